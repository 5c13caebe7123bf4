//! Which entries of a dataset are in this file?
//!
//! A file is known by where it is, not by how its path is written: folders on the way may be links,
//! and a dataset under version control is a folder of links to files that are kept elsewhere. So an
//! entry is found by its own place in the real folder, and by the file that it links to. O(entries)
//! to make, O(1) to ask.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::types::Dataset;

/// Finds the entries and problems of a dataset by file.
#[derive(Debug, Default)]
pub struct Lookup {
    /// Positions of entries, by place in the real folder and by the file linked to.
    entries: HashMap<PathBuf, Vec<usize>>,
    /// Positions of problems, likewise.
    problems: HashMap<PathBuf, usize>,
}

impl Lookup {
    /// Of all entries and problems of `dataset`.
    #[must_use]
    pub fn new(dataset: &Dataset) -> Self {
        let mut folders = Folders::default();
        let mut lookup = Self::default();
        for (position, entry) in dataset.entries.iter().enumerate() {
            let Some(path) = entry.source.path() else {
                continue;
            };
            for place in folders.places(&path) {
                let positions = lookup.entries.entry(place).or_default();
                if positions.last() != Some(&position) {
                    positions.push(position);
                }
            }
        }
        for (position, problem) in dataset.problems.iter().enumerate() {
            for place in problem.file.iter().flat_map(|path| folders.places(path)) {
                lookup.problems.entry(place).or_insert(position);
            }
        }
        lookup
    }

    /// Positions of the entries that are in this file, in order.
    pub fn entries(&self, file: &FileIdentity) -> &[usize] {
        (file.0.iter())
            .find_map(|place| self.entries.get(place))
            .map_or(&[], Vec::as_slice)
    }

    /// The position of the first problem that left something of this file out.
    pub fn problem(&self, file: &FileIdentity) -> Option<usize> {
        file.0
            .iter()
            .find_map(|place| self.problems.get(place).copied())
    }
}

/// Where a file is, whatever its path is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileIdentity(Vec<PathBuf>);

impl FileIdentity {
    /// Of a file, which need not be there.
    #[must_use]
    pub fn of(path: &Path) -> Self {
        Self(Folders::default().places(path))
    }
}

/// The real folders of paths.
#[derive(Default)]
struct Folders(HashMap<PathBuf, Option<PathBuf>>);

impl Folders {
    /// A file's place in its real folder; and the file that it links to, if it does.
    fn places(&mut self, path: &Path) -> Vec<PathBuf> {
        let mut places = Vec::new();
        if let (Some(folder), Some(name)) = (path.parent(), path.file_name()) {
            let real = (self.0.entry(folder.to_owned())).or_insert_with(|| {
                let folder = if folder.as_os_str().is_empty() {
                    Path::new(".")
                } else {
                    folder
                };
                std::fs::canonicalize(folder).ok()
            });
            places.extend(real.as_ref().map(|real| real.join(name)));
        }
        let is_link = std::fs::symlink_metadata(path).is_ok_and(|it| it.is_symlink());
        if is_link || places.is_empty() {
            places.extend(std::fs::canonicalize(path));
        }
        places
    }
}

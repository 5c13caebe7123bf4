//! Which picture is in a file, and when was it taken?
//!
//! As the command `chronotope localize` finds out: an image that an index.csv above it lists is cut,
//! turned and scaled as the index says; its time is the one given, else that of the index, else that
//! of its EXIF data with an offset. The present is never assumed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use chronotope::dataset::{
    Dataset, FileIdentity, FileImage, ImageSource, Lookup, Manifest, ReadOptions, exif_time,
};
use chronotope::map::PlaceKey;
use chronotope::{Error, ErrorKind, Result, Time};

const INDEX: &str = "index.csv";

/// One picture of a file.
#[derive(Clone)]
pub(crate) struct Listed {
    /// How it is called in results.
    pub(crate) name: String,
    pub(crate) source: Arc<dyn ImageSource>,
    /// With who said so.
    pub(crate) time: Option<(Time, &'static str)>,
    /// The place that the index says it shows.
    pub(crate) truth: Option<PlaceKey>,
}

/// A dataset whose entries are found by file.
struct Index {
    dataset: Dataset,
    lookup: Lookup,
}

/// What is known of an index: when it was written, and what it says or why it cannot be read.
type Known = (Option<SystemTime>, Result<Arc<Index>, Arc<Error>>);

/// Turns paths into pictures; every index is read once, and again when it changes.
#[derive(Default)]
pub(crate) struct Files {
    indices: Mutex<BTreeMap<PathBuf, Known>>,
}

impl Files {
    /// The pictures of a file: one, or as many as its index cuts out of it.
    pub(crate) fn list(
        &self,
        path: &Path,
        given: Option<Time>,
        needs_time: bool,
    ) -> Result<Vec<Listed>> {
        let mut listed = self.find(path)?;
        for picture in &mut listed {
            if let Some(time) = given {
                picture.time = Some((time, "option"));
            }
            if picture.time.is_none() {
                // What cannot be read is said when it is decoded.
                let exif = exif_time(path, None).unwrap_or_default();
                picture.time = exif.map(|time| (time, "exif"));
            }
            if picture.time.is_none() && needs_time && path.exists() {
                return Err(no_time(path));
            }
        }
        Ok(listed)
    }

    fn find(&self, path: &Path) -> Result<Vec<Listed>> {
        let file = FileIdentity::of(path);
        for folder in folders_above(path) {
            let Some(index) = self.index_of(&folder) else {
                continue;
            };
            let index = match index {
                Ok(index) => index,
                Err(error) => {
                    tracing::warn!("the index above {} is not used: {error}", path.display());
                    continue;
                }
            };
            if let Some(listed) = entries_of(&index, &file, path)? {
                return Ok(listed);
            }
        }
        Ok(vec![Listed {
            name: path.display().to_string(),
            source: Arc::new(FileImage::new(path)),
            time: None,
            truth: None,
        }])
    }

    /// The index in a folder.
    fn index_of(&self, folder: &Path) -> Option<Result<Arc<Index>, Arc<Error>>> {
        let file = std::fs::metadata(folder.join(INDEX)).ok()?;
        let written = file.modified().ok();
        let mut indices = self.indices.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, index)) = indices.get(folder)
            && *known == written
        {
            return Some(index.clone());
        }
        let read = || {
            let (manifest, data_dir) = Manifest::locate(folder)?;
            let dataset = Dataset::read(&manifest, &data_dir, &ReadOptions::default())?;
            let lookup = Lookup::new(&dataset);
            Ok(Arc::new(Index { dataset, lookup }))
        };
        let index = read().map_err(Arc::new);
        indices.insert(folder.to_owned(), (written, index.clone()));
        Some(index)
    }
}

fn no_time(path: &Path) -> Error {
    let message = "when was it taken? no index.csv above it lists it and it has no EXIF time with an \
                   offset";
    Error::new(ErrorKind::Time, message)
        .with_path(path)
        .with_help("give time=..., or use method=\"static\"")
}

fn entries_of(index: &Index, file: &FileIdentity, path: &Path) -> Result<Option<Vec<Listed>>> {
    let positions = index.lookup.entries(file);
    if positions.is_empty() {
        return match index.lookup.problem(file) {
            None => Ok(None),
            Some(problem) => Err(Error::new(
                ErrorKind::Format,
                format!(
                    "its index leaves it out: {}",
                    index.dataset.problems[problem]
                ),
            )
            .with_path(path)),
        };
    }
    let is_cut = positions.len() > 1;
    let listed = positions.iter().map(|&position| {
        let entry = &index.dataset.entries[position];
        Listed {
            name: if is_cut {
                format!("{} ({} at {})", path.display(), entry.place, entry.time)
            } else {
                path.display().to_string()
            },
            source: Arc::clone(&entry.source),
            time: Some((entry.time, "index")),
            truth: Some(entry.place.clone()),
        }
    });
    Ok(Some(listed.collect()))
}

/// The folders above a file, the nearest first: as its path is given, then as links lead to it.
fn folders_above(path: &Path) -> Vec<PathBuf> {
    let given = std::path::absolute(path).ok();
    let real = std::fs::canonicalize(path).ok();
    let mut folders: Vec<PathBuf> = Vec::new();
    for path in given.iter().chain(&real) {
        for folder in path.ancestors().skip(1) {
            if !folders.iter().any(|known| known == folder) {
                folders.push(folder.to_owned());
            }
        }
    }
    folders
}

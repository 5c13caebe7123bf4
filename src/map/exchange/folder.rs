//! Are the files of an exported folder all there, and those that were written?
//!
//! The `manifest.csv` of a folder lists every other file with its length and SHA-256. Folders of
//! layout 1, which other programs may have written, have none.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::layout::{MANIFEST, MANIFEST_COLUMNS, format_error};
use super::table::Table;
use fremen::error::{Error, ErrorKind, Result};
use fremen::file::{self, OutputFolder};

/// Bytes of one file of the folder, at most.
const MAX_FILE_BYTES: u64 = 1 << 32;
/// Bytes of the manifest, at most.
const MAX_MANIFEST_BYTES: u64 = 1 << 24;

/// What the manifest says of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Entry {
    num_bytes: u64,
    sha256: String,
}

impl Entry {
    fn of(bytes: &[u8]) -> Self {
        let digest = Sha256::digest(bytes);
        let half = |at: usize| u128::from_be_bytes(std::array::from_fn(|i| digest[at + i]));
        Self {
            num_bytes: bytes.len() as u64,
            sha256: format!("{:032x}{:032x}", half(0), half(16)),
        }
    }
}

/// A folder that is being written. Dropped before it is finished, it leaves nothing behind.
pub(super) struct NewFolder {
    folder: OutputFolder,
    manifest: BTreeMap<String, Entry>,
}

impl NewFolder {
    /// Begins a folder that must not exist yet or be empty.
    pub(super) fn begin(path: &Path) -> Result<Self> {
        Ok(Self {
            folder: OutputFolder::begin(path)?,
            manifest: BTreeMap::new(),
        })
    }

    /// Writes a file, whose name may have one folder before it.
    pub(super) fn write(&mut self, name: &str, bytes: &[u8]) -> Result<()> {
        self.folder.write(name, bytes)?;
        self.manifest.insert(name.to_owned(), Entry::of(bytes));
        Ok(())
    }

    /// Writes the manifest and gives the folder its name.
    pub(super) fn finish(self) -> Result<()> {
        let rows: Vec<Vec<String>> = (self.manifest.iter())
            .map(|(name, entry)| {
                vec![
                    name.clone(),
                    entry.num_bytes.to_string(),
                    entry.sha256.clone(),
                ]
            })
            .collect();
        self.folder
            .write(MANIFEST, &Table::to_csv(&MANIFEST_COLUMNS, &rows)?)?;
        self.folder.finish()
    }
}

/// A folder that is read.
pub(super) struct Folder {
    path: PathBuf,
    /// None of layout 1.
    manifest: Option<BTreeMap<String, Entry>>,
}

impl Folder {
    /// Reads the manifest, if there is one.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let manifest_path = path.join(MANIFEST);
        let mut folder = Self {
            path: path.to_owned(),
            manifest: None,
        };
        if fs::symlink_metadata(&manifest_path).is_err() {
            return Ok(folder);
        }
        let bytes = folder.read_within(MANIFEST, MAX_MANIFEST_BYTES)?;
        let table = Table::parse(&manifest_path, &bytes, &MANIFEST_COLUMNS)?;
        let mut manifest = BTreeMap::new();
        for row in &table.rows {
            let entry = Entry {
                num_bytes: table.number(row, 1)?,
                sha256: row[2].to_owned(),
            };
            if manifest.insert(row[0].to_owned(), entry).is_some() {
                return Err(table.cell_error(row, 0, "this file is listed twice"));
            }
        }
        folder.manifest = Some(manifest);
        Ok(folder)
    }

    pub(super) fn has_manifest(&self) -> bool {
        self.manifest.is_some()
    }

    pub(super) fn path_of(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// The bytes of a file, which are what the manifest says.
    pub(super) fn read(&self, name: &str) -> Result<Vec<u8>> {
        let bytes = self.read_within(name, MAX_FILE_BYTES)?;
        let Some(manifest) = &self.manifest else {
            return Ok(bytes);
        };
        let refused = |kind, message: String| {
            Error::new(kind, message)
                .with_path(self.path_of(name))
                .with_help("export the map again")
        };
        let Some(listed) = manifest.get(name) else {
            let message = format!("this file is not listed in {MANIFEST}");
            return Err(refused(ErrorKind::Format, message));
        };
        let found = Entry::of(&bytes);
        if found.num_bytes != listed.num_bytes {
            let message = format!(
                "the file has {} bytes, where {MANIFEST} says {}",
                found.num_bytes, listed.num_bytes
            );
            return Err(refused(ErrorKind::Format, message));
        }
        if found.sha256 != listed.sha256 {
            let message = format!("the file has not the SHA-256 that {MANIFEST} says");
            return Err(refused(ErrorKind::Checksum, message));
        }
        Ok(bytes)
    }

    /// The bytes of a file that is no link to another.
    fn read_within(&self, name: &str, max_bytes: u64) -> Result<Vec<u8>> {
        let path = self.path_of(name);
        let found = fs::symlink_metadata(&path).map_err(|cause| Error::io(&path, cause))?;
        if found.is_symlink() {
            return Err(
                format_error("this is a link, and an exported folder has none")
                    .with_path(&path)
                    .with_help("copy the file itself"),
            );
        }
        file::read(&path, max_bytes)
    }

    /// The names of all files in a folder of the folder, ascending: those that are there, and those
    /// that should be.
    pub(super) fn names_in(&self, inner: &str) -> Result<Vec<String>> {
        let path = self.path_of(inner);
        let prefix = format!("{inner}/");
        let listed = self.manifest.iter().flat_map(BTreeMap::keys);
        let mut names: Vec<String> = (listed.filter(|name| name.starts_with(&prefix)))
            .cloned()
            .collect();
        if path.exists() {
            let io = |cause: std::io::Error| Error::io(&path, cause);
            for entry in fs::read_dir(&path).map_err(io)? {
                let name = entry.map_err(io)?.file_name();
                let Some(name) = name.to_str() else {
                    return Err(format_error("the name of this file is no UTF-8")
                        .with_path(path.join(name)));
                };
                names.push(format!("{prefix}{name}"));
            }
        }
        names.sort();
        names.dedup();
        Ok(names)
    }
}

//! Which files are a table, and is it finished?
//!
//! A table is one file, or a folder of files as Spark writes it: `part-*.parquet`, and `_SUCCESS` once all
//! are whole. A folder of ours is there whole or not at all ([`OutputFolder`]).

use std::fs;
use std::path::{Path, PathBuf};

use fremen::file::OutputFolder;
use fremen::{Error, ErrorKind, Result};

/// The empty file that says that a folder is finished.
pub const SUCCESS: &str = "_SUCCESS";

/// A table that is being written as a folder. Dropped before it is finished, it leaves nothing behind.
#[derive(Debug)]
pub struct TableFolder(OutputFolder);

impl TableFolder {
    /// Begins a folder at a path where nothing is yet, or an empty folder.
    ///
    /// Fails with [`ErrorKind::AlreadyExists`] if something else bears the name.
    pub fn begin(path: impl AsRef<Path>) -> Result<Self> {
        OutputFolder::begin(path).map(Self)
    }

    /// Where a file of the folder is written until the folder is finished.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.file(name)
    }

    /// Writes a file of the folder.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.0.write(name, bytes)
    }

    /// Says that all files are whole, and gives the folder its name.
    pub fn finish(self) -> Result<()> {
        self.0.write(SUCCESS, b"")?;
        self.0.finish()
    }
}

/// The Parquet files that these files and folders are, in order.
///
/// Fails with [`ErrorKind::Format`] for a folder without `_SUCCESS`, or without a file that ends in
/// `.parquet`.
pub fn files_of(inputs: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for input in inputs {
        let found = fs::metadata(input).map_err(|cause| Error::io(input, cause))?;
        if !found.is_dir() {
            files.push(input.clone());
            continue;
        }
        if !input.join(SUCCESS).exists() {
            return Err(
                Error::new(ErrorKind::Format, format!("this folder has no {SUCCESS}"))
                    .with_path(input)
                    .with_help("whoever writes it is not finished, or has failed: write it again"),
            );
        }
        let num_before = files.len();
        add_parts(input, &mut files)?;
        if files.len() == num_before {
            return Err(
                Error::new(ErrorKind::Format, "this folder has no .parquet file")
                    .with_path(input)
                    .with_help("name the files, or the folder that they are in"),
            );
        }
    }
    Ok(files)
}

/// Adds the parts in a folder.
fn add_parts(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    let io = |cause: std::io::Error| Error::io(folder, cause);
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        paths.push(entry.map_err(io)?.path());
    }
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        // As Spark has it, such names are no data.
        if name.starts_with(['_', '.']) {
            continue;
        }
        let is_folder = fs::symlink_metadata(&path).is_ok_and(|it| it.is_dir());
        if is_folder {
            return Err(Error::new(
                ErrorKind::Format,
                "this table is partitioned into folders, whose names hold a column",
            )
            .with_path(&path)
            .with_help(
                "write it without partitionBy: row groups are found by place and day anyway",
            ));
        }
        if path.extension().is_some_and(|it| it == "parquet") {
            files.push(path);
        }
    }
    Ok(())
}

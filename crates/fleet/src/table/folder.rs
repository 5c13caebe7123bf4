//! Which files are a table, and is it finished?
//!
//! A table is one file, or a folder of files as Spark writes it: `part-*.parquet`, and `_SUCCESS` once all
//! are whole. A folder is written under another name (`.NAME.unfinished`) and renamed at the end.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use fremen::file::{OutputFile, rename_new, sync_folder_of};
use fremen::{Error, ErrorKind, Result};

/// The empty file that says that a folder is finished.
pub const SUCCESS: &str = "_SUCCESS";

/// A folder that is being written. Dropped before it is finished, it leaves nothing behind.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    unfinished: PathBuf,
    is_finished: bool,
}

impl OutputFolder {
    /// Begins a folder that must not exist yet.
    ///
    /// Fails with [`ErrorKind::AlreadyExists`] if something bears the name.
    pub fn begin(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let io = |cause: std::io::Error| Error::io(path, cause);
        let whole = std::path::absolute(path).map_err(io)?;
        let Some(name) = whole.file_name() else {
            let error = Error::new(ErrorKind::Config, "this is no name of a folder");
            return Err(error.with_path(path));
        };
        if fs::symlink_metadata(&whole).is_ok() {
            return Err(
                Error::new(ErrorKind::AlreadyExists, "this is there already")
                    .with_path(path)
                    .with_help("a table is never overwritten: choose another name"),
            );
        }
        let mut unfinished = std::ffi::OsString::from(".");
        unfinished.push(name);
        unfinished.push(".unfinished");
        let unfinished = whole.with_file_name(unfinished);
        // What a killed process has left; a link would lead elsewhere.
        if fs::symlink_metadata(&unfinished).is_ok_and(|it| it.is_dir()) {
            fs::remove_dir_all(&unfinished).map_err(io)?;
        }
        fs::create_dir(&unfinished).map_err(|cause| Error::io(&unfinished, cause))?;
        Ok(Self {
            path: whole,
            unfinished,
            is_finished: false,
        })
    }

    /// Where a file of the folder is written until the folder is finished.
    pub fn file(&self, name: &str) -> PathBuf {
        self.unfinished.join(name)
    }

    /// Writes a file of the folder.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.file(name);
        let mut file = OutputFile::begin_new(&path)?;
        file.write_all(bytes)
            .map_err(|cause| Error::io(&path, cause))?;
        file.finish()
    }

    /// Says that all files are whole, and gives the folder its name.
    pub fn finish(mut self) -> Result<()> {
        self.write(SUCCESS, b"")?;
        rename_new(&self.unfinished, &self.path)?;
        self.is_finished = true;
        sync_folder_of(&self.path);
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.is_finished {
            // It is ours; there is nobody to tell.
            let _ = fs::remove_dir_all(&self.unfinished);
        }
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

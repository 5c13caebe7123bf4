//! How is a folder written, so that it is whole or not there and nothing else is lost?
//!
//! As a file is ([`super::output`]): under a name of its own (`.NAME.unfinished`), and renamed once
//! all its files are whole. Two processes that write the same folder exclude each other by a lock.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::output::{
    MAX_ATTEMPTS, OutputFile, being_written, is_same, rename_new, sync_folder_of, unfinished_name,
};
use crate::error::{Error, ErrorKind, Result};

/// A folder that is being written. Dropped before it is finished, it leaves nothing behind.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    unfinished: PathBuf,
    is_finished: bool,
    /// Keeps other processes away.
    _lock: Option<File>,
}

impl OutputFolder {
    /// Begins a folder at a path where nothing is yet, or an empty folder.
    ///
    /// Fails with [`ErrorKind::AlreadyExists`] if something else is there, and with
    /// [`ErrorKind::Conflict`] while another process writes the same folder.
    pub fn begin(path: impl AsRef<Path>) -> Result<Self> {
        let given = path.as_ref();
        // `out/..` and the like have no name of their own.
        let path = std::path::absolute(given).map_err(|cause| Error::io(given, cause))?;
        check_is_free(&path).map_err(|error| error.with_path(given))?;
        let unfinished = unfinished_name(&path).map_err(|error| error.with_path(given))?;
        let lock = claim(&unfinished)?;
        let folder = Self {
            path,
            unfinished,
            is_finished: false,
            _lock: lock,
        };
        // What a killed process has left.
        empty(&folder.unfinished).map_err(|cause| Error::io(&folder.unfinished, cause))?;
        Ok(folder)
    }

    /// Where a file of the folder is until the folder is finished.
    pub fn file(&self, name: impl AsRef<Path>) -> PathBuf {
        self.unfinished.join(name)
    }

    /// Writes a file, whose name may have folders before it.
    pub fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
        let path = self.file(name);
        let io = |cause: std::io::Error| Error::io(&path, cause);
        if let Some(inner) = path.parent() {
            fs::create_dir_all(inner).map_err(io)?;
        }
        let mut file = OutputFile::begin_new(&path)?;
        file.write_all(bytes).map_err(io)?;
        file.finish()
    }

    /// Gives the folder its name; fails with [`ErrorKind::AlreadyExists`] if something has it now.
    pub fn finish(mut self) -> Result<()> {
        check_is_free(&self.path)?;
        if self.path.is_dir() {
            // Goes only if it is still empty.
            fs::remove_dir(&self.path).map_err(|cause| Error::io(&self.path, cause))?;
        }
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

/// An error unless nothing bears this name, or an empty folder.
fn check_is_free(path: &Path) -> Result<()> {
    let Ok(there) = fs::symlink_metadata(path) else {
        return Ok(());
    };
    let message = if there.is_dir() {
        let mut entries = fs::read_dir(path).map_err(|cause| Error::io(path, cause))?;
        if entries.next().is_none() {
            return Ok(());
        }
        "this folder is there already, and it is not empty"
    } else {
        "this is there already, and it is no folder"
    };
    Err(Error::new(ErrorKind::AlreadyExists, message)
        .with_path(path)
        .with_help("a folder is never overwritten: choose another name"))
}

/// Makes a folder that only this process writes until the lock goes; none where folders cannot be
/// locked.
fn claim(path: &Path) -> Result<Option<File>> {
    for _ in 0..MAX_ATTEMPTS {
        match fs::create_dir(path) {
            Ok(()) => {}
            // A link would lead elsewhere.
            Err(_) if fs::symlink_metadata(path).is_ok_and(|it| it.is_dir()) => {}
            Err(cause) => return Err(Error::io(path, cause)),
        }
        let Ok(lock) = File::open(path) else {
            return Ok(None);
        };
        if let Err(fs::TryLockError::WouldBlock) = lock.try_lock() {
            return Err(being_written("folder").with_path(path));
        }
        // Before it was locked, another process may have finished or removed it.
        let found = lock.metadata().map_err(|cause| Error::io(path, cause))?;
        if is_same(&found, path) {
            return Ok(Some(lock));
        }
    }
    Err(being_written("folder").with_path(path))
}

/// Removes all that is in a folder.
fn empty(folder: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        // Of a link, the link.
        if entry.file_type()?.is_dir() {
            fs::remove_dir_all(entry.path())?;
        } else {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::output::tests::names;

    #[test]
    fn a_folder_is_whole_or_not_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("out");
        let out = OutputFolder::begin(&path).expect("nothing is there");
        out.write("a/b", b"1").expect("a disk");
        assert_eq!(names(folder.path()), [".out.unfinished"]);
        drop(out);
        assert!(names(folder.path()).is_empty());

        let out = OutputFolder::begin(&path).expect("nothing is there");
        out.write("a/b", b"1").expect("a disk");
        out.write("c", b"2").expect("a disk");
        out.finish().expect("nothing came");
        assert_eq!(names(folder.path()), ["out"]);
        assert_eq!(names(&path), ["a", "c"]);
        let error = OutputFolder::begin(&path).expect_err("it is there");
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
        assert_eq!(names(&path), ["a", "c"]);
    }

    #[test]
    fn an_empty_folder_is_filled_and_what_came_meanwhile_is_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("out");
        fs::create_dir(&path).expect("new");
        let out = OutputFolder::begin(&path).expect("it is empty");
        fs::write(path.join("theirs"), "1").expect("a disk");
        out.write("ours", b"2").expect("a disk");
        let error = out.finish().expect_err("somebody was faster");
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
        assert_eq!(names(&path), ["theirs"]);
        assert_eq!(names(folder.path()), ["out"]);

        fs::remove_file(path.join("theirs")).expect("there");
        let out = OutputFolder::begin(&path).expect("it is empty");
        out.finish().expect("still empty");
        assert!(names(&path).is_empty());

        let file = folder.path().join("file");
        fs::write(&file, "1").expect("a disk");
        let error = OutputFolder::begin(&file).expect_err("a file");
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
    }

    #[cfg(unix)]
    #[test]
    fn a_rest_is_taken_over_a_writer_is_not_and_links_are_not_followed() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, elsewhere) = (folder.path().join("out"), folder.path().join("elsewhere"));
        fs::create_dir(&elsewhere).expect("new");
        fs::write(elsewhere.join("dear"), "1").expect("a disk");
        let rest = folder.path().join(".out.unfinished");
        fs::create_dir_all(rest.join("inner")).expect("new");
        fs::write(rest.join("inner/old"), "1").expect("a disk");
        std::os::unix::fs::symlink(&elsewhere, rest.join("link")).expect("new");

        let out = OutputFolder::begin(&path).expect("a rest is no obstacle");
        let error = OutputFolder::begin(&path).expect_err("it is being written");
        assert_eq!(error.kind(), ErrorKind::Conflict);
        out.write("new", b"2").expect("a disk");
        out.finish().expect("nothing came");
        assert_eq!(names(&path), ["new"]);
        assert_eq!(names(&elsewhere), ["dear"]);

        fs::remove_dir_all(&path).expect("there");
        std::os::unix::fs::symlink(&elsewhere, &rest).expect("new");
        OutputFolder::begin(&path).expect_err("a link is in the way");
        assert_eq!(names(&elsewhere), ["dear"]);
    }
}

//! How is a large file read without a copy of it in memory?
//!
//! [`MappedFile`] lets the system bring in those pages that are looked at, and drop them again;
//! processes that read the same file share them.
//!
//! Not for files that are written in place: only for those that are written under another name and
//! then renamed, so that what is mapped never changes and never gets shorter.
#![allow(unsafe_code)] // reason: the system cannot promise that nobody changes a mapped file.

use std::fs::File;
use std::io;
use std::ops::Deref;

use memmap2::Mmap;

/// The bytes of a file that is never changed in place.
#[derive(Debug)]
pub struct MappedFile(Mmap);

impl MappedFile {
    /// Maps all of a regular file; it may be closed afterwards.
    pub fn of(file: &File) -> io::Result<Self> {
        if !file.metadata()?.is_file() {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        // SAFETY: files that are opened so are written under another name, renamed once whole, and
        // from then on only removed; a mapping outlives both.
        let mapped = unsafe { Mmap::map(file) }?;
        Ok(Self(mapped))
    }
}

impl Deref for MappedFile {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mapped_file_is_what_was_written_also_once_it_is_removed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("file");
        std::fs::write(&path, b"some bytes").expect("written");
        let mapped = MappedFile::of(&File::open(&path).expect("there")).expect("mapped");
        std::fs::remove_file(&path).expect("removed");
        assert_eq!(&*mapped, b"some bytes");
        let folder = File::open(folder.path()).expect("there");
        assert!(MappedFile::of(&folder).is_err());
    }
}

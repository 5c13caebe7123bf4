//! What do the first bytes of a file say it is?

use std::io::Read;
use std::path::Path;
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use fremen::error::{Error, ErrorKind, Result};

use crate::journal::has_journal;
use crate::kind::Kind;

/// POSIX drops all locks of a process on a file when any descriptor of that file is closed, so the
/// header is read (exclusive) only while no transaction of this process runs (shared).
static DESCRIPTORS: RwLock<()> = RwLock::new(());

/// What a transaction of this process holds.
pub(crate) fn shared() -> RwLockReadGuard<'static, ()> {
    DESCRIPTORS.read().unwrap_or_else(PoisonError::into_inner)
}

/// What this process holds while it opens a file by other ways than `SQLite`'s.
pub(crate) fn alone() -> RwLockWriteGuard<'static, ()> {
    DESCRIPTORS.write().unwrap_or_else(PoisonError::into_inner)
}

/// Looks at a file's first bytes: an error unless it is a whole file of this kind.
pub(crate) fn peek(kind: &Kind, path: &Path) -> Result<()> {
    let Kind { noun, maker, .. } = kind;
    let io = |error: std::io::Error| {
        let error = Error::io(path, error);
        if path.exists() {
            error
        } else {
            error.with_help(format!("make a {noun} with `{maker}`"))
        }
    };
    let format = |message: String| Error::new(ErrorKind::Format, message).with_path(path);
    let metadata = std::fs::metadata(path).map_err(io)?;
    if metadata.is_dir() {
        return Err(
            format(format!("this is a folder, not a {noun} file")).with_help(kind.help_for_folder)
        );
    }
    if !metadata.is_file() {
        return Err(format("this is no regular file".into()));
    }
    let mut header = Vec::new();
    {
        let _alone = alone();
        let file = fremen::file::open(path)?;
        file.take(100).read_to_end(&mut header).map_err(io)?;
    }
    let (num_pages, page_bytes) =
        check_header(kind, &header).map_err(|error| error.with_path(path))?;
    // While a commit runs the file may be shorter than its header says; once the journal is gone
    // the commit is complete, so the length is read last.
    let journal = has_journal(path);
    let is_size_valid = word(&header, 24) == word(&header, 92);
    let (whole, found) = (
        u64::from(num_pages) * page_bytes,
        std::fs::metadata(path).map_err(io)?.len(),
    );
    if !journal && is_size_valid && found < whole {
        return Err(format(format!(
            "the file has been cut off: {found} of {whole} bytes"
        ))
        .with_help("restore a copy"));
    }
    Ok(())
}

/// The number of pages and the bytes of a page, if this is the header of a file of this kind.
fn check_header(kind: &Kind, header: &[u8]) -> Result<(u32, u64)> {
    let Kind { noun, maker, .. } = kind;
    let format = |message: String| Error::new(ErrorKind::Format, message);
    if header.is_empty() {
        return Err(format("the file is empty".into()).with_help(format!(
            "its creation or a copy was interrupted: delete it and build or copy the {noun} again"
        )));
    }
    let give_another = || format!("give the file that `{maker}` has written");
    if !header.starts_with(b"SQLite format 3\0") {
        return Err(
            format(format!("this is {}, not a {noun} file", describe(header)))
                .with_help(give_another()),
        );
    }
    let (Some(id), Some(version), Some(num_pages)) =
        (word(header, 68), word(header, 60), word(header, 28))
    else {
        return Err(
            format(format!("the file ends after {} bytes", header.len()))
                .with_help("restore a copy"),
        );
    };
    if id != kind.application_id {
        return Err(format(format!(
            "this is an SQLite file of another program (application id {id:#010x}), not a {noun}"
        ))
        .with_help(give_another()));
    }
    if version > kind.version {
        let help = format!("use a newer {}", kind.program);
        return Err(kind.unknown_version(version).with_help(help));
    }
    if version == 0 {
        return Err(
            format(format!("the {noun} has format 0, which does not exist"))
                .with_help("the file is damaged: restore a copy"),
        );
    }
    if header[18..20] != [1, 1] {
        let message = format!("the {noun} is in WAL mode, which keeps part of it in other files");
        return Err(format(message)
            .with_help("`sqlite3 FILE 'PRAGMA journal_mode=DELETE'` makes one file of it"));
    }
    let page_bytes = match header[16..18] {
        [0, 1] => 65536,
        [high, low] => u64::from(high) << 8 | u64::from(low),
        _ => 0,
    };
    Ok((num_pages, page_bytes))
}

/// The big-endian number at a byte of the header.
fn word(header: &[u8], at: usize) -> Option<u32> {
    let bytes = header.get(at..at + 4)?;
    bytes.try_into().ok().map(u32::from_be_bytes)
}

/// What a file that is not `SQLite`'s seems to be.
fn describe(header: &[u8]) -> &'static str {
    const KINDS: [(&[u8], &str); 10] = [
        (b"\x89PNG", "a PNG image"),
        (b"\xff\xd8\xff", "a JPEG image"),
        (b"BM", "a BMP image"),
        (b"II*\0", "a TIFF image"),
        (b"MM\0*", "a TIFF image"),
        (b"GIF8", "a GIF image"),
        (b"PK\x03\x04", "a ZIP archive"),
        (b"\x1f\x8b", "a gzip archive"),
        (b"%YAML", "a YAML text"),
        (b"%PDF", "a PDF document"),
    ];
    let is_text = |bytes: &[u8]| {
        let valid = match std::str::from_utf8(bytes) {
            Ok(_) => true,
            // A character may be cut at the end of what was read.
            Err(error) => error.error_len().is_none(),
        };
        valid && bytes.iter().all(|&b| b >= b' ' || b.is_ascii_whitespace())
    };
    KINDS
        .iter()
        .find(|(magic, _)| header.starts_with(magic))
        .map_or(
            if is_text(header) {
                "a text"
            } else {
                "a file of unknown kind"
            },
            |(_, kind)| kind,
        )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kind::tests::NOTES;

    /// The header of a note of seven pages.
    fn header(page_size: [u8; 2]) -> Vec<u8> {
        let mut header = b"SQLite format 3\0".to_vec();
        header.extend(page_size);
        header.extend([1, 1]);
        header.resize(100, 0);
        header[28..32].copy_from_slice(&7_u32.to_be_bytes());
        header[60..64].copy_from_slice(&2_u32.to_be_bytes());
        header[68..72].copy_from_slice(&NOTES.application_id.to_be_bytes());
        header
    }

    #[test]
    fn a_header_says_how_many_pages_there_are_and_how_large() {
        for (page_size, page_bytes) in [([2, 0], 512), ([16, 0], 4_096), ([0, 1], 65_536)] {
            let found = check_header(&NOTES, &header(page_size)).expect("a note");
            assert_eq!(found, (7, page_bytes));
        }
    }

    #[test]
    fn a_header_of_something_else_is_named() {
        let complaint = |header: &[u8]| {
            let error = check_header(&NOTES, header).expect_err("no note");
            assert_eq!(error.kind(), ErrorKind::Format);
            error.to_string()
        };
        let with = |at: usize, bytes: &[u8]| {
            let mut header = header([16, 0]);
            header[at..at + bytes.len()].copy_from_slice(bytes);
            complaint(&header)
        };
        assert!(complaint(&header([16, 0])[..71]).contains("ends after 71 bytes"));
        assert!(with(68, b"geo!").contains("application id 0x67656f21"));
        assert!(with(60, &[0, 0, 0, 3]).contains("use a newer notes"));
        assert!(with(60, &[0; 4]).contains("format 0, which does not exist"));
        for wal in [[2, 2], [1, 2], [2, 1]] {
            assert!(with(18, &wal).contains("WAL mode"), "{wal:?}");
        }
        let cut = "é".repeat(50);
        for (bytes, what) in [
            (&b"\x89PNG\r\n\x1a\n"[..], "a PNG image"),
            (b"\x1f\x8b\x08", "a gzip archive"),
            (b"place,time\tnote\r\n", "a text"),
            (&cut.as_bytes()[..99], "a text"),
            (b"word\x01word", "a file of unknown kind"),
            (b"word \xff word", "a file of unknown kind"),
        ] {
            let complaint = complaint(bytes);
            assert!(
                complaint.contains(&format!("this is {what}, not a note")),
                "{complaint}"
            );
        }
    }
}

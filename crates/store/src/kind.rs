//! What kind of file is this, and in which words are its faults reported?

use fremen::error::{Error, ErrorKind};
use rusqlite::ErrorCode as Code;

use crate::table::Table;

/// A kind of file that is kept in generations.
#[derive(Debug)]
pub struct Kind {
    /// What people call such a file: `map`.
    pub noun: &'static str,
    /// `SQLite`'s `application_id` of such files.
    pub application_id: u32,
    /// The version that is written (`SQLite`'s `user_version`); all before it, from 1, are read,
    /// too.
    pub version: u32,
    /// Every table of a version, in order of creation; the first is that of the generations.
    pub tables: fn(u32) -> &'static [&'static Table],
    /// Columns of the table of generations that name another generation: pruning gives them its new
    /// number.
    pub references: &'static [&'static str],
    /// The program that reads them: `chronotope`.
    pub program: &'static str,
    /// Its command for such files, which has `verify` and `log`: `chronotope map`.
    pub tool: &'static str,
    /// The command that makes such a file: `chronotope map build`.
    pub maker: &'static str,
    /// What helps where a folder is given for such a file.
    pub help_for_folder: &'static str,
}

impl Kind {
    /// Every table of the version that is written.
    pub fn tables_now(&self) -> &'static [&'static Table] {
        (self.tables)(self.version)
    }

    /// What failed in `SQLite`, in words for people.
    pub fn sqlite_error(&self, error: &rusqlite::Error) -> Error {
        let Self { noun, tool, .. } = self;
        let extended = error.sqlite_error().map(|error| error.extended_code);
        let rights = || "check the rights of the file and of its folder".to_owned();
        let (kind, message, help) = match error.sqlite_error_code() {
            Some(Code::ReadOnly) if extended == Some(rusqlite::ffi::SQLITE_READONLY_ROLLBACK) => (
                ErrorKind::Io,
                format!(
                    "the last commit was interrupted and has to be undone before the {noun} can be \
                     read"
                ),
                "open it once where file and folder may be written, together with its `-journal`"
                    .into(),
            ),
            Some(Code::DiskFull) => (
                ErrorKind::Io,
                format!("the disk is full; the {noun} stays as it was"),
                "free some space and repeat".into(),
            ),
            Some(Code::ReadOnly) if extended == Some(rusqlite::ffi::SQLITE_READONLY_DBMOVED) => {
                return self.moved("nothing is written", " and repeat the change");
            }
            Some(Code::ReadOnly) => (
                ErrorKind::Io,
                "the file or its folder may not be written".into(),
                format!("a commit needs both to be writable: change the rights or copy the {noun}"),
            ),
            Some(Code::CannotOpen) => (
                ErrorKind::Io,
                "the file or its journal cannot be opened".into(),
                rights(),
            ),
            Some(Code::PermissionDenied) => (ErrorKind::Io, "access is denied".into(), rights()),
            Some(Code::DatabaseBusy | Code::DatabaseLocked) => (
                ErrorKind::Conflict,
                format!("another process is writing to this {noun}"),
                "wait until it has finished and repeat".into(),
            ),
            Some(Code::SystemIoFailure) => (
                ErrorKind::Io,
                "the disk failed to read or write".into(),
                format!("check the disk, then `{tool} verify`"),
            ),
            Some(Code::DatabaseCorrupt | Code::NotADatabase) => (
                ErrorKind::Format,
                "the file is damaged".into(),
                format!("restore a copy; `{tool} verify` lists the faults"),
            ),
            _ => (
                ErrorKind::Io,
                "SQLite failed".into(),
                "see the message".into(),
            ),
        };
        Error::new(kind, format!("{message} ({error})")).with_help(help)
    }

    /// What is said of a file that is no longer where it was opened.
    pub(crate) fn moved(&self, consequence: &str, and_then: &str) -> Error {
        let message = format!(
            "the {} was moved away, deleted or replaced since it was opened; {consequence}",
            self.noun
        );
        Error::new(ErrorKind::Io, message)
            .with_help(format!("open the {} again{and_then}", self.noun))
    }

    /// What is said of a version that is not read.
    pub(crate) fn unknown_version(&self, version: u32) -> Error {
        let message = format!(
            "the {} has format {version}; this program reads formats up to {}",
            self.noun, self.version
        );
        Error::new(ErrorKind::Format, message)
    }

    /// What is said where the file has no such generation.
    pub fn no_generation(&self, number: u64) -> Error {
        let message = format!("the {} has no generation {number}", self.noun);
        Error::new(ErrorKind::NotFound, message).with_help(format!(
            "`{} log` lists the generations that it has",
            self.tool
        ))
    }

    /// What is said where the file has no generation at all.
    pub fn no_generations(&self) -> Error {
        let message = format!("this {} has no generation", self.noun);
        Error::new(ErrorKind::Format, message)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rusqlite::ffi;

    pub(crate) static NOTES: Kind = Kind {
        noun: "note",
        application_id: 0x6e6f_7465,
        version: 2,
        tables: |_| &[],
        references: &[],
        program: "notes",
        tool: "notes file",
        maker: "notes file new",
        help_for_folder: "a note is one file",
    };

    #[test]
    fn what_sqlite_says_is_said_in_words_that_help() {
        for (code, kind, words) in [
            (
                ffi::SQLITE_READONLY_ROLLBACK,
                ErrorKind::Io,
                "the last commit was interrupted and has to be undone before the note",
            ),
            (
                ffi::SQLITE_READONLY_DBMOVED,
                ErrorKind::Io,
                "open the note again and repeat the change",
            ),
            (
                ffi::SQLITE_READONLY,
                ErrorKind::Io,
                "change the rights or copy the note",
            ),
            (
                ffi::SQLITE_READONLY_DIRECTORY,
                ErrorKind::Io,
                "the file or its folder may not be written",
            ),
            (ffi::SQLITE_FULL, ErrorKind::Io, "free some space"),
            (ffi::SQLITE_CANTOPEN, ErrorKind::Io, "cannot be opened"),
            (ffi::SQLITE_PERM, ErrorKind::Io, "access is denied"),
            (
                ffi::SQLITE_BUSY,
                ErrorKind::Conflict,
                "another process is writing to this note",
            ),
            (
                ffi::SQLITE_LOCKED,
                ErrorKind::Conflict,
                "wait until it has finished",
            ),
            (
                ffi::SQLITE_IOERR_FSYNC,
                ErrorKind::Io,
                "check the disk, then `notes file verify`",
            ),
            (ffi::SQLITE_CORRUPT, ErrorKind::Format, "restore a copy"),
            (ffi::SQLITE_NOTADB, ErrorKind::Format, "the file is damaged"),
            (ffi::SQLITE_TOOBIG, ErrorKind::Io, "SQLite failed"),
        ] {
            let error = rusqlite::Error::SqliteFailure(ffi::Error::new(code), None);
            let error = NOTES.sqlite_error(&error);
            assert_eq!(error.kind(), kind, "{code}: {error}");
            assert!(error.to_string().contains(words), "{code}: {error}");
        }
    }
}

//! How is a file opened with `SQLite`, so that its content cannot do anything?

use std::path::Path;
use std::time::Duration;

use fremen::error::{Error, ErrorKind, Result};
use rusqlite::{Connection, ErrorCode, MAIN_DB, OpenFlags, ffi};

use crate::kind::Kind;

/// How long to wait for another process that commits.
pub(crate) const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

/// What a file is opened for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// To be read and never changed.
    ReadOnly,
    /// To be written where file and folder allow it.
    ReadWrite,
}

impl Access {
    fn flags(self) -> OpenFlags {
        match self {
            Self::ReadOnly => OpenFlags::SQLITE_OPEN_READ_ONLY,
            Self::ReadWrite => OpenFlags::SQLITE_OPEN_READ_WRITE,
        }
    }
}

/// Opens the file at `path`.
pub(crate) fn connect(kind: &Kind, path: &Path, access: Access) -> Result<Connection> {
    // An absolute path is never taken for one of SQLite's special names (`:memory:`, `file:...`).
    let path = std::path::absolute(path).map_err(|error| Error::io(path, error))?;
    let connect = || {
        let flags = access.flags() | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags)?;
        connection.busy_timeout(BUSY_TIMEOUT)?;
        restrict(&connection)?;
        // EXTRA also syncs the folder once the journal is gone: a commit that was acknowledged
        // stays.
        connection.pragma_update(None, "synchronous", "EXTRA")?;
        Ok(connection)
    };
    connect().map_err(|error: rusqlite::Error| kind.sqlite_error(&error))
}

/// Whether there is a journal that the next writer would play: nobody who lives is writing.
pub(crate) fn is_interrupted(kind: &Kind, path: &Path) -> Result<bool> {
    let path = std::path::absolute(path).map_err(|error| Error::io(path, error))?;
    let look = || {
        let flags = Access::ReadOnly.flags() | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags)?;
        connection.busy_timeout(BUSY_TIMEOUT)?;
        // Any reading will do: one that may not write says so and changes nothing.
        connection.query_row("PRAGMA schema_version", [], |_| Ok(()))
    };
    match look() {
        Ok(()) => Ok(false),
        Err(error) => {
            let code = error.sqlite_error().map(|error| error.extended_code);
            match code {
                Some(ffi::SQLITE_READONLY_ROLLBACK) => Ok(true),
                // What is wrong with it will be said when it is opened.
                _ if error.sqlite_error_code() != Some(ErrorCode::DatabaseBusy) => Ok(false),
                _ => Err(kind.sqlite_error(&error)),
            }
        }
    }
}

/// Opens the bytes of a file to be read, from memory.
pub(crate) fn connect_image(kind: &Kind, image: &[u8]) -> Result<Connection> {
    let connect = || {
        let mut connection = Connection::open_in_memory()?;
        connection.deserialize_read_exact(MAIN_DB, image, image.len(), true)?;
        restrict(&connection)?;
        Ok(connection)
    };
    if image.is_empty() {
        return Err(Error::new(ErrorKind::Format, "the file is empty"));
    }
    connect().map_err(|error: rusqlite::Error| kind.sqlite_error(&error))
}

/// A file from elsewhere must not run functions by its schema, nor lead a reader astray by cells
/// that are not as long as they say.
fn restrict(connection: &Connection) -> rusqlite::Result<()> {
    connection.pragma_update(None, "trusted_schema", false)?;
    connection.pragma_update(None, "cell_size_check", true)
}

//! How is something kept in a file, whatever happens to the machine?
//!
//! A [`Store`] is an `SQLite` file with a rollback journal: one file once no commit is running,
//! opened read-only without writing anything beside it. A commit is one transaction with full
//! synchronisation, and appends: its cost follows from what is new, not from what is stored. What
//! an interrupted commit left behind is undone when the file is next opened to be written. One
//! process writes at a time, any number read; nobody holds a lock between calls.

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fremen::error::{Error, ErrorKind, Result};
use rusqlite::{Connection, OpenFlags, Transaction, TransactionBehavior};

use crate::fault::{Fault, Faults};
use crate::generation::Tip;
use crate::header::{peek, shared};
use crate::kind::Kind;
use crate::prune;
use crate::transaction::{Reader, Writer};

/// How long to wait for another process that commits.
const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

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

/// An open file of generations.
#[derive(Debug)]
pub struct Store {
    kind: &'static Kind,
    path: PathBuf,
    connection: Connection,
    is_read_only: bool,
}

impl Store {
    /// Makes a new file with what `fill` writes, generation 0 among it; one that exists is never
    /// overwritten.
    pub fn create(
        kind: &'static Kind,
        path: &Path,
        page_bytes: u32,
        fill: impl FnOnce(&Writer<'_>) -> Result<()>,
    ) -> Result<Self> {
        let noun = kind.noun;
        File::create_new(path).map_err(|error| {
            let help = match error.kind() {
                std::io::ErrorKind::AlreadyExists => format!(
                    "a {noun} is never overwritten: choose another name, or update the {noun}"
                ),
                std::io::ErrorKind::NotFound => "create the folder first".into(),
                _ => "choose a folder that may be written".into(),
            };
            Error::io(path, error).with_help(help)
        })?;
        let created = Self::create_in(kind, path, page_bytes, fill);
        if created.is_err() {
            // It is ours, and holds nothing yet; that it cannot be removed matters less than why.
            let _ = std::fs::remove_file(path);
        }
        created.map_err(|error| error.with_path(path))
    }

    fn create_in(
        kind: &'static Kind,
        path: &Path,
        page_bytes: u32,
        fill: impl FnOnce(&Writer<'_>) -> Result<()>,
    ) -> Result<Self> {
        let failed = |error: rusqlite::Error| kind.sqlite_error(&error);
        let mut connection = connect(kind, path, Access::ReadWrite)?;
        (connection.pragma_update(None, "page_size", page_bytes)).map_err(failed)?;
        {
            let _shared = shared();
            let transaction = connection
                .transaction_with_behavior(TransactionBehavior::Immediate)
                .map_err(failed)?;
            let writer = Writer::new(&transaction, kind);
            writer.create_tables().map_err(failed)?;
            fill(&writer)?;
            transaction.commit().map_err(failed)?;
        }
        Ok(Self {
            kind,
            path: path.to_path_buf(),
            connection,
            is_read_only: false,
        })
    }

    /// Opens a file, checks that it is one of this kind, and gives what `read` finds in it.
    pub fn open<T>(
        kind: &'static Kind,
        path: &Path,
        access: Access,
        read: impl FnOnce(&Reader<'_>) -> Result<T>,
    ) -> Result<(Self, T)> {
        let open = || {
            peek(kind, path)?;
            let mut connection = connect(kind, path, access)?;
            let is_read_only = connection
                .is_readonly(c"main")
                .map_err(|error| kind.sqlite_error(&error))?;
            let found = reading(kind, &mut connection, |reader| {
                reader.check_schema(&mut Faults::strict(kind))?;
                if !is_read_only {
                    // Writing to a file of broken structure would spread the damage.
                    reader.check_structure("quick_check", &mut Faults::strict(kind))?;
                }
                read(reader)
            })?;
            let path = path.to_path_buf();
            let store = Self {
                kind,
                path,
                connection,
                is_read_only,
            };
            Ok((store, found))
        };
        open().map_err(|error: Error| error.with_path(path))
    }

    /// Reads a little of a file and closes it again.
    pub fn glance<T>(
        kind: &'static Kind,
        path: &Path,
        read: impl FnOnce(&Reader<'_>) -> Result<T>,
    ) -> Result<T> {
        let glance = || {
            peek(kind, path)?;
            let mut connection = connect(kind, path, Access::ReadOnly)?;
            reading(kind, &mut connection, |reader| {
                reader.check_schema(&mut Faults::strict(kind))?;
                read(reader)
            })
        };
        glance().map_err(|error| error.with_path(path))
    }

    /// Checks a file and changes nothing: `SQLite`'s pages, the declaration of the tables, then
    /// what `read` checks of the rows; gives what that found and the faults, at most `limit`.
    ///
    /// An error says that the file is not of this kind at all or cannot be read.
    pub fn verify<T>(
        kind: &'static Kind,
        path: &Path,
        limit: usize,
        read: impl FnOnce(&Reader<'_>, &mut Faults) -> Result<Option<T>>,
    ) -> Result<(Option<T>, Vec<Fault>)> {
        let mut faults = Faults::listing(kind, limit);
        let verify = || {
            peek(kind, path)?;
            let mut connection = connect(kind, path, Access::ReadOnly)?;
            let found = reading(kind, &mut connection, |reader| {
                reader.check_schema(&mut faults)?;
                if !faults.is_clean() {
                    return Ok(None);
                }
                reader.check_structure("integrity_check", &mut faults)?;
                let pages = reader.num_page_bytes()?;
                let found = std::fs::metadata(path).map_or(pages, |metadata| metadata.len());
                if found != pages {
                    let message = format!("the file has {found} bytes, its pages {pages}");
                    faults.add(Fault::new("file", ErrorKind::Format, message))?;
                }
                read(reader, &mut faults)
            });
            match found {
                Err(error) if !faults.is_full() => Err(error),
                // One fault too many ends the reading; the list is full then.
                found => Ok(found.ok().flatten()),
            }
        };
        let found = verify().map_err(|error| error.with_path(path))?;
        Ok((found, faults.into_list()))
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether [`write`](Self::write) is known to fail: opened read-only, or the file may not be
    /// written. That the folder may not be written shows only at a commit.
    pub fn is_read_only(&self) -> bool {
        self.is_read_only
    }

    /// Bytes of the file.
    pub fn num_bytes(&self) -> Result<u64> {
        let metadata = std::fs::metadata(&self.path);
        metadata
            .map(|it| it.len())
            .map_err(|error| Error::io(&self.path, error))
    }

    /// Runs `read` in one transaction that changes nothing.
    pub fn read<T>(&mut self, read: impl FnOnce(&Reader<'_>) -> Result<T>) -> Result<T> {
        reading(self.kind, &mut self.connection, read).map_err(|error| error.with_path(&self.path))
    }

    /// Commits what `write` writes, if the file still stands at `tip`; a file of an older version
    /// becomes one of today's.
    ///
    /// Once this returns, the commit survives a power loss; on any error the file is as before.
    pub fn write(&mut self, tip: Tip, write: impl FnOnce(&Writer<'_>) -> Result<()>) -> Result<()> {
        let kind = self.kind;
        let commit = || {
            let _shared = shared();
            let transaction = begin(kind, self.is_read_only, &mut self.connection, tip)?;
            let writer = Writer::new(&transaction, kind);
            writer.migrate()?;
            write(&writer)?;
            transaction
                .commit()
                .map_err(|error| kind.sqlite_error(&error))
        };
        commit().map_err(|error| error.with_path(&self.path))
    }

    /// Forgets all generations but 0, the newest, those in `keep` and those where their lines part,
    /// if the file still stands at `tip`. Gives what `read` finds then, which must be the same as
    /// before by `is_same`, and how many went; `None` if all of them stay.
    pub fn prune<T>(
        &mut self,
        tip: Tip,
        keep: &BTreeSet<u64>,
        read: impl Fn(&Reader<'_>) -> Result<T>,
        is_same: impl Fn(&T, &T) -> bool,
    ) -> Result<Option<(T, usize)>> {
        let kind = self.kind;
        let prune = || {
            let _shared = shared();
            let transaction = begin(kind, self.is_read_only, &mut self.connection, tip)?;
            let Some(pruned) = prune::prune(&transaction, kind, keep, read, is_same)? else {
                return Ok(None);
            };
            transaction
                .commit()
                .map_err(|error| kind.sqlite_error(&error))?;
            Ok(Some(pruned))
        };
        prune().map_err(|error: Error| error.with_path(&self.path))
    }

    /// Makes the file as small as it can be, for which the disk needs room for a second one.
    pub fn vacuum(&mut self) -> Result<()> {
        let _shared = shared();
        (self.connection.execute_batch("VACUUM"))
            .map_err(|error| self.kind.sqlite_error(&error).with_path(&self.path))
    }

    /// The connection, for tests that damage what it holds.
    #[doc(hidden)]
    pub fn connection(&self) -> &Connection {
        &self.connection
    }
}

fn connect(kind: &Kind, path: &Path, access: Access) -> Result<Connection> {
    // An absolute path is never taken for one of SQLite's special names (`:memory:`, `file:...`).
    let path = std::path::absolute(path).map_err(|error| Error::io(path, error))?;
    let connect = || {
        let flags = access.flags() | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags)?;
        connection.busy_timeout(BUSY_TIMEOUT)?;
        // A file from elsewhere must not run functions by its schema.
        connection.pragma_update(None, "trusted_schema", false)?;
        connection.pragma_update(None, "cell_size_check", true)?;
        // EXTRA also syncs the folder once the journal is gone: a commit that was acknowledged
        // stays.
        connection.pragma_update(None, "synchronous", "EXTRA")?;
        Ok(connection)
    };
    connect().map_err(|error: rusqlite::Error| kind.sqlite_error(&error))
}

/// Runs `read` in one transaction that changes nothing.
fn reading<T>(
    kind: &'static Kind,
    connection: &mut Connection,
    read: impl FnOnce(&Reader<'_>) -> Result<T>,
) -> Result<T> {
    let _shared = shared();
    let transaction = connection
        .transaction()
        .map_err(|error| kind.sqlite_error(&error))?;
    read(&Reader::new(&transaction, kind)?)
}

/// Starts to write, if the file still stands at `tip`. The caller holds [`shared`].
fn begin<'a>(
    kind: &Kind,
    is_read_only: bool,
    connection: &'a mut Connection,
    tip: Tip,
) -> Result<Transaction<'a>> {
    let noun = kind.noun;
    if is_read_only {
        let message = format!("this {noun} is open read-only");
        return Err(Error::new(ErrorKind::Io, message)
            .with_help("copy it to a place where it may be written"));
    }
    let failed = |error: rusqlite::Error| kind.sqlite_error(&error);
    let transaction = connection
        .transaction_with_behavior(TransactionBehavior::Immediate)
        .map_err(failed)?;
    let version: u32 = transaction
        .query_row("PRAGMA user_version", [], |row| row.get(0))
        .map_err(failed)?;
    let newest = Tip::read(&transaction, kind, version).map_err(failed)?;
    if newest == tip {
        return Ok(transaction);
    }
    let what = if newest.prunes == tip.prunes {
        format!(
            "another process has committed generation {} on top of {}, which this change was made \
             for",
            newest.number, tip.number
        )
    } else {
        format!("another process has pruned the {noun} since this change was made")
    };
    Err(Error::new(ErrorKind::Conflict, what)
        .with_help(format!("refresh the {noun} and repeat the change")))
}

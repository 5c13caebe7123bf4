//! How is something kept in a file, whatever happens to the machine?
//!
//! A [`Store`] is an `SQLite` file with a rollback journal: one file once no commit is running,
//! opened read-only without writing anything beside it. A commit is one transaction with full
//! synchronisation, and appends: its cost follows from what is new, not from what is stored. What
//! an interrupted commit left behind is undone when the file is next opened, to be read or written;
//! where that may not be, it is read past. One process writes at a time, any number read; nobody
//! holds a lock between calls, but a writer that was overtaken may ask others to wait
//! ([`Store::take_turn`]). A new file is made under another name and renamed, so what bears the
//! name is whole.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use fremen::error::{Error, ErrorKind, Result};
use fremen::file::{Turn, Unfinished, number_at};
use rusqlite::{Connection, Transaction, TransactionBehavior};

use crate::connection::{Access, BUSY_TIMEOUT, connect, connect_image};
use crate::fault::{Fault, Faults};
use crate::generation::Tip;
use crate::header::{peek, shared};
use crate::heal::{Settled, clear_the_way, settle};
use crate::kind::Kind;
use crate::prune;
use crate::transaction::{Check, Reader, Writer};

/// An open file of generations.
#[derive(Debug)]
pub struct Store {
    kind: &'static Kind,
    check: Check,
    path: PathBuf,
    /// Which file bore the name when it was opened.
    number: Option<(u64, u64)>,
    connection: Connection,
    is_read_only: bool,
    /// Whether it is read from memory, because what a killed writer left cannot be undone here.
    is_image: bool,
    /// Held while a change is made again.
    turn: Option<Turn>,
}

impl Store {
    /// Makes a new file with what `fill` writes, generation 0 among it; one that exists is never
    /// overwritten.
    pub fn create(
        kind: &'static Kind,
        path: &Path,
        page_bytes: u32,
        check: Check,
        fill: impl FnOnce(&Writer<'_>) -> Result<()>,
    ) -> Result<Self> {
        let noun = kind.noun;
        let create = || {
            let unfinished = Unfinished::begin(path).map_err(|error| match error.kind() {
                ErrorKind::AlreadyExists => {
                    Error::new(error.kind(), error.message()).with_help(format!(
                        "a {noun} is never overwritten: choose another name, or update the {noun}"
                    ))
                }
                _ => error,
            })?;
            create_in(kind, unfinished.path(), page_bytes, fill)?;
            clear_the_way(kind, path)?;
            unfinished.finish()?;
            let connection = connect(kind, path, Access::ReadWrite)?;
            Ok(Self {
                kind,
                check,
                path: path.to_path_buf(),
                number: number_at(path)?,
                connection,
                is_read_only: false,
                is_image: false,
                turn: None,
            })
        };
        create().map_err(|error: Error| error.with_path(path))
    }

    /// Gives a file another name, which nothing bears yet, however late that came.
    pub fn rename(kind: &Kind, from: &Path, to: &Path) -> Result<()> {
        clear_the_way(kind, to)?;
        fremen::file::rename_new(from, to)?;
        fremen::file::sync_folder_of(to);
        Ok(())
    }

    /// Opens a file, checks that it is one of this kind, and gives what `read` finds in it.
    pub fn open<T>(
        kind: &'static Kind,
        path: &Path,
        access: Access,
        check: Check,
        read: impl FnOnce(&Reader<'_>) -> Result<T>,
    ) -> Result<(Self, T)> {
        let open = || {
            let (mut connection, is_image) = settled(kind, path, access, check)?;
            let is_read_only = is_image
                || connection
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
            let store = Self {
                kind,
                check,
                path: path.to_path_buf(),
                number: number_at(path)?,
                connection,
                is_read_only,
                is_image,
                turn: None,
            };
            Ok((store, found))
        };
        open().map_err(|error: Error| error.with_path(path))
    }

    /// Reads a little of a file and closes it again.
    pub fn glance<T>(
        kind: &'static Kind,
        path: &Path,
        check: Check,
        read: impl FnOnce(&Reader<'_>) -> Result<T>,
    ) -> Result<T> {
        let glance = || {
            let (mut connection, _) = settled(kind, path, Access::ReadOnly, check)?;
            reading(kind, &mut connection, |reader| {
                reader.check_schema(&mut Faults::strict(kind))?;
                read(reader)
            })
        };
        glance().map_err(|error| error.with_path(path))
    }

    /// Checks a file and changes none of its rows: `SQLite`'s pages, the declaration of the tables,
    /// then what `read` checks of the rows; gives what that found and the faults, at most `limit`.
    ///
    /// An error says that the file is not of this kind at all or cannot be read.
    pub fn verify<T>(
        kind: &'static Kind,
        path: &Path,
        limit: usize,
        check: Check,
        read: impl FnOnce(&Reader<'_>, &mut Faults) -> Result<Option<T>>,
    ) -> Result<(Option<T>, Vec<Fault>)> {
        let mut faults = Faults::listing(kind, limit);
        let verify = || {
            let (mut connection, is_image) = settled(kind, path, Access::ReadOnly, check)?;
            let found = reading(kind, &mut connection, |reader| {
                reader.check_schema(&mut faults)?;
                if !faults.is_clean() {
                    return Ok(None);
                }
                reader.check_structure("integrity_check", &mut faults)?;
                let pages = reader.num_page_bytes()?;
                let found = std::fs::metadata(path).map_or(pages, |metadata| metadata.len());
                if found != pages && !is_image {
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

    /// Runs `read` in one transaction that changes nothing. Fails where the file was moved away, deleted or replaced
    /// since it was opened (on Unix).
    pub fn read<T>(&mut self, read: impl FnOnce(&Reader<'_>) -> Result<T>) -> Result<T> {
        let read_it = || {
            if self.number != number_at(&self.path)? {
                return Err(self.kind.moved("nothing new is read", ""));
            }
            if !self.is_image
                && let Settled::Image(image) = settle(self.kind, &self.path, self.check)?
            {
                let mut connection = connect_image(self.kind, &image)?;
                return reading(self.kind, &mut connection, read);
            }
            reading(self.kind, &mut self.connection, read)
        };
        read_it().map_err(|error| error.with_path(&self.path))
    }

    /// Heals what a writer that was killed meanwhile may have left: `SQLite` would play any
    /// journal.
    fn settle(&self) -> Result<()> {
        if !self.is_read_only {
            settle(self.kind, &self.path, self.check)?;
        }
        Ok(())
    }

    /// Commits what `write` writes, if the file still stands at `tip`; a file of an older version
    /// becomes one of today's.
    ///
    /// Once this returns, the commit survives a power loss; on any error the file is as before.
    pub fn write(&mut self, tip: Tip, write: impl FnOnce(&Writer<'_>) -> Result<()>) -> Result<()> {
        let kind = self.kind;
        let _turn = self.others_turn();
        let commit = || {
            self.settle()?;
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

    /// Keeps other writers waiting until [`end_turn`](Self::end_turn), so that a change which takes
    /// long to make is in time. `turn` comes of [`turn_for`](Self::turn_for).
    pub fn take_turn(&mut self, turn: Turn) {
        self.turn = Some(turn);
    }

    /// Lets other writers go on.
    pub fn end_turn(&mut self) {
        self.turn = None;
    }

    /// Waits for the turns of other writers of the file at `path`.
    pub fn turn_for(path: &Path) -> Turn {
        Turn::wait(path, BUSY_TIMEOUT)
    }

    /// A turn for one call, unless it is held already.
    fn others_turn(&self) -> Option<Turn> {
        self.turn.is_none().then(|| Self::turn_for(&self.path))
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
        let _turn = self.others_turn();
        let prune = || {
            self.settle()?;
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

fn create_in(
    kind: &'static Kind,
    path: &Path,
    page_bytes: u32,
    fill: impl FnOnce(&Writer<'_>) -> Result<()>,
) -> Result<()> {
    let failed = |error: rusqlite::Error| kind.sqlite_error(&error);
    let mut connection = connect(kind, path, Access::ReadWrite)?;
    (connection.pragma_update(None, "page_size", page_bytes)).map_err(failed)?;
    let _shared = shared();
    let transaction = connection
        .transaction_with_behavior(TransactionBehavior::Immediate)
        .map_err(failed)?;
    let writer = Writer::new(&transaction, kind);
    writer.create_tables().map_err(failed)?;
    fill(&writer)?;
    transaction.commit().map_err(failed)
}

/// A connection to a file of this kind in which no commit is interrupted, and whether it is one to
/// a copy in memory.
fn settled(
    kind: &'static Kind,
    path: &Path,
    access: Access,
    check: Check,
) -> Result<(Connection, bool)> {
    peek(kind, path)?;
    match settle(kind, path, check)? {
        Settled::File => Ok((connect(kind, path, access)?, false)),
        Settled::Image(image) => Ok((connect_image(kind, &image)?, true)),
    }
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

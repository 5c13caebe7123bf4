//! How is a map kept in a file, whatever happens to the machine?
//!
//! A [`Map`] is an SQLite file with a rollback journal: one file once no commit is running, opened
//! read-only without writing anything beside it. A commit is one transaction with full
//! synchronisation, and appends: its cost follows from what is new, not from what is stored. One
//! process writes at a time, any number read; nobody holds a lock between calls.
//!
//! Not for queries: [`Map::snapshot`] is in memory and immutable.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, SystemTime};

use rusqlite::types::{ToSqlOutput, ValueRef};
use rusqlite::{Connection, OpenFlags, Transaction, TransactionBehavior};

use super::change::Change;
use super::digest;
use super::format::{self, APPLICATION_ID, TABLES, Table, VERSION, tables_of};
use super::load::{self, Fault, Faults, Generation, State};
use super::prune;
use crate::map::types::{MapMeta, Snapshot};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// How long to wait for another process that commits.
const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

/// POSIX drops all locks of a process on a file when any descriptor of that file is closed, so the
/// header is read (exclusive) only while no transaction of this process runs (shared).
static DESCRIPTORS: RwLock<()> = RwLock::new(());

/// A map file.
///
/// Cheap to share: all methods take `&self`, and only [`commit`](Self::commit) waits for the disk.
#[derive(Debug)]
pub struct Map {
    path: PathBuf,
    is_read_only: bool,
    stored: Mutex<Stored>,
    published: RwLock<Arc<Snapshot>>,
}

#[derive(Debug)]
struct Stored {
    connection: Connection,
    state: State,
}

/// What [`Map::prune`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pruned {
    /// Generations that are gone.
    pub num_dropped: usize,
    /// Bytes of the file before.
    pub num_bytes_before: u64,
    /// Bytes of the file after.
    pub num_bytes_after: u64,
}

impl Map {
    /// Makes a new map file; one that exists is never overwritten.
    pub fn create(path: impl AsRef<Path>, meta: MapMeta) -> Result<Self> {
        Self::create_at(path, meta, now())
    }

    /// [`create`](Self::create) with the time to write down as that of generation 0: the same input
    /// gives the same file.
    pub fn create_at(path: impl AsRef<Path>, meta: MapMeta, time: Time) -> Result<Self> {
        Self::create_with(path.as_ref(), meta, time, 4096)
    }

    pub(super) fn create_with(
        path: &Path,
        meta: MapMeta,
        time: Time,
        page_bytes: u32,
    ) -> Result<Self> {
        meta.check().map_err(|error| error.with_path(path))?;
        File::create_new(path).map_err(|error| {
            let help = match error.kind() {
                std::io::ErrorKind::AlreadyExists => {
                    "a map is never overwritten: choose another name, or update the map"
                }
                std::io::ErrorKind::NotFound => "create the folder first",
                _ => "choose a folder that may be written",
            };
            Error::io(path, error).with_help(help)
        })?;
        let created = Self::create_in(path, meta, time, page_bytes);
        if created.is_err() {
            // It is ours, and not yet a map; that it cannot be removed matters less than why.
            let _ = std::fs::remove_file(path);
        }
        created.map_err(|error| error.with_path(path))
    }

    fn create_in(path: &Path, meta: MapMeta, time: Time, page_bytes: u32) -> Result<Self> {
        let mut connection = connect(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        let state = State::empty(meta);
        let write = |connection: &mut Connection| -> rusqlite::Result<()> {
            connection.pragma_update(None, "page_size", page_bytes)?;
            let _shared = shared();
            let transaction =
                connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
            transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
            transaction.pragma_update(None, "user_version", VERSION)?;
            for table in TABLES {
                transaction.execute(table.create, [])?;
            }
            insert_meta(&transaction, 0, &state.snapshot.meta)?;
            insert_generation(&transaction, &state.totals(time))?;
            transaction.commit()
        };
        write(&mut connection).map_err(|error| sqlite_error(&error))?;
        Ok(Self::with_state(path, connection, state, false))
    }

    /// Opens a map file: to be written where file and folder allow it, else read-only.
    ///
    /// Reads all of it, and refuses a file that is not as it was written.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path.as_ref(), OpenFlags::SQLITE_OPEN_READ_WRITE)
    }

    /// Opens a map file without any right to change it.
    pub fn open_read_only(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path.as_ref(), OpenFlags::SQLITE_OPEN_READ_ONLY)
    }

    fn open_with(path: &Path, flags: OpenFlags) -> Result<Self> {
        let open = || -> Result<Self> {
            peek(path)?;
            let mut connection = connect(path, flags)?;
            let is_read_only = connection
                .is_readonly(c"main")
                .map_err(|error| sqlite_error(&error))?;
            let state = reading(&mut connection, |connection| {
                check_schema(connection, &mut Faults::strict())?;
                if !is_read_only {
                    // Writing to a file of broken structure would spread the damage.
                    check_structure(connection, "quick_check", &mut Faults::strict())?;
                }
                load::load(connection, None, None, &mut Faults::strict(), None)
            })?;
            let state =
                state.ok_or_else(|| Error::new(ErrorKind::Format, "this map has no generation"))?;
            Ok(Self::with_state(path, connection, state, is_read_only))
        };
        open().map_err(|error| error.with_path(path))
    }

    fn with_state(path: &Path, connection: Connection, state: State, is_read_only: bool) -> Self {
        let published = RwLock::new(Arc::new(state.snapshot.clone()));
        Self {
            path: path.to_path_buf(),
            is_read_only,
            stored: Mutex::new(Stored { connection, state }),
            published,
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether [`commit`](Self::commit) is known to fail: opened read-only, or the file may not be
    /// written. That the folder may not be written shows only at a commit.
    pub fn is_read_only(&self) -> bool {
        self.is_read_only
    }

    /// The last generation that this object has read or written. Never waits for the disk.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(
            &self
                .published
                .read()
                .unwrap_or_else(PoisonError::into_inner),
        )
    }

    /// Reads what other processes have committed since, and gives the newest snapshot.
    pub fn refresh(&self) -> Result<Arc<Snapshot>> {
        let mut stored = self.stored();
        let Stored { connection, state } = &mut *stored;
        let newest = reading(connection, |connection| {
            let newest = newest_generation(connection).map_err(|error| sqlite_error(&error))?;
            if newest == (state.snapshot.generation, state.prunes) {
                return Ok(None);
            }
            load::catch_up(connection, state.clone())
        })
        .map_err(|error| error.with_path(&self.path))?;
        if let Some(newest) = newest {
            *state = newest;
            self.publish(&state.snapshot);
        }
        Ok(self.snapshot())
    }

    /// Every commit, oldest first.
    pub fn generations(&self) -> Result<Vec<Generation>> {
        reading(&mut self.stored().connection, |connection| {
            let version = load::format_version(connection)?;
            load::read_generations(connection, version, None, &mut Faults::strict())
        })
        .map_err(|error| error.with_path(&self.path))
    }

    /// The map as it was at a generation. Reads the whole file.
    pub fn at(&self, generation: u64) -> Result<Arc<Snapshot>> {
        self.state_at(&mut self.stored().connection, generation)
            .map(|state| Arc::new(state.snapshot))
    }

    fn state_at(&self, connection: &mut Connection, generation: u64) -> Result<State> {
        reading(connection, |connection| {
            load::load(
                connection,
                None,
                Some(generation),
                &mut Faults::strict(),
                None,
            )
        })
        .and_then(|state| state.ok_or_else(|| load::no_generation(generation)))
        .map_err(|error| error.with_path(&self.path))
    }

    /// Makes `snapshot` the stored state in one transaction, and gives its generation number.
    ///
    /// `snapshot` must extend the stored state: the same places and visits in the same order, then
    /// new ones; poses, edges, attachments, preset and zone may differ freely; its generation number
    /// is not looked at. Once this returns, the commit survives a power loss; on any error the stored
    /// state is as before. If nothing differs nothing is written. The first commit to a file of an
    /// older format makes it one of today's.
    pub fn commit(&self, snapshot: &Snapshot) -> Result<u64> {
        self.commit_at(snapshot, now())
    }

    /// [`commit`](Self::commit) with the time to write down as that of the commit: the same input
    /// gives the same file.
    pub fn commit_at(&self, snapshot: &Snapshot, time: Time) -> Result<u64> {
        self.commit_inner(snapshot, time)
            .map_err(|error| error.with_path(&self.path))
    }

    fn commit_inner(&self, snapshot: &Snapshot, time: Time) -> Result<u64> {
        let mut stored = self.stored();
        let Stored { connection, state } = &mut *stored;
        let change = Change::between(state, snapshot)?;
        if change.is_nothing() {
            return Ok(state.snapshot.generation);
        }
        let mut next = change.apply(state, snapshot, state.snapshot.generation + 1);
        self.write(connection, state, state, &change, &mut next, time)?;
        let new_ids = std::mem::replace(&mut next.visit_ids, std::mem::take(&mut state.visit_ids));
        next.visit_ids.extend(new_ids);
        *state = next;
        Ok(state.snapshot.generation)
    }

    /// Makes a past generation the stored state again, as a new generation, and gives its number.
    ///
    /// Nothing is lost: what was committed since stays in the file, and can be returned to by its
    /// number. The snapshot equals the past one in everything but its number.
    pub fn rollback(&self, to: u64) -> Result<u64> {
        self.rollback_at(to, now())
    }

    /// [`rollback`](Self::rollback) with the time to write down as that of the commit.
    pub fn rollback_at(&self, to: u64, time: Time) -> Result<u64> {
        let mut stored = self.stored();
        let Stored { connection, state } = &mut *stored;
        if to == state.snapshot.generation {
            return Ok(to);
        }
        let past = self.state_at(connection, to)?;
        self.branch(connection, state, past, None, time)
    }

    /// Makes `snapshot` the stored state, whether or not it extends the one before, and gives its
    /// generation number.
    ///
    /// What extends the stored state is committed; anything else is written as a whole, so the file
    /// grows by all of it until it is pruned. UUID and extractor must stay. As with
    /// [`rollback`](Self::rollback) nothing is lost.
    pub fn replace(&self, snapshot: &Snapshot) -> Result<u64> {
        self.replace_at(snapshot, now())
    }

    /// [`replace`](Self::replace) with the time to write down as that of the commit.
    pub fn replace_at(&self, snapshot: &Snapshot, time: Time) -> Result<u64> {
        let mut stored = self.stored();
        let Stored { connection, state } = &mut *stored;
        if Change::between(state, snapshot).is_ok() {
            drop(stored);
            return self.commit_at(snapshot, time);
        }
        let empty = self.state_at(connection, 0)?;
        self.branch(connection, state, empty, Some(snapshot), time)
    }

    /// Forgets all generations but 0, the newest, those in `keep` and those where their lines part.
    ///
    /// What stays keeps number, content and digest; what goes cannot be returned to. One transaction,
    /// then the file is made as small as it can be, for which the disk needs room for a second one;
    /// where that fails the map is pruned all the same.
    pub fn prune(&self, keep: &BTreeSet<u64>) -> Result<Pruned> {
        self.prune_inner(keep)
            .map_err(|error| error.with_path(&self.path))
    }

    fn prune_inner(&self, keep: &BTreeSet<u64>) -> Result<Pruned> {
        let num_bytes = || {
            let metadata = std::fs::metadata(&self.path);
            metadata.map_err(|error| Error::io(&self.path, error))
        };
        let num_bytes_before = num_bytes()?.len();
        let mut stored = self.stored();
        let Stored { connection, state } = &mut *stored;
        let _shared = shared();
        let transaction = self.begin(connection, state)?;
        let Some((after, num_dropped)) = prune::prune(&transaction, keep)? else {
            return Ok(Pruned {
                num_dropped: 0,
                num_bytes_before,
                num_bytes_after: num_bytes_before,
            });
        };
        transaction.commit().map_err(|error| sqlite_error(&error))?;
        *state = after;
        self.publish(&state.snapshot);
        if let Err(error) = connection.execute_batch("VACUUM") {
            tracing::warn!(
                "{}: pruned, but not made smaller: {error}",
                self.path.display()
            );
        }
        Ok(Pruned {
            num_dropped,
            num_bytes_before,
            num_bytes_after: num_bytes()?.len(),
        })
    }

    /// Commits on top of `past`, a state of another generation than the newest: `next`, or else the
    /// past itself.
    fn branch(
        &self,
        connection: &mut Connection,
        state: &mut State,
        mut past: State,
        next: Option<&Snapshot>,
        time: Time,
    ) -> Result<u64> {
        let mut commit = || {
            let same = Arc::new(past.snapshot.clone());
            let snapshot = next.unwrap_or(&same);
            let change = Change::between(&past, snapshot)?;
            let mut after = change.apply(&past, snapshot, state.snapshot.generation + 1);
            self.write(connection, state, &past, &change, &mut after, time)?;
            after.visit_ids.extend(std::mem::take(&mut past.visit_ids));
            *state = after;
            Ok(state.snapshot.generation)
        };
        commit().map_err(|error: Error| error.with_path(&self.path))
    }

    /// Writes what leads from `before` to `after` in one transaction, if the file still is as in
    /// `newest`.
    fn write(
        &self,
        connection: &mut Connection,
        newest: &State,
        before: &State,
        change: &Change,
        after: &mut State,
        time: Time,
    ) -> Result<()> {
        let _shared = shared();
        let transaction = self.begin(connection, newest)?;
        if before.version < VERSION {
            migrate(&transaction, before.version)?;
            after.version = VERSION;
        }
        change
            .write(&transaction, before, after)
            .and_then(|()| insert_generation(&transaction, &after.totals(time)))
            .and_then(|()| transaction.commit())
            .map_err(|error| sqlite_error(&error))?;
        self.publish(&after.snapshot);
        Ok(())
    }

    /// Starts to write, if the file still is as in `newest`. The caller holds [`shared`].
    fn begin<'a>(&self, connection: &'a mut Connection, newest: &State) -> Result<Transaction<'a>> {
        if self.is_read_only {
            return Err(Error::new(ErrorKind::Io, "this map is open read-only")
                .with_help("copy it to a place where it may be written"));
        }
        let transaction = connection
            .transaction_with_behavior(TransactionBehavior::Immediate)
            .map_err(|error| sqlite_error(&error))?;
        let (number, prunes) =
            newest_generation(&transaction).map_err(|error| sqlite_error(&error))?;
        if (number, prunes) != (newest.snapshot.generation, newest.prunes) {
            let what = if prunes == newest.prunes {
                format!(
                    "another process has committed generation {number} on top of {}, which this \
                     change was made for",
                    newest.snapshot.generation
                )
            } else {
                "another process has pruned the map since this change was made".into()
            };
            return Err(Error::new(ErrorKind::Config, what)
                .with_help("refresh the map and repeat the change"));
        }
        Ok(transaction)
    }

    fn stored(&self) -> MutexGuard<'_, Stored> {
        self.stored.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn publish(&self, snapshot: &Snapshot) {
        *self
            .published
            .write()
            .unwrap_or_else(PoisonError::into_inner) = Arc::new(snapshot.clone());
    }

    #[cfg(test)]
    pub(super) fn with_connection<T>(&self, f: impl FnOnce(&Connection) -> T) -> T {
        f(&self.stored().connection)
    }
}

fn now() -> Time {
    let since_epoch = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    Time::from_us(i64::try_from(since_epoch.as_micros()).unwrap_or(i64::MAX))
}

fn shared() -> std::sync::RwLockReadGuard<'static, ()> {
    DESCRIPTORS.read().unwrap_or_else(PoisonError::into_inner)
}

pub(super) fn connect(path: &Path, flags: OpenFlags) -> Result<Connection> {
    // An absolute path is never taken for one of SQLite's special names (`:memory:`, `file:...`).
    let path = std::path::absolute(path).map_err(|error| Error::io(path, error))?;
    let connect = || {
        let flags = flags | OpenFlags::SQLITE_OPEN_NO_MUTEX;
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
    connect().map_err(|error: rusqlite::Error| sqlite_error(&error))
}

/// Runs `read` in one transaction that changes nothing.
pub(super) fn reading<T>(
    connection: &mut Connection,
    read: impl FnOnce(&Connection) -> Result<T>,
) -> Result<T> {
    let _shared = shared();
    let transaction = connection
        .transaction()
        .map_err(|error| sqlite_error(&error))?;
    read(&transaction)
}

/// The newest generation's number, and how often the file was pruned.
fn newest_generation(connection: &Connection) -> rusqlite::Result<(u64, u64)> {
    let version: u32 = connection.query_row("PRAGMA user_version", [], |row| row.get(0))?;
    let prunes = if version == 1 { "0" } else { "prunes" };
    let newest = format!("SELECT number, {prunes} FROM generation ORDER BY number DESC LIMIT 1");
    connection.query_row(&newest, [], |row| {
        Ok((row.get::<_, i64>(0)? as u64, row.get::<_, i64>(1)? as u64))
    })
}

/// Makes a file of format 1 one of format 2, inside of the caller's transaction: generations learn
/// their parents, and there may be attachments.
pub(super) fn migrate(connection: &Connection, from: u32) -> Result<()> {
    let generations = load::read_generations(connection, from, None, &mut Faults::strict())?;
    let write = || {
        connection.execute("DROP TABLE generation", [])?;
        connection.execute(format::GENERATION.create, [])?;
        connection.execute(format::ATTACHMENT.create, [])?;
        connection.pragma_update(None, "user_version", VERSION)?;
        (generations.iter()).try_for_each(|generation| insert_generation(connection, generation))
    };
    write().map_err(|error: rusqlite::Error| sqlite_error(&error))
}

/// Writes one row with its checksum; the values are all columns before `crc`.
pub(super) fn insert(
    connection: &Connection,
    table: &Table,
    values: &[ValueRef<'_>],
) -> rusqlite::Result<()> {
    let places = vec!["?"; values.len() + 1].join(", ");
    let mut statement = connection.prepare_cached(&format!(
        "INSERT INTO {} ({}, crc) VALUES ({places})",
        table.name,
        table.columns.join(", ")
    ))?;
    let crc = ValueRef::Integer(format::row_crc(table, values).into());
    let parameters = values
        .iter()
        .chain([&crc])
        .map(|&v| ToSqlOutput::Borrowed(v));
    statement.execute(rusqlite::params_from_iter(parameters))?;
    Ok(())
}

pub(super) fn insert_meta(
    connection: &Connection,
    generation: u64,
    meta: &MapMeta,
) -> rusqlite::Result<()> {
    let uuid = meta.uuid.to_be_bytes();
    let mut values = vec![ValueRef::Integer(generation as i64)];
    values.extend(digest::meta_values(meta, &uuid));
    insert(connection, &format::META, &values)
}

pub(super) fn insert_generation(connection: &Connection, it: &Generation) -> rusqlite::Result<()> {
    let values = [
        ValueRef::Integer(it.number as i64),
        it.parent
            .map_or(ValueRef::Null, |parent| ValueRef::Integer(parent as i64)),
        ValueRef::Integer(it.prunes as i64),
        ValueRef::Integer(it.time.as_us()),
        ValueRef::Integer(it.meta as i64),
        ValueRef::Integer(it.edges as i64),
        ValueRef::Integer(it.num_places as i64),
        ValueRef::Integer(it.num_visits as i64),
        ValueRef::Integer(it.num_features as i64),
        ValueRef::Blob(&it.digest),
    ];
    insert(connection, &format::GENERATION, &values)
}

/// Whether the tables are those of the file's format and nothing else is there that could act on them.
pub(super) fn check_schema(connection: &Connection, faults: &mut Faults) -> Result<()> {
    let version = load::format_version(connection)?;
    let tables = tables_of(version);
    let read = || -> rusqlite::Result<Vec<(String, Option<String>)>> {
        connection
            .prepare("SELECT name, sql FROM sqlite_schema WHERE name NOT LIKE 'sqlite\\_%' ESCAPE '\\' ORDER BY rowid")?
            .query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?
            .collect()
    };
    let found = match read() {
        Ok(found) => found,
        Err(error) => return faults.add(load::from_sqlite("file", None, &error)?),
    };
    for table in tables {
        match found.iter().find(|(name, _)| name == table.name) {
            None => faults.add(Fault::new(
                table.name,
                ErrorKind::Format,
                "the table is missing",
            ))?,
            Some((_, sql)) if sql.as_deref() != Some(table.create) => faults.add(Fault::new(
                table.name,
                ErrorKind::Format,
                format!("the table is not declared as in format {version}"),
            ))?,
            Some(_) => {}
        }
    }
    let foreign = found
        .iter()
        .find(|(name, _)| tables.iter().all(|table| table.name != name));
    if let Some((name, _)) = foreign {
        faults.add(Fault::new(
            "file",
            ErrorKind::Format,
            format!("`{}` is no part of format {version}", name.escape_debug()),
        ))?;
    }
    Ok(())
}

/// SQLite's own check of its pages.
pub(super) fn check_structure(
    connection: &Connection,
    pragma: &str,
    faults: &mut Faults,
) -> Result<()> {
    let read = || -> rusqlite::Result<Vec<String>> {
        connection
            .prepare(&format!("PRAGMA {pragma}(16)"))?
            .query_map([], |row| row.get(0))?
            .collect()
    };
    match read() {
        Ok(lines) => lines
            .into_iter()
            .filter(|line| line != "ok")
            .try_for_each(|line| faults.add(Fault::new("file", ErrorKind::Format, line))),
        Err(error) => faults.add(load::from_sqlite("file", None, &error)?),
    }
}

/// What failed in SQLite, in words of this crate.
pub(super) fn sqlite_error(error: &rusqlite::Error) -> Error {
    use rusqlite::ErrorCode as Code;
    let extended = error.sqlite_error().map(|error| error.extended_code);
    let (kind, message, help) = match error.sqlite_error_code() {
        Some(Code::ReadOnly) if extended == Some(rusqlite::ffi::SQLITE_READONLY_ROLLBACK) => (
            ErrorKind::Io,
            "the last commit was interrupted and has to be undone before the map can be read",
            "open it once where file and folder may be written, together with its `-journal`",
        ),
        Some(Code::DiskFull) => (
            ErrorKind::Io,
            "the disk is full; the map stays as it was",
            "free some space and repeat",
        ),
        Some(Code::ReadOnly) => (
            ErrorKind::Io,
            "the file or its folder may not be written",
            "a commit needs both to be writable: change the rights or copy the map",
        ),
        Some(Code::CannotOpen) => (
            ErrorKind::Io,
            "the file or its journal cannot be opened",
            "check the rights of the file and of its folder",
        ),
        Some(Code::PermissionDenied) => (
            ErrorKind::Io,
            "access is denied",
            "check the rights of the file and of its folder",
        ),
        Some(Code::DatabaseBusy | Code::DatabaseLocked) => (
            ErrorKind::Io,
            "another process is writing to this map",
            "wait until it has finished and repeat",
        ),
        Some(Code::SystemIoFailure) => (
            ErrorKind::Io,
            "the disk failed to read or write",
            "check the disk, then `chronotope map verify`",
        ),
        Some(Code::DatabaseCorrupt | Code::NotADatabase) => (
            ErrorKind::Format,
            "the file is damaged",
            "restore a copy; `chronotope map verify` lists the faults",
        ),
        _ => (ErrorKind::Io, "SQLite failed", "see the message"),
    };
    Error::new(kind, format!("{message} ({error})")).with_help(help)
}

/// Looks at a file's first bytes: an error unless it is a whole file of this format.
pub(super) fn peek(path: &Path) -> Result<()> {
    let io = |error: std::io::Error| {
        let error = Error::io(path, error);
        if path.exists() {
            error
        } else {
            error.with_help("make a map with `chronotope map build`")
        }
    };
    let format = |message: String| Error::new(ErrorKind::Format, message).with_path(path);
    let metadata = std::fs::metadata(path).map_err(io)?;
    if metadata.is_dir() {
        return Err(format("this is a folder, not a map file".into())
            .with_help("to learn a map from a folder of images use `chronotope map build`"));
    }
    if !metadata.is_file() {
        return Err(format("this is no regular file".into()));
    }
    let mut header = Vec::new();
    {
        let _exclusive = DESCRIPTORS.write().unwrap_or_else(PoisonError::into_inner);
        let file = File::open(path).map_err(io)?;
        file.take(100).read_to_end(&mut header).map_err(io)?;
    }
    if header.is_empty() {
        return Err(format("the file is empty".into()).with_help(
            "its creation or a copy was interrupted: delete it and build or copy the map again",
        ));
    }
    if !header.starts_with(b"SQLite format 3\0") {
        return Err(
            format(format!("this is {}, not a map file", describe(&header)))
                .with_help("give the file that `chronotope map build` has written"),
        );
    }
    let word = |at: usize| {
        header
            .get(at..at + 4)
            .and_then(|bytes| bytes.try_into().ok())
            .map(u32::from_be_bytes)
    };
    let (Some(id), Some(version), Some(num_pages)) = (word(68), word(60), word(28)) else {
        return Err(
            format(format!("the file ends after {} bytes", header.len()))
                .with_help("restore a copy"),
        );
    };
    if id != APPLICATION_ID {
        return Err(format(format!(
            "this is an SQLite file of another program (application id {id:#010x}), not a map"
        ))
        .with_help("give the file that `chronotope map build` has written"));
    }
    if version > VERSION {
        return Err(format(format!(
            "the map has format {version}; this program reads formats up to {VERSION}"
        ))
        .with_help("use a newer chronotope"));
    }
    if version == 0 {
        return Err(format("the map has format 0, which does not exist".into())
            .with_help("the file is damaged: restore a copy"));
    }
    let page_bytes = match header[16..18] {
        [0, 1] => 65536,
        [high, low] => u64::from(high) << 8 | u64::from(low),
        _ => 0,
    };
    // While a commit runs the file may be shorter than its header says; once the journal is gone
    // the commit is complete, so the length is asked for last.
    let journal = {
        let mut name = path.as_os_str().to_owned();
        name.push("-journal");
        std::fs::metadata(name).is_ok_and(|journal| journal.len() > 0)
    };
    let is_size_valid = word(24) == word(92);
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

/// What a file that is not SQLite's seems to be.
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

//! How is a map kept in a file, whatever happens to the machine?
//!
//! A [`Map`] is a file of generations ([`Store`]) with the snapshot that it was last read or
//! written as. A commit appends: its cost follows from what is new, not from what is stored.
//!
//! Not for queries: [`Map::snapshot`] is in memory and immutable.

use std::collections::BTreeSet;
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::SystemTime;

use chronotope_store::{Access, Faults, Reader, Store, Writer};

use super::change::{Change, Rewritten, insert_meta};
use super::generation::Generation;
use super::load;
use super::state::State;
use super::tables::MAP;
use crate::map::quarantine::Quarantine;
use crate::map::snapshot::Snapshot;
use crate::map::types::{MapMeta, VisitId};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

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
    store: Store,
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
        let state = State::empty(meta);
        let store = Store::create(&MAP, path, page_bytes, load::check, |writer| {
            insert_empty(writer, &state, time)
        })?;
        Ok(Self::with_state(store, state))
    }

    /// Makes a new map file that holds `snapshot`, whole or not at all; one that exists is never
    /// overwritten.
    pub fn create_from(path: impl AsRef<Path>, snapshot: &Snapshot) -> Result<Self> {
        let (path, time) = (path.as_ref(), now());
        let create = || {
            snapshot.meta.check()?;
            let empty = State::empty(snapshot.meta.clone());
            let change = Change::between(&empty, snapshot, Rewritten::Refused)?;
            let state = change.apply(&empty, snapshot, 1);
            let store = Store::create(&MAP, path, 4096, load::check, |writer| {
                insert_empty(writer, &empty, time)?;
                change.write(writer, &empty, &state)?;
                writer.insert_generation(&state.totals(time).to_stored())
            })?;
            Ok(Self::with_state(store, state))
        };
        create().map_err(|error: Error| never_overwritten(error.with_path(path)))
    }

    /// Refuses a name that is taken by a file or a link, before anything is done for a new map.
    pub fn refuse_existing(path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        if std::fs::symlink_metadata(path).is_err() {
            return Ok(());
        }
        let error = Error::new(ErrorKind::AlreadyExists, "this file exists already");
        Err(never_overwritten(error.with_path(path)))
    }

    /// Gives a map file another name; a file that has that name, however late it came, is never
    /// overwritten.
    pub fn rename(from: impl AsRef<Path>, to: impl AsRef<Path>) -> Result<()> {
        Store::rename(&MAP, from.as_ref(), to.as_ref()).map_err(never_overwritten)
    }

    /// Opens a map file: to be written where file and folder allow it, else read-only.
    ///
    /// Reads all of it, and refuses a file that is not as it was written.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path.as_ref(), Access::ReadWrite)
    }

    /// Opens a map file without any right to change it.
    pub fn open_read_only(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path.as_ref(), Access::ReadOnly)
    }

    fn open_with(path: &Path, access: Access) -> Result<Self> {
        let (store, state) = Store::open(&MAP, path, access, load::check, load::whole)?;
        Ok(Self::with_state(store, state))
    }

    fn with_state(store: Store, state: State) -> Self {
        Self {
            path: store.path().to_path_buf(),
            is_read_only: store.is_read_only(),
            published: RwLock::new(Arc::new(state.snapshot.clone())),
            stored: Mutex::new(Stored { store, state }),
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

    /// Reads what other processes have committed since, and gives the newest snapshot. Fails where
    /// the file was moved away, deleted or replaced since it was opened (on Unix).
    pub fn refresh(&self) -> Result<Arc<Snapshot>> {
        let mut stored = self.stored();
        let Stored { store, state } = &mut *stored;
        let newest = store.read(|reader| {
            if reader.tip()? == state.tip() {
                return Ok(None);
            }
            load::catch_up(reader, state.clone())
        })?;
        if let Some(newest) = newest {
            *state = newest;
            self.publish(&state.snapshot);
        }
        Ok(self.snapshot())
    }

    /// Every commit, oldest first.
    pub fn generations(&self) -> Result<Vec<Generation>> {
        let read = |reader: &Reader<'_>| reader.generations(None, &mut Faults::strict(&MAP));
        let generations = self.stored().store.read(read)?;
        Ok(generations.iter().map(Generation::of).collect())
    }

    /// The map as it was at a generation. Reads the whole file.
    pub fn at(&self, generation: u64) -> Result<Arc<Snapshot>> {
        state_at(&mut self.stored().store, generation).map(|state| Arc::new(state.snapshot))
    }

    /// Makes `snapshot` the stored state in one transaction, and gives its generation number.
    ///
    /// `snapshot` must extend the stored state: the same places and visits in the same order, then
    /// new ones; poses, edges, attachments, preset and zone may differ freely; its generation
    /// number is not looked at. Once this returns, the commit survives a power loss; on any error
    /// the stored state is as before. If nothing differs nothing is written. The first commit to a
    /// file of an older format makes it one of today's.
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
        let Stored { store, state } = &mut *stored;
        let change = Change::between(state, snapshot, Rewritten::Refused)?;
        self.append(store, state, snapshot, &change, time)
    }

    /// Commits on top of the newest generation.
    fn append(
        &self,
        store: &mut Store,
        state: &mut State,
        snapshot: &Snapshot,
        change: &Change,
        time: Time,
    ) -> Result<u64> {
        if change.is_nothing() {
            return Ok(state.snapshot.generation);
        }
        let mut next = change.apply(state, snapshot, state.snapshot.generation + 1);
        self.write(store, state, state, change, &next, time)?;
        next.visit_ids = change.visit_ids(mem::take(&mut state.visit_ids), next.visit_ids);
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
        let Stored { store, state } = &mut *stored;
        if to == state.snapshot.generation {
            return Ok(to);
        }
        let past = state_at(store, to)?;
        self.branch(store, state, past, None, time)
    }

    /// Makes `snapshot` the stored state, whether or not it extends the one before, and gives its
    /// generation number.
    ///
    /// Places that extend what is stored of them are committed as usual; those that do not (a
    /// budget made the learner forget, say) are written anew, each for itself. So the cost follows
    /// from the places that have changed, and the file grows by them until it is pruned. Only if
    /// places are gone, renamed or in another order, or image size or crop is another, all of the
    /// map is written. UUID and extractor must stay. As with [`rollback`](Self::rollback) nothing
    /// is lost.
    pub fn replace(&self, snapshot: &Snapshot) -> Result<u64> {
        self.replace_at(snapshot, now())
    }

    /// [`replace`](Self::replace) with the time to write down as that of the commit.
    pub fn replace_at(&self, snapshot: &Snapshot, time: Time) -> Result<u64> {
        let mut stored = self.stored();
        let Stored { store, state } = &mut *stored;
        if let Ok(change) = Change::between(state, snapshot, Rewritten::Renewed) {
            let appended = self.append(store, state, snapshot, &change, time);
            return appended.map_err(|error| error.with_path(&self.path));
        }
        let empty = state_at(store, 0)?;
        self.branch(store, state, empty, Some(snapshot), time)
    }

    /// Makes what `change` makes of the newest snapshot the stored state, and gives its generation
    /// number: [`replace`](Self::replace) that asks again where another process has committed
    /// meanwhile.
    ///
    /// `change` may be called twice, the second time with a newer snapshot, while other writers
    /// wait.
    pub fn update(&self, mut change: impl FnMut(&Snapshot) -> Result<Snapshot>) -> Result<u64> {
        match self.replace(&change(&self.snapshot())?) {
            Err(error) if error.kind() == ErrorKind::Conflict => {
                tracing::info!("{error}");
            }
            done => return done,
        }
        self.in_turn(|| self.replace(&change(&*self.refresh()?)?))
    }

    /// Forgets quarantined visits, each named once, in one generation, and gives its number; to learn
    /// them instead there is [`accept_held`](crate::learn::accept_held).
    ///
    /// Fails, and changes nothing, with [`ErrorKind::NotFound`] if one of them is not held, and as
    /// [`update`](Self::update) does.
    pub fn drop_held(&self, ids: &[VisitId]) -> Result<u64> {
        self.update(|snapshot| {
            let mut held = Quarantine::of(snapshot)?;
            for &id in ids {
                held.take_known(id)?;
            }
            let mut snapshot = snapshot.clone();
            held.attach(&mut snapshot)?;
            Ok(snapshot)
        })
    }

    /// Does `work`, which commits, while other writers wait.
    fn in_turn<T>(&self, work: impl FnOnce() -> T) -> T {
        self.take_turn();
        let done = work();
        self.end_turn();
        done
    }

    /// Keeps other writers of the file waiting, for ten seconds at most, until
    /// [`end_turn`](Self::end_turn).
    pub(crate) fn take_turn(&self) {
        // Waited for without the lock: others may read meanwhile.
        let turn = Store::turn_for(&self.path);
        self.stored().store.take_turn(turn);
    }

    /// Lets other writers go on.
    pub(crate) fn end_turn(&self) {
        self.stored().store.end_turn();
    }

    /// Forgets all generations but 0, the newest, those in `keep` and those where their lines part.
    ///
    /// What stays keeps number, content and digest; what goes cannot be returned to. One
    /// transaction, then the file is made as small as it can be, for which the disk needs room for
    /// a second one; where that fails the map is pruned all the same.
    pub fn prune(&self, keep: &BTreeSet<u64>) -> Result<Pruned> {
        let mut stored = self.stored();
        let Stored { store, state } = &mut *stored;
        let num_bytes_before = store.num_bytes()?;
        let is_same = |before: &State, after: &State| before.snapshot == after.snapshot;
        let pruned = store.prune(state.tip(), keep, load::whole, is_same)?;
        let Some((after, num_dropped)) = pruned else {
            return Ok(Pruned {
                num_dropped: 0,
                num_bytes_before,
                num_bytes_after: num_bytes_before,
            });
        };
        *state = after;
        self.publish(&state.snapshot);
        if let Err(error) = store.vacuum() {
            tracing::warn!("pruned, but not made smaller: {error}");
        }
        Ok(Pruned {
            num_dropped,
            num_bytes_before,
            num_bytes_after: store.num_bytes()?,
        })
    }

    /// Commits on top of `past`, a state of another generation than the newest: `next`, or else the
    /// past itself.
    fn branch(
        &self,
        store: &mut Store,
        state: &mut State,
        mut past: State,
        next: Option<&Snapshot>,
        time: Time,
    ) -> Result<u64> {
        let mut commit = || {
            let same = Arc::new(past.snapshot.clone());
            let snapshot = next.unwrap_or(&same);
            let change = Change::between(&past, snapshot, Rewritten::Refused)?;
            let mut after = change.apply(&past, snapshot, state.snapshot.generation + 1);
            self.write(store, state, &past, &change, &after, time)?;
            after.visit_ids = change.visit_ids(mem::take(&mut past.visit_ids), after.visit_ids);
            *state = after;
            Ok(state.snapshot.generation)
        };
        commit().map_err(|error: Error| error.with_path(&self.path))
    }

    /// Writes what leads from `before` to `after` in one transaction, if the file still is as in
    /// `newest`.
    fn write(
        &self,
        store: &mut Store,
        newest: &State,
        before: &State,
        change: &Change,
        after: &State,
        time: Time,
    ) -> Result<()> {
        store.write(newest.tip(), |writer| {
            change.write(writer, before, after)?;
            writer.insert_generation(&after.totals(time).to_stored())
        })?;
        self.publish(&after.snapshot);
        Ok(())
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
    pub(super) fn with_connection<T>(&self, f: impl FnOnce(&rusqlite::Connection) -> T) -> T {
        f(self.stored().store.connection())
    }
}

/// Adds what helps to the error that a file exists.
fn never_overwritten(error: Error) -> Error {
    if error.kind() != ErrorKind::AlreadyExists {
        return error;
    }
    error.with_help("a map is never overwritten: choose another name or remove it")
}

/// Writes generation 0.
fn insert_empty(writer: &Writer<'_>, state: &State, time: Time) -> Result<()> {
    insert_meta(writer, 0, &state.snapshot.meta)?;
    writer.insert_generation(&state.totals(time).to_stored())
}

fn now() -> Time {
    let since_epoch = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    Time::from_us(i64::try_from(since_epoch.as_micros()).unwrap_or(i64::MAX))
}

/// The state of the file at a generation.
fn state_at(store: &mut Store, generation: u64) -> Result<State> {
    let path = store.path().to_path_buf();
    let state = store.read(|reader| {
        let strict = &mut Faults::strict(&MAP);
        load::load(reader, None, Some(generation), strict, None)
    })?;
    state.ok_or_else(|| MAP.no_generation(generation).with_path(path))
}

//! Is a new map integrated, known already, or kept in quarantine?

use std::path::Path;

use chronotope_store::Access;
use fremen::{Error, ErrorKind, Result, Time};
use sha2::{Digest, Sha256};

use super::codec::{Memory, decode_held, encode_held};
use crate::cells::{GridSpec, OccupancyMap, Patch, Thresholds};
use crate::file::{Attachments, GridFile, UNDIGESTED};
use crate::history::{History, Outcome};
use crate::model::GridConfig;
use crate::registration::{Decision, Guard, GuardConfig, Judgement, Quarantined};
use crate::temporal::{FittedGrid, TemporalGrid};

/// Names of attachments of quarantined maps begin so.
const HELD: &str = "held-";
/// How many maps that were moved are known when they come again.
const MAX_MOVED: usize = 256;

/// By what a map is named in commands: 128 bits of the digest of its time and its observer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapId([u8; 16]);

impl MapId {
    /// The identity of what an observer saw at a time.
    pub fn new(observer: &str, time: Time) -> Self {
        Self(digest(&[&time.as_us().to_le_bytes(), observer.as_bytes()]))
    }

    /// That of a map in quarantine.
    pub fn of(held: &Quarantined) -> Self {
        Self::new(&held.observer, held.judgement.time)
    }
}

impl std::fmt::Display for MapId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The quarantined maps whose identities begin with these digits, each once.
///
/// # Errors
/// [`ErrorKind::NotFound`] where none does, [`ErrorKind::Config`] where several do.
pub fn choose<S: AsRef<str>>(held: &[Quarantined], begin_with: &[S]) -> Result<Vec<MapId>> {
    let known: Vec<(String, MapId)> = (held.iter().map(MapId::of))
        .map(|id| (id.to_string(), id))
        .collect();
    let mut ids = Vec::new();
    for text in begin_with {
        let text = text.as_ref();
        let digits = text.to_ascii_lowercase();
        let mut found = (known.iter())
            .filter(|(name, _)| !digits.is_empty() && name.starts_with(&digits))
            .map(|(_, id)| *id);
        match (found.next(), found.next()) {
            (Some(id), None) if ids.contains(&id) => {}
            (Some(id), None) => ids.push(id),
            (None, _) => {
                let message = format!("no map in quarantine begins with `{text}`");
                return Err(Error::new(ErrorKind::NotFound, message));
            }
            (Some(_), Some(_)) => {
                let message = format!("`{text}` begins several maps");
                return Err(Error::new(ErrorKind::Config, message));
            }
        }
    }
    Ok(ids)
}

fn digest(parts: &[&[u8]]) -> [u8; 16] {
    let mut sha = Sha256::new();
    for part in parts {
        sha.update((part.len() as u64).to_le_bytes());
        sha.update(part);
    }
    let bytes: [u8; 32] = sha.finalize().into();
    std::array::from_fn(|at| bytes[at])
}

/// What became of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TakenIn {
    /// It was in the grid already.
    Known,
    /// It was integrated.
    Integrated(Judgement),
    /// It shows the same change as others before it: these, and it, were integrated.
    Adopted {
        /// How many maps came out of quarantine, this one among them.
        num_maps: usize,
        /// What was found of it.
        judgement: Judgement,
    },
    /// It is kept in quarantine.
    Quarantined(Judgement),
    /// It has been in quarantine already.
    QuarantinedBefore(Judgement),
}

/// A grid file with its guard.
#[derive(Debug)]
pub struct LifelongGrid {
    file: GridFile,
    grid: TemporalGrid,
    guard: Guard,
    memory: Memory,
    /// What was taken in since the last commit.
    new: History,
    /// In which order the next map in quarantine comes.
    next_order: u64,
    /// Of each map in the guard's quarantine.
    orders: Vec<(MapId, u64)>,
}

impl LifelongGrid {
    /// Makes a new file of maps that are believed, as [`GridFile::create`]; `progress` is told how
    /// many of the maps that are usual were looked at, and of how many.
    pub fn create(
        path: impl AsRef<Path>,
        history: History,
        config: &GridConfig,
        guard: GuardConfig,
        progress: impl FnMut(usize, usize),
    ) -> Result<GridFile> {
        let past = past_of(&history, config, guard, progress)?;
        let mut attachments = Attachments::new();
        attachments.insert(UNDIGESTED.to_owned(), past.encode());
        GridFile::create_with(path, history, attachments)
    }

    /// Opens a file. Where it does not say what is usual (it was merged, or an earlier version made
    /// it), its newest maps are compared with the predictions of the others.
    ///
    /// # Errors
    /// As [`GridFile::open`]; [`ErrorKind::Format`] where an attachment is not as it is written.
    pub fn open(
        path: impl AsRef<Path>,
        access: Access,
        config: &GridConfig,
        guard: GuardConfig,
        progress: impl FnMut(usize, usize),
    ) -> Result<Self> {
        let path = path.as_ref();
        Self::of_file(GridFile::open(path, access)?, config, guard, progress)
            .map_err(|error| error.with_path(path))
    }

    /// Puts the guard of a file that is open before it, as [`open`](Self::open) does.
    ///
    /// # Errors
    /// [`ErrorKind::Format`] where an attachment is not as it is written.
    pub fn of_file(
        file: GridFile,
        config: &GridConfig,
        guard: GuardConfig,
        progress: impl FnMut(usize, usize),
    ) -> Result<Self> {
        let memory = match file.attachments().get(UNDIGESTED) {
            Some(bytes) => Memory::decode(bytes).ok_or_else(|| unreadable(UNDIGESTED))?,
            None => past_of(file.history(), config, guard, progress)?,
        };
        let mut held = Vec::new();
        for (name, bytes) in file.attachments() {
            if name.starts_with(HELD) {
                let found = decode_held(file.history().spec(), bytes);
                held.push(found.ok_or_else(|| unreadable(name))?);
            }
        }
        // A merged grid may hold what another one has accepted.
        held.retain(|(_, it)| !file.history().contains(&it.observer, it.judgement.time));
        held.sort_by_key(|(order, it)| (*order, it.judgement.time, MapId::of(it)));
        let orders: Vec<(MapId, u64)> = held.iter().map(|(o, it)| (MapId::of(it), *o)).collect();
        let quarantined = held.into_iter().map(|(_, it)| it).collect();
        Ok(Self {
            guard: Guard::resume(guard, memory.past.clone(), quarantined, memory.num_in_row),
            grid: TemporalGrid::from_history(file.history().clone(), config.clone()),
            new: History::new(*file.history().spec()),
            next_order: orders.last().map_or(0, |(_, last)| last.saturating_add(1)),
            orders,
            memory,
            file,
        })
    }

    /// What is in the file as it was last committed.
    pub const fn file(&self) -> &GridFile {
        &self.file
    }

    /// Gives the file away as it was last committed; what was taken in since is forgotten.
    pub fn into_file(self) -> GridFile {
        self.file
    }

    /// What the grid predicts, with what was taken in since the last commit.
    pub fn fitted(&mut self) -> FittedGrid<'_> {
        self.grid.fitted()
    }

    /// Predicts otherwise from now on, and judges new maps by that.
    pub fn set_config(&mut self, config: GridConfig) {
        self.grid.set_config(config);
    }

    /// Maps in quarantine, oldest first.
    pub fn quarantined(&self) -> &[Quarantined] {
        self.guard.quarantined()
    }

    /// How many quarantined maps were dropped for want of room, ever.
    pub const fn num_dropped(&self) -> u64 {
        self.memory.num_dropped + self.guard.num_dropped() as u64
    }

    /// Judges a map and integrates it, or keeps it in quarantine; `is_trusted`: it is integrated
    /// whatever it shows, which a map of a 3-D grid has to be. Nothing is written before [`commit`](Self::commit).
    ///
    /// # Errors
    /// As [`History::observe_as`]; [`ErrorKind::Shape`] for a map of a 3-D grid that is not trusted.
    pub fn take_in(
        &mut self,
        observer: &str,
        patch: &Patch,
        time: Time,
        is_trusted: bool,
    ) -> Result<TakenIn> {
        let spec = *self.grid.spec();
        if !spec.is_2d() {
            return self.take_in_solid(observer, patch, time, is_trusted);
        }
        let raw = digest_of(observer, patch, time);
        let id = MapId::new(observer, time);
        if self.grid.history().contains(observer, time) {
            if !self.memory.moved.contains(&raw) {
                // Says whether it is the same one.
                self.grid.observe_as(observer, patch, time)?;
            }
            return Ok(TakenIn::Known);
        }
        let before = self
            .guard
            .quarantined()
            .iter()
            .find(|it| MapId::of(it) == id);
        if let Some(held) = before.filter(|_| !is_trusted) {
            return Ok(TakenIn::QuarantinedBefore(held.judgement));
        }
        self.discard(id);
        let observed = map_of(spec, patch);
        let mut predicted = OccupancyMap::new_unknown(spec);
        self.grid.predict_into(time, &mut predicted)?;
        if is_trusted {
            let (map, judgement) = self.guard.trust(&predicted, &observed, time);
            self.remember_moved(&judgement, raw);
            self.integrate(observer, &map, time)?;
            return Ok(TakenIn::Integrated(judgement));
        }
        let decision = self.guard.judge(observer, &predicted, &observed, time)?;
        self.remember_moved(decision.judgement(), raw);
        match decision {
            Decision::Integrate(map, judgement) => {
                self.integrate(observer, &map, time)?;
                Ok(TakenIn::Integrated(judgement))
            }
            Decision::Quarantine(judgement) => {
                self.orders.push((id, self.next_order));
                self.next_order = self.next_order.saturating_add(1);
                Ok(TakenIn::Quarantined(judgement))
            }
            Decision::Adopt(held, judgement) => {
                for it in &held {
                    self.integrate(&it.observer, &it.map, it.judgement.time)?;
                }
                let num_maps = held.len();
                Ok(TakenIn::Adopted {
                    num_maps,
                    judgement,
                })
            }
        }
    }

    /// Integrates a map of a 3-D grid, which nothing judges.
    fn take_in_solid(
        &mut self,
        observer: &str,
        patch: &Patch,
        time: Time,
        is_trusted: bool,
    ) -> Result<TakenIn> {
        if !is_trusted {
            let message = "maps of a 3-D grid are not judged";
            return Err(Error::new(ErrorKind::Shape, message)
                .with_help("look at it, then integrate it as a trusted one (`--trust`)"));
        }
        let verdict = self.grid.observe_as(observer, patch, time)?;
        if verdict.outcome == Outcome::AlreadyKnown {
            return Ok(TakenIn::Known);
        }
        self.new.observe_as(observer, patch, time)?;
        Ok(TakenIn::Integrated(Judgement {
            time,
            registration: None,
            disagreement: 0.0,
            expected: 0.0,
            limit: f64::INFINITY,
            shift_limit_m: f64::INFINITY,
            reason: None,
        }))
    }

    /// Integrates a map in quarantine; false where there is none of this identity.
    ///
    /// # Errors
    /// As [`History::observe_as`].
    pub fn accept(&mut self, id: MapId) -> Result<bool> {
        let Some((observer, time)) = self.find(id) else {
            return Ok(false);
        };
        let Some(held) = self.guard.accept(&observer, time) else {
            return Ok(false);
        };
        self.integrate(&held.observer, &held.map, time)?;
        Ok(true)
    }

    /// Forgets a map in quarantine; false where there is none of this identity.
    pub fn discard(&mut self, id: MapId) -> bool {
        let found = self.find(id);
        found.is_some_and(|(observer, time)| self.guard.discard(&observer, time).is_some())
    }

    fn find(&self, id: MapId) -> Option<(String, Time)> {
        let mut all = self.guard.quarantined().iter();
        let held = all.find(|it| MapId::of(it) == id)?;
        Some((held.observer.clone(), held.judgement.time))
    }

    fn integrate(&mut self, observer: &str, map: &OccupancyMap, time: Time) -> Result<()> {
        let patch = Patch::from_map(map, Thresholds::default());
        self.grid.observe_as(observer, &patch, time)?;
        self.new.observe_as(observer, &patch, time)?;
        Ok(())
    }

    /// Of a map that was moved, what was given is not what is kept.
    fn remember_moved(&mut self, judgement: &Judgement, given: [u8; 16]) {
        let cell_m = self.grid.spec().resolution_m();
        if judgement.is_moved(cell_m) && !self.memory.moved.contains(&given) {
            self.memory.moved.push(given);
            let too_many = self.memory.moved.len().saturating_sub(MAX_MOVED);
            self.memory.moved.drain(..too_many);
        }
    }

    /// Writes what was taken in, accepted and discarded as one generation; gives how many
    /// observations are new. Without any change there is none.
    ///
    /// # Errors
    /// As [`GridFile::add`].
    pub fn commit(&mut self) -> Result<usize> {
        let memory = Memory {
            past: self.guard.past().to_vec(),
            num_in_row: self.guard.num_in_row(),
            num_dropped: self.num_dropped(),
            moved: self.memory.moved.clone(),
        };
        let held = self.guard.quarantined();
        self.orders
            .retain(|(id, _)| held.iter().any(|it| MapId::of(it) == *id));
        // An empty value takes an attachment away.
        let names = self.file.attachments().keys();
        let mut attachments: Attachments = (names.filter(|name| name.starts_with(HELD)))
            .map(|name| (name.clone(), Vec::new()))
            .collect();
        for it in held {
            let id = MapId::of(it);
            let order = self.orders.iter().find(|(known, _)| *known == id);
            let bytes = encode_held(it, order.map_or(0, |(_, order)| *order));
            let bytes = bytes.ok_or_else(|| unreadable(&id.to_string()))?;
            attachments.insert(format!("{HELD}{id}"), bytes);
        }
        let is_usual_known = self.file.attachments().contains_key(UNDIGESTED);
        let is_changed = self.new.num_observations() > 0
            || (attachments.iter()).any(|(name, value)| {
                self.file
                    .attachments()
                    .get(name)
                    .is_none_or(|it| it != value)
            });
        if is_changed || !is_usual_known {
            attachments.insert(UNDIGESTED.to_owned(), memory.encode());
        }
        let num_new = self.file.add_with(&self.new, &attachments)?;
        self.new = History::new(*self.new.spec());
        Ok(num_new)
    }
}

/// What is usual in a grid, by its own newest maps: each is compared with what the maps before it
/// predict of its time.
fn past_of(
    history: &History,
    config: &GridConfig,
    guard: GuardConfig,
    mut progress: impl FnMut(usize, usize),
) -> Result<Memory> {
    let num = history.num_observations();
    if !history.spec().is_2d() {
        return Ok(Memory::default());
    }
    let first = num.saturating_sub(guard.num_past);
    let mut grid = TemporalGrid::from_history(history.first(first), config.clone());
    let mut judging = Guard::new(guard);
    let mut predicted = OccupancyMap::new_unknown(*history.spec());
    let names = history.observation_names().enumerate().skip(first);
    for (number, (time, observer)) in names {
        let patch = history.patch(number);
        let observed = map_of(*history.spec(), &patch);
        grid.predict_into(time, &mut predicted)?;
        judging.trust(&predicted, &observed, time);
        grid.observe_as(observer, &patch, time)?;
        progress(number + 1 - first, num - first);
    }
    Ok(Memory {
        past: judging.past().to_vec(),
        ..Memory::default()
    })
}

/// What a patch says of the cells of a grid.
fn map_of(spec: GridSpec, patch: &Patch) -> OccupancyMap {
    let mut map = OccupancyMap::new_unknown(spec);
    let (min, dims) = (patch.min(), patch.dims());
    for y in min[1]..min[1].saturating_add(dims[1]) {
        for x in min[0]..min[0].saturating_add(dims[0]) {
            let cell = [x, y, 0];
            if spec.contains(cell) {
                map.set(spec.index(cell), patch.get(cell).as_probability());
            }
        }
    }
    map
}

fn digest_of(observer: &str, patch: &Patch, time: Time) -> [u8; 16] {
    let states: Vec<u8> = patch.states().iter().map(|&it| it as u8).collect();
    digest(&[
        &time.as_us().to_le_bytes(),
        observer.as_bytes(),
        states.as_slice(),
    ])
}

fn unreadable(name: &str) -> Error {
    Error::new(
        ErrorKind::Format,
        format!("the attachment `{name}` is not as it is written"),
    )
    .with_help("return to an earlier generation with `chronotope grid rollback`")
}

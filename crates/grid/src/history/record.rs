//! Which observations were made of which cells, and what did they change?

use std::collections::HashMap;

use fremen::{Error, ErrorKind, Result, Time};

use super::observations::Observations;
use super::tile::{Counts, Plane, Tile};
use crate::cells::{CellState, GridSpec, Patch};
use crate::tiles::Tiling;

/// Everything that was observed of a grid, without loss.
#[derive(Clone, Debug)]
pub struct History {
    pub(super) tiling: Tiling,
    pub(super) observations: Observations,
    /// In the order in which they were first observed.
    pub(super) tiles: Vec<Tile>,
    /// Where in `tiles` the tile of a key is.
    pub(super) slots: HashMap<u32, u32>,
}

/// What became of an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Outcome {
    /// It was added.
    Integrated,
    /// It had been added before; nothing was done.
    AlreadyKnown,
}

/// What an observation said, compared with what was last known of its cells before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// What became of it.
    pub outcome: Outcome,
    /// Cells that it saw.
    pub num_known: usize,
    /// Cells that were free and are occupied, or the reverse.
    pub num_changed: usize,
    /// Cells that the last observation of their tile had not seen.
    pub num_revealed: usize,
    /// Cells that the last observation of their tile had seen, and this one did not.
    pub num_hidden: usize,
}

/// What a history costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Tiles that were observed.
    pub num_tiles: usize,
    /// Cells that had more than one state (free, occupied, unknown) since their tile was first
    /// observed.
    pub num_changing_cells: usize,
    /// Bytes that do not depend on whether cells change.
    pub tile_bytes: usize,
    /// Bytes of the logs of changing cells.
    pub log_bytes: usize,
    /// Bytes of the times and names of observations.
    pub observation_bytes: usize,
}

impl Memory {
    /// All bytes together.
    pub const fn total_bytes(&self) -> usize {
        self.tile_bytes + self.log_bytes + self.observation_bytes
    }
}

impl History {
    /// Nothing observed yet.
    pub fn new(spec: GridSpec) -> Self {
        Self::from_parts(Tiling::new(spec), Observations::default(), Vec::new())
    }

    pub(crate) fn from_parts(
        tiling: Tiling,
        observations: Observations,
        mut tiles: Vec<Tile>,
    ) -> Self {
        tiles.sort_unstable_by_key(Tile::key);
        let slots = (0_u32..)
            .zip(&tiles)
            .map(|(slot, tile)| (tile.key(), slot))
            .collect();
        Self {
            tiling,
            observations,
            tiles,
            slots,
        }
    }

    /// Where the cells are.
    pub const fn spec(&self) -> &GridSpec {
        self.tiling.spec()
    }

    pub(crate) const fn tiling(&self) -> &Tiling {
        &self.tiling
    }

    pub(crate) const fn observations(&self) -> &Observations {
        &self.observations
    }

    /// The observed tiles in the order in which they were first observed.
    pub(crate) fn tiles(&self) -> &[Tile] {
        &self.tiles
    }

    pub(crate) fn slot(&self, key: u32) -> Option<usize> {
        self.slots.get(&key).map(|&slot| slot as usize)
    }

    /// The observed tiles in the order of their keys.
    pub(crate) fn sorted_tiles(&self) -> Vec<&Tile> {
        let mut tiles: Vec<&Tile> = self.tiles.iter().collect();
        tiles.sort_unstable_by_key(|tile| tile.key());
        tiles
    }

    /// How many observations there are.
    pub fn num_observations(&self) -> usize {
        self.observations.len()
    }

    /// Time and observer of each observation, oldest first.
    pub fn observation_names(&self) -> impl Iterator<Item = (Time, &str)> {
        (0..self.observations.len()).map(|index| {
            (
                self.observations.time(index),
                self.observations.observer(index),
            )
        })
    }

    /// What is kept in memory.
    pub fn memory(&self) -> Memory {
        let mut memory = Memory {
            num_tiles: self.tiles.len(),
            observation_bytes: self.observations.heap_bytes(),
            // An entry of the hash map is 8 bytes and one of control.
            tile_bytes: self.slots.capacity() * 9,
            ..Memory::default()
        };
        for tile in &self.tiles {
            let (fixed, logs) = tile.num_bytes();
            memory.tile_bytes += fixed;
            memory.log_bytes += logs;
            memory.num_changing_cells += tile.num_logs();
        }
        memory
    }

    /// The state of a cell at each observation of its tile, as runs: when the run began, how many
    /// observations it has, and the state.
    pub fn runs(&self, cell: [u32; 3]) -> Vec<(Time, u32, CellState)> {
        let mut runs = Vec::new();
        let (key, at) = self.tiling.locate(cell);
        let Some(slot) = self.slot(key).filter(|_| self.spec().contains(cell)) else {
            return runs;
        };
        let tile = &self.tiles[slot];
        let (mut from, mut state) = (0, tile.state(at));
        let mut push = |from: u32, end: u32, state| {
            let observation = tile.visits().observation(from);
            runs.push((
                self.observations.time(observation as usize),
                end - from,
                state,
            ));
        };
        if let Some(log) = tile.log(at) {
            state = log.first();
            for change in log.changes() {
                push(from, change.visit, state);
                (from, state) = (change.visit, change.state);
            }
        }
        push(from, tile.visits().len(), state);
        runs
    }

    /// The state of a cell in the last observation that saw it, and when that was.
    pub fn last_seen(&self, cell: [u32; 3]) -> Option<(Time, CellState)> {
        let (key, at) = self.tiling.locate(cell);
        let tile = &self.tiles[self.slot(key).filter(|_| self.spec().contains(cell))?];
        let (mut state, mut end) = (tile.state(at), tile.visits().len());
        if !state.is_known() {
            let mut before = tile.log(at)?.first();
            for change in tile.log(at)?.changes() {
                if before.is_known() {
                    (state, end) = (before, change.visit);
                }
                before = change.state;
            }
        }
        let observation = tile.visits().observation(end.checked_sub(1)?) as usize;
        state
            .is_known()
            .then(|| (self.observations.time(observation), state))
    }

    /// Whether this observer's observation of this time is one of them.
    pub fn contains(&self, observer: &str, time: Time) -> bool {
        self.observations.find(time, observer).is_ok()
    }

    /// Whether an observation would be the last.
    pub(crate) fn is_latest(&self, observer: &str, time: Time) -> bool {
        self.observations.find(time, observer) == Err(self.observations.len())
    }

    /// The tiles of which a patch has cells.
    pub(crate) fn slots_of(&self, patch: &Patch) -> impl Iterator<Item = usize> + '_ {
        keys_of(&self.tiling, patch)
            .into_iter()
            .filter_map(|key| self.slot(key))
    }

    /// Adds what an anonymous observer saw at a time; see [`Self::observe_as`].
    pub fn observe(&mut self, patch: &Patch, time: Time) -> Result<Verdict> {
        self.observe_as("", patch, time)
    }

    /// Adds what `observer` (a robot, a sensor, a file) saw at a time.
    ///
    /// Observer and time are the observation's identity: the same once more is known already.
    /// Observations may come in any order; one that is newer than all others costs as much as it
    /// has cells and changes, an older one as much as all that is known of its tiles.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where the patch reaches out of the grid or the observations are too
    /// many, [`ErrorKind::Conflict`] where this observer saw something else at this time.
    pub fn observe_as(&mut self, observer: &str, patch: &Patch, time: Time) -> Result<Verdict> {
        self.check_inside(patch)?;
        let (index, is_known) = match self.observations.find(time, observer) {
            Ok(index) => (index, true),
            Err(index) => (index, false),
        };
        if !is_known && index == self.observations.len() {
            return self.append(observer, patch, time);
        }
        let mut single = Self::new(*self.spec());
        let mut verdict = single.append(observer, patch, time)?;
        let counts = self.counts_at(index as u32, &single);
        verdict.num_changed = counts.changed;
        verdict.num_revealed = counts.revealed;
        verdict.num_hidden = counts.hidden;
        // Finds out whether a known one is the same, too.
        self.merge(&single)?;
        if is_known {
            verdict.outcome = Outcome::AlreadyKnown;
        }
        Ok(verdict)
    }

    /// How the one observation of `single` differs from what was observed before `index`.
    fn counts_at(&self, index: u32, single: &Self) -> Counts {
        let mut counts = Counts::default();
        for tile in &single.tiles {
            let known = self.slot(tile.key()).map(|slot| &self.tiles[slot]);
            let visit = known.and_then(|known| {
                let earlier = known.visits().observations().take_while(|&it| it < index);
                earlier.count().checked_sub(1)
            });
            let before = match (known, visit) {
                (Some(known), Some(visit)) => known.planes_at(visit as u32),
                _ => vec![Plane::default(); tile.num_words()],
            };
            for (word, before) in before.into_iter().enumerate() {
                counts.add(before, tile.plane(word));
            }
        }
        counts
    }

    fn check_inside(&self, patch: &Patch) -> Result<()> {
        let (min, dims, all) = (patch.min(), patch.dims(), self.spec().dims());
        let fits = |axis: usize| {
            min[axis]
                .checked_add(dims[axis])
                .is_some_and(|end| end <= all[axis])
        };
        if (0..3).all(fits) {
            return Ok(());
        }
        Err(Error::new(
            ErrorKind::Shape,
            format!("a patch of {dims:?} cells from {min:?} reaches out of a grid of {all:?}"),
        )
        .with_help("cut it to the grid"))
    }

    /// Adds an observation whose identity is above all others'.
    fn append(&mut self, observer: &str, patch: &Patch, time: Time) -> Result<Verdict> {
        let number = self.observations.enlist(observer)?;
        let observation = self.observations.push(time, number)?;
        let mut counts = Counts::default();
        let num_cells = self.tiling.num_cells();
        let mut planes = vec![Plane::default(); num_cells / 64];
        for key in keys_of(&self.tiling, patch) {
            if !planes_of(&self.tiling, key, patch, &mut planes) {
                continue;
            }
            let slot = *self.slots.entry(key).or_insert_with(|| {
                self.tiles.push(Tile::new(key, num_cells));
                self.tiles.len() as u32 - 1
            });
            let tile = &mut self.tiles[slot as usize];
            counts = counts.plus(tile.visit(observation, &planes));
        }
        Ok(Verdict {
            outcome: Outcome::Integrated,
            num_known: counts.known,
            num_changed: counts.changed,
            num_revealed: counts.revealed,
            num_hidden: counts.hidden,
        })
    }
}

/// Two histories are equal where they hold the same observations, in whatever order they came.
impl PartialEq for History {
    fn eq(&self, other: &Self) -> bool {
        self.tiling == other.tiling
            && self.observations == other.observations
            && self.sorted_tiles() == other.sorted_tiles()
    }
}

/// The keys of the tiles that a patch touches, ascending.
pub(super) fn keys_of(tiling: &Tiling, patch: &Patch) -> Vec<u32> {
    let (min, dims, sides) = (patch.min(), patch.dims(), tiling.sides());
    if dims.contains(&0) {
        return Vec::new();
    }
    let first: [u32; 3] = std::array::from_fn(|axis| min[axis] / sides[axis]);
    let last: [u32; 3] = std::array::from_fn(|axis| (min[axis] + dims[axis] - 1) / sides[axis]);
    let mut keys = Vec::new();
    for z in first[2]..=last[2] {
        for y in first[1]..=last[1] {
            keys.extend((first[0]..=last[0]).map(|x| tiling.key([x, y, z])));
        }
    }
    keys
}

/// Writes the states that a patch has for the cells of a tile; whether one of them is known.
pub(super) fn planes_of(tiling: &Tiling, key: u32, patch: &Patch, planes: &mut [Plane]) -> bool {
    planes.fill(Plane::default());
    let (tile_min, sides) = (tiling.min(key), tiling.sides());
    let (min, dims) = (patch.min(), patch.dims());
    let from: [u32; 3] = std::array::from_fn(|axis| tile_min[axis].max(min[axis]));
    let to: [u32; 3] =
        std::array::from_fn(|axis| (tile_min[axis] + sides[axis]).min(min[axis] + dims[axis]));
    let mut any = 0;
    for z in from[2]..to[2] {
        for y in from[1]..to[1] {
            let row = (y - min[1]) as usize + dims[1] as usize * (z - min[2]) as usize;
            let start = row * dims[0] as usize + (from[0] - min[0]) as usize;
            let states = &patch.states()[start..start + (to[0] - from[0]) as usize];
            let (known, occupied) = packed(states);
            let (_, at) = tiling.locate([from[0], y, z]);
            let plane = &mut planes[at / 64];
            plane.known |= known << (at % 64);
            plane.occupied |= occupied << (at % 64);
            any |= known;
        }
    }
    any != 0
}

/// One bit a state, of at most 64: whether it is known, and whether it is occupied.
///
/// Eight states at a time: a product gathers the lowest bits of eight bytes in its highest byte.
#[inline]
fn packed(states: &[CellState]) -> (u64, u64) {
    const LOW: u64 = 0x0101_0101_0101_0101;
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let gathered = |bytes: u64| bytes.wrapping_mul(GATHER) >> 56;
    let (mut known, mut occupied) = (0, 0);
    for (group, states) in states.chunks(8).enumerate() {
        let mut bytes = [CellState::Unknown as u8; 8];
        for (byte, &state) in bytes.iter_mut().zip(states) {
            *byte = state as u8;
        }
        // 0 is free, 1 occupied, 2 unknown.
        let bytes = u64::from_le_bytes(bytes);
        known |= gathered(!(bytes >> 1) & LOW) << (8 * group);
        occupied |= gathered(bytes & LOW) << (8 * group);
    }
    (known, occupied)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_states_are_those_one_by_one() {
        use CellState::{Free, Occupied, Unknown};
        let mut random = crate::random::Random::stream(5, &[1]);
        for num in 0..=64 {
            let states: Vec<CellState> = (0..num)
                .map(|_| [Free, Occupied, Unknown][random.below(3)])
                .collect();
            let (known, occupied) = packed(&states);
            for bit in 0..64 {
                let state = states.get(bit).copied().unwrap_or(Unknown);
                assert_eq!(known >> bit & 1 == 1, state.is_known(), "{num} {bit}");
                assert_eq!(occupied >> bit & 1 == 1, state == Occupied, "{num} {bit}");
            }
        }
    }
}

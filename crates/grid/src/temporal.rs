//! What will the world look like at time t?

use fremen::{Component, Error, ErrorKind, Result, Time};
use rayon::prelude::*;

use crate::cells::{CellState, GridSpec, OccupancyMap, Patch};
use crate::history::{Forgotten, FrameStream, History, Memory, Verdict};
use crate::model::{Errors, GridConfig, Moment, Stats, TileModel, errors, errors_by_day, fit};
use crate::tiles::MAX_TILE_CELLS;

/// A grid that remembers when each cell was free and when occupied, and predicts the occupancy of
/// any time.
///
/// p(t) of a cell is a mixture of its last observed state and of its periodic part f(t): the less
/// time has passed since it was seen, compared with the time tau that its states last, the more the
/// last state counts (IROS 2016 eq. 2).
///
/// ```
/// use fremen_grid::{CellState, GridConfig, GridSpec, OccupancyMap, Patch, TemporalGrid, Time};
///
/// # fn main() -> fremen_grid::Result<()> {
/// let spec = GridSpec::new_2d([0.0, 0.0], 0.05, [40, 20])?;
/// let mut grid = TemporalGrid::new(spec, GridConfig::default());
/// // A cupboard that is open from 8 to 18 o'clock, seen every hour for ten days.
/// let mut patch = Patch::new_whole(&spec);
/// for hour in 0..240 {
///     let is_open = (8..18).contains(&(hour % 24));
///     let state = if is_open { CellState::Occupied } else { CellState::Free };
///     patch.set([7, 7, 0], state);
///     grid.observe(&patch, Time::from_s(hour * 3600))?;
/// }
/// let mut map = OccupancyMap::new_unknown(spec);
/// grid.predict_into(Time::from_s((20 * 24 + 13) * 3600), &mut map)?;
/// let cell = spec.index([7, 7, 0]);
/// assert!(map.get(cell) > Some(0.8));
/// grid.predict_into(Time::from_s((20 * 24 + 1) * 3600), &mut map)?;
/// assert!(map.get(cell) < Some(0.2));
/// // Nothing is known of what was never seen.
/// assert_eq!(map.get(0), None);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct TemporalGrid {
    history: History,
    config: GridConfig,
    /// Of each tile of the history; none where the last state of its cells says all.
    models: Vec<Option<Box<TileModel>>>,
    /// Which of them the history has left behind; all that are missing are, too.
    is_stale: Vec<bool>,
}

impl TemporalGrid {
    /// A grid of which nothing is known yet.
    pub fn new(spec: GridSpec, config: GridConfig) -> Self {
        Self::from_history(History::new(spec), config)
    }

    /// A grid that remembers what is in a history.
    pub fn from_history(history: History, config: GridConfig) -> Self {
        Self {
            history,
            config,
            models: Vec::new(),
            is_stale: Vec::new(),
        }
    }

    /// Where the cells are.
    pub const fn spec(&self) -> &GridSpec {
        self.history.spec()
    }

    /// What was observed.
    pub const fn history(&self) -> &History {
        &self.history
    }

    /// Gives the history away.
    pub fn into_history(self) -> History {
        self.history
    }

    /// How it predicts.
    pub const fn config(&self) -> &GridConfig {
        &self.config
    }

    /// Predicts otherwise from now on; nothing that was observed is lost.
    pub fn set_config(&mut self, config: GridConfig) {
        if !config.is_fitted_as(&self.config) {
            self.is_stale.clear();
        }
        self.config = config;
    }

    /// What the history costs in memory.
    pub fn memory(&self) -> Memory {
        self.history.memory()
    }

    /// Bytes of the models that are made so far; they can be made again at any time.
    pub fn model_bytes(&self) -> usize {
        let models = self.models.iter().flatten();
        let bytes = models.map(|model| size_of::<TileModel>() + model.heap_bytes());
        bytes.sum::<usize>()
            + self.models.capacity() * size_of::<Option<Box<TileModel>>>()
            + self.is_stale.capacity()
    }

    /// Adds what was seen at a time; see [`History::observe`].
    pub fn observe(&mut self, patch: &Patch, time: Time) -> Result<Verdict> {
        self.observe_as("", patch, time)
    }

    /// Adds what `observer` saw at a time; see [`History::observe_as`].
    pub fn observe_as(&mut self, observer: &str, patch: &Patch, time: Time) -> Result<Verdict> {
        let is_latest = self.history.is_latest(observer, time);
        let verdict = self.history.observe_as(observer, patch, time);
        if is_latest {
            for slot in self.history.slots_of(patch) {
                if let Some(is_stale) = self.is_stale.get_mut(slot) {
                    *is_stale = true;
                }
            }
        } else {
            self.is_stale.clear();
        }
        verdict
    }

    /// Begins a stream of frames; see [`History::frames`].
    pub fn frames(
        &mut self,
        observer: &str,
        view: &Patch,
        time: Time,
    ) -> Result<(Verdict, FrameStream<'_>)> {
        self.is_stale.clear();
        self.history.frames(observer, view, time)
    }

    /// Adds all observations of another grid; see [`History::merge`].
    pub fn merge(&mut self, other: &History) -> Result<usize> {
        self.is_stale.clear();
        self.history.merge(other)
    }

    /// Forgets all observations before a time; see [`History::forget_before`].
    pub fn forget_before(&mut self, time: Time) -> Forgotten {
        self.is_stale.clear();
        self.history.forget_before(time)
    }

    /// Brings the models up to date and gives what can be asked of them.
    ///
    /// Costs O(changes x K) after an observation, nothing otherwise.
    pub fn fitted(&mut self) -> FittedGrid<'_> {
        let num_tiles = self.history.tiles().len();
        self.is_stale.resize(num_tiles, true);
        self.models.resize(num_tiles, None);
        let stale: Vec<usize> = (0..num_tiles).filter(|&slot| self.is_stale[slot]).collect();
        let models = fit(&self.history, &self.config, &stale);
        for (slot, model) in stale.into_iter().zip(models) {
            self.models[slot] = model;
            self.is_stale[slot] = false;
        }
        FittedGrid { grid: self }
    }

    /// Writes the occupancy that is expected at a time into a map of the same cells.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where the map has other cells.
    pub fn predict_into(&mut self, time: Time, map: &mut OccupancyMap) -> Result<()> {
        self.fitted().predict_into(time, map)
    }
}

/// The probabilities of eight known cells, by the bits of those that are occupied.
const STATES: [[f32; 8]; 256] = {
    let mut states = [[0.0; 8]; 256];
    let mut at = 0;
    while at < 256 * 8 {
        if (at / 8) >> (at % 8) & 1 == 1 {
            states[at / 8][at % 8] = 1.0;
        }
        at += 1;
    }
    states
};

/// A grid whose models are up to date: any number of threads may query it.
#[derive(Clone, Copy, Debug)]
pub struct FittedGrid<'a> {
    grid: &'a TemporalGrid,
}

/// Why a cell is predicted as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// The probability that it is occupied; none where it was never seen.
    pub probability: Option<f64>,
    /// The periodic part f(t) of it.
    pub periodic: f64,
    /// The weight of the last observation against f(t).
    pub persistence: f64,
    /// When it was last seen, and how.
    pub last_seen: Option<(Time, CellState)>,
    /// Observations that saw it.
    pub num_observed: u32,
    /// Observations that saw it occupied.
    pub num_occupied: u32,
    /// Changes between free and occupied.
    pub num_changes: u32,
    /// The mean time that a state lasts, in seconds; none where it never changed.
    pub tau_s: Option<f64>,
    /// Its rhythms, strongest first.
    pub rhythms: Vec<Component>,
}

impl FittedGrid<'_> {
    /// Writes the occupancy that is expected at a time into a map of the same cells; NaN where a
    /// cell was never seen.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where the map has other cells.
    pub fn predict_into(&self, time: Time, map: &mut OccupancyMap) -> Result<()> {
        let tiling = self.grid.history.tiling();
        if map.spec() != tiling.spec() {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "a map of {:?} for a grid of {:?}",
                    map.spec(),
                    tiling.spec()
                ),
            )
            .with_help("make the map with the grid's spec"));
        }
        let moment = Moment::new(&self.grid.config, time);
        let [w, h, _] = tiling.spec().dims().map(|n| n as usize);
        let [_, side_y, side_z] = tiling.sides().map(|n| n as usize);
        // A band is one row of tiles in 2-D, one layer of them in 3-D.
        let is_2d = tiling.spec().is_2d();
        let band = if is_2d { w * side_y } else { w * h * side_z };
        let [_, rows, layers] = tiling.counts();
        map.probabilities_mut()
            .par_chunks_mut(band)
            .enumerate()
            .for_each(|(at, cells)| {
                let (ys, zs) = if is_2d {
                    (at as u32..at as u32 + 1, 0..1)
                } else {
                    (0..rows, at as u32..(at as u32 + 1).min(layers))
                };
                let mut scratch = Vec::new();
                for z in zs {
                    for y in ys.clone() {
                        self.predict_row(&moment, [y, z], cells, &mut scratch);
                    }
                }
            });
        Ok(())
    }

    /// Predicts the tiles of row y in layer z into their band of cells.
    fn predict_row(
        &self,
        moment: &Moment,
        [y, z]: [u32; 2],
        cells: &mut [f32],
        scratch: &mut Vec<f32>,
    ) {
        let tiling = self.grid.history.tiling();
        let [w, h, _] = tiling.spec().dims().map(|n| n as usize);
        let side = tiling.sides()[0] as usize;
        let mut values = [f32::NAN; MAX_TILE_CELLS];
        for x in 0..tiling.counts()[0] {
            let key = tiling.key([x, y, z]);
            let extent = tiling.extent(key).map(|n| n as usize);
            let min = tiling.min(key).map(|n| n as usize);
            let is_known = self.tile_into(key, moment, scratch, &mut values);
            for layer in 0..extent[2] {
                for row in 0..extent[1] {
                    let y = if tiling.spec().is_2d() {
                        row
                    } else {
                        min[1] + row
                    };
                    let start = min[0] + w * (y + h * layer);
                    let out = &mut cells[start..start + extent[0]];
                    if is_known {
                        let from = side * (row + tiling.sides()[1] as usize * layer);
                        out.copy_from_slice(&values[from..from + extent[0]]);
                    } else {
                        out.fill(f32::NAN);
                    }
                }
            }
        }
    }

    /// Predicts all cells of a tile; false where it was never observed.
    #[inline]
    fn tile_into(
        &self,
        key: u32,
        moment: &Moment,
        scratch: &mut Vec<f32>,
        values: &mut [f32; MAX_TILE_CELLS],
    ) -> bool {
        let history = &self.grid.history;
        let Some(slot) = history.slot(key) else {
            return false;
        };
        let tile = &history.tiles()[slot];
        for (word, values) in values
            .chunks_exact_mut(64)
            .take(tile.num_words())
            .enumerate()
        {
            let plane = tile.plane(word);
            let occupied = plane.occupied.to_le_bytes();
            let known = plane.known.to_le_bytes();
            let eights = values.chunks_exact_mut(8).zip(occupied).zip(known);
            for ((values, occupied), known) in eights {
                values.copy_from_slice(&STATES[usize::from(occupied)]);
                if known != u8::MAX {
                    let unknown = |bit: usize| known >> bit & 1 == 0;
                    let hidden = values
                        .iter_mut()
                        .enumerate()
                        .filter(|(bit, _)| unknown(*bit));
                    hidden.for_each(|(_, value)| *value = f32::NAN);
                }
            }
        }
        if let Some(model) = self.grid.models.get(slot).and_then(Option::as_deref)
            && tile.num_logs() > 0
        {
            model.write(moment, scratch, values);
        }
        true
    }

    /// The probability that a cell is occupied at a time; none where it was never seen.
    pub fn p(&self, cell: [u32; 3], time: Time) -> Option<f64> {
        self.p_at(cell, &Moment::new(&self.grid.config, time))
    }

    fn p_at(&self, cell: [u32; 3], moment: &Moment) -> Option<f64> {
        let history = &self.grid.history;
        let (key, at) = history.tiling().locate(cell);
        let slot = history
            .slot(key)
            .filter(|_| self.grid.spec().contains(cell))?;
        let model = self.grid.models.get(slot).and_then(Option::as_deref);
        model
            .and_then(|model| model.p(at, moment))
            .map(f64::from)
            .or_else(|| match history.tiles()[slot].state(at) {
                CellState::Free => Some(0.0),
                CellState::Occupied => Some(1.0),
                CellState::Unknown => None,
            })
    }

    /// How uncertain a box of `dims` cells from `min` on is at a time, in bits: the sum of the
    /// entropies of its cells, 1 bit for one that was never seen.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where the box reaches out of the grid.
    pub fn entropy(&self, min: [u32; 3], dims: [u32; 3], time: Time) -> Result<f64> {
        let all = self.grid.spec().dims();
        let fits = |i: usize| min[i].checked_add(dims[i]).is_some_and(|end| end <= all[i]);
        if !(0..3).all(fits) {
            return Err(Error::new(
                ErrorKind::Shape,
                format!("a box of {dims:?} cells from {min:?} reaches out of {all:?}"),
            ));
        }
        let moment = Moment::new(&self.grid.config, time);
        let tiling = self.grid.history.tiling();
        let (mut scratch, mut values) = (Vec::new(), [f32::NAN; MAX_TILE_CELLS]);
        let mut held = None;
        let mut bits = 0.0;
        for z in min[2]..min[2] + dims[2] {
            for y in min[1]..min[1] + dims[1] {
                for x in min[0]..min[0] + dims[0] {
                    let (key, at) = tiling.locate([x, y, z]);
                    if held != Some(key) {
                        if !self.tile_into(key, &moment, &mut scratch, &mut values) {
                            values.fill(f32::NAN);
                        }
                        held = Some(key);
                    }
                    bits += entropy_of(values[at]);
                }
            }
        }
        Ok(bits)
    }

    /// Why a cell is predicted as it is at a time.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where there is no such cell.
    pub fn explain(&self, cell: [u32; 3], time: Time) -> Result<Explanation> {
        if !self.grid.spec().contains(cell) {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "no cell {cell:?} in a grid of {:?}",
                    self.grid.spec().dims()
                ),
            ));
        }
        let history = &self.grid.history;
        let moment = Moment::new(&self.grid.config, time);
        let probability = self.p_at(cell, &moment);
        let mut explanation = Explanation {
            probability,
            periodic: probability.unwrap_or(0.5),
            persistence: 0.0,
            last_seen: history.last_seen(cell),
            num_observed: 0,
            num_occupied: 0,
            num_changes: 0,
            tau_s: None,
            rhythms: Vec::new(),
        };
        let (key, at) = history.tiling().locate(cell);
        let Some(slot) = history.slot(key) else {
            return Ok(explanation);
        };
        let tile = &history.tiles()[slot];
        let Some(log) = tile.log(at) else {
            let num = if tile.state(at).is_known() {
                tile.visits().len()
            } else {
                0
            };
            explanation.num_observed = num;
            explanation.num_occupied = num * u32::from(tile.state(at) == CellState::Occupied);
            return Ok(explanation);
        };
        let all_us = history.observations().times_us();
        let times_us: Vec<i64> = tile
            .visits()
            .observations()
            .map(|it| all_us[it as usize])
            .collect();
        let stats = Stats::new(log.first(), log.changes(), &times_us);
        explanation.num_observed = stats.num_known;
        explanation.num_occupied = stats.num_occupied;
        explanation.num_changes = stats.num_changes;
        explanation.tau_s = (stats.rate > 0.0).then(|| 1.0 / stats.rate);
        if let Some(model) = self.grid.models.get(slot).and_then(Option::as_deref) {
            if let Some((periodic, persistence)) = model.parts(at, &moment) {
                explanation.periodic = periodic.into();
                explanation.persistence = persistence.into();
            }
            if let Some(candidates) = self.grid.config.model().candidates() {
                let rhythm = |cos: f32, sin: f32, k: u16| Component {
                    period_s: candidates.period_s(k.into()),
                    amplitude: f64::from(cos).hypot(sin.into()),
                    phase_rad: f64::from(-sin).atan2(cos.into()),
                };
                let terms = model.terms(at);
                explanation.rhythms = terms
                    .iter()
                    .map(|it| rhythm(it.cos, it.sin, it.k))
                    .collect();
            }
        }
        Ok(explanation)
    }

    /// The period in seconds and the amplitude of a cell's strongest rhythm; none where it has none.
    pub fn strongest_rhythm(&self, cell: [u32; 3]) -> Option<(f64, f64)> {
        let candidates = self.grid.config.model().candidates()?;
        let (key, at) = self.grid.history.tiling().locate(cell);
        let slot = self
            .grid
            .history
            .slot(key)
            .filter(|_| self.grid.spec().contains(cell))?;
        let term = self
            .grid
            .models
            .get(slot)?
            .as_deref()?
            .terms(at)
            .first()
            .copied()?;
        let amplitude = f64::from(term.cos).hypot(term.sin.into());
        Some((candidates.period_s(term.k.into()), amplitude))
    }

    /// How it predicts.
    pub fn config(&self) -> &GridConfig {
        &self.grid.config
    }

    /// What was observed.
    pub fn history(&self) -> &History {
        &self.grid.history
    }

    pub(crate) fn tile_model(&self, slot: usize) -> Option<&TileModel> {
        self.grid.models.get(slot)?.as_deref()
    }

    /// How well the periodic part of predictions gives back every `stride`-th observation of each
    /// tile.
    pub fn errors(&self, stride: usize) -> Errors {
        let TemporalGrid {
            history,
            config,
            models,
            ..
        } = self.grid;
        errors(history, config, models, stride.max(1))
    }

    /// The same of each day since the first observation.
    pub fn errors_by_day(&self, stride: usize) -> Vec<Errors> {
        let TemporalGrid {
            history,
            config,
            models,
            ..
        } = self.grid;
        errors_by_day(history, config, models, stride.max(1))
    }

    /// Cells that were seen both free and occupied.
    pub fn num_varying(&self) -> usize {
        self.grid
            .models
            .iter()
            .flatten()
            .map(|model| model.num_varying())
            .sum()
    }
}

/// In bits; 1 for NaN, of which nothing is known.
fn entropy_of(p: f32) -> f64 {
    let p = f64::from(p);
    if p.is_nan() {
        return 1.0;
    }
    let part = |p: f64| if p > 0.0 { -p * p.log2() } else { 0.0 };
    part(p) + part(1.0 - p)
}

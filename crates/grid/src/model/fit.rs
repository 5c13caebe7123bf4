//! How do all cells get their models for the price of their changes?

use std::collections::BTreeMap;

use fremen::spectrum::strongest;
use fremen::{CandidatePeriods, Time};
use rayon::prelude::*;

use super::columns::{Columns, Prefixes, from_fixed};
use super::config::{CellModel, GridConfig, Persistence};
use super::folded::means;
use super::stats::Stats;
use super::tile_model::{CellRecord, Moment, Term, TileModel};
use crate::cells::CellState;
use crate::history::{CellLog, Change, Changes, History, Tile};

/// Bytes of the prefix sums that are held at once.
const TABLE_BYTES: usize = 96 << 20;
/// Bytes of the sums of cells that are held at once.
const SUMS_BYTES: usize = 192 << 20;

/// The models of the tiles in `slots`, in their order; none where the state of the last visit says
/// all.
///
/// Tiles with the same visits share their prefix sums. Memory is bounded however many visits and
/// cells there are: the times are gone through in blocks, the cells in batches.
pub(crate) fn fit(
    history: &History,
    config: &GridConfig,
    slots: &[usize],
) -> Vec<Option<Box<TileModel>>> {
    let columns = Columns::of(config.model());
    let mut groups: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (at, &slot) in slots.iter().enumerate() {
        let tile = &history.tiles()[slot];
        if tile.num_logs() > 0 {
            groups.entry(tile.visits()).or_default().push(at);
        }
    }
    let groups: Vec<Vec<usize>> = groups.into_values().collect();
    let fitted: Vec<(usize, TileModel)> = groups
        .par_iter()
        .flat_map_iter(|group| {
            let tiles = group
                .iter()
                .map(|&at| &history.tiles()[slots[at]])
                .collect();
            let models = Group::new(history, config, &columns, tiles).fit();
            group.iter().copied().zip(models)
        })
        .collect();
    let mut models = vec![None; slots.len()];
    for (at, model) in fitted {
        models[at] = Some(Box::new(model));
    }
    models
}

/// Tiles with the same visits.
struct Group<'a> {
    config: &'a GridConfig,
    columns: &'a Columns,
    tiles: Vec<&'a Tile>,
    times_us: Vec<i64>,
}

/// A cell with a log.
struct Cell<'a> {
    tile: usize,
    at: u16,
    log: &'a CellLog,
    stats: Stats,
}

impl<'a> Group<'a> {
    fn new(
        history: &History,
        config: &'a GridConfig,
        columns: &'a Columns,
        tiles: Vec<&'a Tile>,
    ) -> Self {
        let all_us = history.observations().times_us();
        let visits = tiles
            .first()
            .into_iter()
            .flat_map(|tile| tile.visits().observations());
        let times_us = visits.map(|it| all_us[it as usize]).collect();
        Self {
            config,
            columns,
            tiles,
            times_us,
        }
    }

    fn fit(&self) -> Vec<TileModel> {
        let cells = self.cells();
        let varying: Vec<&Cell<'_>> = cells.iter().filter(|it| it.stats.varies()).collect();
        let row_bytes = 8 * self.columns.width();
        let batch = (SUMS_BYTES / (2 * row_bytes).max(1)).max(1);
        let mut records: Vec<Vec<CellRecord>> = vec![Vec::new(); self.tiles.len()];
        for batch in varying.chunks(batch) {
            for (cell, record) in batch.iter().zip(self.records(batch)) {
                records[cell.tile].push(record);
            }
        }
        let mut constants: Vec<Vec<(u16, bool)>> = vec![Vec::new(); self.tiles.len()];
        for cell in cells.iter().filter(|it| !it.stats.varies()) {
            let hidden = !self.tiles[cell.tile].state(cell.at.into()).is_known();
            if hidden && cell.stats.num_known > 0 {
                let is_occupied = cell.stats.num_occupied > 0;
                constants[cell.tile].push((cell.at, is_occupied));
            }
        }
        let last = self.times_us.last().copied().map(Time::from_us);
        let tiles = records.iter().zip(constants);
        tiles
            .map(|(records, constants)| TileModel::new(last, constants, records))
            .collect()
    }

    /// All cells with logs, tile after tile.
    fn cells(&self) -> Vec<Cell<'a>> {
        let tiles = self.tiles.par_iter().enumerate();
        tiles
            .flat_map_iter(|(tile, it)| {
                it.logs().map(move |(at, log)| Cell {
                    tile,
                    at: at as u16,
                    log,
                    stats: Stats::new(log.first(), log.changes(), &self.times_us),
                })
            })
            .collect()
    }

    /// What predictions of cells that vary are made of.
    fn records(&self, cells: &[&Cell<'_>]) -> Vec<CellRecord> {
        let (mut sums, all) = self.sums(self.columns, cells);
        let supported = self.supported();
        let records = cells.par_iter().zip(sums.par_iter_mut());
        let mut records: Vec<CellRecord> = records
            .map(|(cell, sums)| self.record(cell, sums, &all, &supported))
            .collect();
        drop(sums);
        if let CellModel::Folded {
            candidates,
            num_bins,
        } = self.config.model()
        {
            self.fold(candidates, *num_bins, cells, &mut records);
        }
        if self.config.persistence() == Persistence::Surprise {
            self.compare_with_last(cells, &mut records);
        }
        records
    }

    /// Folds each cell over its strongest period: the cells of one period at a time.
    fn fold(
        &self,
        candidates: &CandidatePeriods,
        num_bins: usize,
        cells: &[&Cell<'_>],
        records: &mut [CellRecord],
    ) {
        let mut of_period: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (at, record) in records.iter_mut().enumerate() {
            match record.terms.first() {
                Some(term) => of_period.entry(term.k.into()).or_default().push(at),
                None => record.bins = vec![record.mean; num_bins],
            }
        }
        for (k, at) in of_period {
            let columns = Columns::Folded(candidates.clone(), k, num_bins);
            let chosen: Vec<&Cell<'_>> = at.iter().map(|&at| cells[at]).collect();
            let (mut sums, all) = self.sums(&columns, &chosen);
            let folded = chosen.par_iter().zip(sums.par_iter_mut());
            let folded: Vec<Vec<f32>> = folded
                .map(|(cell, sums)| {
                    sums.finish(&all);
                    let known = sums.known.as_deref().unwrap_or(&all);
                    means(&sums.occupied, known, cell.stats.mean())
                })
                .collect();
            for (at, bins) in at.into_iter().zip(folded) {
                records[at].bins = bins;
            }
        }
    }

    /// The unfinished sums of these cells, and those over all visits.
    fn sums<'b>(&self, columns: &Columns, cells: &[&Cell<'b>]) -> (Vec<CellSums<'b>>, Vec<i64>) {
        let width = columns.width();
        let mut sums: Vec<CellSums<'_>> = cells
            .iter()
            .map(|cell| CellSums::new(cell.log, width))
            .collect();
        let mut prefixes = Prefixes::new(columns);
        if width > 0 {
            let block = (TABLE_BYTES / (8 * width)).max(1);
            let mut end = 0;
            for times_us in self.times_us.chunks(block) {
                prefixes.advance(columns, times_us);
                end += times_us.len();
                // Cells next to each other in memory go to one thread.
                sums.par_iter_mut()
                    .with_min_len(64)
                    .for_each(|sums| sums.advance(&prefixes, end as u32));
            }
        }
        let all = prefixes.before(self.times_us.len()).to_vec();
        (sums, all)
    }

    /// Says of each cell by how much it was otherwise than foreseen when it was last seen.
    fn compare_with_last(&self, cells: &[&Cell<'_>], records: &mut [CellRecord]) {
        // Most cells of a tile were last seen at the same time.
        let mut moments: BTreeMap<u32, Moment> = BTreeMap::new();
        for (cell, record) in cells.iter().zip(records) {
            let visit = cell.stats.last_visit;
            let moment = moments.entry(visit).or_insert_with(|| {
                Moment::new(self.config, Time::from_us(self.times_us[visit as usize]))
            });
            let state = f32::from(u8::from(record.is_occupied));
            record.surprise = state - record.periodic(moment);
        }
    }

    fn record(
        &self,
        cell: &Cell<'_>,
        sums: &mut CellSums<'_>,
        all: &[i64],
        supported: &[bool],
    ) -> CellRecord {
        let stats = &cell.stats;
        sums.finish(all);
        let last_us = self.times_us.last().copied().unwrap_or_default();
        let seen_us = self.times_us[stats.last_visit as usize];
        let mut record = CellRecord {
            at: cell.at,
            mean: stats.mean() as f32,
            rate: stats.rate as f32,
            age_s: Time::from_us(last_us).since_s(Time::from_us(seen_us)) as f32,
            is_occupied: stats.last_state == CellState::Occupied,
            ..CellRecord::default()
        };
        let known = sums.known.as_deref().unwrap_or(all);
        match self.config.model() {
            CellModel::Fremen { order, .. } => {
                record.terms = terms(stats, &sums.occupied, known, supported, *order);
            }
            CellModel::Histogram { .. } => {
                let bins = sums.occupied.iter().zip(known);
                record.bins = bins
                    .map(|(&occupied, &known)| match known {
                        0 => record.mean,
                        _ => (occupied as f64 / known as f64) as f32,
                    })
                    .collect();
            }
            CellModel::Folded { .. } => {
                record.terms = terms(stats, &sums.occupied, known, supported, 1);
            }
            CellModel::Mean | CellModel::LastObservation => {}
        }
        record
    }

    /// For each candidate whether the times can show it.
    fn supported(&self) -> Vec<bool> {
        let Some(candidates) = self.config.model().candidates() else {
            return Vec::new();
        };
        let ends = self.times_us.first().zip(self.times_us.last());
        let span_s = ends.map_or(0.0, |(&a, &b)| Time::from_us(b).since_s(Time::from_us(a)));
        let mean_gap_s = span_s / (self.times_us.len().max(2) - 1) as f64;
        (0..candidates.len())
            .map(|k| {
                let period_s = candidates.period_s(k);
                !self.config.guards() || (span_s >= 1.5 * period_s && period_s >= 2.0 * mean_gap_s)
            })
            .collect()
    }
}

/// The strongest rhythms of a cell.
fn terms(
    stats: &Stats,
    occupied: &[i64],
    known: &[i64],
    supported: &[bool],
    order: usize,
) -> Vec<Term> {
    let count = supported.len();
    let (mean, num) = (stats.mean(), f64::from(stats.num_known));
    let g = |column: usize| {
        let balance = mean * from_fixed(known[column]);
        (from_fixed(occupied[column]) - balance) / num
    };
    let power = |k: usize| {
        if supported[k] {
            g(k).powi(2) + g(count + k).powi(2)
        } else {
            0.0
        }
    };
    if order == 0 || occupied.is_empty() {
        return Vec::new();
    }
    let mut powers: Vec<f64> = (0..count).map(power).collect();
    let mut selected = vec![0; order.min(count)];
    let num_selected = strongest(&mut powers, &mut selected);
    let term = |&k: &u16| Term {
        k,
        cos: (2.0 * g(k.into())) as f32,
        sin: (2.0 * g(count + usize::from(k))) as f32,
    };
    selected[..num_selected].iter().map(term).collect()
}

/// Sums over the visits at which a cell was occupied, and at which it was seen, on the way through
/// its changes.
struct CellSums<'a> {
    changes: Changes<'a>,
    next: Option<Change>,
    state: CellState,
    occupied: Box<[i64]>,
    /// None where every visit saw the cell.
    known: Option<Box<[i64]>>,
}

impl<'a> CellSums<'a> {
    fn new(log: &'a CellLog, width: usize) -> Self {
        let mut changes = log.changes();
        Self {
            next: changes.next(),
            changes,
            state: log.first(),
            occupied: vec![0; width].into(),
            known: log.hides().then(|| vec![0; width].into()),
        }
    }

    /// Goes on to visit `end`, as far as `prefixes` reach.
    fn advance(&mut self, prefixes: &Prefixes, end: u32) {
        while let Some(change) = self.next
            && change.visit < end
        {
            self.step(change.state, prefixes.before(change.visit as usize));
            self.next = self.changes.next();
        }
    }

    /// Ends the last run: `all` are the sums over all visits.
    fn finish(&mut self, all: &[i64]) {
        self.step(CellState::Unknown, all);
    }

    /// The state is another from the visit on before which there were `before`.
    #[inline]
    fn step(&mut self, state: CellState, before: &[i64]) {
        match (
            self.state == CellState::Occupied,
            state == CellState::Occupied,
        ) {
            (false, true) => subtract(&mut self.occupied, before),
            (true, false) => add(&mut self.occupied, before),
            _ => {}
        }
        if let Some(known) = &mut self.known {
            match (self.state.is_known(), state.is_known()) {
                (false, true) => subtract(known, before),
                (true, false) => add(known, before),
                _ => {}
            }
        }
        self.state = state;
    }
}

#[inline]
fn add(sums: &mut [i64], terms: &[i64]) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}

#[inline]
fn subtract(sums: &mut [i64], terms: &[i64]) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum -= term;
    }
}

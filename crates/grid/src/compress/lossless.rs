//! How is everything that was observed kept in few bytes?
//!
//! Cell after cell, its changes are coded as the times from one to the next. A change mostly comes
//! together with one of a neighbour (things have many cells): whether it does takes a fraction of a
//! bit. Else the length of the run is coded, by models that are chosen by the state, by how far
//! the cell's rhythms contradict it at that time (p(t)), and by how long the last runs were.

use fremen::{CandidatePeriods, Error, ErrorKind, Period, Result, Time};
use sha2::{Digest, Sha256};

use super::coder::{Bit, Coder, Decoder, Encoder, Lengths, code_bytes};
use super::lossy::LossyGrid;
use crate::cells::{CellState, GridSpec, OccupancyMap};
use crate::file::{decode_observations, encode_observations};
use crate::history::{CellLog, Change, History, Observations, Tile, Visits};
use crate::model::GridConfig;
use crate::temporal::TemporalGrid;
use crate::tiles::Tiling;

/// How every such file begins.
const MAGIC: &[u8] = b"CGRZ1\n";
/// Bytes of the checksum behind it.
const NUM_SUM_BYTES: usize = 8;
/// The rhythms by which runs are coded.
const NUM_CANDIDATES: usize = 42;
const ORDER: usize = 3;

/// All observations in few bytes.
///
/// # Errors
/// None in practice: the rhythms by which runs are coded are valid.
pub fn pack(history: &History) -> Result<Vec<u8>> {
    let candidates = CandidatePeriods::harmonic(Period::WEEK, NUM_CANDIDATES)?;
    let config = GridConfig::fremen(candidates, ORDER)?.with_persistence(false);
    let mut grid = TemporalGrid::from_history(history.clone(), config);
    let lossy = LossyGrid::new(&grid.fitted(), Period::WEEK, NUM_CANDIDATES, ORDER)?.to_bytes();
    let mut encoder = Encoder::new();
    code_bytes(&mut encoder, &lossy);
    code_bytes(&mut encoder, &encode_observations(history.observations()));
    // The decoder has the rhythms as they were rounded.
    let rhythms = Rhythms::new(&lossy, history.observations())?;
    let tiles = history.sorted_tiles();
    code_keys(
        &mut encoder,
        &tiles.iter().map(|tile| tile.key()).collect::<Vec<_>>(),
    );
    let mut models = Models::new();
    for tile in tiles {
        models.code_tile(
            &mut encoder,
            history.tiling(),
            tile.key(),
            Some(tile),
            &rhythms,
        );
    }
    let body = encoder.finish();
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(&Sha256::digest(&body)[..NUM_SUM_BYTES]);
    bytes.extend(body);
    Ok(bytes)
}

/// What [`pack`] has packed, bit for bit.
///
/// # Errors
/// [`ErrorKind::Format`] where the bytes are something else, [`ErrorKind::Checksum`] where they
/// are not as they were written.
pub fn unpack(bytes: &[u8]) -> Result<History> {
    let broken = || Error::new(ErrorKind::Format, "these bytes are no packed grid");
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(broken)?;
    let (sum, body) = rest.split_at_checked(NUM_SUM_BYTES).ok_or_else(broken)?;
    if Sha256::digest(body)[..NUM_SUM_BYTES] != *sum {
        return Err(Error::new(
            ErrorKind::Checksum,
            "the packed grid is not as it was written",
        )
        .with_help("restore a copy"));
    }
    let mut decoder = Decoder::new(body);
    let lossy = code_bytes(&mut decoder, &[]);
    let observations = code_bytes(&mut decoder, &[]);
    let observations = decode_observations(&observations).ok_or_else(broken)?;
    let spec = *LossyGrid::from_bytes(&lossy)?.spec();
    let tiling = Tiling::new(spec);
    let rhythms = Rhythms::new(&lossy, &observations)?;
    let keys = code_keys(&mut decoder, &[]);
    let mut models = Models::new();
    let mut tiles: Vec<Tile> = Vec::new();
    for key in keys {
        let ascends = tiles.last().is_none_or(|last| last.key() < key);
        if key >= tiling.num_tiles() || !ascends {
            return Err(broken());
        }
        let tile = models.code_tile(&mut decoder, &tiling, key, None, &rhythms);
        tiles.push(tile.filter(|_| !decoder.is_spent()).ok_or_else(broken)?);
    }
    Ok(History::from_parts(tiling, observations, tiles))
}

/// Bytes of the runs of all cells that vary as variable-length integers, nothing else: what
/// [`pack`] is compared with.
pub fn varint_bytes(history: &History) -> usize {
    let bytes_of = |log: &CellLog| -> usize {
        let mut last = 0;
        let lengths = log.changes().map(|change| {
            let len = change.visit - last;
            last = change.visit;
            (32 - len.leading_zeros()).div_ceil(7).max(1) as usize
        });
        lengths.sum()
    };
    history
        .tiles()
        .iter()
        .flat_map(Tile::logs)
        .map(|(_, log)| bytes_of(log))
        .sum()
}

fn code_keys(coder: &mut impl Coder, keys: &[u32]) -> Vec<u32> {
    let mut lengths = Lengths::new();
    let num = coder.length(keys.len() as u32, &mut lengths);
    let (mut found, mut last) = (Vec::new(), 0_u32);
    for at in 0..num as usize {
        let step = keys.get(at).map_or(0, |key| key - last);
        let step = coder.length(step, &mut lengths);
        if coder.is_spent() || (at > 0 && step == 0) {
            // Only broken bytes say so; what follows cannot be read.
            break;
        }
        last = last.saturating_add(step);
        found.push(last);
    }
    found
}

/// How far p(t) of a cell is from its state, in a few steps for each part of a week.
struct Rhythms {
    spec: GridSpec,
    /// In 84 parts of a week, of each cell.
    levels: Vec<Vec<u8>>,
    times_us: Vec<i64>,
}

/// Two hours.
const NUM_PARTS: usize = 84;
const NUM_LEVELS: usize = 8;

impl Rhythms {
    fn new(lossy: &[u8], observations: &Observations) -> Result<Self> {
        let lossy = LossyGrid::from_bytes(lossy)?;
        let spec = *lossy.spec();
        let mut map = OccupancyMap::new_unknown(spec);
        let mut levels = Vec::with_capacity(NUM_PARTS);
        for part in 0..NUM_PARTS as i64 {
            let middle_us = (2 * part + 1) * Period::WEEK.as_us() / (2 * NUM_PARTS as i64);
            lossy.predict_into(Time::from_us(middle_us), &mut map)?;
            let level = |&p: &f32| ((p * NUM_LEVELS as f32) as u8).min(NUM_LEVELS as u8 - 1);
            levels.push(map.probabilities().iter().map(level).collect());
        }
        Ok(Self {
            spec,
            levels,
            times_us: observations.times_us().to_vec(),
        })
    }

    fn level(&self, index: Option<usize>, observation: u32) -> usize {
        let us = self
            .times_us
            .get(observation as usize)
            .copied()
            .unwrap_or(0);
        let phase = Time::from_us(us).phase(Period::WEEK);
        let part = ((phase * NUM_PARTS as f64) as usize).min(NUM_PARTS - 1);
        index.map_or(0, |index| usize::from(self.levels[part][index]))
    }
}

/// A neighbour whose changes are known.
struct Neighbour<'a> {
    changes: &'a [Change],
    next: usize,
    /// Whether the last few changes came with one of it.
    hits: usize,
}

/// What is learnt on the way.
struct Models {
    plane: [[Bit; 4]; 16],
    logged: [[Bit; 2]; 16],
    bounds: Lengths,
    num_changes: Lengths,
    /// By neighbour, its last hits, the state, and the state to which the neighbour changes.
    hit: Vec<Bit>,
    /// By state and by whether a run follows a hit.
    which: [[Bit; 2]; 3],
    /// By state, level of p(t) and length of the last run of this state.
    run: Vec<Lengths>,
}

const NUM_NEIGHBOURS: usize = 4;
const NUM_HITS: usize = 8;

impl Models {
    fn new() -> Self {
        Self {
            plane: [[Bit::EVEN; 4]; 16],
            logged: [[Bit::EVEN; 2]; 16],
            bounds: Lengths::new(),
            num_changes: Lengths::new(),
            hit: vec![Bit::EVEN; NUM_NEIGHBOURS * NUM_HITS * 9 * 2],
            which: [[Bit::EVEN; 2]; 3],
            run: vec![Lengths::new(); 3 * NUM_LEVELS * 8],
        }
    }

    /// Codes a tile; none where what is read is no tile.
    fn code_tile(
        &mut self,
        coder: &mut impl Coder,
        tiling: &Tiling,
        key: u32,
        tile: Option<&Tile>,
        rhythms: &Rhythms,
    ) -> Option<Tile> {
        let limit = rhythms.times_us.len() as u32;
        let bounds = self.code_bounds(coder, tile.map_or(&[], |tile| tile.visits().bounds()));
        let visits = Visits::from_bounds(bounds, limit).filter(|visits| visits.len() > 0)?;
        let observations: Vec<u32> = visits.observations().collect();
        let first = tile.map(|tile| tile.planes_at(0));
        let num_cells = tiling.num_cells();
        let sides = tiling.sides().map(|n| n as usize);
        let mut states: Vec<(CellState, bool)> = Vec::with_capacity(num_cells);
        let mut logs: Vec<Vec<Change>> = vec![Vec::new(); num_cells];
        for at in 0..num_cells {
            let given = first
                .as_ref()
                .map(|first| first[at / 64].state(at as u32 % 64));
            let log = tile.and_then(|tile| tile.log(at));
            let (state, is_logged) =
                self.code_first(coder, &states, sides[0], given, log.is_some());
            states.push((state, is_logged));
            let cell = tiling.cell(key, at);
            let index = rhythms
                .spec
                .contains(cell)
                .then(|| rhythms.spec.index(cell));
            if index.is_none() && (state.is_known() || is_logged) {
                return None;
            }
            if is_logged {
                let neighbours: Vec<Neighbour<'_>> = [1, sides[0], sides[0] * sides[1], 2]
                    .into_iter()
                    .filter_map(|step| at.checked_sub(step))
                    .map(|at| Neighbour {
                        changes: &logs[at],
                        next: 0,
                        hits: 0,
                    })
                    .collect();
                let changes = self.code_log(
                    coder,
                    state,
                    log,
                    neighbours,
                    &observations,
                    |observation| rhythms.level(index, observation),
                )?;
                logs[at] = changes;
            }
        }
        Some(Tile::build(key, num_cells, visits, |at| {
            (states[at].0, logs[at].iter().copied())
        }))
    }

    fn code_bounds(&mut self, coder: &mut impl Coder, bounds: &[u32]) -> Vec<u32> {
        let num = coder.length(bounds.len() as u32, &mut self.num_changes);
        let (mut found, mut last) = (Vec::new(), 0_u32);
        for at in 0..num as usize {
            let step = bounds.get(at).map_or(0, |bound| bound - last);
            let step = coder.length(step, &mut self.bounds);
            if at > 0 && step == 0 {
                // No range is empty; the caller refuses what is odd.
                found.push(last);
                break;
            }
            last = last.saturating_add(step);
            found.push(last);
        }
        found
    }

    /// The first state of a cell and whether it has a log, by those of its neighbours.
    fn code_first(
        &mut self,
        coder: &mut impl Coder,
        before: &[(CellState, bool)],
        row: usize,
        state: Option<CellState>,
        is_logged: bool,
    ) -> (CellState, bool) {
        let at = before.len();
        let neighbour = |step: usize| at.checked_sub(step).map(|at| before[at]);
        let context = |it: Option<(CellState, bool)>| it.map_or(3, |it| it.0 as usize);
        let context = 4 * context(neighbour(1)) + context(neighbour(row));
        let code = state.map_or(0, |it| it as u32);
        let state = match coder.number(code, 2, &mut self.plane[context]) {
            0 => CellState::Free,
            1 => CellState::Occupied,
            _ => CellState::Unknown,
        };
        let logged = |it: Option<(CellState, bool)>| usize::from(it.is_some_and(|it| it.1));
        let context = 2 * logged(neighbour(1)) + logged(neighbour(row)) + 4 * state as usize;
        (state, coder.code(is_logged, &mut self.logged[context][1]))
    }

    /// The changes of a cell; none where what is read is no log.
    fn code_log(
        &mut self,
        coder: &mut impl Coder,
        first: CellState,
        log: Option<&CellLog>,
        mut neighbours: Vec<Neighbour<'_>>,
        observations: &[u32],
        level: impl Fn(u32) -> usize,
    ) -> Option<Vec<Change>> {
        let mut given = log.map(CellLog::changes);
        let num = log.map_or(0, |log| log.changes().count());
        let num = coder.length(num as u32, &mut self.num_changes) as usize;
        if num == 0 || num >= observations.len() {
            return None;
        }
        let mut changes = Vec::new();
        let (mut visit, mut state) = (0_u32, first);
        // How long the last run of each state was, as a power of two.
        let mut lasted = [0_usize; 3];
        for _ in 0..num {
            let next = given.as_mut().and_then(Iterator::next);
            let to = self.code_visit(
                coder,
                &mut neighbours,
                (visit, state),
                next,
                |models, coder| {
                    let level = level(observations[visit as usize]);
                    let context =
                        (state as usize * NUM_LEVELS + level) * 8 + lasted[state as usize];
                    let len = next.map_or(0, |it| it.visit - visit);
                    coder.length(len, &mut models.run[context])
                },
            );
            if to <= visit || to as usize >= observations.len() {
                return None;
            }
            let bits = 32 - (to - visit).leading_zeros() as usize;
            lasted[state as usize] = (bits / 2).min(7);
            let is_second = next.is_some_and(|it| others(state)[1] == it.state);
            let is_second = coder.code(is_second, &mut self.which[state as usize][1]);
            state = others(state)[usize::from(is_second)];
            visit = to;
            changes.push(Change { visit, state });
        }
        Some(changes)
    }

    /// The visit of the next change: that of a neighbour's, or by the length of the run.
    fn code_visit<C: Coder>(
        &mut self,
        coder: &mut C,
        neighbours: &mut [Neighbour<'_>],
        (visit, state): (u32, CellState),
        next: Option<Change>,
        run: impl FnOnce(&mut Self, &mut C) -> u32,
    ) -> u32 {
        let mut tried = [u32::MAX; NUM_NEIGHBOURS];
        let mut found = None;
        for (i, it) in neighbours.iter_mut().enumerate() {
            while it
                .changes
                .get(it.next)
                .is_some_and(|change| change.visit <= visit)
            {
                it.next += 1;
            }
            let Some(candidate) = it.changes.get(it.next) else {
                continue;
            };
            tried[i] = candidate.visit;
            if found.is_some() || tried[..i].contains(&candidate.visit) {
                continue;
            }
            let agree = usize::from(candidate.state != state);
            let context =
                ((i * NUM_HITS + it.hits) * 9 + state as usize * 3 + candidate.state as usize) * 2
                    + agree;
            let is_hit = next.is_some_and(|next| next.visit == candidate.visit);
            if coder.code(is_hit, &mut self.hit[context]) {
                found = Some(candidate.visit);
            }
        }
        let to = found.unwrap_or_else(|| visit.saturating_add(run(self, coder)));
        for (it, tried) in neighbours.iter_mut().zip(tried) {
            if tried != u32::MAX {
                it.hits = (it.hits << 1 | usize::from(tried == to)) % NUM_HITS;
            }
        }
        to
    }
}

/// The other two states.
const fn others(state: CellState) -> [CellState; 2] {
    match state {
        CellState::Free => [CellState::Occupied, CellState::Unknown],
        CellState::Occupied => [CellState::Free, CellState::Unknown],
        CellState::Unknown => [CellState::Free, CellState::Occupied],
    }
}

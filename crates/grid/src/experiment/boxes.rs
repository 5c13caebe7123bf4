//! Which boxes does a grid foresee? (The thesis' chapter on predicting occupancy.)

use fremen::{CandidatePeriods, Period, Result, Time};
use rayon::prelude::*;

use crate::cells::{CellState, GridSpec, OccupancyMap, Patch, Thresholds};
use crate::experiment::gallery::Gallery;
use crate::experiment::world::sure;
use crate::model::{CellModel, GridConfig};
use crate::picture::{occupancy_png, rhythms_png_between};
use crate::pose::{Pose2, wrap};
use crate::random::Random;
use crate::scan::{InverseSensorModel, ScanMapper};
use crate::simulation::{BoxPeriods, Boxes, Laser};
use crate::temporal::TemporalGrid;

/// What is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxesConfig {
    /// One world for each seed.
    pub seeds: Vec<u64>,
    /// How the boxes move.
    pub periods: BoxPeriods,
    /// Whether ranges (1 cm) and poses (2 cm, 5 mrad) are noisy.
    pub is_noisy: bool,
    /// How long the robot drives.
    pub duration_s: i64,
    /// From here on predictions are counted.
    pub warm_up_s: i64,
    /// Side of a cell.
    pub resolution_m: f64,
    /// Every so many local maps one is predicted; all are learnt. 11 meets the boxes at ever other
    /// phases of their periods.
    pub every: i64,
}

impl Default for BoxesConfig {
    fn default() -> Self {
        Self {
            seeds: (0..5).collect(),
            periods: BoxPeriods::Candidates,
            is_noisy: false,
            duration_s: 2 * 3_600,
            warm_up_s: 3_600,
            resolution_m: 0.1,
            every: 11,
        }
    }
}

/// How maps are predicted.
pub const PREDICTED_BY: [&str; 7] = [
    "FreMEn",
    "FreMEn + persistence",
    "phase histogram",
    "phase histogram + 0.3 persistence",
    "last",
    "averaged",
    "the true boxes",
];

/// From which probability on a cell is predicted as occupied: the most likely state, and what is
/// better where an obstacle that was not foreseen is worse than one that is not there.
pub const OCCUPIED_FROM: [f32; 2] = [0.5, 0.35];

/// Counts of all models, at both thresholds.
type Counts = [[BoxCounts; 2]; PREDICTED_BY.len()];

/// Counts of predicted cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoxCounts {
    /// Measured obstacles, and those of them that were predicted.
    pub num_obstacles: u64,
    /// See [`num_obstacles`](Self::num_obstacles).
    pub num_foreseen: u64,
    /// Measured cells that have been both free and occupied before, and those whose state was
    /// predicted.
    pub num_changing: u64,
    /// See [`num_changing`](Self::num_changing).
    pub num_right: u64,
    /// Of the changing cells, those measured as occupied, and those of them that were predicted.
    pub num_boxes: u64,
    /// See [`num_boxes`](Self::num_boxes).
    pub num_boxes_foreseen: u64,
}

impl BoxCounts {
    /// The share of measured obstacles that were predicted: the thesis' score.
    pub fn recall(&self) -> f64 {
        self.num_foreseen as f64 / self.num_obstacles.max(1) as f64
    }

    /// The share of right predictions of cells that change. Who predicts everything as occupied has
    /// a perfect recall, but not this.
    pub fn accuracy(&self) -> f64 {
        self.num_right as f64 / self.num_changing.max(1) as f64
    }

    /// The recall where something changes: without the walls that everybody foresees.
    pub fn recall_of_boxes(&self) -> f64 {
        self.num_boxes_foreseen as f64 / self.num_boxes.max(1) as f64
    }

    fn add(&mut self, other: &Self) {
        self.num_obstacles += other.num_obstacles;
        self.num_foreseen += other.num_foreseen;
        self.num_changing += other.num_changing;
        self.num_right += other.num_right;
        self.num_boxes += other.num_boxes;
        self.num_boxes_foreseen += other.num_boxes_foreseen;
    }
}

/// All worlds.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxesReport {
    /// For each of [`PREDICTED_BY`], at each of [`OCCUPIED_FROM`].
    pub counts: [[BoxCounts; 2]; PREDICTED_BY.len()],
    /// The same of each world.
    pub worlds: Vec<[[BoxCounts; 2]; PREDICTED_BY.len()]>,
    /// The same of all worlds in each ten minutes from the end of the warm-up on.
    pub over_time: Vec<[[BoxCounts; 2]; PREDICTED_BY.len()]>,
}

impl BoxesReport {
    /// The table.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let mut text = String::from(
            "occupied from | model                             | recall % | recall of what changes % | \
             accuracy of what changes %\n",
        );
        for (at, threshold) in OCCUPIED_FROM.iter().enumerate() {
            for (name, counts) in PREDICTED_BY.iter().zip(&self.counts) {
                let _ = writeln!(
                    text,
                    "{threshold:13} | {name:33} | {:8.1} | {:24.1} | {:.1}",
                    100.0 * counts[at].recall(),
                    100.0 * counts[at].recall_of_boxes(),
                    100.0 * counts[at].accuracy(),
                );
            }
        }
        text
    }
}

fn add(sum: &mut Counts, counts: &Counts) {
    for (sum, counts) in sum.iter_mut().zip(counts) {
        for (sum, counts) in sum.iter_mut().zip(counts) {
            sum.add(counts);
        }
    }
}

/// A local map is made of the scans of so many seconds, then cleared.
const LOCAL_S: i64 = 5;
/// Its robot drives so fast.
const SPEED_M_S: f64 = 0.5;

/// The candidates of the thesis: 1,200 s / (k + 1) for k = 0..19.
fn candidates() -> Result<CandidatePeriods> {
    CandidatePeriods::harmonic(Period::from_s(1_200.0)?, 20)
}

/// Drives through worlds of boxes and predicts every local map before it is observed.
///
/// # Errors
/// As the grid.
pub fn boxes(config: &BoxesConfig) -> Result<BoxesReport> {
    let slots: Vec<Vec<Counts>> = (config.seeds.par_iter())
        .map(|&seed| in_world(seed, config))
        .collect::<Result<_>>()?;
    let mut report = BoxesReport {
        counts: Counts::default(),
        worlds: vec![Counts::default(); slots.len()],
        over_time: vec![Counts::default(); slots.iter().map(Vec::len).max().unwrap_or(0)],
    };
    for (world, slots) in report.worlds.iter_mut().zip(&slots) {
        for (sum, counts) in report.over_time.iter_mut().zip(slots) {
            add(world, counts);
            add(sum, counts);
            add(&mut report.counts, counts);
        }
    }
    Ok(report)
}

/// The models in the order of [`PREDICTED_BY`]; neighbours share what is fitted.
fn models() -> Result<[GridConfig; PREDICTED_BY.len() - 1]> {
    let fremen = GridConfig::fremen(candidates()?, 2)?;
    let folded = GridConfig::new(CellModel::Folded {
        candidates: candidates()?,
        num_bins: 48,
    })?;
    Ok([
        fremen.clone().with_persistence(false),
        fremen,
        folded.clone().with_persistence(false),
        folded.with_persistence_share(0.3)?,
        GridConfig::new(CellModel::LastObservation)?,
        GridConfig::new(CellModel::Mean)?.with_persistence(false),
    ])
}

/// Seconds of the drive that are counted together.
const SLOT_S: i64 = 600;

/// A robot on its way through a world: its local maps, one after another.
struct Tour<'a> {
    world: &'a Boxes,
    way: Vec<Pose2>,
    mapper: ScanMapper,
    random: Random,
    is_noisy: bool,
}

impl<'a> Tour<'a> {
    fn new(world: &'a Boxes, spec: GridSpec, seed: u64, is_noisy: bool) -> Self {
        Self {
            world,
            way: world.way(SPEED_M_S),
            mapper: ScanMapper::new(spec, InverseSensorModel::ideal()),
            random: Random::stream(seed, &[0x0042_4f58]),
            is_noisy,
        }
    }

    /// The local map of number `local`, and its time.
    fn local(&mut self, local: i64) -> Result<(Patch, Time)> {
        self.mapper.clear();
        for second in local * LOCAL_S..(local + 1) * LOCAL_S {
            scan(
                self.world,
                &self.way,
                second,
                self.is_noisy,
                &mut self.random,
                &mut self.mapper,
            )?;
        }
        let patch = Patch::from_map(&self.mapper.to_map(), sure());
        Ok((patch, Time::from_s((local + 1) * LOCAL_S)))
    }
}

fn in_world(seed: u64, config: &BoxesConfig) -> Result<Vec<Counts>> {
    let world = Boxes::new(seed, config.periods);
    let spec = world.spec(config.resolution_m)?;
    let models = models()?;
    let mut grid = TemporalGrid::new(spec, models[0].clone());
    let mut slots: Vec<Counts> = Vec::new();
    let mut predicted = OccupancyMap::new_unknown(spec);
    let mut was: Vec<[bool; 2]> = vec![[false; 2]; spec.num_cells()];
    let mut tour = Tour::new(&world, spec, seed, config.is_noisy);
    for local in 0..config.duration_s / LOCAL_S {
        let (patch, time) = tour.local(local)?;
        let since_s = (local + 1) * LOCAL_S - config.warm_up_s;
        if since_s > 0 && local % config.every.max(1) == 0 {
            let slot = ((since_s - 1) / SLOT_S) as usize;
            if slots.len() <= slot {
                slots.resize(slot + 1, Counts::default());
            }
            for (model, counts) in models.iter().zip(&mut slots[slot]) {
                grid.set_config(model.clone());
                grid.predict_into(time, &mut predicted)?;
                count(&predicted, &patch, &was, counts)?;
            }
            // In the middle of the scans of the local map.
            let middle = time.plus_us(-LOCAL_S * 500_000);
            let mut truth = world.true_map(middle, spec);
            // What no free way leads to is the inside of a box.
            let inside = truth.probabilities_mut().iter_mut().filter(|p| p.is_nan());
            inside.for_each(|p| *p = 1.0);
            count(&truth, &patch, &was, &mut slots[slot][models.len()])?;
        }
        grid.observe(&patch, time)?;
        for (state, was) in patch.states().iter().zip(&mut was) {
            was[0] |= *state == CellState::Free;
            was[1] |= *state == CellState::Occupied;
        }
    }
    Ok(slots)
}

fn count(
    predicted: &OccupancyMap,
    patch: &Patch,
    was: &[[bool; 2]],
    counts: &mut [BoxCounts; 2],
) -> Result<()> {
    for (threshold, counts) in OCCUPIED_FROM.into_iter().zip(counts) {
        let thresholds = Thresholds::new(threshold, threshold)?;
        counts.add(&score(predicted, patch, was, thresholds));
    }
    Ok(())
}

/// Pictures of one world: what is predicted for four moments after the drive and what is true then,
/// and the cells' strongest rhythms.
///
/// # Errors
/// As the grid.
pub fn boxes_gallery(seed: u64, config: &BoxesConfig) -> Result<Gallery> {
    let world = Boxes::new(seed, config.periods);
    let spec = world.spec(config.resolution_m)?;
    let [_, _, _, model, ..] = models()?;
    let mut grid = TemporalGrid::new(spec, model);
    let mut tour = Tour::new(&world, spec, seed, config.is_noisy);
    for local in 0..config.duration_s / LOCAL_S {
        let (patch, time) = tour.local(local)?;
        grid.observe(&patch, time)?;
    }
    let fitted = grid.fitted();
    let mut map = OccupancyMap::new_unknown(spec);
    let mut hours = Vec::new();
    for after_s in [60, 250, 430, 610] {
        let time = Time::from_s(config.duration_s + after_s);
        fitted.predict_into(time, &mut map)?;
        hours.push([
            (
                format!("{after_s} s later, predicted"),
                occupancy_png(&map)?,
            ),
            (
                format!("{after_s} s later, true"),
                occupancy_png(&world.true_map(time, spec))?,
            ),
        ]);
    }
    let end = Time::from_s(config.duration_s);
    let rhythms = rhythms_png_between(&fitted, &spec, end, [60.0, 1_200.0])?;
    Ok(Gallery {
        hours,
        rhythms: ("strongest rhythm of each cell".to_owned(), rhythms),
    })
}

/// The scan of one second.
fn scan(
    world: &Boxes,
    way: &[Pose2],
    second: i64,
    is_noisy: bool,
    random: &mut Random,
    mapper: &mut ScanMapper,
) -> Result<()> {
    let laser = Laser {
        num_beams: 361,
        deviation_m: if is_noisy { 0.01 } else { 0.0 },
        dropout: 0.0,
        ..Laser::default()
    };
    let pose = way[second as usize % way.len()];
    let scan = laser.scan(&world.scene(Time::from_s(second)), &pose, random)?;
    let believed = if is_noisy {
        Pose2::new(
            pose.x_m + random.normal(0.02),
            pose.y_m + random.normal(0.02),
            wrap(pose.heading_rad + random.normal(0.005)),
        )
    } else {
        pose
    };
    mapper.add(&believed, &scan)
}

fn score(
    predicted: &OccupancyMap,
    patch: &Patch,
    was: &[[bool; 2]],
    thresholds: Thresholds,
) -> BoxCounts {
    let mut counts = BoxCounts::default();
    for (index, state) in patch.states().iter().enumerate() {
        if !state.is_known() {
            continue;
        }
        let expected = predicted.state(index, thresholds);
        let is_obstacle = *state == CellState::Occupied;
        let is_foreseen = is_obstacle && expected == CellState::Occupied;
        counts.num_obstacles += u64::from(is_obstacle);
        counts.num_foreseen += u64::from(is_foreseen);
        if was[index] == [true; 2] {
            counts.num_changing += 1;
            counts.num_right += u64::from(expected == *state);
            counts.num_boxes += u64::from(is_obstacle);
            counts.num_boxes_foreseen += u64::from(is_foreseen);
        }
    }
    counts
}

//! Which boxes does a grid foresee? (The thesis' chapter on predicting occupancy.)

use fremen::{CandidatePeriods, Period, Result, Time};
use rayon::prelude::*;

use crate::cells::{CellState, OccupancyMap, Patch, Thresholds};
use crate::experiment::world::sure;
use crate::model::{CellModel, GridConfig, Persistence};
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
        }
    }
}

/// How maps are predicted.
pub const PREDICTED_BY: [&str; 5] = [
    "FreMEn",
    "FreMEn + persistence",
    "FreMEn + surprise",
    "last",
    "averaged",
];

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
    /// For each of [`PREDICTED_BY`].
    pub counts: [BoxCounts; 5],
    /// The same of each world.
    pub worlds: Vec<[BoxCounts; 5]>,
}

impl BoxesReport {
    /// The table.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let mut text = String::from(
            "model                | recall % | recall of what changes % | accuracy of what changes %\n",
        );
        for (name, counts) in PREDICTED_BY.iter().zip(&self.counts) {
            let _ = writeln!(
                text,
                "{name:20} | {:8.1} | {:24.1} | {:.1}",
                100.0 * counts.recall(),
                100.0 * counts.recall_of_boxes(),
                100.0 * counts.accuracy(),
            );
        }
        text
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
    let worlds: Vec<[BoxCounts; 5]> = (config.seeds.par_iter())
        .map(|&seed| in_world(seed, config))
        .collect::<Result<_>>()?;
    let mut counts = [BoxCounts::default(); 5];
    for world in &worlds {
        for (sum, counts) in counts.iter_mut().zip(world) {
            sum.add(counts);
        }
    }
    Ok(BoxesReport { counts, worlds })
}

fn in_world(seed: u64, config: &BoxesConfig) -> Result<[BoxCounts; 5]> {
    let world = Boxes::new(seed, config.periods);
    let spec = world.spec(config.resolution_m)?;
    let fremen = GridConfig::fremen(candidates()?, 2)?;
    let mut grids = [
        TemporalGrid::new(spec, fremen.clone().with_persistence(false)),
        TemporalGrid::new(spec, fremen.clone()),
        TemporalGrid::new(spec, fremen.with_persistence_of(Persistence::Surprise)),
        TemporalGrid::new(spec, GridConfig::new(CellModel::LastObservation)?),
        TemporalGrid::new(
            spec,
            GridConfig::new(CellModel::Mean)?.with_persistence(false),
        ),
    ];
    let mut counts = [BoxCounts::default(); 5];
    let mut random = Random::stream(seed, &[0x0042_4f58]);
    let mut mapper = ScanMapper::new(spec, InverseSensorModel::ideal());
    let mut predicted = OccupancyMap::new_unknown(spec);
    let mut was: Vec<[bool; 2]> = vec![[false; 2]; spec.num_cells()];
    let way = world.way(SPEED_M_S);
    for local in 0..config.duration_s / LOCAL_S {
        mapper.clear();
        for second in local * LOCAL_S..(local + 1) * LOCAL_S {
            scan(
                &world,
                &way,
                second,
                config.is_noisy,
                &mut random,
                &mut mapper,
            )?;
        }
        let time = Time::from_s((local + 1) * LOCAL_S);
        let patch = Patch::from_map(&mapper.to_map(), sure());
        for (grid, counts) in grids.iter_mut().zip(&mut counts) {
            if (local + 1) * LOCAL_S > config.warm_up_s {
                grid.predict_into(time, &mut predicted)?;
                counts.add(&score(&predicted, &patch, &was));
            }
            grid.observe(&patch, time)?;
        }
        for (state, was) in patch.states().iter().zip(&mut was) {
            was[0] |= *state == CellState::Free;
            was[1] |= *state == CellState::Occupied;
        }
    }
    Ok(counts)
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

fn score(predicted: &OccupancyMap, patch: &Patch, was: &[[bool; 2]]) -> BoxCounts {
    let mut counts = BoxCounts::default();
    for (index, state) in patch.states().iter().enumerate() {
        if !state.is_known() {
            continue;
        }
        let expected = predicted.state(index, Thresholds::default());
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

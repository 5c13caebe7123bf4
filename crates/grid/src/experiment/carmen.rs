//! Do recorded scans make a map in which the robot finds itself?

use fremen::{Error, ErrorKind, Result};

use crate::cells::{OccupancyMap, Thresholds};
use crate::localize::{
    DistanceField, FilterConfig, FreeSpace, LikelihoodField, LikelihoodFieldConfig, MonteCarlo,
    MotionModel,
};
use crate::random::Random;
use crate::scan::{Beam, CarmenLog, CarmenScan, InverseSensorModel, ScanMapper, grid_around};

/// What is done with a log.
#[derive(Clone, Debug, PartialEq)]
pub struct CarmenConfig {
    /// Side of a cell.
    pub resolution_m: f64,
    /// Beams that go further are left out of the map.
    pub map_range_m: f64,
    /// To what the scans are trimmed before they are localised.
    pub ranges_m: Vec<f64>,
    /// Noise that is added to the motion between corrected poses: the logs have no raw odometry.
    pub odometry: MotionModel,
    /// How the robot localises.
    pub filter: FilterConfig,
    /// Seed of that noise and of the filter.
    pub seed: u64,
}

impl Default for CarmenConfig {
    fn default() -> Self {
        Self {
            resolution_m: 0.05,
            map_range_m: 20.0,
            ranges_m: vec![2.0, 5.0, 10.0, 20.0],
            odometry: MotionModel::default(),
            filter: FilterConfig::default(),
            seed: 1,
        }
    }
}

/// How a log did.
#[derive(Clone, Debug, PartialEq)]
pub struct CarmenReport {
    /// Scans of which the map is made.
    pub num_mapped: usize,
    /// Held-out scans, which are localised.
    pub num_localized: usize,
    /// Share of the held-out scans' ends whose cell or one of its eight neighbours is a wall.
    pub within_one_cell: f64,
    /// One row a range.
    pub ranges: Vec<RangeResult>,
}

/// How localisation did at one range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeResult {
    /// To what scans were trimmed.
    pub range_m: f64,
    /// Median distance from the corrected pose.
    pub median_m: f64,
    /// 95 % of scans are nearer than this.
    pub p95_m: f64,
    /// Share of scans within 0.1 m.
    pub within_10_cm: f64,
    /// Share of the second half of the log in which a filter that may be anywhere at first is within
    /// 0.5 m.
    pub global: f64,
}

impl CarmenReport {
    /// The table.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let mut text = format!(
            "{} scans mapped, {} localised, {:.1} % of ends within one cell of a wall\n\
             range m | median m | 95 % m | within 0.1 m % | found from anywhere %\n",
            self.num_mapped,
            self.num_localized,
            100.0 * self.within_one_cell,
        );
        for row in &self.ranges {
            let _ = writeln!(
                text,
                "{:7} | {:8.3} | {:6.3} | {:14.1} | {:.1}",
                row.range_m,
                row.median_m,
                row.p95_m,
                100.0 * row.within_10_cm,
                100.0 * row.global,
            );
        }
        text
    }
}

/// One scan of so many is held out of the map and localised in it.
const HELD_OUT: usize = 5;

/// Whether a scan is held out.
const fn is_held_out(number: usize) -> bool {
    number % HELD_OUT == HELD_OUT - 1
}

/// The map of the scans of a log that are not held out.
///
/// # Errors
/// As [`grid_around`] and [`ScanMapper::add`].
pub(super) fn map_of(log: &CarmenLog, config: &CarmenConfig) -> Result<OccupancyMap> {
    let mapped: Vec<CarmenScan> = (log.scans.iter().enumerate())
        .filter(|(number, _)| !is_held_out(*number))
        .map(|(_, scan)| {
            let mut near = scan.clone();
            near.scan = near.scan.trimmed(config.map_range_m)?;
            Ok(near)
        })
        .collect::<Result<_>>()?;
    let pairs = mapped.iter().map(|scan| (&scan.pose, &scan.scan));
    let spec = grid_around(pairs, config.resolution_m, 1.0)?;
    let mut mapper = ScanMapper::new(spec, InverseSensorModel::reduced());
    for scan in &mapped {
        mapper.add(&scan.pose, &scan.scan)?;
    }
    Ok(mapper.to_map())
}

/// Makes a map of four fifths of the scans, and localises the others in it at several ranges. The
/// filter sees all scans, as a robot would; only those that are not in the map are judged.
///
/// # Errors
/// [`ErrorKind::Config`] where the log has fewer than ten scans.
pub fn carmen(log: &CarmenLog, config: &CarmenConfig) -> Result<CarmenReport> {
    if log.scans.len() < 2 * HELD_OUT {
        let message = format!("a log with {} scans is too short", log.scans.len());
        return Err(Error::new(ErrorKind::Config, message));
    }
    let map = map_of(log, config)?;
    let held_out: Vec<&CarmenScan> = (log.scans.iter().enumerate())
        .filter_map(|(number, scan)| is_held_out(number).then_some(scan))
        .collect();
    let sensor = LikelihoodField::new(&map, LikelihoodFieldConfig::default())?;
    let space = FreeSpace::of(&map, Thresholds::default())?;
    let mut ranges = Vec::new();
    for &range_m in &config.ranges_m {
        ranges.push(at_range(range_m, &log.scans, &sensor, &space, config)?);
    }
    Ok(CarmenReport {
        num_mapped: log.scans.len() - held_out.len(),
        num_localized: held_out.len(),
        within_one_cell: within_one_cell(&map, &held_out, config.map_range_m),
        ranges,
    })
}

fn within_one_cell(map: &OccupancyMap, scans: &[&CarmenScan], map_range_m: f64) -> f64 {
    let spec = *map.spec();
    let thresholds = Thresholds::default();
    // The centre of a diagonal neighbour is 1.41 cells away.
    let reach_m = 1.5 * spec.resolution_m();
    let field = DistanceField::new(map, thresholds, 2.0 * reach_m);
    let (mut num_near, mut num_all) = (0_u64, 0_u64);
    for scan in scans {
        for (angle, beam) in scan.scan.beams() {
            let Beam::Hit(range) = beam else { continue };
            if range >= map_range_m {
                continue;
            }
            let (sin, cos) = angle.sin_cos();
            let [x, y] = scan.pose.place([range * cos, range * sin]);
            let cell = spec.cell_at([x, y, 0.0]);
            num_all += 1;
            let near = cell.is_some_and(|cell| field.of_cell(spec.index(cell)) < reach_m);
            num_near += u64::from(near);
        }
    }
    num_near as f64 / num_all.max(1) as f64
}

fn at_range(
    range_m: f64,
    scans: &[CarmenScan],
    sensor: &LikelihoodField,
    space: &FreeSpace,
    config: &CarmenConfig,
) -> Result<RangeResult> {
    let mut tracked = MonteCarlo::around(&scans[0].pose, 0.2, 0.1, config.filter, config.seed)?;
    let mut lost = MonteCarlo::anywhere(space, config.filter, config.seed)?;
    let mut random = Random::stream(config.seed, &[scans.len() as u64]);
    let mut before = scans[0].pose;
    let (mut errors, mut num_found, mut num_late) = (Vec::new(), 0_usize, 0_usize);
    for (number, scan) in scans.iter().enumerate() {
        let motion = config.odometry.sample(&before.to(&scan.pose), &mut random);
        before = scan.pose;
        let seen = scan.scan.trimmed(range_m)?;
        let error = |filter: &mut MonteCarlo| -> Result<f64> {
            let estimate = filter.step(&motion, &seen, sensor, space)?;
            Ok(estimate.pose.distance_m(&scan.pose))
        };
        let (here, found) = (error(&mut tracked)?, error(&mut lost)?);
        if is_held_out(number) {
            errors.push(here);
            let is_late = number >= scans.len() / 2;
            num_late += usize::from(is_late);
            num_found += usize::from(is_late && found < 0.5);
        }
    }
    let near = errors.iter().filter(|error| **error < 0.1).count();
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors[((errors.len() - 1) as f64 * share).round() as usize];
    Ok(RangeResult {
        range_m,
        median_m: at(0.5),
        p95_m: at(0.95),
        within_10_cm: near as f64 / errors.len() as f64,
        global: num_found as f64 / num_late.max(1) as f64,
    })
}

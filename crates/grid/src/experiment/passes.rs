//! In which map does a robot know best where it is? (IROS 2016, section V-A, figure 6)

use fremen::Result;
use rayon::prelude::*;

use crate::cells::{OccupancyMap, Thresholds};
use crate::experiment::statistics::{mean_interval, quantile};
use crate::experiment::world::{moment, patch_of, patrol_map};
use crate::localize::{
    FilterConfig, FreeSpace, LikelihoodField, LikelihoodFieldConfig, MonteCarlo,
};
use crate::model::{CellModel, GridConfig};
use crate::random::Random;
use crate::simulation::{Drive, DriveConfig, Layout, Office, drive_along, is_weekend};
use crate::temporal::TemporalGrid;

/// What is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct PassesConfig {
    /// One office for each seed.
    pub seeds: Vec<u64>,
    /// Which office.
    pub layout: Layout,
    /// Days of patrols before the first pass.
    pub num_days: i64,
    /// Hours between patrols, before and between the passes.
    pub every_h: f64,
    /// Passes through the corridor in each office, in the working hours of the days after.
    pub num_passes: usize,
    /// To what the scans are trimmed.
    pub ranges_m: Vec<f64>,
    /// Side of a cell.
    pub resolution_m: f64,
    /// How the robot localises.
    pub filter: FilterConfig,
    /// How the map is predicted.
    pub predicted: GridConfig,
}

impl Default for PassesConfig {
    fn default() -> Self {
        Self {
            seeds: (0..10).collect(),
            layout: Layout::Paper,
            num_days: 14,
            every_h: 2.0,
            num_passes: 20,
            ranges_m: vec![2.0, 4.0, 6.0, 10.0, 20.0],
            resolution_m: 0.05,
            filter: FilterConfig {
                min_particles: 500,
                max_particles: 5_000,
                ..FilterConfig::default()
            },
            predicted: GridConfig::default(),
        }
    }
}

/// The maps that are compared.
pub const MAPS: [&str; 5] = ["night", "averaged", "last", "predicted", "oracle"];
/// The position of the predicted map, and of the averaged one, in [`MAPS`].
const PREDICTED: usize = 3;
const AVERAGED: usize = 1;

/// One pass in one map at one range: the mean distance of the estimated from the true position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassResult {
    /// Of the office.
    pub seed: u64,
    /// Position in the configured ranges.
    pub range: usize,
    /// Position in [`MAPS`].
    pub map: usize,
    /// The mean error of the pass.
    pub error_m: f64,
}

/// All passes.
#[derive(Clone, Debug, PartialEq)]
pub struct PassesReport {
    /// The configured ranges.
    pub ranges_m: Vec<f64>,
    /// Every pass in every map at every range.
    pub passes: Vec<PassResult>,
}

impl PassesReport {
    /// Errors of a map at a range, one group an office.
    fn groups(&self, range: usize, map: usize) -> Vec<Vec<f64>> {
        let mut groups: Vec<(u64, Vec<f64>)> = Vec::new();
        for pass in (self.passes.iter()).filter(|pass| pass.range == range && pass.map == map) {
            match groups.last_mut() {
                Some((seed, errors)) if *seed == pass.seed => errors.push(pass.error_m),
                _ => groups.push((pass.seed, vec![pass.error_m])),
            }
        }
        groups.into_iter().map(|(_, errors)| errors).collect()
    }

    /// The median error of the passes in a map at a range.
    pub fn median_m(&self, range: usize, map: usize) -> f64 {
        quantile(&self.groups(range, map).concat(), 0.5)
    }

    /// The share of passes with a larger error.
    pub fn share_above(&self, range: usize, map: usize, error_m: f64) -> f64 {
        let errors = self.groups(range, map).concat();
        errors.iter().filter(|error| **error > error_m).count() as f64 / errors.len().max(1) as f64
    }

    /// The mean of "predicted - averaged", pass by pass, with its 95 % interval.
    pub fn against_averaged_m(&self, range: usize) -> [f64; 3] {
        let pairs = (self.groups(range, PREDICTED).into_iter()).zip(self.groups(range, AVERAGED));
        let differences: Vec<Vec<f64>> = pairs
            .map(|(a, b)| a.iter().zip(&b).map(|(a, b)| a - b).collect())
            .collect();
        mean_interval(&differences, 1)
    }

    /// The table.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let num_passes = self.groups(0, 0).concat().len();
        let mut text = format!(
            "median position error, m, of {num_passes} passes in {} offices\nrange m",
            self.groups(0, 0).len()
        );
        for name in MAPS {
            let _ = write!(text, " | {name:>9}");
        }
        text += " | pred./oracle | predicted - averaged (95 %) | predicted above 0.15 m %\n";
        for (range, range_m) in self.ranges_m.iter().enumerate() {
            let _ = write!(text, "{range_m:7}");
            for map in 0..MAPS.len() {
                let _ = write!(text, " | {:9.3}", self.median_m(range, map));
            }
            let ratio = self.median_m(range, PREDICTED) / self.median_m(range, MAPS.len() - 1);
            let [mean, low, high] = self.against_averaged_m(range);
            let _ = writeln!(
                text,
                " | {ratio:12.2} | {mean:+.4} ({low:+.4} .. {high:+.4}) | {:.1}",
                100.0 * self.share_above(range, PREDICTED, 0.15)
            );
        }
        text
    }
}

/// Lets robots learn offices by patrols, and localises passes through their corridors in each map.
///
/// # Errors
/// As the grid and the filter.
pub fn passes(config: &PassesConfig) -> Result<PassesReport> {
    let offices: Vec<Vec<PassResult>> = (config.seeds.par_iter())
        .map(|&seed| in_office(seed, config))
        .collect::<Result<_>>()?;
    Ok(PassesReport {
        ranges_m: config.ranges_m.clone(),
        passes: offices.concat(),
    })
}

fn in_office(seed: u64, config: &PassesConfig) -> Result<Vec<PassResult>> {
    let office = Office::new(seed, config.layout);
    let spec = office.spec(config.resolution_m)?;
    let mut random = Random::stream(seed, &[0x5041_5353]);
    let averaged = GridConfig::new(CellModel::Mean)?.with_persistence(false);
    let mut grid = TemporalGrid::new(spec, averaged.clone());
    // The night in which the static map was made.
    let night = patrol_map(&office, spec, moment(0, 3.0), &mut random)?;
    let mut starts: Vec<f64> = Vec::new();
    let mut day = config.num_days;
    while starts.len() < config.num_passes {
        if !is_weekend(day) {
            // Four a day.
            for _ in 0..4 {
                starts.push(24.0 * day as f64 + random.between(9.0, 17.0));
            }
        }
        day += 1;
    }
    starts.truncate(config.num_passes);
    starts.sort_by(f64::total_cmp);
    let mut results = Vec::new();
    let mut next_h = 1.0;
    let mut maps: Vec<OccupancyMap> = vec![OccupancyMap::new_unknown(spec); MAPS.len()];
    maps[0] = night;
    for start_h in starts {
        while next_h < start_h {
            let map = patrol_map(&office, spec, moment(0, next_h), &mut random)?;
            grid.observe(&patch_of(&map), moment(0, next_h))?;
            next_h += config.every_h;
        }
        let time = moment(0, start_h);
        let last = GridConfig::new(CellModel::LastObservation)?;
        for (at, model) in [
            (AVERAGED, &averaged),
            (2, &last),
            (PREDICTED, &config.predicted),
        ] {
            grid.set_config(model.clone());
            grid.predict_into(time, &mut maps[at])?;
        }
        maps[MAPS.len() - 1] = office.true_map(time, spec);
        let drive_config = DriveConfig::default();
        let path = office.pass(drive_config.step_m, &mut random);
        let scene = |time| office.scene(time);
        let drive = drive_along(&path, time, &scene, &drive_config, &mut random)?;
        for (map, occupancy) in maps.iter().enumerate() {
            let sensor = LikelihoodField::new(occupancy, LikelihoodFieldConfig::default())?;
            let space = FreeSpace::of(occupancy, Thresholds::default())?;
            for (range, &range_m) in config.ranges_m.iter().enumerate() {
                let error_m = pass_error(&drive, range_m, &sensor, &space, config)?;
                results.push(PassResult {
                    seed,
                    range,
                    map,
                    error_m,
                });
            }
        }
    }
    Ok(results)
}

/// The mean error of a pass.
fn pass_error(
    drive: &Drive,
    range_m: f64,
    sensor: &LikelihoodField,
    space: &FreeSpace,
    config: &PassesConfig,
) -> Result<f64> {
    // The same random numbers for every map: differences are the maps'.
    let mut filter = MonteCarlo::around(&drive.truth[0], 0.1, 0.05, config.filter, 1)?;
    let mut sum = 0.0;
    for ((truth, motion), scan) in drive.truth.iter().zip(&drive.motions).zip(&drive.scans) {
        let estimate = filter.step(motion, &scan.trimmed(range_m)?, sensor, space)?;
        sum += estimate.pose.distance_m(truth);
    }
    Ok(sum / drive.truth.len() as f64)
}

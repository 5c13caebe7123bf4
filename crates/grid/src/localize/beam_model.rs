//! How likely is a scan, by where its beams should have ended?

use std::ops::ControlFlow;

use fremen::{Error, ErrorKind, Result};

use crate::cells::{CellState, GridSpec, OccupancyMap, Thresholds};
use crate::localize::sensor::{Reading, Readings, SensorModel};
use crate::pose::Pose2;
use crate::scan::ray::walk;

/// What a [`BeamModel`] expects of the laser and the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamModelConfig {
    /// Standard deviation of a range, with the size of a cell.
    pub deviation_m: f64,
    /// Share of beams that end at the surface of the map.
    pub hit_share: f64,
    /// Share of beams that something stops before that: people, chairs.
    pub short_share: f64,
    /// How often per metre something stops a beam.
    pub short_rate: f64,
    /// Share of beams that find nothing although the map has a surface there.
    pub missed_share: f64,
    /// Which probabilities are surfaces and which are free.
    pub thresholds: Thresholds,
}

impl Default for BeamModelConfig {
    fn default() -> Self {
        Self {
            deviation_m: 0.08,
            hit_share: 0.7,
            short_share: 0.1,
            short_rate: 0.2,
            missed_share: 0.05,
            thresholds: Thresholds::default(),
        }
    }
}

/// The beam model (Probabilistic Robotics, section 6.3): a beam ends at the first surface of the
/// map, or before it, or nowhere, or anywhere. What the map does not know may stop a beam or not.
#[derive(Clone, Debug)]
pub struct BeamModel {
    spec: GridSpec,
    cells: Vec<CellState>,
    config: BeamModelConfig,
}

/// What the map says of a ray.
enum Expected {
    /// The first surface.
    Surface(f64),
    /// Here the map's knowledge ends.
    Unknown(f64),
    /// Free as far as the laser sees.
    Free,
}

impl BeamModel {
    /// The model of a map.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where a share is negative or all together are 1 or more, or where a
    /// deviation or rate is not positive.
    pub fn new(map: &OccupancyMap, config: BeamModelConfig) -> Result<Self> {
        let shares = [config.hit_share, config.short_share, config.missed_share];
        let scales = [config.deviation_m, config.short_rate];
        let is_valid = shares.iter().all(|share| *share >= 0.0)
            && shares.iter().sum::<f64>() < 1.0
            && scales.iter().all(|scale| *scale > 0.0 && scale.is_finite());
        if !is_valid {
            let message = format!("shares and scales of beams cannot be {config:?}");
            return Err(Error::new(ErrorKind::Config, message)
                .with_help("some share must be left for beams that end anywhere"));
        }
        let spec = *map.spec();
        let cells = (0..spec.num_cells()).map(|index| map.state(index, config.thresholds));
        Ok(Self {
            spec,
            cells: cells.collect(),
            config,
        })
    }

    /// How far a ray is expected to go.
    fn expect(&self, from_m: [f64; 2], direction: [f64; 2], max_range_m: f64) -> Expected {
        let to = [0, 1].map(|axis| from_m[axis] + max_range_m * direction[axis]);
        let mut expected = None;
        let mut end_m = 0.0;
        walk(&self.spec, from_m, to, |crossing| {
            end_m = crossing.leave_m;
            let middle_m = f64::midpoint(crossing.enter_m, crossing.leave_m);
            match self.cells[crossing.index] {
                CellState::Free => ControlFlow::Continue(()),
                CellState::Occupied => {
                    expected = Some(Expected::Surface(middle_m));
                    ControlFlow::Break(())
                }
                CellState::Unknown => {
                    expected = Some(Expected::Unknown(middle_m));
                    ControlFlow::Break(())
                }
            }
        });
        // Beyond the grid, nothing is known.
        expected.unwrap_or(if end_m + self.spec.resolution_m() < max_range_m {
            Expected::Unknown(end_m)
        } else {
            Expected::Free
        })
    }

    fn log_likelihood(&self, expected: &Expected, reading: &Reading, max_range_m: f64) -> f64 {
        let config = &self.config;
        let anywhere = 1.0 - config.hit_share - config.short_share - config.missed_share;
        // All as probabilities of ending within one deviation, so that ends and "nothing" compare.
        let width = config.deviation_m;
        let random = anywhere * width / max_range_m;
        let short = |limit: f64| {
            let rate = config.short_rate;
            let norm = 1.0 - (-rate * limit).exp();
            if norm <= 0.0 {
                return 0.0;
            }
            config.short_share * rate * (-rate * reading.range_m).exp() / norm * width
        };
        let p = match (expected, reading.is_hit) {
            (Expected::Surface(at), true) => {
                let z = (reading.range_m - at) / config.deviation_m;
                let hit = config.hit_share * (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
                let before = if reading.range_m < *at {
                    short(*at)
                } else {
                    0.0
                };
                hit + before + random
            }
            (Expected::Surface(_), false) => config.missed_share + random,
            (Expected::Unknown(at), true) if reading.range_m >= *at => {
                // Somewhere behind, or not at all.
                (config.hit_share + config.missed_share) * width / (max_range_m - at).max(width)
                    + random
            }
            (Expected::Unknown(at), true) => short(*at) + random,
            (Expected::Unknown(_), false) => 0.5 * (config.hit_share + config.missed_share),
            (Expected::Free, true) => short(max_range_m) + random,
            (Expected::Free, false) => config.hit_share + config.missed_share,
        };
        p.max(f64::MIN_POSITIVE).ln()
    }
}

impl SensorModel for BeamModel {
    fn mean_log_likelihood(&self, pose: &Pose2, readings: &Readings) -> f64 {
        if readings.is_empty() {
            return 0.0;
        }
        let (sin, cos) = pose.heading_rad.sin_cos();
        let max_range_m = readings.max_range_m();
        let sum: f64 = (readings.iter())
            .map(|reading| {
                let [dx, dy] = reading.direction;
                let direction = [cos * dx - sin * dy, sin * dx + cos * dy];
                let expected = self.expect([pose.x_m, pose.y_m], direction, max_range_m);
                self.log_likelihood(&expected, reading, max_range_m)
            })
            .sum();
        sum / readings.len() as f64
    }
}

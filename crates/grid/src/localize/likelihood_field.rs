//! How likely is a scan, by how far its ends are from surfaces?

use fremen::{Error, ErrorKind, Result};

use crate::cells::{OccupancyMap, Thresholds};
use crate::localize::distance::DistanceField;
use crate::localize::sensor::{Readings, SensorModel};
use crate::pose::Pose2;

/// What a [`LikelihoodField`] expects of the laser and the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LikelihoodFieldConfig {
    /// Standard deviation of the distance between a beam's end and the map's surface: the laser's
    /// noise, the size of a cell and the blur of the map.
    pub deviation_m: f64,
    /// Share of beams that end anywhere: at people, at what the map does not know.
    pub random_share: f64,
    /// Which probabilities are surfaces.
    pub thresholds: Thresholds,
}

impl Default for LikelihoodFieldConfig {
    fn default() -> Self {
        Self {
            deviation_m: 0.08,
            random_share: 0.2,
            thresholds: Thresholds::default(),
        }
    }
}

/// The likelihood field model (S. Thrun, W. Burgard, D. Fox: Probabilistic Robotics, section 6.4):
/// a beam ends near a surface of the map, or anywhere. Rays are not followed, so it is fast and
/// smooth, but does not see that a surface should have stopped a beam. Beams without an end say
/// nothing.
#[derive(Clone, Debug)]
pub struct LikelihoodField {
    field: DistanceField,
    /// Logarithms of likelihoods at equal steps of the distance.
    table: Vec<f64>,
    steps_per_m: f64,
}

/// Steps of the table per deviation, which keep it within a thousandth of the function.
const STEPS: f64 = 100.0;
/// Beyond so many deviations a distance is as good as any larger one.
const REACH: f64 = 4.0;

impl LikelihoodField {
    /// The model of a map.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the deviation is not positive or the share not within (0, 1).
    pub fn new(map: &OccupancyMap, config: LikelihoodFieldConfig) -> Result<Self> {
        let (deviation, share) = (config.deviation_m, config.random_share);
        if !(deviation > 0.0 && deviation.is_finite() && share > 0.0 && share < 1.0) {
            let message = format!(
                "a laser with a deviation of {deviation} m and {share} random beams is none"
            );
            return Err(Error::new(ErrorKind::Config, message));
        }
        let limit_m = REACH * deviation;
        let field = DistanceField::new(map, config.thresholds, limit_m);
        let table = (0..=(REACH * STEPS) as usize + 1).map(|step| {
            let z = step as f64 / STEPS;
            ((1.0 - share) * (-0.5 * z * z).exp() + share).ln()
        });
        Ok(Self {
            field,
            table: table.collect(),
            steps_per_m: STEPS / deviation,
        })
    }

    /// The distances to the map's surfaces, up to four deviations.
    pub const fn field(&self) -> &DistanceField {
        &self.field
    }
}

impl SensorModel for LikelihoodField {
    fn mean_log_likelihood(&self, pose: &Pose2, readings: &Readings) -> f64 {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let (mut sum, mut count) = (0.0, 0_u32);
        for reading in readings.iter().filter(|reading| reading.is_hit) {
            let [dx, dy] = reading.direction.map(|along| along * reading.range_m);
            let end = [
                pose.x_m + cos * dx - sin * dy,
                pose.y_m + sin * dx + cos * dy,
            ];
            let step = (self.field.at(end) * self.steps_per_m) as usize;
            sum += self.table[step.min(self.table.len() - 1)];
            count += 1;
        }
        if count == 0 {
            0.0
        } else {
            sum / f64::from(count)
        }
    }
}

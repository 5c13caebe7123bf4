//! How likely is a scan, by how far its ends are from surfaces?

use fremen::{Error, ErrorKind, Result};

use crate::cells::{GridSpec, OccupancyMap};
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
    /// How many maps stand for the probabilities: one with the surfaces above 0.5, or several whose
    /// surfaces are above equally spaced probabilities.
    pub num_levels: u32,
}

impl Default for LikelihoodFieldConfig {
    fn default() -> Self {
        Self {
            deviation_m: 0.08,
            random_share: 0.2,
            num_levels: 5,
        }
    }
}

/// The likelihood field model (S. Thrun, W. Burgard, D. Fox: Probabilistic Robotics, section 6.4):
/// a beam ends near a surface of the map, or anywhere. Rays are not followed, so it is fast and
/// smooth, but does not see that a surface should have stopped a beam. Beams without an end say
/// nothing.
///
/// Deviation: a map of probabilities is not cut at 0.5 alone. The likelihood is the mean over
/// several cuts, which is its expectation where the surfaces above each probability are there
/// together; a surface that is there with 0.4 then counts with 0.4 and not as absent.
#[derive(Clone, Debug)]
pub struct LikelihoodField {
    spec: GridSpec,
    /// Of each cell's centre.
    likelihoods: Vec<f32>,
    random_share: f32,
}

/// Beyond so many deviations a distance is as good as any larger one.
const REACH: f64 = 4.0;

impl LikelihoodField {
    /// The model of a map.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the deviation is not positive, the share not within (0, 1), or
    /// there are no levels.
    pub fn new(map: &OccupancyMap, config: LikelihoodFieldConfig) -> Result<Self> {
        let (deviation, share) = (config.deviation_m, config.random_share);
        let is_valid = deviation > 0.0
            && deviation.is_finite()
            && share > 0.0
            && share < 1.0
            && (1..=MAX_LEVELS).contains(&config.num_levels);
        if !is_valid {
            let message = format!("a likelihood field cannot be made by {config:?}");
            return Err(Error::new(ErrorKind::Config, message)
                .with_help("a positive deviation, a share within (0, 1), 1 to 100 levels"));
        }
        let spec = *map.spec();
        let levels = f64::from(config.num_levels);
        let mut sums = vec![0.0_f64; spec.num_cells()];
        for level in 0..config.num_levels {
            let cut = (f64::from(level) + 0.5) / levels;
            let is_surface = |index| map.get(index).is_some_and(|p| f64::from(p) > cut);
            let field = DistanceField::to_cells(spec, REACH * deviation, is_surface);
            for (index, sum) in sums.iter_mut().enumerate() {
                let z = field.of_cell(index) / deviation;
                // Nothing is near: no hit.
                if z < REACH {
                    *sum += (-0.5 * z * z).exp();
                }
            }
        }
        let likelihoods = sums
            .iter()
            .map(|sum| ((1.0 - share) * sum / levels + share) as f32);
        Ok(Self {
            spec,
            likelihoods: likelihoods.collect(),
            random_share: share as f32,
        })
    }

    /// The likelihood at a point, interpolated between the centres of the four cells around it.
    fn at(&self, point_m: [f64; 2]) -> f32 {
        let [width, height, _] = self.spec.dims().map(|n| n as usize);
        let origin = self.spec.origin_m();
        let scale = 1.0 / self.spec.resolution_m();
        let u = (point_m[0] - origin[0]) * scale - 0.5;
        let v = (point_m[1] - origin[1]) * scale - 0.5;
        let (x, y) = (u.floor(), v.floor());
        // NaN fails, too.
        if !(x >= 0.0 && y >= 0.0 && x < width as f64 - 1.0 && y < height as f64 - 1.0) {
            return self.random_share;
        }
        let (fx, fy) = ((u - x) as f32, (v - y) as f32);
        let first = x as usize + width * y as usize;
        let [a, b] = [self.likelihoods[first], self.likelihoods[first + 1]];
        let [c, d] = [
            self.likelihoods[first + width],
            self.likelihoods[first + width + 1],
        ];
        let (low, high) = (a + (b - a) * fx, c + (d - c) * fx);
        low + (high - low) * fy
    }
}

/// More levels change nothing that matters.
const MAX_LEVELS: u32 = 100;

impl SensorModel for LikelihoodField {
    fn mean_log_likelihood(&self, pose: &Pose2, readings: &Readings) -> f64 {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let (mut sum, mut count) = (0.0, 0_u32);
        // Products of a few likelihoods stay far from the smallest number, and save logarithms.
        let (mut product, mut in_product) = (1.0_f64, 0);
        for reading in readings.iter().filter(|reading| reading.is_hit) {
            let [dx, dy] = reading.direction.map(|along| along * reading.range_m);
            let end = [
                pose.x_m + cos * dx - sin * dy,
                pose.y_m + sin * dx + cos * dy,
            ];
            product *= f64::from(self.at(end));
            in_product += 1;
            count += 1;
            if in_product == FACTORS {
                sum += product.ln();
                (product, in_product) = (1.0, 0);
            }
        }
        sum += product.ln();
        if count == 0 {
            0.0
        } else {
            sum / f64::from(count)
        }
    }
}

/// A likelihood is at least the random share, so that this many of them are a normal number.
const FACTORS: u32 = 16;

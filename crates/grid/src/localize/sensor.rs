//! What does a model of the sensor answer?

use crate::pose::Pose2;
use crate::scan::{Beam, LaserScan};

/// One beam of a scan, prepared so that its end can be placed without trigonometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The beam's direction in the robot's frame.
    pub direction: [f64; 2],
    /// How far it went.
    pub range_m: f64,
    /// Whether it ended at a surface; otherwise nothing was within the laser's range.
    pub is_hit: bool,
}

/// Beams of one scan that are compared with a map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Readings {
    readings: Vec<Reading>,
    max_range_m: f64,
}

impl Readings {
    /// At most `num_beams` beams of a scan, evenly over those that say something.
    pub fn of(scan: &LaserScan, num_beams: usize) -> Self {
        let valid: Vec<Reading> = (scan.beams())
            .filter_map(|(angle, beam)| {
                let (range_m, is_hit) = match beam {
                    Beam::Hit(range) => (range, true),
                    Beam::Free(range) => (range, false),
                    Beam::Invalid => return None,
                };
                let (sin, cos) = angle.sin_cos();
                Some(Reading {
                    direction: [cos, sin],
                    range_m,
                    is_hit,
                })
            })
            .collect();
        let count = num_beams.min(valid.len());
        let readings = (0..count).map(|index| valid[index * valid.len() / count]);
        Self {
            readings: readings.collect(),
            max_range_m: scan.max_range_m(),
        }
    }

    /// The beams.
    pub fn iter(&self) -> impl Iterator<Item = &Reading> {
        self.readings.iter()
    }

    /// Number of beams.
    pub fn len(&self) -> usize {
        self.readings.len()
    }

    /// Whether the scan said nothing.
    pub fn is_empty(&self) -> bool {
        self.readings.is_empty()
    }

    /// How far the laser sees.
    pub const fn max_range_m(&self) -> f64 {
        self.max_range_m
    }
}

/// How likely a scan is at a pose of a map.
pub trait SensorModel: Sync {
    /// The mean over the beams of the logarithm of each beam's likelihood; 0 without beams.
    ///
    /// A mean, not a sum: how many independent observations a scan is worth is the filter's
    /// business.
    fn mean_log_likelihood(&self, pose: &Pose2, readings: &Readings) -> f64;
}

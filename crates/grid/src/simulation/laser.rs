//! What would a laser measure in a scene?

use std::f64::consts::PI;

use fremen::Result;

use crate::pose::Pose2;
use crate::random::Random;
use crate::scan::LaserScan;
use crate::simulation::scene::Scene;

/// A planar laser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laser {
    /// Number of beams.
    pub num_beams: usize,
    /// Angle from the first beam to the last.
    pub field_of_view_rad: f64,
    /// How far it sees.
    pub max_range_m: f64,
    /// Standard deviation of a range.
    pub deviation_m: f64,
    /// Share of beams that say nothing.
    pub dropout: f64,
}

impl Default for Laser {
    /// A safety laser as on the papers' robot: 270 degrees, 20 m, 3 cm.
    fn default() -> Self {
        Self {
            num_beams: 181,
            field_of_view_rad: 1.5 * PI,
            max_range_m: 20.0,
            deviation_m: 0.03,
            dropout: 0.01,
        }
    }
}

impl Laser {
    /// The scan from `pose`.
    ///
    /// # Errors
    /// [`ErrorKind::Config`](fremen::ErrorKind::Config) where the laser's numbers are none.
    pub fn scan(&self, scene: &Scene, pose: &Pose2, random: &mut Random) -> Result<LaserScan> {
        let first = -0.5 * self.field_of_view_rad;
        let step = self.field_of_view_rad / (self.num_beams.max(2) - 1) as f64;
        let ranges = (0..self.num_beams).map(|index| {
            let (sin, cos) = (pose.heading_rad + first + step * index as f64).sin_cos();
            let noise = random.normal(self.deviation_m);
            if random.chance(self.dropout) {
                return f32::NAN;
            }
            let range = scene.cast([pose.x_m, pose.y_m], [cos, sin], self.max_range_m);
            range.map_or(f32::INFINITY, |range| (range + noise).max(0.01) as f32)
        });
        LaserScan::new(first, step, self.max_range_m, ranges.collect())
    }
}

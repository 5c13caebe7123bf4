//! What does a robot measure while it drives along a path?

use fremen::{Result, Time};

use crate::localize::MotionModel;
use crate::pose::Pose2;
use crate::random::Random;
use crate::scan::LaserScan;
use crate::simulation::laser::Laser;
use crate::simulation::scene::Scene;

/// How a simulated robot drives and measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveConfig {
    /// Its laser.
    pub laser: Laser,
    /// Way between two scans.
    pub step_m: f64,
    /// Its speed.
    pub speed_m_s: f64,
    /// Noise of its odometry from step to step.
    pub odometry: MotionModel,
    /// Deviation of the scale of its odometry, which stays the same for a whole drive.
    pub scale_deviation: f64,
    /// Deviation of a constant drift of the heading, in radians per metre, likewise.
    pub drift_rad_per_m: f64,
}

impl Default for DriveConfig {
    fn default() -> Self {
        Self {
            laser: Laser::default(),
            step_m: 0.25,
            speed_m_s: 0.5,
            odometry: MotionModel {
                turn_per_turn: 0.05,
                turn_per_m: 0.02,
                drive_per_m: 0.05,
                drive_per_turn: 0.01,
            },
            scale_deviation: 0.02,
            drift_rad_per_m: 0.01,
        }
    }
}

/// One drive: truth, odometry and scans, all of the same length.
#[derive(Clone, Debug, Default)]
pub struct Drive {
    /// When each scan was taken.
    pub times: Vec<Time>,
    /// Where the robot really was.
    pub truth: Vec<Pose2>,
    /// Its motion since the scan before as the wheels say; none for the first.
    pub motions: Vec<Pose2>,
    /// What the laser saw.
    pub scans: Vec<LaserScan>,
}

/// Points at equal steps along the corners of a path, with the heading of the way.
pub fn resample(corners_m: &[[f64; 2]], step_m: f64) -> Vec<Pose2> {
    let mut poses = Vec::new();
    let mut left = 0.0;
    for pair in corners_m.windows(2) {
        let (dx, dy) = (pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        let length = dx.hypot(dy);
        let heading = dy.atan2(dx);
        let mut along = left;
        while along < length {
            let share = along / length;
            poses.push(Pose2::new(
                pair[0][0] + share * dx,
                pair[0][1] + share * dy,
                heading,
            ));
            along += step_m;
        }
        left = along - length;
    }
    poses
}

/// Drives along `path` from `begin` on through a world that changes.
///
/// # Errors
/// As [`Laser::scan`].
pub fn drive_along(
    path: &[Pose2],
    begin: Time,
    world: &dyn Fn(Time) -> Scene,
    config: &DriveConfig,
    random: &mut Random,
) -> Result<Drive> {
    let scale = 1.0 + random.normal(config.scale_deviation);
    let drift = random.normal(config.drift_rad_per_m);
    let mut drive = Drive::default();
    let mut way_m = 0.0;
    let mut before: Option<Pose2> = None;
    for pose in path {
        let mut motion = Pose2::default();
        if let Some(before) = before {
            let mut moved = before.to(pose);
            let length = moved.x_m.hypot(moved.y_m);
            way_m += length;
            moved = Pose2::new(moved.x_m * scale, moved.y_m * scale, moved.heading_rad);
            motion = config.odometry.sample(&moved, random);
            motion.heading_rad += drift * length;
        }
        before = Some(*pose);
        let time = begin.plus_us((way_m / config.speed_m_s * 1e6) as i64);
        drive.times.push(time);
        drive.truth.push(*pose);
        drive.motions.push(motion);
        drive
            .scans
            .push(config.laser.scan(&world(time), pose, random)?);
    }
    Ok(drive)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_resampled_at_equal_steps_also_round_corners() {
        let poses = resample(&[[0.0, 0.0], [1.1, 0.0], [1.1, 1.0]], 0.25);
        assert_eq!(poses.len(), 9);
        assert!((poses[5].y_m - 0.15).abs() < 1e-12 && (poses[5].x_m - 1.1).abs() < 1e-12);
        assert!((poses[5].heading_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
}

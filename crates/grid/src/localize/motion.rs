//! Where may the robot have moved to, when its wheels say so?

use crate::pose::{Pose2, wrap};
use crate::random::Random;

/// Noise of odometry as a turn, a straight line and a turn (Probabilistic Robotics, section 5.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionModel {
    /// Deviation of a turn per radian turned.
    pub turn_per_turn: f64,
    /// Deviation of a turn per metre driven.
    pub turn_per_m: f64,
    /// Deviation of a distance per metre driven.
    pub drive_per_m: f64,
    /// Deviation of a distance per radian turned.
    pub drive_per_turn: f64,
}

impl Default for MotionModel {
    fn default() -> Self {
        Self {
            turn_per_turn: 0.1,
            turn_per_m: 0.05,
            drive_per_m: 0.08,
            drive_per_turn: 0.02,
        }
    }
}

impl MotionModel {
    /// A model without noise.
    pub const fn exact() -> Self {
        Self {
            turn_per_turn: 0.0,
            turn_per_m: 0.0,
            drive_per_m: 0.0,
            drive_per_turn: 0.0,
        }
    }

    /// One of the motions that may lie behind what the odometry says.
    #[must_use]
    pub fn sample(&self, motion: &Pose2, random: &mut Random) -> Pose2 {
        let drive = motion.x_m.hypot(motion.y_m);
        // A robot that hardly moves has no direction; one that moves backwards did not turn round.
        let mut first = if drive < 1e-3 {
            0.0
        } else {
            motion.y_m.atan2(motion.x_m)
        };
        let is_backwards = first.abs() > std::f64::consts::FRAC_PI_2;
        if is_backwards {
            first = wrap(first + std::f64::consts::PI);
        }
        let second = wrap(motion.heading_rad - first);
        let mut turn = |angle: f64| {
            let deviation = self.turn_per_turn * angle.abs() + self.turn_per_m * drive;
            angle + random.normal(deviation)
        };
        let (first, second) = (turn(first), turn(second));
        let turned = first.abs() + second.abs();
        let deviation = self.drive_per_m * drive + self.drive_per_turn * turned;
        let mut driven = drive + random.normal(deviation);
        if is_backwards {
            driven = -driven;
        }
        Pose2::new(
            driven * first.cos(),
            driven * first.sin(),
            wrap(first + second),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_noise_a_motion_is_what_the_wheels_say() {
        let mut random = Random::new(1);
        for motion in [
            Pose2::new(0.3, 0.1, 0.2),
            Pose2::new(-0.3, 0.1, -0.4),
            Pose2::new(0.0, 0.0, 1.0),
            Pose2::new(0.0, -0.2, 3.0),
        ] {
            let moved = MotionModel::exact().sample(&motion, &mut random);
            assert!(moved.distance_m(&motion) < 1e-9, "{motion:?} {moved:?}");
            assert!(wrap(moved.heading_rad - motion.heading_rad).abs() < 1e-9);
        }
    }
}

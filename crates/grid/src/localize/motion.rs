//! Where may the robot have moved to, when its wheels say so?

use std::f64::consts::FRAC_1_SQRT_2;

use crate::pose::{Pose2, wrap};
use crate::random::Random;

/// Noise of odometry, in proportion to what was driven and turned.
///
/// Deviation: the usual odometry model (Probabilistic Robotics, section 5.4) takes a motion apart
/// into a turn, a drive and a turn back. For steps of millimetres sideways, as corrected poses have
/// them, these turns are large and their noise tears the heading away; here the noise of the heading
/// follows from the net turn and the distance only.
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
        let driven = motion.x_m.hypot(motion.y_m);
        let turned = motion.heading_rad.abs();
        // Half of the noise of the heading comes before the drive, half after it.
        let deviation = self.turn_per_turn * turned + self.turn_per_m * driven;
        let mut turn = || random.normal(deviation * FRAC_1_SQRT_2);
        let (before, after) = (turn(), turn());
        let along = random.normal(self.drive_per_m * driven + self.drive_per_turn * turned);
        let scale = if driven > 0.0 {
            1.0 + along / driven
        } else {
            0.0
        };
        let slip = if driven > 0.0 { 0.0 } else { along };
        let turn = Pose2::new(0.0, 0.0, before);
        let [x, y] = turn.place([scale * motion.x_m + slip, scale * motion.y_m]);
        Pose2::new(x, y, wrap(motion.heading_rad + before + after))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_follows_what_was_driven_and_not_in_how_many_directions() {
        let model = MotionModel::default();
        let mut random = Random::new(2);
        let mut spread = |motion: Pose2| {
            let turns = (0..4_000).map(|_| model.sample(&motion, &mut random).heading_rad);
            (turns.map(|turn| turn * turn).sum::<f64>() / 4_000.0).sqrt()
        };
        let (ahead, aside) = (
            spread(Pose2::new(0.1, 0.0, 0.0)),
            spread(Pose2::new(0.0, 0.1, 0.0)),
        );
        assert!((ahead - 0.005).abs() < 0.0005 && (aside - 0.005).abs() < 0.0005);
    }

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

//! Which boxes are there at a moment? The thesis' world: boxes that move in and out at fixed
//! intervals, each at its own, while a robot drives from corner to corner.

use fremen::{Result, Time};

use crate::cells::{GridSpec, OccupancyMap};
use crate::pose::Pose2;
use crate::random::Random;
use crate::simulation::drive::resample;
use crate::simulation::scene::Scene;

/// Which periods the boxes have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxPeriods {
    /// The candidates of the thesis: 1,200 s / (k + 1), as far as a robot can follow them.
    Candidates,
    /// Any period of the same range.
    Any,
}

/// One box: where, and when it is there.
#[derive(Clone, Copy, Debug)]
struct Interval {
    low_m: [f64; 2],
    high_m: [f64; 2],
    period_s: f64,
    phase: f64,
    /// Share of the period in which it is there.
    duty: f64,
}

/// A square with boxes that come and go.
#[derive(Clone, Debug)]
pub struct Boxes {
    boxes: Vec<Interval>,
    walls: Scene,
}

/// Side of the square.
const SIDE_M: f64 = 20.0;
/// Boxes along each side.
const PER_SIDE: usize = 5;

impl Boxes {
    /// The world of a seed.
    pub fn new(seed: u64, periods: BoxPeriods) -> Self {
        let mut random = Random::stream(seed, &[0x424f_5845]);
        let mut walls = Scene::default();
        walls.add_box([0.0, 0.0], [SIDE_M, SIDE_M]);
        // The corner from which the robot begins is partly surrounded.
        walls.add_segment([0.0, 3.0], [2.0, 3.0]);
        walls.add_segment([3.0, 0.0], [3.0, 2.0]);
        let mut boxes = Vec::new();
        for number in 0..PER_SIDE * PER_SIDE {
            let (column, row) = (number % PER_SIDE, number / PER_SIDE);
            // The diagonal is the robot's way.
            if column == row {
                continue;
            }
            let center = [column, row].map(|place| {
                (place as f64 + 0.5) * SIDE_M / PER_SIDE as f64 + random.between(-0.6, 0.6)
            });
            let half = [0, 1].map(|_| random.between(0.3, 0.7));
            let period_s = match periods {
                BoxPeriods::Candidates => 1_200.0 / (random.below(8) + 1) as f64,
                BoxPeriods::Any => random.between(150.0, 1_200.0),
            };
            boxes.push(Interval {
                low_m: [0, 1].map(|axis| center[axis] - half[axis]),
                high_m: [0, 1].map(|axis| center[axis] + half[axis]),
                period_s,
                phase: random.uniform(),
                duty: random.between(0.35, 0.65),
            });
        }
        Self { boxes, walls }
    }

    /// Everything at one moment.
    pub fn scene(&self, time: Time) -> Scene {
        let mut scene = self.walls.clone();
        for interval in &self.boxes {
            let turns = time.as_s() / interval.period_s + interval.phase;
            if turns.rem_euclid(1.0) < interval.duty {
                scene.add_box(interval.low_m, interval.high_m);
            }
        }
        scene
    }

    /// A grid over the square.
    ///
    /// # Errors
    /// As [`GridSpec::new_2d`].
    pub fn spec(&self, resolution_m: f64) -> Result<GridSpec> {
        let size = ((SIDE_M + 1.0) / resolution_m).ceil() as u32;
        // Walls lie in the middle of cells: at an edge, rounding would say in which one.
        let corner = -((0.5 / resolution_m).ceil() + 0.5) * resolution_m;
        GridSpec::new_2d([corner, corner], resolution_m, [size, size])
    }

    /// The true map.
    pub fn true_map(&self, time: Time, spec: GridSpec) -> OccupancyMap {
        self.scene(time).rasterize(spec, [1.0, 1.0])
    }

    /// The robot's way: along the diagonal and back.
    pub fn way(&self, step_m: f64) -> Vec<Pose2> {
        let end = SIDE_M - 1.0;
        resample(&[[1.0, 1.0], [end, end], [1.0, 1.0]], step_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_repeat_after_the_longest_period_and_leave_the_way_free() {
        let world = Boxes::new(9, BoxPeriods::Candidates);
        let scene = |s: i64| world.scene(Time::from_s(s));
        assert_eq!(scene(77), scene(77 + 1_200));
        let mut num_scenes = 1;
        for second in 1..1_200 {
            num_scenes += usize::from(scene(second) != scene(second - 1));
            for pose in world.way(0.5) {
                assert!(!scene(second).is_blocked([pose.x_m, pose.y_m], 0.2));
            }
        }
        assert!(num_scenes > 50);
    }
}

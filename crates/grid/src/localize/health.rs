//! Is the robot lost, or is the map outdated?
//!
//! Both look the same to a filter: scans do not fit. [`ScanFit`] counts at the robot's pose which
//! beams contradict the map. [`Outdated`] compares the count of a run with those of earlier runs in
//! maps that were right, by a rank: of runs in right maps, a share `alpha` at most is called
//! outdated, whatever the building, the laser and the distribution (conformal prediction: V. Vovk,
//! A. Gammerman, G. Shafer: Algorithmic learning in a random world, 2005). [`PlaceSearch`] says
//! whether the scan fits better anywhere else.

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use fremen::{Error, ErrorKind, Result};
use rayon::prelude::*;

use crate::cells::{CellState, OccupancyMap, Thresholds};
use crate::localize::distance::DistanceField;
use crate::localize::filter::FreeSpace;
use crate::localize::sensor::{Readings, SensorModel};
use crate::pose::Pose2;
use crate::random::Random;
use crate::scan::{Beam, LaserScan, ray::walk};

/// What the beams of a scan, or of many, say about a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanFit {
    /// Beams that end at a surface of the map.
    pub num_explained: u64,
    /// Beams that pass through a surface of the map: something is gone.
    pub num_gone: u64,
    /// Beams that end where the map is free: something is new.
    pub num_new: u64,
    /// Beams that end where the map knows nothing, or nowhere.
    pub num_open: u64,
}

impl ScanFit {
    /// Compares a scan at `pose` with `map`, whose distances to surfaces are `field`; ends within
    /// `tolerance_m` of a surface are explained by it.
    pub fn of(
        map: &OccupancyMap,
        field: &DistanceField,
        thresholds: Thresholds,
        pose: &Pose2,
        scan: &LaserScan,
        tolerance_m: f64,
    ) -> Self {
        let mut fit = Self::default();
        let spec = map.spec();
        for (angle, beam) in scan.beams() {
            let (range, is_hit) = match beam {
                Beam::Hit(range) => (range, true),
                Beam::Free(range) => (range, false),
                Beam::Invalid => continue,
            };
            let (sin, cos) = angle.sin_cos();
            let end = pose.place([range * cos, range * sin]);
            // A surface that the beam left behind by more than the tolerance.
            let mut passed = false;
            walk(spec, [pose.x_m, pose.y_m], end, |crossing| {
                let is_before = crossing.leave_m < range - tolerance_m;
                passed = is_before
                    && map.state(crossing.index, thresholds) == CellState::Occupied
                    && crossing.leave_m > tolerance_m;
                if passed || !is_before {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            });
            let near = is_hit && field.at(end) <= tolerance_m;
            let state = (spec.cell_at([end[0], end[1], 0.0])).map_or(CellState::Unknown, |cell| {
                map.state(spec.index(cell), thresholds)
            });
            if passed {
                fit.num_gone += 1;
            } else if near {
                fit.num_explained += 1;
            } else if is_hit && state == CellState::Free {
                fit.num_new += 1;
            } else {
                fit.num_open += 1;
            }
        }
        fit
    }

    /// Adds the beams of another scan.
    pub fn add(&mut self, other: &Self) {
        self.num_explained += other.num_explained;
        self.num_gone += other.num_gone;
        self.num_new += other.num_new;
        self.num_open += other.num_open;
    }

    /// The share of beams that contradict the map among those that say something about it; 0
    /// without any.
    pub fn contradiction(&self) -> f64 {
        let against = self.num_gone + self.num_new;
        let all = against + self.num_explained;
        if all == 0 {
            0.0
        } else {
            against as f64 / all as f64
        }
    }
}

/// How unusual a run's contradiction is among those of earlier runs in maps that were right.
#[derive(Clone, Debug)]
pub struct Outdated {
    /// In ascending order.
    past: Vec<f64>,
}

impl Outdated {
    /// A test that knows the [`contradiction`](ScanFit::contradiction) of earlier runs.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where one is not finite.
    pub fn new(mut past: Vec<f64>) -> Result<Self> {
        if past.iter().any(|score| !score.is_finite()) {
            let message = "a run's contradiction is not finite";
            return Err(Error::new(ErrorKind::Config, message));
        }
        past.sort_by(f64::total_cmp);
        Ok(Self { past })
    }

    /// The p-value of "the map is as right as in earlier runs": the share of runs, with this one,
    /// that contradict at least as much. Never below 1 / (number of past runs + 1).
    pub fn p_value(&self, contradiction: f64) -> f64 {
        let below = self.past.partition_point(|past| *past < contradiction);
        let above = self.past.len() - below;
        (above + 1) as f64 / (self.past.len() + 1) as f64
    }

    /// Whether the map is outdated, where at most a share `alpha` of right maps may be called so.
    pub fn is_outdated(&self, contradiction: f64, alpha: f64) -> bool {
        self.p_value(contradiction) <= alpha
    }
}

/// What is wrong, if anything.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Diagnosis {
    /// The scans fit as well as usual.
    Fine,
    /// The scans fit better elsewhere: the robot is lost.
    Lost {
        /// Where they fit best.
        better: Pose2,
    },
    /// They fit nowhere better: the map is outdated.
    MapOutdated {
        /// How often that many contradictions come in a right map.
        p_value: f64,
    },
}

impl Diagnosis {
    /// Judges one scan at the pose that is believed.
    ///
    /// `contradiction` is that of the run. A pose elsewhere has to explain the scan better by
    /// `margin` (in mean log likelihood of a beam), which is how much the best wrong pose gains in
    /// right maps at most.
    pub fn of(
        contradiction: f64,
        past: &Outdated,
        alpha: f64,
        here: f64,
        best: &(Pose2, f64),
        margin: f64,
    ) -> Self {
        if !past.is_outdated(contradiction, alpha) {
            Self::Fine
        } else if best.1 > here + margin {
            Self::Lost { better: best.0 }
        } else {
            Self::MapOutdated {
                p_value: past.p_value(contradiction),
            }
        }
    }
}

/// A search for the pose at which a scan fits best, anywhere in a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceSearch {
    /// Poses that are tried.
    pub num_tries: usize,
    /// How many of them are improved.
    pub num_improved: usize,
    /// Beams that are compared.
    pub num_beams: usize,
}

impl Default for PlaceSearch {
    fn default() -> Self {
        Self {
            num_tries: 30_000,
            num_improved: 40,
            num_beams: 60,
        }
    }
}

/// Steps of the improvement: metres and radians of the first, and how often they are halved.
const FIRST_STEP_M: f64 = 0.2;
const FIRST_STEP_RAD: f64 = TAU / 36.0;
const NUM_HALVINGS: u32 = 5;

impl PlaceSearch {
    /// The best pose and its mean log likelihood of a beam; none where nothing was tried.
    pub fn best(
        &self,
        scan: &LaserScan,
        sensor: &dyn SensorModel,
        space: &FreeSpace,
        seed: u64,
    ) -> Option<(Pose2, f64)> {
        let readings = Readings::of(scan, self.num_beams);
        let mut tried: Vec<(Pose2, f64)> = (0..self.num_tries)
            .into_par_iter()
            .map(|index| {
                let pose = space.sample(&mut Random::stream(seed, &[index as u64]));
                (pose, sensor.mean_log_likelihood(&pose, &readings))
            })
            .collect();
        // Stable, so that equals keep their order.
        tried.sort_by(|a, b| b.1.total_cmp(&a.1));
        tried.truncate(self.num_improved.max(1));
        let improved: Vec<(Pose2, f64)> = (tried.par_iter())
            .map(|start| improve(*start, &readings, sensor))
            .collect();
        (improved.into_iter()).reduce(|best, next| if next.1 > best.1 { next } else { best })
    }
}

/// Climbs from a pose by steps that become smaller.
fn improve(start: (Pose2, f64), readings: &Readings, sensor: &dyn SensorModel) -> (Pose2, f64) {
    let mut best = start;
    for halving in 0..NUM_HALVINGS {
        let scale = 0.5_f64.powi(halving as i32);
        let (step, turn) = (FIRST_STEP_M * scale, FIRST_STEP_RAD * scale);
        loop {
            let at = best.0;
            let near = [
                Pose2::new(at.x_m + step, at.y_m, at.heading_rad),
                Pose2::new(at.x_m - step, at.y_m, at.heading_rad),
                Pose2::new(at.x_m, at.y_m + step, at.heading_rad),
                Pose2::new(at.x_m, at.y_m - step, at.heading_rad),
                Pose2::new(at.x_m, at.y_m, at.heading_rad + turn),
                Pose2::new(at.x_m, at.y_m, at.heading_rad - turn),
            ];
            let before = best.1;
            for pose in near {
                let log = sensor.mean_log_likelihood(&pose, readings);
                if log > best.1 {
                    best = (pose, log);
                }
            }
            if best.1 <= before + 1e-9 {
                break;
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_p_value_is_a_rank() -> Result<()> {
        let test = Outdated::new((1..20).map(|i| f64::from(i) / 100.0).collect())?;
        assert!((test.p_value(0.5) - 0.05).abs() < 1e-12);
        assert!((test.p_value(0.0) - 1.0).abs() < 1e-12);
        assert!((test.p_value(0.10) - 11.0 / 20.0).abs() < 1e-12);
        assert!(test.is_outdated(0.5, 0.05) && !test.is_outdated(0.19, 0.05));
        assert!(!Outdated::new(vec![])?.is_outdated(1.0, 0.05));
        assert!(Outdated::new(vec![f64::NAN]).is_err());
        Ok(())
    }
}

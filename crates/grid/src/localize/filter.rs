//! Where is the robot, after it moved and looked?

use std::f64::consts::{PI, TAU};

use fremen::{Error, ErrorKind, Result};
use rayon::prelude::*;

use crate::cells::{CellState, GridSpec, OccupancyMap, Thresholds};
use crate::localize::clusters::{Estimate, heaviest};
use crate::localize::kld::KldBound;
use crate::localize::motion::MotionModel;
use crate::localize::sensor::{Readings, SensorModel};
use crate::pose::{Pose2, wrap};
use crate::random::Random;
use crate::scan::LaserScan;

/// How a [`MonteCarlo`] filter works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterConfig {
    /// The fewest particles.
    pub min_particles: usize,
    /// The most particles.
    pub max_particles: usize,
    /// Side of a bin in which particles count as one place.
    pub bin_m: f64,
    /// Number of headings that count as different.
    pub num_headings: u32,
    /// How far the particles' distribution may be from the true one (Kullback-Leibler).
    pub kld_error: f64,
    /// How surely, as a quantile of the normal distribution.
    pub kld_quantile: f64,
    /// Beams of a scan that are used.
    pub num_beams: usize,
    /// How many independent observations these beams are worth: neighbouring beams see the same
    /// things, and fail together.
    pub evidence: f64,
    /// The share of the particles beyond the fewest that must carry the weight after a scan; the
    /// scan counts less where fewer would.
    pub min_effective: f64,
    /// A scan is used after the robot moved so far ...
    pub min_move_m: f64,
    /// ... or turned so far: what is seen twice from one place is seen once.
    pub min_turn_rad: f64,
    /// The noise of the odometry.
    pub motion: MotionModel,
    /// How fast the long-term mean of the fit follows, per scan.
    pub slow: f64,
    /// How fast the short-term mean follows. Where it falls below the long-term mean, particles are
    /// drawn anywhere: the robot may have been carried (Probabilistic Robotics, table 8.3).
    pub fast: f64,
    /// Poses that are tried for each particle that is drawn anywhere; the likely ones are kept (S.
    /// Lenser, M. Veloso: Sensor resetting localization, ICRA 2000).
    pub tries: usize,
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self {
            min_particles: 1_000,
            max_particles: 20_000,
            bin_m: 0.25,
            num_headings: 36,
            kld_error: 0.02,
            kld_quantile: 2.33,
            num_beams: 60,
            evidence: 40.0,
            min_effective: 0.05,
            min_move_m: 0.2,
            min_turn_rad: 0.2,
            motion: MotionModel::default(),
            slow: 0.02,
            fast: 0.3,
            tries: 10,
        }
    }
}

impl FilterConfig {
    fn check(&self) -> Result<()> {
        let positive = [self.bin_m, self.kld_error, self.evidence];
        let is_valid = self.min_particles > 0
            && self.max_particles >= self.min_particles
            && self.num_headings > 0
            && self.num_beams > 0
            && positive.iter().all(|x| *x > 0.0 && x.is_finite())
            && (0.0..=1.0).contains(&self.min_effective)
            && (0.0..=1.0).contains(&self.slow)
            && (self.slow..=1.0).contains(&self.fast);
        if is_valid {
            return Ok(());
        }
        Err(Error::new(
            ErrorKind::Config,
            format!("a filter cannot work by {self:?}"),
        )
        .with_help("counts and sizes are positive, slow is at most fast, both in [0, 1]"))
    }

    fn bound(&self) -> KldBound {
        KldBound::new(
            self.bin_m,
            i64::from(self.num_headings),
            self.kld_error,
            self.kld_quantile,
        )
    }
}

/// Where a robot can be: the free cells of a map.
#[derive(Clone, Debug)]
pub struct FreeSpace {
    spec: GridSpec,
    cells: Vec<usize>,
}

impl FreeSpace {
    /// The free cells of `map`.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] where it has none.
    pub fn of(map: &OccupancyMap, thresholds: Thresholds) -> Result<Self> {
        let is_free = |index: &usize| map.state(*index, thresholds) == CellState::Free;
        let cells: Vec<usize> = (0..map.spec().num_cells()).filter(is_free).collect();
        if cells.is_empty() {
            return Err(Error::new(ErrorKind::NotFound, "the map has no free cell"));
        }
        Ok(Self {
            spec: *map.spec(),
            cells,
        })
    }

    /// Any pose in it.
    pub fn sample(&self, random: &mut Random) -> Pose2 {
        let center = self
            .spec
            .center(self.spec.cell(self.cells[random.below(self.cells.len())]));
        let half = 0.5 * self.spec.resolution_m();
        Pose2::new(
            center[0] + random.between(-half, half),
            center[1] + random.between(-half, half),
            random.between(-PI, PI),
        )
    }
}

/// One belief about the robot's pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Particle {
    /// Where.
    pub pose: Pose2,
    /// How likely; all weights add up to 1.
    pub weight: f64,
}

/// A particle filter over poses (adaptive Monte Carlo localisation).
///
/// Every particle has a stream of random numbers of its own, and sums are made in a fixed order:
/// the same seed gives the same bytes for any number of threads.
#[derive(Clone, Debug)]
pub struct MonteCarlo {
    config: FilterConfig,
    seed: u64,
    num_steps: u64,
    particles: Vec<Particle>,
    fit: FitHistory,
    /// Whether it began with a robot that may be anywhere.
    is_global: bool,
    /// Motion since the last scan that was used, and what came of that.
    pending: Pose2,
    last: Option<Estimate>,
}

/// How well scans used to fit, and how well they do now.
#[derive(Clone, Copy, Debug, Default)]
struct FitHistory {
    slow: f64,
    fast: f64,
    /// Of single scans from the fast mean.
    variance: f64,
    num_scans: u32,
}

/// How many deviations below the slow mean scans still fit as usual. Without this band, ordinary
/// fluctuations draw particles anywhere at every scan (the plain rule of table 8.3), which costs an
/// order of magnitude more particles.
const USUAL: f64 = 3.0;
/// By how much slower the slow mean follows scans that do not fit.
const UNUSUAL: f64 = 0.1;
/// The smallest deviation, as a share of the mean: a robot that has stood still has seen none.
const SMALLEST_DEVIATION: f64 = 0.1;

impl FitHistory {
    fn add(&mut self, fit: f64, slow: f64, fast: f64) {
        if self.slow == 0.0 {
            *self = Self {
                slow: fit,
                fast: fit,
                variance: 0.0,
                num_scans: 1,
            };
            return;
        }
        self.num_scans += 1;
        // At first the mean of all scans: a global start fits badly until it has found a place.
        let slow = slow.max(1.0 / f64::from(self.num_scans)).min(fast);
        let off = fit - self.fast;
        // What is unusual teaches little of what is usual: a robot that is lost for long must not
        // come to find that normal.
        if self.share_anywhere() > 0.0 {
            self.slow += UNUSUAL * slow * (fit - self.slow);
        } else {
            self.variance += slow * (off * off - self.variance);
            self.slow += slow * (fit - self.slow);
        }
        self.fast += fast * (fit - self.fast);
    }

    /// The share of particles to be drawn anywhere.
    fn share_anywhere(&self) -> f64 {
        let deviation = self.variance.sqrt().max(SMALLEST_DEVIATION * self.slow);
        let usual = self.slow - USUAL * deviation;
        if usual > 0.0 {
            (1.0 - self.fast / usual).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}

/// What the streams of random numbers are for.
const BEGIN: u64 = 0;
const MOVE: u64 = 1;
const DRAW: u64 = 2;
const ANYWHERE: u64 = 3;

impl MonteCarlo {
    /// A robot that is about at `pose`, with these standard deviations.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the configuration cannot be used or a number is not finite.
    pub fn around(
        pose: &Pose2,
        deviation_m: f64,
        deviation_rad: f64,
        config: FilterConfig,
        seed: u64,
    ) -> Result<Self> {
        config.check()?;
        if !(pose.is_finite() && deviation_m.is_finite() && deviation_rad.is_finite()) {
            let message = format!("{pose:?} within {deviation_m} m, {deviation_rad} is no place");
            return Err(Error::new(ErrorKind::Config, message));
        }
        // As many as the spread needs.
        let mut bound = config.bound();
        let mut random = Random::stream(seed, &[BEGIN]);
        let mut poses = Vec::new();
        let mut needed = 0.0;
        while poses.len() < config.max_particles
            && (poses.len() < config.min_particles || (poses.len() as f64) < needed)
        {
            let drawn = Pose2::new(
                pose.x_m + random.normal(deviation_m),
                pose.y_m + random.normal(deviation_m),
                wrap(pose.heading_rad + random.normal(deviation_rad)),
            );
            needed = bound.add(&drawn);
            poses.push(drawn);
        }
        Ok(Self::of_poses(poses, config, seed))
    }

    /// A robot that may be anywhere in `space`.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the configuration cannot be used.
    pub fn anywhere(space: &FreeSpace, config: FilterConfig, seed: u64) -> Result<Self> {
        config.check()?;
        let mut random = Random::stream(seed, &[BEGIN]);
        let poses = (0..config.max_particles).map(|_| space.sample(&mut random));
        let mut filter = Self::of_poses(poses.collect(), config, seed);
        filter.is_global = true;
        Ok(filter)
    }

    fn of_poses(poses: Vec<Pose2>, config: FilterConfig, seed: u64) -> Self {
        let weight = 1.0 / poses.len() as f64;
        let particles = poses.into_iter().map(|pose| Particle { pose, weight });
        Self {
            config,
            seed,
            num_steps: 0,
            particles: particles.collect(),
            fit: FitHistory::default(),
            is_global: false,
            pending: Pose2::default(),
            last: None,
        }
    }

    /// All beliefs.
    pub fn particles(&self) -> &[Particle] {
        &self.particles
    }

    /// The robot moved by `motion` (in its own frame) and sees `scan`.
    ///
    /// A scan that says nothing only moves the particles, and one after too little motion is not
    /// used: the estimate is the last one, moved on. `space` is where particles are drawn when
    /// the scans do not fit any more.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the motion is not finite; nothing is changed then.
    pub fn step(
        &mut self,
        motion: &Pose2,
        scan: &LaserScan,
        sensor: &dyn SensorModel,
        space: &FreeSpace,
    ) -> Result<Estimate> {
        if !motion.is_finite() {
            let message = format!("a robot cannot move by {motion:?}");
            return Err(Error::new(ErrorKind::Config, message));
        }
        self.pending = self.pending.then(motion);
        let moved_m = self.pending.x_m.hypot(self.pending.y_m);
        let turned_rad = self.pending.heading_rad.abs();
        if let Some(last) = self.last
            && moved_m < self.config.min_move_m
            && turned_rad < self.config.min_turn_rad
        {
            return Ok(Estimate {
                pose: last.pose.then(&self.pending),
                ..last
            });
        }
        let motion = std::mem::take(&mut self.pending);
        let readings = Readings::of(scan, self.config.num_beams);
        self.num_steps += 1;
        let fit = self.move_and_weigh(&motion, &readings, sensor);
        let estimate = Estimate {
            fit,
            ..self.estimate()
        };
        if !readings.is_empty() {
            self.resample(&readings, sensor, space);
            self.last = Some(estimate);
        }
        Ok(estimate)
    }

    /// Moves all particles, weighs them by the scan and returns how well it fits.
    fn move_and_weigh(
        &mut self,
        motion: &Pose2,
        readings: &Readings,
        sensor: &dyn SensorModel,
    ) -> f64 {
        let (seed, step) = (self.seed, self.num_steps);
        let model = self.config.motion;
        let logs: Vec<f64> = (self.particles.par_iter_mut().enumerate())
            .map(|(index, particle)| {
                let mut random = Random::stream(seed, &[MOVE, step, index as u64]);
                particle.pose = particle.pose.then(&model.sample(motion, &mut random));
                sensor.mean_log_likelihood(&particle.pose, readings)
            })
            .collect();
        let fit: f64 = (self.particles.iter().zip(&logs))
            .map(|(particle, log)| particle.weight * log.exp())
            .sum();
        if !readings.is_empty() {
            self.fit.add(fit, self.config.slow, self.config.fast);
        }
        let before: Vec<f64> = self
            .particles
            .iter()
            .map(|particle| particle.weight)
            .collect();
        let evidence = self.config.evidence.min(readings.len() as f64);
        // The particles beyond the fewest are there because the robot may be in many places.
        let num_spread = before.len() - self.config.min_particles.min(before.len());
        let enough = self.config.min_effective * num_spread as f64;
        let weights = tempered(&before, &logs, evidence, enough);
        for (particle, weight) in self.particles.iter_mut().zip(weights) {
            particle.weight = weight;
        }
        fit
    }

    /// Where the robot is by the weights of now.
    fn estimate(&self) -> Estimate {
        let poses: Vec<Pose2> = self
            .particles
            .iter()
            .map(|particle| particle.pose)
            .collect();
        let weights: Vec<f64> = self
            .particles
            .iter()
            .map(|particle| particle.weight)
            .collect();
        heaviest(&poses, &weights, &self.config.bound())
    }

    /// The share of particles to be drawn anywhere: after a global start one n-th at scan n, until
    /// it is known how well scans fit, because the first place that fits may be the wrong one.
    fn share_anywhere(&self) -> f64 {
        let begin = 1.0 / f64::from(self.fit.num_scans.max(1));
        let is_begin = self.is_global && self.fit.num_scans > 1 && begin > self.config.slow;
        self.fit
            .share_anywhere()
            .max(if is_begin { begin } else { 0.0 })
    }

    /// Draws particles by their weights, as many as their spread needs.
    fn resample(&mut self, readings: &Readings, sensor: &dyn SensorModel, space: &FreeSpace) {
        let anywhere = self.share_anywhere();
        let squares: f64 = self.particles.iter().map(|p| p.weight * p.weight).sum();
        let num_effective = 1.0 / squares;
        if anywhere == 0.0 && num_effective > 0.5 * self.particles.len() as f64 {
            return;
        }
        let mut sums = Vec::with_capacity(self.particles.len());
        let mut sum = 0.0;
        for particle in &self.particles {
            sum += particle.weight;
            sums.push(sum);
        }
        let (min, max) = (self.config.min_particles, self.config.max_particles);
        let num_anywhere = (anywhere * self.particles.len() as f64).ceil() as usize;
        let mut elsewhere = self.draw_anywhere(num_anywhere, readings, sensor, space);
        let mut random = Random::stream(self.seed, &[DRAW, self.num_steps]);
        let mut bound = self.config.bound();
        let mut poses: Vec<Pose2> = Vec::new();
        let mut needed = 0.0;
        while poses.len() < max && (poses.len() < min || (poses.len() as f64) < needed) {
            let replaced = if random.chance(anywhere) {
                elsewhere.pop()
            } else {
                None
            };
            let pose = replaced.unwrap_or_else(|| {
                let at = random.uniform() * sum;
                let index = sums.partition_point(|before| *before <= at);
                self.particles[index.min(self.particles.len() - 1)].pose
            });
            needed = bound.add(&pose);
            poses.push(pose);
        }
        let weight = 1.0 / poses.len() as f64;
        self.particles.clear();
        self.particles
            .extend(poses.into_iter().map(|pose| Particle { pose, weight }));
    }

    /// `count` poses of the whole map at which the scan is likely.
    fn draw_anywhere(
        &self,
        count: usize,
        readings: &Readings,
        sensor: &dyn SensorModel,
        space: &FreeSpace,
    ) -> Vec<Pose2> {
        let (seed, step) = (self.seed, self.num_steps);
        let tried: Vec<(Pose2, f64)> = (0..count * self.config.tries.max(1))
            .into_par_iter()
            .map(|index| {
                let mut random = Random::stream(seed, &[ANYWHERE, step, index as u64]);
                let pose = space.sample(&mut random);
                (pose, sensor.mean_log_likelihood(&pose, readings))
            })
            .collect();
        let best = tried
            .iter()
            .fold(f64::NEG_INFINITY, |best, tried| best.max(tried.1));
        let evidence = self.config.evidence.min(readings.len() as f64);
        let mut sums = Vec::with_capacity(tried.len());
        let mut sum = 0.0;
        for (_, log) in &tried {
            sum += (evidence * (log - best)).exp();
            sums.push(sum);
        }
        let mut random = Random::stream(seed, &[ANYWHERE, step]);
        (0..if tried.is_empty() { 0 } else { count })
            .map(|_| {
                let at = random.uniform() * sum;
                let index = sums.partition_point(|before| *before <= at);
                let pose = tried[index.min(tried.len() - 1)].0;
                // Not the same pose many times.
                let jitter = 0.5 * self.config.bin_m;
                let turn = TAU / f64::from(self.config.num_headings);
                Pose2::new(
                    pose.x_m + random.normal(jitter),
                    pose.y_m + random.normal(jitter),
                    wrap(pose.heading_rad + random.normal(0.5 * turn)),
                )
            })
            .collect()
    }
}

/// Weights after observations of these mean log likelihoods, which count as `evidence` independent
/// ones, or as fewer where fewer than `enough` particles would then carry the weight. (One scan must not decide between all places of a building by the few particles that
/// happen to be near the right one.)
fn tempered(before: &[f64], logs: &[f64], evidence: f64, enough: f64) -> Vec<f64> {
    let best = logs
        .iter()
        .fold(f64::NEG_INFINITY, |best, log| best.max(*log));
    let weigh = |evidence: f64| {
        let mut weights: Vec<f64> = (before.iter().zip(logs))
            .map(|(weight, log)| weight * (evidence * (log - best)).exp())
            .collect();
        let sum: f64 = weights.iter().sum();
        for weight in &mut weights {
            *weight /= sum;
        }
        let squares: f64 = weights.iter().map(|weight| weight * weight).sum();
        (weights, 1.0 / squares)
    };
    let (weights, num_effective) = weigh(evidence);
    if num_effective >= enough {
        return weights;
    }
    // NaN, where all weights vanish, is not enough either.
    let (mut low, mut high) = (0.0, evidence);
    for _ in 0..NUM_BISECTIONS {
        let middle = f64::midpoint(low, high);
        if weigh(middle).1 >= enough {
            low = middle;
        } else {
            high = middle;
        }
    }
    weigh(low).0
}

/// They find the evidence within a thousandth of the largest.
const NUM_BISECTIONS: u32 = 10;

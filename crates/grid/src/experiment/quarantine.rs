//! Does a grid survive maps that are wrong? (IROS 2016, section V-C, figure 7)

use fremen::{Result, Time};
use rayon::prelude::*;

use crate::cells::{GridSpec, OccupancyMap, Thresholds};
use crate::experiment::world::{map_at, moment, patch_of, patrol};
use crate::localize::{
    FilterConfig, FreeSpace, LikelihoodField, LikelihoodFieldConfig, MonteCarlo,
};
use crate::picture::contradictions_png;
use crate::pose::{Pose2, wrap};
use crate::random::Random;
use crate::registration::{Decision, Guard, GuardConfig, Quarantined, Reason, compare, resampled};
use crate::simulation::{Drive, Layout, Office};
use crate::temporal::TemporalGrid;

/// What is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct QuarantineConfig {
    /// One office for each seed.
    pub seeds: Vec<u64>,
    /// Which office.
    pub layout: Layout,
    /// Patrols in each office.
    pub num_patrols: usize,
    /// Hours between them.
    pub every_h: f64,
    /// Share of maps that are corrupted, of those after the trusted ones.
    pub corrupted: f64,
    /// From this patrol on furniture stands elsewhere, if any.
    pub rearranged_at: Option<usize>,
    /// Side of a cell.
    pub resolution_m: f64,
    /// How maps are judged.
    pub guard: GuardConfig,
    /// Whether the same patrols are also made without a guard.
    pub with_unguarded: bool,
}

impl Default for QuarantineConfig {
    fn default() -> Self {
        Self {
            seeds: (0..10).collect(),
            layout: Layout::Paper,
            num_patrols: 70,
            every_h: 3.0,
            corrupted: 0.15,
            rearranged_at: None,
            resolution_m: 0.05,
            guard: GuardConfig::default(),
            with_unguarded: true,
        }
    }
}

/// What was done to a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corruption {
    /// Nothing.
    None,
    /// All of it is shifted.
    Shifted,
    /// All of it is turned.
    Turned,
    /// From some scan on all others are displaced: mapping lost its way.
    Torn,
}

/// How a grid deals with maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Care {
    /// Maps are registered, judged, and integrated or quarantined.
    Guarded,
    /// Maps are integrated as they come.
    None,
}

/// One patrol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatrolResult {
    /// What was done to its map.
    pub corruption: Corruption,
    /// Share of cells of the map that were predicted wrongly (the axis of figure 7).
    pub disagreement: f64,
    /// The share that the prediction itself expected to be wrong, and the largest that was usual.
    pub expected: f64,
    /// See [`expected`](Self::expected); infinite without a judgement.
    pub limit: f64,
    /// Why the map was not believed.
    pub reason: Option<Reason>,
    /// Share of cells of the true map that were predicted wrongly before this patrol.
    pub error: f64,
    /// Whether the map was kept out.
    pub is_quarantined: bool,
    /// Whether earlier maps were adopted with this one.
    pub is_adopted: bool,
    /// Median distance of the robot's estimates from the truth.
    pub lost_by_m: f64,
}

/// The patrols of one office.
#[derive(Clone, Debug, PartialEq)]
pub struct OfficePatrols {
    /// Of the office.
    pub seed: u64,
    /// With the guard.
    pub guarded: Vec<PatrolResult>,
    /// The same patrols without; empty where they were not made.
    pub unguarded: Vec<PatrolResult>,
    /// A picture of the last quarantined map with its title: what appeared in red, what vanished in
    /// blue.
    pub evidence: Option<(String, Vec<u8>)>,
}

/// All offices.
#[derive(Clone, Debug, PartialEq)]
pub struct QuarantineReport {
    /// One an office.
    pub offices: Vec<OfficePatrols>,
    /// How many maps were trusted without judgement.
    pub num_trusted: usize,
}

impl QuarantineReport {
    /// Judged maps that were corrupted, and how many of these were quarantined.
    pub fn corrupted(&self) -> (usize, usize) {
        self.count(|patrol| patrol.corruption != Corruption::None)
    }

    /// Judged maps that were good, and how many of these were quarantined.
    pub fn good(&self) -> (usize, usize) {
        self.count(|patrol| patrol.corruption == Corruption::None)
    }

    fn count(&self, is_meant: impl Fn(&PatrolResult) -> bool) -> (usize, usize) {
        let (mut num_all, mut num_held) = (0, 0);
        for office in &self.offices {
            let judged = office.guarded.iter().skip(self.num_trusted);
            for patrol in judged.filter(|patrol| is_meant(patrol)) {
                num_all += 1;
                num_held += usize::from(patrol.is_quarantined);
            }
        }
        (num_all, num_held)
    }

    /// The mean share of wrong cells in the predictions of the last ten patrols, with the guard and
    /// without.
    pub fn final_errors(&self) -> [f64; 2] {
        let last = |patrols: &[PatrolResult]| {
            let last = &patrols[patrols.len().saturating_sub(10)..];
            last.iter().map(|patrol| patrol.error).sum::<f64>() / last.len().max(1) as f64
        };
        let mean = |of: &dyn Fn(&OfficePatrols) -> f64| {
            self.offices.iter().map(of).sum::<f64>() / self.offices.len().max(1) as f64
        };
        [
            mean(&|office| last(&office.guarded)),
            mean(&|office| last(&office.unguarded)),
        ]
    }

    /// The table: one row an office, and a sum.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let mut text = String::from(
            "office | corrupted, quarantined | good, quarantined | adoptions | error at the end %: \
             guarded | unguarded\n",
        );
        for office in &self.offices {
            let alone = Self {
                offices: vec![office.clone()],
                num_trusted: self.num_trusted,
            };
            let (corrupted, good) = (alone.corrupted(), alone.good());
            let adopted: Vec<String> = (office.guarded.iter().enumerate())
                .filter(|(_, patrol)| patrol.is_adopted)
                .map(|(number, _)| number.to_string())
                .collect();
            let [guarded, unguarded] = alone.final_errors();
            let _ = writeln!(
                text,
                "{:6} | {:9}, {:11} | {:4}, {:11} | {:9} | {:27.1} | {:.1}",
                office.seed,
                corrupted.0,
                corrupted.1,
                good.0,
                good.1,
                adopted.join(" "),
                100.0 * guarded,
                100.0 * unguarded,
            );
        }
        let (corrupted, good) = (self.corrupted(), self.good());
        let [guarded, unguarded] = self.final_errors();
        let share = |(all, held): (usize, usize)| 100.0 * held as f64 / all.max(1) as f64;
        let _ = writeln!(
            text,
            "all: {} of {} corrupted maps quarantined ({:.1} %), {} of {} good ones ({:.1} %); \
             error at the end {:.1} % guarded, {:.1} % unguarded",
            corrupted.1,
            corrupted.0,
            share(corrupted),
            good.1,
            good.0,
            share(good),
            100.0 * guarded,
            100.0 * unguarded,
        );
        text
    }
}

/// Lets robots patrol offices, localised in the map that their grid predicts, with some of their
/// maps corrupted.
///
/// # Errors
/// As the grid and the filter.
pub fn quarantine(config: &QuarantineConfig) -> Result<QuarantineReport> {
    let offices = (config.seeds.par_iter())
        .map(|&seed| {
            let (guarded, guard) = patrols(seed, Care::Guarded, config)?;
            Ok(OfficePatrols {
                seed,
                evidence: guard.quarantined().last().map(evidence).transpose()?,
                guarded,
                unguarded: if config.with_unguarded {
                    patrols(seed, Care::None, config)?.0
                } else {
                    Vec::new()
                },
            })
        })
        .collect::<Result<_>>()?;
    Ok(QuarantineReport {
        offices,
        num_trusted: config.guard.num_trusted,
    })
}

/// What speaks against a map.
fn evidence(held: &Quarantined) -> Result<(String, Vec<u8>)> {
    let [appeared, vanished] = &held.contradictions;
    let title = format!(
        "{}: {:.1} % contradict the prediction, {:.1} % are usual",
        held.judgement.time,
        100.0 * held.judgement.disagreement,
        100.0 * held.judgement.limit
    );
    Ok((title, contradictions_png(&held.map, appeared, vanished)?))
}

fn patrols(seed: u64, care: Care, config: &QuarantineConfig) -> Result<(Vec<PatrolResult>, Guard)> {
    let begin_h = 1.0;
    let when = |number: usize| moment(0, begin_h + config.every_h * number as f64);
    let mut office = Office::new(seed, config.layout);
    if let Some(number) = config.rearranged_at {
        office = office.rearranged_at(when(number));
    }
    let spec = office.spec(config.resolution_m)?;
    let mut grid = TemporalGrid::new(spec, crate::model::GridConfig::default());
    let mut guard = Guard::new(config.guard);
    let mut predicted = OccupancyMap::new_unknown(spec);
    let mut results = Vec::new();
    for number in 0..config.num_patrols {
        let time = when(number);
        // The same patrols and corruptions with and without care.
        let mut random = Random::stream(seed, &[0x5155_4152, number as u64]);
        grid.predict_into(time, &mut predicted)?;
        let drive = patrol(&office, time, &mut random)?;
        let poses = follow(&drive, &predicted, seed)?;
        let is_judged = number >= config.guard.num_trusted;
        let is_corrupted = random.chance(config.corrupted) && is_judged;
        let (map, corruption) = if is_corrupted {
            corrupt(spec, &poses, &drive, &mut random)?
        } else {
            (map_at(spec, &poses, &drive.scans)?, Corruption::None)
        };
        let truth = office.true_map(time, spec);
        let thresholds = Thresholds::default();
        let mut result = PatrolResult {
            corruption,
            disagreement: compare(&predicted, &map, thresholds).disagreement,
            expected: 0.0,
            limit: f64::INFINITY,
            reason: None,
            error: compare(&predicted, &truth, thresholds).disagreement,
            is_quarantined: false,
            is_adopted: false,
            lost_by_m: lost_by(&drive, &poses),
        };
        let observed: Vec<(Time, OccupancyMap)> = match care {
            Care::None => vec![(time, map)],
            Care::Guarded => {
                let decision = guard.judge("", &predicted, &map, time)?;
                let judgement = *decision.judgement();
                result.disagreement = judgement.disagreement;
                result.expected = judgement.expected;
                result.limit = judgement.limit;
                result.reason = judgement.reason;
                match decision {
                    Decision::Integrate(map, _) => vec![(time, map)],
                    Decision::Quarantine(_) => {
                        result.is_quarantined = true;
                        Vec::new()
                    }
                    Decision::Adopt(held, _) => {
                        result.is_adopted = true;
                        let maps = held.into_iter().map(|it| (it.judgement.time, it.map));
                        maps.collect()
                    }
                }
            }
        };
        for (time, map) in observed {
            grid.observe(&patch_of(&map), time)?;
        }
        results.push(result);
    }
    Ok((results, guard))
}

/// The poses that a robot believes to have had, by the predicted map; in the first patrol, which has
/// none, somebody has measured them.
fn follow(drive: &Drive, predicted: &OccupancyMap, seed: u64) -> Result<Vec<Pose2>> {
    let Ok(space) = FreeSpace::of(predicted, Thresholds::default()) else {
        return Ok(drive.truth.clone());
    };
    let sensor = LikelihoodField::new(predicted, LikelihoodFieldConfig::default())?;
    let config = FilterConfig {
        min_particles: 500,
        max_particles: 5_000,
        ..FilterConfig::default()
    };
    // It begins at its charger.
    let mut filter = MonteCarlo::around(&drive.truth[0], 0.02, 0.01, config, seed)?;
    (drive.motions.iter().zip(&drive.scans))
        .map(|(motion, scan)| Ok(filter.step(motion, scan, &sensor, &space)?.pose))
        .collect()
}

fn lost_by(drive: &Drive, poses: &[Pose2]) -> f64 {
    let mut errors: Vec<f64> = (drive.truth.iter().zip(poses))
        .map(|(truth, pose)| truth.distance_m(pose))
        .collect();
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

/// A map as it becomes when mapping fails.
fn corrupt(
    spec: GridSpec,
    poses: &[Pose2],
    drive: &Drive,
    random: &mut Random,
) -> Result<(OccupancyMap, Corruption)> {
    let sign = if random.chance(0.5) { 1.0 } else { -1.0 };
    let angle = random.between(0.0, std::f64::consts::TAU);
    let distance = random.between(0.3, 1.0);
    let shift = Pose2::new(distance * angle.cos(), distance * angle.sin(), 0.0);
    let turn = sign * random.between(0.05, 0.3);
    Ok(match random.below(3) {
        0 => {
            let map = map_at(spec, poses, &drive.scans)?;
            (resampled(&map, &shift, spec), Corruption::Shifted)
        }
        1 => {
            let moved: Vec<Pose2> = (poses.iter())
                .map(|pose| {
                    poses[0]
                        .then(&Pose2::new(0.0, 0.0, turn))
                        .then(&poses[0].to(pose))
                })
                .collect();
            (map_at(spec, &moved, &drive.scans)?, Corruption::Turned)
        }
        _ => {
            let from = poses.len() / 4 + random.below(poses.len() / 2);
            let moved: Vec<Pose2> = (poses.iter().enumerate())
                .map(|(number, pose)| {
                    if number < from {
                        return *pose;
                    }
                    let pivot = &poses[from];
                    let turned = Pose2::new(
                        pivot.x_m + shift.x_m,
                        pivot.y_m + shift.y_m,
                        wrap(pivot.heading_rad + turn),
                    );
                    turned.then(&pivot.to(pose))
                })
                .collect();
            (map_at(spec, &moved, &drive.scans)?, Corruption::Torn)
        }
    })
}

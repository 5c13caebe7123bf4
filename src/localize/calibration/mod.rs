//! What do matches at the right place and at wrong places look like?
//!
//! A [`Calibration`] is learnt from the map alone. Past visits are taken out, one or a run of them at a
//! time, and asked for as if they were live: their own place is predicted by a model that was fitted
//! without them, and features born in them do not take part, since a birth is no evidence. By the same
//! procedure every other place is matched with them. That gives
//!
//! - the *detection curve*: how often a feature of a given score is found at its place ([`Curve`]), and how
//!   much more or less often than that at each single place;
//! - for every feature, how often it is found where it is not (`q_f`), drawn to the mean over all features
//!   by [`FALSE_RATE_PRIOR`] trials;
//! - how often a feature strays that is not found (its match does not agree with the others): at each place
//!   in images of others, and how much more often in its own;
//! - how much a matching distance tells: g1 (seen again, counted while the map was learnt,
//!   [`Reobservation`]) against g0 (found at wrong places);
//! - how much a displacement tells: the camera's spread between visits against anywhere;
//! - what a score is worth as evidence ([`Temper`]), for each score and several n.
//!
//! The image of a past visit is its appearance, where that was kept; otherwise it is put together again
//! from the features that the log says were seen then, with the descriptors they were born with.
//!
//! Cost: a few fits of each calibrated place's model, and (images x places) matches of up to 300
//! features; both are bounded ([`MAX_PLACES`], [`MAX_TRIALS`]) however large the map is. Sums are taken
//! in a fixed order, so the result does not depend on the number of threads.
//!
//! Not for maps of a single visit a place: nothing can be held out, and the values are those of
//! [`Calibration::uninformed`].

mod curve;
mod store;
mod temper;

pub use curve::Curve;
pub use store::ATTACHMENT;
pub(super) use store::VERSION;
use temper::Asked;
pub use temper::Temper;

use std::sync::Arc;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::evidence::{Expectation, Hits, LogMean, Strays};
use super::{Evidence, Localizer, Method, Plan, Score, Scratch};
use crate::feature::{Features, FeaturesView};
use crate::map::{Node, NodeId, Reobservation, Snapshot};
use crate::matching::{Displacement, Match, Vote};
use crate::predict::{PredictedMap, Selection, Witnesses};
use fremen::error::Result;
use fremen::time::Time;
use fremen::visibility::{self, BitRow, Visits};

/// So many trials at the mean rate are added to those of each feature.
const FALSE_RATE_PRIOR: f64 = 20.0;
/// So many expected features, all found, are added to those of each place.
const REPEATABILITY_PRIOR: f64 = 30.0;
/// So many features at the mean rate are added to those of each place that were counted as strays or missing.
const STRAY_PRIOR: f64 = 200.0;
/// The rate of strays while nothing is known.
const STRAY_RATE: f64 = 0.15;
/// So many features at that rate are added to those of the whole map.
const MAP_STRAY_PRIOR: f64 = 100.0;
const MAX_STRAY_RATE: f64 = 0.9;
/// The rate of false matches while nothing is known.
const FALSE_RATE: f64 = 0.01;
const FALSE_RATES: std::ops::RangeInclusive<f64> = 0.001..=0.9;
/// Past visits of at most so many places are asked for, evenly spread over the map.
const MAX_PLACES: usize = 32;
/// With so many visits or fewer, each is taken out by itself; otherwise runs of them, so that what is
/// near in time does not vouch for itself.
const MAX_SINGLE_FOLDS: usize = 16;
const NUM_RUNS: usize = 8;
/// Visits asked for of each run.
const IMAGES_PER_RUN: usize = 3;
/// Images x places that are matched, about.
const MAX_TRIALS: usize = 1000;
/// An image is matched with at most so many other places, evenly spread over the map.
const MAX_OTHERS: usize = 256;
/// Appearances of a place that are matched with one image, at most.
const MAX_APPEARANCES: usize = 6;
/// Numbers of features at which the worth of scores is learnt.
const SIZES: [usize; 7] = [10, 20, 30, 50, 100, 200, 300];
/// Position in [`SIZES`] of the number of features that rates are learnt with.
const RATE_SIZE: usize = 4;
/// Distances are smoothed over so many bits to each side.
const SMOOTHING_BITS: usize = 3;
/// Fewer counted distances say nothing.
const MIN_DISTANCES: u64 = 50;
/// Fewer counted displacements say nothing.
const MIN_DISPLACEMENTS: u64 = 5;
/// The share of visits whose displacement may be anything.
const STRAY_SHARE: f64 = 0.1;
/// The method that keeps every appearance.
const EVERYTHING: Method = Method::ExperienceAll;
/// Log odds do not enter the posterior beyond this.
const MAX_LOG_ODDS: f64 = 60.0;

/// What a [`Localizer`] knows about its own evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    detection: Curve,
    /// How much more often than that features of each place are found.
    repeatability: Vec<f64>,
    false_rate: f64,
    /// Of each place and hypothesis (its predicted map, or each visit): trials of each feature.
    false_counts: Vec<Vec<Vec<Trials>>>,
    /// How often a feature strays that is not found, of each place in images of others.
    stray_rates: Vec<f64>,
    /// How much more often it does in images of its own place.
    stray_ratio: f64,
    distance_log_ratios: Vec<f64>,
    displacement: Option<DisplacementPrior>,
    /// Whether features that were seen together are expected together.
    hears_witnesses: bool,
    /// For each score, at each of [`SIZES`].
    tempers: [[Temper; SIZES.len()]; Score::ALL.len()],
    num_images: usize,
}

/// How often a feature was looked for where it is not, and found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "(u32, u32)", into = "(u32, u32)")]
struct Trials {
    tried: u32,
    found: u32,
}

impl From<(u32, u32)> for Trials {
    fn from((tried, found): (u32, u32)) -> Self {
        Self { tried, found }
    }
}

impl From<Trials> for (u32, u32) {
    fn from(trials: Trials) -> Self {
        (trials.tried, trials.found)
    }
}

/// Where the camera stands between visits: normal around the place's frame, or anywhere.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct DisplacementPrior {
    spread_px: (f64, f64),
    /// Area of displacements that leave some overlap, px^2.
    area_px2: f64,
}

/// One past visit, asked for.
struct Image {
    node: usize,
    fold: usize,
    time: Time,
    features: Features,
}

/// One predicted map or appearance of a place, matched with one image.
struct Record {
    hypothesis: usize,
    /// Index of each feature's trials, and what the model says of it.
    features: Vec<(u32, f64)>,
    /// Those that saw each feature; empty for an appearance.
    witnesses: Vec<u64>,
    num_witnesses: usize,
    /// How much each of them counts; nothing where all count alike.
    likeness: Vec<f64>,
    /// At each of [`SIZES`].
    found: [Found; SIZES.len()],
}

/// What matched at one number of features.
#[derive(Clone, Default)]
struct Found {
    num_matches: u32,
    inliers: Vec<Match>,
    displacement: Displacement,
}

impl Found {
    /// Matches that did not agree with the others.
    fn num_strays(&self) -> usize {
        (self.num_matches as usize).saturating_sub(self.inliers.len())
    }
}

/// Features that were not found, and those among them that strayed.
#[derive(Clone, Copy, Default)]
struct StrayCounts {
    num_unmatched: usize,
    num_strays: usize,
}

impl std::ops::AddAssign for StrayCounts {
    fn add_assign(&mut self, other: Self) {
        self.num_unmatched += other.num_unmatched;
        self.num_strays += other.num_strays;
    }
}

impl StrayCounts {
    /// Their share, with `prior` more features at the `usual` rate.
    fn rate(self, usual: f64, prior: f64) -> f64 {
        (self.num_strays as f64 + prior * usual) / (self.num_unmatched as f64 + prior)
    }
}

/// A place matched with an image.
struct Trial {
    image: usize,
    node: usize,
    records: Vec<Record>,
}

/// The models of one place without each of its folds.
struct HeldOutPlace {
    node: usize,
    folds: Vec<BitRow>,
    /// `None` where no visit of the fold is asked for.
    plans: Vec<Option<Plan>>,
}

impl Calibration {
    /// What is assumed while nothing is known.
    pub fn uninformed() -> Self {
        Self {
            detection: Curve::constant(0.3),
            repeatability: Vec::new(),
            false_rate: FALSE_RATE,
            false_counts: Vec::new(),
            stray_rates: Vec::new(),
            stray_ratio: 1.0,
            distance_log_ratios: vec![0.0; 257],
            displacement: None,
            hears_witnesses: true,
            tempers: Score::ALL.map(|score| [prior_temper(score); SIZES.len()]),
            num_images: 0,
        }
    }

    /// Asks past visits of the localizer's map.
    pub(super) fn learn(localizer: &Localizer) -> Result<Self> {
        let mut calibration = Self::uninformed();
        // What a feature of an appearance is worth does not depend on which appearances a method uses,
        // so that is learnt from all of them; what the scores are worth, from the method's own.
        let everything: Option<Vec<Arc<Plan>>> = match localizer.cfg.method() {
            Method::Static | Method::Fremen | Method::Fused | Method::ExperienceAll => None,
            Method::Experience | Method::Freex => Some(
                (localizer.snapshot.nodes.iter())
                    .map(|node| {
                        let cfg = localizer.cfg.clone().with_method(EVERYTHING);
                        Plan::of(node, &cfg).map(Arc::new)
                    })
                    .collect::<Result<_>>()?,
            ),
        };
        let (images, trials) = ask(localizer, everything.as_ref().unwrap_or(&localizer.plans))?;
        calibration.num_images = images.len();
        calibration.learn_rates(localizer, &images, &trials);
        calibration.learn_strays(localizer.plans.len(), &images, &trials);
        let seen = Reobservation::of(&localizer.snapshot)?;
        calibration.learn_distances(&seen, &images, &trials);
        calibration.learn_displacement(&seen, localizer.snapshot.meta.image_size);
        calibration.forget(localizer.cfg.without());
        let trials = match everything {
            None => trials,
            Some(_) => ask(localizer, &localizer.plans)?.1,
        };
        calibration.learn_tempers(&images, &trials);
        Ok(calibration)
    }

    /// Leaves out what the configuration does not want.
    fn forget(&mut self, without: &[Evidence]) {
        for evidence in without {
            match evidence {
                Evidence::Appearances => self.hears_witnesses = false,
                Evidence::Distances => self.distance_log_ratios.fill(0.0),
                Evidence::Displacement => self.displacement = None,
                Evidence::FalseRates => self.false_counts.clear(),
                Evidence::Repeatability => self.repeatability.clear(),
                Evidence::Strays => self.stray_rates.clear(),
            }
        }
    }

    /// Starts an expectation with as many of the witnesses as are heard.
    fn restart(
        &self,
        expectation: &mut Expectation,
        node: NodeId,
        num_witnesses: usize,
        likeness: &[f64],
    ) {
        let strays = self.strays_of(node);
        if self.hears_witnesses {
            expectation.restart_weighted(num_witnesses, strays, likeness);
        } else {
            expectation.restart(0, strays);
        }
    }

    /// What strays say at a place.
    fn strays_of(&self, node: NodeId) -> Strays {
        let elsewhere = self.stray_rates.get(node.0 as usize);
        elsewhere.map_or_else(Strays::default, |&elsewhere| {
            Strays::new(
                (elsewhere * self.stray_ratio).min(MAX_STRAY_RATE),
                elsewhere,
            )
        })
    }

    /// From a model's score to the probability that the feature is matched at its place.
    pub fn detection(&self) -> &Curve {
        &self.detection
    }

    /// How often a feature is matched in an image of another place, on average.
    pub fn mean_false_rate(&self) -> f64 {
        self.false_rate
    }

    /// How many past visits were asked for.
    pub fn num_images(&self) -> usize {
        self.num_images
    }

    /// ln(g1 / g0) at a distance.
    pub fn distance_log_ratio(&self, distance_bits: u16) -> f64 {
        self.distance_log_ratios[usize::from(distance_bits).min(256)]
    }

    /// The worth of a score at `n` features, between learnt sizes by ln n.
    pub fn temper(&self, score: Score, n: usize) -> Temper {
        let tempers = &self.tempers[score as usize];
        let n = n.clamp(SIZES[0], SIZES[SIZES.len() - 1]);
        let above = SIZES.partition_point(|&size| size < n);
        if SIZES[above] == n {
            return tempers[above];
        }
        let (low, high) = (SIZES[above - 1] as f64, SIZES[above] as f64);
        let share = (n as f64 / low).ln() / (high / low).ln();
        let between = |low: f64, high: f64| low + share * (high - low);
        Temper {
            scale: between(tempers[above - 1].scale, tempers[above].scale),
            bias: between(tempers[above - 1].bias, tempers[above].bias),
            level: between(tempers[above - 1].level, tempers[above].level),
        }
    }

    pub(super) fn displacement_log_ratio(&self, displacement: Displacement) -> f64 {
        let Some(prior) = self.displacement else {
            return 0.0;
        };
        let (sx, sy) = prior.spread_px;
        let square = (displacement.dx_px / sx).powi(2) + (displacement.dy_px / sy).powi(2);
        let density = (-0.5 * square).exp() / (std::f64::consts::TAU * sx * sy);
        ((1.0 - STRAY_SHARE) * density * prior.area_px2 + STRAY_SHARE).ln()
    }

    /// What is known, for a newer snapshot of the map; `is_same` says which of its places have not changed.
    ///
    /// False rates go with their features where a budget has numbered them anew, and are forgotten of kept
    /// appearances, whose visits are numbered anew then.
    pub(super) fn on_newer(
        known: &Arc<Self>,
        older: &Snapshot,
        newer: &Snapshot,
        is_same: &[bool],
    ) -> Arc<Self> {
        let mut known = Arc::clone(known);
        let places = older.nodes.iter().zip(&newer.nodes).zip(is_same);
        for (index, ((old, new), _)) in places.enumerate().filter(|(_, (_, is_same))| !**is_same) {
            let extends = new
                .features
                .descriptors()
                .starts_with(old.features.descriptors())
                && new.visits.len() >= old.visits.len();
            if extends || known.false_counts.len() <= index {
                continue;
            }
            let of_place = &mut Arc::make_mut(&mut known).false_counts[index];
            of_place.truncate(1);
            for counts in of_place {
                *counts = renumbered(counts, old.features.view(), new.features.view());
            }
        }
        known
    }

    /// What each feature of a predicted map would say.
    pub(super) fn expect_predicted(
        &self,
        expectation: &mut Expectation,
        node: NodeId,
        predicted: &PredictedMap,
        witnesses: &Witnesses,
    ) {
        self.restart(
            expectation,
            node,
            witnesses.num_visits(),
            predicted.likeness(),
        );
        for &id in predicted.features() {
            let detection = self.detection_at(node, predicted.scores()[id as usize]);
            let false_rate = self.false_rate_of(node, 0, id as usize, Trials::default());
            expectation.push(detection, false_rate, witnesses.seen()[id as usize]);
        }
    }

    /// What each feature of an appearance would say.
    pub(super) fn expect_appearance(
        &self,
        expectation: &mut Expectation,
        node: NodeId,
        visit: u32,
        len: usize,
    ) {
        expectation.restart(0, self.strays_of(node));
        for rank in 0..len {
            let detection = self.detection_at(node, strength_score(rank));
            let false_rate = self.false_rate_of(node, visit as usize, rank, Trials::default());
            expectation.push(detection, false_rate, 0);
        }
    }

    /// The probability that a feature of this score is matched at this place.
    fn detection_at(&self, node: NodeId, score: f64) -> f64 {
        let of_place = self.repeatability.get(node.0 as usize).copied();
        (self.detection.rate(score) * of_place.unwrap_or(1.0)).min(1.0)
    }

    /// `q_f`, without the trials `but`.
    fn false_rate_of(&self, node: NodeId, hypothesis: usize, feature: usize, but: Trials) -> f64 {
        let counts = (self.false_counts.get(node.0 as usize))
            .and_then(|place| place.get(hypothesis))
            .and_then(|features| features.get(feature));
        let trials = counts.copied().unwrap_or_default();
        let found = f64::from(trials.found.saturating_sub(but.found));
        let tried = f64::from(trials.tried.saturating_sub(but.tried));
        let rate = (found + FALSE_RATE_PRIOR * self.false_rate) / (tried + FALSE_RATE_PRIOR);
        rate.clamp(*FALSE_RATES.start(), *FALSE_RATES.end())
    }

    fn learn_rates(&mut self, localizer: &Localizer, images: &[Image], trials: &[Trial]) {
        let mut samples = Vec::new();
        self.false_counts = (localizer.snapshot.nodes.iter().zip(&localizer.plans))
            .map(|(node, plan)| plan.empty_trials(node))
            .collect();
        let mut all = Trials::default();
        for trial in trials {
            let is_own = images[trial.image].node == trial.node;
            for record in &trial.records {
                let found = record.found_at(RATE_SIZE);
                for (&(feature, score), found) in record.features.iter().zip(found) {
                    if is_own {
                        samples.push((score, found));
                        continue;
                    }
                    let counts = &mut self.false_counts[trial.node][record.hypothesis];
                    for counts in [&mut counts[feature as usize], &mut all] {
                        counts.tried += 1;
                        counts.found += u32::from(found);
                    }
                }
            }
        }
        // Of most features of a large map nothing was tried, which takes no memory.
        for features in self.false_counts.iter_mut().flatten() {
            if features.iter().all(|trials| trials.tried == 0) {
                *features = Vec::new();
            }
        }
        if let Some(curve) = Curve::fit(&mut samples) {
            self.detection = curve;
            self.repeatability = self.learn_repeatability(localizer.plans.len(), images, trials);
        }
        self.false_rate = (f64::from(all.found) + FALSE_RATE * FALSE_RATE_PRIOR)
            / (f64::from(all.tried) + FALSE_RATE_PRIOR);
    }

    /// For each place, found over expected features, drawn to 1 by [`REPEATABILITY_PRIOR`] expected ones.
    fn learn_repeatability(
        &self,
        num_places: usize,
        images: &[Image],
        trials: &[Trial],
    ) -> Vec<f64> {
        let mut found = vec![REPEATABILITY_PRIOR; num_places];
        let mut expected = found.clone();
        for trial in trials {
            if images[trial.image].node != trial.node {
                continue;
            }
            for record in &trial.records {
                let was_found = record.found_at(RATE_SIZE);
                for (&(_, score), was_found) in record.features.iter().zip(was_found) {
                    expected[trial.node] += self.detection.rate(score);
                    found[trial.node] += f64::from(u8::from(was_found));
                }
            }
        }
        (found.iter().zip(&expected))
            .map(|(found, expected)| found / expected)
            .collect()
    }

    /// How often features stray that are not found.
    ///
    /// What other places' images show is counted for each place; what its own show, which are few, for the
    /// whole map.
    fn learn_strays(&mut self, num_places: usize, images: &[Image], trials: &[Trial]) {
        let [mut of_own, mut of_others] = [StrayCounts::default(); 2];
        let mut of_place = vec![StrayCounts::default(); num_places];
        for trial in trials {
            let is_own = images[trial.image].node == trial.node;
            for record in &trial.records {
                let counts = record.strays();
                if is_own {
                    of_own += counts;
                } else {
                    of_others += counts;
                    of_place[trial.node] += counts;
                }
            }
        }
        let [own, others] =
            [of_own, of_others].map(|counts| counts.rate(STRAY_RATE, MAP_STRAY_PRIOR));
        self.stray_ratio = own / others;
        self.stray_rates = (of_place.iter())
            .map(|counts| counts.rate(others, STRAY_PRIOR).min(MAX_STRAY_RATE))
            .collect();
    }

    fn learn_distances(&mut self, seen: &Reobservation, images: &[Image], trials: &[Trial]) {
        let mut false_counts = vec![0_u64; 257];
        for trial in trials {
            if images[trial.image].node == trial.node {
                continue;
            }
            for found in trial
                .records
                .iter()
                .flat_map(|it| &it.found[RATE_SIZE].inliers)
            {
                false_counts[usize::from(found.distance_bits).min(256)] += 1;
            }
        }
        let enough = |counts: &[u64]| counts.iter().sum::<u64>() >= MIN_DISTANCES;
        if !(enough(seen.distances()) && enough(&false_counts)) {
            return;
        }
        // Beyond the matching threshold there is nothing to compare, and the ratio stays 1.
        let threshold = usize::from(largest_distance(seen.distances(), &false_counts));
        let (seen, wrong) = (
            smoothed(seen.distances(), threshold),
            smoothed(&false_counts, threshold),
        );
        for (ratio, (seen, wrong)) in self
            .distance_log_ratios
            .iter_mut()
            .zip(seen.iter().zip(&wrong))
        {
            *ratio = (seen / wrong).ln();
        }
    }

    fn learn_displacement(&mut self, seen: &Reobservation, image_size: Option<(u32, u32)>) {
        if let (Some(spread_px), Some((width, height))) = (seen.spread_px(), image_size)
            && seen.num_displacements() >= MIN_DISPLACEMENTS
        {
            let area_px2 = 4.0 * f64::from(width) * f64::from(height);
            self.displacement = Some(DisplacementPrior {
                spread_px,
                area_px2,
            });
        }
    }

    fn learn_tempers(&mut self, images: &[Image], trials: &[Trial]) {
        let mut asked: Vec<[Vec<Asked>; Score::ALL.len()]> = vec![Default::default(); SIZES.len()];
        let mut memory = <(Expectation, Hits)>::default();
        for (image, trials) in images
            .iter()
            .zip(trials.chunk_by(|a, b| a.image == b.image))
        {
            for (size, asked) in asked.iter_mut().enumerate() {
                for asked in asked.iter_mut() {
                    asked.push(Asked {
                        own: None,
                        others: Vec::new(),
                    });
                }
                for trial in trials {
                    let is_own = image.node == trial.node;
                    let scores = self.scores(&mut memory, trial, is_own, size);
                    for (asked, score) in asked.iter_mut().zip(scores) {
                        let Some(asked) = asked.last_mut() else {
                            continue;
                        };
                        if is_own {
                            asked.own = Some(score);
                        } else {
                            asked.others.push(score);
                        }
                    }
                }
            }
        }
        for (size, asked) in asked.iter().enumerate() {
            for (score, asked) in Score::ALL.into_iter().zip(asked) {
                self.tempers[score as usize][size] = Temper::fit(asked, prior_temper(score));
            }
        }
    }

    /// What a trial scores as evidence, for each score.
    fn scores(
        &self,
        (expectation, hits): &mut (Expectation, Hits),
        trial: &Trial,
        is_own: bool,
        size: usize,
    ) -> [f64; Score::ALL.len()] {
        let (mut count, mut inliers, mut odds) = (0, 0, LogMean::default());
        for record in &trial.records {
            let found = &record.found[size];
            count = count.max(found.num_matches);
            inliers = inliers.max(found.inliers.len() as u32);
            let node = NodeId(trial.node as u32);
            self.restart(expectation, node, record.num_witnesses, &record.likeness);
            let was_found = record.found_at(RATE_SIZE);
            for ((rank, &(feature, score)), was_found) in (record.features.iter().enumerate())
                .take(SIZES[size])
                .zip(was_found.chain(std::iter::repeat(false)))
            {
                // An image's own trial is no evidence about it.
                let but = Trials {
                    tried: u32::from(!is_own && rank < SIZES[RATE_SIZE]),
                    found: u32::from(!is_own && was_found),
                };
                let false_rate = self.false_rate_of(node, record.hypothesis, feature as usize, but);
                let word = record.witnesses.get(rank).copied().unwrap_or(0);
                expectation.push(self.detection_at(node, score), false_rate, word);
            }
            let vote = Vote {
                num_inliers: found.inliers.len() as u32,
                median: found.displacement,
                ..Vote::default()
            };
            let all = vec![true; found.inliers.len()];
            expectation.settle(SIZES[size]);
            let num_strays = found.num_strays();
            odds.push(expectation.log_odds(self, hits, &found.inliers, &all, &vote, num_strays));
        }
        Score::ALL.map(|score| match score {
            Score::Count => f64::from(count),
            Score::Inliers => f64::from(inliers),
            Score::Likelihood => as_evidence(Score::Likelihood, odds.value()),
        })
    }
}

/// A score as it enters the posterior: log odds beyond what any image can prove count as that.
pub(super) fn as_evidence(score: Score, value: f64) -> f64 {
    match score {
        Score::Count | Score::Inliers => value,
        Score::Likelihood => value.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS),
    }
}

/// What the `rank`-th strongest feature of an appearance scores.
fn strength_score(rank: usize) -> f64 {
    -(rank as f64)
}

fn prior_temper(score: Score) -> Temper {
    match score {
        Score::Count | Score::Inliers => Temper {
            scale: 0.5,
            bias: 2.0,
            level: 0.0,
        },
        Score::Likelihood => Temper {
            scale: 0.5,
            bias: 1.0,
            level: 0.0,
        },
    }
}

/// The largest distance that occurs.
fn largest_distance(seen: &[u64], wrong: &[u64]) -> u16 {
    let last = |counts: &[u64]| counts.iter().rposition(|&count| count > 0).unwrap_or(0);
    last(seen).max(last(wrong)) as u16
}

/// The distribution of distances up to `threshold`, each averaged with its neighbours; 1 beyond.
fn smoothed(counts: &[u64], threshold: usize) -> Vec<f64> {
    let total = counts.iter().sum::<u64>() as f64;
    (0..counts.len())
        .map(|distance| {
            if distance > threshold {
                return 1.0;
            }
            let low = distance.saturating_sub(SMOOTHING_BITS);
            let high = (distance + SMOOTHING_BITS).min(threshold);
            let sum = counts[low..=high].iter().sum::<u64>() as f64;
            // Half a count a distance, so that no ratio is 0 or infinite.
            (sum / (high - low + 1) as f64 + 0.5) / (total + 0.5 * (threshold + 1) as f64)
        })
        .collect()
}

/// Of `count` things, at most `limit`, evenly spread.
fn spread(count: usize, limit: usize) -> impl Iterator<Item = usize> {
    let taken = count.min(limit);
    (0..taken).map(move |i| (2 * i + 1) * count / (2 * taken))
}

/// What was counted of the features of `old`, for those of them that are left in `new`, in the same order.
fn renumbered(counts: &[Trials], old: FeaturesView<'_>, new: FeaturesView<'_>) -> Vec<Trials> {
    let mut first = 0;
    let of_feature = (0..new.len()).map(|id| {
        let is_it = |was: &usize| {
            (old.keypoints[*was], old.descriptors[*was]) == (new.keypoints[id], new.descriptors[id])
        };
        let Some(was) = (first..old.len()).find(is_it) else {
            return Trials::default();
        };
        first = was + 1;
        counts.get(was).copied().unwrap_or_default()
    });
    of_feature.collect()
}

/// Matches past visits with the places of `plans`.
fn ask(localizer: &Localizer, plans: &[Arc<Plan>]) -> Result<(Vec<Image>, Vec<Trial>)> {
    let nodes = &localizer.snapshot.nodes;
    let mut places: Vec<HeldOutPlace> = spread(nodes.len(), MAX_PLACES)
        .map(|node| HeldOutPlace::new(&nodes[node], node))
        .collect();
    let images = images_of(nodes, &places);
    places.par_iter_mut().try_for_each(|place| {
        let is_asked = |fold| (images.iter()).any(|it| it.node == place.node && it.fold == fold);
        let asked: Vec<bool> = (0..place.folds.len()).map(is_asked).collect();
        place.fit(localizer, &plans[place.node], &asked)
    })?;
    let others: Vec<usize> = spread(nodes.len(), MAX_OTHERS).collect();
    let trials = (images.par_iter().enumerate())
        .map_init(Scratch::default, |scratch, (index, image)| {
            (plans.iter().enumerate())
                .filter(|(node, _)| image.node == *node || others.binary_search(node).is_ok())
                .filter_map(|(node, plan)| {
                    let own = places
                        .iter()
                        .find(|place| place.node == image.node && image.node == node);
                    let plan = match own {
                        Some(own) => own.plans[image.fold].as_ref()?,
                        None => plan,
                    };
                    localizer.attempt(scratch, (index, image), node, plan, own)
                })
                .collect::<Vec<_>>()
        })
        .flatten_iter()
        .collect();
    Ok((images, trials))
}

/// The visits that are asked for.
fn images_of(nodes: &[Arc<Node>], places: &[HeldOutPlace]) -> Vec<Image> {
    let mut asked = Vec::new();
    for place in places {
        for (fold, mask) in place.folds.iter().enumerate() {
            let visits: Vec<usize> = mask.ones().collect();
            let few = spread(visits.len(), IMAGES_PER_RUN);
            asked.extend(few.map(|index| (place.node, fold, visits[index])));
        }
    }
    let limit = (MAX_TRIALS / nodes.len()).max(MAX_SINGLE_FOLDS);
    spread(asked.len(), limit)
        .map(|index| asked[index])
        .filter_map(|(node, fold, visit)| {
            let features = image_of(&nodes[node], visit);
            (!features.is_empty()).then(|| Image {
                node,
                fold,
                time: nodes[node].visits[visit].time,
                features,
            })
        })
        .collect()
}

/// What the camera saw at a past visit, as far as the map remembers.
fn image_of(node: &Node, visit: usize) -> Features {
    if let Some(appearance) = &node.visits[visit].appearance {
        return (**appearance).clone();
    }
    let seen: Vec<u32> = (node.log.seen_row(visit).ones())
        .map(|feature| feature as u32)
        .collect();
    let mut features = Features::new();
    features.gather(&node.features, &seen);
    features
}

impl HeldOutPlace {
    fn new(place: &Node, node: usize) -> Self {
        let num_visits = place.log.num_visits();
        let num_folds = match num_visits {
            0 | 1 => 0,
            few if few <= MAX_SINGLE_FOLDS => few,
            _ => NUM_RUNS,
        };
        let mut folds = vec![BitRow::zeros(num_visits); num_folds];
        if num_folds > 0 {
            for visit in 0..num_visits {
                folds[visit * num_folds / num_visits].set(visit);
            }
        }
        Self {
            node,
            folds,
            plans: Vec::new(),
        }
    }

    /// Fits the place without each fold that is asked for.
    fn fit(&mut self, localizer: &Localizer, plan: &Plan, asked: &[bool]) -> Result<()> {
        let place = &localizer.snapshot.nodes[self.node];
        for (fold, &is_asked) in self.folds.iter().zip(asked) {
            let mut rest = BitRow::zeros(fold.len());
            (0..fold.len())
                .filter(|&visit| !fold.get(visit))
                .for_each(|visit| rest.set(visit));
            self.plans.push(if is_asked {
                Some(plan.without(place, localizer.cfg(), fold, &rest)?)
            } else {
                None
            });
        }
        Ok(())
    }
}

impl Plan {
    /// The same learnt from `rest` only, which is every visit but those of `fold`.
    fn without(
        &self,
        node: &Node,
        cfg: &super::LocalizerConfig,
        fold: &BitRow,
        rest: &BitRow,
    ) -> Result<Self> {
        Ok(match self {
            Self::Predicted { .. } => Self::Predicted {
                model: visibility::fit(&node.log, &cfg.model(), Visits::Only(rest))?,
                witnesses: Witnesses::of(&node.log, Visits::Only(rest))?,
            },
            // Which appearances are likely is not learnt again.
            Self::Appearances { visits, .. } => Self::Appearances {
                visits: (visits.iter().copied())
                    .filter(|&visit| !fold.get(visit as usize))
                    .collect(),
                likely: None,
            },
        })
    }

    /// No trials, of each feature of each hypothesis.
    fn empty_trials(&self, node: &Node) -> Vec<Vec<Trials>> {
        match self {
            Self::Predicted { .. } => vec![vec![Trials::default(); node.features.len()]],
            Self::Appearances { .. } => (node.visits.iter())
                .map(|visit| {
                    let len = visit.appearance.as_ref().map_or(0, |it| it.len());
                    vec![Trials::default(); len.min(SIZES[RATE_SIZE])]
                })
                .collect(),
        }
    }
}

impl Localizer {
    /// Matches a place with a past visit; `None` if nothing of the place is known without that visit.
    fn attempt(
        &self,
        scratch: &mut Scratch,
        (index, image): (usize, &Image),
        node: usize,
        plan: &Plan,
        own: Option<&HeldOutPlace>,
    ) -> Option<Trial> {
        let id = NodeId(node as u32);
        let place = self.snapshot.node(id);
        let most = SIZES[SIZES.len() - 1];
        let mut records = Vec::new();
        match plan {
            Plan::Predicted { model, witnesses } => {
                // What was born in the held-out visits is left out, so more has to be asked for.
                let selection = Selection::Top(if own.is_some() { 2 * most } else { most });
                let predicted = &mut scratch.predicted;
                self.choose(predicted, model.as_ref(), witnesses, image.time, selection);
                let predicted = &scratch.predicted;
                let is_known = |feature: u32| {
                    own.is_none_or(|own| {
                        !own.folds[image.fold].get(place.log.birth(feature as usize))
                    })
                };
                let ids: Vec<u32> = (predicted.features().iter().copied())
                    .filter(|&feature| is_known(feature))
                    .take(most)
                    .collect();
                let features = (ids.iter())
                    .map(|&id| (id, predicted.scores()[id as usize]))
                    .collect();
                let words = ids
                    .iter()
                    .map(|&id| witnesses.seen()[id as usize])
                    .collect();
                scratch.ranked.gather(&place.features, &ids);
                let ranked = std::mem::take(&mut scratch.ranked);
                records.push(Record {
                    hypothesis: 0,
                    features,
                    witnesses: words,
                    num_witnesses: witnesses.num_visits(),
                    likeness: predicted.likeness().to_vec(),
                    found: self.find(scratch, ranked.view(), image),
                });
                scratch.ranked = ranked;
            }
            plan @ Plan::Appearances { .. } => {
                plan.visits_into(image.time, &mut scratch.likely, &mut scratch.visits);
                let visits = std::mem::take(&mut scratch.visits);
                for at in spread(visits.len(), MAX_APPEARANCES) {
                    let ranked = self.appearance(id, visits[at], most);
                    records.push(Record {
                        hypothesis: visits[at] as usize,
                        features: (0..ranked.len())
                            .map(|rank| (rank as u32, strength_score(rank)))
                            .collect(),
                        witnesses: Vec::new(),
                        num_witnesses: 0,
                        likeness: Vec::new(),
                        found: self.find(scratch, ranked, image),
                    });
                }
                scratch.visits = visits;
            }
        }
        records.retain(|record| !record.features.is_empty());
        (!records.is_empty()).then_some(Trial {
            image: index,
            node,
            records,
        })
    }

    fn find(
        &self,
        scratch: &mut Scratch,
        ranked: FeaturesView<'_>,
        image: &Image,
    ) -> [Found; SIZES.len()] {
        let mut all: [Found; SIZES.len()] = Default::default();
        let live = image.features.view();
        let Scratch {
            matching, verify, ..
        } = scratch;
        (self.matcher).prefixes_into(matching, ranked, live, &SIZES, |size, matches| {
            let vote = verify.vote(&self.cfg, matches, ranked, live);
            let inliers = matches.iter().zip(verify.vote.inliers());
            all[size] = Found {
                num_matches: matches.len() as u32,
                inliers: (inliers.filter(|(_, is_inlier)| **is_inlier))
                    .map(|(found, _)| *found)
                    .collect(),
                displacement: vote.median,
            };
        });
        all
    }
}

impl Record {
    fn strays(&self) -> StrayCounts {
        let found = &self.found[RATE_SIZE];
        let num_asked = self.features.len().min(SIZES[RATE_SIZE]);
        let num_unmatched = num_asked.saturating_sub(found.inliers.len());
        StrayCounts {
            num_unmatched,
            num_strays: found.num_strays().min(num_unmatched),
        }
    }

    /// Whether each of the first features was found, at one of [`SIZES`].
    fn found_at(&self, size: usize) -> impl Iterator<Item = bool> + use<> {
        let mut found = vec![false; self.features.len().min(SIZES[size])];
        for inlier in &self.found[size].inliers {
            if let Some(found) = found.get_mut(inlier.map as usize) {
                *found = true;
            }
        }
        found.into_iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Keypoint};

    #[test]
    fn counts_follow_their_features() {
        let features = |numbers: &[u64]| {
            let mut features = Features::new();
            for &number in numbers {
                let keypoint = Keypoint {
                    x: number as f32,
                    y: 0.0,
                    size: 1.0,
                    response: 1.0,
                };
                features.push(keypoint, Descriptor([number % 3, 0, 0, 0]));
            }
            features
        };
        let trials = |tried: u32| Trials { tried, found: 0 };
        let old = features(&[10, 11, 12, 13, 14]);
        let counts = [0, 1, 2, 3].map(trials);
        let new = features(&[11, 13, 14, 20, 10]);
        let expected = [1, 3, 0, 0, 0].map(trials);
        let found = renumbered(&counts, old.view(), new.view());
        assert_eq!(
            found, expected,
            "nothing is known of 14, 20 is new, 10 is out of order"
        );
    }
}

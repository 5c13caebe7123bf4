//! What do matches at the right place and at wrong places look like?
//!
//! A [`Calibration`] is learnt from the map alone: its past visits are held out and matched with
//! all places as if they were live (`held_out.rs`), and what matches and what does not is counted.
//!
//! How much a matching distance tells is the ratio of g1 (seen again, counted while the map was
//! learnt, [`Reobservation`]) and g0 (found at wrong places). All rates are drawn to those of the
//! whole map by priors that are counted in features.
//!
//! Cost: that of matching the held-out visits. Sums are taken in a fixed order, so the result does
//! not depend on the number of threads.
//!
//! In a map of a single run nothing can be held out; what is learnt then is what wrong places look
//! like, and the rest is what is usual over many maps ([`Calibration::uninformed`]).

use std::sync::Arc;

use super::conditions::{self, CONDITIONS, Conditions, learn_conditions};
use super::curve::Curve;
use super::expectation::{Expectation, Hits, LogMean};
use super::held_out::{Found, OutlierCounts, RATE_SIZE, Record, Trial, match_held_out};
use super::posterior::{
    HeldOutScores, PlaceEvidence, PosteriorCalibration, as_evidence, prior_calibration,
};
use super::rates::{
    Calibration, DisplacementPrior, FALSE_RATE, FALSE_RATE_PRIOR, MAX_OUTLIER_RATE, SIZES, Trials,
};
use crate::localize::config::{Method, Score};
use crate::localize::neighbours::{MAX_REACH, Neighbours};
use crate::localize::plan::{Plan, PlannedMap};
use crate::localize::verify::Verified;
use crate::map::{Node, NodeId, Reobservation};
use crate::matching::Vote;
use fremen::error::Result;

/// So many expected features, all found, are added to those of each place.
const REPEATABILITY_PRIOR: f64 = 30.0;
/// So many unmatched features at the mean rate of outlier matches are added to those of each place.
const OUTLIER_PRIOR: f64 = 200.0;
/// The rate of outlier matches while nothing is known.
const OUTLIER_RATE: f64 = 0.15;
/// So many features at that rate are added to those of the whole map.
const MAP_OUTLIER_PRIOR: f64 = 100.0;
/// Distances are smoothed over so many bits to each side.
const SMOOTHING_BITS: usize = 3;
/// Fewer counted distances say nothing.
const MIN_DISTANCES: u64 = 50;
/// Fewer counted displacements say nothing.
const MIN_DISPLACEMENTS: u64 = 5;
/// So many features that were looked for at the mean rate are added to those of each place.
const PLACE_FALSE_RATE_PRIOR: f64 = 300.0;
/// So many images at the mean level are added to those of each place.
const LEVEL_PRIOR: f64 = 4.0;
/// So many distances of the usual ratio are added to those of the map.
const DISTANCE_PRIOR: f64 = 200.0;
/// Places of which this share look alike do.
const ALIKE_SHARE: f64 = 0.25;
/// What fewer than one in a hundred far places reach by chance is no chance.
const FAR_SHARE: f64 = 0.99;
/// So few inliers show nothing, even where there are no far places to compare with.
const MIN_ALIKE_INLIERS: usize = 20;
/// Inliers in the image of a place that looks alike, as a share of those in an own image, and of
/// the features that were looked for.
const OWN_INLIERS_SHARE: f64 = 0.5;
const TRIED_SHARE: f64 = 0.15;
/// So many visits a place, and half of what was learnt is believed.
const TRUSTED_BY: f64 = 6.6;
/// The method that keeps every appearance.
const EVERYTHING: Method = Method::ExperienceAll;

impl Calibration {
    /// Learns from the past visits of `map`.
    pub(in crate::localize) fn learn(map: &PlannedMap) -> Result<Self> {
        let mut calibration = Self::uninformed();
        // What a feature of an appearance is worth does not depend on which appearances a method
        // uses, so that is learnt from all of them; what the scores are worth, from the method's
        // own.
        let everything: Option<Vec<Arc<Plan>>> = match map.cfg.method() {
            Method::Static | Method::Fremen | Method::Fused | Method::ExperienceAll => None,
            Method::Experience | Method::Freex => Some(
                (map.snapshot.nodes().iter())
                    .map(|node| {
                        let cfg = map.cfg.clone().with_method(EVERYTHING);
                        Plan::of(node, &cfg, map.zone.as_ref()).map(Arc::new)
                    })
                    .collect::<Result<_>>()?,
            ),
        };
        calibration.neighbours = Neighbours::of(&map.snapshot);
        let plans = everything.as_ref().unwrap_or(&map.plans);
        let (visits, trials) = match_held_out(map, plans, &calibration.neighbours)?;
        calibration.num_images = visits.len();
        calibration.neighbours = calibration.neighbours.with_reach(reach(&trials));
        let of_own = trials.iter().filter(|it| it.steps == Some(0));
        calibration.spread = conditions::spread(of_own.count());
        calibration.trust = trust(map.snapshot.nodes().iter().map(|node| node.visits().len()));
        calibration.learn_rates(map, &trials);
        calibration.learn_outliers(map.plans.len(), &trials);
        let seen = Reobservation::of(&map.snapshot)?;
        calibration.learn_distances(&seen, &trials);
        calibration.learn_displacement(&seen, map.snapshot.meta().image_size);
        calibration.forget(map.cfg.without());
        calibration.learn_conditions(&trials);
        calibration.learn_levels(map.plans.len(), &trials);
        let trials = match everything {
            None => trials,
            Some(_) => match_held_out(map, &map.plans, &calibration.neighbours)?.1,
        };
        calibration.learn_posteriors(&trials);
        Ok(calibration)
    }

    fn learn_rates(&mut self, map: &PlannedMap, trials: &[Trial]) {
        let mut samples = Vec::new();
        self.false_counts = (map.snapshot.nodes().iter().zip(&map.plans))
            .map(|(node, plan)| no_trials(plan, node))
            .collect();
        let mut all = Trials::default();
        let mut of_place = vec![Trials::default(); map.plans.len()];
        for trial in trials {
            let place = self.place_of(trial);
            if matches!(place, TrialPlace::Alike | TrialPlace::Doubtful) {
                continue;
            }
            for record in &trial.records {
                let found = record.found_at(RATE_SIZE);
                for (&(feature, score), found) in record.features.iter().zip(found) {
                    if place == TrialPlace::Own {
                        samples.push((score, found));
                        continue;
                    }
                    let counts = &mut self.false_counts[trial.node][record.hypothesis];
                    let of_place = &mut of_place[trial.node];
                    for counts in [&mut counts[feature as usize], of_place, &mut all] {
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
            self.repeatability = self.learn_repeatability(map.plans.len(), trials);
        }
        self.false_rate = (f64::from(all.found) + FALSE_RATE * FALSE_RATE_PRIOR)
            / (f64::from(all.tried) + FALSE_RATE_PRIOR);
        self.place_false_rates = (of_place.iter())
            .map(|trials| {
                let found = f64::from(trials.found) + PLACE_FALSE_RATE_PRIOR * self.false_rate;
                found / (f64::from(trials.tried) + PLACE_FALSE_RATE_PRIOR)
            })
            .collect();
    }

    /// For each place, found over expected features, drawn to 1 by [`REPEATABILITY_PRIOR`] expected
    /// ones.
    fn learn_repeatability(&self, num_places: usize, trials: &[Trial]) -> Vec<f64> {
        let mut found = vec![REPEATABILITY_PRIOR; num_places];
        let mut expected = found.clone();
        for trial in trials {
            if self.place_of(trial) != TrialPlace::Own {
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

    /// How often features that are not found have an outlier match.
    ///
    /// What other places' images show is counted for each place; what its own show, which are few,
    /// for the whole map.
    fn learn_outliers(&mut self, num_places: usize, trials: &[Trial]) {
        let [mut of_own, mut of_others] = [OutlierCounts::default(); 2];
        let mut of_place = vec![OutlierCounts::default(); num_places];
        for trial in trials {
            for counts in trial.records.iter().map(Record::outliers) {
                match self.place_of(trial) {
                    TrialPlace::Own => of_own += counts,
                    TrialPlace::Alike | TrialPlace::Doubtful => {}
                    TrialPlace::Other => {
                        of_others += counts;
                        of_place[trial.node] += counts;
                    }
                }
            }
        }
        let others = of_others.rate(OUTLIER_RATE, MAP_OUTLIER_PRIOR);
        self.outlier_ratio = of_own.rate(others, MAP_OUTLIER_PRIOR) / others;
        self.outlier_rates = (of_place.iter())
            .map(|counts| counts.rate(others, OUTLIER_PRIOR).min(MAX_OUTLIER_RATE))
            .collect();
    }

    fn learn_distances(&mut self, seen: &Reobservation, trials: &[Trial]) {
        let mut false_counts = vec![0_u64; 257];
        for trial in trials {
            if self.place_of(trial) != TrialPlace::Other {
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
        let num = |counts: &[u64]| counts.iter().sum::<u64>();
        let num_counted = num(seen.distances()).min(num(&false_counts));
        if num_counted < MIN_DISTANCES {
            return;
        }
        let own = num_counted as f64 / (num_counted as f64 + DISTANCE_PRIOR);
        // Beyond the matching threshold there is nothing to compare, and the ratio stays 1.
        let threshold = usize::from(largest_distance(seen.distances(), &false_counts));
        let (seen, wrong) = (
            smoothed(seen.distances(), threshold),
            smoothed(&false_counts, threshold),
        );
        let ratios = self.distance_log_ratios.iter_mut().take(threshold + 1);
        for (ratio, (seen, wrong)) in ratios.zip(seen.iter().zip(&wrong)) {
            *ratio += own * ((seen / wrong).ln() - *ratio);
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

    fn learn_posteriors(&mut self, trials: &[Trial]) {
        let mut memory = <(Expectation, Hits)>::default();
        for size in 0..SIZES.len() {
            let mut by_score: [Vec<HeldOutScores>; Score::ALL.len()] = Default::default();
            let trials_of_visits = trials.chunk_by(|a, b| a.visit == b.visit);
            for trials in trials_of_visits {
                let mut of_visit = Score::ALL.map(|_| HeldOutScores::default());
                for trial in trials {
                    let scores = self.scores(&mut memory, trial, size);
                    for (known, score) in of_visit.iter_mut().zip(scores) {
                        match self.place_of(trial) {
                            TrialPlace::Own => known.own = Some(score),
                            TrialPlace::Alike => known.alike.push(score),
                            TrialPlace::Doubtful => {}
                            TrialPlace::Other => known.others.push(score),
                        }
                    }
                }
                for (all, of_visit) in by_score.iter_mut().zip(of_visit) {
                    all.push(of_visit);
                }
            }
            for (score, held_out) in Score::ALL.into_iter().zip(&by_score) {
                self.posteriors[score as usize][size] =
                    PosteriorCalibration::fit(held_out, prior_calibration(score));
            }
        }
    }

    /// What a trial scores as evidence, for each score.
    fn scores(
        &self,
        (expectation, hits): &mut (Expectation, Hits),
        trial: &Trial,
        size: usize,
    ) -> [PlaceEvidence; Score::ALL.len()] {
        let (mut count, mut inliers) = (0, 0);
        let [mut odds, mut of_nothing] = [LogMean::default(); 2];
        for record in &trial.records {
            let found = &record.found[size];
            count = count.max(found.num_matches);
            inliers = inliers.max(found.inliers.len() as u32);
            self.expect(expectation, trial, record, size);
            let are_inliers = vec![true; found.inliers.len()];
            odds.push(expectation.log_odds(self, hits, &verified(found, &are_inliers)));
            of_nothing.push(expectation.of_nothing());
        }
        Score::ALL.map(|score| {
            let value = match score {
                Score::Count => f64::from(count),
                Score::Inliers => f64::from(inliers),
                Score::Likelihood => odds.value(),
            };
            as_evidence(score, value, of_nothing.value())
        })
    }

    /// What each feature of a record would say at one of [`SIZES`].
    fn expect(&self, expectation: &mut Expectation, trial: &Trial, record: &Record, size: usize) {
        let node = NodeId(trial.node as u32);
        let is_counted = self.place_of(trial) == TrialPlace::Other;
        expectation.restart(self, node, record.num_references, &record.similarity);
        let was_found = record.found_at(RATE_SIZE);
        for ((rank, &(feature, score)), was_found) in (record.features.iter().enumerate())
            .take(record.num_tried[size])
            .zip(was_found.chain(std::iter::repeat(false)))
        {
            // An image's own trial is no evidence about it.
            let but = Trials {
                tried: u32::from(is_counted && rank < record.num_tried[RATE_SIZE]),
                found: u32::from(is_counted && was_found),
            };
            let false_rate = self.false_rate_of(node, record.hypothesis, feature as usize, but);
            let word = record.references.get(rank).copied().unwrap_or(0);
            expectation.push(self.detection_at(node, score), false_rate, word);
        }
        expectation.finalize(record.num_tried[size]);
    }

    /// What each place scores in images that do not show it, drawn to the mean over all places.
    fn learn_levels(&mut self, num_places: usize, trials: &[Trial]) {
        let mut memory = <(Expectation, Hits)>::default();
        let mut of_place = vec![(0.0, 0.0); num_places];
        let [mut sum, mut count] = [0.0; 2];
        for trial in trials
            .iter()
            .filter(|it| self.place_of(it) == TrialPlace::Other)
        {
            let [.., odds] = self.scores(&mut memory, trial, RATE_SIZE);
            let (odds, of_place) = (odds.score, &mut of_place[trial.node]);
            *of_place = (of_place.0 + odds, of_place.1 + 1.0);
            sum += odds;
            count += 1.0;
        }
        if count > 0.0 {
            let mean = sum / count;
            let level =
                |(sum, count): (f64, f64)| (sum + LEVEL_PRIOR * mean) / (count + LEVEL_PRIOR);
            self.levels = of_place.into_iter().map(level).collect();
        }
    }

    /// Under which conditions the held-out images show their own place.
    fn learn_conditions(&mut self, trials: &[Trial]) {
        let (mut expectation, mut hits) = <(Expectation, Hits)>::default();
        let of_own = trials
            .iter()
            .filter(|it| self.place_of(it) == TrialPlace::Own);
        let images: Vec<Conditions> = of_own
            .map(|trial| {
                let mut most = [f64::NEG_INFINITY; CONDITIONS.len()];
                for record in &trial.records {
                    let found = &record.found[RATE_SIZE];
                    self.expect(&mut expectation, trial, record, RATE_SIZE);
                    let are_inliers = vec![true; found.inliers.len()];
                    let verified = verified(found, &are_inliers);
                    let logs = expectation.log_odds_by_condition(&mut hits, &verified);
                    for (most, log) in most.iter_mut().zip(logs) {
                        *most = log.max(*most);
                    }
                }
                most
            })
            .collect();
        self.conditions = learn_conditions(&images);
    }

    /// What a trial's place is to its image.
    fn place_of(&self, trial: &Trial) -> TrialPlace {
        match trial.steps {
            Some(0) => TrialPlace::Own,
            Some(steps) if steps <= self.neighbours.reach() => TrialPlace::Alike,
            // Where places look alike, those a little farther on still share some features.
            Some(steps)
                if self.neighbours.reach() > 0 && steps <= 2 * self.neighbours.reach() + 1 =>
            {
                TrialPlace::Doubtful
            }
            _ => TrialPlace::Other,
        }
    }
}

/// What a place is to an image that it is matched with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TrialPlace {
    /// The image shows it.
    Own,
    /// The image shows a part of it, from next to it.
    Alike,
    /// It is not far, and the image may show a little of it: no evidence of anything.
    Doubtful,
    /// The image shows another place.
    Other,
}

/// What was found, as if it had been verified just now.
fn verified<'a>(found: &'a Found, are_inliers: &'a [bool]) -> Verified<'a> {
    Verified {
        matches: &found.inliers,
        inliers: are_inliers,
        vote: Vote {
            num_inliers: found.inliers.len() as u32,
            median: found.displacement,
            ..Vote::default()
        },
        num_outliers: found.num_outliers(),
    }
}

/// How many links apart places still look alike: as far as at least [`ALIKE_SHARE`] of them have
/// more inliers in each other's images than [`FAR_SHARE`] of those that are far apart, and about as
/// many as places have in their own.
fn reach(trials: &[Trial]) -> usize {
    let inliers = |trial: &Trial| {
        let of = |record: &Record| record.found[SIZES.len() - 1].inliers.len();
        trial.records.iter().map(of).max().unwrap_or(0)
    };
    let mut far: Vec<usize> = (trials.iter().filter(|it| it.steps.is_none()))
        .map(inliers)
        .collect();
    far.sort_unstable();
    let of_far = far.get((far.len() as f64 * FAR_SHARE) as usize).copied();
    let least = of_far.unwrap_or(0).max(MIN_ALIKE_INLIERS);
    let mut of_own: Vec<usize> = (trials.iter().filter(|it| it.steps == Some(0)))
        .map(inliers)
        .collect();
    of_own.sort_unstable();
    let usual = of_own
        .get(of_own.len() / 2)
        .map_or(0.0, |&usual| usual as f64);
    let tried = |trial: &Trial| {
        let of = |record: &Record| record.features.len();
        trial.records.iter().map(of).max().unwrap_or(0) as f64
    };
    let is_alike = |trial: &&Trial| {
        let found = inliers(trial);
        found > least
            && found as f64 >= OWN_INLIERS_SHARE * usual
            && found as f64 >= TRIED_SHARE * tried(trial)
    };
    (1..=MAX_REACH)
        .take_while(|&steps| {
            let at = || trials.iter().filter(|it| it.steps == Some(steps));
            let (num_alike, num) = (at().filter(is_alike).count(), at().count());
            num > 0 && num_alike as f64 >= ALIKE_SHARE * num as f64
        })
        .count()
}

/// How much what was learnt of a map is believed whose places have so many visits.
fn trust(num_visits: impl ExactSizeIterator<Item = usize>) -> f64 {
    let num_places = num_visits.len().max(1) as f64;
    let mean = num_visits.sum::<usize>() as f64 / num_places;
    1.0 - 1.0 / (1.0 + (mean / TRUSTED_BY).powi(3))
}

/// No trials, of each feature of each hypothesis.
fn no_trials(plan: &Plan, node: &Node) -> Vec<Vec<Trials>> {
    match plan {
        Plan::Predicted { .. } => vec![vec![Trials::default(); node.features().len()]],
        Plan::Appearances { .. } => (node.visits().iter())
            .map(|visit| {
                let len = visit.appearance.as_ref().map_or(0, |it| it.len());
                vec![Trials::default(); len.min(SIZES[RATE_SIZE])]
            })
            .collect(),
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

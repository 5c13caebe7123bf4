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
//! Not for maps of a single visit a place: nothing can be held out, and the values are those of
//! [`Calibration::uninformed`].

use std::sync::Arc;

use super::curve::Curve;
use super::expectation::{Expectation, Hits, LogMean};
use super::held_out::{HeldOutVisit, OutlierCounts, RATE_SIZE, Trial, match_held_out};
use super::posterior::{HeldOutScores, PosteriorCalibration, as_evidence, prior_calibration};
use super::rates::{
    Calibration, DisplacementPrior, FALSE_RATE, FALSE_RATE_PRIOR, MAX_OUTLIER_RATE, SIZES, Trials,
};
use crate::localize::config::{Method, Score};
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
                (map.snapshot.nodes.iter())
                    .map(|node| {
                        let cfg = map.cfg.clone().with_method(EVERYTHING);
                        Plan::of(node, &cfg).map(Arc::new)
                    })
                    .collect::<Result<_>>()?,
            ),
        };
        let (visits, trials) = match_held_out(map, everything.as_ref().unwrap_or(&map.plans))?;
        calibration.num_images = visits.len();
        calibration.learn_rates(map, &visits, &trials);
        calibration.learn_outliers(map.plans.len(), &visits, &trials);
        let seen = Reobservation::of(&map.snapshot)?;
        calibration.learn_distances(&seen, &visits, &trials);
        calibration.learn_displacement(&seen, map.snapshot.meta.image_size);
        calibration.forget(map.cfg.without());
        let trials = match everything {
            None => trials,
            Some(_) => match_held_out(map, &map.plans)?.1,
        };
        calibration.learn_posteriors(&visits, &trials);
        Ok(calibration)
    }

    fn learn_rates(&mut self, map: &PlannedMap, visits: &[HeldOutVisit], trials: &[Trial]) {
        let mut samples = Vec::new();
        self.false_counts = (map.snapshot.nodes.iter().zip(&map.plans))
            .map(|(node, plan)| no_trials(plan, node))
            .collect();
        let mut all = Trials::default();
        for trial in trials {
            let is_own = visits[trial.visit].node == trial.node;
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
            self.repeatability = self.learn_repeatability(map.plans.len(), visits, trials);
        }
        self.false_rate = (f64::from(all.found) + FALSE_RATE * FALSE_RATE_PRIOR)
            / (f64::from(all.tried) + FALSE_RATE_PRIOR);
    }

    /// For each place, found over expected features, drawn to 1 by [`REPEATABILITY_PRIOR`] expected
    /// ones.
    fn learn_repeatability(
        &self,
        num_places: usize,
        visits: &[HeldOutVisit],
        trials: &[Trial],
    ) -> Vec<f64> {
        let mut found = vec![REPEATABILITY_PRIOR; num_places];
        let mut expected = found.clone();
        for trial in trials {
            if visits[trial.visit].node != trial.node {
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
    fn learn_outliers(&mut self, num_places: usize, visits: &[HeldOutVisit], trials: &[Trial]) {
        let [mut of_own, mut of_others] = [OutlierCounts::default(); 2];
        let mut of_place = vec![OutlierCounts::default(); num_places];
        for trial in trials {
            let is_own = visits[trial.visit].node == trial.node;
            for record in &trial.records {
                let counts = record.outliers();
                if is_own {
                    of_own += counts;
                } else {
                    of_others += counts;
                    of_place[trial.node] += counts;
                }
            }
        }
        let [own, others] =
            [of_own, of_others].map(|counts| counts.rate(OUTLIER_RATE, MAP_OUTLIER_PRIOR));
        self.outlier_ratio = own / others;
        self.outlier_rates = (of_place.iter())
            .map(|counts| counts.rate(others, OUTLIER_PRIOR).min(MAX_OUTLIER_RATE))
            .collect();
    }

    fn learn_distances(&mut self, seen: &Reobservation, visits: &[HeldOutVisit], trials: &[Trial]) {
        let mut false_counts = vec![0_u64; 257];
        for trial in trials {
            if visits[trial.visit].node == trial.node {
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

    fn learn_posteriors(&mut self, visits: &[HeldOutVisit], trials: &[Trial]) {
        let mut memory = <(Expectation, Hits)>::default();
        for size in 0..SIZES.len() {
            let mut by_score: [Vec<HeldOutScores>; Score::ALL.len()] = Default::default();
            let trials_of_visits = trials.chunk_by(|a, b| a.visit == b.visit);
            for (visit, trials) in visits.iter().zip(trials_of_visits) {
                let mut of_visit = Score::ALL.map(|_| HeldOutScores::default());
                for trial in trials {
                    let is_own = visit.node == trial.node;
                    let scores = self.scores(&mut memory, trial, is_own, size);
                    for (known, score) in of_visit.iter_mut().zip(scores) {
                        if is_own {
                            known.own = Some(score);
                        } else {
                            known.others.push(score);
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
        is_own: bool,
        size: usize,
    ) -> [f64; Score::ALL.len()] {
        let (mut count, mut inliers, mut odds) = (0, 0, LogMean::default());
        for record in &trial.records {
            let found = &record.found[size];
            count = count.max(found.num_matches);
            inliers = inliers.max(found.inliers.len() as u32);
            let node = NodeId(trial.node as u32);
            expectation.restart(self, node, record.num_references, &record.similarity);
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
                let word = record.references.get(rank).copied().unwrap_or(0);
                expectation.push(self.detection_at(node, score), false_rate, word);
            }
            let verified = Verified {
                matches: &found.inliers,
                inliers: &vec![true; found.inliers.len()],
                vote: Vote {
                    num_inliers: found.inliers.len() as u32,
                    median: found.displacement,
                    ..Vote::default()
                },
                num_outliers: found.num_outliers(),
            };
            expectation.finalize(SIZES[size]);
            odds.push(expectation.log_odds(self, hits, &verified));
        }
        Score::ALL.map(|score| match score {
            Score::Count => f64::from(count),
            Score::Inliers => f64::from(inliers),
            Score::Likelihood => as_evidence(Score::Likelihood, odds.value()),
        })
    }
}

/// No trials, of each feature of each hypothesis.
fn no_trials(plan: &Plan, node: &Node) -> Vec<Vec<Trials>> {
    match plan {
        Plan::Predicted { .. } => vec![vec![Trials::default(); node.features.len()]],
        Plan::Appearances { .. } => (node.visits.iter())
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

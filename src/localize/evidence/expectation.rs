//! What would each feature say, matched or missing, and what do the matches of an image say
//! together?
//!
//! An [`Expectation`] sums the formula of this room's documentation: what an image says in which
//! nothing matched is summed up beforehand ([`finalize`](Expectation::finalize)), so that the
//! evidence of an image costs time for its matches only.
//!
//! Cost: 4 logarithms a feature and condition, and one addition a feature, condition and reference
//! visit for each prediction; for each image one addition a match, condition and reference visit,
//! and an exponential for each pair of condition and reference visit that matters.

use super::conditions::{CONDITIONS, Conditions, USUAL};
use super::rates::{Calibration, OutlierRatios, Trials};
use crate::localize::verify::Verified;
use crate::map::NodeId;
use crate::predict::{PredictedMap, ReferenceVisits};

/// How often a feature of one visit is detected in another one that looks the same.
const REPEATABILITY: f64 = 0.8;
/// How much a reference visit is believed over the model of the single feature.
const REFERENCE_WEIGHT: f64 = 0.5;
/// Probabilities of a match stay below this.
const MAX_DETECTION: f64 = 0.97;
/// Terms of a sum that are smaller than the largest by a factor of `exp` of this are left out.
const NEGLIGIBLE: f64 = 30.0;

/// The log odds of a place of which nothing is remembered.
pub(in crate::localize) const NO_EVIDENCE: f64 = -1000.0;

/// What each feature of a predicted map or appearance would say, matched or missing; memory that is
/// used again.
#[derive(Clone, Debug, Default)]
pub(in crate::localize) struct Expectation {
    /// Log ratio of a missing feature that the reference visit did not see, under each condition.
    missing: Vec<Conditions>,
    /// What is added if it is matched.
    matched: Vec<Conditions>,
    /// What is added if the reference visit saw it and it is missing.
    missing_seen: Vec<Conditions>,
    /// What is added to that if the reference visit saw it and it is matched.
    matched_seen: Vec<Conditions>,
    /// One bit a reference visit.
    words: Vec<u64>,
    outliers: OutlierRatios,
    /// What the place scores where it is not.
    level: f64,
    /// What part of the log odds of nothing is left out, and those odds.
    discount: f64,
    of_nothing: f64,
    num_references: usize,
    /// ln of how much each reference visit counts, which is 1 on average; nothing where all count
    /// alike.
    log_weights: Vec<f64>,
    /// So many features take part.
    num_finalized: usize,
    /// How much more or less often features are found, under each condition.
    conditions: Conditions,
    /// ln of the prior of each condition, and of their sum where all are missing, without what
    /// reference visits add.
    log_prior: Conditions,
    nothing: Conditions,
    /// What each reference visit adds where all are missing: those of the first condition, then
    /// those of the next.
    nothing_seen: Vec<f64>,
}

/// Features that were found, with the distance of the match; memory that is used again.
#[derive(Clone, Debug, Default)]
pub(in crate::localize) struct Hits(Vec<(u32, u16)>);

impl Hits {
    /// Those of the inliers among the first `len` features, ascending; of several matches of one
    /// feature the nearest counts.
    fn gather(&mut self, len: usize, verified: &Verified<'_>) -> &[(u32, u16)] {
        self.0.clear();
        let agreeing = (verified.matches.iter())
            .zip(verified.inliers)
            .filter(|(_, is_inlier)| **is_inlier);
        (self.0).extend(agreeing.map(|(found, _)| (found.map, found.distance_bits)));
        self.0.retain(|hit| (hit.0 as usize) < len);
        self.0.sort_unstable();
        self.0.dedup_by_key(|hit| hit.0);
        &self.0
    }
}

impl Expectation {
    /// Starts over for the predicted map of a place, whose reference visits count as much as their
    /// `similarity` says; alike, where it says nothing.
    pub(super) fn restart(
        &mut self,
        calibration: &Calibration,
        node: NodeId,
        num_references: usize,
        similarity: &[f64],
    ) {
        let outliers = calibration.outlier_ratios(node);
        self.level = calibration.level(node);
        self.discount = calibration.discount();
        self.conditions = CONDITIONS.map(|condition| condition.powf(calibration.spread));
        self.log_prior = calibration.conditions.map(f64::ln);
        if calibration.uses_references {
            self.restart_weighted(num_references, outliers, similarity);
        } else {
            self.restart_alone(outliers);
        }
    }

    /// Starts over without reference visits.
    fn restart_alone(&mut self, outliers: OutlierRatios) {
        self.restart_weighted(0, outliers, &[]);
    }

    fn restart_weighted(
        &mut self,
        num_references: usize,
        outliers: OutlierRatios,
        similarity: &[f64],
    ) {
        self.outliers = outliers;
        self.missing.clear();
        self.matched.clear();
        self.missing_seen.clear();
        self.matched_seen.clear();
        self.words.clear();
        self.num_references = num_references;
        let mean = similarity.iter().sum::<f64>() / similarity.len().max(1) as f64;
        self.log_weights.clear();
        (self.log_weights).extend(similarity.iter().map(|similarity| (similarity / mean).ln()));
        self.forget_sums();
    }

    /// Starts over with what each feature of a predicted map would say.
    pub(in crate::localize) fn expect_predicted(
        &mut self,
        calibration: &Calibration,
        node: NodeId,
        predicted: &PredictedMap,
        references: &ReferenceVisits,
    ) {
        let num_references = references.num_visits();
        self.restart(calibration, node, num_references, predicted.similarity());
        for &id in predicted.features() {
            let detection = calibration.detection_at(node, predicted.scores()[id as usize]);
            let false_rate = calibration.false_rate_of(node, 0, id as usize, Trials::default());
            self.push(detection, false_rate, references.seen()[id as usize]);
        }
    }

    /// Starts over with what each of the `len` strongest features of an appearance would say.
    pub(in crate::localize) fn expect_appearance(
        &mut self,
        calibration: &Calibration,
        node: NodeId,
        visit: u32,
        len: usize,
    ) {
        self.level = calibration.level(node);
        self.discount = calibration.discount();
        self.conditions = CONDITIONS.map(|condition| condition.powf(calibration.spread));
        self.log_prior = calibration.conditions.map(f64::ln);
        self.restart_alone(calibration.outlier_ratios(node));
        for rank in 0..len {
            let detection = calibration.detection_at(node, strength_score(rank));
            let false_rate =
                calibration.false_rate_of(node, visit as usize, rank, Trials::default());
            self.push(detection, false_rate, 0);
        }
    }

    /// Adds the next feature: `detection` is `p_f`, `false_rate` `q_f`, and the reference visits
    /// that saw it.
    pub(super) fn push(&mut self, detection: f64, false_rate: f64, references: u64) {
        let has_references = self.num_references > 0;
        let unseen = if has_references {
            (1.0 - REFERENCE_WEIGHT) * detection
        } else {
            detection
        };
        let ratios = (self.conditions).map(|condition| log_ratios(condition * unseen, false_rate));
        let missing = ratios.map(|[missing, _]| missing + self.outliers.missing);
        self.missing.push(missing);
        let matched = std::array::from_fn(|at| ratios[at][1] - missing[at]);
        self.matched.push(matched);
        self.words.push(references);
        if has_references {
            let by_reference = unseen + REFERENCE_WEIGHT * REPEATABILITY;
            let seen =
                (self.conditions).map(|condition| log_ratios(condition * by_reference, false_rate));
            let added = |kind: usize| -> Conditions {
                std::array::from_fn(|at| seen[at][kind] - ratios[at][kind])
            };
            let (missing, matched) = (added(0), added(1));
            self.missing_seen.push(missing);
            (self.matched_seen).push(std::array::from_fn(|at| matched[at] - missing[at]));
        }
    }

    fn forget_sums(&mut self) {
        self.num_finalized = 0;
        self.of_nothing = 0.0;
        self.nothing = [0.0; CONDITIONS.len()];
        self.nothing_seen.clear();
        for _ in CONDITIONS {
            let end = self.nothing_seen.len() + self.num_references;
            self.nothing_seen.extend_from_slice(&self.log_weights);
            self.nothing_seen.resize(end, 0.0);
        }
    }

    /// From now on the first `len` features take part: O(features x reference visits), or as much
    /// less as took part before.
    pub(in crate::localize) fn finalize(&mut self, len: usize) {
        let len = len.min(self.missing.len());
        if len < self.num_finalized {
            self.forget_sums();
        }
        for feature in self.num_finalized..len {
            add_to(&mut self.nothing, &self.missing[feature]);
            if let Some(missing) = self.missing_seen.get(feature) {
                let sums = self.nothing_seen.chunks_exact_mut(self.num_references);
                for (sums, added) in sums.zip(missing) {
                    add_to_seeing(sums, *added, self.words[feature]);
                }
            }
        }
        self.num_finalized = len;
        self.of_nothing = log_sum(&self.log_odds_under(&[], self.log_prior));
    }

    /// The log odds given the matches of an image.
    pub(in crate::localize) fn log_odds(
        &self,
        calibration: &Calibration,
        hits: &mut Hits,
        verified: &Verified<'_>,
    ) -> f64 {
        let hits = hits.gather(self.num_finalized, verified);
        let num_missing = self.num_finalized.saturating_sub(hits.len());
        let num_outliers = verified.num_outliers.min(num_missing);
        let mut common = num_outliers as f64 * (self.outliers.outlier - self.outliers.missing);
        if verified.vote.num_inliers > 0 {
            common += calibration.displacement_log_ratio(verified.vote.median);
        }
        for &(_, distance_bits) in hits {
            common += calibration.distance_log_ratio(distance_bits);
        }
        let odds = common + log_sum(&self.log_odds_under(hits, self.log_prior));
        odds - self.discount * self.of_nothing - self.level
    }

    /// The log odds of each condition, with its prior, where these features are found: those that
    /// depend on the condition.
    pub(super) fn log_odds_under(&self, hits: &[(u32, u16)], log_prior: Conditions) -> Conditions {
        let mut odds = log_prior;
        add_to(&mut odds, &self.nothing);
        for &(feature, _) in hits {
            add_to(&mut odds, &self.matched[feature as usize]);
        }
        if self.num_references > 0 {
            let means = self.log_mean_over_references(hits);
            add_to(&mut odds, &means);
        }
        odds
    }

    /// The same for the matches of an image.
    pub(super) fn log_odds_by_condition(
        &self,
        hits: &mut Hits,
        verified: &Verified<'_>,
    ) -> Conditions {
        let hits = hits.gather(self.num_finalized, verified);
        self.log_odds_under(hits, [0.0; CONDITIONS.len()])
    }

    /// The log odds where nothing is matched.
    pub(in crate::localize) fn of_nothing(&self) -> f64 {
        (1.0 - self.discount) * self.of_nothing - self.level
    }

    /// About how much the match of one feature adds: under usual conditions, and as if all
    /// reference visits weighed alike.
    pub(in crate::localize) fn worth(&self, feature: usize) -> f64 {
        let of_references = self.matched_seen.get(feature).map_or(0.0, |added| {
            let share = f64::from(self.words[feature].count_ones()) / self.num_references as f64;
            share * added[USUAL]
        });
        self.matched[feature][USUAL] + of_references
    }

    /// Under each condition, ln of the mean over the reference visits.
    fn log_mean_over_references(&self, hits: &[(u32, u16)]) -> Conditions {
        let num = self.num_references;
        let mut means = [0.0; CONDITIONS.len()];
        for (at, mean) in means.iter_mut().enumerate() {
            let mut sums = [0.0; ReferenceVisits::MAX_VISITS];
            let sums = &mut sums[..num];
            sums.copy_from_slice(&self.nothing_seen[at * num..(at + 1) * num]);
            for &(feature, _) in hits {
                let added = self.matched_seen[feature as usize][at];
                add_to_seeing(sums, added, self.words[feature as usize]);
            }
            *mean = log_sum(sums) - (num as f64).ln();
        }
        means
    }
}

/// Adds what each condition adds.
fn add_to(sums: &mut Conditions, added: &Conditions) {
    for (sum, added) in sums.iter_mut().zip(added) {
        *sum += added;
    }
}

/// `ln(sum of exp)`; terms that do not matter are left out.
fn log_sum(logs: &[f64]) -> f64 {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let counted = logs.iter().filter(|log| **log > most - NEGLIGIBLE);
    most + counted.map(|log| (log - most).exp()).sum::<f64>().ln()
}

/// What the `rank`-th strongest feature of an appearance scores.
pub(super) fn strength_score(rank: usize) -> f64 {
    -(rank as f64)
}

/// Adds to the sums of those reference visits whose bit is set.
fn add_to_seeing(sums: &mut [f64], added: f64, word: u64) {
    for (reference, sum) in sums.iter_mut().enumerate() {
        // A multiplication instead of a branch: the loop has no surprises for the processor.
        *sum += added * (word >> reference & 1) as f64;
    }
}

/// Log ratios of a missing and of a matched feature.
///
/// A feature that is not detected may still be matched by chance, here as well as at another place,
/// so the probability of a match here is `1 - (1 - p) (1 - q)`. Where nothing can be detected,
/// nothing is said.
fn log_ratios(detection: f64, false_rate: f64) -> [f64; 2] {
    let p = detection.min(MAX_DETECTION);
    let found = 1.0 - (1.0 - p) * (1.0 - false_rate);
    [(1.0 - p).ln(), (found / false_rate).ln()]
}

/// `ln(mean of exp)` of what was pushed, without overflow.
#[derive(Clone, Copy, Debug)]
pub(in crate::localize) struct LogMean {
    most: f64,
    sum: f64,
    count: u32,
}

impl Default for LogMean {
    fn default() -> Self {
        Self {
            most: f64::NEG_INFINITY,
            sum: 0.0,
            count: 0,
        }
    }
}

impl LogMean {
    pub(in crate::localize) fn push(&mut self, log: f64) {
        if log > self.most {
            self.sum = self.sum * (self.most - log).exp() + 1.0;
            self.most = log;
        } else {
            self.sum += (log - self.most).exp();
        }
        self.count += 1;
    }

    /// [`NO_EVIDENCE`] if nothing was pushed.
    pub(in crate::localize) fn value(&self) -> f64 {
        if self.count == 0 {
            return NO_EVIDENCE;
        }
        self.most + (self.sum / f64::from(self.count)).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::localize::evidence::conditions::PRIOR;
    use crate::matching::{Match, Vote};

    fn found(map: u32, distance_bits: u16) -> Match {
        Match {
            map,
            live: map,
            distance_bits,
        }
    }

    /// The formula of the module, term by term.
    fn by_definition(features: &[(f64, f64, u64)], num_references: usize, hits: &[bool]) -> f64 {
        let under = CONDITIONS.map(|condition| under(condition, features, num_references, hits));
        (under.iter().zip(PRIOR).map(|(under, prior)| prior * under))
            .sum::<f64>()
            .ln()
    }

    /// The same under one condition, as a ratio.
    fn under(
        condition: f64,
        features: &[(f64, f64, u64)],
        num_references: usize,
        hits: &[bool],
    ) -> f64 {
        let product = |reference: Option<usize>| -> f64 {
            (features.iter().zip(hits))
                .map(|(&(p, q, word), &hit)| {
                    let p = match reference {
                        Some(v) => 0.5 * p + 0.4 * (word >> v & 1) as f64,
                        None => p,
                    };
                    let p = f64::min(condition * p, MAX_DETECTION);
                    let found = 1.0 - (1.0 - p) * (1.0 - q);
                    if hit {
                        found / q
                    } else {
                        (1.0 - found) / (1.0 - q)
                    }
                })
                .product()
        };
        if num_references == 0 {
            product(None)
        } else {
            let sum: f64 = (0..num_references).map(|v| product(Some(v))).sum();
            sum / num_references as f64
        }
    }

    #[test]
    fn log_odds_are_those_of_the_formula() {
        let features = [(0.5, 0.1, 0b011), (0.3, 0.02, 0b100), (0.8, 0.05, 0b001)];
        let calibration = Calibration::uninformed();
        for num_references in [0, 3] {
            let mut expectation = Expectation {
                conditions: CONDITIONS,
                log_prior: PRIOR.map(f64::ln),
                ..Expectation::default()
            };
            expectation.restart_weighted(num_references, OutlierRatios::default(), &[]);
            for (p, q, word) in features {
                expectation.push(p, q, word);
            }
            expectation.finalize(3);
            for pattern in 0..8_u32 {
                let hits = [0, 1, 2].map(|f| pattern >> f & 1 == 1);
                let matches: Vec<Match> = (0..3)
                    .filter(|&f| hits[f as usize])
                    .map(|f| found(f, 7))
                    .collect();
                let verified = Verified {
                    matches: &matches,
                    inliers: &vec![true; matches.len()],
                    vote: Vote {
                        num_inliers: matches.len() as u32,
                        ..Vote::default()
                    },
                    num_outliers: 0,
                };
                let odds = expectation.log_odds(&calibration, &mut Hits::default(), &verified);
                let expected = by_definition(&features, num_references, &hits);
                assert!((odds - expected).abs() < 1e-12, "{odds} {expected}");
            }
        }
    }

    #[test]
    fn finalizing_again_is_finalizing_at_once() {
        let calibration = Calibration::uninformed();
        let matches = [found(0, 7), found(3, 9), found(3, 2), found(8, 1)];
        let odds = |lens: &[usize]| {
            let mut expectation = Expectation::default();
            expectation.restart_weighted(3, OutlierRatios::default(), &[]);
            for feature in 0..10_u32 {
                let p = 0.05 + 0.09 * f64::from(feature);
                expectation.push(p, 0.02, u64::from(feature % 8));
            }
            for &len in lens {
                expectation.finalize(len);
            }
            let verified = Verified {
                matches: &matches,
                inliers: &[true; 4],
                vote: Vote::default(),
                num_outliers: 0,
            };
            expectation.log_odds(&calibration, &mut Hits::default(), &verified)
        };
        let at_once = odds(&[6]);
        assert_eq!(odds(&[2, 5, 6]), at_once);
        assert_eq!(odds(&[10, 3, 6]), at_once);
        assert_ne!(odds(&[10]), at_once, "feature 8 takes part");
    }

    #[test]
    fn an_outlier_match_is_neither_found_nor_missing() {
        let (here, others) = (0.3, 0.2);
        let odds = |outliers: OutlierRatios, num_outliers: usize| {
            let mut expectation = Expectation {
                conditions: CONDITIONS,
                log_prior: PRIOR.map(f64::ln),
                ..Expectation::default()
            };
            expectation.restart_alone(outliers);
            expectation.push(0.5, 0.01, 0);
            expectation.push(0.4, 0.01, 0);
            expectation.finalize(2);
            let matches: Vec<Match> = (0..num_outliers as u32).map(|f| found(f, 3)).collect();
            let verified = Verified {
                matches: &matches,
                inliers: &vec![false; num_outliers],
                vote: Vote::default(),
                num_outliers,
            };
            let calibration = Calibration::uninformed();
            expectation.log_odds(&calibration, &mut Hits::default(), &verified)
        };
        let missing = by_definition(&[(0.5, 0.01, 0), (0.4, 0.01, 0)], 0, &[false, false]);
        for num_outliers in 0..=2 {
            let said = num_outliers as f64 * f64::ln(here / others)
                + (2 - num_outliers) as f64 * f64::ln((1.0 - here) / (1.0 - others));
            let found = odds(OutlierRatios::new(here, others), num_outliers);
            assert!((found - missing - said).abs() < 1e-12);
            // Where nothing is known of outlier matches, they count as missing.
            assert!((odds(OutlierRatios::default(), num_outliers) - missing).abs() < 1e-12);
        }
        // There are not more than features.
        let outliers = OutlierRatios::new(here, others);
        assert_eq!(odds(outliers, 7), odds(outliers, 2));
    }

    #[test]
    fn the_mean_of_logs_does_not_overflow() {
        let mut mean = LogMean::default();
        assert_eq!(mean.value(), NO_EVIDENCE);
        for log in [-2000.0, 1000.0, 1000.0, -5.0] {
            mean.push(log);
        }
        assert!((mean.value() - (1000.0 - 2.0_f64.ln())).abs() < 1e-9);
    }
}

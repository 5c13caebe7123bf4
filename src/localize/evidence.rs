//! How much does one match of features say for a place?
//!
//! With `p_f` the probability that predicted feature f is matched at its place, `q_f` the probability that
//! it is matched in an image of another place, d its matching distance and D the displacement that the
//! matches agree on, the log odds of "this place" against "somewhere else" are
//!
//! ```text
//! ln( P(D | here) / P(D | elsewhere) )
//!   + ln mean over witnesses v of product over f of
//!         p_fv / q_f * g1(d) / g0(d)        f matched
//!         (1 - p_fv) / (1 - q_f) * a / b                    f strays
//!         (1 - p_fv) / (1 - q_f) * (1 - a) / (1 - b)        f not matched
//!   p_fv = (p_f + r s_fv) / 2
//! ```
//!
//! A feature is matched if its match agrees with D, and strays if its match does not: a and b are the
//! probabilities of that, of a feature that is not matched, at the place and in images of others ([`Strays`]).
//! Matched and missing features both count. The mixture over witnesses (past visits of the place, `s_fv`
//! whether v saw f, [`Witnesses`]) is what makes features that appear together speak as one: an image
//! like those of the snowy visits is not held against the place because all summer features are
//! missing. r = 0.8 is the rate at which a feature is detected again under the same conditions; an
//! appearance of one visit has no witnesses, and its `p_f` stands for itself.
//!
//! Source: the likelihood ratio over matched and missing features goes beyond T-RO 2017 VII, which
//! counts matches; a mixture over remembered appearances is the idea of experience-based navigation
//! (Churchill & Newman 2013) and of FAB-MAP's place models (Cummins & Newman 2008).
//!
//! Cost: 4 logarithms a feature and one addition a feature and witness for each prediction; for each
//! image one addition a match and witness, and one exponential a witness.

use super::calibration::Calibration;
use crate::matching::{Match, Vote};
use crate::predict::Witnesses;

/// How often a feature of one visit is detected in another one that looks the same.
const REPEATABILITY: f64 = 0.8;
/// How much a witness is believed over the model of the single feature.
const WITNESS_WEIGHT: f64 = 0.5;
/// Probabilities of a match stay this far from 0 and 1.
const MIN_DETECTION: f64 = 0.003;
const MAX_DETECTION: f64 = 0.97;

/// The log odds of a place of which nothing is remembered.
pub(super) const NO_EVIDENCE: f64 = -1000.0;

/// What each feature of a predicted map or appearance would say, matched or missing; memory that is
/// used again.
///
/// What an image says in which nothing matched is summed up beforehand ([`settle`](Self::settle)), so that
/// the evidence of an image costs time for its matches only.
#[derive(Clone, Debug, Default)]
pub(super) struct Expectation {
    /// Log ratio of a missing feature that the witness did not see.
    missing: Vec<f64>,
    /// What is added if it is matched.
    matched: Vec<f64>,
    /// What is added if the witness saw it: missing, matched.
    seen: Vec<[f64; 2]>,
    /// One bit a witness.
    words: Vec<u64>,
    strays: Strays,
    num_witnesses: usize,
    /// ln of how much each witness counts, which is 1 on average; nothing where all count alike.
    log_weights: Vec<f64>,
    /// So many features take part.
    num_settled: usize,
    /// Their sum where all are missing, without what witnesses add.
    nothing: f64,
    /// What each witness adds where all are missing.
    nothing_seen: Vec<f64>,
}

/// What the features say that did not agree with the others: of each log ratios of here against elsewhere.
///
/// A true match may lie beside the others, since the camera stands elsewhere and near things shift more
/// than far ones; so strays are somewhat more frequent at the place itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Strays {
    /// ln((1 - a) / (1 - b)): nothing like it in the image.
    missing: f64,
    /// ln(a / b): something like it, but not where the others are.
    stray: f64,
}

impl Strays {
    /// Of the probabilities, both between 0 and 1, that a feature strays that is not matched.
    pub(super) fn new(here: f64, elsewhere: f64) -> Self {
        Self {
            missing: ((1.0 - here) / (1.0 - elsewhere)).ln(),
            stray: (here / elsewhere).ln(),
        }
    }
}

/// Features that were found, with the distance of the match; memory that is used again.
#[derive(Clone, Debug, Default)]
pub(super) struct Hits(Vec<(u32, u16)>);

impl Hits {
    /// Those of the inliers among the first `len` features, ascending; of several matches of one feature
    /// the nearest counts.
    fn gather(&mut self, len: usize, matches: &[Match], inliers: &[bool]) -> &[(u32, u16)] {
        self.0.clear();
        let agreeing = (matches.iter().zip(inliers)).filter(|(_, is_inlier)| **is_inlier);
        (self.0).extend(agreeing.map(|(found, _)| (found.map, found.distance_bits)));
        self.0.retain(|hit| (hit.0 as usize) < len);
        self.0.sort_unstable();
        self.0.dedup_by_key(|hit| hit.0);
        &self.0
    }
}

impl Expectation {
    /// Starts over, with this many witnesses (0 for an appearance).
    pub(super) fn restart(&mut self, num_witnesses: usize, strays: Strays) {
        self.strays = strays;
        self.missing.clear();
        self.matched.clear();
        self.seen.clear();
        self.words.clear();
        self.num_witnesses = num_witnesses;
        self.log_weights.clear();
        self.forget_sums();
    }

    /// Starts over with witnesses that count as much as `likeness` says; alike, where it says nothing.
    pub(super) fn restart_weighted(
        &mut self,
        num_witnesses: usize,
        strays: Strays,
        likeness: &[f64],
    ) {
        self.restart(num_witnesses, strays);
        let mean = likeness.iter().sum::<f64>() / likeness.len().max(1) as f64;
        (self.log_weights).extend(likeness.iter().map(|likeness| (likeness / mean).ln()));
        self.forget_sums();
    }

    /// Adds the next feature: `detection` is `p_f`, `false_rate` `q_f`, and the witnesses that saw it.
    pub(super) fn push(&mut self, detection: f64, false_rate: f64, witnesses: u64) {
        let [missing, matched] = log_ratios(
            if self.num_witnesses == 0 {
                detection
            } else {
                (1.0 - WITNESS_WEIGHT) * detection
            },
            false_rate,
        );
        let unmatched = missing + self.strays.missing;
        self.missing.push(unmatched);
        self.matched.push(matched - unmatched);
        self.words.push(witnesses);
        if self.num_witnesses > 0 {
            let witnessed = (1.0 - WITNESS_WEIGHT) * detection + WITNESS_WEIGHT * REPEATABILITY;
            let [missing_seen, matched_seen] = log_ratios(witnessed, false_rate);
            self.seen
                .push([missing_seen - missing, matched_seen - matched]);
        }
    }

    fn forget_sums(&mut self) {
        self.num_settled = 0;
        self.nothing = 0.0;
        self.nothing_seen.clear();
        self.nothing_seen.extend_from_slice(&self.log_weights);
        self.nothing_seen.resize(self.num_witnesses, 0.0);
    }

    /// From now on the first `len` features take part: O(features x witnesses), or as much less as took
    /// part before.
    pub(super) fn settle(&mut self, len: usize) {
        let len = len.min(self.missing.len());
        if len < self.num_settled {
            self.forget_sums();
        }
        for feature in self.num_settled..len {
            self.nothing += self.missing[feature];
            if self.num_witnesses > 0 {
                add_to_seeing(
                    &mut self.nothing_seen,
                    self.seen[feature][0],
                    self.words[feature],
                );
            }
        }
        self.num_settled = len;
    }

    /// The log odds given `matches`, of which `inliers` agree on the displacement of `vote`; `num_strays`
    /// others do not.
    pub(super) fn log_odds(
        &self,
        calibration: &Calibration,
        hits: &mut Hits,
        matches: &[Match],
        inliers: &[bool],
        vote: &Vote,
        num_strays: usize,
    ) -> f64 {
        let hits = hits.gather(self.num_settled, matches, inliers);
        let num_strays = num_strays.min(self.num_settled.saturating_sub(hits.len()));
        let mut common =
            self.nothing + num_strays as f64 * (self.strays.stray - self.strays.missing);
        if vote.num_inliers > 0 {
            common += calibration.displacement_log_ratio(vote.median);
        }
        for &(feature, distance_bits) in hits {
            common +=
                self.matched[feature as usize] + calibration.distance_log_ratio(distance_bits);
        }
        common + self.log_mean_over_witnesses(hits)
    }

    /// The log odds where nothing is matched.
    pub(super) fn of_nothing(&self) -> f64 {
        self.nothing + self.log_mean_over_witnesses(&[])
    }

    /// About how much the match of one feature adds: as if all witnesses weighed alike.
    pub(super) fn worth(&self, feature: usize) -> f64 {
        let of_witnesses = self.seen.get(feature).map_or(0.0, |[missing, matched]| {
            let share = f64::from(self.words[feature].count_ones()) / self.num_witnesses as f64;
            share * (matched - missing)
        });
        self.matched[feature] + of_witnesses
    }

    fn log_mean_over_witnesses(&self, hits: &[(u32, u16)]) -> f64 {
        if self.num_witnesses == 0 {
            return 0.0;
        }
        let mut sums = [0.0; Witnesses::MAX_VISITS];
        let sums = &mut sums[..self.num_witnesses];
        sums.copy_from_slice(&self.nothing_seen);
        for &(feature, _) in hits {
            let [missing, matched] = self.seen[feature as usize];
            add_to_seeing(sums, matched - missing, self.words[feature as usize]);
        }
        let mut mean = LogMean::default();
        for &sum in &*sums {
            mean.push(sum);
        }
        mean.value()
    }
}

/// Adds to the sums of those witnesses whose bit is set.
fn add_to_seeing(sums: &mut [f64], added: f64, word: u64) {
    for (witness, sum) in sums.iter_mut().enumerate() {
        // A multiplication instead of a branch: the loop has no surprises for the processor.
        *sum += added * (word >> witness & 1) as f64;
    }
}

/// Log ratios of a missing and of a matched feature.
fn log_ratios(detection: f64, false_rate: f64) -> [f64; 2] {
    let p = detection.clamp(MIN_DETECTION, MAX_DETECTION);
    let q = false_rate;
    [((1.0 - p) / (1.0 - q)).ln(), (p / q).ln()]
}

/// `ln(mean of exp)` of what was pushed, without overflow.
#[derive(Clone, Copy, Debug)]
pub(super) struct LogMean {
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
    pub(super) fn push(&mut self, log: f64) {
        if log > self.most {
            self.sum = self.sum * (self.most - log).exp() + 1.0;
            self.most = log;
        } else {
            self.sum += (log - self.most).exp();
        }
        self.count += 1;
    }

    /// [`NO_EVIDENCE`] if nothing was pushed.
    pub(super) fn value(&self) -> f64 {
        if self.count == 0 {
            return NO_EVIDENCE;
        }
        self.most + (self.sum / f64::from(self.count)).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matching::Displacement;

    fn found(map: u32, distance_bits: u16) -> Match {
        Match {
            map,
            live: map,
            distance_bits,
        }
    }

    /// The formula of the module, term by term.
    fn by_definition(features: &[(f64, f64, u64)], num_witnesses: usize, hits: &[bool]) -> f64 {
        let product = |witness: Option<usize>| -> f64 {
            (features.iter().zip(hits))
                .map(|(&(p, q, word), &hit)| {
                    let p = match witness {
                        Some(v) => 0.5 * p + 0.4 * (word >> v & 1) as f64,
                        None => p,
                    };
                    if hit { p / q } else { (1.0 - p) / (1.0 - q) }
                })
                .product()
        };
        if num_witnesses == 0 {
            product(None).ln()
        } else {
            let sum: f64 = (0..num_witnesses).map(|v| product(Some(v))).sum();
            (sum / num_witnesses as f64).ln()
        }
    }

    #[test]
    fn log_odds_are_those_of_the_formula() {
        let features = [(0.5, 0.1, 0b011), (0.3, 0.02, 0b100), (0.8, 0.05, 0b001)];
        let calibration = Calibration::uninformed();
        for num_witnesses in [0, 3] {
            let mut expectation = Expectation::default();
            expectation.restart(num_witnesses, Strays::default());
            for (p, q, word) in features {
                expectation.push(p, q, word);
            }
            expectation.settle(3);
            for pattern in 0..8_u32 {
                let hits = [0, 1, 2].map(|f| pattern >> f & 1 == 1);
                let matches: Vec<Match> = (0..3)
                    .filter(|&f| hits[f as usize])
                    .map(|f| found(f, 7))
                    .collect();
                let inliers = vec![true; matches.len()];
                let vote = Vote {
                    num_inliers: matches.len() as u32,
                    mean: Displacement::default(),
                    median: Displacement::default(),
                    spread: Displacement::default(),
                };
                let odds = expectation.log_odds(
                    &calibration,
                    &mut Hits::default(),
                    &matches,
                    &inliers,
                    &vote,
                    0,
                );
                let expected = by_definition(&features, num_witnesses, &hits);
                assert!((odds - expected).abs() < 1e-12, "{odds} {expected}");
            }
        }
    }

    #[test]
    fn settling_again_is_settling_at_once() {
        let calibration = Calibration::uninformed();
        let matches = [found(0, 7), found(3, 9), found(3, 2), found(8, 1)];
        let odds = |lens: &[usize]| {
            let mut expectation = Expectation::default();
            expectation.restart(3, Strays::default());
            for feature in 0..10_u32 {
                let p = 0.05 + 0.09 * f64::from(feature);
                expectation.push(p, 0.02, u64::from(feature % 8));
            }
            for &len in lens {
                expectation.settle(len);
            }
            let mut hits = Hits::default();
            expectation.log_odds(
                &calibration,
                &mut hits,
                &matches,
                &[true; 4],
                &Vote::default(),
                0,
            )
        };
        let at_once = odds(&[6]);
        assert_eq!(odds(&[2, 5, 6]), at_once);
        assert_eq!(odds(&[10, 3, 6]), at_once);
        assert_ne!(odds(&[10]), at_once, "feature 8 takes part");
    }

    #[test]
    fn a_stray_is_neither_found_nor_missing() {
        let (here, elsewhere) = (0.3, 0.2);
        let odds = |strays: Strays, num_strays: usize| {
            let mut expectation = Expectation::default();
            expectation.restart(0, strays);
            expectation.push(0.5, 0.01, 0);
            expectation.push(0.4, 0.01, 0);
            expectation.settle(2);
            let matches: Vec<Match> = (0..num_strays as u32).map(|f| found(f, 3)).collect();
            expectation.log_odds(
                &Calibration::uninformed(),
                &mut Hits::default(),
                &matches,
                &vec![false; num_strays],
                &Vote::default(),
                num_strays,
            )
        };
        let missing = (0.5 * 0.6 / 0.99_f64.powi(2)).ln();
        for num_strays in 0..=2 {
            let told = num_strays as f64 * f64::ln(here / elsewhere)
                + (2 - num_strays) as f64 * f64::ln((1.0 - here) / (1.0 - elsewhere));
            let odds_told = odds(Strays::new(here, elsewhere), num_strays);
            assert!((odds_told - missing - told).abs() < 1e-12);
            // Where nothing is known of strays, they count as missing.
            assert!((odds(Strays::default(), num_strays) - missing).abs() < 1e-12);
        }
        // There are not more than features.
        let strays = Strays::new(here, elsewhere);
        assert_eq!(odds(strays, 7), odds(strays, 2));
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

//! Is something that is called 80 % sure right in 80 of 100 cases?
//!
//! Answers are put in order of confidence and cut into [`NUM_BINS`] bins of equal mass. A bin with
//! mean confidence `c_b` in which the share `a_b` is right misses by `|c_b - a_b|`; the expected
//! calibration error is the mean over the mass, `sum_b w_b |c_b - a_b|` (Naeini, Cooper and
//! Hauskrecht 2015, with bins of equal mass as in Nguyen and O'Connor 2015). Answers of one
//! confidence are one atom, which a cut divides by mass: the order of the queries cannot matter.
//!
//! The error of a perfect posterior is above 0 in a finite sample, and the draws of its interval
//! add noise of their own: both push it up, the more so the fewer queries a bin has. O(q log q),
//! then O(q) per draw.

use std::collections::BTreeMap;

use super::judged::Claim;
use super::statistics::{Estimate, NUM_RESAMPLES, SplitMix64, interval_of_draws};
use crate::results::{Bin, Measured};

/// Bins of equal mass.
const NUM_BINS: usize = 15;

/// The claims in atoms of equal confidence, ascending.
struct Atoms {
    confidences: Vec<f64>,
    /// Per claim: its atom and group.
    places: Vec<(usize, usize)>,
    num_groups: usize,
}

impl Atoms {
    fn of(claims: &[Claim<'_>]) -> Self {
        let mut confidences: Vec<f64> = claims.iter().map(|claim| claim.confidence).collect();
        confidences.sort_by(f64::total_cmp);
        confidences.dedup();
        let mut groups: BTreeMap<&str, usize> = BTreeMap::new();
        let mut num_groups = 0;
        let places = (claims.iter())
            .map(|claim| {
                let atom = confidences.partition_point(|&c| c < claim.confidence);
                let group = match claim.group {
                    Some(name) => *groups.entry(name).or_insert(num_groups),
                    None => num_groups,
                };
                num_groups = num_groups.max(group + 1);
                (atom, group)
            })
            .collect();
        Self {
            confidences,
            places,
            num_groups,
        }
    }

    /// The bins, where a group counts `times[group]` times.
    fn bins(&self, claims: &[Claim<'_>], times: &[f64]) -> Vec<Bin> {
        let mut atoms = vec![(0.0, 0.0); self.confidences.len()];
        for (claim, &(atom, group)) in claims.iter().zip(&self.places) {
            let weight = claim.weight * times[group];
            atoms[atom].0 += weight;
            atoms[atom].1 += weight * claim.right;
        }
        let total: f64 = atoms.iter().map(|(weight, _)| weight).sum();
        if total <= 0.0 {
            return Vec::new();
        }
        let room = total / NUM_BINS as f64;
        let mut sums = vec![[0.0; 3]; NUM_BINS];
        let (mut at, mut free) = (0, room);
        for (&confidence, (weight, right)) in self.confidences.iter().zip(atoms) {
            let mut left = weight;
            while left > 0.0 {
                // The last bin takes what rounding leaves over.
                let part = if at + 1 < NUM_BINS {
                    left.min(free)
                } else {
                    left
                };
                for (sum, value) in sums[at].iter_mut().zip([1.0, confidence, right / weight]) {
                    *sum += part * value;
                }
                left -= part;
                free -= part;
                if free <= 0.0 && at + 1 < NUM_BINS {
                    (at, free) = (at + 1, room);
                }
            }
        }
        (sums.into_iter())
            .filter(|[weight, ..]| *weight > 0.0)
            .map(|[weight, confidence, right]| Bin {
                mass: weight / total,
                confidence: confidence / weight,
                right: right / weight,
            })
            .collect()
    }
}

fn error_of(bins: &[Bin]) -> f64 {
    (bins.iter())
        .map(|bin| bin.mass * (bin.confidence - bin.right).abs())
        .sum()
}

/// The bins of a reliability diagram, ascending in confidence; none without claims.
pub(super) fn bins(claims: &[Claim<'_>]) -> Vec<Bin> {
    let atoms = Atoms::of(claims);
    atoms.bins(claims, &vec![1.0; atoms.num_groups])
}

/// The expected calibration error with its interval: whole groups are drawn, as in
/// [`statistics`](super::statistics), and binned anew.
pub(super) fn expected_error(claims: &[Claim<'_>]) -> Measured {
    let atoms = Atoms::of(claims);
    let mut times = vec![1.0; atoms.num_groups];
    let value = error_of(&atoms.bins(claims, &times));
    let mut random = SplitMix64::of_intervals();
    let draws = (0..NUM_RESAMPLES)
        .map(|_| {
            times.fill(0.0);
            for _ in 0..atoms.num_groups {
                times[random.below(atoms.num_groups)] += 1.0;
            }
            error_of(&atoms.bins(claims, &times))
        })
        .collect();
    let estimate = Estimate {
        mean: value,
        interval: interval_of_draws(draws, value),
    };
    estimate.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn four_of_five_at_80_percent_is_calibrated_and_at_90_is_not() {
        for (confidence, error) in [(0.8, 0.0), (0.9, 0.1), (0.5, 0.3)] {
            let claims: Vec<_> = (0..50)
                .map(|i| Claim::alone(confidence, f64::from(i % 5 != 0)))
                .collect();
            let measured = expected_error(&claims);
            assert!((measured.value - error).abs() < 1e-12, "{measured:?}");
            assert!(measured.ci_low <= measured.value && measured.value <= measured.ci_high);
        }
    }

    #[test]
    fn bins_of_equal_mass_by_hand() {
        // 30 claims, so two a bin: confidence i / 30, right in the upper half.
        let claims: Vec<_> = (0..30)
            .map(|i| Claim::alone(f64::from(i) / 30.0, f64::from(i >= 15)))
            .collect();
        let bins = bins(&claims);
        assert_eq!(bins.len(), NUM_BINS);
        for (b, bin) in bins.iter().enumerate() {
            let first = 2.0 * b as f64;
            assert!((bin.mass - 1.0 / 15.0).abs() < 1e-12);
            assert!((bin.confidence - (first + 0.5) / 30.0).abs() < 1e-12);
            let right = match b {
                0..7 => 0.0,
                7 => 0.5,
                _ => 1.0,
            };
            assert!((bin.right - right).abs() < 1e-12, "{b}: {bin:?}");
        }
        // sum of |c - a| by hand: bins 0..7 miss by (2b + 0.5)/30, bin 7 by |14.5/30 - 0.5|, bins
        // 8.. by (29.5 - 2b)/30.
        let below: f64 = (0..7).map(|b| (2.0 * f64::from(b) + 0.5) / 30.0).sum();
        let above: f64 = (8..15).map(|b| (29.5 - 2.0 * f64::from(b)) / 30.0).sum();
        let by_hand = (below + 0.5 / 30.0 + above) / 15.0;
        assert!((error_of(&bins) - by_hand).abs() < 1e-12);
    }

    #[test]
    fn a_weight_of_two_is_the_claim_twice() {
        let mut heavy = Claim::alone(0.9, 0.0);
        heavy.weight = 2.0;
        let twice = [
            Claim::alone(0.9, 0.0),
            Claim::alone(0.9, 0.0),
            Claim::alone(0.4, 1.0),
        ];
        let once = [heavy, Claim::alone(0.4, 1.0)];
        assert!((error_of(&bins(&twice)) - error_of(&bins(&once))).abs() < 1e-12);
    }

    #[test]
    fn nothing_claimed_is_no_error() {
        assert!(bins(&[]).is_empty());
        assert_eq!(expected_error(&[]).value, 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn the_order_of_the_queries_does_not_matter_and_mass_is_kept(
            raw in prop::collection::vec((0_u8..=20, 0_u8..=1), 1..80)
        ) {
            let mut claims: Vec<_> = (raw.iter())
                .map(|&(c, r)| Claim::alone(f64::from(c) / 20.0, f64::from(r)))
                .collect();
            let forth = bins(&claims);
            claims.reverse();
            let back = bins(&claims);
            prop_assert!((error_of(&forth) - error_of(&back)).abs() < 1e-9);
            let sum = |f: fn(&Bin) -> f64| forth.iter().map(f).sum::<f64>();
            prop_assert!((sum(|b| b.mass) - 1.0).abs() < 1e-9);
            let mean = claims.iter().map(|c| c.right).sum::<f64>() / claims.len() as f64;
            prop_assert!((sum(|b| b.mass * b.right) - mean).abs() < 1e-9);
            prop_assert!(error_of(&forth) <= 1.0 + 1e-9);
        }
    }
}

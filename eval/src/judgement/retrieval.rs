//! Does the posterior put the right place first, and does it know when?
//!
//! Recall@k: the true place is among the k most probable ones. Precision and recall: of the queries
//! whose most probable place has at least confidence c, the share that is right; and of all queries
//! that have a true place, the share that is accepted and right. Average precision is
//! `sum_i (R_i - R_{i-1}) P_i` over falling c; R@100P is the largest recall that comes without any
//! mistake.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::reliability::Claim;
use crate::results::ELSEWHERE;

/// Points of a stored curve, about.
const MAX_POINTS: usize = 40;

/// One point of precision over recall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PrecisionRecall {
    /// What a first choice must have to be accepted.
    pub least_confidence: f64,
    /// Right ones among the accepted.
    pub precision: f64,
    /// Accepted and right ones among those that have a true place.
    pub recall: f64,
}

/// How far the posterior can be trusted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Retrieval {
    /// Area under precision over recall.
    pub average_precision: f64,
    /// The largest recall without a mistake.
    pub recall_at_full_precision: f64,
    /// Falling confidence, thinned.
    pub curve: Vec<PrecisionRecall>,
}

/// The most probable place with its probability; `right` is the share of the truth in a tie of first
/// places (a foreign query, without truth, is never right).
pub fn first_choice(posterior: &BTreeMap<String, f64>, truth: Option<&str>) -> (f64, f64) {
    let places = || posterior.iter().filter(|(place, _)| *place != ELSEWHERE);
    let confidence = places().map(|(_, &p)| p).fold(0.0, f64::max);
    (confidence, recall_at(posterior, truth, 1))
}

/// Whether the truth is among the `k` most probable places; the expected value where places tie for
/// the last rank. A place whose probability was too small to be written is not among them.
pub fn recall_at(posterior: &BTreeMap<String, f64>, truth: Option<&str>, k: usize) -> f64 {
    let Some(&p) = truth.and_then(|truth| posterior.get(truth)) else {
        return 0.0;
    };
    let others = || posterior.iter().filter(|(place, _)| *place != ELSEWHERE);
    let above = others().filter(|&(_, &other)| other > p).count();
    let equal = others().filter(|&(_, &other)| other == p).count();
    (k.saturating_sub(above) as f64 / equal as f64).min(1.0)
}

/// Precision and recall of `claims`, of which `num_native` (by weight) have a true place.
pub fn retrieval(claims: &[Claim<'_>], num_native: f64) -> Retrieval {
    let mut sorted = claims.to_vec();
    sorted.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
    let (mut accepted, mut right) = (0.0, 0.0);
    let (mut average_precision, mut recall_at_full_precision, mut last_recall) = (0.0, 0.0, 0.0);
    let mut has_mistake = false;
    let mut curve = Vec::new();
    for level in sorted.chunk_by(|a, b| a.confidence == b.confidence) {
        for claim in level {
            accepted += claim.weight;
            right += claim.weight * claim.right;
            has_mistake |= claim.right < 1.0;
        }
        let point = PrecisionRecall {
            least_confidence: level[0].confidence,
            precision: if accepted > 0.0 {
                right / accepted
            } else {
                1.0
            },
            recall: if num_native > 0.0 {
                right / num_native
            } else {
                0.0
            },
        };
        average_precision += (point.recall - last_recall) * point.precision;
        last_recall = point.recall;
        if !has_mistake {
            recall_at_full_precision = point.recall;
        }
        curve.push(point);
    }
    Retrieval {
        average_precision,
        recall_at_full_precision,
        curve: thinned(curve),
    }
}

/// Every k-th point and the last.
fn thinned(curve: Vec<PrecisionRecall>) -> Vec<PrecisionRecall> {
    let last = curve.len().saturating_sub(1);
    let step = curve.len().div_ceil(MAX_POINTS).max(1);
    (curve.into_iter().enumerate())
        .filter(|(i, _)| i % step == 0 || *i == last)
        .map(|(_, point)| point)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn posterior(shares: &[(&str, f64)]) -> BTreeMap<String, f64> {
        shares.iter().map(|&(k, p)| (k.to_owned(), p)).collect()
    }

    fn claim(confidence: f64, right: bool) -> Claim<'static> {
        Claim {
            group: None,
            confidence,
            right: f64::from(right),
            weight: 1.0,
        }
    }

    #[test]
    fn recall_counts_ranks_splits_ties_and_never_ranks_elsewhere() {
        let shares = posterior(&[("a", 0.1), ("b", 0.3), ("c", 0.1), (ELSEWHERE, 0.5)]);
        let at = |truth, k| recall_at(&shares, truth, k);
        assert_eq!([at(Some("b"), 1), at(Some("b"), 5)], [1.0, 1.0]);
        assert_eq!(
            [at(Some("a"), 1), at(Some("a"), 2), at(Some("a"), 3)],
            [0.0, 0.5, 1.0]
        );
        assert_eq!([at(Some("unlisted"), 5), at(None, 5)], [0.0, 0.0]);
        assert_eq!(first_choice(&shares, Some("b")), (0.3, 1.0));
        assert_eq!(first_choice(&shares, None), (0.3, 0.0));
        assert_eq!(
            first_choice(&posterior(&[(ELSEWHERE, 1.0)]), Some("a")),
            (0.0, 0.0)
        );
    }

    #[test]
    fn average_precision_by_hand() {
        // Right, right, wrong, right: AP = (1 + 1 + 3/4) / 4 of four natives.
        let claims = [
            claim(0.9, true),
            claim(0.8, true),
            claim(0.7, false),
            claim(0.6, true),
        ];
        let found = retrieval(&claims, 4.0);
        assert!((found.average_precision - (1.0 + 1.0 + 0.75) / 4.0).abs() < 1e-12);
        assert_eq!(found.recall_at_full_precision, 0.5);
        let last = found.curve.last().unwrap();
        assert_eq!((last.precision, last.recall), (0.75, 0.75));
    }

    #[test]
    fn a_mistake_of_the_same_confidence_spoils_the_whole_level() {
        let claims = [claim(0.9, true), claim(0.8, true), claim(0.8, false)];
        let found = retrieval(&claims, 3.0);
        assert!((found.recall_at_full_precision - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(found.curve.len(), 2);
        assert_eq!(retrieval(&[], 0.0).average_precision, 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn recall_grows_along_the_curve_and_precision_is_a_share(
            raw in prop::collection::vec((0_u8..=30, prop::bool::ANY), 1..200)
        ) {
            let claims: Vec<_> = raw.iter().map(|&(c, r)| claim(f64::from(c) / 30.0, r)).collect();
            let found = retrieval(&claims, claims.len() as f64);
            prop_assert!(found.curve.is_sorted_by(|a, b| a.recall <= b.recall));
            prop_assert!(found.curve.iter().all(|p| (0.0..=1.0).contains(&p.precision)));
            let last = found.curve.last().unwrap();
            prop_assert!(found.recall_at_full_precision <= last.recall);
            prop_assert!(found.average_precision <= last.recall + 1e-9);
        }
    }
}

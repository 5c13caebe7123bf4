//! Does the posterior put the right place first, and does it know when?
//!
//! Recall@k: the true place is among the k most probable ones. Precision and recall: of the queries
//! whose most probable place has at least confidence c, the share that is right; and of all queries
//! that have a true place, the share that is accepted and right. Average precision is
//! `sum_i (R_i - R_{i-1}) P_i` over falling c; R@100P is the largest recall that comes without any
//! mistake.

use super::judged::Claim;
use crate::results::{PrecisionRecall, Retrieval};

/// Points of a stored curve, about.
const MAX_POINTS: usize = 40;

/// Precision and recall of `claims`, of which `num_native` (by weight) have a true place.
pub(super) fn retrieval(claims: &[Claim<'_>], num_in_map: f64) -> Retrieval {
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
            recall: if num_in_map > 0.0 {
                right / num_in_map
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

    fn claim(confidence: f64, right: bool) -> Claim<'static> {
        Claim {
            group: None,
            confidence,
            right: f64::from(right),
            weight: 1.0,
        }
    }

    #[test]
    fn average_precision_by_hand() {
        // Right, right, wrong, right: AP = (1 + 1 + 3/4) / 4 of four in-map queries.
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

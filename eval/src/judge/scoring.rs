//! How much does a posterior lose against the truth?
//!
//! Brier score, `sum_k (p_k - y_k)^2` over the places and off-map (Brier 1950): 0 is perfect, 2 is
//! sure and wrong. Log loss, `-ln p` of what is true: the truth of a out-of-map query is off-map.
//! Both are proper: no posterior expects less than the one that says what it believes.
//!
//! Shares below 0.00005 are not written, so that a probability below [`LEAST`] is taken for it: one
//! query loses at most 9.2. Absent places count as 0.

use std::collections::BTreeMap;

use crate::results::OFF_MAP;

/// The least probability in a log loss.
const LEAST: f64 = 1e-4;

/// The Brier score of one query; `truth` is none for a place that the map lacks.
pub(super) fn brier(posterior: &BTreeMap<String, f64>, truth: Option<&str>) -> f64 {
    let truth = truth.unwrap_or(OFF_MAP);
    let listed: f64 = (posterior.iter())
        .map(|(place, p)| (p - f64::from(place == truth)).powi(2))
        .sum();
    listed + f64::from(!posterior.contains_key(truth))
}

/// The log loss of one query, in nats.
pub(super) fn log_loss(posterior: &BTreeMap<String, f64>, truth: Option<&str>) -> f64 {
    let p = posterior.get(truth.unwrap_or(OFF_MAP)).copied();
    -p.unwrap_or(0.0).clamp(LEAST, 1.0).ln()
}

/// The most probable place with its probability; `right` is the share of the truth in a tie of
/// first places (a out-of-map query, without truth, is never right).
pub(super) fn first_choice(posterior: &BTreeMap<String, f64>, truth: Option<&str>) -> (f64, f64) {
    let places = || posterior.iter().filter(|(place, _)| *place != OFF_MAP);
    let confidence = places().map(|(_, &p)| p).fold(0.0, f64::max);
    (confidence, recall_at(posterior, truth, 1))
}

/// Whether the truth is among the `k` most probable places; the expected value where places tie for
/// the last rank. A place whose probability was too small to be written is not among them.
pub(super) fn recall_at(posterior: &BTreeMap<String, f64>, truth: Option<&str>, k: usize) -> f64 {
    let Some(&p) = truth.and_then(|truth| posterior.get(truth)) else {
        return 0.0;
    };
    let others = || posterior.iter().filter(|(place, _)| *place != OFF_MAP);
    let above = others().filter(|&(_, &other)| other > p).count();
    let equal = others().filter(|&(_, &other)| other == p).count();
    (k.saturating_sub(above) as f64 / equal as f64).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shares(listed: &[(&str, f64)]) -> BTreeMap<String, f64> {
        listed.iter().map(|&(k, p)| (k.to_owned(), p)).collect()
    }

    fn posterior(a: f64, b: f64, off_map: f64) -> BTreeMap<String, f64> {
        BTreeMap::from([
            ("a".to_owned(), a),
            ("b".to_owned(), b),
            (OFF_MAP.to_owned(), off_map),
        ])
    }

    #[test]
    fn recall_counts_ranks_splits_ties_and_never_ranks_off_map() {
        let listed = shares(&[("a", 0.1), ("b", 0.3), ("c", 0.1), (OFF_MAP, 0.5)]);
        let at = |truth, k| recall_at(&listed, truth, k);
        assert_eq!([at(Some("b"), 1), at(Some("b"), 5)], [1.0, 1.0]);
        assert_eq!(
            [at(Some("a"), 1), at(Some("a"), 2), at(Some("a"), 3)],
            [0.0, 0.5, 1.0]
        );
        assert_eq!([at(Some("unlisted"), 5), at(None, 5)], [0.0, 0.0]);
        assert_eq!(first_choice(&listed, Some("b")), (0.3, 1.0));
        assert_eq!(first_choice(&listed, None), (0.3, 0.0));
        assert_eq!(
            first_choice(&shares(&[(OFF_MAP, 1.0)]), Some("a")),
            (0.0, 0.0)
        );
    }

    #[test]
    fn scores_by_hand() {
        let shares = posterior(0.7, 0.2, 0.1);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(brier(&shares, Some("a")), 0.09 + 0.04 + 0.01);
        near(brier(&shares, None), 0.49 + 0.04 + 0.81);
        near(brier(&shares, Some("unlisted")), 0.49 + 0.04 + 0.01 + 1.0);
        near(log_loss(&shares, Some("a")), -(0.7_f64.ln()));
        near(log_loss(&shares, None), -(0.1_f64.ln()));
        near(log_loss(&shares, Some("unlisted")), -(1e-4_f64.ln()));
        near(brier(&posterior(1.0, 0.0, 0.0), Some("a")), 0.0);
        near(log_loss(&posterior(1.0, 0.0, 0.0), Some("a")), 0.0);
        near(brier(&posterior(0.0, 1.0, 0.0), Some("a")), 2.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn nothing_expects_to_lose_less_than_what_it_believes(
            (a, b) in (0.01..0.9_f64, 0.01..0.9_f64), shift in -0.009..0.009_f64
        ) {
            let total = a + b + 0.1;
            let (a, b, off_map) = (a / total, b / total, 0.1 / total);
            let honest = posterior(a, b, off_map);
            let bent = posterior(a + shift, b - shift, off_map);
            for score in [brier, log_loss] {
                let expected = |said: &BTreeMap<String, f64>| {
                    a * score(said, Some("a")) + b * score(said, Some("b")) + off_map * score(said, None)
                };
                prop_assert!(expected(&honest) <= expected(&bent) + 1e-12);
            }
        }
    }
}

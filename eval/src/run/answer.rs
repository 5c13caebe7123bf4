//! How is what the library says written in results?

use std::collections::BTreeMap;

use chronotope::localize::Decision;
use chronotope::map::NodeId;

use crate::results::{self, Answer};

/// Smaller shares of a posterior would be written as 0 and are left out of the results.
const LEAST_SHARE: f64 = 5e-5;

/// What one run said about one query.
#[derive(Clone, Debug)]
pub(crate) struct RunAnswers {
    /// For each ranking and n: the answer.
    pub(crate) answers: Vec<Vec<Answer>>,
    /// For each n, what the image said of every place; only where ways are followed.
    pub(crate) images: Vec<ImageAnswer>,
    pub(crate) pairs_compared: Vec<u64>,
    /// (seen again, selected) of the most likely features, where the method predicts features.
    pub(crate) reobserved: Option<(u32, u32)>,
}

/// What one image said of every place, by its likelihoods.
#[derive(Clone, Debug)]
pub(crate) struct ImageAnswer {
    /// By node.
    pub(crate) scores: Vec<f64>,
    pub(crate) posterior: Vec<f64>,
    pub(crate) off_map: f64,
}

/// Probabilities as results write them, by place.
pub(crate) fn named_posterior(
    shares: &[f64],
    off_map: f64,
    name: &impl Fn(usize) -> String,
) -> BTreeMap<String, f64> {
    let mut named: BTreeMap<String, f64> = (shares.iter().enumerate())
        .filter(|(_, share)| **share >= LEAST_SHARE)
        .map(|(node, share)| (name(node), rounded(*share)))
        .collect();
    named.insert(results::OFF_MAP.into(), rounded(off_map));
    named
}

/// Probabilities are written so that `p` and `1 - p` both keep four digits, down to 1e-12: files
/// stay small, and answers that are nearly sure stay in order.
fn rounded(p: f64) -> f64 {
    let rarer = p.min(1.0 - p).max(1e-12);
    let scale = 10_f64.powi(3 - rarer.log10().floor() as i32);
    (p * scale).round() / scale
}

/// A decision of the library as results name it: the one place where that is done. What it is worth
/// says [`results::Query::outcome`].
pub(crate) fn decided(
    (decision, region): (Decision, Vec<NodeId>),
    name: &impl Fn(usize) -> String,
) -> results::Decision {
    match decision {
        Decision::Near(_) => {
            let places = region.iter().map(|node| name(node.0 as usize));
            results::Decision::Near(places.collect())
        }
        Decision::At(node) => results::Decision::At(name(node.0 as usize)),
        Decision::Ambiguous => results::Decision::Ambiguous,
        _ => results::Decision::Unknown,
    }
}

//! Under which conditions was the image taken?
//!
//! How many of a place's features an image shows depends on the place and the time, which a model
//! foretells, and on the image: blur, dust on the lens, a viewpoint a little off, a kind of weather
//! that the map has not seen. The second is the same for all features of the image, and nothing is
//! known of it beforehand. So the probability that a feature is matched is `rho * p`, with the
//! *condition* `rho` one of [`CONDITIONS`], and the evidence is a mean over them:
//!
//! ```text
//! P(matches | here) = sum over rho of P(rho) * product over f of P(match of f | rho * p_f)
//! ```
//!
//! An image that shows a tenth of what was expected, all in the right order, is then one taken
//! under bad conditions; without the mean, nine missing features in ten would outweigh the tenth
//! that was found, and places of few features, which have little to miss, would win.
//!
//! The more images of their own place were held out, the better the rates of single features are
//! known, conditions and all, and the more a missing feature says: the conditions draw together, as
//! `rho^k` with `k = 1 / (1 + (images / 20)^1.5)` ([`spread`]). In a map of hundreds of visits nearly
//! nothing is left of them. (Kept apart, they cost six points of first choices where places are
//! told by what is missing: Las Vegas, n = 50, 1398 queries.)
//!
//! `P(rho)` is learnt from past visits that are held out, drawn to what is usual over many maps
//! ([`PRIOR`]): expectation maximisation with a Dirichlet prior of [`PRIOR_IMAGES`] images.

/// How much more or less often than expected features are found.
pub(super) const CONDITIONS: [f64; 6] = [1.4, 1.0, 0.65, 0.35, 0.15, 0.05];
/// Position of the usual condition.
pub(super) const USUAL: usize = 1;
/// Something for each condition.
pub(super) type Conditions = [f64; CONDITIONS.len()];

/// How often each condition is met over many maps.
pub(super) const PRIOR: Conditions = [0.1, 0.2, 0.2, 0.2, 0.2, 0.1];
/// So many images at that rate are added to those of each map.
const PRIOR_IMAGES: f64 = 6.0;
/// So many held-out images halve the distance between conditions.
const KNOWN_BY: f64 = 20.0;
/// Rounds of expectation maximisation; it has settled long before.
const NUM_ROUNDS: usize = 30;

/// How far the conditions are apart once so many images of their own place were held out: 1 where
/// none was, towards 0 where there were many.
pub(super) fn spread(num_images: usize) -> f64 {
    1.0 / (1.0 + (num_images as f64 / KNOWN_BY).powf(1.5))
}

/// How often each condition was met, given the log likelihood of each image under each.
pub(super) fn learn_conditions(images: &[Conditions]) -> Conditions {
    let mut shares = PRIOR;
    for _ in 0..NUM_ROUNDS {
        let mut counts = PRIOR.map(|share| PRIOR_IMAGES * share);
        for logs in images {
            let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let weights: Conditions =
                std::array::from_fn(|at| shares[at] * (logs[at] - most).exp());
            let total: f64 = weights.iter().sum();
            for (count, weight) in counts.iter_mut().zip(weights) {
                *count += weight / total;
            }
        }
        let total: f64 = counts.iter().sum();
        shares = counts.map(|count| count / total);
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_met_often_becomes_likely_and_the_rest_stays_possible() {
        assert!((PRIOR.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let nothing = learn_conditions(&[]);
        assert!(
            nothing
                .iter()
                .zip(PRIOR)
                .all(|(share, usual)| (share - usual).abs() < 1e-12)
        );
        let mut image = [-50.0; CONDITIONS.len()];
        image[2] = 0.0;
        let shares = learn_conditions(&[image; 94]);
        assert!(shares[2] > 0.94, "{shares:?}");
        assert!(shares.iter().all(|share| *share > 0.001), "{shares:?}");
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}

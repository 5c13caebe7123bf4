//! Which probability does a model's score stand for?
//!
//! A [`Curve`] is the non-decreasing function from score to rate that fits yes/no samples best in
//! least squares (isotonic regression by pooling adjacent violators; Ayer et al. 1955), linear
//! between the means of its blocks and constant beyond the first and the last.

use serde::{Deserialize, Serialize};

/// Samples are first gathered into so many blocks of about equal size, at least [`MIN_BLOCK`] each.
const MAX_BLOCKS: usize = 30;
const MIN_BLOCK: usize = 20;

/// A non-decreasing piecewise linear function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// (score, rate), both ascending; at least one.
    knots: Vec<(f64, f64)>,
}

#[derive(Clone, Copy)]
struct Block {
    score_sum: f64,
    hits: f64,
    count: f64,
}

impl Curve {
    /// The same rate for every score.
    pub fn constant(rate: f64) -> Self {
        Self {
            knots: vec![(0.0, rate)],
        }
    }

    /// Fits (score, whether it came true); the order of samples does not matter. Half a hit and
    /// half a miss are added, so that no rate is 0 or 1. `None` without samples.
    pub fn fit(samples: &mut [(f64, bool)]) -> Option<Self> {
        if samples.is_empty() {
            return None;
        }
        samples.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let num_blocks = (samples.len() / MIN_BLOCK).clamp(1, MAX_BLOCKS);
        let mut blocks: Vec<Block> = Vec::with_capacity(num_blocks);
        for index in 0..num_blocks {
            // Samples of one score stay together, so that every score has one rate.
            let end = |share: usize| {
                let at = share * samples.len() / num_blocks;
                match at.checked_sub(1).map(|last| samples[last].0) {
                    Some(score) => samples.partition_point(|sample| sample.0 <= score),
                    None => 0,
                }
            };
            let part = &samples[end(index)..end(index + 1)];
            if part.is_empty() {
                continue;
            }
            let mut block = Block {
                score_sum: part.iter().map(|sample| sample.0).sum(),
                // Half a hit and half a miss are spread over the blocks before they are pooled:
                // rates then rise as pooling makes them.
                hits: part.iter().filter(|sample| sample.1).count() as f64
                    + 0.5 / num_blocks as f64,
                count: part.len() as f64 + 1.0 / num_blocks as f64,
            };
            let mean_score = block.score_sum / part.len() as f64;
            block.score_sum = mean_score * block.count;
            while let Some(last) = blocks.last()
                && last.hits * block.count >= block.hits * last.count
            {
                block.score_sum += last.score_sum;
                block.hits += last.hits;
                block.count += last.count;
                blocks.pop();
            }
            blocks.push(block);
        }
        let knots = (blocks.iter())
            .map(|block| (block.score_sum / block.count, block.hits / block.count))
            .collect();
        Some(Self { knots })
    }

    /// The rate that `score` stands for.
    pub fn rate(&self, score: f64) -> f64 {
        let above = self.knots.partition_point(|knot| knot.0 <= score);
        match (
            above.checked_sub(1).map(|below| self.knots[below]),
            self.knots.get(above),
        ) {
            (Some(below), Some(&above)) => {
                below.1 + (above.1 - below.1) * (score - below.0) / (above.0 - below.0)
            }
            (Some(end), None) => end.1,
            (None, Some(end)) => end.1,
            (None, None) => 0.5,
        }
    }

    /// Its corners: (score, rate), ascending.
    pub fn knots(&self) -> &[(f64, f64)] {
        &self.knots
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn rates_that_rise_with_the_score_are_found() {
        let mut samples: Vec<(f64, bool)> = (0..4000)
            .map(|i| {
                let level = i % 4;
                (f64::from(level), (i / 4) % 10 < level * 3)
            })
            .collect();
        let curve = Curve::fit(&mut samples).expect("samples");
        for level in 0..4 {
            let expected = f64::from(level) * 0.3;
            let rate = curve.rate(f64::from(level));
            assert!((rate - expected).abs() < 0.01, "{level}: {rate}");
        }
        assert!((curve.rate(1.5) - 0.45).abs() < 0.05);
        assert_eq!(curve.rate(-7.0), curve.rate(0.0));
    }

    #[test]
    fn a_score_that_says_nothing_gives_one_rate() {
        let mut samples: Vec<(f64, bool)> = (0..1000).map(|i| (f64::from(i), i < 300)).collect();
        let curve = Curve::fit(&mut samples).expect("samples");
        assert_eq!(curve.knots().len(), 1);
        assert!((curve.rate(0.0) - 0.3).abs() < 0.001);
        assert_eq!(Curve::fit(&mut []), None);
    }

    proptest! {
        #[test]
        fn rates_never_fall(
            mut samples in prop::collection::vec((-2.0..2.0_f64, any::<bool>()), 1..400),
            scores in prop::collection::vec(-3.0..3.0_f64, 2..20),
        ) {
            let curve = Curve::fit(&mut samples).expect("samples");
            let mut scores = scores;
            scores.sort_by(f64::total_cmp);
            let rates: Vec<f64> = scores.iter().map(|&score| curve.rate(score)).collect();
            prop_assert!(rates.is_sorted());
            prop_assert!(rates.iter().all(|rate| (0.0..1.0).contains(rate) && *rate > 0.0));
        }
    }
}

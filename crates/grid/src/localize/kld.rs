//! How many particles does their spread need?

use std::collections::HashSet;
use std::f64::consts::TAU;

use crate::pose::{Pose2, wrap};

/// Counts the bins that particles fall into, and how many particles so many bins need (D. Fox:
/// Adapting the sample size in particle filters through KLD-sampling, IJRR 2003, eq. 7).
#[derive(Clone, Debug)]
pub(super) struct KldBound {
    bin_m: f64,
    num_headings: i64,
    error: f64,
    quantile: f64,
    bins: HashSet<[i64; 3]>,
}

impl KldBound {
    /// With probability given by the normal `quantile`, the particles' distribution differs from the
    /// true one by at most `error` (Kullback-Leibler).
    pub(super) fn new(bin_m: f64, num_headings: i64, error: f64, quantile: f64) -> Self {
        Self {
            bin_m,
            num_headings,
            error,
            quantile,
            bins: HashSet::new(),
        }
    }

    /// A bin of headings, counted round.
    pub(super) const fn heading(&self, bin: i64) -> i64 {
        bin.rem_euclid(self.num_headings)
    }

    /// The bin of a pose.
    pub(super) fn bin(&self, pose: &Pose2) -> [i64; 3] {
        [
            (pose.x_m / self.bin_m).floor() as i64,
            (pose.y_m / self.bin_m).floor() as i64,
            self.heading(
                ((wrap(pose.heading_rad) / TAU) * self.num_headings as f64).floor() as i64,
            ),
        ]
    }

    /// Counts a pose and says how many are needed now.
    pub(super) fn add(&mut self, pose: &Pose2) -> f64 {
        let bin = self.bin(pose);
        self.bins.insert(bin);
        let k = self.bins.len() as f64;
        if k < 2.0 {
            return 0.0;
        }
        let a = 2.0 / (9.0 * (k - 1.0));
        let b = 1.0 - a + a.sqrt() * self.quantile;
        (k - 1.0) / (2.0 * self.error) * b * b * b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wider_spread_needs_more_particles() {
        let need = |count: u32| {
            let mut bound = KldBound::new(0.5, 36, 0.05, 2.33);
            let poses = (0..count).map(|i| Pose2::new(f64::from(i), 0.0, 0.0));
            poses.map(|pose| bound.add(&pose)).last().unwrap_or(0.0)
        };
        assert_eq!(need(1), 0.0);
        // Chi-square with 9 and 99 degrees of freedom at 99 %: 21.67 and 134.64.
        assert!((need(10) - 21.67 / 0.1).abs() < 2.0, "{}", need(10));
        assert!((need(100) - 134.64 / 0.1).abs() < 5.0, "{}", need(100));
    }
}

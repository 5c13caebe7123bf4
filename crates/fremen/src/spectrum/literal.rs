//! What do the papers' own update rules give?
//!
//! For parity only. Both are incremental averages in the order of arrival, as printed; prediction
//! uses the factor 2 (see the errata in [`spectrum`](crate::spectrum)).

use serde::{Deserialize, Serialize};

use super::candidates::CandidatePeriods;
use super::rhythms::Rhythms;
use super::select::strongest;
use super::sums::P_UNKNOWN;
use crate::time::Time;

/// How a rhythm's strength is freed of the sampling's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Balance {
    /// `g_k = (S_k - mu W_k) / m` with the mean of all observations.
    #[default]
    Exact,
    /// No balance: `g_k = S_k / m` (T-RO eq. 11). Irregular sampling shows up as rhythms of its
    /// own.
    AlphaOnly,
    /// `g_k = alpha_k - beta_k`, beta with the mean so far (RAS eq. 3). Depends on the order of
    /// arrival, so it cannot be merged, and early observations are balanced with a poor mean.
    RunningMean,
}

/// A state learnt by T-RO eq. 11 or RAS eq. 3 as printed.
///
/// O(K) an observation, `32 K` bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct LiteralFremen {
    candidates: CandidatePeriods,
    balance: Balance,
    num_observed: f64,
    mean: f64,
    /// Averages of `s cos` and `s sin`.
    alpha: Vec<f64>,
    /// Averages of `mu cos` and `mu sin`.
    beta: Vec<f64>,
    phasors: Vec<f64>,
}

impl LiteralFremen {
    /// No observations. [`Balance::Exact`] is made of the same averages: beta with the final mean.
    pub fn new(candidates: CandidatePeriods, balance: Balance) -> Self {
        let width = 2 * candidates.len();
        Self {
            candidates,
            balance,
            num_observed: 0.0,
            mean: P_UNKNOWN,
            alpha: vec![0.0; width],
            beta: vec![0.0; width],
            phasors: vec![0.0; width],
        }
    }

    /// Adds one observation.
    pub fn add(&mut self, time: Time, state: bool) {
        let state = f64::from(u8::from(state));
        let count = self.num_observed + 1.0;
        let average = |old: f64, new: f64| (self.num_observed * old + new) / count;
        self.mean = average(self.mean, state);
        let mean = match self.balance {
            Balance::Exact => 1.0,
            Balance::AlphaOnly => 0.0,
            Balance::RunningMean => self.mean,
        };
        self.candidates.phasors_into(time, &mut self.phasors);
        let averages = self.alpha.iter_mut().zip(&mut self.beta);
        for ((alpha, beta), &phasor) in averages.zip(&self.phasors) {
            *alpha = average(*alpha, state * phasor);
            *beta = average(*beta, mean * phasor);
        }
        self.num_observed = count;
    }

    /// p(t) with the `order` strongest rhythms.
    pub fn rhythms(&self, order: usize) -> Rhythms {
        let count = self.candidates.len();
        let weight = match self.balance {
            Balance::Exact => self.mean,
            Balance::AlphaOnly | Balance::RunningMean => 1.0,
        };
        let gamma = |i: usize| self.alpha[i] - weight * self.beta[i];
        let mut powers: Vec<_> = (0..count)
            .map(|k| gamma(k).powi(2) + gamma(count + k).powi(2))
            .collect();
        let mut selected = vec![0; order.min(count)];
        let num_selected = strongest(&mut powers, &mut selected);
        let terms = selected[..num_selected]
            .iter()
            .map(|&k| {
                let at = usize::from(k);
                (k, 2.0 * gamma(at), 2.0 * gamma(count + at))
            })
            .collect();
        Rhythms::new(self.candidates.clone(), self.mean, terms)
    }
}

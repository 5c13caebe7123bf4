//! How often was it seen at about this time of day, of late?
//!
//! `p(t) = (sum of w s + prior mu) / (sum of w + prior)` over all looks, w the product of a Gaussian
//! of the distance round the day and of a half-life, mu the mean of the state with half a look at
//! each value added. No rhythm is chosen, so a few looks suffice to begin with; what is forgotten
//! makes room for habits that change.

use super::counts::LookCount;
use super::model::OnlineModel;
use crate::error::Result;
use crate::spectrum::P_UNKNOWN;
use crate::time::{Period, Time};

/// Parts of the cycle that are compared.
const HOURS: usize = 24;

/// As many stays at any hour may say as much of an hour as one stay at that hour: from hours that have
/// nothing in common to hours that are the same.
const ALIKE: [f64; 8] = [0.5, 1.0, 2.0, 4.0, 8.0, 32.0, 128.0, 512.0];

/// How a [`Histogram`] sees the looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Smoothing {
    /// Standard deviation of the Gaussian, in seconds.
    pub(super) width_s: f64,
    /// After so long a look counts half, in seconds; infinite: nothing is forgotten.
    pub(super) half_life_s: f64,
    /// Stays at the mean that are added to each bin.
    pub(super) prior: f64,
}

impl Smoothing {
    /// Half an hour round the day, three weeks back, one stay.
    pub(super) const DEFAULT: Self = Self {
        width_s: 1_800.0,
        half_life_s: 21.0 * 86_400.0,
        prior: 1.0,
    };
}

/// A smooth profile of a cycle; `16 B` bytes a state.
#[derive(Clone, Debug)]
pub(super) struct Histogram {
    period: Period,
    smoothing: Smoothing,
    num_states: usize,
    count: LookCount,
    num_looks: f64,
    /// Looks in bin b, what is forgotten taken off; of state i that were 1: at `i * bins + b`.
    observed: Vec<f64>,
    seen: Vec<f64>,
    /// When `observed` was brought up to date.
    as_of: Option<Time>,
    p: Vec<f64>,
    /// Stays that p of each bin rests on.
    near: Vec<f64>,
}

impl Histogram {
    pub(super) fn new(
        num_states: usize,
        period: Period,
        num_bins: usize,
        smoothing: Smoothing,
    ) -> Self {
        Self {
            period,
            smoothing,
            num_states,
            count: LookCount::default(),
            num_looks: 0.0,
            observed: vec![0.0; num_bins],
            seen: vec![0.0; num_states * num_bins],
            as_of: None,
            p: vec![P_UNKNOWN; num_states * num_bins],
            near: vec![0.0; num_bins],
        }
    }

    fn bin(&self, time: Time) -> usize {
        let num_bins = self.observed.len();
        ((time.phase(self.period) * num_bins as f64) as usize).min(num_bins - 1)
    }

    /// Lets what is known age until the last look.
    fn forget(&mut self) {
        let (Some(as_of), Some(last)) = (self.as_of.replace_with(self.count.last), self.count.last)
        else {
            return;
        };
        let kept = (-last.since_s(as_of).max(0.0) / self.smoothing.half_life_s).exp2();
        if kept < 1.0 {
            for weight in self.observed.iter_mut().chain(&mut self.seen) {
                *weight *= kept;
            }
        }
    }

    /// How probable each of [`ALIKE`] is: the share of a state at an hour comes from a beta
    /// distribution round its mean that counts so many stays, and any of them is as probable before
    /// the first look. All states of the place together.
    ///
    /// A few looks say nothing of it, so that hours that nobody has seen are unknown although the
    /// others were all the same; many looks at a coin say that all of its hours are alike, so that
    /// nothing is left to be learnt. p itself is not drawn to the mean so far: that made it worse.
    fn alike(&self, stays_per_look: f64) -> [f64; ALIKE.len()] {
        let num_bins = self.observed.len();
        let num_hours = num_bins.min(HOURS);
        let hour = |bin: usize| bin * num_hours / num_bins;
        let mut observed = vec![0.0; num_hours];
        for (bin, count) in self.observed.iter().enumerate() {
            observed[hour(bin)] += count * stays_per_look;
        }
        let total: f64 = observed.iter().sum();
        let mut log = [0.0; ALIKE.len()];
        let mut seen = vec![0.0; num_hours];
        for row in self.seen.chunks_exact(num_bins) {
            seen.fill(0.0);
            for (bin, count) in row.iter().enumerate() {
                seen[hour(bin)] += count * stays_per_look;
            }
            let mean = (seen.iter().sum::<f64>() + 0.5) / (total + 1.0);
            for (log, &stays) in log.iter_mut().zip(&ALIKE) {
                let ones = stays * mean;
                for (&observed, &seen) in observed.iter().zip(&seen) {
                    let unseen = (observed - seen).max(0.0);
                    *log += ln_rising(ones, seen) + ln_rising(stays - ones, unseen)
                        - ln_rising(stays, observed);
                }
            }
        }
        let most = log.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut weights = log.map(|log| (log - most).exp());
        let sum: f64 = weights.iter().sum();
        for weight in &mut weights {
            *weight /= sum;
        }
        weights
    }

    /// Weights of the bins 0, 1, ... away, each way round.
    fn kernel(&self) -> Vec<f64> {
        let num_bins = self.observed.len();
        let bin_s = self.period.as_s() / num_bins as f64;
        (0..num_bins)
            .map(|b| {
                let distance_s = b.min(num_bins - b) as f64 * bin_s;
                (-0.5 * (distance_s / self.smoothing.width_s).powi(2)).exp()
            })
            .map(|weight| if weight < 1e-3 { 0.0 } else { weight })
            .collect()
    }
}

/// `Option::replace` that keeps the old value where there is no new one.
trait ReplaceWith {
    fn replace_with(&mut self, new: Self) -> Self;
}

impl ReplaceWith for Option<Time> {
    fn replace_with(&mut self, new: Self) -> Self {
        let old = *self;
        *self = new.or(old);
        old
    }
}

/// `sum over b of kernel[b] values[at - b]`, round the cycle.
fn smooth(values: &[f64], kernel: &[f64], out: &mut [f64]) {
    let num_bins = values.len();
    out.fill(0.0);
    for (offset, &weight) in kernel
        .iter()
        .enumerate()
        .filter(|(_, weight)| **weight > 0.0)
    {
        for (at, out) in out.iter_mut().enumerate() {
            *out += weight * values[(at + offset) % num_bins];
        }
    }
}

/// `ln(gamma(x + count) / gamma(x))`, x above 0.
fn ln_rising(x: f64, count: f64) -> f64 {
    if count > 0.0 {
        ln_gamma(x + count) - ln_gamma(x)
    } else {
        0.0
    }
}

/// Stirling's series from 7 on, to nine digits.
fn ln_gamma(mut x: f64) -> f64 {
    let mut below = 1.0;
    while x < 7.0 {
        below *= x;
        x += 1.0;
    }
    let series = 1.0 / (12.0 * x) - 1.0 / (360.0 * x.powi(3)) + 1.0 / (1_260.0 * x.powi(5));
    (x - 0.5) * x.ln() - x + 0.5 * std::f64::consts::TAU.ln() + series - below.ln()
}

impl OnlineModel for Histogram {
    fn num_states(&self) -> usize {
        self.num_states
    }

    fn observe(&mut self, time: Time, states: &[bool]) {
        assert_eq!(states.len(), self.num_states, "one state each");
        let bin = self.bin(time);
        let num_bins = self.observed.len();
        self.observed[bin] += 1.0;
        for (i, &state) in states.iter().enumerate() {
            self.seen[i * num_bins + bin] += f64::from(u8::from(state));
        }
        self.num_looks += 1.0;
        self.count.add(time);
    }

    fn learn(&mut self) -> Result<()> {
        if self.num_looks < 1.0 {
            return Ok(());
        }
        self.forget();
        let num_bins = self.observed.len();
        let kernel = self.kernel();
        // Looks of one stay are nearly one.
        let stays_per_look = self.count.num_stays / self.num_looks;
        let mut near = vec![0.0; num_bins];
        smooth(&self.observed, &kernel, &mut near);
        let total: f64 = self.observed.iter().sum::<f64>() * stays_per_look;
        let alike = self.alike(stays_per_look);
        let prior = self.smoothing.prior;
        let rows = self.seen.chunks_exact(num_bins);
        for (seen, p) in rows.zip(self.p.chunks_exact_mut(num_bins)) {
            let mean = (seen.iter().sum::<f64>() * stays_per_look + 0.5) / (total + 1.0);
            smooth(seen, &kernel, p);
            for (p, &near) in p.iter_mut().zip(&near) {
                *p = ((*p * stays_per_look + prior * mean) / (near * stays_per_look + prior))
                    .clamp(0.0, 1.0);
            }
        }
        for near in &mut near {
            let stays = *near * stays_per_look;
            // So many stays have the variance of p that is expected.
            let each = alike.iter().zip(&ALIKE);
            let variance: f64 = each
                .map(|(weight, alike)| weight / (alike.min(total) + stays + 1.0))
                .sum();
            *near = 1.0 / variance - 1.0;
        }
        self.near = near;
        Ok(())
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        assert_eq!(out.len(), self.num_states, "one p each");
        let bin = self.bin(time);
        for (p, row) in out.iter_mut().zip(self.p.chunks_exact(self.observed.len())) {
            *p = row[bin];
        }
    }

    fn looks(&self, time: Time) -> f64 {
        self.near[self.bin(time)]
    }

    fn last_look(&self) -> Option<Time> {
        self.count.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A look at noon of so many days, and at every hour of so many others.
    fn looks_at_midnight(noons: i64, days: i64, state: impl Fn(i64) -> bool) -> f64 {
        let mut model = Histogram::new(1, Period::DAY, 96, Smoothing::DEFAULT);
        for day in 0..noons {
            model.observe(Time::from_s(day * 86_400 + 43_200), &[false]);
        }
        for hour in 0..24 * days {
            model.observe(Time::from_s((noons * 24 + hour) * 3_600), &[state(hour)]);
        }
        model.learn().unwrap_or_default();
        model.looks(Time::from_s(0))
    }

    #[test]
    fn hours_that_nobody_has_seen_are_unknown_until_hours_are_known_to_be_alike() {
        let noons = looks_at_midnight(12, 0, |_| false);
        assert!(noons < 3.0, "{noons}");
        // Every third hour, whatever the hour of the day: five days, then one more hour.
        let alike = looks_at_midnight(0, 15, |hour| hour % 25 % 3 == 0);
        assert!(alike > 30.0, "{alike}");
        // By day only: no night says anything of another hour.
        let differ = looks_at_midnight(0, 15, |hour| (8..20).contains(&(hour % 24)));
        assert!(differ < 0.6 * alike, "{differ} {alike}");
    }

    #[test]
    fn the_logarithm_of_gamma_is_that_of_factorials() {
        for (x, gamma) in [(1.0, 1.0_f64), (5.0, 24.0), (10.0, 362_880.0)] {
            assert!((ln_gamma(x) - gamma.ln()).abs() < 1e-8, "{x}");
        }
        assert!((ln_gamma(0.5) - std::f64::consts::PI.sqrt().ln()).abs() < 1e-8);
    }
}

//! For how long does the last look count?
//!
//! `p'(t) = p(t) + w(age) (s_last - p(t))`, as T-RO 2017 eq. 13, but with a w that is measured at
//! every age instead of assumed to be exponential. Looks are paired with earlier ones of the same
//! place, one pair for each octave of age, and in each octave
//!
//! `w = (sum of (s - p)(s_earlier - p) + prior w_slower) / (sum of (s_earlier - p)^2 + prior)`
//!
//! over all states of the place: the least-squares slope of what is seen on what was seen, shrunk
//! to the octave below it, and never above that. Looks of one stay (ten minutes) are not paired:
//! what counts is what a stay says of a later one. A coin that is tossed from stay to stay has w = 0
//! from the first octave on, whatever the time between changes seems to be.
//!
//! How well w is known says what a look may be worth that would show it: the expectation of `w^2` is
//! the square of what was measured and the variance of that, which falls from that of a uniform w as
//! stays are paired. A place whose first few looks had nothing in common is so not given up.
//!
//! `Deviation:` T-RO eq. 12 takes the rate of changes between consecutive looks for all ages alike,
//! so that looks a minute apart decide what is believed hours later.

use std::collections::VecDeque;

use super::counts::LookCount;
use super::model::OnlineModel;
use crate::error::Result;
use crate::time::Time;

/// The first octave is 45 to 90 s; the last ends after six days.
const FIRST_S: f64 = 45.0;
const NUM_OCTAVES: usize = 14;

/// What is left after each octave, which never grows, and its weight: neighbours that say otherwise
/// are one (pool adjacent violators).
fn pooled(octaves: impl Iterator<Item = (f64, f64)>) -> [(f64, f64); NUM_OCTAVES] {
    let mut steps: Vec<Step> = Vec::with_capacity(NUM_OCTAVES);
    for (kept, weight) in octaves {
        let mut step = Step {
            kept,
            weight,
            octaves: 1,
        };
        while let Some(before) = steps.pop_if(|before| before.kept < step.kept) {
            step = before.with(step);
        }
        steps.push(step);
    }
    let each =
        (steps.iter()).flat_map(|step| std::iter::repeat_n((step.kept, step.weight), step.octaves));
    let mut pooled = [(0.0, 0.0); NUM_OCTAVES];
    for (pooled, kept) in pooled.iter_mut().zip(each) {
        *pooled = kept;
    }
    pooled
}

/// At `age_s`, the logarithm of the age counting between the middles of octaves; 1 at no age.
fn at_age(kept: &[f64; NUM_OCTAVES], age_s: f64) -> f64 {
    let octave = (age_s.max(1.0) / FIRST_S).log2() - 0.5;
    if octave <= 0.0 {
        let share = (age_s / (FIRST_S * std::f64::consts::SQRT_2)).clamp(0.0, 1.0);
        return 1.0 + share * (kept[0] - 1.0);
    }
    let below = (octave as usize).min(NUM_OCTAVES - 1);
    let above = kept.get(below + 1).copied().unwrap_or(0.0);
    let share = (octave - below as f64).clamp(0.0, 1.0);
    kept[below] + share * (above - kept[below])
}

/// Of what is left after one octave, so much is expected to be left after the next.
const EXPECTED: f64 = 0.75;

/// Squared surprises that what is expected counts as.
const PRIOR: f64 = 1.0;

/// The variance of a share of which nothing is known: uniform in [0, 1].
const UNKNOWN_VARIANCE: f64 = 1.0 / 12.0;

/// Its mean square.
const UNKNOWN_SQUARED: f64 = 1.0 / 3.0;

/// The largest variance of a state, by which that of the slope is bounded: where only a few of many
/// looks were a surprise, little is known of what surprises leave behind.
const STATE_VARIANCE: f64 = 0.25;

/// Of one octave: what pairs of looks say together, and the earlier one alone.
#[derive(Clone, Copy, Debug, Default)]
struct PairSums {
    /// `sum of (s - p)(s_earlier - p)`.
    both: f64,
    /// `sum of (s_earlier - p)^2`.
    earlier: f64,
}

/// Octaves that share what is left.
#[derive(Clone, Copy, Debug)]
struct Step {
    kept: f64,
    weight: f64,
    octaves: usize,
}

impl Step {
    fn with(self, next: Self) -> Self {
        let weight = self.weight + next.weight;
        Self {
            kept: (self.kept * self.weight + next.kept * next.weight) / weight,
            weight,
            octaves: self.octaves + next.octaves,
        }
    }
}

/// Looks that are kept to be paired.
const MAX_KEPT: usize = 4096;

/// Any model with the last look first.
#[derive(Debug)]
pub(super) struct Persistent {
    of: Box<dyn OnlineModel>,
    looks: VecDeque<Look>,
    count: LookCount,
    num_looks: f64,
    sums: [PairSums; NUM_OCTAVES],
    /// `w` at the middle of each octave.
    kept: [f64; NUM_OCTAVES],
    /// The expectation of its square.
    kept_squared: [f64; NUM_OCTAVES],
    usual: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Look {
    time: Time,
    states: Vec<bool>,
    /// Looks of one stay have the same.
    stay: f64,
}

impl Persistent {
    pub(super) fn new(of: Box<dyn OnlineModel>) -> Self {
        Self {
            usual: vec![0.0; of.num_states()],
            of,
            looks: VecDeque::new(),
            count: LookCount::default(),
            num_looks: 0.0,
            sums: [PairSums::default(); NUM_OCTAVES],
            kept: [0.0; NUM_OCTAVES],
            kept_squared: [UNKNOWN_SQUARED; NUM_OCTAVES],
        }
    }

    fn pair(&mut self, time: Time, states: &[bool]) {
        self.of.usual_into(time, &mut self.usual);
        let mut at = self.looks.len();
        for (octave, sums) in self.sums.iter_mut().enumerate() {
            let least_s = FIRST_S * f64::from(1 << octave);
            // The latest look that is at least so old.
            let is_too_near = |look: &Look| {
                time.since_s(look.time) < least_s || look.stay >= self.count.num_stays
            };
            while at > 0 && is_too_near(&self.looks[at - 1]) {
                at -= 1;
            }
            let Some(earlier) = at.checked_sub(1).map(|at| &self.looks[at]) else {
                return;
            };
            if time.since_s(earlier.time) >= 2.0 * least_s {
                continue;
            }
            for ((&state, &was), &p) in states.iter().zip(&earlier.states).zip(&self.usual) {
                let (now, before) = (f64::from(u8::from(state)), f64::from(u8::from(was)));
                sums.both += (now - p) * (before - p);
                sums.earlier += (before - p) * (before - p);
            }
        }
    }
}

impl OnlineModel for Persistent {
    fn num_states(&self) -> usize {
        self.of.num_states()
    }

    fn observe(&mut self, time: Time, states: &[bool]) {
        let is_latest = self.of.last_look().is_none_or(|last| time >= last);
        if is_latest {
            self.count.add(time);
            self.num_looks += 1.0;
            self.pair(time, states);
            if self.looks.len() == MAX_KEPT {
                self.looks.pop_front();
            }
            self.looks.push_back(Look {
                time,
                states: states.to_vec(),
                stay: self.count.num_stays,
            });
        }
        self.of.observe(time, states);
    }

    fn learn(&mut self) -> Result<()> {
        self.of.learn()?;
        let octaves = pooled(self.sums.iter().scan(1.0_f64, |shorter, sums| {
            // Where little is known, a quarter of what is left is gone after each octave.
            let weight = sums.earlier + PRIOR;
            let kept = (sums.both + PRIOR * EXPECTED * *shorter) / weight;
            *shorter = kept.clamp(0.0, 1.0);
            Some((*shorter, weight))
        }));
        // Looks of one stay are nearly one.
        let stays_per_look = self.count.num_stays / self.num_looks.max(1.0);
        let mut shorter = 1.0_f64;
        for (octave, (kept, weight)) in octaves.into_iter().enumerate() {
            self.kept[octave] = kept;
            let known = weight * stays_per_look / STATE_VARIANCE;
            let variance = 1.0 / (1.0 / UNKNOWN_VARIANCE + known);
            shorter = shorter.min(kept * kept + variance);
            self.kept_squared[octave] = shorter;
        }
        Ok(())
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        self.of.usual_into(time, out);
        if let Some(last) = self.looks.back() {
            let kept = at_age(&self.kept, time.since_s(last.time).abs());
            for (p, &state) in out.iter_mut().zip(&last.states) {
                *p += kept * (f64::from(u8::from(state)) - *p);
            }
        }
    }

    fn usual_into(&self, time: Time, out: &mut [f64]) {
        self.of.usual_into(time, out);
    }

    fn looks(&self, time: Time) -> f64 {
        self.of.looks(time)
    }

    fn kept(&self, age_s: f64) -> f64 {
        at_age(&self.kept, age_s)
    }

    fn kept_squared(&self, age_s: f64) -> f64 {
        at_age(&self.kept_squared, age_s)
    }

    fn last_look(&self) -> Option<Time> {
        self.of.last_look()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::online::long_term::LongTerm;

    /// Looks every hour at a coin.
    fn coin(num_looks: i64) -> Persistent {
        let mut model = Persistent::new(Box::new(LongTerm::new(1)));
        let mut number = 1_u64;
        for look in 0..num_looks {
            number = number
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            model.observe(Time::from_s(look * 3_600), &[number >> 63 == 1]);
            if look % 24 == 23 {
                model.learn().unwrap_or_default();
            }
        }
        model.learn().unwrap_or_default();
        model
    }

    #[test]
    fn what_is_expected_falls_as_stays_are_paired_and_never_below_what_is_measured() {
        let hours = |hours: f64| hours * 3_600.0;
        let nothing = coin(0);
        assert!(nothing.kept_squared(hours(2.0)) > UNKNOWN_VARIANCE);
        let [few, many] = [9, 4_000].map(coin);
        // Nine looks without anything in common: nobody knows.
        let [few_say, many_say] = [&few, &many].map(|model| model.kept_squared(hours(2.0)));
        assert!(few_say > 0.008, "{few_say}");
        assert!(many_say < 0.2 * few_say, "{many_say}");
        for model in [&nothing, &few, &many] {
            let ages = [0.0, 0.1, 0.5, 1.0, 2.0, 8.0, 24.0, 100.0].map(hours);
            let squared = ages.map(|age_s| model.kept_squared(age_s));
            assert!(squared.is_sorted_by(|a, b| a >= b), "{squared:?}");
            for (&age_s, &squared) in ages.iter().zip(&squared).skip(3) {
                assert!((0.0..=1.0).contains(&squared));
                assert!(squared + 1e-3 >= model.kept(age_s).powi(2), "{age_s}");
            }
        }
    }
}

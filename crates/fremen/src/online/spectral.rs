//! Which rhythms do the looks so far bear out? (RAS 2016 eq. 3-4)
//!
//! `p(t) = clamp(mu + sum over the l strongest of 2 abs(g_k) cos(w_k t + arg g_k))` with the exact
//! balance `g_k = (S_k - mu W_k) / m`; all states of a place share `W_k`.
//!
//! The order l of a state is the one that would have predicted it best so far: each look is first
//! predicted with 0, 1, ... rhythms by what was learnt before it, and only then learnt (RAS 4.1.3,
//! the paper's comparison "by means of (2)"). So order 0 stands until a day has been learnt and
//! another has judged it. `Deviation:` squared errors are compared, and count half after two weeks,
//! instead of the states that are wrong since the beginning.

use super::counts::LookCount;
use super::model::OnlineModel;
use crate::error::Result;
use crate::spectrum::{
    CandidatePeriods, MAX_OBSERVATIONS, P_UNKNOWN, from_fixed, strongest, to_fixed, too_many,
};
use crate::time::Time;

/// After so long an error counts half.
const HALF_LIFE_S: f64 = 14.0 * 86_400.0;

/// FreMEn of the states of one place; `16 K + 24 l` bytes a state and `16 K` for the place.
#[derive(Clone, Debug)]
pub(super) struct Spectral {
    candidates: CandidatePeriods,
    max_order: usize,
    count: LookCount,
    num_looks: usize,
    /// `W_k`: cosines, then sines.
    observed: Vec<i64>,
    num_seen: Vec<u32>,
    /// `S_k` of one state after the other.
    seen: Vec<i64>,
    /// Squared errors of a state's predictions by 0, 1, ... rhythms, one state after the other.
    errors: Vec<f64>,
    /// Until when what is in `errors` has aged.
    as_of: Option<Time>,
    learnt: Vec<Learnt>,
    phasors: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Learnt {
    mean: f64,
    order: usize,
    /// Index of the candidate, factors of its cosine and sine; strongest first.
    terms: Vec<(u16, f64, f64)>,
}

impl Spectral {
    pub(super) fn new(num_states: usize, candidates: CandidatePeriods, max_order: usize) -> Self {
        let width = 2 * candidates.len();
        let learnt = Learnt {
            mean: P_UNKNOWN,
            order: 0,
            terms: Vec::new(),
        };
        Self {
            max_order: max_order.min(candidates.len()),
            candidates,
            count: LookCount::default(),
            num_looks: 0,
            observed: vec![0; width],
            num_seen: vec![0; num_states],
            seen: vec![0; num_states * width],
            errors: vec![0.0; num_states * (max_order + 1)],
            as_of: None,
            learnt: vec![learnt; num_states],
            phasors: vec![0.0; width],
        }
    }

    /// Judges the orders by a look, whose phasors are known.
    fn judge(&mut self, states: &[bool]) {
        let (cos, sin) = self.phasors.split_at(self.candidates.len());
        let rows = self.errors.chunks_exact_mut(self.max_order + 1);
        for ((errors, learnt), &state) in rows.zip(&self.learnt).zip(states) {
            let mut p = learnt.mean;
            for (order, errors) in errors.iter_mut().enumerate() {
                if let Some(&(k, re, im)) = order.checked_sub(1).and_then(|l| learnt.terms.get(l)) {
                    p += re * cos[usize::from(k)] + im * sin[usize::from(k)];
                }
                let error = p.clamp(0.0, 1.0) - f64::from(u8::from(state));
                *errors += error * error;
            }
        }
    }
}

impl OnlineModel for Spectral {
    fn num_states(&self) -> usize {
        self.num_seen.len()
    }

    fn observe(&mut self, time: Time, states: &[bool]) {
        assert_eq!(states.len(), self.num_seen.len(), "one state each");
        let mut phasors = std::mem::take(&mut self.phasors);
        self.candidates.phasors_into(time, &mut phasors);
        self.phasors = phasors;
        self.judge(states);
        for (sum, &phasor) in self.observed.iter_mut().zip(&self.phasors) {
            *sum = sum.wrapping_add(to_fixed(phasor));
        }
        let rows = self.seen.chunks_exact_mut(self.observed.len());
        for ((row, num_seen), &state) in rows.zip(&mut self.num_seen).zip(states) {
            if state {
                *num_seen += 1;
                for (sum, &phasor) in row.iter_mut().zip(&self.phasors) {
                    *sum = sum.wrapping_add(to_fixed(phasor));
                }
            }
        }
        self.num_looks += 1;
        self.count.add(time);
    }

    fn learn(&mut self) -> Result<()> {
        if self.num_looks > MAX_OBSERVATIONS {
            return Err(too_many(self.num_looks));
        }
        if self.num_looks == 0 {
            return Ok(());
        }
        if let (Some(last), Some(as_of)) = (self.count.last, self.as_of) {
            let kept = (-last.since_s(as_of).max(0.0) / HALF_LIFE_S).exp2();
            self.errors.iter_mut().for_each(|error| *error *= kept);
        }
        self.as_of = self.count.last;
        let num_candidates = self.candidates.len();
        let scale = 1.0 / self.num_looks as f64;
        let mut powers = vec![0.0; num_candidates];
        let mut g = vec![0.0; 2 * num_candidates];
        let mut selected = vec![0; self.max_order];
        for (state, learnt) in self.learnt.iter_mut().enumerate() {
            learnt.mean = f64::from(self.num_seen[state]) * scale;
            let row = &self.seen[state * g.len()..(state + 1) * g.len()];
            for ((g, &seen), &observed) in g.iter_mut().zip(row).zip(&self.observed) {
                *g = (from_fixed(seen) - learnt.mean * from_fixed(observed)) * scale;
            }
            let (cos, sin) = g.split_at(num_candidates);
            for (k, power) in powers.iter_mut().enumerate() {
                *power = cos[k] * cos[k] + sin[k] * sin[k];
            }
            let count = strongest(&mut powers, &mut selected);
            learnt.terms = (selected[..count].iter())
                .map(|&k| (k, 2.0 * cos[usize::from(k)], 2.0 * sin[usize::from(k)]))
                .collect();
            let orders = self.max_order + 1;
            let errors = &self.errors[state * orders..(state + 1) * orders];
            // The lower one of equals.
            let by_error = |&a: &usize, &b: &usize| errors[a].total_cmp(&errors[b]);
            learnt.order = (0..orders).min_by(by_error).unwrap_or(0);
        }
        Ok(())
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        assert_eq!(out.len(), self.learnt.len(), "one p each");
        let num_terms: usize = self.learnt.iter().map(|it| it.order).sum();
        if num_terms * 8 < self.candidates.len() {
            for (p, learnt) in out.iter_mut().zip(&self.learnt) {
                let mut sum = learnt.mean;
                for &(k, re, im) in learnt.terms.iter().take(learnt.order) {
                    let (cos, sin) = self.candidates.phasor(usize::from(k), time);
                    sum += re * cos + im * sin;
                }
                *p = sum.clamp(0.0, 1.0);
            }
            return;
        }
        let mut phasors = vec![0.0; 2 * self.candidates.len()];
        self.candidates.phasors_into(time, &mut phasors);
        let (cos, sin) = phasors.split_at(self.candidates.len());
        for (p, learnt) in out.iter_mut().zip(&self.learnt) {
            let mut sum = learnt.mean;
            for &(k, re, im) in learnt.terms.iter().take(learnt.order) {
                sum += re * cos[usize::from(k)] + im * sin[usize::from(k)];
            }
            *p = sum.clamp(0.0, 1.0);
        }
    }

    /// A level and two numbers a rhythm share the looks.
    fn looks(&self, _time: Time) -> f64 {
        let order = self.learnt.iter().map(|it| it.order).max().unwrap_or(0);
        self.count.num_stays / (1 + 2 * order) as f64
    }

    fn last_look(&self) -> Option<Time> {
        self.count.last
    }
}

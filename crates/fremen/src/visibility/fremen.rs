//! Which rhythms does each feature follow?
//!
//! `p(t) = clamp(mu + sum over the l largest abs(g_k) of 2 abs(g_k) cos(w_k t + arg g_k))`
//! with `g_k = (S_k - mu W_k) / m` (T-RO 2017 eq. 10-11, RAS 2016 eq. 3-4; errata in
//! [`spectrum`](crate::spectrum)).
//!
//! # Cost of learning
//!
//! With V visits, K candidates and B one bits in the log (or zero bits, where a feature has fewer
//! of them): `S_k` of all features costs O(B K) additions, `W_k` is shared by all features of a
//! birth cohort and costs O(V K), selection O(F K l). Features are taken in blocks whose sums stay
//! in the cache, so memory is O(V K) beyond the model. Hidden bits are exact: a feature that was
//! not observable at a visit has that visit's phasors taken out of its own `W_k`. Sums are whole
//! numbers ([`PhasorTable`]), so no order of summation shows.

use super::VisibilityModel;
use super::chance;
use super::codec;
use super::config::{Guards, HeldOut, Order, Split};
use super::evidence::{Counts, Evidence};
use crate::error::Result;
use crate::spectrum::{
    Balance, CandidatePeriods, Component, PhasorTable, Reader, SpectralSums, Writer, from_fixed,
    strongest,
};
use crate::time::Time;

/// The sums of one block of features stay within this.
const BLOCK_BYTES: usize = 4 * 1024 * 1024;

/// So many candidates have their phasors on the stack during a prediction; more are put on the
/// heap.
const CANDIDATES_ON_STACK: usize = 256;

/// FreMEn for every feature of a place.
///
/// `8 + 18 l` bytes a feature. A prediction of all F features takes the phasors of the K candidates
/// once and two products a component: O(K + F l), no trigonometry per feature.
///
/// Not for features with few visits and many candidates: the strongest of many rhythms over few
/// visits is mostly chance; use guards, a held-out order or fewer candidates.
#[derive(Clone, Debug, PartialEq)]
pub struct Fremen {
    candidates: CandidatePeriods,
    order: usize,
    mean: Vec<f64>,
    /// Component `slot` of feature f is at `slot * num_features + f`; an unused one has terms 0.
    candidate: Vec<u16>,
    /// Factors of `cos(w_k t)` and `sin(w_k t)`: `2 re g_k` and `-2 im g_k`.
    terms: Vec<(f64, f64)>,
}

impl Fremen {
    /// Every feature at its mean; the fit fills in components.
    pub(super) fn of_means(candidates: CandidatePeriods, order: usize, mean: Vec<f64>) -> Self {
        let slots = order * mean.len();
        Self {
            candidates,
            order,
            mean,
            candidate: vec![0; slots],
            terms: vec![(0.0, 0.0); slots],
        }
    }

    /// The model of one state, of what is left of its history: its sums.
    ///
    /// The same, bit for bit, as [`fit`](super::fit) of a log of these observations with
    /// [`Order::Fixed`] and without guards.
    pub fn of_sums(sums: &SpectralSums, order: usize) -> Self {
        let candidates = sums.candidates().clone();
        let order = order.min(candidates.len());
        let mut model = Self::of_means(candidates, order, vec![sums.mean()]);
        for (slot, &(k, cos, sin)) in sums.rhythms(order).terms().iter().enumerate() {
            model.candidate[slot] = k;
            model.terms[slot] = (cos, sin);
        }
        model
    }

    /// From what [`to_parts`](Self::to_parts) gave; `None` if the parts do not fit each other.
    pub fn from_parts(
        candidates: CandidatePeriods,
        order: usize,
        mean: Vec<f64>,
        candidate: Vec<u16>,
        terms: Vec<(f64, f64)>,
    ) -> Option<Self> {
        let num_slots = order.checked_mul(mean.len())?;
        let fits = candidate.len() == num_slots
            && terms.len() == num_slots
            && candidate.iter().all(|&k| usize::from(k) < candidates.len());
        fits.then_some(Self {
            candidates,
            order,
            mean,
            candidate,
            terms,
        })
    }

    /// Means of the features; candidate and terms of component `slot` of feature f at
    /// `slot * num_features + f`.
    pub fn to_parts(&self) -> (&[f64], &[u16], &[(f64, f64)]) {
        (&self.mean, &self.candidate, &self.terms)
    }

    /// Unused components are written too: their terms are 0.
    pub(super) fn write(&self, writer: &mut Writer) {
        self.candidates.write(writer);
        writer.varint(self.order as u64);
        writer.varint(self.mean.len() as u64);
        writer.floats(self.mean.iter().copied());
        for &candidate in &self.candidate {
            writer.u16(candidate);
        }
        writer.floats(self.terms.iter().flat_map(|&(cos, sin)| [cos, sin]));
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let candidates = CandidatePeriods::read(reader)?;
        let order = usize::try_from(reader.varint()?).unwrap_or(usize::MAX);
        let num_features = reader.count(8)?;
        let mean = reader.floats(num_features)?;
        let num_slots = order.saturating_mul(num_features);
        let candidate = reader.u16s(num_slots)?;
        let terms = reader.floats(num_slots.saturating_mul(2))?;
        let terms = terms
            .chunks_exact(2)
            .map(|pair| (pair[0], pair[1]))
            .collect();
        Self::from_parts(candidates, order, mean, candidate, terms)
            .ok_or_else(|| reader.impossible("parts of a model do not fit each other"))
    }

    /// The rhythms it was fitted with.
    pub fn candidates(&self) -> &CandidatePeriods {
        &self.candidates
    }

    /// The long-term mean of a feature.
    ///
    /// # Panics
    /// If there is no such feature.
    pub fn mean(&self, feature: usize) -> f64 {
        self.mean[feature]
    }

    /// Sets mean and components of a feature: harmonics from 1, factors of cosine and sine in turn.
    pub(super) fn set(&mut self, feature: usize, mean: f64, harmonics: &[u16], factors: &[f64]) {
        self.mean[feature] = mean;
        let pairs = factors.chunks_exact(2);
        for (slot, (&harmonic, pair)) in harmonics.iter().zip(pairs).enumerate() {
            let at = slot * self.mean.len() + feature;
            self.candidate[at] = harmonic - 1;
            self.terms[at] = (pair[0], pair[1]);
        }
    }

    /// Mean and rhythms of every feature, not clamped.
    pub(super) fn sums_into(&self, time: Time, out: &mut [f64]) {
        out.copy_from_slice(&self.mean);
        if self.order == 0 {
            return;
        }
        let count = self.mean.len().max(1);
        self.with_phasors(time, |cos, sin| {
            let slots = self.candidate.chunks(count).zip(self.terms.chunks(count));
            for (candidates, terms) in slots {
                for ((p, &k), &(re, im)) in out.iter_mut().zip(candidates).zip(terms) {
                    *p += re * cos[usize::from(k)] + im * sin[usize::from(k)];
                }
            }
        });
    }

    /// Mean and rhythms of one feature, not clamped.
    pub(super) fn sum_of(&self, feature: usize, time: Time) -> f64 {
        let mut p = self.mean[feature];
        for slot in (feature..self.terms.len()).step_by(self.mean.len()) {
            let (cos, sin) = self.candidates.phasor(self.candidate[slot].into(), time);
            let (re, im) = self.terms[slot];
            p += re * cos + im * sin;
        }
        p
    }

    /// Calls `with` with the cosines and the sines of all candidates at `time`.
    fn with_phasors<R>(&self, time: Time, with: impl FnOnce(&[f64], &[f64]) -> R) -> R {
        let count = self.candidates.len();
        let mut on_stack = [0.0; 2 * CANDIDATES_ON_STACK];
        let mut on_heap = Vec::new();
        let phasors = if count <= CANDIDATES_ON_STACK {
            &mut on_stack[..2 * count]
        } else {
            on_heap.resize(2 * count, 0.0);
            &mut on_heap[..]
        };
        self.candidates.phasors_into(time, phasors);
        let (cos, sin) = phasors.split_at(count);
        with(cos, sin)
    }
}

impl VisibilityModel for Fremen {
    fn num_features(&self) -> usize {
        self.mean.len()
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        self.sums_into(time, out);
        for p in out {
            *p = p.clamp(0.0, 1.0);
        }
    }

    fn score_into(&self, time: Time, out: &mut [f64]) {
        self.sums_into(time, out);
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        self.sum_of(feature, time).clamp(0.0, 1.0)
    }

    fn order(&self) -> usize {
        self.order
    }

    fn level(&self, feature: usize) -> Option<f64> {
        Some(self.mean[feature])
    }

    fn encode(&self) -> Option<Vec<u8>> {
        Some(codec::encode(codec::Kind::Fremen, |writer| {
            self.write(writer);
        }))
    }

    fn components(&self, feature: usize) -> Vec<Component> {
        assert!(feature < self.mean.len(), "no feature {feature}");
        (feature..self.terms.len())
            .step_by(self.mean.len())
            .filter(|&slot| self.terms[slot] != (0.0, 0.0))
            .map(|slot| {
                let (re, im) = self.terms[slot];
                let period_s = self.candidates.period_s(self.candidate[slot].into());
                Component::of_terms(period_s, re, im)
            })
            .collect()
    }
}

/// Fits FreMEn with a given order, or the one that predicts held-out visits best.
pub(super) fn fit(
    evidence: &Evidence<'_>,
    candidates: &CandidatePeriods,
    order: Order,
    balance: Balance,
    guards: Option<Guards>,
) -> Result<Fremen> {
    let learner = Learner {
        candidates,
        balance,
        allowed: guards.map(|guards| supported(evidence, candidates, guards)),
    };
    let order = match order {
        Order::Fixed(order) => order,
        Order::HeldOut(held_out) => learner.best_order(evidence, &held_out)?,
    };
    learner.learn(evidence, order)
}

/// Which candidates the times of the visits support and the place follows beyond chance.
pub(super) fn supported(
    evidence: &Evidence<'_>,
    candidates: &CandidatePeriods,
    guards: Guards,
) -> Vec<bool> {
    let mut allowed = supported_by_times(evidence, candidates, guards);
    if guards.min_sigmas() > 0.0 && allowed.contains(&true) {
        chance::refuse(evidence, candidates, guards.min_sigmas(), &mut allowed);
    }
    allowed
}

/// Which candidates the times of the visits support.
fn supported_by_times(
    evidence: &Evidence<'_>,
    candidates: &CandidatePeriods,
    guards: Guards,
) -> Vec<bool> {
    let mut times: Vec<_> = evidence.times().collect();
    times.sort_unstable();
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return vec![false; candidates.len()];
    };
    let span_s = last.since_s(*first);
    let mut gaps_s: Vec<_> = times.windows(2).map(|w| w[1].since_s(w[0])).collect();
    gaps_s.sort_unstable_by(f64::total_cmp);
    let median_gap_s = gaps_s.get(gaps_s.len() / 2).copied().unwrap_or(0.0);
    (0..candidates.len())
        .map(|k| {
            let period_s = candidates.period_s(k);
            guards.min_cycles() * period_s <= span_s && period_s >= guards.min_gaps() * median_gap_s
        })
        .collect()
}

/// Visits to learn from and visits to judge by, each in order of arrival.
pub(super) fn splits(evidence: &Evidence<'_>, split: Split) -> Vec<(Vec<usize>, Vec<usize>)> {
    let by_time = evidence.by_time();
    let count = by_time.len();
    let parts: Vec<_> = match split {
        Split::LastVisits(last) => vec![(count.saturating_sub(last), count)],
        Split::Folds(folds) => {
            let folds = folds.min(count / 2);
            (0..folds)
                .map(|i| (count * i / folds, count * (i + 1) / folds))
                .collect()
        }
    };
    parts
        .into_iter()
        .map(|(start, end)| {
            let mut learnt = [&by_time[..start], &by_time[end..]].concat();
            learnt.sort_unstable();
            (learnt, by_time[start..end].to_vec())
        })
        .collect()
}

struct Learner<'a> {
    candidates: &'a CandidatePeriods,
    balance: Balance,
    /// `None` if all are.
    allowed: Option<Vec<bool>>,
}

impl Learner<'_> {
    fn learn(&self, evidence: &Evidence<'_>, order: usize) -> Result<Fremen> {
        let order = order.min(self.candidates.len());
        let num_features = evidence.num_features();
        let counts = evidence.counts();
        let mut model = Fremen::of_means(self.candidates.clone(), order, counts.means());
        if order == 0 || evidence.visits.is_empty() {
            return Ok(model);
        }
        let table = PhasorTable::new(self.candidates, evidence.times())?;
        let width = table.width();
        let sums = BlockSums::new(evidence, &table);
        let block = (BLOCK_BYTES / (8 * width * 64)).max(1) * 64;
        let mut selected = vec![0; order];
        let mut powers = vec![0.0; self.candidates.len()];
        for first in (0..num_features).step_by(block) {
            let last = (first + block).min(num_features);
            let coefficients = match self.balance {
                Balance::RunningMean => running_mean(evidence, &table, first, last),
                Balance::Exact | Balance::AlphaOnly => {
                    sums.coefficients(&counts, self.balance, first, last)
                }
            };
            for (feature, g) in (first..last).zip(coefficients.chunks_exact(width)) {
                let (cos, sin) = g.split_at(self.candidates.len());
                for (k, power) in powers.iter_mut().enumerate() {
                    let is_allowed = self.allowed.as_ref().is_none_or(|allowed| allowed[k]);
                    *power = f64::from(u8::from(is_allowed)) * (cos[k] * cos[k] + sin[k] * sin[k]);
                }
                let count = strongest(&mut powers, &mut selected);
                for (slot, &k) in selected[..count].iter().enumerate() {
                    let at = slot * num_features + feature;
                    model.candidate[at] = k;
                    model.terms[at] = (2.0 * cos[usize::from(k)], 2.0 * sin[usize::from(k)]);
                }
            }
        }
        Ok(model)
    }

    /// The order with the lowest squared error on held-out visits; the lower one of equals.
    fn best_order(&self, evidence: &Evidence<'_>, held_out: &HeldOut) -> Result<usize> {
        let max_order = held_out.max_order().min(self.candidates.len());
        if evidence.visits.len() < held_out.min_visits() {
            return Ok(0);
        }
        let mut errors = vec![0.0; max_order + 1];
        for (learnt, judged) in splits(evidence, held_out.split()) {
            if learnt.is_empty() {
                return Ok(0);
            }
            let model = self.learn(&evidence.of_visits(learnt), max_order)?;
            for visit in judged {
                add_squared_errors(&model, evidence, visit, &mut errors);
            }
        }
        Ok(lowest(&errors))
    }
}

/// The index of the lowest value; the first of equals.
pub(super) fn lowest(errors: &[f64]) -> usize {
    let mut best = 0;
    for (i, error) in errors.iter().enumerate() {
        if *error < errors[best] {
            best = i;
        }
    }
    best
}

/// Adds the squared errors of orders 0, 1, ... at one visit.
fn add_squared_errors(model: &Fremen, evidence: &Evidence<'_>, visit: usize, errors: &mut [f64]) {
    model.with_phasors(evidence.log.times()[visit], |cos, sin| {
        evidence.for_each_state(visit, |feature, seen| {
            let state = f64::from(u8::from(seen));
            let mut p = model.mean[feature];
            for (order, error) in errors.iter_mut().enumerate() {
                if order > 0 {
                    let slot = (order - 1) * model.mean.len() + feature;
                    let k = usize::from(model.candidate[slot]);
                    let (re, im) = model.terms[slot];
                    p += re * cos[k] + im * sin[k];
                }
                *error += (p.clamp(0.0, 1.0) - state).powi(2);
            }
        });
    });
}

/// The sums of blocks of features, with all that features share.
pub(super) struct BlockSums<'a> {
    evidence: &'a Evidence<'a>,
    table: &'a PhasorTable,
    /// Row i: sums over all visits from index i on. Only row 0 if every feature counts from there.
    shared: Vec<i64>,
    any_hidden: bool,
}

impl<'a> BlockSums<'a> {
    pub(super) fn new(evidence: &'a Evidence<'_>, table: &'a PhasorTable) -> Self {
        let width = table.width();
        let num_visits = evidence.visits.len();
        let num_rows = match evidence.before_birth {
            super::BeforeBirth::NotSeen => 1,
            super::BeforeBirth::NotObservable => num_visits + 1,
        };
        let mut shared = vec![0; num_rows * width];
        let mut sum = vec![0; width];
        for i in (0..num_visits).rev() {
            table.add_to(i, &mut sum);
            if let Some(row) = shared.get_mut(i * width..(i + 1) * width) {
                row.copy_from_slice(&sum);
            }
        }
        Self {
            evidence,
            table,
            shared,
            any_hidden: evidence.any_hidden(),
        }
    }

    /// `S_k` and `W_k` of the features `first..last`, one row of the table's width a feature.
    pub(super) fn sums(&self, first: usize, last: usize) -> (Vec<i64>, Vec<i64>) {
        let width = self.table.width();
        let mut hidden = vec![
            0;
            if self.any_hidden {
                (last - first) * width
            } else {
                0
            }
        ];
        if self.any_hidden {
            let lists = self.evidence.hidden_lists(first, last);
            self.table.sums_into(&lists.rows(), &mut hidden);
        }
        let mut observed = Vec::with_capacity((last - first) * width);
        for feature in first..last {
            let from = self.evidence.first_visit(feature) * width;
            observed.extend_from_slice(&self.shared[from..from + width]);
        }
        for (observed, hidden) in observed.iter_mut().zip(hidden) {
            *observed -= hidden;
        }
        let mut seen = vec![0; (last - first) * width];
        let lists = self.evidence.seen_lists(first, last);
        self.table.sums_into(&lists.rows(), &mut seen);
        (seen, observed)
    }

    /// `re g_k` and `-im g_k` of the features `first..last`: cosines, then sines.
    fn coefficients(
        &self,
        counts: &Counts,
        balance: Balance,
        first: usize,
        last: usize,
    ) -> Vec<f64> {
        let width = self.table.width();
        let (seen, observed) = self.sums(first, last);
        let mut coefficients = Vec::with_capacity(seen.len());
        for (i, feature) in (first..last).enumerate() {
            let row = i * width..(i + 1) * width;
            let scale = 1.0 / f64::from(counts.observed[feature].max(1));
            let mean = match balance {
                Balance::Exact => counts.mean(feature),
                Balance::AlphaOnly | Balance::RunningMean => 0.0,
            };
            let sums = seen[row.clone()].iter().zip(&observed[row]);
            coefficients
                .extend(sums.map(|(&s, &w)| (from_fixed(s) - mean * from_fixed(w)) * scale));
        }
        coefficients
    }
}

/// `alpha_k - beta_k` of RAS eq. 3: every observation is balanced with the mean so far.
fn running_mean(
    evidence: &Evidence<'_>,
    table: &PhasorTable,
    first: usize,
    last: usize,
) -> Vec<f64> {
    let width = table.width();
    let mut coefficients = vec![0.0; (last - first) * width];
    let mut seen_so_far = vec![0.0; last - first];
    let mut observed_so_far = vec![0.0; last - first];
    for (index, &visit) in evidence.visits.iter().enumerate() {
        evidence.for_each_state(visit, |feature, seen| {
            if !(first..last).contains(&feature) {
                return;
            }
            let i = feature - first;
            let state = f64::from(u8::from(seen));
            seen_so_far[i] += state;
            observed_so_far[i] += 1.0;
            let excess = state - seen_so_far[i] / observed_so_far[i];
            let row = &mut coefficients[i * width..(i + 1) * width];
            table.for_each_phasor(index, |column, phasor| row[column] += excess * phasor);
        });
    }
    for (row, observed) in coefficients.chunks_exact_mut(width).zip(observed_so_far) {
        for g in row {
            *g /= f64::max(observed, 1.0);
        }
    }
    coefficients
}

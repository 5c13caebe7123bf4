//! Which rhythms does each feature follow?
//!
//! `p(t) = clamp(mu + sum over the l largest abs(g_k) of 2 abs(g_k) cos(w_k t + arg g_k))`
//! with `g_k = (S_k - mu W_k) / m` (T-RO 2017 eq. 10-11, RAS 2016 eq. 3-4; errata in
//! [`spectrum`](crate::spectrum)).

use super::{Component, VisibilityModel};
use crate::spectrum::CandidatePeriods;
use crate::time::Time;

/// So many candidates have their phasors on the stack during a prediction; more are put on the heap.
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
    pub(super) candidates: CandidatePeriods,
    pub(super) order: usize,
    pub(super) mean: Vec<f64>,
    /// Component `slot` of feature f is at `slot * num_features + f`; an unused one has terms 0.
    pub(super) candidate: Vec<u16>,
    /// Factors of `cos(w_k t)` and `sin(w_k t)`: `2 re g_k` and `-2 im g_k`.
    pub(super) terms: Vec<(f64, f64)>,
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

    /// Calls `with` with the cosines and the sines of all candidates at `time`.
    pub(super) fn with_phasors<R>(&self, time: Time, with: impl FnOnce(&[f64], &[f64]) -> R) -> R {
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
        self.score_into(time, out);
        for p in out {
            *p = p.clamp(0.0, 1.0);
        }
    }

    fn score_into(&self, time: Time, out: &mut [f64]) {
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

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        let mut p = self.mean[feature];
        for slot in (feature..self.terms.len()).step_by(self.mean.len()) {
            let (cos, sin) = self.candidates.phasor(self.candidate[slot].into(), time);
            let (re, im) = self.terms[slot];
            p += re * cos + im * sin;
        }
        p.clamp(0.0, 1.0)
    }

    fn order(&self) -> usize {
        self.order
    }

    fn components(&self, feature: usize) -> Vec<Component> {
        assert!(feature < self.mean.len(), "no feature {feature}");
        (feature..self.terms.len())
            .step_by(self.mean.len())
            .filter(|&slot| self.terms[slot] != (0.0, 0.0))
            .map(|slot| {
                let (re, im) = self.terms[slot];
                Component {
                    period_s: self.candidates.period_s(self.candidate[slot].into()),
                    amplitude: re.hypot(im),
                    phase_rad: (-im).atan2(re),
                }
            })
            .collect()
    }
}

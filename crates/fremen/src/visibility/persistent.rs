//! For how long does the last look count?
//!
//! `p'(t) = s_last w + p(t) (1 - w)`, `w = e^{-(t - t_last) / tau}`, round any model p (T-RO eq. 13);
//! `1 / tau` is the mean of `abs(s_i - s_{i-1}) / (t_i - t_{i-1})` over consecutive observations.
//!
//! Erratum: eq. 12 prints that mean with mixed counts n and n + 1; it is a plain mean here.
//! tau is infinite where nothing has ever changed: the only state known holds forever. A feature that
//! was never observed has the wrapped model's p. `Deviation:` observations at equal times have no rate
//! and are left out; before the last observation the distance in time counts.

use super::VisibilityModel;
use super::evidence::Evidence;
use super::markov::for_each_step;
use crate::spectrum::Component;
use crate::time::Time;

/// Persistence round another model; 24 bytes a feature and one exponential more than that model.
///
/// Not for judging a model on the very visits it was learnt from: there it knows the answer.
#[derive(Debug)]
pub struct Persistent {
    of: Box<dyn VisibilityModel>,
    /// `None` if it was never observed.
    features: Vec<Option<Memory>>,
}

#[derive(Clone, Copy, Debug)]
struct Memory {
    last_state: f64,
    last_time: Time,
    /// `1 / tau`.
    changes_per_s: f64,
}

impl Memory {
    fn p(&self, time: Time, long_term: f64) -> f64 {
        let age_s = time.since_s(self.last_time).abs();
        let weight = (-age_s * self.changes_per_s).exp();
        (self.last_state * weight + long_term * (1.0 - weight)).clamp(0.0, 1.0)
    }
}

/// O(visits x features).
pub(super) fn fit(evidence: &Evidence<'_>, of: Box<dyn VisibilityModel>) -> Persistent {
    let mut rates = vec![0.0; evidence.num_features()];
    let mut num_steps = vec![0_u32; evidence.num_features()];
    let latest = for_each_step(evidence, |feature, earlier, later| {
        let passed_s = later.time.since_s(earlier.time);
        if passed_s > 0.0 {
            num_steps[feature] += 1;
            if earlier.state != later.state {
                rates[feature] += 1.0 / passed_s;
            }
        }
    });
    let features = (latest.into_iter().zip(&rates).zip(&num_steps))
        .map(|((latest, &rate), &steps)| {
            latest.map(|latest| Memory {
                last_state: f64::from(u8::from(latest.state)),
                last_time: latest.time,
                changes_per_s: rate / f64::from(steps.max(1)),
            })
        })
        .collect();
    Persistent { of, features }
}

impl Persistent {
    /// The mean time between changes of a feature; infinite if it never changed or was never observed.
    ///
    /// # Panics
    /// If there is no such feature.
    pub fn tau_s(&self, feature: usize) -> f64 {
        self.features[feature].map_or(f64::INFINITY, |memory| memory.changes_per_s.recip())
    }
}

impl VisibilityModel for Persistent {
    fn num_features(&self) -> usize {
        self.features.len()
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        self.of.predict_into(time, out);
        for (p, memory) in out.iter_mut().zip(&self.features) {
            *p = memory.map_or(*p, |memory| memory.p(time, *p));
        }
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        let long_term = self.of.predict_one(feature, time);
        self.features[feature].map_or(long_term, |memory| memory.p(time, long_term))
    }

    fn order(&self) -> usize {
        self.of.order()
    }

    fn components(&self, feature: usize) -> Vec<Component> {
        self.of.components(feature)
    }
}

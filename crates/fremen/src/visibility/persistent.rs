//! For how long does the last look count?
//!
//! `p'(t) = s_last w + p(t) (1 - w)`, `w = e^{-(t - t_last) / tau}`, round any model p (T-RO eq.
//! 13); `1 / tau` is the mean of `abs(s_i - s_{i-1}) / (t_i - t_{i-1})` over consecutive
//! observations.
//!
//! Erratum: eq. 12 prints that mean with mixed counts n and n + 1; it is a plain mean here. tau is
//! infinite where nothing has ever changed: the only state known holds forever. A feature that was
//! never observed has the wrapped model's p. `Deviation:` observations at equal times have no rate
//! and are left out; before the last observation the distance in time counts.

use super::VisibilityModel;
use super::codec;
use super::evidence::Evidence;
use super::markov::for_each_step;
use crate::error::Result;
use crate::spectrum::{Component, Reader};
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
    pub(super) fn read(reader: &mut Reader<'_>, of: Box<dyn VisibilityModel>) -> Result<Self> {
        let count = reader.count(1)?;
        if count != of.num_features() {
            return Err(reader.impossible("features and those of the long term differ"));
        }
        let features = (0..count)
            .map(|_| {
                if reader.byte()? == 0 {
                    return Ok(None);
                }
                let last_time = Time::from_us(reader.signed()?);
                let numbers = reader.floats(2)?;
                let [last_state, changes_per_s] = [numbers[0], numbers[1]];
                if !(0.0..=1.0).contains(&last_state) || changes_per_s < 0.0 {
                    return Err(reader.impossible("this is no memory of a state"));
                }
                Ok(Some(Memory {
                    last_state,
                    last_time,
                    changes_per_s,
                }))
            })
            .collect::<Result<_>>()?;
        Ok(Self { of, features })
    }

    /// The mean time between changes of a feature; infinite if it never changed or was never
    /// observed.
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

    /// `None` if the model of the long term has no such form.
    fn encode(&self) -> Option<Vec<u8>> {
        let of = self.of.encode()?;
        Some(codec::encode(codec::Kind::Persistent, |writer| {
            writer.bytes(&of);
            writer.varint(self.features.len() as u64);
            for memory in &self.features {
                writer.byte(u8::from(memory.is_some()));
                if let Some(memory) = memory {
                    writer.signed(memory.last_time.as_us());
                    writer.floats([memory.last_state, memory.changes_per_s]);
                }
            }
        }))
    }

    fn components(&self, feature: usize) -> Vec<Component> {
        self.of.components(feature)
    }
}

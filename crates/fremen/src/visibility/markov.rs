//! Is it still as it was last seen?
//!
//! A continuous Markov chain of two states: `p(t) = q + (s - q) e^{-(alpha + beta) (t - t_last)}`
//! with `q = alpha / (alpha + beta)`, alpha the rate of appearing and beta of vanishing (RAS 2016
//! eq. 5-6). A rate is the number of changes over the time spent in the state, the time between two
//! observations being counted for the state at its start.
//!
//! `Deviation:` before the last observation, where the paper predicts nothing, the distance in time
//! is used. Changes between observations at the same time have no rate and are left out.

use super::VisibilityModel;
use super::codec;
use super::evidence::Evidence;
use crate::error::Result;
use crate::spectrum::{P_UNKNOWN, Reader, Writer};
use crate::time::Time;

/// Short-term memory; 40 bytes a feature, one exponential a prediction.
///
/// Not for the long term: after a few changes' time it is constant, whatever the clock says.
#[derive(Clone, Debug, PartialEq)]
pub struct Markov {
    features: Vec<Chain>,
}

/// A feature that was never observed has no rates and the state 1/2.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Chain {
    last_state: f64,
    last_time: Time,
    appear_per_s: f64,
    vanish_per_s: f64,
}

impl Chain {
    fn p(&self, time: Time) -> f64 {
        let rate = self.appear_per_s + self.vanish_per_s;
        if rate <= 0.0 {
            return self.last_state;
        }
        let share = self.appear_per_s / rate;
        let age_s = time.since_s(self.last_time).abs();
        (share + (self.last_state - share) * (-rate * age_s).exp()).clamp(0.0, 1.0)
    }
}

/// The latest observation of a feature while its log is read in order of time.
#[derive(Clone, Copy)]
pub(super) struct Latest {
    pub(super) time: Time,
    pub(super) state: bool,
}

/// Calls `with(feature, earlier, later)` for every two consecutive observations of a feature, and
/// returns the latest of each.
pub(super) fn for_each_step(
    evidence: &Evidence<'_>,
    mut with: impl FnMut(usize, Latest, Latest),
) -> Vec<Option<Latest>> {
    let mut latest = vec![None; evidence.num_features()];
    for visit in evidence.by_time() {
        let time = evidence.log.times()[visit];
        evidence.for_each_state(visit, |feature, state| {
            let later = Latest { time, state };
            if let Some(earlier) = latest[feature].replace(later) {
                with(feature, earlier, later);
            }
        });
    }
    latest
}

/// O(visits x features).
pub(super) fn fit(evidence: &Evidence<'_>) -> Markov {
    // Changes out of, and seconds in, the states 0 and 1.
    let mut changes = vec![[0.0; 2]; evidence.num_features()];
    let mut seconds = vec![[0.0; 2]; evidence.num_features()];
    let latest = for_each_step(evidence, |feature, earlier, later| {
        let passed_s = later.time.since_s(earlier.time);
        let state = usize::from(earlier.state);
        if passed_s > 0.0 {
            seconds[feature][state] += passed_s;
            changes[feature][state] += f64::from(u8::from(earlier.state != later.state));
        }
    });
    let rate = |changes: f64, seconds: f64| {
        if changes > 0.0 {
            changes / seconds
        } else {
            0.0
        }
    };
    let features = (changes.iter().zip(&seconds).zip(latest))
        .map(|((changes, seconds), latest)| Chain {
            last_state: latest.map_or(P_UNKNOWN, |l| f64::from(u8::from(l.state))),
            last_time: latest.map_or(Time::default(), |l| l.time),
            appear_per_s: rate(changes[0], seconds[0]),
            vanish_per_s: rate(changes[1], seconds[1]),
        })
        .collect();
    Markov { features }
}

impl Markov {
    fn write(&self, writer: &mut Writer) {
        writer.varint(self.features.len() as u64);
        for chain in &self.features {
            writer.signed(chain.last_time.as_us());
            writer.floats([chain.last_state, chain.appear_per_s, chain.vanish_per_s]);
        }
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let count = reader.count(25)?;
        let mut features = Vec::with_capacity(count);
        for _ in 0..count {
            let last_time = Time::from_us(reader.signed()?);
            let numbers = reader.floats(3)?;
            let [last_state, appear_per_s, vanish_per_s] = [numbers[0], numbers[1], numbers[2]];
            if !(0.0..=1.0).contains(&last_state) || appear_per_s < 0.0 || vanish_per_s < 0.0 {
                return Err(reader.impossible("this is no chain of states"));
            }
            features.push(Chain {
                last_state,
                last_time,
                appear_per_s,
                vanish_per_s,
            });
        }
        Ok(Self { features })
    }
}

impl VisibilityModel for Markov {
    fn num_features(&self) -> usize {
        self.features.len()
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        assert_eq!(out.len(), self.features.len(), "one p a feature");
        for (p, chain) in out.iter_mut().zip(&self.features) {
            *p = chain.p(time);
        }
    }

    fn encode(&self) -> Option<Vec<u8>> {
        Some(codec::encode(codec::Kind::Markov, |writer| {
            self.write(writer);
        }))
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        self.features[feature].p(time)
    }
}

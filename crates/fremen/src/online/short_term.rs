//! Is it still as it was last seen? (RAS 2016 eq. 5-6, as in [`Markov`](crate::visibility::Markov))

use super::counts::LookCount;
use super::model::OnlineModel;
use crate::error::Result;
use crate::spectrum::P_UNKNOWN;
use crate::time::Time;

/// A continuous Markov chain of two states for each state; 40 bytes a state.
#[derive(Clone, Debug)]
pub(super) struct ShortTerm {
    chains: Vec<Chain>,
    count: LookCount,
}

/// Changes out of, and seconds in, the states 0 and 1.
#[derive(Clone, Copy, Debug, Default)]
struct Chain {
    changes: [f64; 2],
    seconds: [f64; 2],
    last: bool,
}

impl Chain {
    fn rate(&self, state: usize) -> f64 {
        if self.changes[state] > 0.0 {
            self.changes[state] / self.seconds[state]
        } else {
            0.0
        }
    }

    fn p(&self, age_s: f64) -> f64 {
        let (appear, vanish) = (self.rate(0), self.rate(1));
        let last = f64::from(u8::from(self.last));
        let rate = appear + vanish;
        if rate <= 0.0 {
            return last;
        }
        let share = appear / rate;
        (share + (last - share) * (-rate * age_s).exp()).clamp(0.0, 1.0)
    }

    /// The share of time in state 1; the last state if nothing has ever changed.
    fn usual(&self) -> f64 {
        self.p(f64::INFINITY)
    }
}

impl ShortTerm {
    pub(super) fn new(num_states: usize) -> Self {
        Self {
            chains: vec![Chain::default(); num_states],
            count: LookCount::default(),
        }
    }
}

impl OnlineModel for ShortTerm {
    fn num_states(&self) -> usize {
        self.chains.len()
    }

    fn observe(&mut self, time: Time, states: &[bool]) {
        assert_eq!(states.len(), self.chains.len(), "one state each");
        let passed_s = self.count.last.map(|last| time.since_s(last));
        if passed_s.is_some_and(|passed_s| passed_s < 0.0) {
            return; // Its neighbours in time are not known any more.
        }
        for (chain, &state) in self.chains.iter_mut().zip(states) {
            if let Some(passed_s) = passed_s.filter(|&passed_s| passed_s > 0.0) {
                let from = usize::from(chain.last);
                chain.seconds[from] += passed_s;
                chain.changes[from] += f64::from(u8::from(chain.last != state));
            }
            chain.last = state;
        }
        self.count.add(time);
    }

    fn learn(&mut self) -> Result<()> {
        Ok(())
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        assert_eq!(out.len(), self.chains.len(), "one p each");
        let Some(last) = self.count.last else {
            out.fill(P_UNKNOWN);
            return;
        };
        let age_s = time.since_s(last).abs();
        for (p, chain) in out.iter_mut().zip(&self.chains) {
            *p = chain.p(age_s);
        }
    }

    fn usual_into(&self, _time: Time, out: &mut [f64]) {
        assert_eq!(out.len(), self.chains.len(), "one p each");
        for (p, chain) in out.iter_mut().zip(&self.chains) {
            *p = if self.count.last.is_some() {
                chain.usual()
            } else {
                P_UNKNOWN
            };
        }
    }

    fn looks(&self, _time: Time) -> f64 {
        self.count.num_stays
    }

    fn kept(&self, age_s: f64) -> f64 {
        let mean = |sum: f64| sum / self.chains.len().max(1) as f64;
        let kept = |chain: &Chain| (-(chain.rate(0) + chain.rate(1)) * age_s).exp();
        if self.count.last.is_some() {
            mean(self.chains.iter().map(kept).sum())
        } else {
            0.0
        }
    }

    fn last_look(&self) -> Option<Time> {
        self.count.last
    }
}

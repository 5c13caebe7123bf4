//! Which few events round the day? (RAS 2016, 4.3.2)
//!
//! The profile of the day is kept in bins; the mixture is fitted to it as in
//! [`Pergam`](crate::visibility::Pergam).

use super::counts::LookCount;
use super::model::OnlineModel;
use crate::error::Result;
use crate::spectrum::P_UNKNOWN;
use crate::time::{Period, Time};
use crate::visibility::{Pergam, VisibilityModel as _};

/// A periodic Gaussian mixture for each state; `8 B + 24 l` bytes a state.
#[derive(Clone, Debug)]
pub(super) struct Gaussians {
    period: Period,
    order: usize,
    num_states: usize,
    count: LookCount,
    /// Looks in bin b.
    observed: Vec<u32>,
    /// Of state i in bin b: at `i * bins + b`.
    seen: Vec<u32>,
    learnt: Option<Pergam>,
}

impl Gaussians {
    pub(super) fn new(num_states: usize, period: Period, num_bins: usize, order: usize) -> Self {
        Self {
            period,
            order,
            num_states,
            count: LookCount::default(),
            observed: vec![0; num_bins],
            seen: vec![0; num_states * num_bins],
            learnt: None,
        }
    }

    fn bin(&self, time: Time) -> usize {
        let num_bins = self.observed.len();
        ((time.phase(self.period) * num_bins as f64) as usize).min(num_bins - 1)
    }
}

impl OnlineModel for Gaussians {
    fn num_states(&self) -> usize {
        self.num_states
    }

    fn observe(&mut self, time: Time, states: &[bool]) {
        assert_eq!(states.len(), self.num_states, "one state each");
        let bin = self.bin(time);
        self.observed[bin] += 1;
        let num_bins = self.observed.len();
        for (i, &state) in states.iter().enumerate() {
            self.seen[i * num_bins + bin] += u32::from(state);
        }
        self.count.add(time);
    }

    fn learn(&mut self) -> Result<()> {
        let observed: u32 = self.observed.iter().sum();
        if observed > 0 {
            let learnt = Pergam::of_counts(self.period, self.order, &self.seen, &self.observed);
            self.learnt = Some(learnt);
        }
        Ok(())
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        match &self.learnt {
            Some(learnt) => learnt.predict_into(time, out),
            None => out.fill(P_UNKNOWN),
        }
    }

    /// Three numbers a Gaussian share the looks.
    fn looks(&self, _time: Time) -> f64 {
        self.count.num_stays / (3 * self.order) as f64
    }

    fn last_look(&self) -> Option<Time> {
        self.count.last
    }
}

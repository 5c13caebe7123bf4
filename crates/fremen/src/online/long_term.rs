//! How often was it seen, whatever the hour? (RAS 2016, 4.3.1)

use super::counts::LookCount;
use super::model::OnlineModel;
use crate::error::Result;
use crate::spectrum::P_UNKNOWN;
use crate::time::Time;

/// The mean of all looks; 12 bytes a state.
#[derive(Clone, Debug)]
pub(super) struct LongTerm {
    seen: Vec<u32>,
    num_looks: u32,
    p: Vec<f64>,
    count: LookCount,
}

impl LongTerm {
    pub(super) fn new(num_states: usize) -> Self {
        Self {
            seen: vec![0; num_states],
            num_looks: 0,
            p: vec![P_UNKNOWN; num_states],
            count: LookCount::default(),
        }
    }
}

impl OnlineModel for LongTerm {
    fn num_states(&self) -> usize {
        self.seen.len()
    }

    fn observe(&mut self, time: Time, states: &[bool]) {
        assert_eq!(states.len(), self.seen.len(), "one state each");
        for (seen, &state) in self.seen.iter_mut().zip(states) {
            *seen += u32::from(state);
        }
        self.num_looks += 1;
        self.count.add(time);
    }

    fn learn(&mut self) -> Result<()> {
        if self.num_looks > 0 {
            for (p, &seen) in self.p.iter_mut().zip(&self.seen) {
                *p = f64::from(seen) / f64::from(self.num_looks);
            }
        }
        Ok(())
    }

    fn predict_into(&self, _time: Time, out: &mut [f64]) {
        out.copy_from_slice(&self.p);
    }

    fn looks(&self, _time: Time) -> f64 {
        self.count.num_stays
    }

    fn last_look(&self) -> Option<Time> {
        self.count.last
    }
}

//! What does a model say that is fitted anew to the log of all looks?

use super::counts::LookCount;
use super::model::OnlineModel;
use crate::error::Result;
use crate::spectrum::P_UNKNOWN;
use crate::time::Time;
use crate::visibility::{BitRow, HistoryLog, VisibilityConfig, VisibilityModel, Visits, fit};

/// Any model of [`visibility`](crate::visibility), fitted at every `learn`. The whole log is kept,
/// one look of each stay: `1/8` byte a state and look.
#[derive(Debug)]
pub(super) struct Refitted {
    cfg: VisibilityConfig,
    num_states: usize,
    log: HistoryLog,
    count: LookCount,
    learnt: Option<Box<dyn VisibilityModel>>,
}

impl Refitted {
    pub(super) fn new(num_states: usize, cfg: VisibilityConfig) -> Self {
        Self {
            cfg,
            num_states,
            log: HistoryLog::new(),
            count: LookCount::default(),
            learnt: None,
        }
    }
}

impl OnlineModel for Refitted {
    fn num_states(&self) -> usize {
        self.num_states
    }

    fn observe(&mut self, time: Time, states: &[bool]) {
        assert_eq!(states.len(), self.num_states, "one state each");
        if !self.count.add(time) {
            return;
        }
        let mut row = BitRow::zeros(states.len());
        for (i, _) in states.iter().enumerate().filter(|(_, state)| **state) {
            row.set(i);
        }
        // A row of the right length can only fail beyond 2^32 looks.
        let _ = self.log.push_visit(time, row, None);
    }

    fn learn(&mut self) -> Result<()> {
        if self.log.num_visits() > 0 {
            self.learnt = Some(fit(&self.log, &self.cfg, Visits::All)?);
        }
        Ok(())
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        match &self.learnt {
            Some(learnt) => learnt.predict_into(time, out),
            None => out.fill(P_UNKNOWN),
        }
    }

    fn looks(&self, _time: Time) -> f64 {
        let order = self.learnt.as_ref().map_or(0, |learnt| learnt.order());
        self.count.num_stays / (1 + 2 * order) as f64
    }

    fn last_look(&self) -> Option<Time> {
        self.count.last
    }
}

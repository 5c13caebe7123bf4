//! How often was a cell seen, how often occupied, how persistent is it?

use crate::cells::CellState;
use crate::history::Changes;

/// What can be said of a cell without any rhythm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stats {
    /// Visits that saw it.
    pub(crate) num_known: u32,
    /// Visits that saw it occupied.
    pub(crate) num_occupied: u32,
    /// Changes between free and occupied.
    pub(crate) num_changes: u32,
    /// The last visit that saw it, and how.
    pub(crate) last_visit: u32,
    pub(crate) last_state: CellState,
    /// 1 / tau in 1/s: the mean of `abs(ds) / dt` over consecutive observations of the cell
    /// (T-RO 2017 eq. 12, with one n throughout); 0 where it never changed.
    pub(crate) rate: f64,
}

impl Stats {
    /// Of a cell with these changes since visit 0 at times `times_us`, one a visit.
    pub(crate) fn new(first: CellState, changes: Changes<'_>, times_us: &[i64]) -> Self {
        let mut stats = Self {
            num_known: 0,
            num_occupied: 0,
            num_changes: 0,
            last_visit: 0,
            last_state: CellState::Unknown,
            rate: 0.0,
        };
        let mut sum = 0.0;
        let (mut from, mut state) = (0, first);
        let end = (times_us.len() as u32, CellState::Unknown);
        for (visit, next) in changes.map(|it| (it.visit, it.state)).chain([end]) {
            sum += stats.run(from, visit, state, times_us);
            (from, state) = (visit, next);
        }
        if stats.num_known > 1 {
            stats.rate = sum / f64::from(stats.num_known - 1);
        }
        stats
    }

    /// Adds visits `from..to` in one state; gives the change's part of the rate.
    fn run(&mut self, from: u32, to: u32, state: CellState, times_us: &[i64]) -> f64 {
        if !state.is_known() {
            return 0.0;
        }
        let mut speed = 0.0;
        if self.last_state.is_known() && self.last_state != state {
            self.num_changes += 1;
            let before = times_us[self.last_visit as usize];
            let us = times_us[from as usize].saturating_sub(before);
            // Two observations of one moment say nothing about how long a state lasts.
            if us > 0 {
                speed = 1e6 / us as f64;
            }
        }
        self.num_known += to - from;
        if state == CellState::Occupied {
            self.num_occupied += to - from;
        }
        self.last_visit = to - 1;
        self.last_state = state;
        speed
    }

    /// The share of observations in which it was occupied.
    pub(crate) fn mean(&self) -> f64 {
        if self.num_known == 0 {
            fremen::spectrum::P_UNKNOWN
        } else {
            f64::from(self.num_occupied) / f64::from(self.num_known)
        }
    }

    /// Whether it was seen free and occupied.
    pub(crate) const fn varies(&self) -> bool {
        self.num_occupied > 0 && self.num_occupied < self.num_known
    }
}

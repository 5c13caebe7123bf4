//! How many independent looks are there, and when was the last?

use crate::time::Time;

/// Looks closer than this are one stay: doors, people and light change within minutes.
const STAY_S: f64 = 600.0;

/// What models need to know of their looks beside the states.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LookCount {
    /// Looks, those of one stay being one.
    pub(super) num_stays: f64,
    pub(super) last: Option<Time>,
    /// When the present stay began.
    began: Option<Time>,
}

impl LookCount {
    /// Counts a look; whether it begins a new stay.
    pub(super) fn add(&mut self, time: Time) -> bool {
        let is_new = self
            .began
            .is_none_or(|began| time.since_s(began).abs() >= STAY_S);
        if is_new {
            self.num_stays += 1.0;
            self.began = Some(time);
        }
        self.last = Some(self.last.map_or(time, |last| last.max(time)));
        is_new
    }
}

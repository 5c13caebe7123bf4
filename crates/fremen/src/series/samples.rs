//! When was one state 1, and when was it 0?

use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::{CandidatePeriods, Periodogram};
use crate::time::{Time, Zone};
use crate::visibility::HistoryLog;

/// The history of one binary state, ascending in time.
///
/// Samples of equal times stay in the order in which they came.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Series {
    states: Vec<(Time, bool)>,
    missing: Vec<Time>,
}

impl Series {
    /// No samples.
    pub fn new() -> Self {
        Self::default()
    }

    /// Of times and the states at them, in any order.
    ///
    /// Fails with [`ErrorKind::Shape`] if there are not as many of the one as of the other.
    pub fn from_slices(times: &[Time], states: &[bool]) -> Result<Self> {
        if times.len() != states.len() {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "{} times and {} states are no series",
                    times.len(),
                    states.len()
                ),
            ));
        }
        let samples = times.iter().copied().zip(states.iter().copied());
        Ok(samples.collect())
    }

    /// Adds a sample; `None` if the state is missing. O(1) for the latest one.
    pub fn push(&mut self, time: Time, state: Option<bool>) {
        if let Some(state) = state {
            let at = self.states.partition_point(|known| known.0 <= time);
            self.states.insert(at, (time, state));
        } else {
            let at = self.missing.partition_point(|known| *known <= time);
            self.missing.insert(at, time);
        }
    }

    /// The same samples at the times that clocks in `zone` showed, for rhythms of people: they keep
    /// office hours by their clocks, not by UTC.
    ///
    /// What is learnt of such a series predicts for [`Zone::wall`] of a moment.
    #[must_use]
    pub fn in_zone(&self, zone: &Zone) -> Self {
        let known = self.states.iter().map(|&(time, state)| (time, Some(state)));
        let missing = self.missing.iter().map(|&time| (time, None));
        (known.chain(missing))
            .map(|(time, state)| (zone.wall(time), state))
            .collect()
    }

    /// The samples whose state is known, ascending.
    pub fn states(&self) -> &[(Time, bool)] {
        &self.states
    }

    /// The times of the samples whose state is missing, ascending.
    pub fn missing(&self) -> &[Time] {
        &self.missing
    }

    /// Samples whose state is known.
    pub fn len(&self) -> usize {
        self.states.len()
    }

    /// Whether no state is known.
    pub fn is_empty(&self) -> bool {
        self.states.is_empty()
    }

    /// The share of known states that are 1; `None` without any.
    pub fn mean(&self) -> Option<f64> {
        let num_seen = self.states.iter().filter(|state| state.1).count();
        (!self.is_empty()).then(|| num_seen as f64 / self.len() as f64)
    }

    /// Seconds from the first to the last known state; 0 without two of them.
    pub fn span_s(&self) -> f64 {
        match (self.states.first(), self.states.last()) {
            (Some(first), Some(last)) => last.0.since_s(first.0),
            _ => 0.0,
        }
    }

    /// What is before a time, and what is not.
    pub fn split_at(&self, time: Time) -> (Self, Self) {
        let (earlier, later) =
            (self.states).split_at(self.states.partition_point(|it| it.0 < time));
        let missing = self
            .missing
            .split_at(self.missing.partition_point(|it| *it < time));
        let part = |states: &[(Time, bool)], missing: &[Time]| Self {
            states: states.to_vec(),
            missing: missing.to_vec(),
        };
        (part(earlier, missing.0), part(later, missing.1))
    }

    /// The known states as the log of a place with one feature, which every model of
    /// [`visibility`](crate::visibility) learns from.
    pub fn to_log(&self) -> Result<HistoryLog> {
        HistoryLog::of_states(self.states.iter().copied())
    }

    /// How strong each candidate period is in the states, and in their sampling alone.
    pub fn periodogram(&self, candidates: &CandidatePeriods) -> Result<Periodogram> {
        Periodogram::new(&self.states, candidates)
    }
}

impl FromIterator<(Time, bool)> for Series {
    fn from_iter<I: IntoIterator<Item = (Time, bool)>>(samples: I) -> Self {
        (samples.into_iter())
            .map(|(time, state)| (time, Some(state)))
            .collect()
    }
}

impl FromIterator<(Time, Option<bool>)> for Series {
    fn from_iter<I: IntoIterator<Item = (Time, Option<bool>)>>(samples: I) -> Self {
        let mut series = Self::new();
        for (time, state) in samples {
            match state {
                Some(state) => series.states.push((time, state)),
                None => series.missing.push(time),
            }
        }
        // Stable: samples of equal times stay in their order.
        series.states.sort_by_key(|state| state.0);
        series.missing.sort();
        series
    }
}

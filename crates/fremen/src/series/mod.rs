//! When was one state 1, when was it 0, and what follows from that?
//!
//! A [`Series`] is the history of a single binary state: a door, a person in a room, an edge of a
//! map that can be passed. It comes from a CSV file or from slices, may have missing samples, and
//! is kept in order of time. [`Series::learn`] fits a model to it; the [`SeriesModel`] predicts,
//! shows its rhythms, and finds the samples that nobody would have expected.
//!
//! ```
//! use fremen::{Period, Series, Time};
//!
//! // Open from 6 to 18 h on every day of four weeks, looked at every hour.
//! let is_open = |hour: i64| (6..18).contains(&(hour % 24));
//! let door: Series = (0..28 * 24)
//!     .map(|hour| (Time::from_s(3_600 * hour), is_open(hour)))
//!     .collect();
//! let model = door.learn()?;
//!
//! let noon = Time::parse("1970-06-01T12:00:00Z")?;
//! assert!(model.p(noon) > 0.9);
//! assert_eq!(model.components()[0].period_s, Period::DAY.as_s());
//! # Ok::<(), fremen::Error>(())
//! ```

mod csv;

use std::path::Path;

pub use self::csv::{Columns, line_of_record, time_of_cell};

use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::{CandidatePeriods, Component, Periodogram};
use crate::time::Time;
use crate::visibility::{
    BitRow, HistoryLog, VisibilityConfig, VisibilityModel, Visits, decode, fit,
};

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

    /// Reads a CSV file: a time and a state on every line.
    ///
    /// Times are RFC 3339 with an offset or seconds since 1970 (a fraction is allowed), states `0`,
    /// `1`, `false`, `true`; a row with an empty state is missing. Rows may come in any order,
    /// lines that begin with `#` are comments, and a first row whose time is none is a header.
    /// Fails with the line of what is no series.
    pub fn read_csv(path: impl AsRef<Path>, columns: Columns<'_>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|cause| Error::io(path, cause))?;
        Self::parse_csv(&bytes, columns).map_err(|error| error.with_path(path))
    }

    /// [`read_csv`](Self::read_csv) of the content of a file.
    pub fn parse_csv(bytes: &[u8], columns: Columns<'_>) -> Result<Self> {
        Ok(csv::parse(bytes, columns)?.into_iter().collect())
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
        log_of(&self.states)
    }

    /// How strong each candidate period is in the states, and in their sampling alone.
    pub fn periodogram(&self, candidates: &CandidatePeriods) -> Result<Periodogram> {
        Periodogram::new(&self.states, candidates)
    }

    /// Learns the model for a series of any sampling: [`VisibilityConfig::natural`].
    pub fn learn(&self) -> Result<SeriesModel> {
        self.learn_with(&VisibilityConfig::natural())
    }

    /// Learns the model that `cfg` names.
    ///
    /// A series without known states gives p = 1/2 at every time.
    pub fn learn_with(&self, cfg: &VisibilityConfig) -> Result<SeriesModel> {
        let mut log = self.to_log()?;
        if self.is_empty() {
            // One feature that could not be observed: unknown, but there.
            let mut hidden = BitRow::zeros(1);
            hidden.set(0);
            log.push_visit(Time::default(), BitRow::zeros(1), Some(hidden))?;
        }
        let model = fit(&log, cfg, Visits::All)?;
        Ok(SeriesModel { model })
    }
}

/// The log of one feature whose states these are.
fn log_of(states: &[(Time, bool)]) -> Result<HistoryLog> {
    let mut log = HistoryLog::new();
    for &(time, state) in states {
        let mut seen = BitRow::zeros(1);
        if state {
            seen.set(0);
        }
        log.push_visit(time, seen, None)?;
    }
    Ok(log)
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

/// A sample that a model would not have expected.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Anomaly {
    /// When.
    pub time: Time,
    /// What was observed.
    pub state: bool,
    /// The probability that the model gave to a state of 1.
    pub p: f64,
}

/// What was learnt of a series.
#[derive(Debug)]
pub struct SeriesModel {
    model: Box<dyn VisibilityModel>,
}

impl SeriesModel {
    /// The probability that the state is 1 at a time, in [0, 1].
    pub fn p(&self, time: Time) -> f64 {
        self.model.predict_one(0, time)
    }

    /// What the rhythms swing about; `None` for a model that is not a level and rhythms.
    pub fn level(&self) -> Option<f64> {
        self.model.level(0)
    }

    /// The rhythms, strongest first; none for a model that has none.
    pub fn components(&self) -> Vec<Component> {
        self.model.components(0)
    }

    /// The most rhythms that the model may have.
    pub fn order(&self) -> usize {
        self.model.order()
    }

    /// The states that were given a probability below `1 - confidence` (T-RO 2017 III-D calls these
    /// the times at which the observed and the predicted state differ; `confidence` is 1/2 there).
    ///
    /// Fails with [`ErrorKind::Config`] unless `confidence` is in [1/2, 1].
    pub fn anomalies(&self, series: &Series, confidence: f64) -> Result<Vec<Anomaly>> {
        if !(0.5..=1.0).contains(&confidence) {
            return Err(Error::new(
                ErrorKind::Config,
                format!("a confidence is 0.5 to 1, not {confidence}"),
            ));
        }
        let judged = series.states.iter().map(|&(time, state)| Anomaly {
            time,
            state,
            p: self.p(time),
        });
        Ok(judged
            .filter(|it| (if it.state { it.p } else { 1.0 - it.p }) < 1.0 - confidence)
            .collect())
    }

    /// The mean squared difference of p and state (Brier score); `None` without known states.
    pub fn brier(&self, series: &Series) -> Option<f64> {
        let error =
            |&(time, state): &(Time, bool)| (self.p(time) - f64::from(u8::from(state))).powi(2);
        let total: f64 = series.states.iter().map(error).sum();
        (!series.is_empty()).then(|| total / series.len() as f64)
    }

    /// The model as one of a place with one feature.
    pub fn as_visibility(&self) -> &dyn VisibilityModel {
        &*self.model
    }

    /// The model as bytes; `None` if it is of a kind that has no such form (none of this crate's).
    pub fn encode(&self) -> Option<Vec<u8>> {
        self.model.encode()
    }

    /// What [`encode`](Self::encode) wrote.
    ///
    /// Fails with [`ErrorKind::Checksum`] or [`ErrorKind::Format`] if these bytes are damaged or no
    /// model, and with [`ErrorKind::Shape`] if they are a model of something other than one state.
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        let model = decode(bytes)?;
        match model.num_features() {
            1 => Ok(Self { model }),
            count => Err(Error::new(
                ErrorKind::Shape,
                format!("this is a model of {count} states, not of one"),
            )),
        }
    }
}

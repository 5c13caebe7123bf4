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
mod model;
mod samples;

pub use self::csv::{Columns, line_of_record};
pub use model::{Anomaly, SeriesModel};
pub use samples::Series;

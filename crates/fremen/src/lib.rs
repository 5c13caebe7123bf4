//! When will a binary state be true?
//!
//! A door that is open, a person in a room, an edge of a map that can be passed, a feature that a
//! camera can see: states that are 0 or 1 at known times, and that follow the rhythms of sun and
//! people. *Frequency map enhancement* (FreMEn) keeps such a history as a mean and a few periodic
//! components and predicts the probability of a 1 at any time.
//!
//! ```no_run
//! use fremen::{Series, Time};
//!
//! # fn main() -> fremen::Result<()> {
//! let door = Series::read_csv("door.csv", Default::default())?; // rows of time,state
//! let model = door.learn()?;
//! println!("open with p = {:.2}", model.p(Time::parse("2024-05-06T08:30:00Z")?));
//! for unexpected in model.anomalies(&door, 0.95)? {
//!     println!("{}: {}", unexpected.time, u8::from(unexpected.state));
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Rooms
//!
//! | room | the question it answers |
//! |---|---|
//! | [`error`] | what failed, where, and what helps? |
//! | [`mod@file`] | how is a file opened that may be hostile, and one written so that nothing is lost? |
//! | [`time`] | when? |
//! | [`spectrum`] | which rhythms are in this 0/1 history? |
//! | [`visibility`] | will it be visible at time t? (many states that share their observation times) |
//! | [`online`] | what is believed of states that are looked at now and then, one look after the other? |
//! | [`series`] | when was one state 1, when was it 0, and what follows from that? |
//!
//! Each names only those above it. None knows what a state means: there are no pixels, places or
//! grids here, no threads, and of the formats of files only CSV.
//!
//! # Conventions
//!
//! Times are whole microseconds since 1970 in UTC, periods whole microseconds ([`Time`],
//! [`Period`]); a probability lies in [0, 1]; the same input gives the same bytes on every run. One
//! [`Error`] names the file, the place in it and what helps.
//!
//! # Sources
//!
//! - T. Krajník, J. P. Fentanes, J. M. Santos, T. Duckett: FreMEn: Frequency map enhancement for
//!   long-term mobile robot autonomy in changing environments. IEEE Transactions on Robotics, 2017.
//!   In these docs: T-RO 2017.
//! - T. Krajník, J. P. Fentanes, G. Cielniak, C. Dondrup, T. Duckett: Spectral analysis for
//!   long-term robotic mapping. ICRA 2014.
//! - J. M. Santos, T. Krajník, T. Duckett: Spatio-temporal exploration strategies for long-term
//!   autonomy of mobile robots. Robotics and Autonomous Systems (RAS), 2017, online 2016.

pub mod error;
pub mod file;
pub mod online;
pub mod series;
pub mod spectrum;
pub mod time;
pub mod visibility;

pub use error::{Error, ErrorKind, Result};
pub use series::{Series, SeriesModel};
pub use spectrum::{CandidatePeriods, Component, Periodogram};
pub use time::{Period, Time};

/// The README's examples, so that they compile.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

//! Visual topological localisation that knows what each place looks like *at a given time*.

#[cfg(feature = "cli")]
pub mod cli;
pub mod dataset;
pub mod error;
pub mod feature;
pub mod learn;
pub mod localize;
pub mod map;
pub mod matching;
pub mod predict;
pub mod simd;
pub mod spectrum;
pub mod time;
pub mod visibility;

pub use error::{Error, ErrorKind, Result};
pub use time::{Period, Time};

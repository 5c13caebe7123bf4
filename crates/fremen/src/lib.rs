//! When will a binary state be true?
//!
//! A door, a person in a room, a feature of an image, a cell of a grid: anything that is observed as 0 or
//! 1 at known times.

pub mod error;
pub mod spectrum;
pub mod time;
pub mod visibility;

pub use error::{Error, ErrorKind, Result};
pub use time::{Period, Time};

//! When?
//!
//! A [`Time`] is a moment in UTC, a [`Period`] the length of a cycle; both are whole microseconds.
//! Text becomes a moment by [`Time::parse`], [`TimeUnit`] and [`Zone`]: what a number without a
//! unit or a date without an offset means is never guessed.

mod moment;
mod stamp;
mod zone;

pub use moment::{Period, Time};
pub use stamp::TimeUnit;
pub use zone::Zone;

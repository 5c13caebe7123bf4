//! How is a map kept in one file that survives what happens to files?
//!
//! `chronotope-store` keeps generations of rows; what is here says what a row of a map means.

mod change;
#[cfg(test)]
mod damage;
mod generation;
mod load;
mod map;
mod stamp;
mod state;
mod tables;
mod trail;
mod verify;

pub use generation::Generation;
pub use map::{Map, Pruned};
pub use stamp::Stamp;
pub use verify::VerifyReport;

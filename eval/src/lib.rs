//! Which method recognises places best, how sure are we of it, and what does it look like?
//!
//! Finished answers become numbers and pictures here: [`results`] is the file `SUITE.json`,
//! [`judge`] turns answers into rates with intervals, pairs two runs query by query and says
//! whether posteriors and decisions deserve their trust, and [`report`] prints a run in a terminal
//! and draws it as one HTML file. [`series`] does all of this for single states over time, [`grid`] for
//! occupancy grids, and [`explore`] for ways to explore.

pub mod command;
pub mod data;
pub mod explore;
pub mod grid;
pub mod judge;
pub(crate) mod progress;
pub mod provenance;
pub mod report;
pub mod results;
pub mod run;
pub mod series;
pub mod soak;
pub mod speed;
pub mod suite;

// The made-up run is shared by unit and integration tests, which name this crate differently.
#[cfg(test)]
extern crate self as chronotope_eval;
#[cfg(test)]
#[path = "../tests/it/sample.rs"]
mod sample;

//! How does a grid take in the maps of years, without being harmed by one of them?
//!
//! A [`LifelongGrid`] is a grid file together with its guard: each new map is laid onto the
//! prediction of its time, judged, and integrated or kept in quarantine *in the file*, where
//! somebody can look at it, accept it or drop it. Everything that one run adds becomes one
//! generation; a run that is killed has added nothing, and what it is given again has the same
//! outcome.

mod codec;
mod grid;

pub use grid::{LifelongGrid, MapId, TakenIn, choose};

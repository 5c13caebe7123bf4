//! Which cell of the world is occupied at time t?
//!
//! A spatio-temporal occupancy grid, in 2-D or 3-D, keeps when each cell was seen free and when
//! occupied, learns the rhythm and the persistence of these changes, and predicts the occupancy
//! grid of any time.
//!
//! # Rooms
//!
//! | room | the question it answers |
//! |---|---|
//! | [`cells`] | where is a cell, and in which state? |
//! | [`history`] | when was each cell free, occupied and hidden? |
//! | [`model`] | which rhythm and which persistence has each cell? |
//! | [`temporal`] | what will the world look like at time t? |
//! | [`exchange`] | how are maps read that others wrote, and written so that others read them? |
//! | [`mod@file`] | how is a grid kept in a file, whatever happens to the machine? |
//! | [`compress`] | in how few bytes can a grid be kept? |
//! | [`picture`] | what does a grid look like? |
//! | [`random`] | which number comes next, the same on every run and in every thread? |
//! | [`pose`] | where does the robot stand in the plane, and where does it look? |
//! | [`scan`] | what does a planar laser say about cells? |
//! | [`localize`] | where is the robot in a map, and is the map still right? |
//! | [`registration`] | does a patrol's map belong into the grid, and where? |
//! | [`lifelong`] | how does a grid take in the maps of years without being harmed by one of them? |
//! | [`plan`] | which way is short, and free at the time at which the robot comes there? |
//! | [`simulation`] | what would a robot have seen in a world whose truth is known? |
//! | [`experiment`] | how good is all this? |
//!
//! Each names only those above it.
//!
//! # Conventions
//!
//! Lengths are metres, angles radians, times whole microseconds since 1970 in UTC
//! ([`Time`]). Cell `[x, y, z]` of a grid has the index `x + w (y + h z)`: x runs
//! fastest. A probability lies in [0, 1]; the same input gives the same bytes for any number of
//! threads.
//!
//! # Sources
//!
//! - T. Krajník, J. P. Fentanes, J. M. Santos, T. Duckett: FreMEn: Frequency map enhancement for
//!   long-term mobile robot autonomy in changing environments. IEEE Transactions on Robotics, 2017.
//!   In these docs: T-RO 2017.
//! - T. Krajník, J. P. Fentanes, M. Hanheide, T. Duckett: Persistent localization and life-long
//!   mapping in changing environments using the frequency map enhancement. IROS 2016.

pub mod cells;
pub mod compress;
pub mod exchange;
pub mod experiment;
pub mod file;
pub mod history;
pub mod lifelong;
pub mod localize;
pub mod model;
pub mod picture;
pub mod plan;
pub mod pose;
pub mod random;
pub mod registration;
pub mod scan;
pub mod simulation;
pub mod temporal;
mod tiles;

pub use cells::{CellState, GridSpec, OccupancyMap, Patch, Thresholds};
pub use file::GridFile;
pub use fremen::{Error, ErrorKind, Result, Time};
pub use history::{FrameStream, History, Outcome, Verdict};
pub use lifelong::LifelongGrid;
pub use model::{CellModel, Errors, GridConfig, Persistence};
pub use temporal::{Explanation, FittedGrid, TemporalGrid};

/// The README's examples, so that they compile.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

//! When was each cell free, occupied and hidden?
//!
//! The lossless log: of each cell, at which of its tile's observations its state changed. A cell
//! that never changes costs less than a byte, one that is observed again unchanged costs nothing
//! more, and everything else in this crate can be derived from it.

mod forget;
mod frames;
mod log;
mod merge;
mod observations;
mod recall;
mod record;
mod tile;

pub use forget::Forgotten;
pub use frames::FrameStream;
pub(crate) use log::{CellLog, Change, Changes, put_varint, take_varint};
pub(crate) use observations::Observations;
pub use record::{History, Memory, Outcome, Verdict};
pub(crate) use tile::{Tile, Visits};

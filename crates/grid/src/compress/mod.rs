//! In how few bytes can a grid be kept?
//!
//! [`pack`] keeps every observation: an arithmetic coder is told by the cell's rhythms (p(t)), by
//! how long its last states lasted and by its neighbours when the next change is likely.
//! [`LossyGrid`] keeps the rhythms alone, a few bytes for each cell that varies (T-RO 2017,
//! section VI).

mod coder;
mod lossless;
mod lossy;

pub use lossless::{pack, unpack, varint_bytes};
pub use lossy::LossyGrid;

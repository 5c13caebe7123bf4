//! How good is all this, in worlds whose truth is known and on recorded scans?
//!
//! Each experiment is a function of its configuration and gives a table; `examples/` prints them.

mod carmen;

pub use carmen::{CarmenConfig, CarmenReport, RangeResult, carmen};

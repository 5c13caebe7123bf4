//! What does a planar laser say about cells?
//!
//! A [`LaserScan`] is cast into a grid ray by ray ([`mod@ray`]); [`ScanMapper`] gathers scans at given
//! poses into a map of log odds, and [`read_carmen`] reads recorded scans.

mod carmen;
mod laser;
mod mapper;
pub mod ray;

pub use carmen::{CarmenLog, CarmenScan, parse_carmen, read_carmen};
pub use laser::{Beam, LaserScan};
pub use mapper::{InverseSensorModel, ScanMapper, grid_around};

//! How good is all this, in worlds whose truth is known and on recorded scans?
//!
//! Each experiment is a function of its configuration and gives a table; `examples/` prints them.

mod carmen;
mod journeys;
mod passes;
mod quarantine;
mod statistics;
mod world;

pub use carmen::{CarmenConfig, CarmenReport, RangeResult, carmen};
pub use journeys::{JourneyCounts, JourneysConfig, JourneysReport, PLANNED_IN, journeys};
pub use passes::{MAPS, PassResult, PassesConfig, PassesReport, passes};
pub use quarantine::{
    Care, Corruption, OfficePatrols, PatrolResult, QuarantineConfig, QuarantineReport, quarantine,
};

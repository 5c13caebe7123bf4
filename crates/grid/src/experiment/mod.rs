//! How good is all this, in worlds whose truth is known and on recorded scans?
//!
//! Each experiment is a function of its configuration and gives a table; the suites `grid-*` of the
//! evaluation judge them.

mod boxes;
mod carmen;
mod gallery;
mod journeys;
mod office;
mod passes;
mod presence;
mod quarantine;
mod statistics;
mod world;

pub use boxes::{BoxCounts, BoxesConfig, BoxesReport, PREDICTED_BY, boxes};
pub use carmen::{CarmenConfig, CarmenReport, RangeResult, carmen};
pub use gallery::{Gallery, gallery};
pub use journeys::{JourneyCounts, JourneysConfig, JourneysReport, PLANNED_IN, journeys};
pub use office::{OfficeConfig, OfficeModel, OfficeReport, office};
pub use passes::{MAPS, PassResult, PassesConfig, PassesReport, passes};
pub use presence::{Detections, PresenceConfig, PresenceResult, presence, presence_table};
pub use quarantine::{
    Care, Corruption, OfficePatrols, PatrolResult, QuarantineConfig, QuarantineReport, quarantine,
};

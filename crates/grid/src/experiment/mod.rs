//! How good is all this, in worlds whose truth is known and on recorded scans?
//!
//! Each experiment is a function of its configuration and gives a table; the suites `grid-*` of the
//! evaluation judge them.

mod boxes;
mod carmen;
mod gallery;
mod injected;
mod journeys;
mod office;
mod passes;
mod presence;
mod quarantine;
mod statistics;
mod world;

pub use boxes::{
    BoxCounts, BoxesConfig, BoxesReport, OCCUPIED_FROM, PREDICTED_BY, boxes, boxes_gallery,
};
pub use carmen::{CarmenConfig, CarmenReport, RangeResult, carmen};
pub use gallery::{Gallery, gallery};
pub use injected::{DAILY_BY, Daily, InjectedConfig, InjectedReport, Moved, Sudden, injected};
pub use journeys::{JourneyCounts, JourneysConfig, JourneysReport, PLANNED_IN, journeys};
pub use office::{OfficeConfig, OfficeModel, OfficeReport, office};
pub use passes::{MAPS, PassResult, PassesConfig, PassesReport, passes};
pub use presence::{
    Detections, PresenceConfig, PresenceResult, presence, presence_gallery, presence_table,
};
pub use quarantine::{
    Care, Corruption, OfficePatrols, PatrolResult, QuarantineConfig, QuarantineReport, quarantine,
};

//! What is remembered of each place?
//!
//! A [`Snapshot`] is one immutable state of a map: places ([`Node`]) with their features, the log of
//! what was seen at which visit, and the edges between them. A [`Map`] keeps snapshots in a file, each
//! commit a generation; `maps/README.md` describes that file down to the byte. This room stores and
//! decides nothing: what to add is up to `learn`, what to expect to `predict`.

mod building;
mod change;
#[cfg(test)]
mod damage;
mod digest;
mod exchange;
mod file_storage;
mod format;
mod held;
mod identity;
mod load;
mod mapped;
mod npy;
mod prune;
mod reobservation;
mod stamp;
mod store;
mod types;
mod verify;

pub use building::Summary;
pub use digest::ContentDigest;
pub use file_storage::{FileStorageMap, read_file_storage};
pub(crate) use format::MAX_TEXT_BYTES;
pub use held::{ClockFault, Doubt, Held, HeldVisit, MaskRuns};
pub use identity::{derived_uuid, features_digest, random_uuid};
pub use load::{Fault, Generation};
pub(crate) use mapped::MappedFile;
pub use reobservation::Reobservation;
pub use stamp::Stamp;
pub use store::{Map, Pruned};
pub use types::{
    AppearanceUse, Edge, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, Visit, VisitId,
};
pub use verify::VerifyReport;

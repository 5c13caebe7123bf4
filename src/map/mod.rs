//! What is remembered of each place?
//!
//! A [`Snapshot`] is one immutable state of a map: places ([`Node`]) with their features, the log of
//! what was seen at which visit, and the edges between them. A [`Map`] keeps snapshots in a file, each
//! commit a generation; `maps/README.md` describes that file down to the byte. This room stores and
//! decides nothing: what to add is up to `learn`, what to expect to `predict`.

mod building;
mod exchange;
mod file;
mod held;
mod identity;
mod reobservation;
mod types;

pub use building::Summary;
pub use exchange::{FileStorageMap, read_file_storage};
pub use file::{ContentDigest, Fault, Generation, Map, Pruned, Stamp, VerifyReport};
pub(crate) use file::{MAX_TEXT_BYTES, MappedFile};
pub use held::{ClockFault, Doubt, Held, HeldVisit, MaskRuns};
pub use identity::{derived_uuid, features_digest, random_uuid};
pub use reobservation::Reobservation;
pub use types::{
    AppearanceUse, Edge, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, Visit, VisitId,
};

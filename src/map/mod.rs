//! What is remembered of each place?
//!
//! A [`Snapshot`] is one immutable state of a map: places ([`Node`]) with their features, the log
//! of what was seen at which visit, and the edges between them. A [`Map`] keeps snapshots in a
//! file, each commit a generation; `maps/README.md` describes that file down to the byte. This room
//! stores and decides nothing: what to add is up to `learn`, what to expect to `predict`.

mod codec;
mod digest;
#[cfg(feature = "dataset")]
mod exchange;
mod file;
mod identity;
mod limits;
mod node;
mod quarantine;
mod quarantine_row;
mod quarantined;
mod reobservation;
mod snapshot;
mod types;

pub(crate) use chronotope_store::MappedFile;

pub use chronotope_store::Fault;
pub use digest::ContentDigest;
#[cfg(feature = "dataset")]
pub use exchange::{FileStorageMap, decode_file_storage, read_file_storage};
pub use file::{Generation, Map, Pruned, Stamp, VerifyReport};
pub use identity::{derived_uuid, features_digest, random_uuid};
pub(crate) use limits::MAX_TEXT_BYTES;
pub use node::{Node, NodeParts};
pub use quarantine::Quarantine;
pub use quarantined::{ClockFault, MaskRuns, QuarantineReason, QuarantinedVisit};
pub use reobservation::Reobservation;
pub use snapshot::{Snapshot, SnapshotParts, Summary};
pub use types::{AppearanceUse, Edge, MapMeta, NodeId, PlaceKey, SessionId, Visit, VisitId};

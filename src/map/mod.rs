//! What is remembered of each place?
//!
//! A [`Snapshot`] is one immutable state of a map: places ([`Node`]) with their features, the log of
//! what was seen at which visit, and the edges between them. This room stores and decides nothing.

mod format;
mod identity;
mod types;

pub use identity::{derived_uuid, features_digest, random_uuid};

pub use types::{
    AppearanceUse, Edge, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, Visit, VisitId,
};

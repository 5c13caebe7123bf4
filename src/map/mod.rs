//! What is remembered of each place?
//!
//! A [`Snapshot`] is one immutable state of a map: places ([`Node`]) with their features, the log of
//! what was seen at which visit, and the edges between them. This room stores and decides nothing.

mod types;

pub use types::{
    AppearanceUse, Edge, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, Visit, VisitId,
};

//! What does each panel show of a localisation?
//!
//! One file for each panel: it logs what its view shows, under the names of
//! [`entities`](crate::entities). They share [`lookup`] (what a trace says), [`texts`], [`series`]
//! and [`time_axis`].

pub(crate) mod bars;
pub(crate) mod decision;
pub(crate) mod graph;
pub(crate) mod history;
pub(crate) mod latency;
pub(crate) mod live;
pub(crate) mod lookup;
pub(crate) mod map_changes;
pub(crate) mod over_time;
pub(crate) mod predicted;
pub(crate) mod series;
pub(crate) mod similarity;
pub(crate) mod spectrum;
pub(crate) mod texts;
pub(crate) mod time_axis;

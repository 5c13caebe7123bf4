//! Which parts of a report come from the numbers alone?

mod confusion;
mod cost;
mod error;
mod glossary;
mod head;
mod methods;
mod names;
mod summary;
mod visibility;

pub(super) use confusion::confusion;
pub(super) use cost::cost;
pub(super) use error::error_over_n;
pub(super) use head::{foot, head};
pub(super) use names::label;
pub(super) use summary::summary;
pub(super) use visibility::{reobservation, visibility_errors};

//! What did the robot believe, and why?
//!
//! Turns traces of localisations ([`chronotope::trace::Trace`]) into recordings for the rerun
//! viewer: live picture with its features, predicted maps, posterior, graph of places, histories
//! and rhythms, similarity, latency and the decision with its reason, arranged on two pages. The
//! command `chronotope-dashboard` does this for files and pipes; a robot's own loop uses
//! [`Recorder`] directly (`examples/live_robot.rs`).
//!
//! This crate is the only one that names rerun, and computes nothing of its own.

mod background;
mod colours;
mod contents;
mod destination;
pub mod entities;
mod layout;
mod panels;
mod reader;
mod recorder;

pub use background::Background;
pub use contents::rows;
pub use destination::Destination;
pub use layout::Page;
pub use panels::similarity::{SIMILARITY_QUERIES, SIMILARITY_ROWS};
pub use reader::{MAX_LINE_BYTES, TraceReader};
pub use recorder::{Recorder, RecorderConfig};

//! What does a dashboard need to know of one localisation?
//!
//! A [`Trace`] is one JSON object on a line: the picture, its features, the names of all places,
//! the answer with its evidence ([`Localization`](crate::localize::Localization)), and the
//! keypoints that were predicted for each place. The first line, and every line whose map is
//! another than that of the line before, also describes the map ([`MapSummary`]): where places are
//! and how they are joined, what the latest session brought, and the history, p(t) and spectrum of
//! some features. Keypoints are `[x, y, size, response]` in px.
//!
//! A reader needs nothing but the lines, and ignores what it does not know: new fields come without
//! a new [`SCHEMA_VERSION`], and those that came later may be missing from old lines.
//!
//! Cost: O(live features + predicted features) a line; a map's description costs one transform of
//! [`SPECTRUM_BARS`] frequencies and at most [`MAX_CURVE_POINTS`] predictions for each feature
//! shown.

mod informative;
mod jpeg;
mod schema;
mod spectrum;
mod tracer;

pub use informative::most_informative;
pub use jpeg::Jpeg;
pub use schema::{
    CurveSummary, MapSummary, PlaceSummary, SCHEMA_VERSION, SessionSummary, Stage, Trace,
    TracePoint,
};
pub use spectrum::{SPECTRUM_BARS, SpectrumSummary};
pub use tracer::{MAX_CURVE_POINTS, Shot, TraceConfig, Tracer};

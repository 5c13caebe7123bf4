//! What is where in a recording?
//!
//! Paths of entities and names of timelines: the only place that spells them, for scripts that
//! query recordings. `{}` stands for a number.
//!
//! Logged with every query:
//!
//! - `belief/decision`: the answer and its reason, Markdown
//! - `belief/over_time`: percent of each place (of the best one only, in a map of many), then of
//!   being off the map
//! - `latency`: milliseconds of each stage
//!
//! Logged with pictures that are drawn:
//!
//! - `live/image`: the picture (JPEG)
//! - `live/matched`, `live/missing`, `live/unexpected`: features in px of the picture
//! - `predicted/{}/frame`, `predicted/{}/features`: predicted maps of the best places, best first, in
//!   px of the place's first visit, moved to where they were found
//! - `memory/curve_{}/now`, `memory/curve_{}/now/p`: the query's time in a feature's history (behind
//!   a break of the axis, where it is far outside), and p then
//! - `memory/similarity`: percent of predicted features found, place x query, of the latest queries
//!
//! Logged with pictures that are drawn; without any, where the decision changes:
//!
//! - `belief/bars`, `belief/bars/names`: posterior of the best places and of being off the map, drawn
//! - `belief/posterior`: percent of each place by number, then of being off the map
//! - `belief/graph`: places, coloured by posterior; the ways between them also with a new map
//!
//! Logged with a new map:
//!
//! - `memory/curve_{}/axes`, `memory/curve_{}/texts`: the frame of a feature's history, drawn over
//!   its own years
//! - `memory/curve_{}/p`: p(t) of the feature
//! - `memory/curve_{}/seen`: its history: dots at 1 or 0
//! - `memory/spectrum/amplitude`, `memory/spectrum/window`: spectrum of the first curve's history
//! - `map/changes`: what the map holds and what changed, Markdown

/// Timeline: when the picture was taken.
pub const CAPTURE_TIME: &str = "capture_time";
/// Timeline: the number of the query, from 0.
pub const QUERY: &str = "query";

/// Everything about the live picture, in its px.
pub const LIVE: &str = "live";
/// The picture.
pub const LIVE_IMAGE: &str = "live/image";
/// Live features that are predicted ones, where these belong.
pub const LIVE_MATCHED: &str = "live/matched";
/// Predicted features that were not found, where they should be.
pub const LIVE_MISSING: &str = "live/missing";
/// Live features that nothing predicted.
pub const LIVE_UNEXPECTED: &str = "live/unexpected";

/// The predicted map of the place with this rank.
pub fn predicted(rank: usize) -> String {
    format!("predicted/{rank}")
}

/// The border and name of [`predicted`].
pub fn predicted_frame(rank: usize) -> String {
    format!("predicted/{rank}/frame")
}

/// The features of [`predicted`].
pub fn predicted_features(rank: usize) -> String {
    format!("predicted/{rank}/features")
}

/// The answer and its reason.
pub const DECISION: &str = "belief/decision";
/// The posterior of all places, then of being off the map.
pub const POSTERIOR: &str = "belief/posterior";
/// The posteriors that are followed over time: of each place of a small map, else of the best; of
/// being off the map.
pub const OVER_TIME: &str = "belief/over_time";
/// The posterior of the best places, as bars with names.
pub const BARS: &str = "belief/bars";
/// Names and values of [`BARS`].
pub const BAR_NAMES: &str = "belief/bars/names";
/// The topological map.
pub const GRAPH: &str = "belief/graph";

/// Parent of what is drawn of one feature.
pub fn curve(index: usize) -> String {
    format!("memory/curve_{index}")
}

/// The frame of [`curve`].
pub fn curve_axes(index: usize) -> String {
    format!("memory/curve_{index}/axes")
}

/// Probabilities and dates at the frame.
pub fn curve_texts(index: usize) -> String {
    format!("memory/curve_{index}/texts")
}

/// p(t) of [`curve`].
pub fn curve_p(index: usize) -> String {
    format!("memory/curve_{index}/p")
}

/// The history of [`curve`].
pub fn curve_seen(index: usize) -> String {
    format!("memory/curve_{index}/seen")
}

/// The time of the query in [`curve`].
pub fn curve_now(index: usize) -> String {
    format!("memory/curve_{index}/now")
}

/// p at the time of the query.
pub fn curve_p_now(index: usize) -> String {
    format!("memory/curve_{index}/now/p")
}

/// Parent of the spectrum.
pub const SPECTRUM: &str = "memory/spectrum";
/// How much the history swings at each frequency.
pub const SPECTRUM_AMPLITUDE: &str = "memory/spectrum/amplitude";
/// How much the visits themselves come in step with it.
pub const SPECTRUM_WINDOW: &str = "memory/spectrum/window";
/// Place x query: how much of what was predicted was found.
pub const SIMILARITY: &str = "memory/similarity";

/// How long each stage took.
pub const LATENCY: &str = "latency";

/// What the map holds and what changed.
pub const MAP_CHANGES: &str = "map/changes";

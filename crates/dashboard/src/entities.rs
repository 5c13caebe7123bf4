//! What is where in a recording?
//!
//! Paths of entities and names of timelines: the only place that spells them, for scripts that query
//! recordings. `{}` below stands for a number.
//!
//! | entity | holds | logged |
//! |---|---|---|
//! | `live/image` | the picture (JPEG) | pictures that are drawn |
//! | `live/matched`, `live/missing`, `live/unexpected` | features in px of the picture | the same |
//! | `predicted/{}/frame`, `predicted/{}/features` | predicted maps of the best places, best first, in px of the place's first visit, moved to where they were found | the same |
//! | `belief/decision` | the answer and its reason, Markdown | every query |
//! | `belief/over_time` | percent of each place (of the best one only, in a map of many), of elsewhere | every query |
//! | `belief/bars`, `belief/bars/names` | posterior of the best places and elsewhere, drawn | pictures that are drawn; without any, new decision |
//! | `belief/posterior` | percent of each place by number, then "elsewhere" | the same |
//! | `belief/graph` | places, coloured by posterior; the ways between them | the same; new map |
//! | `memory/curve_{}/axes`, `memory/curve_{}/texts` | the frame of a feature's history, drawn over its own years | new map |
//! | `memory/curve_{}/p` | p(t) of the feature | new map |
//! | `memory/curve_{}/seen` | its history: dots at 1 or 0 | new map |
//! | `memory/curve_{}/now`, `memory/curve_{}/now/p` | the query's time, and p then | pictures that are drawn |
//! | `memory/spectrum/amplitude`, `memory/spectrum/window` | spectrum of the first curve's history | new map |
//! | `memory/similarity` | percent of predicted features found, place x query, of the latest queries | pictures that are drawn |
//! | `latency` | milliseconds of each stage | every query |
//! | `map/changes` | what the map holds and what changed, Markdown | new map |

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
/// The posterior of all places, then of "elsewhere".
pub const POSTERIOR: &str = "belief/posterior";
/// The posteriors that are followed over time: of each place of a small map, else of the best; of
/// "elsewhere".
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

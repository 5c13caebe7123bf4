//! What does a trace say, wherever its numbers point?
//!
//! A trace may come from anybody: numbers that point nowhere are left out, never trusted.

use chronotope::Time;
use chronotope::localize::Candidate;
use chronotope::map::PlaceKey;
use chronotope::trace::{Trace, TracePoint};

/// How people call the share of the posterior that no place has.
pub(crate) const OFF_MAP: &str = "off the map";

/// The names of all places.
pub(crate) fn names<'t>(trace: &'t Trace<'_>) -> Vec<&'t str> {
    trace.places.iter().map(PlaceKey::as_str).collect()
}

/// The name of a place.
pub(crate) fn place<'t>(trace: &'t Trace<'_>, node: usize) -> &'t str {
    (trace.places.get(node)).map_or("a place without name", PlaceKey::as_str)
}

/// The share of each place, by node; places that were not ranked have none.
pub(crate) fn posterior(trace: &Trace<'_>) -> Vec<f64> {
    let mut posterior = vec![0.0; trace.places.len()];
    for candidate in &trace.localization.ranking {
        if let Some(share) = posterior.get_mut(candidate.node.0 as usize) {
            *share = candidate.posterior;
        }
    }
    posterior
}

/// When the picture was taken; the time that was predicted for says the same, where both are there.
pub(crate) fn capture_time(trace: &Trace<'_>) -> Option<Time> {
    let written = trace
        .time
        .as_deref()
        .and_then(|text| Time::parse(text).ok());
    written.or(trace.localization.time)
}

/// Which of `num` predicted features were found where they belong.
pub(crate) fn found(candidate: &Candidate, num: usize) -> Vec<bool> {
    let mut is_found = vec![false; num];
    for found in candidate.matches.iter().filter(|found| found.inlier) {
        if let Some(is_found) = is_found.get_mut(found.rank as usize) {
            *is_found = true;
        }
    }
    is_found
}

/// By how much the picture is moved against the place, px.
pub(crate) fn displacement(candidate: &Candidate) -> (f32, f32) {
    let median = candidate.displacement.median;
    (median.dx_px as f32, median.dy_px as f32)
}

/// Where a point of a place is in the picture.
pub(crate) fn moved(point: &TracePoint, shift: (f32, f32)) -> (f32, f32) {
    (point[0] + shift.0, point[1] + shift.1)
}

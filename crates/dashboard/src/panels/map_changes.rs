//! What does the map hold, and what has changed in it?

use std::fmt::Write as _;

use anyhow::Result;
use chronotope::trace::{MapSummary, Trace};
use rerun::{RecordingStream, TextDocument};

use crate::entities;

/// What the map holds, what its latest session brought, and what is new since `before`.
pub(crate) fn log(
    stream: &RecordingStream,
    trace: &Trace<'_>,
    before: Option<&MapSummary>,
    map: &MapSummary,
) -> Result<()> {
    let document = TextDocument::from_markdown(text(trace, before, map));
    Ok(stream.log(entities::MAP_CHANGES, &document)?)
}

fn text(trace: &Trace<'_>, before: Option<&MapSummary>, map: &MapSummary) -> String {
    let (visits, features) = totals(map);
    let mut text = format!(
        "**Map** {}, generation {}: {} places, {} ways, {visits} visits, {features} features\n\n",
        trace.map_uuid.get(..8).unwrap_or(&trace.map_uuid),
        trace.map_generation,
        map.places.len(),
        map.edges.len(),
    );
    if let Some(session) = &map.latest_session {
        let new_places = match session.new_places.as_slice() {
            [] => "no new place".into(),
            places => format!("{} new places", places.len()),
        };
        let _ = write!(
            text,
            "**Latest session**, {} to {}: +{} visits, +{} features, {new_places}\n\n",
            session.first, session.last, session.num_visits, session.num_born
        );
    }
    if let Some(before) = before {
        let (visits_before, features_before) = totals(before);
        let _ = write!(
            text,
            "**Since the map before**: {:+} visits, {:+} features, {:+} places\n\n",
            visits as i64 - visits_before as i64,
            features as i64 - features_before as i64,
            map.places.len() as i64 - before.places.len() as i64
        );
    }
    text
}

/// Visits and features of all places.
fn totals(map: &MapSummary) -> (usize, usize) {
    let visits = map.places.iter().map(|place| place.num_visits).sum();
    let features = map.places.iter().map(|place| place.num_features).sum();
    (visits, features)
}

//! What does a dashboard need to know of one localisation?
//!
//! One JSON object a line, complete in itself: the picture, its features, the names of all places, the
//! answer with its evidence ([`Localization`]), and the keypoints that were predicted for each place.
//! Keypoints are `[x, y, size, response]` in px.

use serde::Serialize;

use super::pictures::{Picture, TimeSource};
use crate::feature::{Features, Keypoint};
use crate::localize::{Candidate, Localization, Localizer};
use crate::map::PlaceKey;
use crate::predict::Selection;

/// Changes with every change that a reader has to know of.
const SCHEMA_VERSION: u32 = 1;

#[derive(Serialize)]
pub(super) struct Trace<'a> {
    schema_version: u32,
    image: &'a str,
    file: Option<&'a std::path::Path>,
    /// How the file was cut, turned and scaled.
    recipe: &'a str,
    image_size: (usize, usize),
    time: Option<String>,
    time_source: Option<TimeSource>,
    /// The place that an index says it shows.
    truth: Option<&'a PlaceKey>,
    map_uuid: String,
    map_generation: u64,
    method: &'static str,
    score: &'static str,
    selection: Selection,
    /// The name of each node, by id.
    places: Vec<&'a PlaceKey>,
    /// The live image's features, by the index that matches use.
    live: Vec<Point>,
    /// For each candidate of the ranking, in its order: what it was matched by, by the rank that
    /// matches use.
    predicted: Vec<Vec<Point>>,
    localization: &'a Localization,
    duration_ms: f64,
}

type Point = [f32; 4];

impl<'a> Trace<'a> {
    pub(super) fn new(
        localizer: &'a Localizer,
        picture: &'a Picture,
        live: &Features,
        answer: &'a Localization,
        duration_ms: f64,
    ) -> Self {
        let snapshot = localizer.snapshot();
        let cfg = localizer.cfg();
        Self {
            schema_version: SCHEMA_VERSION,
            image: &picture.name,
            file: picture.file.as_deref(),
            recipe: &picture.recipe,
            image_size: (picture.image.width(), picture.image.height()),
            time: picture.time.map(|(time, _)| time.to_string()),
            time_source: picture.time.map(|(_, source)| source),
            truth: picture.truth.as_ref(),
            map_uuid: format!("{:032x}", snapshot.meta.uuid),
            map_generation: snapshot.generation,
            method: cfg.method().name(),
            score: cfg.score().name(),
            selection: cfg.selection(),
            places: snapshot.nodes.iter().map(|node| &node.key).collect(),
            live: points(live.keypoints()),
            predicted: (answer.ranking.iter())
                .map(|candidate| predicted(localizer, candidate))
                .collect(),
            localization: answer,
            duration_ms,
        }
    }
}

/// What a place was matched by.
fn predicted(localizer: &Localizer, candidate: &Candidate) -> Vec<Point> {
    let node = localizer.snapshot().node(candidate.node);
    let Some(visit) = candidate.appearance else {
        let keypoints = node.features.keypoints();
        return (candidate.predicted.iter())
            .map(|&id| point(&keypoints[id as usize]))
            .collect();
    };
    let size = match localizer.cfg().selection() {
        Selection::Top(n) => n,
        Selection::Threshold(_) => usize::MAX,
    };
    let appearance = &node.visits[visit as usize].appearance;
    (appearance.as_ref()).map_or_else(Vec::new, |features| {
        points(features.view().prefix(size).keypoints)
    })
}

fn points(keypoints: &[Keypoint]) -> Vec<Point> {
    keypoints.iter().map(point).collect()
}

fn point(keypoint: &Keypoint) -> Point {
    [keypoint.x, keypoint.y, keypoint.size, keypoint.response]
}

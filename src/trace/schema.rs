//! What stands on one line of a trace?

use std::borrow::Cow;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::jpeg::Jpeg;
use super::spectrum::SpectrumSummary;
use crate::localize::Localization;
use crate::map::{Edge, NodeId, PlaceKey};
use crate::predict::Selection;

/// Changes with every change that a reader has to know of.
pub const SCHEMA_VERSION: u32 = 1;

/// `[x, y, size, response]` in px.
pub type TracePoint = [f32; 4];

/// One localisation with all its evidence, and what else it takes to show it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Trace<'a> {
    /// [`SCHEMA_VERSION`] of the writer.
    pub schema_version: u32,
    /// How the picture is called.
    pub image: Cow<'a, str>,
    /// The file it comes from.
    pub file: Option<Cow<'a, Path>>,
    /// How the file was cut, turned and scaled.
    pub recipe: Cow<'a, str>,
    /// Width and height, px.
    pub image_size: (usize, usize),
    /// When it was taken, RFC 3339.
    pub time: Option<String>,
    /// Where that time comes from, one word.
    pub time_source: Option<Cow<'a, str>>,
    /// The place that it is known to show.
    pub truth: Option<PlaceKey>,
    /// The map's UUID.
    pub map_uuid: String,
    /// The commit that was localised in.
    pub map_generation: u64,
    /// How places are remembered.
    pub method: Cow<'a, str>,
    /// What places are ranked by.
    pub score: Cow<'a, str>,
    /// How many features were predicted.
    pub selection: Selection,
    /// The name of each node, by id.
    pub places: Vec<PlaceKey>,
    /// The live image's features, by the index that matches use.
    pub live: Vec<TracePoint>,
    /// For each candidate of the ranking, in its order, what it was matched by, by the rank that
    /// matches use; shorter than the ranking if
    /// [`TraceConfig::with_num_candidates`](super::TraceConfig::with_num_candidates) says so.
    pub predicted: Vec<Vec<TracePoint>>,
    /// The answer with its evidence.
    pub localization: Cow<'a, Localization>,
    /// Milliseconds from pixels to answer.
    pub duration_ms: f64,
    /// The parts of that, in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<Stage>,
    /// p at this time of each feature of [`MapSummary::curves`], in its order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curve_probabilities: Vec<f64>,
    /// The map, if it is not that of the line before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<MapSummary>,
    /// The picture that was localised, for some lines only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jpeg: Option<Jpeg>,
}

impl Trace<'_> {
    /// The same without borrowing anything, for another thread; costs a copy of what was borrowed.
    pub fn into_owned(self) -> Trace<'static> {
        fn owned<B: ?Sized + ToOwned>(part: Cow<'_, B>) -> Cow<'static, B> {
            Cow::Owned(part.into_owned())
        }
        Trace {
            schema_version: self.schema_version,
            image: owned(self.image),
            file: self.file.map(owned),
            recipe: owned(self.recipe),
            image_size: self.image_size,
            time: self.time,
            time_source: self.time_source.map(owned),
            truth: self.truth,
            map_uuid: self.map_uuid,
            map_generation: self.map_generation,
            method: owned(self.method),
            score: owned(self.score),
            selection: self.selection,
            places: self.places,
            live: self.live,
            predicted: self.predicted,
            localization: owned(self.localization),
            duration_ms: self.duration_ms,
            stages: self.stages,
            curve_probabilities: self.curve_probabilities,
            map: self.map,
            jpeg: self.jpeg,
        }
    }
}

/// How long one part of a localisation took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// What was done, in one word.
    pub name: Cow<'static, str>,
    /// How long it took, in milliseconds.
    pub ms: f64,
}

impl Stage {
    /// A stage that took this long.
    pub fn new(name: &'static str, took: std::time::Duration) -> Self {
        Self {
            name: Cow::Borrowed(name),
            ms: took.as_secs_f64() * 1e3,
        }
    }

    /// A stage that began at `start` and ends now.
    pub fn since(name: &'static str, start: std::time::Instant) -> Self {
        Self::new(name, start.elapsed())
    }
}

/// What a dashboard shows of a map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MapSummary {
    /// One for each node, by id.
    pub places: Vec<PlaceSummary>,
    /// The ways between them.
    pub edges: Vec<Edge>,
    /// The session with the latest visit; `None` in a map without visits.
    pub latest_session: Option<SessionSummary>,
    /// The features whose visibility changes most with time (where none changes, those whose
    /// history is split most evenly): at most
    /// [`TraceConfig::with_num_curves`](super::TraceConfig::with_num_curves), each of another
    /// place.
    pub curves: Vec<CurveSummary>,
}

/// What a dashboard shows of one place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlaceSummary {
    /// Position in metres, where known.
    pub pose: Option<[f64; 3]>,
    /// How often it was visited.
    pub num_visits: usize,
    /// How many features it has.
    pub num_features: usize,
}

/// What one session changed in the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionSummary {
    /// Its UUID.
    pub id: String,
    /// Its first visit, RFC 3339.
    pub first: String,
    /// The time of its last visit, RFC 3339.
    pub last: String,
    /// Visits that it added.
    pub num_visits: usize,
    /// Features born at them.
    pub num_born: usize,
    /// Places that were visited for the first time.
    pub new_places: Vec<PlaceKey>,
}

/// The history of one feature, and what was learnt from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurveSummary {
    /// The place that it belongs to.
    pub node: NodeId,
    /// Its number among the features of the place.
    pub feature: usize,
    /// Where it is in the place's frame.
    pub point: TracePoint,
    /// The period of its strongest rhythm, s.
    pub period_s: Option<f64>,
    /// When the place was visited, microseconds since 1970.
    pub visit_times_us: Vec<i64>,
    /// Whether it was seen at each visit; `None` where it could not be observed.
    pub seen: Vec<Option<bool>>,
    /// Times of the curve, microseconds since 1970.
    pub times_us: Vec<i64>,
    /// p at these times.
    pub p: Vec<f64>,
    /// The rhythms of the history.
    pub spectrum: SpectrumSummary,
}

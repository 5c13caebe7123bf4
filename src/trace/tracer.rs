//! How is a localisation, and the map that it was made in, put into a trace?

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use super::informative::most_informative;
use super::jpeg::Jpeg;
use super::schema::{
    CurveSummary, MapSummary, PlaceSummary, SCHEMA_VERSION, SessionSummary, Stage, Trace,
    TracePoint,
};
use super::spectrum::SpectrumSummary;
use crate::feature::{Features, GrayImage, Keypoint};
use crate::localize::{Candidate, Localization, Localizer};
use crate::map::{Node, NodeId, PlaceKey, Snapshot};
use fremen::error::Result;
use fremen::time::Time;
use fremen::visibility::{FeatureState, VisibilityModel};

/// Points of a curve p(t).
pub const MAX_CURVE_POINTS: usize = 3_000;
/// Points of a curve within its shortest rhythm.
const POINTS_PER_PERIOD: f64 = 8.0;
/// Points of a curve without rhythms.
const MIN_CURVE_POINTS: usize = 200;

/// What a [`Tracer`] puts into traces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceConfig {
    image_every: usize,
    num_candidates: usize,
    num_curves: usize,
}

impl Default for TraceConfig {
    /// Every picture, every candidate, three curves.
    fn default() -> Self {
        Self {
            image_every: 1,
            num_candidates: usize::MAX,
            num_curves: 3,
        }
    }
}

impl TraceConfig {
    /// The picture itself with every `n`-th line, from the first; 0: never.
    #[must_use]
    pub fn with_image_every(mut self, n: usize) -> Self {
        self.image_every = n;
        self
    }

    /// Predicted keypoints for this many of the best candidates.
    #[must_use]
    pub fn with_num_candidates(mut self, num: usize) -> Self {
        self.num_candidates = num;
        self
    }

    /// History, p(t) and spectrum of this many features of a map.
    #[must_use]
    pub fn with_num_curves(mut self, num: usize) -> Self {
        self.num_curves = num;
        self
    }
}

/// One picture that was localised.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// How it is called.
    pub name: &'a str,
    /// The file it comes from.
    pub file: Option<&'a Path>,
    /// How the file was cut, turned and scaled; may be empty.
    pub recipe: &'a str,
    /// The picture itself.
    pub picture: &'a GrayImage,
    /// When it was taken.
    pub time: Option<Time>,
    /// Who said so, one word.
    pub time_source: Option<&'a str>,
    /// The place that it is known to show.
    pub truth: Option<&'a PlaceKey>,
    /// Its features, as they were localised.
    pub live: &'a Features,
    /// How long each part took.
    pub stages: &'a [Stage],
}

/// The map that was described last.
#[derive(Debug)]
struct Described {
    snapshot: Arc<Snapshot>,
    /// The features shown of it.
    features: Vec<(NodeId, usize)>,
}

/// Makes traces of one localisation after another.
#[derive(Debug, Default)]
pub struct Tracer {
    cfg: TraceConfig,
    num_lines: usize,
    described: Option<Described>,
}

impl Tracer {
    /// A tracer that has traced nothing yet.
    pub fn new(cfg: TraceConfig) -> Self {
        Self {
            cfg,
            ..Self::default()
        }
    }

    /// The trace of `answer`, which `localizer` gave to `shot`.
    ///
    /// Fails if the picture has no pixels and is to be shown.
    pub fn trace<'a>(
        &mut self,
        localizer: &'a Localizer,
        shot: &Shot<'a>,
        answer: &'a Localization,
    ) -> Result<Trace<'a>> {
        let snapshot = localizer.snapshot();
        let cfg = localizer.cfg();
        let map = self.describe(localizer, shot.time);
        let with_image =
            self.cfg.image_every > 0 && self.num_lines.is_multiple_of(self.cfg.image_every);
        self.num_lines += 1;
        Ok(Trace {
            schema_version: SCHEMA_VERSION,
            image: shot.name.into(),
            file: shot.file.map(Into::into),
            recipe: shot.recipe.into(),
            image_size: (shot.picture.width(), shot.picture.height()),
            time: shot.time.map(|time| time.to_string()),
            time_source: shot.time_source.map(Into::into),
            truth: shot.truth.cloned(),
            map_uuid: format!("{:032x}", snapshot.meta().uuid),
            map_generation: snapshot.generation(),
            method: cfg.method().name().into(),
            score: cfg.score().name().into(),
            selection: cfg.selection(),
            places: snapshot
                .nodes()
                .iter()
                .map(|node| node.key().clone())
                .collect(),
            live: points(shot.live.keypoints()),
            predicted: (answer.ranking.iter())
                .take(self.cfg.num_candidates)
                .map(|candidate| predicted(localizer, candidate))
                .collect(),
            localization: Cow::Borrowed(answer),
            duration_ms: shot.stages.iter().map(|stage| stage.ms).sum(),
            stages: shot.stages.to_vec(),
            curve_probabilities: self.probabilities(localizer, shot.time),
            map,
            jpeg: with_image.then(|| Jpeg::encode(shot.picture)).transpose()?,
        })
    }

    /// The map, if it is another than last time.
    fn describe(&mut self, localizer: &Localizer, now: Option<Time>) -> Option<MapSummary> {
        let snapshot = localizer.snapshot();
        if let Some(known) = &self.described
            && Arc::ptr_eq(&known.snapshot, snapshot)
        {
            return None;
        }
        let shown = most_informative(localizer, self.cfg.num_curves);
        let curves = (shown.iter())
            .filter_map(|&(node, feature)| {
                let model = localizer.model(node)?;
                Some(curve(snapshot, node, feature, model, now))
            })
            .collect();
        self.described = Some(Described {
            snapshot: Arc::clone(snapshot),
            features: shown,
        });
        Some(MapSummary {
            places: (snapshot.nodes().iter())
                .map(|node| PlaceSummary {
                    pose: node.pose(),
                    num_visits: node.visits().len(),
                    num_features: node.features().len(),
                })
                .collect(),
            edges: snapshot.edges().to_vec(),
            latest_session: latest_session(snapshot),
            curves,
        })
    }

    fn probabilities(&self, localizer: &Localizer, time: Option<Time>) -> Vec<f64> {
        let (Some(time), Some(shown)) = (time, &self.described) else {
            return Vec::new();
        };
        (shown.features.iter())
            .filter_map(|&(node, feature)| Some(localizer.model(node)?.predict_one(feature, time)))
            .collect()
    }
}

/// What a place was matched by.
fn predicted(localizer: &Localizer, candidate: &Candidate) -> Vec<TracePoint> {
    let node = localizer.snapshot().node(candidate.node);
    let Some(visit) = candidate.appearance else {
        let keypoints = node.features().keypoints();
        return (candidate.predicted.iter())
            .map(|&id| point(&keypoints[id as usize]))
            .collect();
    };
    let appearance = &node.visits()[visit as usize].appearance;
    (appearance.as_ref()).map_or_else(Vec::new, |features| {
        points(features.view().prefix(localizer.largest_size()).keypoints)
    })
}

/// The history of a feature and its p(t) from the first visit to `now`.
fn curve(
    snapshot: &Snapshot,
    id: NodeId,
    feature: usize,
    model: &dyn VisibilityModel,
    now: Option<Time>,
) -> CurveSummary {
    let node = snapshot.node(id);
    let times = node.log().times();
    let seen: Vec<Option<bool>> = (0..times.len())
        .map(|visit| match node.log().state(visit, feature) {
            Some(FeatureState::Seen) => Some(true),
            Some(FeatureState::NotSeen) => Some(false),
            Some(FeatureState::NotObservable) | None => None,
        })
        .collect();
    let ends = || times.iter().copied().chain(now);
    let first = ends().min().unwrap_or_default();
    let last = ends().max().unwrap_or_default();
    let span_us = last.as_us().saturating_sub(first.as_us());
    let components = model.components(feature);
    let shortest_s = (components.iter())
        .map(|component| component.period_s)
        .fold(f64::INFINITY, f64::min);
    let wanted = POINTS_PER_PERIOD * (span_us as f64 / 1e6) / shortest_s;
    let num_points = (wanted as usize).clamp(MIN_CURVE_POINTS, MAX_CURVE_POINTS);
    let times_us: Vec<i64> = (0..=num_points)
        .map(|i| {
            let us = i128::from(span_us) * i as i128 / num_points as i128;
            first.plus_us(us as i64).as_us()
        })
        .collect();
    CurveSummary {
        node: id,
        feature,
        point: point(&node.features().keypoints()[feature]),
        period_s: components.first().map(|component| component.period_s),
        visit_times_us: times.iter().map(|time| time.as_us()).collect(),
        p: (times_us.iter())
            .map(|&us| model.predict_one(feature, Time::from_us(us)))
            .collect(),
        times_us,
        spectrum: SpectrumSummary::of(times, &seen),
        seen,
    }
}

/// The session with the latest visit, and what it changed.
fn latest_session(snapshot: &Snapshot) -> Option<SessionSummary> {
    let visits = || snapshot.nodes().iter().flat_map(|node| node.visits());
    let latest = visits().max_by_key(|visit| (visit.time, visit.id))?.session;
    let of_it = || visits().filter(|visit| visit.session == latest);
    let is_of_it =
        |node: &Node, index: usize| (node.visits().get(index)).is_some_and(|v| v.session == latest);
    Some(SessionSummary {
        id: latest.to_string(),
        first: of_it().map(|visit| visit.time).min()?.to_string(),
        last: of_it().map(|visit| visit.time).max()?.to_string(),
        num_visits: of_it().count(),
        num_born: (snapshot.nodes().iter())
            .map(|node| {
                (0..node.log().num_features())
                    .filter(|&feature| is_of_it(node, node.log().birth(feature)))
                    .count()
            })
            .sum(),
        new_places: (snapshot.nodes().iter())
            .filter(|node| is_of_it(node, 0))
            .map(|node| node.key().clone())
            .collect(),
    })
}

fn points(keypoints: &[Keypoint]) -> Vec<TracePoint> {
    keypoints.iter().map(point).collect()
}

fn point(keypoint: &Keypoint) -> TracePoint {
    [keypoint.x, keypoint.y, keypoint.size, keypoint.response]
}

//! What does a dashboard need to know of one localisation?
//!
//! A [`Trace`] is one JSON object on a line: the picture, its features, the names of all places, the
//! answer with its evidence ([`Localization`]), and the keypoints that were predicted for each place.
//! The first line, and every line whose map is another than that of the line before, also describes the
//! map ([`MapSheet`]): where places are and how they are joined, what the latest session brought, and
//! the history, p(t) and spectrum of some features. Keypoints are `[x, y, size, response]` in px.
//!
//! A reader needs nothing but the lines, and ignores what it does not know: new fields come without a
//! new [`SCHEMA_VERSION`], and those that came later may be missing from old lines.
//!
//! Cost: O(live features + predicted features) a line; a map's description costs one transform of
//! [`SPECTRUM_BARS`] frequencies and at most [`MAX_CURVE_POINTS`] predictions for each feature shown.

use std::borrow::Cow;
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::feature::{Features, GrayImage, Keypoint};
use crate::localize::{Candidate, Localization, Localizer};
use crate::map::{Edge, Node, NodeId, PlaceKey, Snapshot};
use crate::predict::Selection;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Period, Time};
use fremen::visibility::{Observation, VisibilityModel};

/// Changes with every change that a reader has to know of.
pub const SCHEMA_VERSION: u32 = 1;
/// Frequencies of a spectrum.
pub const SPECTRUM_BARS: usize = 240;
/// Points of a curve p(t).
pub const MAX_CURVE_POINTS: usize = 3_000;
/// Points of a curve within its shortest rhythm.
const POINTS_PER_PERIOD: f64 = 8.0;
/// Points of a curve without rhythms.
const MIN_CURVE_POINTS: usize = 200;
/// 0 to 100; above this a picture only grows.
const JPEG_QUALITY: u8 = 80;

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
    /// Who said so.
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
    /// For each candidate of the ranking, in its order, what it was matched by, by the rank that matches
    /// use; shorter than the ranking if [`TraceConfig::with_num_candidates`] says so.
    pub predicted: Vec<Vec<TracePoint>>,
    /// The answer.
    pub localization: Cow<'a, Localization>,
    /// Milliseconds from pixels to answer.
    pub duration_ms: f64,
    /// The parts of that, in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<Stage>,
    /// p at this time of each feature of [`MapSheet::curves`], in its order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curve_probabilities: Vec<f64>,
    /// The map, if it is not that of the line before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<MapSheet>,
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
    /// One word.
    pub name: Cow<'static, str>,
    /// Milliseconds.
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

/// A picture as a JPEG file; base64 in JSON.
#[derive(Clone, PartialEq, Eq)]
pub struct Jpeg(pub Vec<u8>);

impl Jpeg {
    /// Encodes a picture.
    pub fn encode(picture: &GrayImage) -> Result<Self> {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
            .write_image(
                picture.data(),
                picture.width() as u32,
                picture.height() as u32,
                ExtendedColorType::L8,
            )
            .map_err(|error| {
                Error::new(
                    ErrorKind::Format,
                    format!("no JPEG can be made of it: {error}"),
                )
            })?;
        Ok(Self(bytes))
    }
}

impl std::fmt::Debug for Jpeg {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Jpeg({} bytes)", self.0.len())
    }
}

impl Serialize for Jpeg {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.serialize_str(&BASE64.encode(&self.0))
    }
}

impl<'de> Deserialize<'de> for Jpeg {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let text = Cow::<str>::deserialize(deserializer)?;
        let bytes = BASE64.decode(text.as_bytes());
        bytes.map(Self).map_err(serde::de::Error::custom)
    }
}

/// What a dashboard shows of a map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MapSheet {
    /// One for each node, by id.
    pub places: Vec<PlaceSheet>,
    /// The ways between them.
    pub edges: Vec<Edge>,
    /// The session with the latest visit; `None` in a map without visits.
    pub latest_session: Option<SessionSheet>,
    /// The features whose visibility changes most with time (where none changes, those whose history is
    /// split most evenly): at most [`TraceConfig::with_num_curves`], each of another place.
    pub curves: Vec<CurveSheet>,
}

/// One place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlaceSheet {
    /// Position in metres, where known.
    pub pose: Option<[f64; 3]>,
    /// How often it was visited.
    pub num_visits: usize,
    /// How many features it has.
    pub num_features: usize,
}

/// What one session changed in the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionSheet {
    /// Its UUID.
    pub id: String,
    /// Its first visit, RFC 3339.
    pub first: String,
    /// Its last visit.
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
pub struct CurveSheet {
    /// Its place.
    pub node: NodeId,
    /// Its number there.
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
    pub spectrum: SpectrumSheet,
}

/// The amplitudes of a history's rhythms.
///
/// With visits at `t_i`, 1 <= i <= m, and states `s_i` in {0, 1} of mean mu, frequency f has the amplitude
/// `2 / m * abs(sum_i (s_i - mu) e^(-j 2 pi f t_i))` and the sampling window
/// `1 / m * abs(sum_i e^(-j 2 pi f t_i))`: where the window is near 1, visits came in step with f, and
/// no history can tell that rhythm from none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpectrumSheet {
    /// What frequencies are counted per, `day` or `year`.
    pub per: String,
    /// Frequencies, ascending from one cycle in the history's span.
    pub frequencies: Vec<f64>,
    /// Their amplitudes, 0 to 1.
    pub amplitudes: Vec<f64>,
    /// The sampling window, 0 to 1.
    pub window: Vec<f64>,
}

impl SpectrumSheet {
    /// The amplitudes of the rhythms of a history: when it was looked for, and whether it was seen.
    ///
    /// Frequencies are multiples of one cycle in the span, up to 2.5 a day (twelve a year, where visits are
    /// more than a day apart). If that is more than [`SPECTRUM_BARS`], each bar shows the highest of its part.
    pub fn of(times: &[Time], seen: &[Option<bool>]) -> Self {
        let observed: Vec<(f64, f64)> = (times.iter().zip(seen))
            .filter_map(|(&time, &seen)| Some((time.since_s(times[0]), f64::from(u8::from(seen?)))))
            .collect();
        let mut ascending: Vec<f64> = observed.iter().map(|&(t_s, _)| t_s).collect();
        ascending.sort_unstable_by(f64::total_cmp);
        let span_s = match (ascending.first(), ascending.last()) {
            (Some(first), Some(last)) if last > first => last - first,
            _ => return Self::default(),
        };
        let mut gaps_s: Vec<f64> = ascending.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps_s.sort_unstable_by(f64::total_cmp);
        let is_daily = gaps_s[gaps_s.len() / 2] <= Period::DAY.as_s();
        let (per, unit_s, highest) = if is_daily {
            ("day", Period::DAY.as_s(), 2.5)
        } else {
            ("year", Period::YEAR.as_s(), 12.0)
        };
        let m = observed.len() as f64;
        let mean = observed.iter().map(|&(_, state)| state).sum::<f64>() / m;
        let transform = |f_hz: f64| {
            let mut sums = [0.0; 4];
            for &(t_s, state) in &observed {
                let (sin, cos) = (TAU * f_hz * t_s).sin_cos();
                let state = state - mean;
                for (sum, term) in (sums.iter_mut()).zip([state * cos, state * sin, cos, sin]) {
                    *sum += term;
                }
            }
            (
                2.0 / m * sums[0].hypot(sums[1]),
                1.0 / m * sums[2].hypot(sums[3]),
            )
        };
        let num = ((highest / unit_s * span_s).ceil() as usize).max(2);
        // Years of daily visits have thousands of lines; a part of them shows how high they are.
        let num = num.min(64 * SPECTRUM_BARS);
        let per_bar = num.div_ceil(SPECTRUM_BARS);
        let mut sheet = Self {
            per: per.into(),
            ..Self::default()
        };
        for first in (1..=num).step_by(per_bar) {
            let part = first..(first + per_bar).min(num + 1);
            let middle = (part.start + part.end - 1) as f64 / 2.0;
            sheet.frequencies.push(middle / span_s * unit_s);
            let (amplitude, window) = part
                .map(|k| transform(k as f64 / span_s))
                .fold((0.0_f64, 0.0_f64), |a, b| (a.0.max(b.0), a.1.max(b.1)));
            sheet.amplitudes.push(amplitude.min(1.0));
            sheet.window.push(window.min(1.0));
        }
        sheet
    }
}

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
    /// Its pixels.
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
    /// Nothing traced yet.
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
            map_uuid: format!("{:032x}", snapshot.meta.uuid),
            map_generation: snapshot.generation,
            method: cfg.method().name().into(),
            score: cfg.score().name().into(),
            selection: cfg.selection(),
            places: snapshot.nodes.iter().map(|node| node.key.clone()).collect(),
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
    fn describe(&mut self, localizer: &Localizer, now: Option<Time>) -> Option<MapSheet> {
        let snapshot = localizer.snapshot();
        if let Some(known) = &self.described
            && Arc::ptr_eq(&known.snapshot, snapshot)
        {
            return None;
        }
        let shown = telling(localizer, self.cfg.num_curves);
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
        Some(MapSheet {
            places: (snapshot.nodes.iter())
                .map(|node| PlaceSheet {
                    pose: node.pose,
                    num_visits: node.visits.len(),
                    num_features: node.features.len(),
                })
                .collect(),
            edges: snapshot.edges.clone(),
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
        let keypoints = node.features.keypoints();
        return (candidate.predicted.iter())
            .map(|&id| point(&keypoints[id as usize]))
            .collect();
    };
    let appearance = &node.visits[visit as usize].appearance;
    (appearance.as_ref()).map_or_else(Vec::new, |features| {
        points(features.view().prefix(localizer.largest_size()).keypoints)
    })
}

/// The feature of each place that has most to tell, those with most first: how far its p(t) swings; where
/// too few swing, how evenly its history is split between seen and not seen.
///
/// At most `num`; places without a model of time have none. O(features of the map), and no more than `num`
/// histories of places that do not swing.
pub fn telling(localizer: &Localizer, num: usize) -> Vec<(NodeId, usize)> {
    let snapshot = localizer.snapshot();
    let nodes = (0..snapshot.nodes.len() as u32).map(NodeId);
    let (mut swinging, mut still) = (Vec::new(), Vec::new());
    for id in nodes {
        let Some(model) = localizer.model(id) else {
            continue;
        };
        let swing = |feature| model.components(feature).iter().map(|c| c.amplitude).sum();
        let best = (0..model.num_features())
            .map(|feature| (swing(feature), feature))
            .max_by(|a: &(f64, usize), b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        match best {
            Some((swing, feature)) if swing > 0.0 => swinging.push((swing, id, feature)),
            Some(_) => still.push(id),
            None => {}
        }
    }
    let most_first = |found: &mut Vec<(f64, NodeId, usize)>| {
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    };
    most_first(&mut swinging);
    swinging.truncate(num);
    let mut split: Vec<(f64, NodeId, usize)> = (still.into_iter())
        .take(num - swinging.len())
        .filter_map(|id| {
            let (split, feature) = most_split(snapshot.node(id))?;
            Some((split, id, feature))
        })
        .collect();
    most_first(&mut split);
    (swinging.into_iter().chain(split))
        .map(|(_, id, feature)| (id, feature))
        .collect()
}

/// The feature of a place whose history is split most evenly: with a visits at which it was seen and b at which
/// it was not, a b / (a + b) is the largest. O(features x visits).
fn most_split(node: &Node) -> Option<(f64, usize)> {
    (0..node.features.len())
        .map(|feature| {
            let (mut seen, mut missed) = (0.0, 0.0);
            for visit in node.log.birth(feature)..node.log.num_visits() {
                match node.log.observation(visit, feature) {
                    Some(Observation::Seen) => seen += 1.0,
                    Some(Observation::NotSeen) => missed += 1.0,
                    Some(Observation::NotObservable) | None => {}
                }
            }
            (seen * missed / f64::max(seen + missed, 1.0), feature)
        })
        .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
}

/// The history of a feature and its p(t) from the first visit to `now`.
fn curve(
    snapshot: &Snapshot,
    id: NodeId,
    feature: usize,
    model: &dyn VisibilityModel,
    now: Option<Time>,
) -> CurveSheet {
    let node = snapshot.node(id);
    let times = node.log.times();
    let seen: Vec<Option<bool>> = (0..times.len())
        .map(|visit| match node.log.observation(visit, feature) {
            Some(Observation::Seen) => Some(true),
            Some(Observation::NotSeen) => Some(false),
            Some(Observation::NotObservable) | None => None,
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
    CurveSheet {
        node: id,
        feature,
        point: point(&node.features.keypoints()[feature]),
        period_s: components.first().map(|component| component.period_s),
        visit_times_us: times.iter().map(|time| time.as_us()).collect(),
        p: (times_us.iter())
            .map(|&us| model.predict_one(feature, Time::from_us(us)))
            .collect(),
        times_us,
        spectrum: SpectrumSheet::of(times, &seen),
        seen,
    }
}

/// The session with the latest visit, and what it changed.
fn latest_session(snapshot: &Snapshot) -> Option<SessionSheet> {
    let visits = || snapshot.nodes.iter().flat_map(|node| &node.visits);
    let latest = visits().max_by_key(|visit| (visit.time, visit.id))?.session;
    let of_it = || visits().filter(|visit| visit.session == latest);
    let is_of_it =
        |node: &Node, index: usize| (node.visits.get(index)).is_some_and(|v| v.session == latest);
    Some(SessionSheet {
        id: latest.to_string(),
        first: of_it().map(|visit| visit.time).min()?.to_string(),
        last: of_it().map(|visit| visit.time).max()?.to_string(),
        num_visits: of_it().count(),
        num_born: (snapshot.nodes.iter())
            .map(|node| {
                (0..node.log.num_features())
                    .filter(|&feature| is_of_it(node, node.log.birth(feature)))
                    .count()
            })
            .sum(),
        new_places: (snapshot.nodes.iter())
            .filter(|node| is_of_it(node, 0))
            .map(|node| node.key.clone())
            .collect(),
    })
}

fn points(keypoints: &[Keypoint]) -> Vec<TracePoint> {
    keypoints.iter().map(point).collect()
}

fn point(keypoint: &Keypoint) -> TracePoint {
    [keypoint.x, keypoint.y, keypoint.size, keypoint.response]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A feature that is seen by day only, looked at every five hours and a bit for 100 days.
    fn by_day() -> (Vec<Time>, Vec<Option<bool>>) {
        let times: Vec<Time> = (0..480).map(|i| Time::from_s(i * 18_011)).collect();
        let seen = (times.iter())
            .map(|time| Some(time.phase(Period::DAY) < 0.5))
            .collect();
        (times, seen)
    }

    fn highest(values: &[f64]) -> usize {
        (0..values.len())
            .max_by(|&a, &b| values[a].total_cmp(&values[b]))
            .expect("bars")
    }

    #[test]
    fn a_daily_rhythm_is_the_highest_bar() {
        let (times, seen) = by_day();
        let sheet = SpectrumSheet::of(&times, &seen);
        assert_eq!(sheet.per, "day");
        assert!(sheet.frequencies.len() <= SPECTRUM_BARS);
        let best = highest(&sheet.amplitudes);
        assert!((sheet.frequencies[best] - 1.0).abs() < 0.02, "{sheet:?}");
        // A square wave's first harmonic is 2 / pi.
        assert!((sheet.amplitudes[best] - 2.0 / std::f64::consts::PI).abs() < 0.05);
        // Five hours and eleven seconds step past every rhythm up to twice a day.
        let window = (sheet.frequencies.iter().zip(&sheet.window))
            .filter(|(frequency, _)| **frequency < 2.0)
            .map(|(_, window)| *window)
            .fold(0.0, f64::max);
        assert!(window < 0.3, "{window}");
    }

    #[test]
    fn visits_once_a_day_show_in_the_sampling_window() {
        let times: Vec<Time> = (0..100).map(|day| Time::from_s(day * 86_400)).collect();
        let seen = vec![Some(true); times.len()];
        let sheet = SpectrumSheet::of(&times, &seen);
        for per_day in [1.0, 2.0] {
            let bar = (sheet.frequencies.iter()).position(|f| (f - per_day).abs() < 0.006);
            assert!(sheet.window[bar.expect("a bar")] > 0.99, "{sheet:?}");
        }
        assert!(sheet.amplitudes.iter().all(|&amplitude| amplitude < 1e-9));
    }

    #[test]
    fn what_could_not_be_observed_has_no_weight() {
        let (mut times, mut seen) = by_day();
        let without = SpectrumSheet::of(&times, &seen);
        times.insert(7, times[7].plus_us(1));
        seen.insert(7, None);
        let with = SpectrumSheet::of(&times, &seen);
        for (a, b) in without.amplitudes.iter().zip(&with.amplitudes) {
            assert!((a - b).abs() < 1e-9);
        }
    }

    #[test]
    fn a_history_of_one_moment_has_no_spectrum() {
        let empty = SpectrumSheet::default();
        assert_eq!(SpectrumSheet::of(&[], &[]), empty);
        assert_eq!(SpectrumSheet::of(&[Time::from_s(1)], &[Some(true)]), empty);
        assert_eq!(
            SpectrumSheet::of(&[Time::from_s(1); 3], &[Some(true); 3]),
            empty
        );
    }

    #[test]
    fn a_picture_survives_json() {
        let picture = GrayImage::new(8, 8, (0..64).collect()).expect("pixels");
        let jpeg = Jpeg::encode(&picture).expect("encoded");
        let text = serde_json::to_string(&jpeg).expect("text");
        assert_eq!(serde_json::from_str::<Jpeg>(&text).expect("read"), jpeg);
        assert!(serde_json::from_str::<Jpeg>("\"not base64!\"").is_err());
    }
}

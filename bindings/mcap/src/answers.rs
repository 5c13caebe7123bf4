//! How do answers go into a bag of their own?
//!
//! An MCAP file with two channels of JSON, one message an image on each, at the time at which the
//! image was recorded: `/chronotope/localization` says where it was taken and why, and
//! `/chronotope/annotations` draws what was predicted over the image, in the messages that Foxglove
//! knows for that. Opened beside the robot's bag they share its timeline; the images are not
//! copied. [`foxglove_layout`] shows both.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::Keypoint;
use chronotope::localize::{Candidate, Decision, Localizer};
use chronotope::map::{NodeId, PlaceKey};
use chronotope::robot::Robot;
use chronotope::time::Time;
use fremen::file::{OutputFile, OutputKind};
use mcap::write::NoSeek;
use mcap::{Channel, Compression, Message, Schema, WriteOptions, Writer};
use serde::Serialize;

/// What wrote the file, in its header: so an earlier file of answers is known.
const LIBRARY: &str = "chronotope-bags";
/// The magic bytes, the record of the header, its length, no profile, the library.
const ANSWERS: OutputKind = OutputKind {
    noun: "a bag of answers",
    begins: b"\x89MCAP0\r\n\x01\x17\0\0\0\0\0\0\0\0\0\0\0\x0f\0\0\0chronotope-bags",
};
/// So many places of the ranking are written.
const MAX_RANKING: usize = 10;

const FOXGLOVE_LAYOUT: &str = include_str!("../foxglove/chronotope.json");
/// The topic of the camera in it.
const LAYOUT_CAMERA: &str = "\"/camera/image_raw\"";

/// A layout for Foxglove: the images of the topic `camera` with their annotations, the decision, the
/// posterior over time.
pub fn foxglove_layout(camera: &str) -> String {
    let camera = serde_json::Value::from(camera).to_string();
    FOXGLOVE_LAYOUT.replace(LAYOUT_CAMERA, &camera)
}

/// One answer, for people and programs; its JSON has the keys of `chronotope localize --json`.
#[derive(Clone, Debug, Serialize)]
pub struct Answer<'a> {
    /// When the image was taken, as Foxglove reads times.
    timestamp: Timestamp,
    image: &'a str,
    time: String,
    decision: &'static str,
    place: Option<&'a PlaceKey>,
    region: Vec<&'a PlaceKey>,
    best: Option<Share<'a>>,
    second: Option<Share<'a>>,
    first_posterior: f64,
    elsewhere: f64,
    tied: usize,
    ranking: Vec<Share<'a>>,
    reason: String,
    displacement_px: Option<[f64; 2]>,
    num_matches: u32,
    num_inliers: u32,
    num_features: usize,
    method: &'static str,
    map_generation: u64,
    duration_ms: f64,
    /// The place that the bag says it shows.
    truth: Option<&'a PlaceKey>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    predicted: Vec<Predicted>,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Timestamp {
    sec: i64,
    nsec: u32,
}

impl From<Time> for Timestamp {
    fn from(time: Time) -> Self {
        Self {
            sec: time.as_us().div_euclid(1_000_000),
            nsec: time.as_us().rem_euclid(1_000_000) as u32 * 1_000,
        }
    }
}

#[derive(Clone, Debug, Serialize)]
struct Share<'a> {
    place: &'a PlaceKey,
    score: f64,
    posterior: f64,
}

/// What became of a predicted feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// It was found where it was predicted.
    Inlier,
    /// It was matched elsewhere.
    Outlier,
    /// It was not found.
    Missing,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Predicted {
    x: f32,
    y: f32,
    p: Option<f64>,
    state: State,
}

impl<'a> Answer<'a> {
    /// What `robot` said of the image that it saw last.
    pub fn of(robot: &'a Robot, image: &'a str, time: Time, truth: Option<&'a PlaceKey>) -> Self {
        let (localizer, answer) = (robot.localizer(), robot.answer());
        let key = |id: NodeId| localizer.snapshot().node(id).key();
        let share = |candidate: &Candidate| Share {
            place: key(candidate.node),
            score: candidate.score,
            posterior: candidate.posterior,
        };
        let (decision, place) = match answer.decision {
            Decision::At(id) => ("at", Some(key(id))),
            Decision::Near(id) => ("near", Some(key(id))),
            Decision::Ambiguous => ("ambiguous", None),
            _ => ("unknown", None),
        };
        let is_near = matches!(answer.decision, Decision::Near(_));
        let first = answer.first();
        let vote = first
            .map(|first| first.displacement)
            .filter(|vote| vote.num_inliers > 0);
        let timing = robot.timing();
        Self {
            timestamp: time.into(),
            image,
            time: time.to_string(),
            decision,
            place,
            region: (answer.region.iter().filter(|_| is_near))
                .map(|&id| key(id))
                .collect(),
            best: first.map(share),
            second: answer.ranking.get(1).map(share),
            first_posterior: first.map_or(0.0, |first| first.posterior),
            elsewhere: answer.off_map,
            tied: answer.tied,
            ranking: answer.ranking.iter().take(MAX_RANKING).map(share).collect(),
            reason: answer.reason.to_string(),
            displacement_px: vote.map(|vote| [vote.median.dx_px, vote.median.dy_px]),
            num_matches: first.map_or(0, |first| first.num_matches),
            num_inliers: first.map_or(0, |first| first.num_inliers),
            num_features: robot.features().len(),
            method: localizer.cfg().method().name(),
            map_generation: localizer.snapshot().generation(),
            duration_ms: (timing.extract + timing.localize).as_secs_f64() * 1e3,
            truth,
            predicted: first.map_or_else(Vec::new, |first| predicted(localizer, first)),
        }
    }

    /// Without what was predicted, which is long.
    #[must_use]
    pub fn in_short(mut self) -> Self {
        self.predicted.clear();
        self
    }

    /// Where the features that were predicted of the first place lie in the image, px, and what
    /// became of each.
    pub fn predicted(&self) -> impl Iterator<Item = ([f64; 2], State)> + '_ {
        let [dx, dy] = self.displacement_px.unwrap_or_default();
        (self.predicted.iter())
            .map(move |it| ([f64::from(it.x) + dx, f64::from(it.y) + dy], it.state))
    }

    /// What was decided and how sure that is, in a few words: `at kitchen, 97 %`.
    pub fn headline(&self) -> String {
        let percent = (100.0 * self.first_posterior).floor();
        match (self.place, &self.best) {
            (Some(place), _) => format!("{} {place}, {percent} %", self.decision),
            (None, Some(best)) => format!("{}: first {}, {percent} %", self.decision, best.place),
            (None, None) => self.decision.to_owned(),
        }
    }

    /// On one line, for people.
    pub fn row(&self) -> String {
        let names: Vec<&str> = match (&self.place, self.decision) {
            (Some(place), "at") => vec![place.as_str()],
            (Some(_), _) => self.region.iter().map(|it| it.as_str()).collect(),
            (None, decision) => vec![decision],
        };
        format!("{}  {}  {}", self.image, names.join(" or "), self.reason)
    }
}

/// The features that were predicted of a place, and what became of each.
fn predicted(localizer: &Localizer, candidate: &Candidate) -> Vec<Predicted> {
    let node = localizer.snapshot().node(candidate.node);
    let appearance = (candidate.appearance)
        .and_then(|visit| node.visits().get(visit as usize))
        .and_then(|visit| visit.appearance.as_ref());
    let keypoints: Vec<Keypoint> = match appearance {
        Some(features) => {
            let largest = localizer.largest_size();
            features.view().prefix(largest).keypoints.to_vec()
        }
        None => (candidate.predicted.iter())
            .filter_map(|&id| node.features().keypoints().get(id as usize).copied())
            .collect(),
    };
    let mut states: BTreeMap<u32, State> = BTreeMap::new();
    for one in &candidate.matches {
        let state = if one.inlier {
            State::Inlier
        } else {
            State::Outlier
        };
        states.insert(one.rank, state);
    }
    (keypoints.iter().enumerate())
        .map(|(rank, keypoint)| Predicted {
            x: keypoint.x,
            y: keypoint.y,
            p: candidate.probabilities.get(rank).copied(),
            state: (states.get(&(rank as u32)).copied()).unwrap_or(State::Missing),
        })
        .collect()
}

/// `foxglove.ImageAnnotations`.
#[derive(Serialize)]
struct Annotations {
    circles: [(); 0],
    points: Vec<PointsAnnotation>,
    texts: [TextAnnotation; 1],
}

#[derive(Serialize)]
struct PointsAnnotation {
    timestamp: Timestamp,
    #[serde(rename = "type")]
    kind: u8,
    points: Vec<Point>,
    outline_color: Color,
    outline_colors: [Color; 0],
    fill_color: Color,
    thickness: f32,
}

#[derive(Clone, Copy, Serialize)]
struct Point {
    x: f32,
    y: f32,
}

#[derive(Clone, Copy, Serialize)]
struct Color {
    r: f32,
    g: f32,
    b: f32,
    a: f32,
}

const fn color(r: f32, g: f32, b: f32, a: f32) -> Color {
    Color { r, g, b, a }
}

const GREEN: Color = color(0.1, 0.8, 0.2, 1.0);
const ORANGE: Color = color(1.0, 0.6, 0.0, 1.0);
const RED: Color = color(0.9, 0.1, 0.1, 0.6);
const WHITE: Color = color(1.0, 1.0, 1.0, 1.0);
const BLACK: Color = color(0.0, 0.0, 0.0, 0.6);

#[derive(Serialize)]
struct TextAnnotation {
    timestamp: Timestamp,
    position: Point,
    text: String,
    font_size: f32,
    text_color: Color,
    background_color: Color,
}

impl Annotations {
    /// `before`: where a point of the image that was matched is in the recorded one.
    fn of(answer: &Answer<'_>, before: &dyn Fn([f64; 2]) -> [f64; 2]) -> Self {
        let (origin, beside) = (before([0.0, 0.0]), before([1.0, 0.0]));
        let per_px = (beside[0] - origin[0]).hypot(beside[1] - origin[1]);
        let timestamp = answer.timestamp;
        let of = |state: State, outline_color: Color| {
            let points = answer.predicted().filter(|it| it.1 == state);
            PointsAnnotation {
                timestamp,
                kind: 1,
                points: points
                    .map(|(point, _)| before(point))
                    .map(|[x, y]| Point {
                        x: x as f32,
                        y: y as f32,
                    })
                    .collect(),
                outline_color,
                outline_colors: [],
                fill_color: outline_color,
                thickness: 6.0 * per_px as f32,
            }
        };
        Self {
            circles: [],
            points: vec![
                of(State::Missing, RED),
                of(State::Outlier, ORANGE),
                of(State::Inlier, GREEN),
            ],
            texts: [TextAnnotation {
                timestamp,
                position: Point { x: 8.0, y: 24.0 },
                text: answer.headline(),
                font_size: 20.0,
                text_color: WHITE,
                background_color: BLACK,
            }],
        }
    }
}

/// A bag of answers that is being written. Dropped before it is finished, it leaves nothing behind.
pub struct AnswerFile {
    writer: Writer<NoSeek<OutputFile>>,
    localization: Arc<Channel<'static>>,
    annotations: Arc<Channel<'static>>,
    num_written: u32,
    path: std::path::PathBuf,
}

impl std::fmt::Debug for AnswerFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (f.debug_struct("AnswerFile"))
            .field("path", &self.path)
            .field("num_written", &self.num_written)
            .finish_non_exhaustive()
    }
}

impl AnswerFile {
    /// Begins a bag, in place of an earlier one of answers.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::AlreadyExists`] if anything else is there, [`ErrorKind::Config`] if it is one of
    /// `inputs`.
    pub fn create(path: &Path, inputs: &[&Path]) -> Result<Self> {
        let file = OutputFile::replace(path, ANSWERS, inputs)?;
        let options = WriteOptions::new()
            .library(LIBRARY)
            .profile("")
            .compression(Some(Compression::Zstd))
            .disable_seeking(true);
        let writer = (options.create(NoSeek::new(file))).map_err(|cause| failed(path, cause))?;
        let channel = |id: u16, topic: &str, name: &str, schema: &'static [u8]| {
            Arc::new(Channel {
                id,
                topic: topic.into(),
                schema: Some(Arc::new(Schema {
                    id,
                    name: name.into(),
                    encoding: "jsonschema".into(),
                    data: Cow::Borrowed(schema),
                })),
                message_encoding: "json".into(),
                metadata: BTreeMap::new(),
            })
        };
        Ok(Self {
            writer,
            localization: channel(
                1,
                "/chronotope/localization",
                "chronotope.Localization",
                include_bytes!("../schemas/localization.json"),
            ),
            annotations: channel(
                2,
                "/chronotope/annotations",
                "foxglove.ImageAnnotations",
                include_bytes!("../schemas/image_annotations.json"),
            ),
            num_written: 0,
            path: path.to_owned(),
        })
    }

    /// Adds an answer; `logged` is when its image was recorded, and `before` says where a point of
    /// the image that was matched is in the recorded one, px.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Io`] if it cannot be written.
    pub fn add(
        &mut self,
        answer: &Answer<'_>,
        logged: Time,
        before: impl Fn([f64; 2]) -> [f64; 2],
    ) -> Result<()> {
        let annotations = Annotations::of(answer, &before);
        let json = |it: serde_json::Result<Vec<u8>>| {
            it.map_err(|cause| Error::new(ErrorKind::Format, cause.to_string()))
        };
        let messages = [
            (&self.localization, json(serde_json::to_vec(answer))?),
            (&self.annotations, json(serde_json::to_vec(&annotations))?),
        ];
        let ns = |us: i64| u64::try_from(us).unwrap_or(0).saturating_mul(1_000);
        let publish_time = (answer.timestamp.sec.cast_unsigned())
            .wrapping_mul(1_000_000_000)
            .wrapping_add(u64::from(answer.timestamp.nsec));
        for (channel, data) in messages {
            let message = Message {
                channel: Arc::clone(channel),
                sequence: self.num_written,
                log_time: ns(logged.as_us()),
                publish_time,
                data: Cow::Owned(data),
            };
            (self.writer.write(&message)).map_err(|cause| failed(&self.path, cause))?;
        }
        self.num_written += 1;
        Ok(())
    }

    /// Everything is on the disk and has its name once this returns.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Io`] if it cannot be written.
    pub fn finish(mut self) -> Result<()> {
        (self.writer.finish()).map_err(|cause| failed(&self.path, cause))?;
        self.writer.into_inner().into_inner().finish()
    }
}

fn failed(path: &Path, cause: mcap::McapError) -> Error {
    match cause {
        mcap::McapError::Io(cause) => Error::io(path, cause),
        other => Error::new(ErrorKind::Io, other.to_string()).with_path(path),
    }
}

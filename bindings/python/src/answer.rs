//! What does an answer look like in Python?
//!
//! A `Localization` is frozen and keeps all evidence; arrays are made when they are looked at. Its
//! JSON is that of `chronotope localize --json`, key by key and bit by bit.

use std::sync::Arc;

use chronotope::dataset::ImageSource;
use chronotope::feature::{Features, GrayImage};
use chronotope::localize::{Candidate, Decision, Localization};
use chronotope::map::{NodeId, PlaceKey, Snapshot};
use chronotope::trace::Jpeg;
use chronotope::{Error, ErrorKind, Time};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde::Serialize;

use crate::failure::{Result, detached};
use crate::features::PyFeatures;
use crate::hints::{Ids, Json, Matches, MaybeMoment, Numbers, Points};
use crate::image::Pixels;
use crate::python::{column, json_line, loads, maybe_moment, table};

/// Where the pixels of a query can be had again, for pictures.
pub(crate) enum Shown {
    /// The caller's own object.
    Object {
        object: Py<PyAny>,
        is_bgr: bool,
    },
    File(Arc<dyn ImageSource>),
    Nothing,
}

/// What was queried.
pub(crate) struct Queried {
    pub(crate) name: String,
    pub(crate) time: Option<(Time, &'static str)>,
    pub(crate) truth: Option<PlaceKey>,
    pub(crate) features: Arc<Features>,
    pub(crate) image_size: Option<(u32, u32)>,
    pub(crate) shown: Shown,
}

/// One answer with the map it is about.
pub(crate) struct Told {
    pub(crate) snapshot: Arc<Snapshot>,
    pub(crate) method: &'static str,
    pub(crate) answer: Localization,
    pub(crate) queried: Queried,
}

/// Where an image was taken, how sure that is, and why.
///
/// Made by ``Localizer.localize`` and ``Robot.see``. ``decision`` is one of ``"at"`` (``place`` is
/// where the robot is), ``"near"`` (it is at one of the neighbours in ``region``), ``"ambiguous"``
/// (in the map, but several places fit) and ``"unknown"``. "Not here" is an answer and no error.
#[pyclass(frozen, module = "chronotope", name = "Localization")]
pub(crate) struct PyLocalization {
    pub(crate) told: Arc<Told>,
}

/// What speaks for one place of an answer.
#[pyclass(frozen, module = "chronotope", name = "Candidate")]
pub(crate) struct PyCandidate {
    told: Arc<Told>,
    at: usize,
}

/// On which displacement the matches of a place agree, and their spread, px.
fn displacement(candidate: &Candidate) -> (Option<[f64; 2]>, Option<[f64; 2]>) {
    let vote = Some(candidate.displacement).filter(|vote| vote.num_inliers > 0);
    (
        vote.map(|vote| [vote.median.dx_px, vote.median.dy_px]),
        vote.map(|vote| [vote.spread.dx_px, vote.spread.dy_px]),
    )
}

impl Told {
    fn key(&self, node: NodeId) -> &PlaceKey {
        self.snapshot.node(node).key()
    }

    fn decision(&self) -> (&'static str, Option<&PlaceKey>) {
        match self.answer.decision {
            Decision::At(node) => ("at", Some(self.key(node))),
            Decision::Near(node) => ("near", Some(self.key(node))),
            Decision::Ambiguous => ("ambiguous", None),
            _ => ("unknown", None),
        }
    }

    /// The features of a candidate that were matched, as the ranks of its matches count them.
    fn matched<'a>(&'a self, candidate: &'a Candidate) -> Vec<(u32, [f32; 2], f64)> {
        let node = self.snapshot.node(candidate.node);
        let at = |features: &Features, id: u32| {
            let keypoint = features.keypoints()[id as usize];
            [keypoint.x, keypoint.y]
        };
        if let Some(visit) = candidate.appearance {
            let appearance =
                (node.visits().get(visit as usize)).and_then(|it| it.appearance.clone());
            let Some(features) = appearance else {
                return Vec::new();
            };
            return (0..features.len() as u32)
                .map(|id| (id, at(&features, id), f64::NAN))
                .collect();
        }
        (candidate.predicted.iter().zip(&candidate.probabilities))
            .map(|(&id, &p)| (id, at(node.features(), id), p))
            .collect()
    }

    /// One match after another, as `chronotope._types.MATCH` names the fields.
    fn matches<'py>(&self, py: Python<'py>, candidate: &Candidate) -> Result<Matches<'py>> {
        let predicted = self.matched(candidate);
        let mut bytes = Vec::with_capacity(candidate.matches.len() * 40);
        for found in &candidate.matches {
            let (id, [map_x, map_y], p) = predicted.get(found.rank as usize).copied().unwrap_or((
                u32::MAX,
                [f32::NAN; 2],
                f64::NAN,
            ));
            let live = self.queried.features.keypoints()[found.live as usize];
            bytes.extend(id.to_le_bytes());
            bytes.extend(found.live.to_le_bytes());
            for value in [map_x, map_y, live.x, live.y] {
                bytes.extend(value.to_le_bytes());
            }
            bytes.extend(p.to_le_bytes());
            bytes.extend(found.distance_bits.to_le_bytes());
            bytes.push(u8::from(found.inlier));
        }
        let numpy = py.import("numpy")?;
        let dtype = py.import("chronotope._types")?.getattr("MATCH")?;
        let array = if bytes.is_empty() {
            numpy.call_method1("empty", (0, dtype))?
        } else {
            numpy.call_method1("frombuffer", (PyBytes::new(py, &bytes), dtype))?
        };
        Ok(Matches(array))
    }

    /// Positions in the live image of what was predicted and not found.
    fn missing(&self, candidate: &Candidate) -> Vec<f32> {
        let vote = candidate.displacement;
        let (dx, dy) = if vote.num_inliers > 0 {
            (vote.median.dx_px as f32, vote.median.dy_px as f32)
        } else {
            (0.0, 0.0)
        };
        let predicted = self.matched(candidate);
        let mut is_found = vec![false; predicted.len()];
        for found in candidate.matches.iter().filter(|found| found.inlier) {
            if let Some(found) = is_found.get_mut(found.rank as usize) {
                *found = true;
            }
        }
        (predicted.iter().zip(is_found))
            .filter(|(_, is_found)| !is_found)
            .flat_map(|((_, [x, y], _), _)| [x + dx, y + dy])
            .collect()
    }

    /// One line, as the command prints it.
    fn to_json(&self, top: usize) -> Result<String> {
        let share = |candidate: &Candidate| Share {
            place: self.key(candidate.node).as_str(),
            score: candidate.score,
            posterior: candidate.posterior,
        };
        let answer = &self.answer;
        let first = answer.first();
        let (displacement_px, displacement_spread_px) = first.map_or((None, None), displacement);
        let (decision, place) = self.decision();
        let is_near = matches!(answer.decision, Decision::Near(_));
        let keys = |nodes: &[NodeId]| nodes.iter().map(|&node| self.key(node).as_str()).collect();
        json_line(&Report {
            image: &self.queried.name,
            time: self.queried.time.map(|(time, _)| time.to_string()),
            time_source: self.queried.time.map(|(_, source)| source),
            decision,
            place: place.map(PlaceKey::as_str),
            region: is_near.then(|| keys(&answer.region)),
            best: first.map(share),
            second: answer.ranking.get(1).map(share),
            tied: answer.tied,
            tied_places: (answer.ranking.iter())
                .take(if answer.tied > 1 { answer.tied } else { 0 })
                .map(|candidate| self.key(candidate.node).as_str())
                .collect(),
            ranking: answer.ranking.iter().take(top).map(share).collect(),
            elsewhere: answer.off_map,
            reason: answer.reason.to_string(),
            displacement_px,
            displacement_spread_px,
            num_matches: first.map_or(0, |first| first.num_matches),
            num_inliers: first.map_or(0, |first| first.num_inliers),
            num_features: self.queried.features.len(),
            pairs_compared: answer.pairs_compared,
            method: self.method,
            truth: self.queried.truth.as_ref().map(PlaceKey::as_str),
        })
    }

    fn picture(&self, py: Python<'_>) -> Result<Option<GrayImage>> {
        match &self.queried.shown {
            Shown::Nothing => Ok(None),
            Shown::File(source) => Ok(Some(detached(py, || source.load())?)),
            Shown::Object { object, is_bgr } => {
                let pixels = Pixels::of(object.bind(py), *is_bgr)?;
                Ok(Some(pixels.view()?.to_image()))
            }
        }
    }
}

/// The keys of `chronotope localize --json`, in their order.
#[derive(Serialize)]
struct Report<'a> {
    image: &'a str,
    time: Option<String>,
    time_source: Option<&'static str>,
    decision: &'static str,
    place: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    region: Option<Vec<&'a str>>,
    best: Option<Share<'a>>,
    second: Option<Share<'a>>,
    tied: usize,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    tied_places: Vec<&'a str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ranking: Vec<Share<'a>>,
    elsewhere: f64,
    reason: String,
    displacement_px: Option<[f64; 2]>,
    displacement_spread_px: Option<[f64; 2]>,
    num_matches: u32,
    num_inliers: u32,
    num_features: usize,
    pairs_compared: u64,
    method: &'static str,
    truth: Option<&'a str>,
}

#[derive(Serialize)]
struct Share<'a> {
    place: &'a str,
    score: f64,
    posterior: f64,
}

#[pymethods]
impl PyLocalization {
    /// ``"at"``, ``"near"``, ``"ambiguous"`` or ``"unknown"``.
    #[getter]
    fn decision(&self) -> &'static str {
        self.told.decision().0
    }

    /// The place that was decided for; of neighbours the most probable; None if there is none.
    #[getter]
    fn place(&self) -> Option<&str> {
        self.told.decision().1.map(PlaceKey::as_str)
    }

    /// The places that hold the probability which the risk asks for, most probable first.
    #[getter]
    fn region(&self) -> Vec<&str> {
        let region = self.told.answer.region.iter();
        region.map(|&node| self.told.key(node).as_str()).collect()
    }

    /// The numbers behind the decision, as a sentence.
    #[getter]
    fn reason(&self) -> String {
        self.told.answer.reason.to_string()
    }

    /// The first place, whatever was decided; None in a map without places.
    #[getter]
    fn best(&self) -> Option<PyCandidate> {
        self.candidate(0)
    }

    /// Every place that was matched, best first.
    #[getter]
    fn ranking(&self) -> Vec<PyCandidate> {
        (0..self.told.answer.ranking.len())
            .filter_map(|at| self.candidate(at))
            .collect()
    }

    /// The names of the places in order of ``ranking``.
    #[getter]
    fn places(&self) -> Vec<&str> {
        let ranking = self.told.answer.ranking.iter();
        ranking.map(|it| self.told.key(it.node).as_str()).collect()
    }

    /// The posterior probability of each place in order of ``ranking``, float64 (n,). With
    /// ``off_map`` they sum to 1. Of methods that count matches it is a share of the score, and not
    /// calibrated.
    #[getter]
    fn posterior<'py>(&self, py: Python<'py>) -> Result<Numbers<'py>> {
        let posterior = self.told.answer.ranking.iter().map(|it| it.posterior);
        Ok(Numbers(column(py, posterior.collect())?))
    }

    /// The score of each place in order of ``ranking``, float64 (n,): log odds, or a count.
    #[getter]
    fn scores<'py>(&self, py: Python<'py>) -> Result<Numbers<'py>> {
        let scores = self.told.answer.ranking.iter().map(|it| it.score);
        Ok(Numbers(column(py, scores.collect())?))
    }

    /// The probability of being at none of the places.
    #[getter]
    fn off_map(&self) -> f64 {
        self.told.answer.off_map
    }

    /// How many places share the best score.
    #[getter]
    fn tied(&self) -> usize {
        self.told.answer.tied
    }

    /// By how much the image is moved against the first place: (dx, dy) in px, live minus map; None
    /// if no matches agree on that.
    #[getter]
    fn displacement_px(&self) -> Option<(f64, f64)> {
        self.best().and_then(|best| best.displacement_px())
    }

    /// The spread of the matches that agree, (x, y) in px.
    #[getter]
    fn displacement_spread_px(&self) -> Option<(f64, f64)> {
        let first = self.told.answer.first()?;
        displacement(first).1.map(|[x, y]| (x, y))
    }

    /// Matches of the first place.
    #[getter]
    fn num_matches(&self) -> u32 {
        self.told
            .answer
            .first()
            .map_or(0, |first| first.num_matches)
    }

    /// Matches of the first place that agree on one displacement.
    #[getter]
    fn num_inliers(&self) -> u32 {
        self.told
            .answer
            .first()
            .map_or(0, |first| first.num_inliers)
    }

    /// Hamming distances that were computed.
    #[getter]
    fn pairs_compared(&self) -> u64 {
        self.told.answer.pairs_compared
    }

    /// The method that answered.
    #[getter]
    fn method(&self) -> &'static str {
        self.told.method
    }

    /// When the image was taken, in UTC, where that is known.
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Result<MaybeMoment<'py>> {
        maybe_moment(py, self.told.queried.time.map(|(time, _)| time))
    }

    /// Who said so: ``"option"`` (the argument), ``"index"`` or ``"exif"``.
    #[getter]
    fn time_source(&self) -> Option<&'static str> {
        self.told.queried.time.map(|(_, source)| source)
    }

    /// What the image is called: its path, or the argument ``name``.
    #[getter]
    fn name(&self) -> &str {
        &self.told.queried.name
    }

    /// The place that an index says it shows.
    #[getter]
    fn truth(&self) -> Option<&str> {
        self.told.queried.truth.as_ref().map(PlaceKey::as_str)
    }

    /// The features of the image.
    #[getter]
    fn features(&self) -> PyFeatures {
        let queried = &self.told.queried;
        PyFeatures::of(Arc::clone(&queried.features), queried.image_size)
    }

    /// The matches of the first place: a structured array with ``feature`` (its id within the
    /// place), ``live`` (row of ``features``), ``map_x``, ``map_y``, ``live_x``, ``live_y`` in px,
    /// ``p`` (its predicted visibility; NaN for the experience methods), ``distance_bits`` and
    /// ``inlier``.
    #[getter]
    fn matches<'py>(&self, py: Python<'py>) -> Result<Matches<'py>> {
        match self.told.answer.first() {
            Some(first) => self.told.matches(py, first),
            None => self.told.matches(py, &Candidate::default()),
        }
    }

    /// Where the features that were predicted of the first place and not found would lie in the
    /// image, float32 (n, 2) in px.
    #[getter]
    fn missing_xy<'py>(&self, py: Python<'py>) -> Result<Points<'py>> {
        let missing = (self.told.answer.first()).map_or_else(Vec::new, |it| self.told.missing(it));
        Ok(Points(table(py, missing, 2)?))
    }

    /// Rows of ``features`` that nothing predicted, uint32 (n,).
    #[getter]
    fn unexpected<'py>(&self, py: Python<'py>) -> Result<Ids<'py>> {
        let mut is_matched = vec![false; self.told.queried.features.len()];
        if let Some(first) = self.told.answer.first() {
            for found in first.matches.iter().filter(|found| found.inlier) {
                is_matched[found.live as usize] = true;
            }
        }
        let unexpected = (is_matched.iter().enumerate()).filter(|(_, is_matched)| !**is_matched);
        Ok(Ids(column(
            py,
            unexpected.map(|(row, _)| row as u32).collect(),
        )?))
    }

    /// The answer as the line that ``chronotope localize --json --top N`` prints.
    #[pyo3(signature = (*, top=0))]
    fn to_json(&self, top: usize) -> Result<String> {
        self.told.to_json(top)
    }

    /// The answer as a dictionary with the keys of ``chronotope localize --json``.
    #[pyo3(signature = (*, top=0))]
    fn to_dict<'py>(&self, py: Python<'py>, top: usize) -> Result<Json<'py>> {
        loads(py, &self.told.to_json(top)?)
    }

    /// The image with what was found (green), missing (orange) and unexpected (grey), and the
    /// posterior as bars: what a notebook shows.
    fn _repr_html_(slf: &Bound<'_, Self>) -> Result<String> {
        let html = slf
            .py()
            .import("chronotope._html")?
            .getattr("localization")?;
        Ok(html.call1((slf,))?.extract()?)
    }

    /// The image as JPEG, if there is one.
    fn _jpeg<'py>(&self, py: Python<'py>) -> Result<Option<Bound<'py, PyBytes>>> {
        let Some(image) = self.told.picture(py)? else {
            return Ok(None);
        };
        let jpeg = detached(py, || Jpeg::encode(&image))?;
        Ok(Some(PyBytes::new(py, &jpeg.0)))
    }

    fn __repr__(&self) -> String {
        let (decision, place) = self.told.decision();
        let place = place.map_or_else(String::new, |place| format!(" '{place}'"));
        format!("<Localization {decision}{place}: {}>", self.reason())
    }
}

impl PyLocalization {
    pub(crate) fn of(told: Told) -> Self {
        Self {
            told: Arc::new(told),
        }
    }

    fn candidate(&self, at: usize) -> Option<PyCandidate> {
        (at < self.told.answer.ranking.len()).then(|| PyCandidate {
            told: Arc::clone(&self.told),
            at,
        })
    }
}

impl PyCandidate {
    fn candidate(&self) -> &Candidate {
        &self.told.answer.ranking[self.at]
    }
}

#[pymethods]
impl PyCandidate {
    /// The name of the place.
    #[getter]
    fn place(&self) -> &str {
        self.told.key(self.candidate().node).as_str()
    }

    /// What it is ranked by: log odds of this place against another one, or a count of matches.
    #[getter]
    fn score(&self) -> f64 {
        self.candidate().score
    }

    /// The probability of being here.
    #[getter]
    fn posterior(&self) -> f64 {
        self.candidate().posterior
    }

    /// Features of the place that were found.
    #[getter]
    fn num_matches(&self) -> u32 {
        self.candidate().num_matches
    }

    /// Those that agree on one displacement.
    #[getter]
    fn num_inliers(&self) -> u32 {
        self.candidate().num_inliers
    }

    /// The displacement of these, (dx, dy) in px, live minus map.
    #[getter]
    fn displacement_px(&self) -> Option<(f64, f64)> {
        displacement(self.candidate()).0.map(|[x, y]| (x, y))
    }

    /// Its matches, as those of ``Localization.matches``.
    #[getter]
    fn matches<'py>(&self, py: Python<'py>) -> Result<Matches<'py>> {
        self.told.matches(py, self.candidate())
    }

    /// Ids within the place of the features that were predicted, uint32 (n,); none for the
    /// experience methods.
    #[getter]
    fn predicted<'py>(&self, py: Python<'py>) -> Result<Ids<'py>> {
        Ok(Ids(column(py, self.candidate().predicted.clone())?))
    }

    /// Their p(t), float64 (n,).
    #[getter]
    fn probabilities<'py>(&self, py: Python<'py>) -> Result<Numbers<'py>> {
        Ok(Numbers(column(py, self.candidate().probabilities.clone())?))
    }

    fn __repr__(&self) -> String {
        let Candidate {
            score, posterior, ..
        } = self.candidate();
        format!(
            "<Candidate '{}': posterior {posterior:.3}, score {score:.1}, {} inliers>",
            self.place(),
            self.num_inliers()
        )
    }
}

/// The pictures of a file that its index cuts into several are no one image.
pub(crate) fn several_pictures(num: usize, name: &str) -> Error {
    Error::new(
        ErrorKind::Config,
        format!("its index cuts it into {num} pictures"),
    )
    .with_path(name)
    .with_help("call localize_file, which answers for each of them")
}

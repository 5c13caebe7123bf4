//! How does a robot in Python keep knowing where it is?

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use chronotope::learn::LearnConfig;
use chronotope::localize::{LocalizerConfig, MotionConfig, Tracker};
use chronotope::map::MapMeta;
use chronotope::robot::{Event, Frame, Robot, RobotConfig};
use chronotope::{Error, ErrorKind};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use serde_json::{Value, json};

use crate::answer::{PyLocalization, Queried, Shown, Told};
use crate::failure::{Result, detached, of_kind};
use crate::hints::{ConfigLike, Json, MaskLike, PathLike, PixelsLike, TimeLike};
use crate::image::{Pixels, mask_of};
use crate::localizer::PyLocalizer;
use crate::python::{json_line, loads, overlaid, path_of, time_of};
use crate::settings::{Wanted, preset_of, without_clock};

/// A map, a camera's features, and what is believed: localises image after image, and learns from
/// them if it shall.
///
/// ``learn=True`` learns each located image as a visit of its place, on a second thread; a dictionary
/// replaces keys of the table ``[learn]``. ``inline=True`` learns between images instead: slower, and
/// the same images give the same map. ``track=True`` takes the images as one way (a dictionary: the
/// table ``[motion]``). ``live=False`` says that the images were recorded, and may come in any order of
/// time. The other arguments are those of ``Localizer``. A ``with`` block commits at its end.
///
/// Errors: those of ``Localizer``; ``ConfigError`` if it shall learn but the map may not be written.
#[pyclass(frozen, module = "chronotope", name = "Robot")]
pub(crate) struct PyRobot {
    path: PathBuf,
    /// Nothing once it has finished.
    robot: Mutex<Option<Robot>>,
}

/// What a caller means by True, False or a dictionary.
fn wished<T: serde::Serialize + serde::de::DeserializeOwned>(
    wish: Option<&ConfigLike<'_>>,
    base: T,
    name: &str,
) -> Result<Option<T>> {
    let Some(wish) = wish else {
        return Ok(None);
    };
    if let Ok(is_wished) = wish.0.extract::<bool>() {
        return Ok(is_wished.then_some(base));
    }
    Ok(Some(overlaid(base, Some(wish), name)?))
}

impl PyRobot {
    /// Works with the robot, which waits for whoever else does.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Robot) -> chronotope::Result<T> + Send,
    ) -> Result<T> {
        let done = detached(py, || {
            let mut robot = self.robot.lock().unwrap_or_else(PoisonError::into_inner);
            robot.as_mut().map(work).transpose()
        })?;
        done.ok_or_else(|| {
            of_kind(
                py,
                "closed",
                "this robot has finished",
                "make another Robot",
            )
        })
    }
}

#[pymethods]
impl PyRobot {
    #[new]
    #[pyo3(signature = (map, *, method=None, score=None, n=None, risk=None, config=None, learn=None,
                        inline=false, track=None, mask=None, live=true, index_cache="auto",
                        commit_every_s=1.0))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn new(
        py: Python<'_>,
        map: PathLike<'_>,
        method: Option<&str>,
        score: Option<&str>,
        n: Option<usize>,
        risk: Option<f64>,
        config: Option<ConfigLike<'_>>,
        learn: Option<ConfigLike<'_>>,
        inline: bool,
        track: Option<ConfigLike<'_>>,
        mask: Option<MaskLike<'_>>,
        live: bool,
        index_cache: &str,
        commit_every_s: f64,
    ) -> Result<Self> {
        let path = path_of(&map)?;
        let meta = MapMeta::read(&path)?;
        let wanted = Wanted {
            method,
            score,
            n,
            risk,
            config,
        };
        let interval = Duration::try_from_secs_f64(commit_every_s).map_err(|cause| {
            Error::new(ErrorKind::Config, cause.to_string()).with_place("commit_every_s")
        })?;
        let localize: LocalizerConfig = wanted.over(&meta)?;
        let mut cfg = RobotConfig::default()
            .with_localize(localize)
            .with_index_cache(index_cache.parse()?)
            .with_commit_interval(interval);
        if let Some(mask) = mask {
            cfg = cfg.with_mask(mask_of(&mask.0)?);
        }
        if let Some(motion) = wished(track.as_ref(), MotionConfig::default(), "track")? {
            cfg = cfg.with_tracking(motion);
        }
        let base = LearnConfig::preset(preset_of(&meta));
        if let Some(learn) = wished(learn.as_ref(), base, "learn")? {
            cfg = if inline {
                cfg.with_learning_inline(learn)
            } else {
                cfg.with_learning(learn)
            };
        }
        if !live {
            cfg = cfg.with_recorded_images();
        }
        let mut robot = detached(py, || Robot::open(&path, cfg.clone()))?;
        let localizer = robot.localizer();
        if let Some(localize) =
            without_clock(&wanted, &localizer.cfg().clone(), localizer.snapshot())
        {
            drop(robot);
            robot = detached(py, || Robot::open(&path, cfg.with_localize(localize)))?;
        }
        Ok(Self {
            path,
            robot: Mutex::new(Some(robot)),
        })
    }

    /// Says where an image was taken, and learns it if that is wanted and it was located.
    ///
    /// ``image`` and ``time`` as for ``Localizer.localize``, but no file. ``now`` is what the robot's clock
    /// says where that is not the system's. What goes wrong with learning is an event, no exception.
    ///
    /// Errors: ``ShapeError`` for an image of another size than the map's, ``TimeError``.
    #[pyo3(signature = (image, time, *, mask=None, bgr=false, name="", now=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn see(
        &self,
        py: Python<'_>,
        image: PixelsLike<'_>,
        time: TimeLike<'_>,
        mask: Option<MaskLike<'_>>,
        bgr: bool,
        name: &str,
        now: Option<TimeLike<'_>>,
    ) -> Result<PyLocalization> {
        let pixels = Pixels::of(&image.0, bgr)?;
        let time = time_of(&time.0)?;
        let now = now.map(|now| time_of(&now.0)).transpose()?;
        let mask = mask.map(|mask| mask_of(&mask.0)).transpose()?;
        let view = pixels.view()?;
        let (snapshot, method, answer, features) = self.with(py, |robot| {
            let mut frame = Frame::new(view).at(time).with_source(name);
            if let Some(mask) = &mask {
                frame = frame.with_mask(mask);
            }
            if let Some(now) = now {
                frame = frame.with_now(now);
            }
            let answer = robot.see_frame(&frame)?.clone();
            let localizer = robot.localizer();
            Ok((
                Arc::clone(localizer.snapshot()),
                localizer.cfg().method().name(),
                answer,
                Arc::new(robot.features().clone()),
            ))
        })?;
        Ok(PyLocalization::of(Told {
            snapshot,
            method,
            answer,
            queried: Queried {
                name: name.to_owned(),
                time: Some((time, "option")),
                truth: None,
                features,
                image_size: Some(view.size()),
                shown: Shown::Object {
                    object: image.0.unbind(),
                    is_bgr: bgr,
                },
            },
        }))
    }

    /// The place of the last image, if that was decided.
    #[getter]
    fn place(&self, py: Python<'_>) -> Result<Option<String>> {
        self.with(py, |robot| Ok(robot.place().map(ToString::to_string)))
    }

    /// What happened since this was called last, the oldest first: dictionaries with ``event`` one of
    /// ``"learnt"``, ``"held"``, ``"same-visit"``, ``"not-learnt"``, ``"missed"``, ``"not-committed"`` and
    /// ``"committed"``. At most 256 are kept.
    fn events<'py>(&self, py: Python<'py>) -> Result<Vec<Json<'py>>> {
        let events = self.with(py, |robot| Ok(robot.events().map(|it| told(&it)).collect()))?;
        let events: Vec<Value> = events;
        events
            .iter()
            .map(|event| loads(py, &json_line(event)?))
            .collect()
    }

    /// What was done so far: ``num_images``, ``num_located``, ``num_learnt``, ``num_same_visit``,
    /// ``num_held``, ``num_not_learnt``, ``num_missed``.
    #[getter]
    fn totals<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let totals = self.with(py, |robot| Ok(robot.totals()))?;
        loads(
            py,
            &json_line(&json!({
                "num_images": totals.num_images,
                "num_located": totals.num_located,
                "num_learnt": totals.num_learnt,
                "num_same_visit": totals.num_same_visit,
                "num_held": totals.num_quarantined,
                "num_not_learnt": totals.num_not_learnt,
                "num_missed": totals.num_missed,
            }))?,
        )
    }

    /// How long the last image took, seconds: to extract its features, and to localise them.
    #[getter]
    fn timing_s(&self, py: Python<'_>) -> Result<(f64, f64)> {
        let timing = self.with(py, |robot| Ok(robot.timing()))?;
        Ok((timing.extract.as_secs_f64(), timing.localize.as_secs_f64()))
    }

    /// The run that its visits belong to: ``Map.forget`` takes them back.
    #[getter]
    fn session(&self, py: Python<'_>) -> Result<String> {
        self.with(py, |robot| Ok(robot.session().to_string()))
    }

    /// The map's file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// Waits until everything that was located is learnt, and commits it.
    fn commit(&self, py: Python<'_>) -> Result<()> {
        self.with(py, Robot::commit)
    }

    /// Commits what was learnt and lets go of the file.
    fn close(&self, py: Python<'_>) -> Result<()> {
        detached(py, || {
            let robot = self
                .robot
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .take();
            robot.map_or(Ok(()), |robot| robot.finish().map(drop))
        })
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_exception: "object"))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> Result<()> {
        self.close(py)
    }

    fn __repr__(&self) -> String {
        format!("<Robot in {}>", self.path.display())
    }
}

fn told(event: &Event) -> Value {
    match event {
        Event::Learnt {
            place,
            source,
            learnt,
            took,
        } => json!({
            "event": match (learnt.is_same_visit, &learnt.doubt) {
                (true, _) => "same-visit",
                (false, Some(_)) => "held",
                (false, None) => "learnt",
            },
            "place": place,
            "name": source,
            "num_seen": learnt.num_seen,
            "num_born": learnt.num_born,
            "experience": learnt.experience,
            "doubt": learnt.doubt.as_ref().map(ToString::to_string),
            "took_s": took.as_secs_f64(),
        }),
        Event::NotLearnt { source, error } => {
            json!({"event": "not-learnt", "name": source, "error": error.to_string()})
        }
        Event::Missed { source } => json!({"event": "missed", "name": source}),
        Event::NotCommitted { error } => {
            json!({"event": "not-committed", "error": error.to_string()})
        }
        Event::Committed { generation, took } => json!({
            "event": "committed",
            "generation": generation,
            "took_s": took.as_secs_f64(),
        }),
        _ => json!({"event": "other"}),
    }
}

/// Follows a robot from answer to answer along the map's edges: a Bayes filter over the places.
///
/// ``config`` replaces keys of the table ``[motion]``. For answers of one ``Localizer`` with the score
/// ``"likelihood"``, one way at a time.
///
/// Errors: ``ConfigError`` for another score or numbers that are no probabilities.
#[pyclass(frozen, module = "chronotope", name = "Tracker")]
pub(crate) struct PyTracker {
    cfg: LocalizerConfig,
    places: Vec<String>,
    tracker: Mutex<Tracker>,
}

#[pymethods]
impl PyTracker {
    #[new]
    #[pyo3(signature = (localizer, *, config=None))]
    fn new(localizer: &PyLocalizer, config: Option<ConfigLike<'_>>) -> Result<Self> {
        let motion = overlaid(MotionConfig::default(), config.as_ref(), "config")?;
        let localizer = &localizer.localizer;
        let nodes = localizer.snapshot().nodes().iter();
        Ok(Self {
            cfg: localizer.cfg().clone(),
            places: nodes.map(|node| node.key().to_string()).collect(),
            tracker: Mutex::new(Tracker::new(localizer, motion)?),
        })
    }

    /// Takes the next image's answer into account, and gives the answer for the whole way.
    ///
    /// Errors: ``ConfigError`` for an answer by another score, ``ShapeError`` for one of another map.
    fn update(&self, answer: &PyLocalization) -> Result<PyLocalization> {
        let told = &answer.told;
        let mut updated = told.answer.clone();
        let mut tracker = self.tracker.lock().unwrap_or_else(PoisonError::into_inner);
        tracker.update(&self.cfg, &mut updated)?;
        let queried = &told.queried;
        let shown = match &queried.shown {
            Shown::Nothing => Shown::Nothing,
            Shown::File(source) => Shown::File(Arc::clone(source)),
            Shown::Object { object, is_bgr } => Python::attach(|py| Shown::Object {
                object: object.clone_ref(py),
                is_bgr: *is_bgr,
            }),
        };
        Ok(PyLocalization::of(Told {
            snapshot: Arc::clone(&told.snapshot),
            method: told.method,
            answer: updated,
            queried: Queried {
                name: queried.name.clone(),
                time: queried.time,
                truth: queried.truth.clone(),
                features: Arc::clone(&queried.features),
                image_size: queried.image_size,
                shown,
            },
        }))
    }

    /// What is believed of each place, by name; empty before the first image.
    #[getter]
    fn belief<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let tracker = self.tracker.lock().unwrap_or_else(PoisonError::into_inner);
        let belief: serde_json::Map<String, Value> = (self.places.iter().cloned())
            .zip(tracker.belief().iter().map(|&p| json!(p)))
            .collect();
        loads(py, &json_line(&belief)?)
    }

    /// What is believed of being at none of them.
    #[getter]
    fn off_map(&self) -> f64 {
        self.tracker
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .off_map()
    }

    /// Forgets where the robot was.
    fn reset(&self) {
        self.tracker
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .reset();
    }
}

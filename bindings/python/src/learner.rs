//! How are labelled images learnt from Python, one by one?

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use chronotope::dataset::{PictureFinder, ReadOptions};
use chronotope::feature::{Extractor, ExtractorConfig, Features, GrayImage};
use chronotope::learn::{Circumstances, LearnConfig, Observation};
use chronotope::map::{Map, PlaceKey, SessionId};
use chronotope::robot::OnlineLearner;
use chronotope::{Error, ErrorKind, Time};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use serde_json::json;

use crate::failure::{Result, detached, of_kind};
use crate::features::PyFeatures;
use crate::hints::{ConfigLike, ImageLike, Json, MapLike, MaskLike, TimeLike};
use crate::image::{Pixels, both, mask_of};
use crate::map::PyMap;
use crate::python::{json_line, loads, overlaid, time_of};
use crate::settings::preset_of;

/// Learns images of known places into a map, visit by visit.
///
/// ``map`` is a ``Map`` or a path. Nothing is in the file before ``commit``, which a ``with`` block calls at
/// its end; ``commit_every_s`` commits by itself at most so often (None: never). ``session`` names the
/// run that the visits belong to (``Map.forget``). ``config`` replaces keys of the table ``[learn]``.
///
/// Errors: ``IoError`` if the file may not be written.
#[pyclass(frozen, module = "chronotope", name = "Learner")]
pub(crate) struct PyLearner {
    extractor: Box<dyn Extractor>,
    session: SessionId,
    commits: bool,
    /// Nothing once it was closed.
    learner: Mutex<Option<OnlineLearner>>,
}

impl PyLearner {
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut OnlineLearner) -> chronotope::Result<T> + Send,
    ) -> Result<T> {
        let done = detached(py, || {
            let mut learner = self.learner.lock().unwrap_or_else(PoisonError::into_inner);
            learner.as_mut().map(work).transpose()
        })?;
        done.ok_or_else(|| {
            of_kind(
                py,
                "closed",
                "this learner was closed",
                "make another Learner",
            )
        })
    }
}

#[pymethods]
impl PyLearner {
    #[new]
    #[pyo3(signature = (map, *, session="python", config=None, commit_every_s=None))]
    fn new(
        py: Python<'_>,
        map: MapLike<'_>,
        session: &str,
        config: Option<ConfigLike<'_>>,
        commit_every_s: Option<f64>,
    ) -> Result<Self> {
        let path = match map.0.cast::<PyMap>() {
            Ok(map) => map.get().open()?.path().to_owned(),
            Err(_) => map.0.extract()?,
        };
        let interval = commit_every_s.map(Duration::try_from_secs_f64).transpose();
        let interval = interval.map_err(|cause| {
            Error::new(ErrorKind::Config, cause.to_string()).with_place("commit_every_s")
        })?;
        let map = detached(py, || Map::open(&path))?;
        if map.is_read_only() {
            return Err(Error::new(ErrorKind::Io, "this map may not be written")
                .with_path(&path)
                .with_help("change the rights or copy it")
                .into());
        }
        let meta = map.snapshot().meta().clone();
        let cfg = overlaid(
            LearnConfig::preset(preset_of(&meta)),
            config.as_ref(),
            "config",
        )?;
        let extractor = ExtractorConfig::from_id(&meta.extractor)
            .and_then(|extractor| extractor.build())
            .map_err(|error| error.with_path(&path).with_place("extractor"))?;
        let learner = detached(py, || {
            OnlineLearner::new(map, cfg, interval.unwrap_or(Duration::from_secs(1)))
        })?;
        Ok(Self {
            extractor,
            session: SessionId::derive(session),
            commits: interval.is_some(),
            learner: Mutex::new(Some(learner)),
        })
    }

    /// Learns one image of ``place``, taken at ``time``; gives a dictionary with ``num_seen``,
    /// ``num_born``, ``experience``, ``is_same_visit`` and ``doubt``, which says why it is held instead.
    ///
    /// ``image`` is an array, a PIL image, ``Features`` with their ``image_size``, or the path of a file, which
    /// is cut, turned, scaled and masked as an index.csv above it says. ``name`` is kept for people (of a path:
    /// its own).
    ///
    /// Errors: ``AlreadyExistsError`` if the very same visit was learnt before, ``ShapeError`` for images of
    /// another size than the map's, ``TimeError``, ``FormatError`` for a file that is no image.
    #[pyo3(signature = (place, image, time, *, mask=None, bgr=false, name=""))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn observe<'py>(
        &self,
        py: Python<'py>,
        place: &str,
        image: ImageLike<'py>,
        time: TimeLike<'py>,
        mask: Option<MaskLike<'py>>,
        bgr: bool,
        name: &str,
    ) -> Result<Json<'py>> {
        let place = PlaceKey::written(place)?;
        let time = time_of(&time.0)?;
        let mut mask = mask.map(|mask| mask_of(&mask.0)).transpose()?;
        let file = match image.0.extract::<PathBuf>() {
            Ok(path) => Some(detached(py, || load(&path))?),
            Err(_) => None,
        };
        let name = match &file {
            Some(file) if name.is_empty() => &file.name,
            _ => name,
        };
        let nothing = Features::new();
        let mut observation =
            Observation::new(place, self.session, time, &nothing, (0, 0)).with_source(name);
        let mut circumstances = Circumstances {
            now: Some(Time::now()),
            is_live: false,
            is_labelled: true,
            gray_range: None,
        };
        let learnt = if let Ok(features) = image.0.cast::<PyFeatures>() {
            let features = features.get();
            observation.image_size = features.image_size.ok_or_else(|| {
                Error::new(
                    ErrorKind::Shape,
                    "of which size was the image of these features?",
                )
                .with_help("give Features(..., image_size=(width, height))")
            })?;
            observation.features = &features.features;
            observation.mask = mask.as_ref();
            self.with(py, |learner| learner.observe(&observation, &circumstances))?
        } else {
            let pixels = match file {
                Some(file) => {
                    mask = both(file.mask, mask.as_ref())?;
                    Pixels::Owned(file.image)
                }
                None => Pixels::of(&image.0, bgr)?,
            };
            let view = pixels.view()?;
            self.with(py, |learner| {
                let mut features = Features::new();
                self.extractor
                    .extract_into(view, mask.as_ref(), &mut features)?;
                circumstances.gray_range = view.gray_range(mask.as_ref());
                let mut observation = observation;
                observation.features = &features;
                observation.mask = mask.as_ref();
                observation.image_size = view.size();
                learner.observe(&observation, &circumstances)
            })?
        };
        if self.commits {
            self.with(py, |learner| {
                if learner.is_commit_due() {
                    learner.commit()?;
                }
                Ok(())
            })?;
        }
        loads(
            py,
            &json_line(&json!({
                "num_seen": learnt.num_seen,
                "num_born": learnt.num_born,
                "experience": learnt.experience,
                "is_same_visit": learnt.is_same_visit,
                "doubt": learnt.doubt.as_ref().map(ToString::to_string),
            }))?,
        )
    }

    /// Writes what was learnt as a generation of the file, and gives its number; on top of what others
    /// have committed meanwhile.
    fn commit(&self, py: Python<'_>) -> Result<u64> {
        self.with(py, |learner| Ok(learner.commit()?.snapshot.generation()))
    }

    /// Commits, and lets go of the file.
    fn close(&self, py: Python<'_>) -> Result<()> {
        detached(py, || {
            let learner = self
                .learner
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .take();
            learner.map_or(Ok(()), |mut learner| learner.commit().map(drop))
        })
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_exception: "object"))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> Result<()> {
        self.close(py)
    }
}

/// A picture of a file, with what its index hides.
struct Loaded {
    name: String,
    image: GrayImage,
    mask: Option<GrayImage>,
}

/// Reads the one picture of a file.
fn load(path: &Path) -> chronotope::Result<Loaded> {
    let found = PictureFinder::new(ReadOptions::default())
        .find(path)
        .map_err(|error| error.with_path(path))?;
    let [picture] = found.as_slice() else {
        let message = format!(
            "this is {} pictures, and one is learnt at a time",
            found.len()
        );
        return Err(Error::new(ErrorKind::Config, message)
            .with_path(path)
            .with_help("give the array of one of them, or learn the file with Map.update"));
    };
    let (image, mask) = (picture.source.load_masked()).map_err(|error| error.with_path(path))?;
    Ok(Loaded {
        name: picture.name.clone(),
        image,
        mask,
    })
}

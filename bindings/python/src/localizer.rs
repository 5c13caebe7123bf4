//! How is a map asked where an image was taken, from one thread or many?

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use chronotope::dataset::{FoundPicture, ImageSource, PictureFinder, ReadOptions, scale_between};
use chronotope::feature::{
    Extractor, ExtractorConfig, Features, GrayImage, GrayView, LoadOptions, load_gray,
};
use chronotope::localize::{IndexCache, Localization, Localizer, Query, Scratch};
use chronotope::map::{MapMeta, NodeId, PlaceKey};
use chronotope::time::Zone;
use chronotope::{Error, ErrorKind, Time};
use pyo3::prelude::*;
use pyo3::types::PyList;
use rayon::prelude::*;

use crate::answer::{PyLocalization, Queried, Shown, Told, several_pictures};
use crate::failure::{Failure, Result, detached, detached_with, interruptible};
use crate::features::PyFeatures;
use crate::hints::{
    Answers, ConfigLike, ImageLike, ImagesLike, Json, MapLike, MaskLike, PathLike, PixelsLike,
    ProgressLike, TimeLike, TimesLike,
};
use crate::image::{Pixels, both, mask_of};
use crate::map::{PyMap, place_in};
use crate::progress::Progress;
use crate::python::{json_line, loads, time_if_given, time_of};
use crate::settings::{Wanted, pool_of, without_clock};

/// Images that each thread answers before somebody looks whether Ctrl-C was pressed.
const IMAGES_PER_THREAD: usize = 4;

/// Says where images were taken, by one state of a map.
///
/// ``map`` is a ``Map`` or the path of one. ``method`` is ``"fremen"`` (the default: the features that
/// should be visible at the image's time), ``"static"``, ``"fused"``, ``"experience"``,
/// ``"experience-all"`` or ``"freex"``; ``score`` is ``"likelihood"``, ``"inliers"`` or ``"count"``;
/// ``n`` features of each place are matched; an answer names a wrong place with a probability of at
/// most ``risk``. ``config`` replaces single keys of the table ``[localize]``
/// (``chronotope localize --print-config``), and the attribute ``config`` shows all.
///
/// Fitting takes a tenth of a second to a few seconds; of a path it is kept in a file beside the map
/// where it took more than one (``index_cache``: ``"auto"``, ``"always"``, ``"never"``). It reads the
/// map as it was then: make another one after ``Map.refresh``. Threads may share it, and work at the
/// same time.
///
/// Of paths, ``zone`` ("Europe/Prague") is that of EXIF times without an offset, and ``manifest`` the
/// name of a supported dataset, a manifest or a folder, whose index and rule for file names count
/// before an index.csv above the file.
///
/// Errors: those of ``Map.open``; ``ConfigError`` for values out of range and for an extractor that this
/// version does not know.
#[pyclass(frozen, module = "chronotope", name = "Localizer")]
pub(crate) struct PyLocalizer {
    pub(crate) localizer: Arc<Localizer>,
    extractor: Box<dyn Extractor>,
    finder: PictureFinder,
    /// One for each thread that is at work.
    scratches: Mutex<Vec<Scratch>>,
}

/// What helps where nobody says when a picture was taken.
const TIME_HELP: &str = "give time=..., zone=... for an EXIF time without an offset, or use \
                         method=\"static\"";

/// What a caller gave as an image.
pub(crate) enum Given<'py> {
    Pixels {
        pixels: Pixels<'py>,
        object: Bound<'py, PyAny>,
    },
    Features(Arc<Features>, Option<(u32, u32)>),
    File(FoundPicture),
}

/// The same without the interpreter's lock.
enum Task<'a> {
    Pixels(GrayView<'a>),
    Features(&'a Arc<Features>, Option<(u32, u32)>),
    File(&'a dyn ImageSource),
}

/// One image with what is known of it.
struct Job<'py> {
    given: Given<'py>,
    time: Option<(Time, &'static str)>,
    name: String,
    truth: Option<PlaceKey>,
}

/// What is known beside the image.
#[derive(Clone, Copy, Default)]
struct Known<'a> {
    time: Option<Time>,
    mask: Option<&'a GrayImage>,
    prior: &'a [NodeId],
}

/// What came of one image.
struct Done {
    answer: Localization,
    features: Arc<Features>,
    image_size: Option<(u32, u32)>,
}

impl PyLocalizer {
    fn of(localizer: Localizer, path: Option<PathBuf>, finder: PictureFinder) -> Result<Self> {
        let extractor = ExtractorConfig::from_id(&localizer.snapshot().meta().extractor)
            .and_then(|extractor| extractor.build())
            .map_err(|error| match path {
                Some(path) => error.with_path(path).with_place("extractor"),
                None => error.with_place("extractor"),
            })?;
        Ok(Self {
            localizer: Arc::new(localizer),
            extractor,
            finder,
            scratches: Mutex::default(),
        })
    }

    fn needs_time(&self) -> bool {
        self.localizer.cfg().method().needs_time()
    }

    /// What a caller means by an image: the pictures of a file, or one of pixels or features.
    fn jobs<'py>(
        &self,
        image: &Bound<'py, PyAny>,
        time: Option<Time>,
        name: &str,
        is_bgr: bool,
    ) -> Result<Vec<Job<'py>>> {
        if let Ok(path) = image.extract::<PathBuf>() {
            let found = (self.finder.find(&path)).map_err(|error| error.with_path(&path))?;
            let jobs = found.into_iter().map(|found| {
                let taken = (self.finder)
                    .time_of(&found, time, self.needs_time())
                    .map_err(|error| error.with_path(&path))?;
                for warning in taken.warnings {
                    tracing::warn!("{warning}");
                }
                Ok(Job {
                    time: taken.time.map(|(time, source)| (time, source.word())),
                    name: found.name.clone(),
                    truth: found.truth.clone(),
                    given: Given::File(found),
                })
            });
            return jobs.collect();
        }
        let given = match image.cast::<PyFeatures>() {
            Ok(features) => {
                let features = features.get();
                Given::Features(Arc::clone(&features.features), features.image_size)
            }
            Err(_) => Given::Pixels {
                pixels: Pixels::of(image, is_bgr)?,
                object: image.clone(),
            },
        };
        if time.is_none() && self.needs_time() {
            return Err(Error::new(
                ErrorKind::Time,
                format!(
                    "the method `{}` needs to know when the image was taken",
                    self.method()
                ),
            )
            .with_help("give time=..., or use method=\"static\"")
            .into());
        }
        Ok(vec![Job {
            given,
            time: time.map(|time| (time, "option")),
            name: name.to_owned(),
            truth: None,
        }])
    }

    fn job<'py>(
        &self,
        image: &Bound<'py, PyAny>,
        time: Option<Time>,
        name: &str,
        is_bgr: bool,
    ) -> Result<Job<'py>> {
        let mut jobs = self.jobs(image, time, name, is_bgr)?;
        let num = jobs.len();
        match (num, jobs.pop()) {
            (1, Some(job)) => Ok(job),
            _ => Err(several_pictures(num, name).into()),
        }
    }

    fn answer(&self, task: &Task<'_>, known: Known<'_>) -> Result<Done, Error> {
        let Known { time, mask, prior } = known;
        let size = self.localizer.snapshot().meta().image_size;
        let mut scratch = self.scratch();
        let (features, image_size) = match *task {
            Task::Features(features, image_size) => (Arc::clone(features), image_size),
            Task::Pixels(view) => match adjusted(view, mask, size)? {
                Some((image, mask)) => self.extract(image.view(), mask.as_ref())?,
                None => self.extract(view, mask)?,
            },
            Task::File(source) => {
                let (image, own) = source.load_masked()?;
                let mask = both(own, mask)?;
                match adjusted(image.view(), mask.as_ref(), size)? {
                    Some((image, mask)) => self.extract(image.view(), mask.as_ref())?,
                    None => self.extract(image.view(), mask.as_ref())?,
                }
            }
        };
        let query = Query::new(&features)
            .at(time)
            .with_image_size(image_size)
            .with_prior(prior);
        let mut answer = Localization::default();
        self.localizer
            .localize_into(&mut scratch, &query, &mut answer)?;
        self.scratches
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(scratch);
        Ok(Done {
            answer,
            features,
            image_size,
        })
    }

    fn scratch(&self) -> Scratch {
        let kept = self
            .scratches
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop();
        kept.unwrap_or_else(|| self.localizer.scratch())
    }

    fn extract(&self, view: GrayView<'_>, mask: Option<&GrayImage>) -> Result<Extracted, Error> {
        let mut features = Features::new();
        self.extractor.extract_into(view, mask, &mut features)?;
        Ok((Arc::new(features), Some(view.size())))
    }

    fn told(&self, job: Job<'_>, done: Done, is_bgr: bool) -> PyLocalization {
        let shown = match job.given {
            Given::Pixels { object, .. } => Shown::Object {
                object: object.unbind(),
                is_bgr,
            },
            Given::File(listed) => Shown::File(listed.source),
            Given::Features(..) => Shown::Nothing,
        };
        PyLocalization::of(Told {
            snapshot: Arc::clone(self.localizer.snapshot()),
            method: self.localizer.cfg().method().name(),
            answer: done.answer,
            queried: Queried {
                name: job.name,
                time: job.time,
                truth: job.truth,
                features: done.features,
                image_size: done.image_size,
                shown,
            },
        })
    }
}

/// The features of an image, with its size where that is known.
type Extracted = (Arc<Features>, Option<(u32, u32)>);

impl Given<'_> {
    fn task(&self) -> Result<Task<'_>> {
        Ok(match self {
            Self::Pixels { pixels, .. } => Task::Pixels(pixels.view()?),
            Self::Features(features, size) => Task::Features(features, *size),
            Self::File(listed) => Task::File(&*listed.source),
        })
    }

    /// The file that an error is about.
    fn named(&self, error: Error) -> Error {
        match self {
            Self::File(listed) => match listed.source.path() {
                Some(path) => error.with_path(path),
                None => error,
            },
            _ => error,
        }
    }
}

/// An image of another size than the map's images but of their shape is scaled to it, as the command
/// does; `None` where nothing is to be done.
fn adjusted(
    view: GrayView<'_>,
    mask: Option<&GrayImage>,
    size: Option<(u32, u32)>,
) -> chronotope::Result<Option<(GrayImage, Option<GrayImage>)>> {
    let (from, Some(to)) = (view.size(), size) else {
        return Ok(None);
    };
    match scale_between(from, to) {
        Some(scale) if from != to => {
            let options = LoadOptions::default().with_scale(scale);
            let mask = mask
                .cloned()
                .map(|mask| options.apply_to_mask(mask))
                .transpose()?;
            Ok(Some((options.apply(view.to_image())?, mask)))
        }
        _ => Ok(None),
    }
}

/// How files are read: times without an offset in `zone`, and those of the dataset `manifest` as it
/// says.
fn finder(zone: Option<&str>, manifest: Option<&str>) -> Result<PictureFinder> {
    let options = ReadOptions {
        zone: zone.map(Zone::new).transpose()?,
        ..ReadOptions::default()
    };
    let finder = PictureFinder::new(options).with_time_help(TIME_HELP);
    Ok(match manifest {
        Some(manifest) => finder.with_manifest(manifest)?,
        None => finder,
    })
}

#[pymethods]
impl PyLocalizer {
    #[new]
    #[pyo3(signature = (map, *, method=None, score=None, n=None, risk=None, config=None,
                        index_cache="auto", zone=None, manifest=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn new(
        py: Python<'_>,
        map: MapLike<'_>,
        method: Option<&str>,
        score: Option<&str>,
        n: Option<usize>,
        risk: Option<f64>,
        config: Option<ConfigLike<'_>>,
        index_cache: &str,
        zone: Option<&str>,
        manifest: Option<&str>,
    ) -> Result<Self> {
        let finder = finder(zone, manifest)?;
        let wanted = Wanted {
            method,
            score,
            n,
            risk,
            config,
        };
        let cache: IndexCache = index_cache.parse()?;
        if let Ok(map) = map.0.cast::<PyMap>() {
            let map = map.get().open()?;
            let path = map.path().to_owned();
            let snapshot = map.snapshot();
            let cfg = wanted.over(snapshot.meta())?;
            let cfg = without_clock(&wanted, &cfg, &snapshot).unwrap_or(cfg);
            let localizer = interruptible(py, move || Localizer::new(snapshot, cfg))
                .map_err(|failure| with_path(failure, &path))?;
            return Self::of(localizer, Some(path), finder);
        }
        let path: PathBuf = map.0.extract()?;
        let cfg = wanted.over(&MapMeta::read(&path)?)?;
        let open = |cfg| {
            let path = path.clone();
            interruptible(py, move || Localizer::open_with(&path, cfg, cache))
        };
        let mut localizer = open(cfg)?;
        let snapshot = Arc::clone(localizer.snapshot());
        if let Some(cfg) = without_clock(&wanted, &localizer.cfg().clone(), &snapshot) {
            localizer = open(cfg)?;
        }
        Self::of(localizer, Some(path), finder)
    }

    /// Says where an image was taken.
    ///
    /// ``image`` is uint8 (height, width), or (height, width, 3) in RGB (``bgr=True``: in BGR, as
    /// OpenCV has it), a PIL image, ``Features``, or a path. A contiguous grey array is read where it
    /// lies. An image of another size than the map's but of its shape is scaled to it.
    ///
    /// ``time`` is when it was taken: an aware datetime, a datetime64 (of UTC), text with an offset
    /// or seconds since 1970. Of a path it may be left out where an index.csv above the file or its EXIF
    /// data with an offset say it.
    ///
    /// ``mask`` (height, width) hides what is 0 or False.
    ///
    /// ``prior`` names the places where it may have been taken, as far as is known: these are matched,
    /// and in a large map all others only if the image decides for none of them.
    ///
    /// Errors: ``ShapeError`` for arrays that are no image and images that do not fit the map,
    /// ``TimeError`` for a time that is missing or naive, ``FormatError`` and ``NotFoundError`` for files,
    /// ``NotFoundError`` for a place that is not in the map.
    #[pyo3(signature = (image, time=None, *, mask=None, bgr=false, name="", prior=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn localize(
        &self,
        py: Python<'_>,
        image: ImageLike<'_>,
        time: Option<TimeLike<'_>>,
        mask: Option<MaskLike<'_>>,
        bgr: bool,
        name: &str,
        prior: Option<Vec<String>>,
    ) -> Result<PyLocalization> {
        let mask = mask.map(|mask| mask_of(&mask.0)).transpose()?;
        let snapshot = self.localizer.snapshot();
        let prior = (prior.unwrap_or_default().iter())
            .map(|place| place_in(snapshot, place, None))
            .collect::<Result<Vec<NodeId>>>()?;
        let job = self.job(&image.0, time_if_given(time)?, name, bgr)?;
        let done = {
            let task = job.given.task()?;
            let known = Known {
                time: job.time.map(|(time, _)| time),
                mask: mask.as_ref(),
                prior: &prior,
            };
            detached_with(py, || Ok(self.answer(&task, known)?))
        };
        let done = match done {
            Err(Failure::Engine(error)) => return Err(job.given.named(*error).into()),
            done => done?,
        };
        Ok(self.told(job, done, bgr))
    }

    /// The features of an image, as the map was learnt with: what ``localize`` finds in it.
    ///
    /// Errors: as ``extract``.
    #[pyo3(name = "extract", signature = (image, *, mask=None, bgr=false))]
    fn extract_features(
        &self,
        py: Python<'_>,
        image: PixelsLike<'_>,
        mask: Option<MaskLike<'_>>,
        bgr: bool,
    ) -> Result<PyFeatures> {
        let mask = mask.map(|mask| mask_of(&mask.0)).transpose()?;
        let pixels = match image.0.extract::<PathBuf>() {
            Ok(path) => Pixels::Owned(detached(py, || load_gray(&path, &LoadOptions::default()))?),
            Err(_) => Pixels::of(&image.0, bgr)?,
        };
        let view = pixels.view()?;
        let (features, size) = detached(py, || self.extract(view, mask.as_ref()))?;
        Ok(PyFeatures::of(features, size))
    }

    /// Says where the pictures of a file were taken: one answer for each that its index cuts out of
    /// it, in its order.
    ///
    /// Errors: as ``localize``.
    #[pyo3(signature = (path, time=None))]
    fn localize_file(
        &self,
        py: Python<'_>,
        path: PathLike<'_>,
        time: Option<TimeLike<'_>>,
    ) -> Result<Vec<PyLocalization>> {
        let jobs = self.jobs(&path.0, time_if_given(time)?, "", false)?;
        let answer = |job: Job<'_>| {
            let known = Known {
                time: job.time.map(|(time, _)| time),
                ..Known::default()
            };
            let task = job.given.task()?;
            let done = detached_with(py, || Ok(self.answer(&task, known)?))?;
            Ok(self.told(job, done, false))
        };
        jobs.into_iter().map(answer).collect()
    }

    /// Says where many images were taken, on several threads: the same answers, in the same order,
    /// as ``localize`` gives one by one.
    ///
    /// ``images`` is a sequence of what ``localize`` takes, or an array (n, height, width); ``times``
    /// as many times, or None. ``threads`` is the number of threads, of all cores by default.
    /// ``errors="return"`` puts an exception in the place of an answer that cannot be given, instead of
    /// raising the first. ``progress=True`` shows a bar where ``tqdm`` is installed. Ctrl-C is heard
    /// every few images.
    ///
    /// Errors: as ``localize``; their ``place`` says which image.
    #[pyo3(signature = (images, times=None, *, threads=None, bgr=false, errors="raise",
                        progress=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn localize_many<'py>(
        &self,
        py: Python<'py>,
        images: ImagesLike<'py>,
        times: Option<TimesLike<'py>>,
        threads: Option<usize>,
        bgr: bool,
        errors: &str,
        progress: Option<ProgressLike<'py>>,
    ) -> Result<Answers<'py>> {
        let returns = match errors {
            "raise" => false,
            "return" => true,
            _ => {
                return Err(Error::new(
                    ErrorKind::Config,
                    format!("there is no errors=`{errors}`"),
                )
                .with_help("use one of raise, return")
                .into());
            }
        };
        let images: Vec<Bound<'py, PyAny>> = images.0.try_iter()?.collect::<PyResult<_>>()?;
        let times = match times {
            Some(times) => times_of(&times.0, images.len())?,
            None => vec![None; images.len()],
        };
        let pool = pool_of(threads)?;
        let mut bar = Progress::new(py, progress.as_ref(), images.len(), "localising")?;
        let answers = PyList::empty(py);
        let chunk_len = IMAGES_PER_THREAD * pool.current_num_threads();
        for (first, chunk) in images
            .chunks(chunk_len)
            .enumerate()
            .map(|(at, it)| (at * chunk_len, it))
        {
            let jobs: Vec<Result<Job<'py>>> = (chunk.iter().zip(&times[first..]))
                .map(|(image, &time)| {
                    let name = String::new();
                    self.job(image, time, &name, bgr)
                })
                .collect();
            let results = self.answer_all(py, &pool, &jobs);
            for (at, (job, result)) in jobs.into_iter().zip(results).enumerate() {
                let place = format!("images[{}]", first + at);
                let told = job.and_then(|job| match result {
                    Some(Ok(done)) => Ok(self.told(job, done, bgr)),
                    Some(Err(error)) => Err(job.given.named(error).into()),
                    None => Err(Failure::Internal("an image was passed over".into())),
                });
                match told {
                    Ok(told) => answers.append(told)?,
                    Err(failure) if returns => {
                        let error = PyErr::from(failure.at(place));
                        answers.append(error.into_value(py))?;
                    }
                    Err(failure) => return Err(failure.at(place)),
                }
            }
            py.check_signals()?;
            bar.advance(chunk.len())?;
        }
        bar.close()?;
        Ok(Answers(answers.into_any()))
    }

    /// Everything that is in effect, with the keys of the table ``[localize]``.
    #[getter]
    fn config<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &json_line(self.localizer.cfg())?)
    }

    /// The method that answers.
    #[getter]
    fn method(&self) -> &'static str {
        self.localizer.cfg().method().name()
    }

    /// The names of the places, in the order of the map.
    #[getter]
    fn places(&self) -> Vec<String> {
        let nodes = self.localizer.snapshot().nodes().iter();
        nodes.map(|node| node.key().as_str().to_owned()).collect()
    }

    /// Width and height in px of the images that the map was learnt from; None while it is empty.
    #[getter]
    fn image_size(&self) -> Option<(u32, u32)> {
        self.localizer.snapshot().meta().image_size
    }

    /// Which commit of the map it reads.
    #[getter]
    fn generation(&self) -> u64 {
        self.localizer.snapshot().generation()
    }

    fn __repr__(&self) -> String {
        let snapshot = self.localizer.snapshot();
        format!(
            "<Localizer by {} in {} places, generation {}>",
            self.method(),
            snapshot.nodes().len(),
            snapshot.generation()
        )
    }
}

impl PyLocalizer {
    /// Answers a few images at once; nothing for those that are none.
    fn answer_all(
        &self,
        py: Python<'_>,
        pool: &rayon::ThreadPool,
        jobs: &[Result<Job<'_>>],
    ) -> Vec<Option<Result<Done, Error>>> {
        let tasks: Vec<Option<(Task<'_>, Option<Time>)>> = (jobs.iter())
            .map(|job| {
                let job = job.as_ref().ok()?;
                Some((job.given.task().ok()?, job.time.map(|(time, _)| time)))
            })
            .collect();
        let work = || {
            let answer = |task: &Option<(Task<'_>, Option<Time>)>| {
                task.as_ref().map(|(task, time)| {
                    let known = Known {
                        time: *time,
                        ..Known::default()
                    };
                    self.answer(task, known)
                })
            };
            Ok(pool.install(|| tasks.par_iter().map(answer).collect::<Vec<_>>()))
        };
        match detached_with(py, work) {
            Ok(results) => results,
            // A panic: none of these has an answer.
            Err(_) => jobs.iter().map(|_| None).collect(),
        }
    }
}

fn with_path(failure: Failure, path: &std::path::Path) -> Failure {
    match failure {
        Failure::Engine(error) => error.with_path(path).into(),
        other => other,
    }
}

fn times_of(times: &Bound<'_, PyAny>, num_images: usize) -> Result<Vec<Option<Time>>> {
    let mut read = Vec::with_capacity(num_images);
    for (at, time) in times.try_iter()?.enumerate() {
        let time = time?;
        if time.is_none() {
            read.push(None);
            continue;
        }
        let time = time_of(&time).map_err(|failure| match failure {
            Failure::Python(error) => {
                Python::attach(|py| add_place(py, &error, &format!("times[{at}]")));
                Failure::Python(error)
            }
            other => other.at(format!("times[{at}]")),
        })?;
        read.push(Some(time));
    }
    if read.len() == num_images {
        return Ok(read);
    }
    let message = format!("{} times do not fit {num_images} images", read.len());
    Err(Error::new(ErrorKind::Shape, message)
        .with_place("times")
        .into())
}

/// Says which of several arguments an exception is about.
fn add_place(py: Python<'_>, error: &PyErr, place: &str) {
    let value = error.value(py);
    let is_unsaid = value.getattr("place").is_ok_and(|place| place.is_none());
    if is_unsaid {
        // An exception without the attribute says it all in its text.
        let _ = value.setattr("place", place);
    }
}

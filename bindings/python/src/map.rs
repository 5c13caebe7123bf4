//! How is a map file opened, learnt, looked into and changed?

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use chronotope::dataset::ReadOptions;
use chronotope::feature::{ExtractorConfig, StarBriefConfig};
use chronotope::learn::{KeepAppearances, LearnConfig, accept_held};
use chronotope::localize::{Localizer, LocalizerConfig, Method, Preset};
use chronotope::map::{Map, MapMeta, Node, NodeId, Snapshot, derived_uuid, random_uuid};
use chronotope::predict::Selection;
use chronotope::time::Zone;
use chronotope::training::{Training, TrainingConfig, TrainingReport};
use chronotope::{Error, ErrorKind, Time};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use serde_json::Value;

use crate::failure::{Failure, Result, detached, interruptible, of_kind};
use crate::features::{PyFeatures, xy_of};
use crate::hints::{
    ConfigLike, Descriptors, Ids, Json, MapLike, MaybeMoment, Moment, Numbers, PathLike, Points,
    ProgressLike, Stamps, Ternary, TimeLike, Triples,
};
use crate::learn_folder;
use crate::map_changes::{self, Correction, known_or_written};
use crate::map_json::{self, Predicted};
use crate::python::{column, json_line, loads, maybe_moment, moment, overlaid, path_of, table};
use crate::settings::{checked_threads, preset_of};

/// A map file: places, what was seen at each visit, and every commit that made it.
///
/// ``Map.open`` reads one, ``Map.build`` learns one from a folder of images, ``Map.create`` begins an
/// empty one, ``Map.merge`` makes one of several. Any number of processes may read a file while one
/// writes; what others have committed is seen after ``refresh``. Every change is a generation that
/// ``rollback`` can return to. A ``with`` block closes it.
#[pyclass(frozen, module = "chronotope", name = "Map")]
pub(crate) struct PyMap {
    path: PathBuf,
    /// Nothing once it is closed.
    map: Mutex<Option<Arc<Map>>>,
    /// Held while a change is made: a change begins with the newest snapshot, and two that begin with the
    /// same one would lose one of them.
    changing: Mutex<()>,
    /// What it was built of.
    learnt: Option<TrainingReport>,
}

impl PyMap {
    pub(crate) fn of(map: Map) -> Self {
        Self {
            path: map.path().to_owned(),
            map: Mutex::new(Some(Arc::new(map))),
            changing: Mutex::new(()),
            learnt: None,
        }
    }

    /// The map, unless it was closed.
    pub(crate) fn open(&self) -> Result<Arc<Map>> {
        let map = self.map.lock().unwrap_or_else(PoisonError::into_inner);
        map.clone().ok_or_else(|| {
            let message = format!("the map {} was closed", self.path.display());
            Python::attach(|py| of_kind(py, "closed", &message, "open it again with Map.open"))
        })
    }

    fn snapshot(&self) -> Result<Arc<Snapshot>> {
        Ok(self.open()?.snapshot())
    }

    fn generation_of(
        &self,
        py: Python<'_>,
        change: impl FnOnce(&Map) -> chronotope::Result<u64> + Send,
    ) -> Result<u64> {
        self.changed(py, change)
    }

    /// Makes one change after another, whichever threads they come from.
    fn changed<T: Send>(
        &self,
        py: Python<'_>,
        change: impl FnOnce(&Map) -> chronotope::Result<T> + Send,
    ) -> Result<T> {
        let map = self.open()?;
        detached(py, || {
            let _turn = self.changing.lock().unwrap_or_else(PoisonError::into_inner);
            change(&map)
        })
    }

    fn find(&self, key: &str) -> Result<(Arc<Snapshot>, NodeId)> {
        let snapshot = self.snapshot()?;
        let id = place_in(&snapshot, key, Some(&self.path))?;
        Ok((snapshot, id))
    }
}

/// The place that bears a name; `path` is the map's, for the error.
pub(crate) fn place_in(snapshot: &Snapshot, key: &str, path: Option<&Path>) -> Result<NodeId> {
    let found = known_or_written(snapshot, key)?;
    snapshot.find(&found).ok_or_else(|| {
        let mut known: Vec<_> = snapshot
            .nodes()
            .iter()
            .map(|node| node.key().as_str())
            .collect();
        let more = if known.len() > 20 { ", ..." } else { "" };
        known.truncate(20);
        let error = Error::new(ErrorKind::NotFound, format!("the map has no place `{key}`"))
            .with_help(format!("it has {}{more}", known.join(", ")));
        match path {
            Some(path) => error.with_path(path),
            None => error,
        }
        .into()
    })
}

/// A snapshot of what a caller named: a map that is open, or the path of one.
pub(crate) fn snapshot_of(map: &Bound<'_, PyAny>) -> Result<(PathBuf, Arc<Snapshot>)> {
    if let Ok(map) = map.cast::<PyMap>() {
        let map = map.get();
        return Ok((map.path.clone(), map.snapshot()?));
    }
    let path: PathBuf = map.extract()?;
    let snapshot = detached(map.py(), || Map::open_read_only(&path))?.snapshot();
    Ok((path, snapshot))
}

fn keep_of(name: Option<&str>) -> Result<Option<KeepAppearances>> {
    Ok(Some(match name {
        None => return Ok(None),
        Some("none") => KeepAppearances::None,
        Some("experiences") => KeepAppearances::Experiences,
        Some("all") => KeepAppearances::All,
        Some(other) => {
            let message = format!("there is no keep_appearances `{other}`");
            let error = Error::new(ErrorKind::Config, message);
            return Err(error.with_help("use one of none, experiences, all").into());
        }
    }))
}

/// What is learnt of an image: the numbers of a preset, changed as the caller wishes.
fn learn_config(
    preset: Preset,
    config: Option<&ConfigLike<'_>>,
    keep: Option<&str>,
) -> Result<LearnConfig> {
    let cfg = overlaid(LearnConfig::preset(preset), config, "config")?;
    Ok(match keep_of(keep)? {
        Some(keep) => cfg.with_keep_appearances(keep),
        None => cfg,
    })
}

#[pymethods]
impl PyMap {
    /// Opens a map file: to be written where file and folder allow it, else read-only.
    ///
    /// Reads and checks all of it.
    ///
    /// Errors: ``NotFoundError``, ``FormatError`` if it is no map, ``ChecksumError`` if it is damaged.
    #[staticmethod]
    #[pyo3(name = "open", signature = (path, *, read_only=false))]
    fn open_file(py: Python<'_>, path: PathLike<'_>, read_only: bool) -> Result<Self> {
        let path = path_of(&path)?;
        let open = || {
            if read_only {
                Map::open_read_only(&path)
            } else {
                Map::open(&path)
            }
        };
        Ok(Self::of(detached(py, open)?))
    }

    /// Begins an empty map, for a ``Learner``; a file that exists is never overwritten.
    ///
    /// ``name`` gives the map's UUID, so that the same images give the same map; it is random
    /// otherwise. ``preset`` is ``"default"`` or ``"lttl"``, the recipe of the FreMEn authors' benchmark.
    ///
    /// Errors: ``AlreadyExistsError``, ``ConfigError``.
    #[staticmethod]
    #[pyo3(signature = (path, *, preset="default", name=None, zone=None))]
    fn create(
        py: Python<'_>,
        path: PathLike<'_>,
        preset: &str,
        name: Option<&str>,
        zone: Option<&str>,
    ) -> Result<Self> {
        let path = path_of(&path)?;
        let preset: Preset = preset.parse()?;
        let zone = zone.map(Zone::new).transpose()?;
        let cfg = LearnConfig::preset(preset);
        let extractor = ExtractorConfig::StarBrief(
            StarBriefConfig::default().with_num_features(cfg.features_per_visit()),
        )
        .build()?;
        let uuid = name.map_or_else(random_uuid, derived_uuid);
        let meta = MapMeta {
            zone: zone.map(|zone| zone.name().to_owned()),
            ..MapMeta::new(uuid, extractor.id(), preset.name())
        };
        Ok(Self::of(detached(py, || Map::create(&path, meta))?))
    }

    /// Learns a map from a folder of images of known places and times, as ``chronotope map build``
    /// does.
    ///
    /// ``data`` is a folder with an ``index.csv`` (columns place, time, path), one in a known layout,
    /// or a manifest. Visits are committed to ``path.part`` while it learns; Ctrl-C loses nothing, and
    /// the same call goes on where it stopped. ``config`` replaces keys of the table ``[learn]``,
    /// ``keep_appearances`` is ``"none"``, ``"experiences"`` or ``"all"``. What was left out and why is in
    /// ``map.learnt.problems`` and in the log.
    ///
    /// Errors: ``AlreadyExistsError`` if ``path`` exists, ``FormatError`` if nothing could be learnt.
    #[staticmethod]
    #[pyo3(signature = (data, path, *, preset="default", config=None, keep_appearances=None,
                        zone=None, threads=None, progress=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn build(
        py: Python<'_>,
        data: PathLike<'_>,
        path: PathLike<'_>,
        preset: &str,
        config: Option<ConfigLike<'_>>,
        keep_appearances: Option<&str>,
        zone: Option<&str>,
        threads: Option<usize>,
        progress: Option<ProgressLike<'_>>,
    ) -> Result<Self> {
        let (data, path) = (path_of(&data)?, path_of(&path)?);
        let preset: Preset = preset.parse()?;
        let cfg = learn_config(preset, config.as_ref(), keep_appearances)?;
        let reading = ReadOptions {
            zone: zone.map(Zone::new).transpose()?,
            ..ReadOptions::default()
        };
        let cfg = TrainingConfig::new(preset, cfg)
            .with_reading(reading)
            .with_num_threads(checked_threads(threads)?);
        let mut training = detached(py, || Training::to_build(&data, &path, &cfg))?;
        let report = learn_folder::run(py, &mut training, progress.as_ref())?;
        let map = detached(py, || {
            drop(training);
            Map::open(&path)
        })?;
        Ok(Self {
            learnt: Some(report),
            ..Self::of(map)
        })
    }

    /// Learns more images of known places and times into the map, as ``chronotope map update`` does;
    /// what it has already is not learnt again.
    ///
    /// Errors: ``IoError`` if the file may not be written.
    #[pyo3(signature = (data, *, config=None, keep_appearances=None, threads=None, progress=None))]
    fn update(
        &self,
        py: Python<'_>,
        data: PathLike<'_>,
        config: Option<ConfigLike<'_>>,
        keep_appearances: Option<&str>,
        threads: Option<usize>,
        progress: Option<ProgressLike<'_>>,
    ) -> Result<PyReport> {
        let map = self.open()?;
        let data = path_of(&data)?;
        let preset = preset_of(map.snapshot().meta());
        let cfg = learn_config(preset, config.as_ref(), keep_appearances)?;
        let cfg = TrainingConfig::new(preset, cfg).with_num_threads(checked_threads(threads)?);
        let open = if map.is_read_only() {
            Map::open_read_only
        } else {
            Map::open
        };
        let mut training = detached(py, || {
            open(&self.path).and_then(|map| Training::to_update(map, &data, &cfg))
        })?;
        let report = learn_folder::run(py, &mut training, progress.as_ref())?;
        detached(py, || map.refresh())?;
        Ok(PyReport { report })
    }

    /// Makes one map of several, of robots or days, as ``chronotope map merge`` does: the union of
    /// their visits, the same in any order.
    ///
    /// ``relearn=True`` learns all visits anew (``config`` as for ``build``); ``disjoint=True`` allows maps
    /// that have nothing in common.
    ///
    /// Errors: ``ConfigError`` for maps of other extractors or without anything in common,
    /// ``AlreadyExistsError`` if ``path`` exists.
    #[staticmethod]
    #[pyo3(signature = (maps, path, *, relearn=false, disjoint=false, config=None))]
    fn merge(
        py: Python<'_>,
        maps: Vec<MapLike<'_>>,
        path: PathLike<'_>,
        relearn: bool,
        disjoint: bool,
        config: Option<ConfigLike<'_>>,
    ) -> Result<Self> {
        if maps.len() < 2 {
            let message = format!("{} maps cannot be merged", maps.len());
            let error = Error::new(ErrorKind::Config, message);
            return Err(error.with_help("give two or more").into());
        }
        let maps = (maps.iter())
            .map(|map| snapshot_of(&map.0))
            .collect::<Result<Vec<_>>>()?;
        let path = path_of(&path)?;
        let cfg = relearn
            .then(|| learn_config(preset_of(maps[0].1.meta()), config.as_ref(), None))
            .transpose()?;
        let map = detached(py, || map_changes::merge(&maps, &path, disjoint, cfg))?;
        Ok(Self::of(map))
    }

    /// Checks every byte of a map file and changes nothing: a dictionary as
    /// ``chronotope map verify --json`` prints it, with ``clean`` and ``faults``.
    ///
    /// Errors: ``NotFoundError``, ``FormatError`` if it is no map at all.
    #[staticmethod]
    fn verify_file<'py>(py: Python<'py>, path: PathLike<'py>) -> Result<Json<'py>> {
        let path = path_of(&path)?;
        let report = detached(py, || Map::verify(&path))?;
        loads(py, &json_line(&map_json::verify(&path, &report))?)
    }

    /// Checks every byte of this map's file, as ``verify_file``.
    fn verify<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let map = self.open()?;
        let report = detached(py, || Map::verify(map.path()))?;
        loads(py, &json_line(&map_json::verify(&self.path, &report))?)
    }

    /// Lets go of the file; snapshots and localizers that were made of it stay as they are.
    fn close(&self) {
        self.map
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
    }

    /// Whether ``close`` was called.
    #[getter]
    fn closed(&self) -> bool {
        self.map
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_none()
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_exception: "object"))]
    fn __exit__(&self, _exception: &Bound<'_, PyTuple>) {
        self.close();
    }

    /// The file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// Whether the file was opened without the right to change it.
    #[getter]
    fn read_only(&self) -> Result<bool> {
        Ok(self.open()?.is_read_only())
    }

    /// Which commit was read last, counted from 0.
    #[getter]
    fn generation(&self) -> Result<u64> {
        Ok(self.snapshot()?.generation())
    }

    /// What the last ``build`` has learnt and left out; None for a map that was opened.
    #[getter]
    fn learnt(&self) -> Option<PyReport> {
        let report = self.learnt.clone()?;
        Some(PyReport { report })
    }

    /// The places, in order of creation.
    #[getter]
    fn places(&self) -> Result<Vec<PyPlace>> {
        let snapshot = self.snapshot()?;
        let place = |at| PyPlace {
            snapshot: Arc::clone(&snapshot),
            id: NodeId(at),
        };
        Ok((0..snapshot.nodes().len() as u32).map(place).collect())
    }

    /// The place of this name.
    ///
    /// Errors: ``NotFoundError``, with the names that there are.
    fn place(&self, name: &str) -> Result<PyPlace> {
        let (snapshot, id) = self.find(name)?;
        Ok(PyPlace { snapshot, id })
    }

    fn __getitem__(&self, name: &str) -> Result<PyPlace> {
        self.place(name)
    }

    fn __contains__(&self, name: &str) -> Result<bool> {
        let snapshot = self.snapshot()?;
        Ok(known_or_written(&snapshot, name).is_ok_and(|key| snapshot.find(&key).is_some()))
    }

    fn __len__(&self) -> Result<usize> {
        Ok(self.snapshot()?.nodes().len())
    }

    /// The ways between places: (from, to, name).
    #[getter]
    fn edges(&self) -> Result<Vec<(String, String, String)>> {
        let snapshot = self.snapshot()?;
        let edges = snapshot.edges().iter();
        Ok(edges
            .map(|it| (it.from.to_string(), it.to.to_string(), it.name.clone()))
            .collect())
    }

    /// Adds a way from one place to another, and gives the generation.
    ///
    /// Errors: ``NotFoundError`` if the map lacks a place.
    #[pyo3(signature = (start, end, *, name=""))]
    fn add_edge(&self, py: Python<'_>, start: &str, end: &str, name: &str) -> Result<u64> {
        self.generation_of(py, |map| map_changes::add_edge(map, start, end, name))
    }

    /// Removes the ways from one place to another, or the one of that name.
    ///
    /// Errors: ``NotFoundError``.
    #[pyo3(signature = (start, end, *, name=None))]
    fn remove_edge(
        &self,
        py: Python<'_>,
        start: &str,
        end: &str,
        name: Option<&str>,
    ) -> Result<u64> {
        self.generation_of(py, |map| map_changes::remove_edge(map, start, end, name))
    }

    /// Gives a place another name, and gives the generation.
    fn rename_place(&self, py: Python<'_>, place: &str, to: &str) -> Result<u64> {
        self.generation_of(py, |map| {
            map_changes::correct(map, place, &Correction::Rename { to })
        })
    }

    /// Removes a place with all of its visits.
    fn remove_place(&self, py: Python<'_>, place: &str) -> Result<u64> {
        self.generation_of(py, |map| {
            map_changes::correct(map, place, &Correction::Remove)
        })
    }

    /// Makes the visits of ``other`` visits of ``place``.
    fn join_places(&self, py: Python<'_>, place: &str, other: &str) -> Result<u64> {
        self.generation_of(py, |map| {
            map_changes::correct(map, place, &Correction::Join { other })
        })
    }

    /// All that it holds, as ``chronotope map inspect --json`` prints it.
    fn inspect<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let snapshot = self.snapshot()?;
        let value = detached(py, || Ok(map_json::inspect(&self.path, &snapshot)))?;
        loads(py, &json_line(&value)?)
    }

    /// Every commit, oldest first, as ``chronotope map log --json`` prints them.
    fn log<'py>(&self, py: Python<'py>) -> Result<Vec<Json<'py>>> {
        let map = self.open()?;
        let generations = detached(py, || map.generations())?;
        lines(py, &map_json::log(&generations, &map.snapshot()))
    }

    /// The visits that it does not believe, as ``chronotope map held --json`` prints them.
    fn held<'py>(&self, py: Python<'py>) -> Result<Vec<Json<'py>>> {
        let map = self.open()?;
        lines(py, &detached(py, || map_json::held(&map))?)
    }

    /// Learns visits that are held; ``ids`` are their beginnings, None means all. Gives the generation.
    #[pyo3(signature = (ids=None, *, config=None))]
    fn accept(
        &self,
        py: Python<'_>,
        ids: Option<Vec<String>>,
        config: Option<ConfigLike<'_>>,
    ) -> Result<u64> {
        let cfg = learn_config(preset_of(self.snapshot()?.meta()), config.as_ref(), None)?;
        self.changed(py, |map| {
            let ids = map_changes::held_ids(map, ids.as_deref(), false)?;
            accept_held(map, &cfg, &ids)
        })
    }

    /// Forgets visits that are held. Gives the generation.
    #[pyo3(signature = (ids=None))]
    fn drop_held(&self, py: Python<'_>, ids: Option<Vec<String>>) -> Result<u64> {
        self.generation_of(py, |map| {
            let ids = map_changes::held_ids(map, ids.as_deref(), true)?;
            map.drop_held(&ids)
        })
    }

    /// Takes back all visits of a run, by its UUID or name, and says how many they were.
    fn forget(&self, py: Python<'_>, session: &str) -> Result<usize> {
        self.changed(py, |map| map_changes::forget(map, session))
    }

    /// Returns to what the map was at a generation, as a new generation, and gives its number;
    /// nothing is lost.
    ///
    /// Errors: ``NotFoundError``.
    fn rollback(&self, py: Python<'_>, to: u64) -> Result<u64> {
        self.generation_of(py, |map| map.rollback(to))
    }

    /// Forgets generations but the newest ``keep_last``, those in ``keep`` and, with ``keep_daily``, the
    /// last of each day; gives how many are gone, and the bytes of the file before and after.
    #[pyo3(signature = (*, keep_last=1, keep_daily=false, keep=Vec::new()))]
    fn prune(
        &self,
        py: Python<'_>,
        keep_last: usize,
        keep_daily: bool,
        keep: Vec<u64>,
    ) -> Result<(usize, u64, u64)> {
        let pruned = self.changed(py, |map| {
            let kept = map_changes::kept(&map.generations()?, keep_last, keep_daily, &keep);
            map.prune(&kept)
        })?;
        Ok((
            pruned.num_dropped,
            pruned.num_bytes_before,
            pruned.num_bytes_after,
        ))
    }

    /// Reads what other processes have committed, and gives the newest generation.
    fn refresh(&self, py: Python<'_>) -> Result<u64> {
        let map = self.open()?;
        Ok(detached(py, || map.refresh())?.generation())
    }

    /// Works out once what matches in this map are worth and keeps it with it, so that localizers
    /// start at once; gives the number of past images, or None if it was known.
    #[pyo3(signature = (*, config=None))]
    fn calibrate(&self, py: Python<'_>, config: Option<ConfigLike<'_>>) -> Result<Option<usize>> {
        let preset = preset_of(self.snapshot()?.meta());
        let cfg = overlaid(LocalizerConfig::preset(preset), config.as_ref(), "config")?;
        self.changed(py, |map| map_changes::calibrate(map, cfg))
    }

    /// Writes the map as plain files (JSON, CSV, NPY) into a new folder.
    fn export(&self, py: Python<'_>, folder: PathLike<'_>) -> Result<()> {
        let folder = path_of(&folder)?;
        let snapshot = self.snapshot()?;
        detached(py, || snapshot.export(&folder))?;
        Ok(())
    }

    /// Makes a map of such a folder.
    ///
    /// Errors: ``AlreadyExistsError`` if ``path`` exists, ``FormatError`` for damaged files.
    #[staticmethod]
    fn import_folder(py: Python<'_>, folder: PathLike<'_>, path: PathLike<'_>) -> Result<Self> {
        let (folder, path) = (path_of(&folder)?, path_of(&path)?);
        Map::refuse_existing(&path)?;
        let map = detached(py, || {
            let snapshot = Snapshot::import(&folder)?;
            Map::create_from(&path, &snapshot)
        })?;
        Ok(Self::of(map))
    }

    /// Which features of a place should be visible at a time, most likely first, as
    /// ``chronotope predict`` says; at most ``n``.
    ///
    /// Models are fitted at each call; ask for several times at once with ``predict_many``.
    ///
    /// Errors: ``NotFoundError``, ``TimeError``, ``ConfigError``.
    #[pyo3(signature = (place, time, *, n=None, config=None))]
    fn predict(
        &self,
        py: Python<'_>,
        place: &str,
        time: TimeLike<'_>,
        n: Option<usize>,
        config: Option<ConfigLike<'_>>,
    ) -> Result<PyPredictedMap> {
        let time = crate::python::time_of(&time.0)?;
        let mut predicted = self.predicted(py, place, vec![time], n, config.as_ref())?;
        predicted
            .pop()
            .ok_or_else(|| Failure::Internal("nothing was predicted".into()))
    }

    /// ``predict`` for several times, of models that are fitted once.
    #[pyo3(signature = (place, times, *, n=None, config=None))]
    fn predict_many(
        &self,
        py: Python<'_>,
        place: &str,
        times: Vec<TimeLike<'_>>,
        n: Option<usize>,
        config: Option<ConfigLike<'_>>,
    ) -> Result<Vec<PyPredictedMap>> {
        let times = times.iter().map(|time| crate::python::time_of(&time.0));
        let times = times.collect::<Result<Vec<Time>>>()?;
        self.predicted(py, place, times, n, config.as_ref())
    }

    fn __repr__(&self) -> String {
        let path = self.path.display();
        match self.snapshot() {
            Err(_) => format!("<Map {path}, closed>"),
            Ok(snapshot) => {
                let it = snapshot.summary();
                format!(
                    "<Map {path}: {} places, {} visits, {} features, generation {}>",
                    it.num_places, it.num_visits, it.num_features, it.generation
                )
            }
        }
    }
}

impl PyMap {
    fn predicted(
        &self,
        py: Python<'_>,
        place: &str,
        times: Vec<Time>,
        n: Option<usize>,
        config: Option<&ConfigLike<'_>>,
    ) -> Result<Vec<PyPredictedMap>> {
        let (snapshot, id) = self.find(place)?;
        let base = LocalizerConfig::preset(preset_of(snapshot.meta()));
        let mut cfg = overlaid(base, config, "config")?;
        if let Some(n) = n {
            cfg = cfg.with_selection(Selection::top(n).map_err(|error| error.with_place("n"))?);
        }
        if !cfg.method().predicts() {
            cfg = cfg.with_method(Method::Fremen);
        }
        let path = self.path.clone();
        let predicted = interruptible(py, move || {
            let localizer =
                Localizer::new(snapshot, cfg).map_err(|error| error.with_path(&path))?;
            (times.into_iter())
                .map(|time| Predicted::of(&localizer, id, time))
                .collect::<chronotope::Result<Vec<_>>>()
        })?;
        let predicted = predicted.into_iter().flatten();
        Ok(predicted
            .map(|predicted| PyPredictedMap { predicted })
            .collect())
    }
}

fn lines<'py>(py: Python<'py>, values: &[Value]) -> Result<Vec<Json<'py>>> {
    values
        .iter()
        .map(|value| loads(py, &json_line(value)?))
        .collect()
}

/// One place of a map, as it was when it was asked for.
#[pyclass(frozen, module = "chronotope", name = "Place")]
pub(crate) struct PyPlace {
    snapshot: Arc<Snapshot>,
    id: NodeId,
}

impl PyPlace {
    fn node(&self) -> &Node {
        self.snapshot.node(self.id)
    }
}

#[pymethods]
impl PyPlace {
    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        self.node().key().as_str()
    }

    /// Position in metres in a frame of the user's, where known.
    #[getter]
    fn pose(&self) -> Option<(f64, f64, f64)> {
        self.node().pose().map(|[x, y, z]| (x, y, z))
    }

    /// Its features, in order of birth.
    #[getter]
    fn features(&self) -> PyFeatures {
        let size = self.snapshot.meta().image_size;
        PyFeatures::of(Arc::new(self.node().features().clone()), size)
    }

    /// Positions of the features, float32 (n, 2), px.
    #[getter]
    fn xy<'py>(&self, py: Python<'py>) -> Result<Points<'py>> {
        Ok(Points(xy_of(py, self.node().features().keypoints())?))
    }

    /// Their descriptors, uint8 (n, 32).
    #[getter]
    fn descriptors<'py>(&self, py: Python<'py>) -> Result<Descriptors<'py>> {
        let bytes = (self.node().features().descriptors().iter()).flat_map(|it| it.to_bytes());
        Ok(Descriptors(table(py, bytes.collect(), 32)?))
    }

    /// When each visit was, int64 (m,), microseconds since 1970 in UTC: ``.view("datetime64[us]")``.
    #[getter]
    fn visit_times_us<'py>(&self, py: Python<'py>) -> Result<Stamps<'py>> {
        let times = self.node().visits().iter().map(|it| it.time.as_us());
        Ok(Stamps(column(py, times.collect())?))
    }

    /// Where the image of each visit came from.
    #[getter]
    fn visit_sources(&self) -> Vec<String> {
        self.node()
            .visits()
            .iter()
            .map(|it| it.source.clone())
            .collect()
    }

    /// The run of each visit.
    #[getter]
    fn visit_sessions(&self) -> Vec<String> {
        self.node()
            .visits()
            .iter()
            .map(|it| it.session.to_string())
            .collect()
    }

    /// The identity of each visit across maps.
    #[getter]
    fn visit_ids(&self) -> Vec<String> {
        self.node()
            .visits()
            .iter()
            .map(|it| it.id.to_string())
            .collect()
    }

    /// What was seen when, int8 (m visits, n features): 1 seen, 0 not seen, -1 not observable (before
    /// its birth, or under a mask).
    fn seen<'py>(&self, py: Python<'py>) -> Result<Ternary<'py>> {
        use chronotope::visibility::FeatureState;
        let log = self.node().log();
        let (num_visits, num_features) = (log.num_visits(), log.num_features());
        let mut states = Vec::with_capacity(num_visits * num_features);
        for visit in 0..num_visits {
            states.extend(
                (0..num_features).map(|feature| match log.state(visit, feature) {
                    Some(FeatureState::Seen) => 1_i8,
                    Some(FeatureState::NotSeen) => 0,
                    _ => -1,
                }),
            );
        }
        if num_features == 0 {
            return Ok(Ternary(table(py, states, 1)?));
        }
        Ok(Ternary(table(py, states, num_features)?))
    }

    /// How many features it has.
    fn __len__(&self) -> usize {
        self.node().features().len()
    }

    fn __repr__(&self) -> String {
        let node = self.node();
        format!(
            "<Place '{}': {} visits, {} features>",
            node.key(),
            node.visits().len(),
            node.features().len()
        )
    }
}

/// What a place should look like at a time.
#[pyclass(frozen, module = "chronotope", name = "PredictedMap")]
pub(crate) struct PyPredictedMap {
    predicted: Predicted,
}

#[pymethods]
impl PyPredictedMap {
    /// The place.
    #[getter]
    fn place(&self) -> &str {
        &self.predicted.place
    }

    /// The time, in UTC.
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Result<Moment<'py>> {
        moment(py, self.predicted.time)
    }

    /// Ids of the features within the place, most likely first, uint32 (n,).
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Result<Ids<'py>> {
        Ok(Ids(column(py, self.predicted.ids.clone())?))
    }

    /// Where they are, float32 (n, 2), px.
    #[getter]
    fn xy<'py>(&self, py: Python<'py>) -> Result<Points<'py>> {
        Ok(Points(table(py, self.predicted.xy.clone(), 2)?))
    }

    /// p(t) of each, float64 (n,).
    #[getter]
    fn p<'py>(&self, py: Python<'py>) -> Result<Numbers<'py>> {
        let p = self.predicted.p.chunks_exact(3).map(|p| p[0]);
        Ok(Numbers(column(py, p.collect())?))
    }

    /// p(t) with the lower and the upper end of its 95 % interval, float64 (n, 3).
    #[getter]
    fn estimate<'py>(&self, py: Python<'py>) -> Result<Triples<'py>> {
        Ok(Triples(table(py, self.predicted.p.clone(), 3)?))
    }

    /// As ``chronotope predict --json`` prints it.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &self.to_json()?)
    }

    /// The line that ``chronotope predict --json`` prints.
    fn to_json(&self) -> Result<String> {
        json_line(&self.predicted.to_json())
    }

    fn __len__(&self) -> usize {
        self.predicted.ids.len()
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> Result<String> {
        let html = slf
            .py()
            .import("chronotope._html")?
            .getattr("predicted_map")?;
        Ok(html.call1((slf,))?.extract()?)
    }

    fn __repr__(&self) -> String {
        format!(
            "<PredictedMap '{}' at {}: {} of {} features>",
            self.predicted.place,
            self.predicted.time,
            self.predicted.ids.len(),
            self.predicted.num_features
        )
    }
}

/// What was learnt of a folder, and what was left out.
#[pyclass(frozen, module = "chronotope", name = "LearnReport")]
pub(crate) struct PyReport {
    report: TrainingReport,
}

#[pymethods]
impl PyReport {
    /// Visits that were learnt.
    #[getter]
    fn num_learnt(&self) -> usize {
        self.report.num_learnt
    }

    /// Visits that the map does not believe (``Map.held``).
    #[getter]
    fn num_held(&self) -> usize {
        self.report.num_held
    }

    /// Images that belong to a visit that was learnt.
    #[getter]
    fn num_same_visit(&self) -> usize {
        self.report.num_same_visit
    }

    /// Images that the map had already.
    #[getter]
    fn num_known(&self) -> usize {
        self.report.num_known
    }

    /// What was left out, and why.
    #[getter]
    fn problems(&self) -> Vec<String> {
        (self.report.problems.iter())
            .map(ToString::to_string)
            .collect()
    }

    fn __repr__(&self) -> String {
        format!(
            "<LearnReport: {} visits learnt, {} held, {} problems>",
            self.report.num_learnt,
            self.report.num_held,
            self.report.problems.len()
        )
    }
}

/// When an image was taken, by its EXIF data; None if they say nothing with an offset.
#[pyfunction]
pub(crate) fn exif_time<'py>(py: Python<'py>, path: PathLike<'py>) -> Result<MaybeMoment<'py>> {
    let path = path_of(&path)?;
    let time = detached(py, || chronotope::dataset::exif_time(&path, None))?;
    maybe_moment(py, time)
}

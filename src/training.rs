//! How does a folder of images become a map, or more of a map?
//!
//! Visits are learnt in order of time into `MAP.part`, and committed every few seconds. Only the
//! finished map gets the name MAP, so what bears it is whole. The same training goes on where an
//! interrupted one stopped: the part's UUID is derived from dataset, extractor and configuration,
//! so a part of another training is refused, and visits it holds (same place, time and source) are
//! not read again. The reference recipe (preset `lttl`) can write its log only once all images are
//! known: it commits once, at the end, and starts again if it is interrupted.
//!
//! An update learns into the map itself: each commit is a generation that can be returned to.
//!
//! ```no_run
//! use chronotope::map::Map;
//! use chronotope::training::{Training, TrainingConfig};
//!
//! # fn main() -> chronotope::Result<()> {
//! let cfg = TrainingConfig::default();
//! let mut training = Training::to_build("photos".as_ref(), "street.map".as_ref(), &cfg)?;
//! training.learn(&|| false, &mut |_| {})?;
//! let snapshot = training.finish()?;
//! println!("{} places, {} images left out", snapshot.nodes().len(), training.report().problems.len());
//! # Ok(())
//! # }
//! ```
//!
//! Images are decoded and extracted on several threads, and learnt in their order: the same folder
//! gives the same map for any number of threads, from the command and from Python.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use rayon::prelude::*;

use crate::dataset::{
    Clock, Dataset, Entry, Manifest, Problem, ReadOptions, blind_doubt, needs_room,
};
use crate::feature::{
    Extractor, ExtractorConfig, Features, GrayImage, LoadOptions, Models, StarBriefConfig,
};
use crate::learn::{Circumstances, ClockPolicy, Judge, LearnConfig, Learnt, Observation, Recipe};
use crate::localize::Preset;
use crate::map::{Map, MapMeta, PlaceKey, SessionId, Snapshot, derived_uuid};
use crate::robot::OnlineLearner;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// Images that each thread extracts before they are learnt.
const IMAGES_PER_THREAD: usize = 8;

/// How a folder is read and learnt.
#[derive(Clone, Debug)]
pub struct TrainingConfig {
    preset: Preset,
    learn: LearnConfig,
    extractor: Option<ExtractorConfig>,
    models: Models,
    reading: ReadOptions,
    adjustment: LoadOptions,
    commit_interval: Duration,
    num_threads: Option<usize>,
}

impl Default for TrainingConfig {
    /// That of the shipped preset.
    fn default() -> Self {
        Self::new(Preset::Default, LearnConfig::default())
    }
}

impl TrainingConfig {
    /// Learns by `learn`; a new map says that its numbers come from `preset`.
    pub fn new(preset: Preset, learn: LearnConfig) -> Self {
        Self {
            preset,
            learn,
            extractor: None,
            models: Models::from_env(),
            reading: ReadOptions::default(),
            adjustment: LoadOptions::default(),
            commit_interval: Duration::from_secs(1),
            num_threads: None,
        }
    }

    /// A new map has the features of this extractor; by default those of the reference recipe, as
    /// many as are learnt of a visit. A map that is updated keeps its own.
    #[must_use]
    pub fn with_extractor(mut self, extractor: Option<ExtractorConfig>) -> Self {
        self.extractor = extractor;
        self
    }

    /// Where the network of learned features is looked for; by default in the folder that the
    /// environment names ([`Models::from_env`]).
    #[must_use]
    pub fn with_models(mut self, models: Models) -> Self {
        self.models = models;
        self
    }

    /// Reads the folder so; its zone becomes that of a new map, in the place of the manifest's.
    #[must_use]
    pub fn with_reading(mut self, reading: ReadOptions) -> Self {
        self.reading = reading;
        self
    }

    /// Turns, cuts and scales every image so, after what the dataset says of it.
    #[must_use]
    pub fn with_adjustment(mut self, adjustment: LoadOptions) -> Self {
        self.adjustment = adjustment;
        self
    }

    /// Commits are at least this far apart, a second by default: what a crash may cost.
    #[must_use]
    pub fn with_commit_interval(mut self, interval: Duration) -> Self {
        self.commit_interval = interval;
        self
    }

    /// Images are extracted on so many threads, by default those of the caller's pool.
    #[must_use]
    pub fn with_num_threads(mut self, num_threads: Option<usize>) -> Self {
        self.num_threads = num_threads;
        self
    }

    fn pool(&self) -> Result<Option<rayon::ThreadPool>> {
        let Some(num_threads) = self.num_threads else {
            return Ok(None);
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads);
        let pool = pool.build().map_err(|cause| {
            Error::new(ErrorKind::Config, format!("{num_threads} threads: {cause}"))
                .with_help("choose fewer")
        })?;
        Ok(Some(pool))
    }
}

/// What happens while a folder is learnt.
#[derive(Debug)]
#[non_exhaustive]
pub enum Step<'a> {
    /// So many of the images are in the map already, and are not read again.
    Resumed {
        /// How many.
        num_known: usize,
    },
    /// An image became a visit.
    Learnt {
        /// The image.
        entry: &'a Entry,
        /// What was learnt from it.
        learnt: &'a Learnt,
    },
    /// An image is quarantined: `learnt.doubt` says why.
    Held {
        /// The image.
        entry: &'a Entry,
        /// What was found out about it.
        learnt: &'a Learnt,
    },
    /// So many of the images are done, whatever became of them.
    Done {
        /// How many, those that were known with them.
        num_done: usize,
    },
    /// What was learnt so far is safe.
    Committed {
        /// The number of the generation.
        generation: u64,
    },
}

/// What became of the images.
#[derive(Clone, Debug, Default)]
pub struct TrainingReport {
    /// Images that were learnt as visits.
    pub num_learnt: usize,
    /// Images of a place that was seen just before, which belong to that visit.
    pub num_same_visit: usize,
    /// Images that are quarantined.
    pub num_held: usize,
    /// Visits held before whose features had to go.
    pub num_given_up: usize,
    /// Images that the map had learnt by another name.
    pub num_known: usize,
    /// What was left out, and why.
    pub problems: Vec<Problem>,
}

/// A folder that is being learnt.
pub struct Training {
    dataset: Dataset,
    num_images: usize,
    /// The size that all images have or are scaled to, and how many are scaled.
    scaled: (Option<(u32, u32)>, usize),
    session: SessionId,
    extractor: Box<dyn Extractor>,
    learner: OnlineLearner,
    /// Of its own, if not the caller's.
    pool: Option<rayon::ThreadPool>,
    /// The map's name once it is finished.
    out: PathBuf,
    /// Its name until then, if that is another.
    part: Option<PathBuf>,
    /// Images with nothing to see are problems; what holds visits judges them itself.
    leaves_out_blind: bool,
    report: TrainingReport,
}

struct Extracted {
    features: Features,
    image_size: (u32, u32),
    gray_range: Option<(u8, u8)>,
    mask: Option<GrayImage>,
}

impl std::fmt::Debug for Training {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (f.debug_struct("Training"))
            .field("dataset", &self.dataset.name)
            .field("out", &self.out)
            .field("report", &self.report)
            .finish_non_exhaustive()
    }
}

impl Training {
    /// For a new map: `data` is a folder or a manifest, `out` the file that will be written.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::AlreadyExists`] if `out` exists or `MAP.part` is of another training, else those
    /// of reading the dataset as a whole and of creating a map.
    pub fn to_build(data: &Path, out: &Path, cfg: &TrainingConfig) -> Result<Self> {
        Map::refuse_existing(out)?;
        Self::to_build_from(open_dataset(data, cfg)?, out, cfg)
    }

    /// [`to_build`](Self::to_build) from a dataset that is open already: entries whose images come
    /// from anywhere, such as a robot's log ([`ImageSource`](crate::dataset::ImageSource)).
    ///
    /// Its entries are sorted by time, then place, then id. Of `cfg`, how a folder is read counts no
    /// more; its adjustment of images does.
    ///
    /// # Errors
    ///
    /// Those of [`to_build`](Self::to_build), but of reading the dataset.
    pub fn to_build_from(dataset: Dataset, out: &Path, cfg: &TrainingConfig) -> Result<Self> {
        Map::refuse_existing(out)?;
        let dataset = dataset.adjusted(&cfg.adjustment);
        let judges = cfg.learn.guard().judge() == Judge::Updates;
        let learn = cfg.learn.clone().for_building();
        let extractor = cfg.extractor.clone().unwrap_or_else(|| {
            let num_features = learn.features_per_visit();
            ExtractorConfig::StarBrief(StarBriefConfig::default().with_num_features(num_features))
        });
        let extractor = extractor.build_with(&cfg.models)?;
        let text = toml::to_string(&learn)
            .map_err(|cause| Error::new(ErrorKind::Config, cause.to_string()))?;
        let seed = [
            &dataset.name,
            &dataset.sha256(),
            &extractor.id(),
            cfg.preset.name(),
            &text,
        ]
        .join("\n");
        let meta = MapMeta {
            zone: dataset.zone.clone(),
            ..MapMeta::new(derived_uuid(&seed), extractor.id(), cfg.preset.name())
        };
        let part = part_of(out);
        let map = open_part(&part, meta)?;
        let mut training = Self::with(map, extractor, learn, dataset, cfg)?;
        out.clone_into(&mut training.out);
        training.part = Some(part);
        training.leaves_out_blind = judges;
        let may_grow = needs_room(&*training.extractor) && !cfg.adjustment.changes_scale();
        training.set_aside(judges.then(Time::now), may_grow);
        Ok(training)
    }

    /// For more of a map that is finished.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Io`] if the map may not be written, else those of reading the dataset as a whole.
    pub fn to_update(map: Map, data: &Path, cfg: &TrainingConfig) -> Result<Self> {
        refuse_read_only(&map)?;
        Self::to_update_from(map, open_dataset(data, cfg)?, cfg)
    }

    /// [`to_update`](Self::to_update) from a dataset that is open already, as
    /// [`to_build_from`](Self::to_build_from) takes it.
    ///
    /// # Errors
    ///
    /// Those of [`to_update`](Self::to_update), but of reading the dataset.
    pub fn to_update_from(map: Map, dataset: Dataset, cfg: &TrainingConfig) -> Result<Self> {
        refuse_read_only(&map)?;
        let dataset = dataset.adjusted(&cfg.adjustment);
        let mut learn = cfg.learn.clone();
        if dataset.clock == Clock::None {
            // Times that only number the visits are no clock's.
            let guard = learn.guard().clone().with_clock(ClockPolicy::Ignore);
            learn = learn.with_guard(guard);
        }
        let extractor = ExtractorConfig::from_id(&map.snapshot().meta().extractor)
            .and_then(|extractor| extractor.build_with(&cfg.models))
            .map_err(|error| error.with_path(map.path()).with_place("extractor"))?;
        let mut training = Self::with(map, extractor, learn, dataset, cfg)?;
        training.set_aside(None, false);
        Ok(training)
    }

    fn with(
        map: Map,
        extractor: Box<dyn Extractor>,
        learn: LearnConfig,
        dataset: Dataset,
        cfg: &TrainingConfig,
    ) -> Result<Self> {
        Ok(Self {
            session: SessionId::derive(&dataset.name),
            leaves_out_blind: false,
            out: map.path().to_owned(),
            learner: OnlineLearner::new(map, learn, cfg.commit_interval)?,
            pool: cfg.pool()?,
            num_images: 0,
            scaled: (None, 0),
            dataset,
            extractor,
            part: None,
            report: TrainingReport::default(),
        })
    }

    /// Leaves out what has another size than the map's images or, of a map that is built, than most
    /// of them; and, where it is known what time it is, impossible times.
    fn set_aside(&mut self, now: Option<Time>, may_grow: bool) {
        let size = self.learner.map().snapshot().meta().image_size;
        self.scaled = self.dataset.set_aside_growing(now, size, may_grow);
        self.num_images = self.dataset.entries.len();
        self.report.problems.append(&mut self.dataset.problems);
    }

    /// How many images are learnt, those that the map has already with them.
    pub fn num_images(&self) -> usize {
        self.num_images
    }

    /// The size that the images have or are scaled to, and how many are scaled to it.
    pub fn scaled(&self) -> (Option<(u32, u32)>, usize) {
        self.scaled
    }

    /// What the dataset is called.
    pub fn dataset_name(&self) -> &str {
        &self.dataset.name
    }

    /// Whether the dataset's times are times, or only number the visits.
    pub fn clock(&self) -> Clock {
        self.dataset.clock
    }

    /// The map as it is so far: MAP.part until [`finish`](Self::finish), where one is built.
    pub fn map(&self) -> &Map {
        self.learner.map()
    }

    /// The learner, with what is quarantined.
    pub fn learner(&self) -> &OnlineLearner {
        &self.learner
    }

    /// What became of the images so far.
    pub fn report(&self) -> &TrainingReport {
        &self.report
    }

    /// Learns what the map does not have yet; false if it was told to stop.
    ///
    /// `should_stop` is called before each image, on any thread; `on_step` on the caller's.
    ///
    /// # Errors
    ///
    /// Those of the map's file. Images that cannot be used are problems, not errors.
    pub fn learn(
        &mut self,
        should_stop: &(dyn Fn() -> bool + Sync),
        on_step: &mut dyn FnMut(Step<'_>),
    ) -> Result<bool> {
        let known = self.known_visits();
        let entries = std::mem::take(&mut self.dataset.entries);
        let pending: Vec<&Entry> = (entries.iter())
            .filter(|entry| !known.contains(&(entry.place.clone(), entry.time, entry.id.clone())))
            .collect();
        let mut num_done = entries.len() - pending.len();
        if num_done > 0 {
            on_step(Step::Resumed {
                num_known: num_done,
            });
        }
        let num_threads = match &self.pool {
            Some(pool) => pool.current_num_threads(),
            None => rayon::current_num_threads(),
        };
        for chunk in pending.chunks(IMAGES_PER_THREAD * num_threads) {
            let extract = || -> Vec<_> {
                (chunk.par_iter())
                    .map(|entry| (!should_stop()).then(|| self.extract(entry)))
                    .collect()
            };
            let extracted = match &self.pool {
                Some(pool) => pool.install(extract),
                None => extract(),
            };
            for (entry, extracted) in chunk.iter().zip(extracted) {
                let Some(extracted) = extracted.filter(|_| !should_stop()) else {
                    return Ok(false);
                };
                match extracted.and_then(|image| self.observe(entry, &image, on_step)) {
                    Ok(()) => {}
                    // The same image by another name.
                    Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                        self.report.num_known += 1;
                    }
                    Err(error) => self.report.problems.push(Problem::of(&entry.id, error)),
                }
                num_done += 1;
                on_step(Step::Done { num_done });
            }
            if self.commits_early() && self.learner.is_commit_due() {
                let generation = self.learner.commit()?.snapshot.generation();
                on_step(Step::Committed { generation });
            }
        }
        Ok(true)
    }

    /// The visits that the map has learnt or holds.
    ///
    /// Whatever run it was: a folder may have been renamed, an image located before.
    fn known_visits(&self) -> HashSet<(PlaceKey, Time, String)> {
        let snapshot = self.learner.map().snapshot();
        let visits = (snapshot.nodes().iter())
            .flat_map(|node| node.visits().iter().map(move |visit| (node, visit)))
            .map(|(node, visit)| (node.key().clone(), visit.time, visit.source.clone()));
        let held = self.learner.learner().held();
        let held = (held.visits().iter().chain(held.given_up()))
            .map(|visit| (visit.place.clone(), visit.time, visit.source.clone()));
        visits.chain(held).collect()
    }

    fn extract(&self, entry: &Entry) -> Result<Extracted> {
        let (image, mask) = entry.source.load_masked()?;
        Ok(Extracted {
            features: self.extractor.extract(&image, mask.as_ref())?,
            image_size: image.size(),
            gray_range: image.gray_range(mask.as_ref()),
            mask,
        })
    }

    fn observe(
        &mut self,
        entry: &Entry,
        image: &Extracted,
        on_step: &mut dyn FnMut(Step<'_>),
    ) -> Result<()> {
        if self.leaves_out_blind {
            let least = self.learner.learner().cfg().guard().min_features();
            let (num_features, size) = (image.features.len(), image.image_size);
            if let Some(doubt) = blind_doubt(num_features, least, image.gray_range, size) {
                self.report.problems.push(Problem::new(&entry.id, doubt));
                return Ok(());
            }
        }
        let observation = Observation {
            place: entry.place.clone(),
            session: self.session,
            time: entry.time,
            features: &image.features,
            image_size: image.image_size,
            mask: image.mask.as_ref(),
            source: entry.id.clone(),
        };
        let circumstances = Circumstances {
            now: Some(Time::now()),
            is_live: false,
            is_labelled: true,
            gray_range: image.gray_range,
        };
        let learnt = self.learner.observe(&observation, &circumstances)?;
        if learnt.is_same_visit {
            self.report.num_same_visit += 1;
        } else if learnt.doubt.is_some() {
            self.report.num_held += 1;
            self.report.num_given_up += learnt.num_given_up;
            on_step(Step::Held {
                entry,
                learnt: &learnt,
            });
        } else {
            self.report.num_learnt += 1;
            on_step(Step::Learnt {
                entry,
                learnt: &learnt,
            });
        }
        Ok(())
    }

    /// Whether what was learnt is committed before all of it is known.
    pub fn commits_early(&self) -> bool {
        self.learner.learner().cfg().recipe() != Recipe::Reference
    }

    /// Adds what the dataset knows of places, commits, and gives the map its name.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Format`] if nothing could be learnt, else those of the map's file.
    pub fn finish(&mut self) -> Result<Arc<Snapshot>> {
        let snapshot = self.learner.snapshot()?;
        if snapshot.nodes().is_empty() {
            return Err(self.nothing("no image could be learnt"));
        }
        if snapshot
            .nodes()
            .iter()
            .all(|node| node.features().is_empty())
        {
            return Err(
                self.nothing("no image has a feature, so nothing could be located by this map")
            );
        }
        let dataset = &self.dataset;
        // With the reference recipe, what is visible in a new image may change what was visible in
        // an old one; with a budget, something may have been forgotten.
        let committed = (self.learner).commit_with(|snapshot| add_layout(snapshot, dataset))?;
        // A place without a usable image is not in the map, so its edges are not either.
        for edge in &dataset.edges {
            let missing = ([&edge.from, &edge.to].into_iter())
                .find(|key| committed.snapshot.find(key).is_none());
            if let Some(missing) = missing {
                self.report.problems.push(Problem::new(
                    format!("edge {} -> {}", edge.from, edge.to),
                    format!("no image of `{missing}` could be learnt"),
                ));
            }
        }
        if let Some(part) = &self.part {
            Map::rename(part, &self.out)?;
        }
        Ok(committed.snapshot)
    }

    fn nothing(&self, message: &str) -> Error {
        let help = match self.report.problems.first() {
            Some(first) => format!("the first problem: {first}"),
            None => "`chronotope dataset check` finds what is wrong with a folder".into(),
        };
        self.remove_if_empty();
        Error::new(ErrorKind::Format, message)
            .with_path(&self.out)
            .with_help(help)
    }

    /// Commits what was learnt, if that can be gone on with, and gives the number of visits that the
    /// map has. After an error nothing is committed, but what was is counted.
    ///
    /// # Errors
    ///
    /// Those of the map's file.
    pub fn stop(&mut self) -> Result<usize> {
        if self.commits_early() {
            self.learner.commit()?;
        }
        Ok(self.num_safe())
    }

    /// How many visits are safe in the map's file; a part without any is removed.
    pub fn num_safe(&self) -> usize {
        self.remove_if_empty();
        self.learner.map().snapshot().summary().num_visits
    }

    /// A part without visits would only be in the way.
    fn remove_if_empty(&self) {
        if let Some(part) = &self.part
            && self.learner.map().snapshot().nodes().is_empty()
        {
            let _ = std::fs::remove_file(part);
        }
    }
}

/// Where the map is kept while it is not finished.
fn part_of(map: &Path) -> PathBuf {
    let mut name = map.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

fn open_dataset(data: &Path, cfg: &TrainingConfig) -> Result<Dataset> {
    let (manifest, data_dir) = Manifest::locate(data)?;
    Dataset::read(&manifest, &data_dir, &cfg.reading)
}

fn refuse_read_only(map: &Map) -> Result<()> {
    if map.is_read_only() {
        return Err(Error::new(ErrorKind::Io, "this map may not be written")
            .with_path(map.path())
            .with_help("change the rights or copy it"));
    }
    Ok(())
}

/// Adds the poses of places and the edges between them, as far as the map has the places.
fn add_layout(snapshot: &mut Snapshot, dataset: &Dataset) -> Result<()> {
    for node in snapshot.nodes_mut() {
        let pose = dataset.poses.get(node.key()).copied();
        if pose.is_some() && node.pose() != pose {
            Arc::make_mut(node).set_pose(pose)?;
        }
    }
    for edge in &dataset.edges {
        if ([&edge.from, &edge.to].into_iter()).all(|key| snapshot.find(key).is_some()) {
            snapshot.add_edge(edge.clone())?;
        }
    }
    Ok(())
}

/// The part of an interrupted training like this one, or a new one.
fn open_part(part: &Path, meta: MapMeta) -> Result<Map> {
    match std::fs::symlink_metadata(part) {
        Err(_) => return Map::create(part, meta),
        // Nothing was ever written to it.
        Ok(found) if found.is_file() && found.len() == 0 => {
            std::fs::remove_file(part).map_err(|cause| Error::io(part, cause))?;
            return Map::create(part, meta);
        }
        Ok(_) => {}
    }
    let map = Map::open(part).map_err(|error| {
        let before = error
            .help()
            .map_or_else(String::new, |help| format!("{help}; or "));
        error.with_help(format!("{before}remove it to start again"))
    })?;
    if map.snapshot().meta().uuid != meta.uuid {
        return Err(Error::new(
            ErrorKind::AlreadyExists,
            "this is part of a build from another dataset or with other numbers",
        )
        .with_path(part)
        .with_help("give the same arguments as then, choose another name, or remove it"));
    }
    Ok(map)
}

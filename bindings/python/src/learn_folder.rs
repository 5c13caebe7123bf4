//! How does a folder of images become a map, or more of a map, while Ctrl-C is heard?
//!
//! The same steps with the same numbers as `chronotope map build` and `map update`, so that the same
//! folder gives the same digest: visits in order of time, learnt into `MAP.part`, committed every
//! second; the finished map is renamed. A test compares the two.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use chronotope::dataset::{Clock, Dataset, Entry, Manifest, Problem, ReadOptions, blind_doubt};
use chronotope::feature::{Extractor, ExtractorConfig, Features, GrayImage, StarBriefConfig};
use chronotope::learn::{Circumstances, ClockPolicy, Judge, LearnConfig, Observation, Recipe};
use chronotope::localize::Preset;
use chronotope::map::{Map, MapMeta, PlaceKey, SessionId, Snapshot, derived_uuid};
use chronotope::robot::OnlineLearner;
use chronotope::time::Zone;
use chronotope::{Error, ErrorKind, Time};
use rayon::prelude::*;

use crate::failure::{Result, check_interrupt};
use crate::map_changes::never_overwritten;
use crate::progress::Progress;

/// Images that each thread extracts before they are learnt.
const IMAGES_PER_THREAD: usize = 8;

/// Commits are at least this far apart.
const COMMIT_INTERVAL: Duration = Duration::from_secs(1);

/// What came of a folder.
#[derive(Clone, Debug, Default)]
pub(crate) struct Report {
    pub(crate) num_learnt: usize,
    pub(crate) num_held: usize,
    pub(crate) num_same_visit: usize,
    pub(crate) num_known: usize,
    /// What was left out, for people.
    pub(crate) problems: Vec<String>,
}

impl Report {
    /// Says what was left out to whoever listens.
    pub(crate) fn log(&self) {
        for problem in &self.problems {
            tracing::warn!("left out: {problem}");
        }
    }
}

/// A folder that is being learnt.
pub(crate) struct Folder {
    dataset: Dataset,
    session: SessionId,
    extractor: Box<dyn Extractor>,
    learner: OnlineLearner,
    out: PathBuf,
    /// The map's name until it is finished, if that is another.
    part: Option<PathBuf>,
    leaves_out_blind: bool,
    report: Report,
}

struct Extracted {
    features: Features,
    image_size: (u32, u32),
    gray_range: Option<(u8, u8)>,
    mask: Option<GrayImage>,
}

impl Folder {
    /// For a new map.
    pub(crate) fn to_build(
        data: &Path,
        out: &Path,
        preset: Preset,
        cfg: LearnConfig,
        zone: Option<&Zone>,
    ) -> chronotope::Result<Self> {
        let (manifest, dataset) = open_dataset(data, zone)?;
        let judges = cfg.guard().judge() == Judge::Updates;
        let cfg = cfg.for_building();
        let extractor = ExtractorConfig::StarBrief(
            StarBriefConfig::default().with_num_features(cfg.features_per_visit()),
        )
        .build()?;
        let mut part = out.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let text = toml::to_string(&cfg)
            .map_err(|cause| Error::new(ErrorKind::Config, cause.to_string()))?;
        let seed = [
            &dataset.name,
            &dataset.sha256(),
            &extractor.id(),
            preset.name(),
            &text,
        ]
        .join("\n");
        let meta = MapMeta {
            zone: zone.map_or_else(
                || manifest.time.zone.clone(),
                |zone| Some(zone.name().to_owned()),
            ),
            ..MapMeta::new(derived_uuid(&seed), extractor.id(), preset.name())
        };
        let map = open_part(&part, meta)?;
        let mut folder = Self::with(map, extractor, cfg, dataset)?;
        out.clone_into(&mut folder.out);
        folder.part = Some(part);
        folder.leaves_out_blind = judges;
        folder.set_aside(judges.then(Time::now));
        Ok(folder)
    }

    /// For a map that is finished.
    pub(crate) fn to_update(
        data: &Path,
        path: &Path,
        mut cfg: LearnConfig,
    ) -> chronotope::Result<Self> {
        let map = Map::open(path)?;
        let (_, dataset) = open_dataset(data, None)?;
        if dataset.clock == Clock::None {
            // Times that only number the visits are no clock's.
            let guard = cfg.guard().clone().with_clock(ClockPolicy::Ignore);
            cfg = cfg.with_guard(guard);
        }
        let extractor = ExtractorConfig::from_id(&map.snapshot().meta.extractor)
            .and_then(|extractor| extractor.build())
            .map_err(|error| error.with_path(map.path()).with_place("extractor"))?;
        let mut folder = Self::with(map, extractor, cfg, dataset)?;
        folder.set_aside(None);
        Ok(folder)
    }

    fn with(
        map: Map,
        extractor: Box<dyn Extractor>,
        cfg: LearnConfig,
        dataset: Dataset,
    ) -> chronotope::Result<Self> {
        Ok(Self {
            session: SessionId::derive(&dataset.name),
            leaves_out_blind: false,
            out: map.path().to_owned(),
            learner: OnlineLearner::new(map, cfg, COMMIT_INTERVAL)?,
            dataset,
            extractor,
            part: None,
            report: Report::default(),
        })
    }

    /// Leaves out what has another size than the map's images or, of a map that is built, than most
    /// of them; and, where it is known what time it is, impossible times.
    fn set_aside(&mut self, now: Option<Time>) {
        let size = self.learner.map().snapshot().meta.image_size;
        self.dataset.set_aside(now, size);
        let problems = std::mem::take(&mut self.dataset.problems);
        self.report
            .problems
            .extend(problems.iter().map(ToString::to_string));
    }

    pub(crate) fn num_images(&self) -> usize {
        self.dataset.entries.len()
    }

    /// Learns all of it, and gives the finished map.
    ///
    /// After Ctrl-C what was learnt is committed, and the same call goes on.
    pub(crate) fn learn(
        mut self,
        pool: &rayon::ThreadPool,
        bar: &mut Progress,
    ) -> Result<(Map, Report)> {
        if let Err(failure) = self.learn_entries(pool, bar) {
            if self.commits_early() {
                self.learner.commit()?;
            }
            self.remove_if_empty();
            return Err(failure);
        }
        let snapshot = self.learner.snapshot()?;
        let nothing = if snapshot.nodes.is_empty() {
            Some("no image could be learnt")
        } else if snapshot.nodes.iter().all(|node| node.features.is_empty()) {
            Some("no image has a feature, so nothing could be located by this map")
        } else {
            None
        };
        if let Some(nothing) = nothing {
            self.report.log();
            self.remove_if_empty();
            let why = self.report.problems.first().cloned();
            let help = why.map_or_else(
                || "`chronotope dataset check` finds all problems".into(),
                |first| format!("the first problem: {first}"),
            );
            return Err(Error::new(ErrorKind::Format, nothing)
                .with_path(&self.out)
                .with_help(help)
                .into());
        }
        self.finish()?;
        let Self {
            learner,
            out,
            part,
            report,
            ..
        } = self;
        let map = learner.into_map();
        let map = if part.is_some() {
            drop(map);
            Map::open(&out)?
        } else {
            map
        };
        Ok((map, report))
    }

    fn learn_entries(&mut self, pool: &rayon::ThreadPool, bar: &mut Progress) -> Result<()> {
        let known = self.known_visits();
        let entries = std::mem::take(&mut self.dataset.entries);
        let pending: Vec<&Entry> = (entries.iter())
            .filter(|entry| !known.contains(&(entry.place.clone(), entry.time, entry.id.clone())))
            .collect();
        bar.advance(entries.len() - pending.len())?;
        for chunk in pending.chunks(IMAGES_PER_THREAD * pool.current_num_threads()) {
            let extracted: Vec<_> =
                pool.install(|| chunk.par_iter().map(|entry| self.extract(entry)).collect());
            for (entry, extracted) in chunk.iter().zip(extracted) {
                match extracted.and_then(|image| self.observe(entry, &image)) {
                    Ok(()) => {}
                    // The same image by another name.
                    Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                        self.report.num_known += 1;
                    }
                    Err(error) => {
                        let problem = Problem::of(&entry.id, error);
                        self.report.problems.push(problem.to_string());
                    }
                }
            }
            check_interrupt()?;
            bar.advance(chunk.len())?;
            if self.commits_early() && self.learner.is_commit_due() {
                let generation = self.learner.commit()?.snapshot.generation;
                tracing::info!(generation, "committed");
            }
        }
        Ok(())
    }

    /// The visits that the map has learnt or holds, whatever run it was.
    fn known_visits(&self) -> HashSet<(PlaceKey, Time, String)> {
        let snapshot = self.learner.map().snapshot();
        let visits = (snapshot.nodes.iter())
            .flat_map(|node| node.visits.iter().map(move |visit| (node, visit)))
            .map(|(node, visit)| (node.key.clone(), visit.time, visit.source.clone()));
        let held = self.learner.learner().held();
        let held = (held.visits().iter().chain(held.given_up()))
            .map(|visit| (visit.place.clone(), visit.time, visit.source.clone()));
        visits.chain(held).collect()
    }

    fn extract(&self, entry: &Entry) -> chronotope::Result<Extracted> {
        let (image, mask) = entry.source.load_masked()?;
        Ok(Extracted {
            features: self.extractor.extract(&image, mask.as_ref())?,
            image_size: image.size(),
            gray_range: image.gray_range(mask.as_ref()),
            mask,
        })
    }

    fn observe(&mut self, entry: &Entry, image: &Extracted) -> chronotope::Result<()> {
        if self.leaves_out_blind {
            let least = self.learner.learner().cfg().guard().min_features();
            if let Some(doubt) = blind_doubt(image.features.len(), least, image.gray_range) {
                let problem = Problem::new(&entry.id, doubt);
                self.report.problems.push(problem.to_string());
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
        } else if let Some(doubt) = &learnt.doubt {
            self.report.num_held += 1;
            tracing::warn!("held: {}: {doubt}", entry.id);
        } else {
            self.report.num_learnt += 1;
        }
        Ok(())
    }

    fn commits_early(&self) -> bool {
        self.learner.learner().cfg().recipe() != Recipe::Reference
    }

    /// Adds what the dataset knows of places, commits, and gives the map its name.
    fn finish(&mut self) -> chronotope::Result<()> {
        let dataset = &self.dataset;
        let committed = self
            .learner
            .commit_with(|snapshot| add_layout(snapshot, dataset))?;
        // A place without a usable image is not in the map, so its edges are not either.
        for edge in &dataset.edges {
            let missing = ([&edge.from, &edge.to].into_iter())
                .find(|key| committed.snapshot.find(key).is_none());
            if let Some(missing) = missing {
                let problem = Problem::new(
                    format!("edge {} -> {}", edge.from, edge.to),
                    format!("no image of `{missing}` could be learnt"),
                );
                self.report.problems.push(problem.to_string());
            }
        }
        match &self.part {
            Some(part) => Map::rename(part, &self.out).map_err(never_overwritten),
            None => Ok(()),
        }
    }

    /// A part without visits would only be in the way.
    fn remove_if_empty(&self) {
        if let Some(part) = &self.part
            && self.learner.map().snapshot().nodes.is_empty()
        {
            let _ = std::fs::remove_file(part);
        }
    }
}

fn open_dataset(data: &Path, zone: Option<&Zone>) -> chronotope::Result<(Manifest, Dataset)> {
    let (manifest, data_dir) = Manifest::locate(data)?;
    let options = ReadOptions {
        zone: zone.cloned(),
        ..ReadOptions::default()
    };
    let dataset = Dataset::read(&manifest, &data_dir, &options)?;
    if dataset.clock == Clock::None {
        tracing::warn!(
            "the times of `{}` only number its visits: localise with method=\"static\" or an \
             experience method",
            dataset.name
        );
    }
    Ok((manifest, dataset))
}

/// Adds the poses of places and the edges between them, as far as the map has the places.
fn add_layout(snapshot: &mut Snapshot, dataset: &Dataset) -> chronotope::Result<()> {
    for node in &mut snapshot.nodes {
        let pose = dataset.poses.get(&node.key).copied();
        if pose.is_some() && node.pose != pose {
            Arc::make_mut(node).pose = pose;
        }
    }
    for edge in &dataset.edges {
        if ([&edge.from, &edge.to].into_iter()).all(|key| snapshot.find(key).is_some()) {
            snapshot.add_edge(edge.clone())?;
        }
    }
    Ok(())
}

/// The part of an interrupted build like this one, or a new one.
fn open_part(part: &Path, meta: MapMeta) -> chronotope::Result<Map> {
    match std::fs::symlink_metadata(part) {
        Err(_) => return Map::create(part, meta),
        // Nothing was ever written to it.
        Ok(found) if found.is_file() && found.len() == 0 => {
            std::fs::remove_file(part).map_err(|cause| Error::io(part, cause))?;
            return Map::create(part, meta);
        }
        Ok(_) => {}
    }
    let map = Map::open(part).map_err(|error| error.with_help("remove it to start again"))?;
    if map.snapshot().meta.uuid != meta.uuid {
        return Err(Error::new(
            ErrorKind::AlreadyExists,
            "this is part of a build from another dataset or with other numbers",
        )
        .with_path(part)
        .with_help("give the same arguments as then, choose another name, or remove it"));
    }
    Ok(map)
}

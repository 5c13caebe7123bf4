//! How does a folder of images become a map, or more of a map?
//!
//! Visits are learnt in order of time into `MAP.part`, and committed every few seconds. Only the
//! finished map gets the name MAP, so what bears it is whole. The same command goes on where an
//! interrupted one stopped: the part's UUID is derived from dataset, extractor and configuration,
//! so a part of another build is refused, and visits it holds (same session, place, time and
//! source) are not read again. The reference recipe (preset `lttl`) can write its log only once all
//! images are known: it commits once, at the end, and starts again if it is interrupted.
//!
//! An update learns into the map itself: each commit is a generation that can be returned to.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use rayon::prelude::*;

use super::arguments::{ConfigArgs, named};
use super::config::Config;
use super::interrupt;
use super::new_map::{finish, part_of, refuse_existing};
use super::outcome::Outcome;
use super::output::{Output, contents};
use super::progress::Progress;
use super::reading::ReadingArgs;
use super::warnings::{print_held, print_num_held};
use chronotope::dataset::{Clock, Dataset, Entry, Manifest, Problem, blind_doubt};
use chronotope::error::{Error, ErrorKind};
use chronotope::feature::{Extractor, ExtractorConfig, Features, GrayImage, StarBriefConfig};
use chronotope::learn::{
    Circumstances, ClockPolicy, Judge, KeepAppearances, LearnConfig, Observation, Recipe,
};
use chronotope::localize::Preset;
use chronotope::map::{Map, MapMeta, PlaceKey, SessionId, Snapshot, derived_uuid};
use chronotope::robot::OnlineLearner;
use chronotope::time::{Time, Zone};

/// Images that each thread extracts before they are learnt.
const IMAGES_PER_THREAD: usize = 8;

/// Learn a map from images of known places and times.
///
/// Ctrl-C loses nothing: visits are committed to MAP.part every few seconds, and the same command
/// goes on where it stopped; the finished map is then renamed to MAP. With the reference recipe
/// (preset `lttl`) visibility is known only once all images are: it commits once, at the end.
/// Images that cannot be used are left out, counted and listed: broken files, images of another
/// size than most, with nothing to see, of a clock that was never set. Exit code 0 if all were
/// learnt, 1 if some were left out, 2 if there is no map.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map build --data photos/ --out street.map
  chronotope map build --data datasets/stromovka.toml --out park.map --preset lttl
  chronotope map build --print-config > numbers.toml
  chronotope map build --data photos/ --out street.map --config numbers.toml --keep-appearances all")]
pub(super) struct BuildArgs {
    /// A folder with an index.csv (or in a known layout), or a manifest (*.toml).
    #[arg(
        long,
        value_name = "DIR|MANIFEST",
        required_unless_present = "print_config"
    )]
    data: Option<PathBuf>,
    /// The file to write; one that exists is never overwritten.
    #[arg(long, value_name = "MAP", required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Where all numbers come from: our own (default), or the recipe of the FreMEn authors'
    /// benchmark.
    #[arg(long, default_value = "default", value_parser = named::<Preset>(Preset::ALL.map(Preset::name)))]
    preset: Preset,
    #[command(flatten)]
    config: ConfigArgs,
    /// Which visits keep their own features, for the experience methods (of the preset if not
    /// given).
    #[arg(long, value_name = "WHICH")]
    keep_appearances: Option<Keep>,
    #[command(flatten)]
    commits: CommitArgs,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// Learn more images of known places and times into a map.
///
/// Visits that the map has already (same place, time and image, whatever the folder is called) are
/// not learnt again, so the same command can be repeated. Every few seconds what was learnt is
/// committed as a generation, and `map rollback` returns to any of them. With the reference recipe
/// (preset `lttl`) all of the map is written anew, once, at the end. Give the numbers that the map
/// was built with. Exit code 0 if nothing was left out, 1 if something was or visits are held,
/// because they clearly show another place or next to nothing, 2 if it failed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map update street.map --data june/
  chronotope map update street.map --data june/ --config numbers.toml")]
pub(super) struct UpdateArgs {
    /// The map file.
    map: PathBuf,
    /// A folder with an index.csv (or in a known layout), or a manifest (*.toml).
    #[arg(long, value_name = "DIR|MANIFEST")]
    data: PathBuf,
    /// TOML with the table [learn]; a key that is given replaces that of the map's preset.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Which visits keep their own features, for the experience methods (of the preset if not
    /// given).
    #[arg(long, value_name = "WHICH")]
    keep_appearances: Option<Keep>,
    #[command(flatten)]
    commits: CommitArgs,
    #[command(flatten)]
    reading: ReadingArgs,
}

#[derive(Clone, Copy, Debug, Args)]
struct CommitArgs {
    /// Seconds of learning that a crash may cost: commits are at least this far apart.
    #[arg(long = "commit-every", value_name = "SECONDS", default_value_t = 1)]
    every_s: u32,
}

impl CommitArgs {
    fn interval(self) -> Duration {
        Duration::from_secs(u64::from(self.every_s))
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Keep {
    None,
    Experiences,
    All,
}

impl From<Keep> for KeepAppearances {
    fn from(keep: Keep) -> Self {
        match keep {
            Keep::None => Self::None,
            Keep::Experiences => Self::Experiences,
            Keep::All => Self::All,
        }
    }
}

pub(super) fn run(args: &BuildArgs, out: &mut Output) -> Result<Outcome> {
    let mut config = Config::read(args.config.config.as_deref(), args.preset)?;
    if let Some(keep) = args.keep_appearances {
        config.learn = config.learn.with_keep_appearances(keep.into());
    }
    if args.config.print_config {
        return config.print(out);
    }
    let (Some(data), Some(map)) = (&args.data, &args.out) else {
        anyhow::bail!("--data and --out are missing");
    };
    refuse_existing(map)?;
    let (manifest, dataset) = open_dataset(data, &args.reading)?;
    interrupt::watch()?;
    let zone = args.reading.zone.as_ref().map(Zone::name);
    if let Some(zone) = zone.or(manifest.time.zone.as_deref()) {
        note!(
            "note: the map keeps its zone, {zone}, but rhythms of its places are those of UTC: when \
             summer time begins or ends they are an hour off until they are learnt anew"
        );
    }
    let judges = config.learn.guard().judge() == Judge::Updates;
    let mut build = Build::new(
        args.preset,
        config.learn.for_building(),
        &manifest,
        dataset,
        map,
        args.commits.interval(),
        args.reading.zone.as_ref(),
    )?;
    build.leaves_out_blind = judges;
    build.set_aside(judges.then(Time::now));
    build.run(out)
}

pub(super) fn update(args: &UpdateArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.map)?;
    if map.is_read_only() {
        return Err(Error::new(ErrorKind::Io, "this map may not be written")
            .with_path(&args.map)
            .with_help("change the rights or copy it")
            .into());
    }
    let mut config = Config::read_for(&map.snapshot().meta, args.config.as_deref())?;
    if let Some(keep) = args.keep_appearances {
        config.learn = config.learn.with_keep_appearances(keep.into());
    }
    let (_, dataset) = open_dataset(&args.data, &args.reading)?;
    if dataset.clock == Clock::None {
        // Times that only number the visits are no clock's.
        let guard = (config.learn.guard().clone()).with_clock(ClockPolicy::Ignore);
        config.learn = config.learn.with_guard(guard);
    }
    interrupt::watch()?;
    let mut build = Build::onto(map, config.learn, dataset, args.commits.interval())?;
    build.set_aside(None);
    build.run(out)
}

fn open_dataset(data: &Path, reading: &ReadingArgs) -> Result<(Manifest, Dataset)> {
    let (manifest, data_dir) = Manifest::locate(data)?;
    let dataset = Dataset::read(&manifest, &data_dir, &reading.read_options())?
        .adjusted(&reading.load_options());
    if dataset.clock == Clock::None {
        note!(
            "warning: the times of `{}` only number its visits: localise with --method static or an \
             experience method",
            dataset.name
        );
    }
    Ok((manifest, dataset))
}

/// A build that is under way.
struct Build {
    dataset: Dataset,
    session: SessionId,
    extractor: Box<dyn Extractor>,
    learner: OnlineLearner,
    /// The map's name once it is finished.
    out: PathBuf,
    /// Its name until then, if that is another.
    part: Option<PathBuf>,
    problems: Vec<Problem>,
    /// Images with nothing to see are problems; what holds visits judges them itself.
    leaves_out_blind: bool,
    num_learnt: usize,
    num_same_visit: usize,
    num_held: usize,
    /// Visits held before whose features had to go.
    num_given_up: usize,
    /// Images that the map had learnt by another name.
    num_known: usize,
}

struct Extracted {
    features: Features,
    image_size: (u32, u32),
    gray_range: Option<(u8, u8)>,
    mask: Option<GrayImage>,
}

impl Build {
    fn new(
        preset: Preset,
        cfg: LearnConfig,
        manifest: &Manifest,
        dataset: Dataset,
        out: &Path,
        commit_interval: Duration,
        zone: Option<&Zone>,
    ) -> Result<Self> {
        let extractor = ExtractorConfig::StarBrief(
            StarBriefConfig::default().with_num_features(cfg.features_per_visit()),
        )
        .build()?;
        let part = part_of(out);
        let seed = [
            &dataset.name,
            &dataset.sha256(),
            &extractor.id(),
            preset.name(),
            &toml::to_string(&cfg)?,
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
        let build = Self::with(map, extractor, cfg, dataset, commit_interval)?;
        Ok(Self {
            out: out.to_owned(),
            part: Some(part),
            ..build
        })
    }

    /// An update of a finished map.
    fn onto(
        map: Map,
        cfg: LearnConfig,
        dataset: Dataset,
        commit_interval: Duration,
    ) -> Result<Self> {
        let extractor = ExtractorConfig::from_id(&map.snapshot().meta.extractor)
            .and_then(|extractor| extractor.build())
            .map_err(|error| error.with_path(map.path()).with_place("extractor"))?;
        Self::with(map, extractor, cfg, dataset, commit_interval)
    }

    fn with(
        map: Map,
        extractor: Box<dyn Extractor>,
        cfg: LearnConfig,
        mut dataset: Dataset,
        commit_interval: Duration,
    ) -> Result<Self> {
        Ok(Self {
            session: SessionId::derive(&dataset.name),
            problems: std::mem::take(&mut dataset.problems),
            leaves_out_blind: false,
            out: map.path().to_owned(),
            learner: OnlineLearner::new(map, cfg, commit_interval)?,
            dataset,
            extractor,
            part: None,
            num_learnt: 0,
            num_same_visit: 0,
            num_held: 0,
            num_given_up: 0,
            num_known: 0,
        })
    }

    /// Leaves out what has another size than the map's images or, of a map that is built, than most
    /// of them; and, where it is known what time it is, impossible times.
    fn set_aside(&mut self, now: Option<Time>) {
        let size = self.learner.map().snapshot().meta.image_size;
        let (size, num_scaled) = self.dataset.set_aside(now, size);
        if let Some((width, height)) = size.filter(|_| num_scaled > 0) {
            note!(
                "note: {num_scaled} images of another resolution are scaled to {width} x {height} px"
            );
        }
        self.problems.append(&mut self.dataset.problems);
    }

    fn run(mut self, out: &mut Output) -> Result<Outcome> {
        match self.learn() {
            Ok(true) => {}
            Ok(false) => return self.stop(),
            Err(error) => return Err(self.give_up(error)),
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
            self.list_problems();
            self.remove_if_empty();
            return Err(Error::new(ErrorKind::Format, nothing)
                .with_path(&self.out)
                .with_help("see the problems above; `chronotope dataset check` finds them all")
                .into());
        }
        match self.finish() {
            Ok(snapshot) => {
                self.list_problems();
                if self.num_known > 0 {
                    note!("{} images were learnt before", self.num_known);
                }
                self.count_same_visit();
                self.count_held();
                let summary = snapshot.summary();
                out.line(format_args!(
                    "{}: {}, {} appearances kept",
                    self.out.display(),
                    contents(&summary, format_args!(" ({} learnt now)", self.num_learnt)),
                    summary.num_appearances,
                ))?;
                Ok(Outcome::of_check(
                    self.problems.is_empty() && self.num_held == 0,
                ))
            }
            Err(error) => Err(self.give_up(error)),
        }
    }

    /// Learns what the part does not hold yet; false if it was interrupted.
    fn learn(&mut self) -> Result<bool> {
        let known = self.known_visits();
        let entries = std::mem::take(&mut self.dataset.entries);
        let pending: Vec<&Entry> = (entries.iter())
            .filter(|entry| !known.contains(&(entry.place.clone(), entry.time, entry.id.clone())))
            .collect();
        let num_known = entries.len() - pending.len();
        if num_known > 0 {
            note!(
                "going on: {num_known} of {} visits are in {}",
                entries.len(),
                self.learner.map().path().display()
            );
        }
        let progress = Progress::new("learning", entries.len());
        let chunk_len = IMAGES_PER_THREAD * rayon::current_num_threads();
        let mut num_done = num_known;
        for chunk in pending.chunks(chunk_len) {
            let extracted: Vec<_> = chunk
                .par_iter()
                .map(|entry| (!interrupt::is_requested()).then(|| self.extract(entry)))
                .collect();
            for (entry, extracted) in chunk.iter().zip(extracted) {
                let Some(extracted) = extracted.filter(|_| !interrupt::is_requested()) else {
                    return Ok(false);
                };
                match extracted.and_then(|image| self.observe(entry, &image)) {
                    Ok(()) => {}
                    // The same image by another name.
                    Err(error) if error.kind() == ErrorKind::AlreadyExists => self.num_known += 1,
                    Err(error) => {
                        self.problems.push(Problem::of(&entry.id, error));
                    }
                }
                num_done += 1;
                progress.reach(num_done);
            }
            if self.commits_early() && self.learner.is_commit_due() {
                let committed = self.learner.commit()?;
                let generation = committed.snapshot.generation;
                tracing::info!(generation, visits = num_done, "committed");
            }
        }
        Ok(true)
    }

    /// The visits that the part has learnt or holds.
    ///
    /// Whatever run it was: a folder may have been renamed, an image located before.
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
                self.problems.push(Problem::new(&entry.id, doubt));
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
        let learnt = (self.learner).observe(&observation, &circumstances)?;
        if learnt.is_same_visit {
            self.num_same_visit += 1;
            return Ok(());
        }
        if let Some(doubt) = &learnt.doubt {
            self.num_held += 1;
            self.num_given_up += learnt.num_given_up;
            print_held(&entry.id, doubt, &self.out);
            return Ok(());
        }
        self.num_learnt += 1;
        tracing::debug!(
            place = entry.place.as_str(),
            time = %entry.time,
            seen = learnt.num_seen,
            born = learnt.num_born,
            experience = learnt.experience,
            "learnt"
        );
        Ok(())
    }

    fn commits_early(&self) -> bool {
        self.learner.learner().cfg().recipe() != Recipe::Reference
    }

    /// Adds what the dataset knows of places, commits, and gives the map its name.
    fn finish(&mut self) -> Result<Arc<Snapshot>> {
        let dataset = &self.dataset;
        // With the reference recipe, what is visible in a new image may change what was visible in
        // an old one; with a budget, something may have been forgotten.
        let committed = (self.learner).commit_with(|snapshot| add_layout(snapshot, dataset))?;
        // A place without a usable image is not in the map, so its edges are not either.
        for edge in &dataset.edges {
            let ends = [&edge.from, &edge.to];
            let missing = ends
                .into_iter()
                .find(|key| committed.snapshot.find(key).is_none());
            if let Some(missing) = missing {
                self.problems.push(Problem::new(
                    format!("edge {} -> {}", edge.from, edge.to),
                    format!("no image of `{missing}` could be learnt"),
                ));
            }
        }
        if let Some(part) = &self.part {
            finish(part, &self.out)?;
        }
        Ok(committed.snapshot)
    }

    /// Keeps what was learnt, after Ctrl-C.
    fn stop(&mut self) -> Result<Outcome> {
        if self.commits_early() {
            self.learner.commit()?;
        }
        self.list_problems();
        let num_kept = self.learner.map().snapshot().summary().num_visits;
        self.remove_if_empty();
        if num_kept > 0 {
            note!(
                "interrupted: {num_kept} visits are safe in {}; to go on, give the same command again",
                self.learner.map().path().display()
            );
        } else if self.commits_early() {
            note!("interrupted: nothing was learnt yet; to start, give the same command again");
        } else {
            note!(
                "interrupted: the reference recipe writes its map at the end, so nothing is kept; to \
                 start, give the same command again"
            );
        }
        Ok(Outcome::Interrupted)
    }

    /// Says what is left after a failure.
    fn give_up(&self, error: anyhow::Error) -> anyhow::Error {
        self.list_problems();
        let num_kept = self.learner.map().snapshot().summary().num_visits;
        if num_kept == 0 {
            self.remove_if_empty();
            return error;
        }
        note!(
            "note: {num_kept} visits are safe in {}; to go on, give the same command again",
            self.learner.map().path().display()
        );
        error
    }

    /// A part without visits would only be in the way.
    fn remove_if_empty(&self) {
        if let Some(part) = &self.part
            && self.learner.map().snapshot().nodes.is_empty()
        {
            let _ = std::fs::remove_file(part);
        }
    }

    /// Says how many images were no visits of their own.
    fn count_same_visit(&self) {
        if self.num_same_visit > 0 {
            note!(
                "note: {} more images belong to these visits: their place was seen less than {} s \
                 before",
                self.num_same_visit,
                self.learner.learner().cfg().stay_gap_s()
            );
        }
    }

    /// Says how many visits are held, and how many there was no room for.
    fn count_held(&self) {
        if self.num_held == 0 {
            return;
        }
        let held = self.learner.learner().held();
        print_num_held(held.visits().len(), &self.out);
        if self.num_given_up > 0 {
            note!(
                "warning: there is no room for all visits that are held: in this run the features of \
                 {} older ones were given up, which can only be dropped and learnt again from their \
                 images",
                self.num_given_up
            );
        }
    }

    fn list_problems(&self) {
        for problem in &self.problems {
            note!("problem: {problem}");
        }
        match self.problems.len() {
            0 => {}
            1 => note!("1 problem: the above was left out"),
            count => note!("{count} problems: the above were left out"),
        }
    }
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
        if [&edge.from, &edge.to]
            .into_iter()
            .all(|key| snapshot.find(key).is_some())
        {
            snapshot.add_edge(edge.clone())?;
        }
    }
    Ok(())
}

/// The part of an interrupted build like this one, or a new one.
fn open_part(part: &Path, meta: MapMeta) -> Result<Map> {
    match std::fs::symlink_metadata(part) {
        Err(_) => return Ok(Map::create(part, meta)?),
        // Nothing was ever written to it.
        Ok(found) if found.is_file() && found.len() == 0 => {
            std::fs::remove_file(part).map_err(|cause| Error::io(part, cause))?;
            return Ok(Map::create(part, meta)?);
        }
        Ok(_) => {}
    }
    let map = Map::open(part).with_context(|| {
        format!(
            "cannot go on with {} (help: remove it to start again)",
            part.display()
        )
    })?;
    if map.snapshot().meta.uuid != meta.uuid {
        return Err(Error::new(
            ErrorKind::AlreadyExists,
            "this is part of a build from another dataset or with other numbers",
        )
        .with_path(part)
        .with_help("give the same command as then, choose another name, or remove it")
        .into());
    }
    Ok(map)
}

//! The commands `map build` and `map update`: how does a folder of images become a map?
//!
//! [`Training`] does it; here is what people read of it, and how Ctrl-C is heard.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use clap::{Args, ValueEnum};

use super::progress::Progress;
use super::warnings::{print_held, print_num_held};
use chronotope::dataset::Clock;
use chronotope::feature::ExtractorConfig;
use chronotope::learn::{KeepAppearances, LearnConfig};
use chronotope::localize::Preset;
use chronotope::map::{Map, Snapshot};
use chronotope::training::{Step, Training, TrainingConfig};
use chronotope_terminal::arguments::{ConfigArgs, ModelArgs, named};
use chronotope_terminal::config::Config;
use chronotope_terminal::output::contents;
use chronotope_terminal::reading::ReadingArgs;
use chronotope_terminal::{Outcome, Output, interrupt};

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
  chronotope map build --data photos/ --out street.map --config numbers.toml --keep-appearances all
  chronotope map build --data photos/ --out street.map --model eye.onnx --extractor 'onnx:layer=\"relu9\"'")]
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
    /// What finds the features: star-brief (default), orb-brief, fast-brief, agast-brief (with the
    /// cargo feature `opencv`) or onnx (with the cargo feature `onnx`), with what differs from its
    /// defaults; values are JSON.
    #[arg(long, value_name = "KIND:NAME=VALUE,...")]
    extractor: Option<ExtractorConfig>,
    #[command(flatten)]
    model: ModelArgs,
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
    model: ModelArgs,
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
    Map::refuse_existing(map)?;
    interrupt::watch()?;
    let cfg = training(args.preset, config.learn, args.commits, &args.reading)
        .with_extractor(args.extractor.clone())
        .with_models(args.model.models());
    let training = Training::to_build(data, map, &cfg)?;
    Build::new(training, map.clone()).run(out)
}

pub(super) fn update(args: &UpdateArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.map)?;
    let mut config = Config::read_for(map.snapshot().meta(), args.config.as_deref())?;
    if let Some(keep) = args.keep_appearances {
        config.learn = config.learn.with_keep_appearances(keep.into());
    }
    interrupt::watch()?;
    let preset = Preset::Default;
    let cfg = training(preset, config.learn, args.commits, &args.reading)
        .with_models(args.model.models());
    let training = Training::to_update(map, &args.data, &cfg)?;
    Build::new(training, args.map.clone()).run(out)
}

fn training(
    preset: Preset,
    learn: LearnConfig,
    commits: CommitArgs,
    reading: &ReadingArgs,
) -> TrainingConfig {
    TrainingConfig::new(preset, learn)
        .with_reading(reading.read_options())
        .with_adjustment(reading.load_options())
        .with_commit_interval(commits.interval())
}

/// A training that is under way, and the map that will come of it.
struct Build {
    training: Training,
    out: PathBuf,
}

impl Build {
    fn new(training: Training, out: PathBuf) -> Self {
        if training.clock() == Clock::None {
            note!(
                "warning: the times of `{}` only number its visits: localise with --method static or \
                 an experience method",
                training.dataset_name()
            );
        }
        if let (Some((width, height)), num_scaled @ 1..) = training.scaled() {
            note!(
                "note: {num_scaled} images of another resolution are scaled to {width} x {height} px"
            );
        }
        Self { training, out }
    }

    fn run(mut self, out: &mut Output) -> Result<Outcome> {
        match self.learn() {
            Ok(true) => {}
            Ok(false) => return self.stop(),
            Err(error) => return Err(self.give_up(error)),
        }
        let finished = self.training.finish();
        match finished {
            Ok(snapshot) => self.print(&snapshot, out),
            Err(error) => Err(self.give_up(error)),
        }
    }

    /// Learns what the map does not hold yet; false if it was interrupted.
    fn learn(&mut self) -> chronotope::Result<bool> {
        let num_images = self.training.num_images();
        let path = self.training.map().path().to_owned();
        let progress = Progress::new("learning", num_images);
        let out = &self.out;
        self.training
            .learn(&interrupt::is_requested, &mut |step| match step {
                Step::Resumed { num_known } => {
                    note!(
                        "going on: {num_known} of {num_images} visits are in {}",
                        path.display()
                    );
                }
                Step::Held { entry, learnt } => {
                    if let Some(doubt) = &learnt.doubt {
                        print_held(&entry.id, doubt, out);
                    }
                }
                Step::Learnt { entry, learnt } => tracing::debug!(
                    place = entry.place.as_str(),
                    time = %entry.time,
                    seen = learnt.num_seen,
                    born = learnt.num_born,
                    experience = learnt.experience,
                    "learnt"
                ),
                Step::Done { num_done } => progress.reach(num_done),
                Step::Committed { generation } => tracing::info!(generation, "committed"),
                _ => {}
            })
    }

    fn print(&self, snapshot: &Arc<Snapshot>, out: &mut Output) -> Result<Outcome> {
        let report = self.training.report();
        self.list_problems();
        if report.num_known > 0 {
            note!("{} images were learnt before", report.num_known);
        }
        self.count_same_visit();
        self.count_held();
        let summary = snapshot.summary();
        out.line(format_args!(
            "{}: {}, {} appearances kept",
            self.out.display(),
            contents(
                &summary,
                format_args!(" ({} learnt now)", report.num_learnt)
            ),
            summary.num_appearances,
        ))?;
        Ok(Outcome::of_check(
            report.problems.is_empty() && report.num_held == 0,
        ))
    }

    /// Keeps what was learnt, after Ctrl-C.
    fn stop(&mut self) -> Result<Outcome> {
        let num_kept = self.training.stop()?;
        self.list_problems();
        if num_kept > 0 {
            note!(
                "interrupted: {num_kept} visits are safe in {}; to go on, give the same command again",
                self.training.map().path().display()
            );
        } else if self.training.commits_early() {
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
    fn give_up(&self, error: chronotope::Error) -> anyhow::Error {
        self.list_problems();
        let num_kept = self.training.num_safe();
        if num_kept > 0 {
            note!(
                "note: {num_kept} visits are safe in {}; to go on, give the same command again",
                self.training.map().path().display()
            );
        }
        error.into()
    }

    /// Says how many images were no visits of their own.
    fn count_same_visit(&self) {
        let num_same_visit = self.training.report().num_same_visit;
        if num_same_visit > 0 {
            note!(
                "note: {num_same_visit} more images belong to these visits: their place was seen less \
                 than {} s before",
                self.training.learner().learner().cfg().stay_gap_s()
            );
        }
    }

    /// Says how many visits are held, and how many there was no room for.
    fn count_held(&self) {
        let report = self.training.report();
        if report.num_held == 0 {
            return;
        }
        let held = self.training.learner().learner().held();
        print_num_held(held.visits().len(), &self.out);
        if report.num_given_up > 0 {
            note!(
                "warning: there is no room for all visits that are held: in this run the features of \
                 {} older ones were given up, which can only be dropped and learnt again from their \
                 images",
                report.num_given_up
            );
        }
    }

    fn list_problems(&self) {
        let problems = &self.training.report().problems;
        for problem in problems {
            note!("problem: {problem}");
        }
        match problems.len() {
            0 => {}
            1 => note!("1 problem: the above was left out"),
            count => note!("{count} problems: the above were left out"),
        }
    }
}

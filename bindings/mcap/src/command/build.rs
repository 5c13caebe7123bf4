//! The commands `build` and `update`: how does a bag become a map?
//!
//! [`Training`] does it, as for a folder; here is what people read of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use clap::Args;

use super::arguments::{ImageArgs, PlaceArgs};
use chronotope::dataset::Dataset;
use chronotope::feature::{LoadOptions, load_mask};
use chronotope::localize::Preset;
use chronotope::map::{Map, Snapshot};
use chronotope::training::{Step, Training, TrainingConfig};
use chronotope_bags::{Bag, Recording};
use chronotope_terminal::arguments::{ConfigArgs, named};
use chronotope_terminal::config::{Config, preset_of};
use chronotope_terminal::{Outcome, Output, interrupt};

/// Learn a map from the images of a bag.
///
/// The map is the one that the same images in a folder would give, and Ctrl-C loses nothing: the
/// same command goes on where it stopped. Exit code 0 if all images were learnt, 1 if some were left
/// out, 2 if there is no map.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope-bags build monday.mcap --out site.map --places poses:/odom
  chronotope-bags build rosbag2_2024_05_01/ --out site.map --topic /camera/image/compressed \\
      --places tf:map,base_link --radius 3 --every 0.5 --rotate 180 --mask bumper.png
  chronotope-bags build monday.mcap --out site.map --places csv:places.csv")]
pub(crate) struct BuildArgs {
    /// The bag.
    #[arg(required_unless_present = "print_config")]
    bag: Option<PathBuf>,
    /// The file to write; one that exists is never overwritten.
    #[arg(long, value_name = "MAP", required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Where all numbers come from: our own (default), or the recipe of the FreMEn authors'
    /// benchmark.
    #[arg(long, default_value = "default", value_parser = named::<Preset>(Preset::ALL.map(Preset::name)))]
    preset: Preset,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    commits: CommitArgs,
    #[command(flatten)]
    images: ImageArgs,
    #[command(flatten)]
    mask: MaskArgs,
    #[command(flatten)]
    places: PlaceArgs,
}

/// Learn the images of another bag into a map.
///
/// Places are found again by their poses or by their names; new ones are added. Visits that the map
/// has already are not learnt again. Exit code 0 if nothing was left out, 1 if something was or
/// visits are held, 2 if it failed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope-bags update site.map tuesday.mcap --places poses:/odom")]
pub(crate) struct UpdateArgs {
    /// The map file.
    map: PathBuf,
    /// The bag.
    bag: PathBuf,
    /// TOML with the table [learn]; a key that is given replaces that of the map's preset.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    commits: CommitArgs,
    #[command(flatten)]
    images: ImageArgs,
    #[command(flatten)]
    mask: MaskArgs,
    #[command(flatten)]
    places: PlaceArgs,
}

/// What is hidden in every image.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Reading images")]
struct MaskArgs {
    /// An image of the size that is learnt, after --rotate, --crop and --scale; where it is black,
    /// nothing is used.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
}

impl MaskArgs {
    /// The images of a bag as they are learnt.
    fn applied_to(&self, dataset: Dataset, images: &ImageArgs) -> Result<Dataset> {
        let dataset = dataset.adjusted(&images.reading.load_options());
        Ok(match &self.mask {
            Some(mask) => dataset.masked(load_mask(mask, &LoadOptions::default())?),
            None => dataset,
        })
    }
}

#[derive(Clone, Copy, Debug, Args)]
struct CommitArgs {
    /// Seconds of learning that a crash may cost: commits are at least this far apart.
    #[arg(long = "commit-every", value_name = "SECONDS", default_value_t = 1)]
    commit_every_s: u32,
}

pub(crate) fn build(args: &BuildArgs, out: &mut Output) -> Result<Outcome> {
    let config = Config::read(args.config.config.as_deref(), args.preset)?;
    if args.config.print_config {
        return config.print(out);
    }
    let (Some(bag), Some(map)) = (&args.bag, &args.out) else {
        anyhow::bail!("the bag and --out are missing");
    };
    Map::refuse_existing(map)?;
    interrupt::watch()?;
    let bag = Arc::new(Bag::open(bag)?);
    let recording = Recording::read(&bag, &args.places.options(&args.images)?, None)?;
    if let Some([latitude, longitude]) = recording.origin {
        note!(
            "note: positions are in metres from --origin {latitude},{longitude}, which an update has to \
             be given"
        );
    }
    let cfg = TrainingConfig::new(args.preset, config.learn)
        .with_commit_interval(Duration::from_secs(u64::from(args.commits.commit_every_s)));
    let dataset = args.mask.applied_to(recording.dataset, &args.images)?;
    let training = Training::to_build_from(dataset, map, &cfg)?;
    run(training, map, out)
}

pub(crate) fn update(args: &UpdateArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.map)?;
    interrupt::watch()?;
    let bag = Arc::new(Bag::open(&args.bag)?);
    let options = args.places.options(&args.images)?;
    let snapshot = map.snapshot();
    let recording = Recording::read(&bag, &options, Some(&snapshot))?;
    let preset = preset_of(snapshot.meta());
    let config = Config::read(args.config.as_deref(), preset)?;
    let cfg = TrainingConfig::new(preset, config.learn)
        .with_commit_interval(Duration::from_secs(u64::from(args.commits.commit_every_s)));
    let dataset = args.mask.applied_to(recording.dataset, &args.images)?;
    let training = Training::to_update_from(map, dataset, &cfg)?;
    run(training, &args.map, out)
}

fn run(mut training: Training, path: &Path, out: &mut Output) -> Result<Outcome> {
    let num_images = training.num_images();
    let learnt = training.learn(&interrupt::is_requested, &mut |step| match step {
        Step::Resumed { num_known } => {
            note!("going on: {num_known} of {num_images} visits are there");
        }
        Step::Held { entry, learnt } => {
            if let Some(doubt) = &learnt.doubt {
                note!("held: {}: {doubt}", entry.id);
            }
        }
        Step::Done { num_done } => tracing::debug!(num_done, num_images, "learning"),
        Step::Committed { generation } => tracing::info!(generation, "committed"),
        _ => {}
    });
    let finished = match learnt {
        Ok(true) => training.finish(),
        Ok(false) => {
            let num_kept = training.stop()?;
            list_problems(&training);
            note!("interrupted: {num_kept} visits are safe; to go on, give the same command again");
            return Ok(Outcome::Interrupted);
        }
        Err(error) => Err(error),
    };
    list_problems(&training);
    match finished {
        Ok(snapshot) => print(&training, &snapshot, path, out),
        Err(error) => Err(error.into()),
    }
}

fn print(
    training: &Training,
    snapshot: &Snapshot,
    path: &Path,
    out: &mut Output,
) -> Result<Outcome> {
    let report = training.report();
    if report.num_same_visit > 0 {
        note!(
            "note: {} more images belong to these visits: their place was seen less than {} s before",
            report.num_same_visit,
            training.learner().learner().cfg().stay_gap_s()
        );
    }
    if report.num_held > 0 {
        note!(
            "{} visits are held and not learnt: `chronotope map held {}` lists them",
            report.num_held,
            path.display()
        );
    }
    let summary = snapshot.summary();
    out.line(format_args!(
        "{}: {} places, {} visits ({} learnt now), {} features, {} edges",
        path.display(),
        summary.num_places,
        summary.num_visits,
        report.num_learnt,
        summary.num_features,
        snapshot.edges().len(),
    ))?;
    Ok(Outcome::of_check(
        report.problems.is_empty() && report.num_held == 0,
    ))
}

fn list_problems(training: &Training) {
    let problems = &training.report().problems;
    for problem in problems {
        note!("problem: {problem}");
    }
    match problems.len() {
        0 => {}
        1 => note!("1 problem: the above was left out"),
        count => note!("{count} problems: the above were left out"),
    }
}

//! Can this dataset be used?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use super::progress::Progress;
use chronotope::dataset::{CheckOptions, Dataset, Manifest};
use chronotope::feature::{ExtractorConfig, StarBriefConfig};
use chronotope::learn::LearnConfig;
use chronotope::localize::Preset;
use chronotope::time::Time;
use chronotope_terminal::reading::ReadingArgs;
use chronotope_terminal::{Outcome, Output};

/// Decode every image of a dataset, count, and list what is wrong.
///
/// Missing and broken files, crops outside their image, second rows of a place and time,
/// differences from checksums; and what a map would not learn: images of another size than most,
/// with nothing to see, of a clock that was never set. Images with the same pixels are listed, but
/// are no fault. Exit code 1 if there is a problem.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope dataset check photos/
  chronotope dataset check photos/dataset.toml --json")]
pub(super) struct CheckArgs {
    /// A folder with an index.csv (or in a known layout), or a manifest (*.toml).
    #[arg(value_name = "DIR|MANIFEST")]
    path: PathBuf,
    /// One JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reading: ReadingArgs,
}

pub(super) fn run(args: &CheckArgs, out: &mut Output) -> Result<Outcome> {
    let (manifest, data_dir) = Manifest::locate(&args.path)?;
    let dataset = Dataset::read(&manifest, &data_dir, &args.reading.read_options())?
        .adjusted(&args.reading.load_options());
    let guard = LearnConfig::preset(Preset::Default).guard().clone();
    let extractor = ExtractorConfig::StarBrief(StarBriefConfig::default()).build()?;
    let options = CheckOptions {
        now: Some(Time::now()),
        features: Some((extractor, guard.min_features())),
    };
    let mut report = {
        let progress = Progress::new("decoding", dataset.entries.len());
        dataset.check_with(&options, |done, _| progress.reach(done))
    };
    let differences = {
        let progress = Progress::new("comparing checksums of", dataset.entries.len());
        manifest.verify(&dataset, &data_dir, |done, _| progress.reach(done))?
    };
    report.problems.extend(differences);
    if args.json {
        out.json(&report)?;
    } else {
        out.line(&report)?;
    }
    Ok(Outcome::of_check(report.is_clean()))
}

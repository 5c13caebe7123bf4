//! Can this dataset be used?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use super::outcome::Outcome;
use super::output::Output;
use super::progress::Progress;
use chronotope::dataset::{Dataset, Manifest};

/// Decode every image of a dataset, count, and list what is wrong.
///
/// Missing and broken files, crops outside their image, second rows of a place and time,
/// differences from checksums; images with the same pixels are listed, but are no fault. Exit code
/// 1 if there is a problem.
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
}

pub(super) fn run(args: &CheckArgs, out: &mut Output) -> Result<Outcome> {
    let (manifest, data_dir) = Manifest::locate(&args.path)?;
    let dataset = Dataset::open_with(&manifest, &data_dir)?;
    let mut report = {
        let progress = Progress::new("decoding", dataset.entries.len());
        dataset.check(|done, _| progress.reach(done))
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

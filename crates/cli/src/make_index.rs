//! Which index does a folder in another layout need?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use chronotope::dataset::{IndexOptions, IndexSource, MadeIndex};
use chronotope::time::Zone;
use chronotope_terminal::arguments::named;
use chronotope_terminal::{Outcome, Output};

/// Print the index.csv of a folder of images in another layout.
///
/// Look it over, then save it in the folder. The layouts robotcar, tum and euroc have poses and no
/// places: an image without a place within the radius begins one. Exit code 1 if images are left
/// out.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope dataset index photos/ --from folders > photos/index.csv
  chronotope dataset index run/ --from file-names --pattern '{place}_{unix_s}'
  chronotope dataset index freiburg2_desk/ --from tum --radius-m 0.5
  chronotope dataset index MH_01_easy/ --from euroc
  chronotope dataset index 2014-05-19-13-20-57/mono_left/ --from robotcar --radius-m 10")]
pub(super) struct MakeIndexArgs {
    /// The folder.
    dir: PathBuf,
    /// How it is laid out.
    #[arg(long, value_parser = named::<IndexSource>(IndexSource::ALL.map(IndexSource::name)))]
    from: IndexSource,
    /// What names of files say, as in a manifest: fields `{place}`, `{year:4}`, `{unix_s}` and
    /// others.
    #[arg(long)]
    pattern: Option<String>,
    /// The zone of dates without an offset, such as Europe/Prague.
    #[arg(long, value_name = "ZONE")]
    zone: Option<Zone>,
    /// How near to each other images of one place were taken, m.
    #[arg(long, value_name = "METRES", default_value_t = 2.0)]
    radius_m: f64,
}

pub(super) fn run(args: &MakeIndexArgs, out: &mut Output) -> Result<Outcome> {
    let options = IndexOptions {
        pattern: args.pattern.clone(),
        zone: args.zone.clone(),
        radius_m: args.radius_m,
    };
    let made = MadeIndex::of(&args.dir, args.from, &options)?;
    out.line(made.to_csv()?.trim_end())?;
    for problem in &made.problems {
        note!("problem: {problem}");
    }
    note!("{} images, {} left out", made.len(), made.problems.len());
    Ok(Outcome::of_check(made.problems.is_empty()))
}

//! How does a map come to know what matches in it are worth?

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use clap::Args;

use chronotope::error::{Error, ErrorKind};
use chronotope::localize::{ATTACHMENT, Localizer};
use chronotope::map::{Map, Snapshot};
use chronotope_terminal::config::Config;
use chronotope_terminal::{Outcome, Output};

/// Keep with a map what its past visits say about matches, so that `localize` starts at once.
///
/// Without it every start queries them anew. Answers are the same. What is kept is for the map as
/// it is and for these numbers; after more visits, or with other numbers, it is not used.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map calibrate street.map
  chronotope map calibrate street.map --config numbers.toml")]
pub(super) struct CalibrateArgs {
    /// The map file.
    map: PathBuf,
    /// TOML with the table [localize]; a key that is given replaces that of the map's preset.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

pub(super) fn run(args: &CalibrateArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.map)?;
    let snapshot = map.snapshot();
    let config = Config::read_for(snapshot.meta(), args.config.as_deref())?;
    let localizer = Localizer::new(Arc::clone(&snapshot), config.localize)
        .map_err(|error| error.with_path(&args.map))?;
    let (Some(calibration), Some(bytes)) = (localizer.calibration(), localizer.to_attachment()?)
    else {
        return Err(
            Error::new(ErrorKind::Config, "this configuration calibrates nothing")
                .with_path(&args.map)
                .with_help("set `calibrated = true` in the table [localize]")
                .into(),
        );
    };
    let name = args.map.display();
    if snapshot.attachments().get(ATTACHMENT) == Some(&bytes) {
        out.line(format_args!("{name}: calibrated already"))?;
        return Ok(Outcome::Good);
    }
    // Of what another process has committed meanwhile it says nothing, which its key tells.
    let generation = map.update(|snapshot| {
        let mut next = Snapshot::clone(snapshot);
        next.attach(ATTACHMENT, Arc::clone(&bytes))?;
        Ok(next)
    })?;
    let num_images = calibration.num_images();
    out.line(format_args!(
        "{name}: generation {generation} is calibrated on {num_images} past images"
    ))?;
    Ok(Outcome::Good)
}

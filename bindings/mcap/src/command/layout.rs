//! How does Foxglove show the answers?

use anyhow::Result;
use clap::Args;

use chronotope_bags::foxglove_layout;
use chronotope_terminal::{Outcome, Output};

/// Print a layout for Foxglove: the image with what was predicted over it, the place, how sure.
///
/// Import it in Foxglove (Layouts, Import from file), and open the robot's bag and the bag of answers
/// together.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope-bags layout > chronotope.json
  chronotope-bags layout --topic /camera/image_raw/compressed > chronotope.json")]
pub(crate) struct LayoutArgs {
    /// The topic of the camera's images in the robot's bag.
    #[arg(long, value_name = "TOPIC", default_value = "/camera/image_raw")]
    topic: String,
}

pub(crate) fn run(args: &LayoutArgs, out: &mut Output) -> Result<Outcome> {
    out.line(foxglove_layout(&args.topic).trim_end())?;
    Ok(Outcome::Good)
}

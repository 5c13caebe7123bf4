//! How does Foxglove show the answers?

use anyhow::Result;
use clap::Args;

use chronotope_bags::FOXGLOVE_LAYOUT;
use chronotope_terminal::{Outcome, Output};

/// Print a layout for Foxglove: the image with what was predicted over it, the place, how sure.
///
/// Import it in Foxglove (Layouts, Import from file), open the robot's bag and the bag of answers
/// together, and choose the topic of the camera in the image panel.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope-bags layout > chronotope.json")]
pub(crate) struct LayoutArgs {}

pub(crate) fn run(_: &LayoutArgs, out: &mut Output) -> Result<Outcome> {
    out.line(FOXGLOVE_LAYOUT.trim_end())?;
    Ok(Outcome::Good)
}

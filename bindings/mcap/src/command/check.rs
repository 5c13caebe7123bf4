//! Can this bag be used?

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use super::arguments::ImageArgs;
use chronotope::dataset::{CheckOptions, CheckReport};
use chronotope::error::ErrorKind;
use chronotope::feature::{ExtractorConfig, StarBriefConfig};
use chronotope::learn::LearnConfig;
use chronotope::localize::Preset;
use chronotope::map::PlaceKey;
use chronotope::time::Time;
use chronotope_bags::{Bag, Contents, Places, Recording};
use chronotope_terminal::{Outcome, Output};

/// List a bag's topics, decode its images, and list what is wrong.
///
/// Cut off, damaged and missing files; topics that cannot be read; images that are broken, of
/// another size than most, with nothing to see, of a clock that was never set. Exit code 1 if there
/// is a problem, 2 if the bag cannot be read at all.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope-bags check monday.mcap
  chronotope-bags check rosbag2_2024_05_01/ --topic /camera/image/compressed --json")]
pub(crate) struct CheckArgs {
    /// The bag.
    bag: PathBuf,
    /// One JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    images: ImageArgs,
}

pub(crate) fn run(args: &CheckArgs, out: &mut Output) -> Result<Outcome> {
    let bag = Arc::new(Bag::open(&args.bag)?);
    let contents = bag.contents()?;
    let one = Places::One(PlaceKey::new("somewhere")?);
    let recording = match Recording::read(&bag, &args.images.options(one), None) {
        Ok(recording) => Some(recording),
        // Without a topic of images, or with several, the topics are what was asked for.
        Err(error) if matches!(error.kind(), ErrorKind::Config | ErrorKind::Format) => {
            note!("{error}");
            None
        }
        Err(error) => return Err(error.into()),
    };
    let guard = LearnConfig::preset(Preset::Default).guard().clone();
    let extractor = ExtractorConfig::StarBrief(StarBriefConfig::default()).build()?;
    let options = CheckOptions {
        now: Some(Time::now()),
        features: Some((extractor, guard.min_features())),
    };
    let adjustment = args.images.reading.load_options();
    let report = recording.map(|it| {
        let dataset = it.dataset.adjusted(&adjustment);
        dataset.check_with(&options, |_, _| {})
    });
    let is_clean =
        report.as_ref().is_some_and(CheckReport::is_clean) && contents.problems.is_empty();
    if args.json {
        print_json(&bag, &contents, report.as_ref(), out)?;
    } else {
        print_text(&contents, report.as_ref(), out)?;
    }
    Ok(Outcome::of_check(is_clean))
}

fn print_json(
    bag: &Bag,
    contents: &Contents,
    report: Option<&CheckReport>,
    out: &mut Output,
) -> Result<()> {
    let topics: Vec<_> = (contents.topics.iter())
        .map(|(topic, summary)| {
            json!({
                "topic": topic.name,
                "type": topic.type_name,
                "encoding": topic.encoding,
                "messages": summary.num_messages,
                "first": Time::from_us(summary.logged_ns.0.div_euclid(1_000)).to_string(),
                "last": Time::from_us(summary.logged_ns.1.div_euclid(1_000)).to_string(),
                "is_read": topic.message_type().is_some(),
            })
        })
        .collect();
    out.json(&json!({
        "bag": bag.path().display().to_string(),
        "topics": topics,
        "cameras": contents.cameras,
        "images": report,
        "problems": contents.problems,
    }))
}

fn print_text(contents: &Contents, report: Option<&CheckReport>, out: &mut Output) -> Result<()> {
    for (position, (topic, summary)) in contents.topics.iter().enumerate() {
        let is_read = match topic.message_type() {
            Some(_) => "",
            None => " (not read)",
        };
        out.line(format_args!(
            "{:9} {}: {} of {}{is_read}",
            if position == 0 { "topics" } else { "" },
            topic.name,
            summary.num_messages,
            topic.type_name,
        ))?;
    }
    for (topic, camera) in &contents.cameras {
        out.line(format_args!(
            "camera    {topic}: {} x {} px, {}, focal lengths {:.1} and {:.1} px",
            camera.width,
            camera.height,
            camera.distortion_model,
            camera.focal_px[0],
            camera.focal_px[1],
        ))?;
    }
    match report {
        // Its problems are those of the bag and those of the images.
        Some(report) => out.line(report)?,
        None => {
            for problem in &contents.problems {
                out.line(format_args!("problem   {problem}"))?;
            }
        }
    }
    Ok(())
}

//! Where were the images of this bag taken?

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use super::arguments::ImageArgs;
use chronotope::dataset::Entry;
use chronotope::error::{Error, printable};
use chronotope::feature::{GrayImage, LoadOptions, load_mask};
use chronotope::localize::{Decision, LocalizerConfig, Method, Preset};
use chronotope::map::{MapMeta, PlaceKey};
use chronotope::predict::Selection;
use chronotope::robot::{Event, Frame, Robot, RobotConfig};
use chronotope::time::Time;
use chronotope_bags::{Answer, AnswerFile, Bag, Places, Recording};
use chronotope_terminal::arguments::{ConfigArgs, named};
use chronotope_terminal::config::{Config, preset_of};
use chronotope_terminal::reading::Adjust;
use chronotope_terminal::{Outcome, Output, interrupt};

/// Say at which place of a map the images of a bag were taken, in the order of time.
///
/// Images of another size but of the shape of the map's images are scaled to their size. Exit code 0
/// if all are located, 1 if one is unknown or ambiguous, 2 if one cannot be used.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope-bags localize site.map wednesday.mcap
  chronotope-bags localize site.map wednesday.mcap --out answers.mcap --track
  chronotope-bags localize site.map wednesday.mcap --json --every 1 --learn")]
pub(crate) struct LocalizeArgs {
    /// The map file.
    #[arg(required_unless_present = "print_config")]
    map: Option<PathBuf>,
    /// The bag.
    #[arg(required_unless_present = "print_config")]
    bag: Option<PathBuf>,
    /// Write the answers with their evidence as an MCAP file, which Foxglove opens beside the bag.
    #[arg(long, value_name = "MCAP")]
    out: Option<PathBuf>,
    /// How places are remembered.
    #[arg(long, value_parser = named::<Method>(Method::ALL.map(Method::name)))]
    method: Option<Method>,
    /// How many features of each place (or experience) are matched; all, where it has fewer.
    #[arg(long)]
    n: Option<usize>,
    /// How often an answer may name a wrong place, from 0 to 1 (of the preset if not given).
    #[arg(long, value_name = "SHARE")]
    risk: Option<f64>,
    /// An image of the size that is matched; where it is black, nothing is used.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// What was believed before moves along the map's edges and counts too; the table [motion] of
    /// --config says how the robot moves.
    #[arg(long)]
    track: bool,
    /// Learn each located image, as a new visit of its place; `chronotope map forget` takes the run
    /// back.
    #[arg(long)]
    learn: bool,
    /// One JSON object for each image.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    images: ImageArgs,
}

pub(crate) fn run(args: &LocalizeArgs, out: &mut Output) -> Result<Outcome> {
    let preset = match &args.map {
        Some(map) => preset_of(&MapMeta::read(map)?),
        None => Preset::Default,
    };
    let mut config = Config::read(args.config.config.as_deref(), preset)?;
    config.localize = args.change(config.localize)?;
    if args.config.print_config {
        return config.print(out);
    }
    let (Some(map), Some(bag)) = (&args.map, &args.bag) else {
        anyhow::bail!("a map and a bag are missing");
    };
    let robot = Robot::open(map, args.robot(&config, map)?)?;
    let bag_path = bag;
    let bag = Arc::new(Bag::open(bag_path)?);
    let one = Places::One(PlaceKey::new("somewhere")?);
    let recording = Recording::read(&bag, &args.images.options(one), None)?;
    for problem in &recording.dataset.problems {
        note!("problem: {problem}");
    }
    interrupt::watch()?;
    let answers = match &args.out {
        Some(path) => Some(AnswerFile::create(path, &[map, bag_path])?),
        None => None,
    };
    let outcome = Outcome::of_check(recording.dataset.problems.is_empty());
    let size = robot.localizer().snapshot().meta().image_size;
    let mut guide = Guide {
        robot,
        answers,
        outcome,
        is_json: args.json,
        adjust: Adjust::new(args.images.reading.load_options(), size),
    };
    for (entry, &logged) in recording.dataset.entries.iter().zip(&recording.logged) {
        if interrupt::is_requested() {
            guide.outcome = Outcome::Interrupted;
            break;
        }
        guide.answer(entry, logged, out)?;
    }
    guide.finish(args)
}

impl LocalizeArgs {
    fn change(&self, mut cfg: LocalizerConfig) -> Result<LocalizerConfig> {
        if let Some(method) = self.method {
            cfg = cfg.with_method(method);
        }
        if let Some(risk) = self.risk {
            cfg = cfg.with_risk(risk);
        }
        if let Some(n) = self.n {
            let selection = Selection::top(n).map_err(|error| error.with_place("--n"))?;
            cfg = cfg.with_selection(selection);
        }
        Ok(cfg)
    }

    fn robot(&self, config: &Config, map: &Path) -> Result<RobotConfig> {
        let mut cfg = RobotConfig::default()
            .with_localize(config.localize.clone())
            .with_recorded_images();
        if let Some(mask) = &self.mask {
            cfg = cfg.with_mask(load_mask(mask, &LoadOptions::default())?);
        }
        if self.track {
            cfg = cfg.with_tracking(config.motion);
        }
        if self.learn {
            cfg = cfg.with_learning_inline(config.learn_within_budget(map)?);
        }
        Ok(cfg)
    }
}

/// Answers one image after another.
struct Guide {
    robot: Robot,
    answers: Option<AnswerFile>,
    outcome: Outcome,
    is_json: bool,
    /// What is done to every image.
    adjust: Adjust,
}

impl Guide {
    fn answer(&mut self, entry: &Entry, logged: Time, out: &mut Output) -> Result<()> {
        let (image, found) = match entry.source.load().and_then(|image| self.adjusted(image)) {
            Ok(adjusted) => adjusted,
            Err(error) => return self.fail(&error, entry, out),
        };
        let frame = Frame::new(&image).at(entry.time).with_source(&entry.id);
        if let Err(error) = self.robot.see_frame(&frame) {
            return self.fail(&error, entry, out);
        }
        let is_located = matches!(self.robot.answer().decision, Decision::At(_));
        if self.outcome == Outcome::Good && !is_located {
            self.outcome = Outcome::Doubtful;
        }
        let answer = Answer::of(&self.robot, &entry.id, entry.time, None);
        if let Some(answers) = &mut self.answers {
            answers.add(&answer, logged, |point| {
                self.adjust.point_before(point, found)
            })?;
        }
        let answer = answer.in_short();
        if self.is_json {
            out.json(&answer)?;
        } else {
            out.line(printable(&answer.row()))?;
        }
        for event in self.robot.events() {
            match event {
                Event::Learnt { source, learnt, .. } if !learnt.is_same_visit => {
                    if let Some(doubt) = &learnt.doubt {
                        note!("held: {source}: {doubt}");
                    }
                }
                Event::NotLearnt { source, error } => note!("not learnt: {source}: {error}"),
                Event::NotCommitted { error } => note!("not written yet: {error}"),
                _ => {}
            }
        }
        Ok(())
    }

    /// The image as it is matched, and its size before.
    fn adjusted(&mut self, image: GrayImage) -> chronotope::Result<(GrayImage, (u32, u32))> {
        let found = image.size();
        let (image, _) = self.adjust.apply(image, None, &mut String::new())?;
        Ok((image, found))
    }

    /// Says why an image has no answer, and goes on.
    fn fail(&mut self, error: &Error, entry: &Entry, out: &mut Output) -> Result<()> {
        note!("error: {}: {}", entry.id, error);
        self.outcome = Outcome::Failed;
        if self.is_json {
            out.json(&json!({
                "image": entry.id,
                "decision": "unusable",
                "place": null,
                "error": error.to_string(),
            }))?;
        }
        Ok(())
    }

    fn finish(mut self, args: &LocalizeArgs) -> Result<Outcome> {
        if let Some(answers) = self.answers.take() {
            answers.finish()?;
        }
        if args.learn {
            let (session, path) = (self.robot.session(), self.robot.path().to_owned());
            let totals = self.robot.finish()?;
            note!(
                "learnt: {} visits, {} held",
                totals.num_learnt,
                totals.num_quarantined
            );
            if totals.num_learnt + totals.num_quarantined > 0 {
                let map = path.display();
                note!("to take this run back: chronotope map forget {map} --session {session}");
            }
        }
        Ok(self.outcome)
    }
}

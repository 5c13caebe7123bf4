//! Where were the images of this bag taken?

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde_json::json;

use super::arguments::ImageArgs;
use chronotope::dataset::{Entry, scale_between};
use chronotope::error::{Error, ErrorKind, printable};
use chronotope::feature::{GrayImage, LoadOptions};
use chronotope::learn::{BudgetConfig, LearnConfig};
use chronotope::localize::{Decision, LocalizerConfig, Method, MotionConfig, Preset};
use chronotope::map::{Map, MapMeta, PlaceKey};
use chronotope::predict::Selection;
use chronotope::robot::{Event, Frame, Robot, RobotConfig};
use chronotope::time::Time;
use chronotope_bags::{Answer, AnswerFile, Bag, Places, Recording};
use chronotope_terminal::{Outcome, Output, interrupt};

/// All places of a map that learns on take at most so many bytes together; that of `chronotope
/// localize --learn`.
const BUDGET_BYTES: usize = 256 << 20;

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
    map: PathBuf,
    /// The bag.
    bag: PathBuf,
    /// Write the answers with their evidence as an MCAP file, which Foxglove opens beside the bag.
    #[arg(long, value_name = "MCAP")]
    out: Option<PathBuf>,
    /// How places are remembered.
    #[arg(long, value_parser = methods())]
    method: Option<Method>,
    /// How many features of each place (or experience) are matched; all, where it has fewer.
    #[arg(long)]
    n: Option<usize>,
    /// How often an answer may name a wrong place, from 0 to 1 (of the preset if not given).
    #[arg(long, value_name = "SHARE")]
    risk: Option<f64>,
    /// What was believed before moves along the map's edges and counts too.
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
    images: ImageArgs,
}

fn methods() -> impl TypedValueParser<Value = Method> {
    PossibleValuesParser::new(Method::ALL.map(Method::name)).try_map(|name| name.parse::<Method>())
}

pub(crate) fn run(args: &LocalizeArgs, out: &mut Output) -> Result<Outcome> {
    let preset = MapMeta::read(&args.map)?
        .preset
        .parse()
        .unwrap_or(Preset::Default);
    let robot = Robot::open(&args.map, args.robot(preset)?)?;
    let bag = Arc::new(Bag::open(&args.bag)?);
    let one = Places::One(PlaceKey::new("somewhere")?);
    let recording = Recording::read(&bag, &args.images.options(one), None)?;
    for problem in &recording.dataset.problems {
        note!("problem: {problem}");
    }
    interrupt::watch()?;
    let answers = match &args.out {
        Some(path) => Some(AnswerFile::create(path, &[&args.map, &args.bag])?),
        None => None,
    };
    let outcome = Outcome::of_check(recording.dataset.problems.is_empty());
    let mut guide = Guide {
        robot,
        answers,
        outcome,
        is_json: args.json,
        is_scaling_told: false,
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
    fn robot(&self, preset: Preset) -> Result<RobotConfig> {
        let mut localize = LocalizerConfig::preset(preset);
        if let Some(method) = self.method {
            localize = localize.with_method(method);
        }
        if let Some(risk) = self.risk {
            localize = localize.with_risk(risk);
        }
        if let Some(n) = self.n {
            let selection = Selection::top(n).map_err(|error| error.with_place("--n"))?;
            localize = localize.with_selection(selection);
        }
        let mut cfg = RobotConfig::default()
            .with_localize(localize)
            .with_recorded_images();
        if self.track {
            cfg = cfg.with_tracking(MotionConfig::default());
        }
        if self.learn {
            cfg = cfg.with_learning_inline(self.bounded(LearnConfig::preset(preset))?);
        }
        Ok(cfg)
    }

    /// A map that is larger than the budget already does not grow.
    fn bounded(&self, learn: LearnConfig) -> Result<LearnConfig> {
        let snapshot = Map::open_read_only(&self.map)?.snapshot();
        let num_bytes: usize = snapshot.nodes.iter().map(|node| node.num_bytes()).sum();
        let budget = BudgetConfig::default().with_bytes(num_bytes.max(BUDGET_BYTES));
        Ok(learn.with_budget(budget)?)
    }
}

/// Answers one image after another.
struct Guide {
    robot: Robot,
    answers: Option<AnswerFile>,
    outcome: Outcome,
    is_json: bool,
    is_scaling_told: bool,
}

impl Guide {
    fn answer(&mut self, entry: &Entry, logged: Time, out: &mut Output) -> Result<()> {
        let (image, scale) = match entry.source.load().and_then(|image| self.fitted(image)) {
            Ok(fitted) => fitted,
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
            answers.add(&answer, logged, scale)?;
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

    /// The image in the size of the map's images, and by how much it was scaled.
    fn fitted(&mut self, image: GrayImage) -> chronotope::Result<(GrayImage, f64)> {
        let (from, Some(to)) = (
            image.size(),
            self.robot.localizer().snapshot().meta.image_size,
        ) else {
            return Ok((image, 1.0));
        };
        if from == to {
            return Ok((image, 1.0));
        }
        let Some(scale) = scale_between(from, to) else {
            let message = format!(
                "the image has {} x {} px, but the map was learnt from {} x {} px",
                from.0, from.1, to.0, to.1
            );
            return Err(Error::new(ErrorKind::Shape, message)
                .with_help("make a map of its own for this camera"));
        };
        if !self.is_scaling_told {
            self.is_scaling_told = true;
            note!(
                "note: images of {} x {} px are scaled to {} x {} px, as the map's are",
                from.0,
                from.1,
                to.0,
                to.1
            );
        }
        Ok((
            LoadOptions::default().with_scale(scale).apply(image)?,
            scale,
        ))
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
            let session = self.robot.session();
            let totals = self.robot.finish()?;
            note!(
                "learnt: {} visits, {} held",
                totals.num_learnt,
                totals.num_quarantined
            );
            if totals.num_learnt + totals.num_quarantined > 0 {
                let map = Path::new(&args.map).display();
                note!("to take this run back: chronotope map forget {map} --session {session}");
            }
        }
        Ok(self.outcome)
    }
}

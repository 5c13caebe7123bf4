//! Where was this image taken?

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use serde::Serialize;
use serde_json::json;

use super::live::{self, Frames};
use super::pictures::{Picture, Pictures};
use super::warnings::{print_held, print_num_held, warn_of_time};
use super::within::Within;
use chronotope::dataset::blindness;
use chronotope::error::{Error, printable};
use chronotope::feature::{LoadOptions, load_mask};
use chronotope::localize::{
    Candidate, Decision, IndexCache, Localization, Localizer, LocalizerConfig, Method, Preset,
    Score,
};
use chronotope::map::{MapMeta, NodeId, PlaceKey, Snapshot};
use chronotope::predict::Selection;
use chronotope::robot::{Event, Frame, Robot, RobotConfig};
use chronotope::time::Time;
use chronotope::trace::{Shot, Stage, TraceConfig, Tracer};
use chronotope_terminal::arguments::{ConfigArgs, ModelArgs, named};
use chronotope_terminal::config::{Config, preset_of};
use chronotope_terminal::reading::{Adjust, ReadingArgs};
use chronotope_terminal::{Outcome, Output, interrupt};

/// Say at which place of a map images were taken.
///
/// The time of an image is --time, else that of an index.csv in a parent folder that lists it, else
/// its EXIF time, else what the file-name rule of --manifest reads. Images that an index lists are
/// cut and scaled as it says, then as the options say; images of another size but of the shape of
/// the map's images are scaled to their size. Exit code 0 if all are located, 1 if one is unknown
/// or ambiguous, 2 if one cannot be used.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope localize street.map now.jpg --time 2024-05-01T08:30:00Z
  chronotope localize street.map photos/*.jpg --json
  chronotope localize street.map photos/*.jpg --learn
  chronotope localize street.map run/*.jpg --track
  chronotope localize street.map now.jpg --method static --n 100 --trace evidence.jsonl
  chronotope localize park.map 0105.webp --manifest stromovka
  chronotope localize street.map --camera 0 --trace - | chronotope-dashboard --connect")]
pub(super) struct LocalizeArgs {
    /// The map file.
    #[arg(required_unless_present = "print_config")]
    map: Option<PathBuf>,
    /// Image files, or videos (with the cargo feature `opencv`).
    #[arg(value_name = "IMAGE", required_unless_present_any = ["camera", "print_config"])]
    images: Vec<PathBuf>,
    /// When they were taken (a video: began), in RFC 3339 with an offset (of --zone without one), or
    /// a number since 1970 with its unit: 1714552200s.
    #[arg(long)]
    time: Option<String>,
    /// A supported dataset, a manifest or a folder with one, whose file-name rule says when.
    #[arg(long, value_name = "NAME|FILE")]
    manifest: Option<String>,
    /// How places are remembered.
    #[arg(long, value_parser = named::<Method>(Method::ALL.map(Method::name)))]
    method: Option<Method>,
    /// What places are ranked by.
    #[arg(long, value_parser = named::<Score>(Score::ALL.map(Score::name)))]
    score: Option<Score>,
    /// How many features of each place (or experience) are matched; all, where it has fewer.
    #[arg(long)]
    n: Option<usize>,
    /// How often an answer may name a wrong place, from 0 to 1 (of the preset if not given).
    #[arg(long, value_name = "SHARE")]
    risk: Option<f64>,
    /// Also give the ranking of this many places.
    #[arg(long, value_name = "K", default_value_t = 0)]
    top: usize,
    /// An image of the size that is matched; where it is black, nothing is used.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Locate what this camera sees until Ctrl-C (with the cargo feature `opencv`).
    #[arg(long, value_name = "N", conflicts_with_all = ["images", "time", "manifest"])]
    camera: Option<u32>,
    /// Learn each located image, as a new visit of its place: the map file grows by generations,
    /// which `map rollback` can take back. Its places take at most 256 MiB, unless [learn.budget] of
    /// --config says otherwise: then what is least useful is forgotten. Without this the map is only
    /// read.
    #[arg(long)]
    learn: bool,
    /// Take the images as one way, in the order given: what was believed before moves along the
    /// map's edges (where it has none, along the ways that it was learnt on) and counts too. The table [motion] of --config says how the robot moves.
    #[arg(long)]
    track: bool,
    /// Count an answer that leaves several neighbouring places open as located (exit code 0) if all
    /// of them are so near the first.
    #[arg(long, value_name = "edges:K|metres:R")]
    within: Option<Within>,
    /// Whether to keep what is worked out of the map in a file beside it, MAP.*.query, so that the
    /// next call starts at once: `auto` where that took more than a second. Answers are the same
    /// without, and the files may be deleted at any time. --learn has none.
    #[arg(long, value_name = "WHEN", default_value_t, value_parser = named::<IndexCache>(IndexCache::ALL.map(IndexCache::name)))]
    query_form: IndexCache,
    /// One JSON object for each image, also for one that cannot be used.
    #[arg(long)]
    json: bool,
    /// Write all evidence as one JSON object for each image; with `-` to stdout, and results to
    /// stderr.
    #[arg(long, value_name = "FILE|-")]
    trace: Option<PathBuf>,
    /// The picture itself goes into every Nth line of the trace; 0: into none.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "trace")]
    trace_images: usize,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    config: ConfigArgs,
}

pub(super) fn run(args: &LocalizeArgs, out: &mut Output) -> Result<Outcome> {
    let preset = match &args.map {
        Some(path) => preset_of(&MapMeta::read(path)?),
        None => Preset::Default,
    };
    let mut config = Config::read(args.config.config.as_deref(), preset)?;
    config.localize = args.change(config.localize)?;
    if args.config.print_config {
        return config.print(out);
    }
    let Some(path) = &args.map else {
        bail!("MAP is missing");
    };
    let time = args.time()?;
    let (trace, results) = args.outputs(out)?;
    let mut robot = Robot::open(path, args.robot(&config)?)?;
    let is_preset = config.localize.method() == LocalizerConfig::preset(preset).method();
    if is_preset && args.method.is_none() && counts_visits(robot.localizer().snapshot()) {
        note!(
            "note: the times of this map only number its visits, so it is localised by --method static"
        );
        config.localize = config.localize.with_method(Method::Static);
        drop(robot);
        robot = Robot::open(path, args.robot(&config)?)?;
    }
    let needs_time = config.localize.method().needs_time();
    let mut guide = Guide::new(args, robot, trace, results);
    guide.form = match (args.json, args.images.len()) {
        (true, _) => Form::Json,
        (false, 1) => Form::Sheet,
        (false, _) => Form::Line,
    };
    guide.min_features = config.learn.guard().min_features();
    if args.learn || args.camera.is_some() {
        interrupt::watch()?;
    }
    if let Some(camera) = args.camera {
        guide.form = guide.form.for_many();
        guide.follow(live::camera(camera)?)?;
        return guide.finish(args.learn);
    }
    let mut pictures = Pictures::new(
        &args.images,
        time,
        needs_time,
        args.manifest.as_deref(),
        &args.reading,
        guide.robot.localizer().snapshot().meta().image_size,
    )?;
    for path in &args.images {
        if interrupt::is_requested() {
            break;
        }
        if live::is_video(path) {
            guide.form = guide.form.for_many();
            match live::video(path, time) {
                Ok(frames) => guide.follow(frames)?,
                Err(error) => guide.fail(&error, path)?,
            }
            continue;
        }
        let listed = match pictures.list(path) {
            Ok(listed) => listed,
            Err(error) => {
                guide.fail(&error.with_path(path), path)?;
                continue;
            }
        };
        if listed.len() > 1 {
            guide.form = guide.form.for_many();
        }
        for picture in listed {
            match pictures.load(picture) {
                Ok(picture) => guide.answer(&picture)?,
                Err(error) => guide.fail(&error.with_path(path), path)?,
            }
        }
    }
    guide.finish(args.learn)
}

/// Whether a map's times are no clock's: all of them lie before any camera's clock was right.
fn counts_visits(snapshot: &Snapshot) -> bool {
    const FIRST_TIME: Time = Time::from_s(946_684_800);
    snapshot
        .summary()
        .last
        .is_some_and(|last| last < FIRST_TIME)
}

impl LocalizeArgs {
    fn robot(&self, config: &Config) -> Result<RobotConfig> {
        let score = config.localize.score();
        let mut cfg = RobotConfig::default()
            .with_localize(config.localize.clone())
            .with_index_cache(self.query_form)
            .with_models(self.model.models());
        if let Some(mask) = &self.mask {
            cfg = cfg.with_mask(load_mask(mask, &LoadOptions::default())?);
        }
        if self.track {
            if score != Score::Likelihood {
                bail!(
                    "--track needs the score `likelihood`, not `{score}` (help: leave --score and \
                     --preset out)"
                );
            }
            cfg = cfg.with_tracking(config.motion);
        }
        if self.learn {
            cfg = cfg.with_learning_inline(match &self.map {
                Some(map) => config.learn_within_budget(map)?,
                None => config.learn.clone(),
            });
        }
        if self.camera.is_none() {
            cfg = cfg.with_recorded_images();
        }
        Ok(cfg)
    }

    /// The time that was given for all images.
    fn time(&self) -> Result<Option<Time>> {
        let zone = self.reading.zone.as_ref();
        let read = |text: &String| Time::parse_in(text, zone);
        let time = self.time.as_ref().map(read).transpose();
        Ok(time.map_err(|error| error.with_place("--time"))?)
    }

    fn change(&self, mut cfg: LocalizerConfig) -> Result<LocalizerConfig> {
        if let Some(method) = self.method {
            cfg = cfg.with_method(method);
        }
        if let Some(score) = self.score {
            cfg = cfg.with_score(score);
        }
        if let Some(risk) = self.risk {
            cfg = cfg.with_risk(risk);
        }
        if let Some(n) = self.n {
            cfg = cfg.with_selection(Selection::top(n).map_err(|error| error.with_place("--n"))?);
        }
        Ok(cfg)
    }

    /// Where the trace goes, and where results go.
    fn outputs<'o>(&self, out: &'o mut Output) -> Result<(Option<Sink>, &'o mut Output)> {
        let Some(path) = &self.trace else {
            return Ok((None, out));
        };
        let output = if path == Path::new("-") {
            if self.json {
                bail!(
                    "--json and --trace - would both write to stdout (help: the trace has it all)"
                );
            }
            std::mem::replace(out, Output::stderr())
        } else {
            let others = [&self.map, &self.mask, &self.config.config];
            let inputs: Vec<&Path> = (others.into_iter().flatten())
                .chain(&self.images)
                .map(PathBuf::as_path)
                .collect();
            Output::trace(path, &inputs)?
        };
        let path = path.clone();
        let tracer = Tracer::new(TraceConfig::default().with_image_every(self.trace_images));
        let sink = Sink {
            output,
            path,
            tracer,
        };
        Ok((Some(sink), out))
    }
}

struct Sink {
    output: Output,
    path: PathBuf,
    tracer: Tracer,
}

impl Sink {
    fn write(&mut self, robot: &Robot, picture: &Picture) -> Result<()> {
        let timing = robot.timing();
        let stages = [
            Stage::new("extract", timing.extract),
            Stage::new("localize", timing.localize),
        ];
        let shot = Shot {
            name: &picture.name,
            file: picture.file.as_deref(),
            recipe: &picture.recipe,
            picture: &picture.image,
            time: picture.time.map(|(time, _)| time),
            time_source: picture.time.map(|(_, source)| source.word()),
            truth: picture.truth.as_ref(),
            live: robot.features(),
            stages: &stages,
        };
        let trace = (self.tracer).trace(robot.localizer(), &shot, robot.answer())?;
        let written = self.output.json(&trace);
        written.with_context(|| format!("{}: the trace cannot be written", self.path.display()))
    }
}

/// How an answer is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Json,
    /// One image on several lines.
    Sheet,
    Line,
}

impl Form {
    fn for_many(self) -> Self {
        match self {
            Self::Sheet => Self::Line,
            other => other,
        }
    }
}

/// Answers one picture after another.
struct Guide<'o> {
    robot: Robot,
    trace: Option<Sink>,
    out: &'o mut Output,
    form: Form,
    /// What is done to the frames of cameras and videos.
    adjust: Adjust,
    learns: bool,
    /// How many places of the ranking are shown.
    top: usize,
    /// With fewer features than this hardly anything can be seen.
    min_features: usize,
    outcome: Outcome,
    within: Option<Within>,
    is_warned: bool,
    /// Whether it was said that the map has reached its budget.
    is_full: bool,
}

impl<'o> Guide<'o> {
    fn new(args: &LocalizeArgs, robot: Robot, trace: Option<Sink>, out: &'o mut Output) -> Self {
        let size = robot.localizer().snapshot().meta().image_size;
        Self {
            robot,
            trace,
            out,
            form: Form::Line,
            adjust: Adjust::new(args.reading.load_options(), size),
            learns: args.learn,
            top: args.top,
            min_features: 0,
            outcome: Outcome::Good,
            within: args.within,
            is_warned: false,
            is_full: false,
        }
    }

    /// Says why a picture has no answer, and goes on.
    fn fail(&mut self, error: &Error, image: impl AsRef<Path>) -> Result<()> {
        note!("error: {error}");
        self.outcome = Outcome::Failed;
        if self.form == Form::Json {
            self.out.json(&json!({
                "image": image.as_ref().display().to_string(),
                "decision": "unusable",
                "place": null,
                "error": error.to_string(),
            }))?;
        }
        Ok(())
    }

    /// Answers until the frames end or Ctrl-C is pressed.
    fn follow(&mut self, frames: Frames) -> Result<()> {
        for frame in frames {
            if interrupt::is_requested() {
                break;
            }
            match frame {
                Ok(mut picture) => {
                    let (image, mask) =
                        (self.adjust).apply(picture.image, picture.mask, &mut picture.recipe)?;
                    let picture = Picture {
                        image,
                        mask,
                        ..picture
                    };
                    self.answer(&picture)?;
                }
                Err(error) => {
                    let name = error.path().unwrap_or(Path::new("camera")).to_owned();
                    self.fail(&error, name)?;
                    break;
                }
            }
        }
        Ok(())
    }

    fn answer(&mut self, picture: &Picture) -> Result<()> {
        let mut frame = Frame::new(&picture.image).with_source(&picture.name);
        if let Some((time, _)) = picture.time {
            frame = frame.at(time);
        }
        if let Some(mask) = &picture.mask {
            frame = frame.with_mask(mask);
        }
        if let Err(error) = self.robot.see_frame(&frame) {
            let error = match &picture.file {
                Some(file) => error.with_path(file),
                None => error.with_place(&picture.name),
            };
            return self.fail(&error, &picture.name);
        }
        let (timing, num_features) = (self.robot.timing(), self.robot.features().len());
        tracing::info!(
            image = picture.name,
            duration_ms = (timing.extract + timing.localize).as_secs_f64() * 1e3,
            features = num_features,
            "localised"
        );
        self.warn_of_blindness(picture, num_features);
        let localizer = self.robot.localizer();
        if let Some((time, _)) = picture.time
            && !self.is_warned
        {
            self.is_warned = warn_of_time(localizer.snapshot(), time, Some(&picture.name));
        }
        let answer = self.robot.answer();
        if let (true, Decision::At(id), Some(truth)) =
            (self.learns, answer.decision, &picture.truth)
            && *localizer.snapshot().node(id).key() != *truth
        {
            note!(
                "warning: {}: learnt as `{}`, where it was located, but its index says `{truth}`",
                picture.name,
                localizer.snapshot().node(id).key()
            );
        }
        let is_located = match (answer.decision, self.within) {
            (Decision::At(_), _) => true,
            (Decision::Near(_), Some(within)) => within.holds(localizer, &answer.region),
            _ => false,
        };
        if self.outcome == Outcome::Good && !is_located {
            self.outcome = Outcome::Doubtful;
        }
        if let Some(sink) = &mut self.trace {
            sink.write(&self.robot, picture)?;
        }
        let report = Report::new(localizer, picture, answer, num_features, self.top);
        match self.form {
            Form::Json => self.out.json(&report)?,
            Form::Sheet => self.out.line(report.sheet())?,
            Form::Line => self.out.line(report.row())?,
        }
        self.say_what_was_learnt();
        Ok(())
    }

    /// Says why hardly anything can be seen, if that is so: "unknown" alone sounds like another place.
    fn warn_of_blindness(&self, picture: &Picture, num_features: usize) {
        if num_features < self.min_features {
            let range = picture.image.gray_range(picture.mask.as_ref());
            let size = picture.image.size();
            if let Some(why) = blindness(num_features, self.min_features, range, size) {
                note!("warning: {}: {why}", picture.name);
            }
        }
    }

    fn say_what_was_learnt(&mut self) {
        let map = self.robot.path().to_owned();
        for event in self.robot.events() {
            match event {
                Event::Learnt { learnt, .. } if learnt.is_same_visit => {}
                Event::Learnt { source, learnt, .. } if learnt.doubt.is_some() => {
                    if let Some(doubt) = &learnt.doubt {
                        print_held(&source, doubt, &map);
                    }
                }
                Event::Learnt {
                    place,
                    source,
                    learnt,
                    ..
                } => {
                    tracing::info!(
                        image = source,
                        place = place.as_str(),
                        seen = learnt.num_seen,
                        born = learnt.num_born,
                        "learnt"
                    );
                    if learnt.num_forgotten > 0 && !self.is_full {
                        self.is_full = true;
                        note!(
                            "warning: the map has reached its budget: from now on it forgets what is \
                             least useful ([learn.budget] of --config says how large it may become)"
                        );
                    }
                }
                Event::NotLearnt { source, error } => {
                    note!("not learnt: {source}: {}", error.without_path());
                }
                Event::NotCommitted { error } => note!("not written yet: {error}"),
                _ => {}
            }
        }
    }

    /// Keeps what was learnt.
    fn finish(mut self, learns: bool) -> Result<Outcome> {
        if learns {
            self.robot.commit()?;
            let generation = self.robot.events().fold(0, |latest, event| match event {
                Event::Committed { generation, .. } => generation,
                _ => latest,
            });
            let path = self.robot.path().display().to_string();
            let session = self.robot.session();
            let totals = self.robot.finish()?;
            note!(
                "learnt: {} visits, {} held; {path} is at generation {generation}",
                totals.num_learnt,
                totals.num_quarantined
            );
            if totals.num_same_visit > 0 {
                note!(
                    "note: {} more images belong to these visits or to those just before",
                    totals.num_same_visit
                );
            }
            if totals.num_quarantined > 0 {
                print_num_held(totals.num_quarantined, Path::new(&path));
                if self.outcome == Outcome::Good {
                    self.outcome = Outcome::Doubtful;
                }
            }
            if totals.num_learnt + totals.num_quarantined > 0 {
                note!("to take this run back: chronotope map forget {path} --session {session}");
            }
        }
        Ok(self.outcome)
    }
}

/// One answer, for people and scripts.
#[derive(Serialize)]
struct Report<'a> {
    image: &'a str,
    time: Option<String>,
    time_source: Option<chronotope::dataset::TimeSource>,
    decision: &'static str,
    /// Where it is, if that was decided.
    place: Option<&'a PlaceKey>,
    /// The neighbouring places that are left open, most probable first, where it is near one.
    #[serde(skip_serializing_if = "Option::is_none")]
    region: Option<Vec<&'a PlaceKey>>,
    /// The first place, whatever was decided.
    best: Option<Share<'a>>,
    second: Option<Share<'a>>,
    /// How many places share the best score.
    tied: usize,
    /// Which, if there are several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    tied_places: Vec<&'a PlaceKey>,
    /// The first places, if they were asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ranking: Vec<Share<'a>>,
    elsewhere: f64,
    reason: String,
    /// By how much the image is moved against the first place, if matches agree on that.
    displacement_px: Option<[f64; 2]>,
    displacement_spread_px: Option<[f64; 2]>,
    num_matches: u32,
    num_inliers: u32,
    num_features: usize,
    pairs_compared: u64,
    method: &'static str,
    /// The place that an index says it shows.
    truth: Option<&'a PlaceKey>,
}

/// A count as it is, log odds to a tenth.
fn rounded(score: f64) -> f64 {
    (score * 10.0).round() / 10.0
}

#[derive(Serialize)]
struct Share<'a> {
    place: &'a PlaceKey,
    score: f64,
    posterior: f64,
}

impl<'a> Report<'a> {
    fn new(
        localizer: &'a Localizer,
        picture: &'a Picture,
        answer: &Localization,
        num_features: usize,
        top: usize,
    ) -> Self {
        let key = |id: NodeId| localizer.snapshot().node(id).key();
        let share = |candidate: &Candidate| Share {
            place: key(candidate.node),
            score: candidate.score,
            posterior: candidate.posterior,
        };
        let first = answer.first();
        let vote = first
            .map(|first| first.displacement)
            .filter(|vote| vote.num_inliers > 0);
        let (decision, place) = match answer.decision {
            Decision::At(id) => ("at", Some(key(id))),
            Decision::Near(id) => ("near", Some(key(id))),
            Decision::Ambiguous => ("ambiguous", None),
            _ => ("unknown", None),
        };
        let is_near = matches!(answer.decision, Decision::Near(_));
        Self {
            image: &picture.name,
            region: is_near.then(|| answer.region.iter().map(|&id| key(id)).collect()),
            time: picture.time.map(|(time, _)| time.to_string()),
            time_source: picture.time.map(|(_, source)| source),
            decision,
            place,
            best: first.map(share),
            second: answer.ranking.get(1).map(share),
            tied: answer.tied,
            tied_places: (answer.ranking.iter())
                .take(if answer.tied > 1 { answer.tied } else { 0 })
                .map(|candidate| key(candidate.node))
                .collect(),
            ranking: answer.ranking.iter().take(top).map(share).collect(),
            elsewhere: answer.off_map,
            reason: answer.reason.to_string(),
            displacement_px: vote.map(|vote| [vote.median.dx_px, vote.median.dy_px]),
            displacement_spread_px: vote.map(|vote| [vote.spread.dx_px, vote.spread.dy_px]),
            num_matches: first.map_or(0, |first| first.num_matches),
            num_inliers: first.map_or(0, |first| first.num_inliers),
            num_features,
            pairs_compared: answer.pairs_compared,
            method: localizer.cfg().method().name(),
            truth: picture.truth.as_ref(),
        }
    }

    fn verdict(&self) -> String {
        let names: Vec<&str> = match &self.region {
            Some(region) => region.iter().map(|place| place.as_str()).collect(),
            None => vec![self.place.map_or(self.decision, PlaceKey::as_str)],
        };
        match names.split_last() {
            Some((last, [])) => (*last).to_owned(),
            Some((last, [one])) => format!("between {one} and {last}"),
            Some((last, more)) => format!("among {} and {last}", more.join(", ")),
            None => String::new(),
        }
    }

    fn displacement(&self) -> String {
        match self.displacement_px {
            Some([dx, dy]) => format!("({dx:+.1}, {dy:+.1}) px"),
            None => "none".into(),
        }
    }

    fn row(&self) -> String {
        let score = |share: &Option<Share<'_>>| match share {
            Some(share) => format!("{} {}", share.place, rounded(share.score)),
            None => "none".into(),
        };
        format!(
            "{}  {}  first {}  second {}  moved {}  {}",
            printable(self.image),
            self.verdict(),
            score(&self.best),
            score(&self.second),
            self.displacement(),
            self.reason
        )
    }

    fn sheet(&self) -> String {
        let share = |share: &Option<Share<'_>>| match share {
            Some(share) => format!(
                "{}, score {}, posterior {:.3}",
                share.place,
                rounded(share.score),
                share.posterior
            ),
            None => "none".into(),
        };
        let time = match (&self.time, self.time_source) {
            (Some(time), Some(source)) => format!("{time} ({})", source.name()),
            _ => "none".into(),
        };
        let spread = match self.displacement_spread_px {
            Some([dx, dy]) => format!(", spread ({dx:.1}, {dy:.1}) px"),
            None => String::new(),
        };
        let ranking: Vec<String> = (self.ranking.iter().enumerate())
            .map(|(position, one)| {
                let title = if position == 0 { "ranking" } else { "" };
                format!(
                    "\n{title:<12}  {}, score {}, posterior {:.3}",
                    one.place,
                    rounded(one.score),
                    one.posterior
                )
            })
            .collect();
        let ranking = ranking.concat();
        format!(
            "image         {}\n\
             time          {time}\n\
             decision      {}\n\
             reason        {}\n\
             first         {}\n\
             second        {}\n\
             matches       {} of {} features, {} agree on the displacement\n\
             displacement  {}{spread}{ranking}",
            printable(self.image),
            self.verdict(),
            self.reason,
            share(&self.best),
            share(&self.second),
            self.num_matches,
            self.num_features,
            self.num_inliers,
            self.displacement(),
        )
    }
}

//! A robot with a live dashboard: see every picture, record it, keep memory flat.
//!
//! The loop is [`Robot`]'s; this adds a tracer, which is given what the robot says of each picture,
//! and a recorder on a thread of its own.
//!
//! ```sh
//! # As fast as it goes, measured.
//! cargo run --example live_robot -- --queries 10000 --save target/robot.rrd
//! # One hour, watched live.
//! cargo run --example live_robot -- --hz 10 --queries 36000 --connect
//! ```
//!
//! At the end it says what localising took, what recording took of the robot's own loop (a thread
//! of its own does the rest) and of all processors, and how much memory the process held before the
//! first query, after a tenth of the session, at its end and at most. Memory and processor time are
//! those of Linux; they are not shown on other systems. `--max-mib` makes it fail if recording and
//! its queue ever held more. `--alternate 500` records every other 500 queries, and compares the
//! processor time of both kinds: what else the machine does affects both alike.
#![allow(clippy::print_stdout)] // reason: the measurement is this example's output.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use chronotope::Time;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, GrayImage, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::map::{Map, MapMeta, SessionId, derived_uuid};
use chronotope::robot::{Robot, RobotConfig};
use chronotope::trace::{Shot, Stage, TraceConfig, Tracer};
use chronotope_dashboard::{Background, Destination, Page, RecorderConfig};
use clap::Parser;

/// Pictures of the made-up street that the robot sees in turn.
const NUM_PICTURES: usize = 24;
/// The made-up clock between two pictures.
const STEP_US: i64 = 100_000;

#[derive(Parser)]
struct Args {
    /// How many pictures are localised.
    #[arg(long, default_value_t = 1000)]
    queries: usize,
    /// Pictures per second; as fast as possible, if it is left out.
    #[arg(long)]
    hz: Option<f64>,
    /// Every Nth picture is recorded with its features.
    #[arg(long, default_value_t = 20)]
    image_every: usize,
    /// Write a recording.
    #[arg(long, default_value = "target/robot.rrd")]
    save: PathBuf,
    /// Send to a viewer instead.
    #[arg(long, num_args = 0..=1, default_missing_value = "rerun+http://127.0.0.1:9876/proxy")]
    connect: Option<String>,
    /// Open on the page of histories and rhythms.
    #[arg(long)]
    why: bool,
    /// Fail if the process grows by more than this while it records, MiB.
    #[arg(long)]
    max_mib: Option<u64>,
    /// Record only every other block of this many queries, and compare the two.
    #[arg(long, value_name = "QUERIES")]
    alternate: Option<usize>,
    /// Localise only, for comparison.
    #[arg(long)]
    without_recording: bool,
}

impl Args {
    /// The recording on its thread; `None` if only localising is measured.
    fn recording(&self) -> Result<Option<Background>> {
        if self.without_recording {
            return Ok(None);
        }
        let destination = match &self.connect {
            Some(url) => Destination::Viewer(url.clone()),
            None => Destination::File(self.save.clone()),
        };
        let cfg = RecorderConfig::default()
            .with_image_every(self.image_every as u64)
            .with_page(if self.why { Page::Why } else { Page::Now });
        Background::new(destination, cfg).map(Some)
    }

    /// Pictures and points are the largest part of a trace: the tracer encodes no more pictures
    /// than the recorder draws.
    fn tracer(&self) -> Tracer {
        Tracer::new(
            TraceConfig::default()
                .with_image_every(self.image_every)
                .with_num_candidates(3),
        )
    }

    /// Whether the `i`-th query is recorded.
    fn is_recorded(&self, i: usize) -> bool {
        self.alternate.is_none_or(|size| (i / size.max(1)) % 2 == 1)
    }
}

fn main() -> Result<()> {
    let args = Args::parse();
    let street = Street::new()?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("street.map");
    street.learn(&path)?;
    let mut robot = Robot::open(&path, RobotConfig::default())?;
    let recording = args.recording()?;
    let mut tracer = args.tracer();

    let mut cost = Cost {
        idle_s: processor_s(),
        idle_kib: memory_kib("VmRSS:"),
        ..Cost::default()
    };
    let mut blocks = Blocks::default();
    let began = Instant::now();
    for i in 0..args.queries {
        if let Some(hz) = args.hz {
            let due = began + Duration::from_secs_f64(i as f64 / hz);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        let is_recorded = args.is_recorded(i);
        if (args.alternate).is_some_and(|size| i.is_multiple_of(size.max(1))) {
            blocks.next(is_recorded);
        }
        let (picture, time) = street.picture(i);
        let before = Instant::now();
        robot.see(picture, time)?;
        cost.localizing += before.elapsed();

        let before = Instant::now();
        if let Some(recording) = recording.as_ref().filter(|_| is_recorded) {
            record(recording, &mut tracer, &robot, picture, time)?;
        }
        cost.recording += before.elapsed();
        if i == args.queries / 10 {
            cost.early_kib = memory_kib("VmRSS:");
        }
    }
    cost.late_kib = memory_kib("VmRSS:");
    cost.num_recorded = recording.map_or(Ok(0), Background::finish)?;
    blocks.end();
    cost.print(&args)?;
    blocks.print(args.alternate.unwrap_or_default());
    Ok(())
}

/// Records what the robot says of the picture that it saw last.
fn record(
    recording: &Background,
    tracer: &mut Tracer,
    robot: &Robot,
    picture: &GrayImage,
    time: Time,
) -> Result<()> {
    let timing = robot.timing();
    let shot = Shot {
        name: "camera",
        file: None,
        recipe: "",
        picture,
        time: Some(time),
        time_source: Some("clock"),
        truth: None,
        live: robot.features(),
        stages: &[
            Stage::new("extract", timing.extract),
            Stage::new("localize", timing.localize),
        ],
    };
    recording.record(tracer.trace(robot.localizer(), &shot, robot.answer())?)
}

/// A rendered street: what is learnt of it, and the pictures that the robot sees in turn.
struct Street {
    world: World,
    schedule: Schedule,
    pictures: Vec<GrayImage>,
}

impl Street {
    fn new() -> Result<Self> {
        let world = World::new(&WorldConfig::new(1))?;
        let schedule = Schedule::standard(1, 12, NUM_PICTURES);
        let pictures = (schedule.query.iter().enumerate())
            .map(|(i, &time)| world.render(i % world.places().len(), time, 0))
            .collect();
        Ok(Self {
            world,
            schedule,
            pictures,
        })
    }

    /// The `i`-th picture, and what the made-up clock says then.
    fn picture(&self, i: usize) -> (&GrayImage, Time) {
        let start = self.schedule.query.first().copied().unwrap_or_default();
        let picture = &self.pictures[i % self.pictures.len()];
        (picture, start.plus_us(STEP_US * i as i64))
    }

    /// Learns the street and writes its map.
    fn learn(&self, path: &Path) -> Result<()> {
        let extractor = StarBrief::new(StarBriefConfig::default())?;
        let meta = MapMeta::new(derived_uuid("live robot"), extractor.id(), "default");
        let mut learner = Learner::new(LearnConfig::default(), meta.clone());
        for entry in self.world.dataset("learn", &self.schedule.learn).entries {
            let image = entry.source.load()?;
            learner.observe(
                &Observation::new(
                    entry.place,
                    SessionId::derive("one run"),
                    entry.time,
                    &extractor.extract(&image, None)?,
                    (image.width() as u32, image.height() as u32),
                )
                .with_source(entry.id),
            )?;
        }
        let snapshot = learner.snapshot()?;
        Map::create(path, meta)?.commit(&snapshot)?;
        Ok(())
    }
}

/// What a session took.
#[derive(Default)]
struct Cost {
    num_recorded: u64,
    /// Of the robot's own loop.
    localizing: Duration,
    recording: Duration,
    /// Of all threads before the first query, s.
    idle_s: Option<f64>,
    /// Resident memory before the first query, after a tenth of them, and after the last.
    idle_kib: Option<u64>,
    early_kib: Option<u64>,
    late_kib: Option<u64>,
}

impl Cost {
    fn print(&self, args: &Args) -> Result<()> {
        let num = args.queries.max(1) as f64;
        let num_recorded = (self.num_recorded as f64).max(1.0);
        let localizing_ms = self.localizing.as_secs_f64() * 1e3 / num;
        let recording_ms = self.recording.as_secs_f64() * 1e3 / num_recorded;
        println!(
            "{} queries, {} recorded, every {}th with its picture",
            args.queries, self.num_recorded, args.image_every
        );
        println!(
            "localising {localizing_ms:.2} ms a query, \
             recording {recording_ms:.3} ms of the robot's loop: {:.1} %",
            100.0 * recording_ms / localizing_ms.max(f64::MIN_POSITIVE)
        );
        if let (Some(before), Some(after)) = (self.idle_s, processor_s()) {
            println!(
                "processor time in all: {:.2} ms a query",
                (after - before) * 1e3 / num
            );
        }
        let (Some(idle), Some(early), Some(late), Some(most)) = (
            self.idle_kib,
            self.early_kib,
            self.late_kib,
            memory_kib("VmHWM:"),
        ) else {
            return Ok(());
        };
        let mib = |kib: u64| kib / 1024;
        println!(
            "resident memory: {} MiB before, {} MiB after a tenth, {} MiB at the end, \
             {} MiB at most",
            mib(idle),
            mib(early),
            mib(late),
            mib(most)
        );
        let grown = mib(early.max(late).saturating_sub(idle));
        ensure!(
            args.max_mib.is_none_or(|max| grown <= max),
            "it grew by {grown} MiB while it recorded"
        );
        Ok(())
    }
}

/// Processor time of blocks of queries, alternately without and with recording.
#[derive(Default)]
struct Blocks {
    /// Whether the block that runs is recorded, and the processor time when it began, s.
    running: Option<(bool, f64)>,
    /// Processor time of each finished block, s.
    without: Vec<f64>,
    with: Vec<f64>,
}

impl Blocks {
    fn next(&mut self, is_recorded: bool) {
        self.end();
        self.running = processor_s().map(|now| (is_recorded, now));
    }

    fn end(&mut self) {
        if let (Some((is_recorded, began)), Some(now)) = (self.running.take(), processor_s()) {
            let finished = if is_recorded {
                &mut self.with
            } else {
                &mut self.without
            };
            finished.push(now - began);
        }
    }

    /// The median of each kind; a block that was cut short counts as the others do.
    fn print(&self, size: usize) {
        let median = |of: &[f64]| -> Option<f64> {
            let mut sorted = of.to_vec();
            sorted.sort_by(f64::total_cmp);
            sorted.get(sorted.len() / 2).copied()
        };
        if let (Some(without), Some(with)) = (median(&self.without), median(&self.with)) {
            let ms = |seconds: f64| seconds * 1e3 / size.max(1) as f64;
            println!(
                "processor time of {} and {} blocks of {size}: \
                 {:.2} ms a query without recording, {:.2} ms with it: {:+.1} %",
                self.without.len(),
                self.with.len(),
                ms(without),
                ms(with),
                100.0 * (with - without) / without.max(f64::MIN_POSITIVE)
            );
        }
    }
}

/// What the process holds in memory (`VmRSS:`) or ever held (`VmHWM:`), KiB.
fn memory_kib(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok()
}

/// Processor time of all threads so far, s.
fn processor_s() -> Option<f64> {
    // Clock ticks of user and system time, of which Linux has 100 a second for every program.
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |index: usize| fields.get(index)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

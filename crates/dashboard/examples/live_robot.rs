//! A robot's own loop with a live dashboard: localise every picture, record it, keep memory flat.
//!
//! ```sh
//! cargo run --example live_robot -- --queries 10000 --save target/robot.rrd   # as fast as it goes, measured
//! cargo run --example live_robot -- --hz 10 --queries 36000 --connect         # one hour, watched live
//! ```
//!
//! At the end it says what localising and recording took, and how much memory the process held after the
//! first tenth of the session and at its end. Memory is `VmRSS` of Linux; elsewhere it is not shown.
#![allow(clippy::print_stdout)] // reason: the measurement is this example's output.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, GrayImage, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::trace::{Shot, Stage, TraceConfig, Tracer};
use chronotope::localize::{Localization, Localizer, LocalizerConfig, Query};
use chronotope::map::{MapMeta, SessionId, derived_uuid};
use chronotope_dashboard::{Destination, Page, Recorder, RecorderConfig};
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
    #[arg(long, default_value_t = 10)]
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
}

fn main() -> Result<()> {
    let args = Args::parse();
    let extractor = StarBrief::new(StarBriefConfig::default())?;
    let world = World::new(&WorldConfig::new(1))?;
    let schedule = Schedule::standard(1, 12, NUM_PICTURES);
    let localizer = learn(&world, &schedule, &extractor)?;
    let pictures: Vec<GrayImage> = (schedule.query.iter().enumerate())
        .map(|(i, &time)| world.render(i % world.places().len(), time, 0))
        .collect();
    let start = schedule.query.first().copied().unwrap_or_default();

    let destination = match args.connect {
        Some(url) => Destination::Viewer(url),
        None => Destination::File(args.save),
    };
    // Pictures and points are what weighs: the tracer encodes no more pictures than the recorder draws.
    let cfg = RecorderConfig::default()
        .with_image_every(args.image_every as u64)
        .with_page(if args.why { Page::Why } else { Page::Now });
    let mut recorder = Recorder::new(destination, cfg)?;
    let mut tracer = Tracer::new(
        TraceConfig::default()
            .with_image_every(args.image_every)
            .with_num_candidates(3),
    );
    let mut scratch = localizer.scratch();
    let mut answer = Localization::default();
    let (mut localizing, mut recording) = (Duration::ZERO, Duration::ZERO);
    let mut early_kib = None;
    let began = Instant::now();
    for i in 0..args.queries {
        if let Some(hz) = args.hz {
            let due = began + Duration::from_secs_f64(i as f64 / hz);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        let picture = &pictures[i % pictures.len()];
        let time = start.plus_us(STEP_US * i as i64);
        let before = Instant::now();
        let live = extractor.extract(picture, None)?;
        let extract = Stage::since("extract", before);
        let localize = Instant::now();
        let query = Query {
            features: &live,
            time: Some(time),
            image_size: None,
        };
        localizer.localize_into(&mut scratch, &query, &mut answer)?;
        let stages = [extract, Stage::since("localize", localize)];
        localizing += before.elapsed();

        let before = Instant::now();
        let shot = Shot {
            name: "camera",
            file: None,
            recipe: "",
            picture,
            time: Some(time),
            time_source: Some("clock"),
            truth: None,
            live: &live,
            stages: &stages,
        };
        recorder.record(&tracer.trace(&localizer, &shot, &answer)?)?;
        recording += before.elapsed();
        if i == args.queries / 10 {
            early_kib = resident_kib();
        }
    }
    let late_kib = resident_kib();
    let num = recorder.finish()?;

    let ms = |total: Duration| total.as_secs_f64() * 1e3 / num.max(1) as f64;
    println!(
        "{num} queries, every {}th picture recorded",
        args.image_every
    );
    println!(
        "localising {:.2} ms a query, recording {:.2} ms: {:.1} %",
        ms(localizing),
        ms(recording),
        100.0 * recording.as_secs_f64() / localizing.as_secs_f64().max(f64::MIN_POSITIVE)
    );
    if let (Some(early), Some(late)) = (early_kib, late_kib) {
        println!(
            "resident memory {} MiB after a tenth, {} MiB at the end",
            early / 1024,
            late / 1024
        );
    }
    Ok(())
}

fn learn(world: &World, schedule: &Schedule, extractor: &StarBrief) -> Result<Localizer> {
    let meta = MapMeta::new(derived_uuid("live robot"), extractor.id(), "default");
    let mut learner = Learner::new(LearnConfig::default(), meta);
    for entry in world.dataset("learn", &schedule.learn).entries {
        let image = entry.source.load()?;
        learner.observe(&Observation {
            place: entry.place,
            session: SessionId::derive("one run"),
            time: entry.time,
            features: &extractor.extract(&image, None)?,
            image_size: (image.width() as u32, image.height() as u32),
            mask: None,
            source: entry.id,
        })?;
    }
    Localizer::new(learner.snapshot()?, LocalizerConfig::default())
        .context("the map cannot be localised in")
}

/// What the process holds in memory, KiB.
fn resident_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok()
}

//! Does the command turn a pipe into a complete recording, also when it is interrupted?
#![allow(
    clippy::unwrap_used,
    reason = "a helper of tests; clippy only knows their functions"
)]

use std::io::Write as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, GrayImage, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::{Localizer, LocalizerConfig, Query};
use chronotope::map::{Map, MapMeta, SessionId, Snapshot, derived_uuid};
use chronotope::trace::{Shot, Stage, TraceConfig, Tracer};
use chronotope_dashboard::{Background, Destination, RecorderConfig, entities, rows};

const NUM_QUERIES: usize = 4;

/// A street of two places, learnt, and pictures to query with and their times.
struct Street {
    snapshot: Arc<Snapshot>,
    extractor: StarBrief,
    queries: Vec<(GrayImage, chronotope::Time)>,
}

impl Street {
    fn new() -> Self {
        let world = World::new(
            &WorldConfig::new(1)
                .with_num_places(2)
                .with_image_size(320, 256),
        )
        .unwrap();
        let schedule = Schedule::standard(1, 8, NUM_QUERIES / 2);
        let extractor = StarBrief::new(StarBriefConfig::default()).unwrap();
        let meta = MapMeta::new(derived_uuid("pipe"), extractor.id(), "default");
        let mut learner = Learner::new(LearnConfig::default(), meta);
        for entry in world.dataset("learn", &schedule.learn).entries {
            let image = entry.source.load().unwrap();
            learner
                .observe(
                    &Observation::new(
                        entry.place,
                        SessionId::derive("one run"),
                        entry.time,
                        &extractor.extract(&image, None).unwrap(),
                        image.size(),
                    )
                    .with_source(entry.id),
                )
                .unwrap();
        }
        let queries = (world.dataset("query", &schedule.query).entries.into_iter())
            .map(|entry| (entry.source.load().unwrap(), entry.time))
            .collect();
        Self {
            snapshot: learner.snapshot().unwrap(),
            extractor,
            queries,
        }
    }

    /// Gives the trace of every picture to `take`.
    fn trace(&self, mut take: impl FnMut(chronotope::trace::Trace<'_>)) {
        let localizer =
            Localizer::new(Arc::clone(&self.snapshot), LocalizerConfig::default()).unwrap();
        let mut tracer = Tracer::new(TraceConfig::default());
        for (picture, time) in &self.queries {
            let live = self.extractor.extract(picture, None).unwrap();
            let query = Query::new(&live).at(*time);
            let answer = localizer
                .localize(&mut localizer.scratch(), &query)
                .unwrap();
            let shot = Shot {
                name: "query",
                file: None,
                recipe: "",
                picture,
                time: Some(*time),
                time_source: None,
                truth: None,
                live: &live,
                stages: &[Stage {
                    name: "localize".into(),
                    ms: 1.0,
                }],
            };
            take(tracer.trace(&localizer, &shot, &answer).unwrap());
        }
    }

    fn lines(&self) -> String {
        let mut text = String::new();
        self.trace(|trace| {
            text.push_str(&serde_json::to_string(&trace).unwrap());
            text.push('\n');
        });
        text
    }
}

fn dashboard(recording: &Path) -> Child {
    Command::new(env!("CARGO_BIN_EXE_chronotope-dashboard"))
        .arg("--save")
        .arg(recording)
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn assert_complete(recording: &Path) {
    let rows = rows(recording).unwrap();
    for entity in [
        entities::DECISION,
        entities::LIVE_IMAGE,
        entities::SIMILARITY,
    ] {
        assert_eq!(rows.get(entity), Some(&NUM_QUERIES), "{entity}: {rows:?}");
    }
}

#[test]
fn a_pipe_becomes_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("pipe.rrd");
    let mut child = dashboard(&recording);
    let mut pipe = child.stdin.take().unwrap();
    pipe.write_all(Street::new().lines().as_bytes()).unwrap();
    drop(pipe);
    let output = child.wait_with_output().unwrap();
    let diagnostics = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{diagnostics}");
    assert!(
        diagnostics.contains("recorded 4 localisations"),
        "{diagnostics}"
    );
    assert_complete(&recording);
}

#[cfg(unix)]
#[test]
fn ctrl_c_finishes_the_file_though_the_pipe_stays_open() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("interrupt.rrd");
    let mut child = dashboard(&recording);
    let mut pipe = child.stdin.take().unwrap();
    pipe.write_all(Street::new().lines().as_bytes()).unwrap();
    pipe.flush().unwrap();
    // All lines are in the pipe; what is left after the signal is read before it ends.
    std::thread::sleep(Duration::from_secs(5));
    let killed = Command::new("sh")
        .args(["-c", "kill -INT \"$0\"", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
    let status = child.wait().unwrap();
    drop(pipe);
    assert!(status.success(), "{status}");
    assert_complete(&recording);
}

#[test]
fn a_thread_of_its_own_records_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("thread.rrd");
    let background = Background::new(
        Destination::File(recording.clone()),
        RecorderConfig::default(),
    )
    .unwrap();
    Street::new().trace(|trace| background.record(trace).unwrap());
    assert_eq!(background.finish().unwrap(), NUM_QUERIES as u64);
    assert_complete(&recording);
}

/// The evaluation that records is an example of this crate; `cargo test` builds it unless it is
/// told to build this file alone.
#[test]
fn a_replay_recorded_at_once_holds_what_its_trace_gives() {
    let command = Path::new(env!("CARGO_BIN_EXE_chronotope-dashboard"))
        .with_file_name("examples")
        .join(format!("chronotope-eval{}", std::env::consts::EXE_SUFFIX));
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let replayed = Command::new(command)
        .args(["replay", "synthetic", "--trace"])
        .arg(at("trace.jsonl"))
        .arg("--rerun")
        .arg(at("at-once.rrd"))
        .status()
        .expect("cargo build --example chronotope-eval");
    assert!(replayed.success(), "{replayed}");
    let rendered = Command::new(env!("CARGO_BIN_EXE_chronotope-dashboard"))
        .arg(at("trace.jsonl"))
        .arg("--save")
        .arg(at("later.rrd"))
        .status()
        .unwrap();
    assert!(rendered.success(), "{rendered}");
    let held = rows(&at("at-once.rrd")).unwrap();
    assert_eq!(held, rows(&at("later.rrd")).unwrap());
    let num_queries = held.get(entities::DECISION).copied().unwrap_or_default();
    let trace = std::fs::read_to_string(at("trace.jsonl")).unwrap();
    assert!(num_queries > 0 && num_queries == trace.lines().count());
}

/// With the command of the main workspace in `CHRONOTOPE_COMMAND`, as `make test` sets it.
#[test]
fn the_command_and_the_dashboard_speak_one_language() {
    let Some(command) = std::env::var_os("CHRONOTOPE_COMMAND") else {
        println!("skipped: CHRONOTOPE_COMMAND names no command `chronotope`");
        return;
    };
    let street = Street::new();
    let folder = tempfile::tempdir().unwrap();
    let map_path = folder.path().join("street.map");
    let snapshot = &street.snapshot;
    let map = Map::create(&map_path, snapshot.meta().clone()).unwrap();
    map.commit(snapshot).unwrap();
    drop(map);
    let mut localize = Command::new(command);
    localize.arg("localize").arg(&map_path);
    for (index, (picture, _)) in street.queries.iter().enumerate() {
        let path = folder.path().join(format!("{index}.png"));
        let (width, height) = picture.size();
        image::GrayImage::from_raw(width, height, picture.data().to_vec())
            .unwrap()
            .save(&path)
            .unwrap();
        localize.arg(path);
    }
    localize.args(["--time", &street.queries[0].1.to_string(), "--trace", "-"]);
    let mut localize = localize.stdout(Stdio::piped()).spawn().unwrap();
    let recording = folder.path().join("command.rrd");
    let status = Command::new(env!("CARGO_BIN_EXE_chronotope-dashboard"))
        .arg("--save")
        .arg(&recording)
        .stdin(localize.stdout.take().unwrap())
        .status()
        .unwrap();
    assert!(localize.wait().unwrap().code().unwrap() < 2);
    assert!(status.success(), "{status}");
    assert_complete(&recording);
}

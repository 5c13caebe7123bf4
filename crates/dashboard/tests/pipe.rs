//! Does the command turn a pipe into a complete recording, also when it is interrupted?
#![allow(
    clippy::unwrap_used,
    reason = "a helper of tests; clippy only knows their functions"
)]

use std::collections::BTreeMap;
use std::io::{BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, GrayImage, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::trace::{Shot, Stage, TraceConfig, Tracer};
use chronotope::localize::{Localizer, LocalizerConfig, Query};
use chronotope::map::{Map, MapMeta, SessionId, Snapshot, derived_uuid};
use chronotope_dashboard::{Background, Destination, RecorderConfig, entities};
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};

const NUM_QUERIES: usize = 4;

/// A file in a folder of this test's own.
fn scratch(test: &str, name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}

/// A street of two places, learnt, and pictures to ask for with their times.
struct Street {
    snapshot: Arc<Snapshot>,
    extractor: StarBrief,
    asked: Vec<(GrayImage, chronotope::Time)>,
}

impl Street {
    fn new() -> Self {
        let world = World::new(&WorldConfig::new(1).num_places(2).image_size(320, 256)).unwrap();
        let schedule = Schedule::standard(1, 8, NUM_QUERIES / 2);
        let extractor = StarBrief::new(StarBriefConfig::default()).unwrap();
        let meta = MapMeta::new(derived_uuid("pipe"), extractor.id(), "default");
        let mut learner = Learner::new(LearnConfig::default(), meta);
        for entry in world.dataset("learn", &schedule.learn).entries {
            let image = entry.source.load().unwrap();
            learner
                .observe(&Observation {
                    place: entry.place,
                    session: SessionId::derive("one run"),
                    time: entry.time,
                    features: &extractor.extract(&image, None).unwrap(),
                    image_size: (image.width() as u32, image.height() as u32),
                    mask: None,
                    source: entry.id,
                })
                .unwrap();
        }
        let asked = (world.dataset("ask", &schedule.query).entries.into_iter())
            .map(|entry| (entry.source.load().unwrap(), entry.time))
            .collect();
        Self {
            snapshot: learner.snapshot().unwrap(),
            extractor,
            asked,
        }
    }

    /// Gives the trace of every picture to `take`.
    fn trace(&self, mut take: impl FnMut(chronotope::localize::trace::Trace<'_>)) {
        let localizer =
            Localizer::new(Arc::clone(&self.snapshot), LocalizerConfig::default()).unwrap();
        let mut tracer = Tracer::new(TraceConfig::default());
        for (picture, time) in &self.asked {
            let live = self.extractor.extract(picture, None).unwrap();
            let query = Query {
                features: &live,
                time: Some(*time),
                image_size: None,
            };
            let answer = localizer
                .localize(&mut localizer.scratch(), &query)
                .unwrap();
            let shot = Shot {
                name: "asked",
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
    let _ = std::fs::remove_file(recording);
    Command::new(env!("CARGO_BIN_EXE_chronotope-dashboard"))
        .arg("--save")
        .arg(recording)
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// The number of rows of each entity of a recording that can be read to its end.
fn rows(recording: &Path) -> BTreeMap<String, usize> {
    let file = BufReader::new(std::fs::File::open(recording).unwrap());
    let mut rows = BTreeMap::new();
    for message in DecoderApp::decode_lazy(file) {
        if let LogMsg::ArrowMsg(_, message) = message.unwrap() {
            let chunk = Chunk::from_arrow_msg(&message).unwrap();
            let entity = chunk.entity_path().to_string();
            *rows
                .entry(entity.trim_start_matches('/').to_owned())
                .or_insert(0) += chunk.num_rows();
        }
    }
    rows
}

fn assert_complete(recording: &Path) {
    let rows = rows(recording);
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
    let recording = scratch("pipe", "pipe.rrd");
    let mut child = dashboard(&recording);
    let mut pipe = child.stdin.take().unwrap();
    pipe.write_all(Street::new().lines().as_bytes()).unwrap();
    drop(pipe);
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("recorded 4 localisations"), "{said}");
    assert_complete(&recording);
}

#[cfg(unix)]
#[test]
fn ctrl_c_finishes_the_file_though_the_pipe_stays_open() {
    let recording = scratch("interrupt", "interrupt.rrd");
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
    let recording = scratch("thread", "thread.rrd");
    let background = Background::new(
        Destination::File(recording.clone()),
        RecorderConfig::default(),
    )
    .unwrap();
    Street::new().trace(|trace| background.record(trace).unwrap());
    assert_eq!(background.finish().unwrap(), NUM_QUERIES as u64);
    assert_complete(&recording);
}

/// With the command of the main workspace in `CHRONOTOPE_COMMAND`, as `make test` sets it.
#[test]
fn the_command_and_the_dashboard_speak_one_language() {
    let Some(command) = std::env::var_os("CHRONOTOPE_COMMAND") else {
        println!("skipped: CHRONOTOPE_COMMAND names no command `chronotope`");
        return;
    };
    let street = Street::new();
    let map_path = scratch("command", "street.map");
    let _ = std::fs::remove_file(&map_path);
    let snapshot = &street.snapshot;
    let map = Map::create(&map_path, snapshot.meta.clone()).unwrap();
    map.commit(snapshot).unwrap();
    drop(map);
    let mut localize = Command::new(command);
    localize.arg("localize").arg(&map_path);
    for (index, (picture, _)) in street.asked.iter().enumerate() {
        let path = scratch("command", &format!("{index}.png"));
        let (width, height) = (picture.width() as u32, picture.height() as u32);
        image::GrayImage::from_raw(width, height, picture.data().to_vec())
            .unwrap()
            .save(&path)
            .unwrap();
        localize.arg(path);
    }
    localize.args(["--time", &street.asked[0].1.to_string(), "--trace", "-"]);
    let mut localize = localize.stdout(Stdio::piped()).spawn().unwrap();
    let recording = scratch("command", "command.rrd");
    let _ = std::fs::remove_file(&recording);
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

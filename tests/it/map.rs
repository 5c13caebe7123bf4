//! A map keeps what it was given, or says what is wrong.
#![allow(
    clippy::expect_used,
    reason = "these functions all belong to tests, which clippy cannot see here"
)]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use chronotope::feature::{Descriptor, Features, Keypoint, Rect};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::Preset;
use chronotope::map::{
    AppearanceUse, Edge, Map, MapMeta, Node, NodeId, NodeParts, PlaceKey, SessionId, Snapshot,
    SnapshotParts, Visit, VisitId, derived_uuid, features_digest,
};
use chronotope::visibility::{BitRow, HistoryLog};
use chronotope::{ErrorKind, Time};
use proptest::prelude::*;

fn features(seed: u64, len: usize) -> Features {
    let mut features = Features::new();
    for i in 0..len as u64 {
        let mixed = (seed * 1_000_003 + i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let keypoint = Keypoint {
            x: (mixed % 752) as f32 + 0.25,
            y: (mixed >> 20) as f32 % 480.0,
            size: 12.0 + (i % 5) as f32,
            response: -1.5 * i as f32,
        };
        features.push(
            keypoint,
            Descriptor([mixed, !mixed, mixed.rotate_left(17), i]),
        );
    }
    features
}

fn visit(key: &PlaceKey, seed: u64, kept: bool) -> Visit {
    let seen = features(seed, 3);
    let session = SessionId::derive(&format!("session {}", seed % 3));
    let time = Time::from_us(1_255_600_000_000_000 + seed as i64 * 3_600_000_001);
    Visit {
        id: VisitId::derive(session, key, time, &features_digest(&seen)),
        session,
        time,
        source: format!("image-{seed}.png"),
        appearance: kept.then(|| Arc::new(seen)),
        appearance_use: if seed.is_multiple_of(2) {
            AppearanceUse::Experience
        } else {
            AppearanceUse::Recognised
        },
    }
}

/// One thing that happens to a map.
#[derive(Clone, Debug)]
enum Step {
    Visit {
        place: u8,
        born: usize,
        seen: Vec<bool>,
        hidden: Option<Vec<bool>>,
        located_by: Vec<bool>,
        kept: bool,
    },
    Pose {
        place: u8,
        pose: Option<[f64; 3]>,
    },
    Edge {
        from: u8,
        to: u8,
    },
    NoEdges,
    Zone(bool),
    Attach(u8, Vec<u8>),
}

fn step() -> impl Strategy<Value = Step> {
    let bits = || proptest::collection::vec(any::<bool>(), 1..80);
    prop_oneof![
        8 => (
            0..4_u8, 0..40_usize, bits(), proptest::option::of(bits()), bits(), any::<bool>()
        ).prop_map(|(place, born, seen, hidden, located_by, kept)| {
            Step::Visit { place, born, seen, hidden, located_by, kept }
        }),
        1 => (0..4_u8, proptest::option::of(proptest::array::uniform3(-1e6..1e6)))
            .prop_map(|(place, pose)| Step::Pose { place, pose }),
        2 => (0..4_u8, 0..4_u8).prop_map(|(from, to)| Step::Edge { from, to }),
        1 => Just(Step::NoEdges),
        1 => any::<bool>().prop_map(Step::Zone),
        2 => (0..3_u8, proptest::collection::vec(any::<u8>(), 0..40))
            .prop_map(|(name, value)| Step::Attach(name, value)),
    ]
}

/// What a budget may do to one place: which of its visits and features it keeps.
#[derive(Clone, Debug)]
struct Forget {
    place: u8,
    visits: Vec<bool>,
    features: Vec<bool>,
}

fn forget() -> impl Strategy<Value = Forget> {
    let bits = || proptest::collection::vec(any::<bool>(), 1..9);
    (0..4_u8, bits(), bits()).prop_map(|(place, visits, features)| Forget {
        place,
        visits,
        features,
    })
}

fn repeated(bits: &[bool], len: usize) -> Vec<bool> {
    (0..len).map(|i| bits[i % bits.len()]).collect()
}

fn lose(snapshot: &mut Snapshot, forget: &Forget) {
    let Some(id) = snapshot.find(&place(forget.place)) else {
        return;
    };
    let node = snapshot.node(id);
    let visits = repeated(&forget.visits, node.visits().len());
    let features = repeated(&forget.features, node.features().len());
    let (node, _) = node.retained(&visits, &features).expect("in step");
    snapshot.replace_node(id, node).expect("the same place");
}

pub(crate) fn place(number: u8) -> PlaceKey {
    PlaceKey::new(&format!("place {number} ✓")).expect("valid")
}

fn take(snapshot: &mut Snapshot, number: u64, step: &Step) {
    match step {
        Step::Visit {
            place: at,
            born,
            seen,
            hidden,
            located_by,
            kept,
        } => {
            let key = place(*at);
            let id = snapshot.find_or_add(&key);
            let node = snapshot.node(id);
            let len = node.features().len() + born;
            let (mut seen_row, mut hidden_row) = (BitRow::zeros(len), BitRow::zeros(len));
            for i in 0..len {
                if seen[i % seen.len()] {
                    seen_row.set(i);
                } else if hidden.as_ref().is_some_and(|h| h[i % h.len()]) {
                    hidden_row.set(i);
                }
            }
            let visit = visit(&key, number, *kept);
            let mut located_row = node.unlocated(visit.appearance_use);
            for i in (0..located_row.len()).filter(|i| located_by[i % located_by.len()]) {
                located_row.set(i);
            }
            let born = features(number + 1000, *born);
            let hidden = hidden.is_some().then_some(hidden_row);
            (snapshot.push_visit(id, visit, &born, seen_row, hidden, located_row))
                .expect("in step");
        }
        Step::Pose { place: at, pose } => {
            let id = snapshot.find_or_add(&place(*at));
            snapshot.set_pose(id, *pose).expect("finite");
        }
        Step::Edge { from, to } => {
            for number in [from, to] {
                snapshot.find_or_add(&place(*number));
            }
            let edge = Edge {
                from: place(*from),
                to: place(*to),
                name: "corridor".into(),
            };
            snapshot.add_edge(edge).expect("both are there");
        }
        Step::NoEdges => snapshot.retain_edges(|_| false),
        Step::Zone(set) => {
            let zone = set.then(|| "Europe/Prague".into());
            set_meta(snapshot, |meta| meta.zone = zone);
        }
        Step::Attach(name, value) if value.is_empty() => {
            snapshot.detach(&format!("value-{name}"));
        }
        Step::Attach(name, value) => {
            let name = format!("value-{name}");
            snapshot.attach(&name, value.as_slice()).expect("a name");
        }
    }
}

fn set_meta(snapshot: &mut Snapshot, change: impl FnOnce(&mut MapMeta)) {
    let mut meta = snapshot.meta().clone();
    change(&mut meta);
    snapshot.set_meta(meta).expect("can be stored");
}

/// The map with other parts of its first place.
pub(crate) fn with_first(
    map: &Snapshot,
    change: impl FnOnce(&mut NodeParts),
) -> chronotope::Result<Snapshot> {
    let first = map.find(&place(0)).expect("there");
    let mut parts = map.node(first).clone().into_parts();
    change(&mut parts);
    let mut changed = map.clone();
    changed.replace_node(first, Node::from_parts(parts)?)?;
    Ok(changed)
}

/// The map with other parts of its own.
pub(crate) fn with_map(
    map: &Snapshot,
    change: impl FnOnce(&mut SnapshotParts),
) -> chronotope::Result<Snapshot> {
    let mut parts = map.clone().into_parts();
    change(&mut parts);
    Snapshot::from_parts(parts)
}

/// A log with rows of these lengths, which hide something or not, at the visits of the first place.
pub(crate) fn experience_log(map: &Snapshot, rows: &[(usize, bool)]) -> HistoryLog {
    let mut log = HistoryLog::new();
    for (&(len, hides), &time) in rows.iter().zip(map.nodes()[0].log().times()) {
        let hidden = hides.then(|| BitRow::zeros(len));
        (log.push_visit(time, BitRow::zeros(len), hidden)).expect("fits");
    }
    log
}

pub(crate) fn meta() -> MapMeta {
    MapMeta {
        image_size: Some((752, 480)),
        crop: Some(Rect {
            x: 1,
            y: 2,
            width: 700,
            height: 400,
        }),
        ..MapMeta::new(derived_uuid("test"), "star-45+brief-32", "default")
    }
}

/// What is seen in an image of a run, one an hour.
pub(crate) fn observation(
    place: PlaceKey,
    number: u64,
    features: &Features,
    image_size: (u32, u32),
) -> Observation<'_> {
    Observation::new(
        place,
        SessionId::derive("run"),
        Time::from_s(number as i64 * 3600),
        features,
        image_size,
    )
    .with_source(format!("{number}.png"))
}

/// In memory where there is such a folder: every commit waits for the disk.
pub(crate) fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder");
    let path = folder.path().join("a.map");
    (folder, path)
}

fn same(a: &Snapshot, b: &Snapshot) -> bool {
    let all = |of: &Snapshot| SnapshotParts {
        generation: 0,
        ..of.clone().into_parts()
    };
    all(a) == all(b)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn any_number_of_commits_and_reopenings_gives_the_same_map(
        steps in proptest::collection::vec(step(), 1..16),
        cuts in proptest::collection::vec(any::<bool>(), 16),
    ) {
        let (_folder, path) = folder();
        let map = Map::create(&path, meta()).expect("new");
        let other = path.with_extension("other");
        let at_once = Map::create(&other, meta()).expect("new");
        let reader = Map::open_read_only(&path).expect("is a map");
        let mut snapshot = Snapshot::clone(&map.snapshot());
        for (number, (step, cut)) in steps.iter().zip(&cuts).enumerate() {
            take(&mut snapshot, number as u64, step);
            if *cut {
                let generation = map.commit(&snapshot).expect("extends");
                prop_assert!(same(&map.snapshot(), &snapshot));
                prop_assert_eq!(map.snapshot().generation(), generation);
                // A second reader follows commit by commit.
                prop_assert_eq!(reader.refresh().expect("sound"), map.snapshot());
            }
        }
        map.commit(&snapshot).expect("extends");
        at_once.commit(&snapshot).expect("extends");
        let reopened = Map::open(&path).expect("is a map");
        prop_assert_eq!(reopened.snapshot(), map.snapshot());
        prop_assert!(same(&reopened.snapshot(), &snapshot));
        prop_assert!(same(&Map::open(&other).expect("is a map").snapshot(), &snapshot));
        prop_assert_eq!(reopened.snapshot().digest(), snapshot.digest());
        let generations = map.generations().expect("readable");
        prop_assert_eq!(generations.last().expect("some").digest, snapshot.digest());
        let report = Map::verify(&path).expect("is a map");
        prop_assert!(report.is_clean(), "{:?}", report.faults);
        prop_assert_eq!(report.digest, Some(snapshot.digest()));
    }

    #[test]
    fn every_generation_can_be_returned_to_and_nothing_is_lost(
        steps in proptest::collection::vec(
            (step(), proptest::option::of(0..100_u64), proptest::option::of(forget())), 1..12
        ),
        keep in any::<u64>(),
    ) {
        let (_folder, path) = folder();
        let map = Map::create(&path, meta()).expect("new");
        let reader = Map::open_read_only(&path).expect("is a map");
        let mut known = vec![map.snapshot()];
        for (number, (step, back, forget)) in steps.iter().enumerate() {
            if let Some(back) = back {
                let to = back % known.len() as u64;
                let generation = map.rollback(to).expect("there");
                prop_assert!(same(&map.snapshot(), &known[to as usize]));
                prop_assert_eq!(map.snapshot().generation(), generation);
                if generation == known.len() as u64 {
                    known.push(map.snapshot());
                }
                prop_assert_eq!(reader.refresh().expect("sound"), map.snapshot());
            }
            let mut snapshot = Snapshot::clone(&map.snapshot());
            take(&mut snapshot, number as u64, step);
            if let Some(forget) = forget {
                lose(&mut snapshot, forget);
            }
            let parent = map.snapshot().generation();
            let generation = map.replace(&snapshot).expect("stored");
            prop_assert!(same(&map.snapshot(), &snapshot));
            if generation == known.len() as u64 {
                known.push(map.snapshot());
                // What a place forgets does not write the map anew.
                let generations = map.generations().expect("readable");
                prop_assert_eq!(generations.last().expect("some").parent, Some(parent));
            }
            prop_assert_eq!(reader.refresh().expect("sound"), map.snapshot());
        }
        let reopened = Map::open(&path).expect("is a map");
        prop_assert_eq!(reopened.snapshot(), map.snapshot());
        for past in &known {
            prop_assert_eq!(&reopened.at(past.generation()).expect("there"), past);
        }
        let generations = reopened.generations().expect("readable");
        prop_assert_eq!(generations.len(), known.len());
        for (generation, past) in generations.iter().zip(&known) {
            prop_assert_eq!(generation.digest, past.digest());
        }
        let report = Map::verify(&path).expect("is a map");
        prop_assert!(report.is_clean(), "{:?}", report.faults);
        // What is kept stays what it was, for those who have the file open, too.
        let prunes_all = keep % 4 == 0;
        let keep = known.iter().map(|it| it.generation()).filter(|it| keep >> it & 1 == 1);
        let keep: BTreeSet<u64> = keep.collect();
        let pruned = reopened.prune(&keep).expect("sound");
        let left = reopened.generations().expect("readable");
        prop_assert_eq!(left.len() + pruned.num_dropped, known.len());
        prop_assert!(keep.iter().all(|number| left.iter().any(|it| it.number == *number)));
        for it in &left {
            prop_assert_eq!(&reader.at(it.number).expect("kept"), &known[it.number as usize]);
        }
        prop_assert_eq!(reader.refresh().expect("sound"), map.snapshot());
        prop_assert_eq!(Map::open(&path).expect("is a map").snapshot(), map.snapshot());
        let report = Map::verify(&path).expect("is a map");
        prop_assert!(report.is_clean(), "{:?}", report.faults);
        if prunes_all {
            // Pruned to its last generation, it is the map that was written at once.
            reopened.prune(&BTreeSet::new()).expect("sound");
            let other = path.with_extension("other");
            let at_once = Map::create(&other, meta()).expect("new");
            at_once.commit(&map.snapshot()).expect("extends");
            let report = Map::verify(&path).expect("is a map");
            prop_assert!(report.is_clean(), "{:?}", report.faults);
            prop_assert_eq!(report.digest, Map::verify(&other).expect("is a map").digest);
            return Ok(());
        }
        let mut snapshot = Snapshot::clone(&map.snapshot());
        take(&mut snapshot, 999, &Step::Zone(map.snapshot().meta().zone.is_none()));
        if pruned.num_dropped > 0 {
            let error = map.commit(&snapshot).expect_err("not refreshed").to_string();
            prop_assert!(error.contains("pruned"), "{}", error);
        }
        map.refresh().expect("sound");
        map.commit(&snapshot).expect("extends");
        prop_assert_eq!(reader.refresh().expect("sound"), map.snapshot());
        let report = Map::verify(&path).expect("is a map");
        prop_assert!(report.is_clean(), "{:?}", report.faults);
    }
}

pub(crate) fn small(path: &Path) -> (Map, Snapshot) {
    let map = Map::create_at(path, meta(), Time::from_s(0)).expect("new");
    let mut snapshot = Snapshot::clone(&map.snapshot());
    for number in 0..6 {
        let step = Step::Visit {
            place: (number % 2) as u8,
            born: 3,
            seen: vec![true, true, false],
            hidden: (number == 3).then(|| vec![true, false]),
            located_by: vec![false, true],
            kept: number == 1,
        };
        take(&mut snapshot, number, &step);
    }
    map.commit_at(&snapshot, Time::from_s(1)).expect("extends");
    (map, snapshot)
}

#[test]
fn a_commit_that_changes_the_past_is_refused() {
    let (_folder, path) = folder();
    let (map, good) = small(&path);
    let refused = |changed: chronotope::Result<Snapshot>| {
        let error = map.commit(&changed.expect("sound by itself"));
        assert_eq!(map.snapshot().generation(), 1);
        error.expect_err("must not be stored").to_string()
    };
    let all = [
        refused(with_map(&good, |parts| parts.meta.uuid = 1)),
        refused(with_map(&good, |parts| parts.meta.crop = None)),
        refused(with_map(&good, |parts| drop(parts.nodes.pop()))),
        refused(with_map(&good, |parts| parts.nodes.swap(0, 1))),
        refused(with_first(&good, |parts| {
            parts.visits[0].source = "another".into();
        })),
        refused(with_first(&good, |parts| {
            parts.visits[1].appearance = Some(Arc::default());
        })),
    ];
    for message in all {
        assert!(message.contains("does not extend"), "{message}");
        assert!(message.contains("a.map"), "{message}");
    }
    let mut twice = good.clone();
    let first = twice.find(&place(0)).expect("there");
    let again = twice.nodes()[0].visits()[0].clone();
    let node = twice.node(first);
    let seen = BitRow::zeros(node.features().len());
    let located_by = node.unlocated(again.appearance_use);
    (twice.push_visit(first, again, &Features::new(), seen, None, located_by)).expect("in step");
    let message = refused(Ok(twice));
    assert!(message.contains("already"), "{message}");
    let other_log = experience_log(&good, &[(1, false), (2, false), (3, false)]);
    let message = refused(with_first(&good, |parts| parts.experience_log = other_log));
    assert!(message.contains("visit 0 is another"), "{message}");
    assert_eq!(map.commit(&good).expect("nothing new"), 1);
    assert!(Map::verify(&path).expect("is a map").is_clean());
}

#[test]
fn push_visit_refuses_bits_for_other_experiences_and_changes_nothing() {
    let key = place(0);
    let mut node = Node::new(key.clone());
    for (seed, bits) in [(0, 0), (0, 2), (1, 1)] {
        let before = node.clone();
        let error = node
            .push_visit(
                visit(&key, seed, false),
                &features(seed, 2),
                BitRow::zeros(2),
                None,
                BitRow::zeros(bits),
            )
            .expect_err("an experience has a bit, another visit none");
        assert_eq!(error.kind(), ErrorKind::Shape);
        assert_eq!(node, before);
    }
    // An experience whose appearance was not kept counts all the same.
    for (seed, expected) in [(0, &[0][..]), (1, &[]), (2, &[1])] {
        let visit = visit(&key, seed, false);
        let row = node.unlocated(visit.appearance_use);
        assert_eq!(row.ones().collect::<Vec<_>>(), expected);
        node.push_visit(visit, &Features::new(), BitRow::zeros(0), None, row)
            .expect("in step");
    }
    assert_eq!(node.experience_log().num_features(), 2);
    assert!(node.check().is_ok());
}

/// The reference recipe writes its log when all images are known: every feature is in the row of
/// the first visit, whether it was seen there or not.
#[test]
fn a_map_whose_features_all_come_with_the_first_visit_is_kept() {
    let observe = |learner: &mut Learner, numbers: std::ops::Range<u64>| {
        for number in numbers {
            let live = features(number / 4 % 3, 40);
            let key = place((number % 2) as u8);
            let seen = observation(key, number, &live, (752, 480));
            learner.observe(&seen).expect("fits");
        }
        learner.snapshot().expect("in step")
    };
    let (_folder, path) = folder();
    let map = Map::create(
        &path,
        MapMeta::new(derived_uuid("lttl"), "star+brief", "lttl"),
    );
    let map = map.expect("new");
    let cfg = LearnConfig::preset(Preset::Lttl);
    let mut learner = Learner::resume(cfg, Snapshot::clone(&map.snapshot())).unwrap();
    let learnt = observe(&mut learner, 0..8);
    let node = &learnt.nodes()[0];
    assert_eq!(node.born_at(0), 0..node.features().len());
    assert!(node.log().seen_row(0).count_ones() < node.features().len());
    assert!(learnt.check().is_ok());
    map.commit(&learnt).expect("extends");
    let reopened = Map::open(&path).expect("is a map");
    assert!(same(&reopened.snapshot(), &learnt));
    let report = Map::verify(&path).expect("is a map");
    assert!(report.is_clean(), "{:?}", report.faults);
    assert_eq!(report.digest, Some(learnt.digest()));
    // A later image without new features extends the map, one with new features rewrites its past.
    let cfg = LearnConfig::preset(Preset::Lttl);
    let mut learner = Learner::resume(cfg, Snapshot::clone(&reopened.snapshot())).unwrap();
    let more = observe(&mut learner, 12..14);
    reopened.commit(&more).expect("extends");
    assert!(Map::verify(&path).expect("is a map").is_clean());
    let rewritten = observe(&mut learner, 8..10);
    assert_ne!(
        rewritten.nodes()[0].log().seen_row(0),
        node.log().seen_row(0)
    );
    let error = reopened.commit(&rewritten).expect_err("rewrites visit 0");
    assert!(error.to_string().contains("visit 0 is another"), "{error}");
    assert!(same(&reopened.snapshot(), &more));
    assert!(Map::verify(&path).expect("is a map").is_clean());
}

#[test]
fn two_writers_do_not_overwrite_each_other() {
    let (_folder, path) = folder();
    let (first, snapshot) = small(&path);
    let second = Map::open(&path).expect("is a map");
    let step = |born| Step::Visit {
        place: 0,
        born,
        seen: vec![true],
        hidden: None,
        located_by: vec![false],
        kept: false,
    };
    let (mut a, mut b) = (snapshot.clone(), snapshot);
    take(&mut a, 50, &step(1));
    take(&mut b, 51, &step(2));
    assert_eq!(first.commit(&a).expect("first"), 2);
    let error = second.commit(&b).expect_err("built on generation 1");
    assert!(error.to_string().contains("another process"), "{error}");
    let mut b = Snapshot::clone(&second.refresh().expect("sound"));
    take(&mut b, 51, &step(2));
    assert_eq!(second.commit(&b).expect("now it extends"), 3);
    assert_eq!(first.refresh().expect("sound"), second.snapshot());
}

#[test]
fn one_thread_commits_while_others_read() {
    let (_folder, path) = folder();
    let (map, mut snapshot) = small(&path);
    let reader = Map::open_read_only(&path).expect("is a map");
    std::thread::scope(|scope| {
        let readers: Vec<_> = (0..2)
            .map(|_| {
                scope.spawn(|| {
                    let mut last = 0;
                    while last < 21 {
                        // Opening anew reads the header beside a running commit.
                        let opened = Map::open_read_only(&path).expect("sound").snapshot();
                        let refreshed = reader.refresh().expect("sound");
                        assert!(refreshed.generation() >= opened.generation());
                        assert!(opened.generation() >= last);
                        assert!(opened.check().is_ok());
                        last = opened.generation();
                    }
                })
            })
            .collect();
        for number in 200..220 {
            let step = Step::Visit {
                place: (number % 3) as u8,
                born: 30,
                seen: vec![true, false],
                hidden: None,
                located_by: vec![true, false],
                kept: true,
            };
            take(&mut snapshot, number, &step);
            map.commit(&snapshot).expect("extends");
        }
        for reader in readers {
            reader.join().expect("no assertion failed");
        }
    });
    assert!(Map::verify(&path).expect("is a map").is_clean());
}

#[test]
fn what_is_no_map_is_named_and_left_alone() {
    let (folder, _) = folder();
    let sqlite = |name: &str, id: u32, version: u32| {
        let path = folder.path().join(name);
        let connection = rusqlite::Connection::open(&path).expect("new");
        connection
            .execute_batch(&format!(
                "PRAGMA application_id = {id}; PRAGMA user_version = {version}; CREATE TABLE t (x);"
            ))
            .expect("sound");
        drop(connection);
        std::fs::read(&path).expect("there")
    };
    let foreign = sqlite("a.db", 0, 0);
    let newer = sqlite("b.db", 0x4368_726f, 7);
    let no_tables = sqlite("c.db", 0x4368_726f, 1);
    let cases: [(&str, &[u8], &str); 8] = [
        ("empty", b"", "empty"),
        ("text", b"place,time\n", "a text"),
        ("image", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "a PNG image"),
        ("noise", &[0, 1, 2, 255, 254], "unknown kind"),
        ("short", &foreign[..50], "ends after 50 bytes"),
        ("foreign", &foreign, "another program"),
        ("newer", &newer, "format 7"),
        ("no-tables", &no_tables, "the table is missing"),
    ];
    for (name, bytes, expected) in cases {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("writable");
        for opened in [Map::open(&path), Map::open_read_only(&path)] {
            let error = opened.expect_err(name);
            let message = error.to_string();
            assert_eq!(error.kind(), ErrorKind::Format, "{message}");
            assert!(message.contains(expected), "{message}");
            assert!(message.contains(name), "{message}");
            assert!(message.contains("help: "), "{message}");
        }
        assert!(Map::verify(&path).map_or(true, |report| !report.is_clean()));
        assert_eq!(std::fs::read(&path).expect("there"), bytes, "{name}");
        let error = Map::create(&path, meta()).expect_err("exists");
        assert!(error.to_string().contains("never overwritten"), "{error}");
    }
    let missing = Map::open(folder.path().join("missing")).expect_err("missing");
    assert_eq!(missing.kind(), ErrorKind::NotFound);
    assert!(missing.to_string().contains("map build"), "{missing}");
    let error = Map::open(folder.path()).expect_err("a folder");
    assert!(error.to_string().contains("folder"), "{error}");
}

/// The map as if it was committed as this generation.
pub(crate) fn of_generation(map: Snapshot, generation: u64) -> Snapshot {
    let parts = SnapshotParts {
        generation,
        ..map.into_parts()
    };
    Snapshot::from_parts(parts).expect("as sound as before")
}

/// The map `start` with the visits of commits `from` to `to`.
pub(crate) fn after_commits(start: &Snapshot, from: u64, to: u64) -> Snapshot {
    let mut snapshot = start.clone();
    for number in from..to {
        let step = Step::Visit {
            place: (number % 3) as u8,
            born: 60,
            seen: vec![true, false, true],
            hidden: None,
            located_by: vec![true, false],
            kept: true,
        };
        take(&mut snapshot, number, &step);
    }
    snapshot
}

/// Starts one test of this program again as another process, which finds `path` in `variable`;
/// gives it and the lines that it prints.
pub(crate) fn start_again(
    test: &str,
    variable: &str,
    path: &Path,
) -> (
    std::process::Child,
    impl Iterator<Item = String> + Send + use<>,
) {
    use std::io::{BufRead, BufReader};

    let mut child = std::process::Command::new(std::env::current_exe().expect("running"))
        .args(["--exact", test, "--nocapture"])
        .env(variable, path)
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("can be started");
    let output = BufReader::new(child.stdout.take().expect("piped"));
    (child, output.lines().map_while(Result::ok))
}

/// How often a test kills a process: `CHRONOTOPE_TEST_KILLS`, or `usual`.
pub(crate) fn num_kills(usual: u64) -> u64 {
    let wished = std::env::var("CHRONOTOPE_TEST_KILLS").ok();
    wished
        .and_then(|number| number.parse().ok())
        .unwrap_or(usual)
}

#[test]
fn a_killed_writer_loses_nothing_it_acknowledged() {
    use std::io::Write;

    const FILE: &str = "CHRONOTOPE_TEST_KILLED_WRITER";
    /// Then a new map is begun, so that no round is slower than others.
    const ROUNDS_PER_MAP: u64 = 50;
    let num_rounds = num_kills(24);
    if let Some(path) = std::env::var_os(FILE) {
        // Started again below: commits until it is killed.
        let map = Map::open(path).expect("sound");
        loop {
            let now = map.snapshot();
            let next = after_commits(&now, now.generation(), now.generation() + 1);
            let generation = map.commit(&next).expect("extends");
            writeln!(std::io::stdout(), "committed {generation}").expect("heard");
        }
    }
    let (folder, _) = folder();
    let (mut path, mut known) = (PathBuf::new(), Snapshot::empty(meta()));
    for round in 0..num_rounds {
        if round % ROUNDS_PER_MAP == 0 {
            path = folder.path().join(format!("{round}.map"));
            let map = Map::create(&path, meta()).expect("new");
            known = Snapshot::clone(&map.snapshot());
        }
        let (mut writer, mut lines) = start_again(
            "map::a_killed_writer_loses_nothing_it_acknowledged",
            FILE,
            &path,
        );
        let acknowledged = |line: String| line.strip_prefix("committed ")?.parse::<u64>().ok();
        let mut last = lines.by_ref().find_map(acknowledged).expect("one commit");
        // Another process reads meanwhile: no error, and nothing older than what was acknowledged.
        let reader = Map::open_read_only(&path).expect("sound");
        assert!(reader.snapshot().generation() >= last);
        for _ in 0..round % 4 {
            last = lines.by_ref().find_map(acknowledged).expect("one more");
            assert!(reader.refresh().expect("sound").generation() >= last);
        }
        std::thread::sleep(std::time::Duration::from_micros(round * 377 % 3001));
        writer.kill().expect("runs");
        writer.wait().expect("ours");
        last = lines.filter_map(acknowledged).last().unwrap_or(last);
        let found = Map::open(&path).expect("sound").snapshot();
        assert!(
            (last..=last + 1).contains(&found.generation()),
            "{last} was acknowledged, {} is found",
            found.generation()
        );
        known = after_commits(&known, known.generation(), found.generation());
        known = of_generation(known, found.generation());
        assert_eq!(*found, known);
        assert!(Map::verify(&path).expect("a map").is_clean());
    }
}

#[test]
fn a_killed_prune_or_rollback_leaves_the_map_whole() {
    use std::io::Write;

    const FILE: &str = "CHRONOTOPE_TEST_KILLED_PRUNE";
    if let Some(path) = std::env::var_os(FILE) {
        // Started again below: branches and prunes until it is killed.
        let map = Map::open(path).expect("sound");
        loop {
            let whole = map.snapshot().generation();
            map.rollback(0).expect("there");
            map.rollback(whole).expect("there");
            map.prune(&BTreeSet::new()).expect("sound");
            writeln!(std::io::stdout(), "pruned").expect("heard");
        }
    }
    let (_folder, path) = folder();
    let (map, snapshot) = small(&path);
    drop(map);
    for round in 0..num_kills(12) {
        let (mut writer, mut lines) = start_again(
            "map::a_killed_prune_or_rollback_leaves_the_map_whole",
            FILE,
            &path,
        );
        assert!(lines.by_ref().any(|line| line == "pruned"));
        std::thread::sleep(std::time::Duration::from_micros(round * 911 % 4001));
        writer.kill().expect("runs");
        writer.wait().expect("ours");
        let map = Map::open(&path).expect("sound");
        // Between the two rollbacks the map is empty, and its past is there.
        if map.snapshot().nodes().is_empty() {
            let generations = map.generations().expect("readable");
            let whole = generations.iter().rev().find(|it| it.num_visits > 0);
            map.rollback(whole.expect("kept").number).expect("there");
        }
        assert!(same(&map.snapshot(), &snapshot));
        let report = Map::verify(&path).expect("a map");
        assert!(report.is_clean(), "{:?}", report.faults);
    }
}

/// Whether rights bind this process; to root they are nothing.
fn may_write(folder: &Path) -> bool {
    let probe = folder.join("probe");
    let may = std::fs::write(&probe, b"").is_ok();
    let _ = std::fs::remove_file(probe);
    may
}

#[cfg(unix)]
#[test]
fn a_read_only_folder_can_be_read_and_keeps_its_map() {
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::process::CommandExt;

    const FOLDER: &str = "CHRONOTOPE_TEST_READ_ONLY_FOLDER";
    let rights = |path: &Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("ours");
    };
    if let Some(folder) = std::env::var_os(FOLDER) {
        // Started again below, as somebody whom rights bind.
        check_read_only(Path::new(&folder));
        return;
    }
    let (folder, path) = folder();
    drop(small(&path));
    std::fs::copy(&path, folder.path().join("b.map")).expect("writable");
    rights(&path, 0o444);
    rights(&folder.path().join("b.map"), 0o666);
    rights(folder.path(), 0o555);
    if may_write(folder.path()) {
        let name = "map::a_read_only_folder_can_be_read_and_keeps_its_map";
        // The program itself may lie where only root can go.
        let program = tempfile::tempdir().expect("temporary folder");
        rights(program.path(), 0o755);
        let copy = program.path().join("it");
        std::fs::copy(std::env::current_exe().expect("running"), &copy).expect("writable");
        let status = std::process::Command::new(copy)
            .args(["--exact", name])
            .env(FOLDER, folder.path())
            .current_dir("/")
            .uid(65_534)
            .gid(65_534)
            .status();
        match status {
            Ok(status) => assert!(status.success()),
            Err(error) => skipped(&format!("no unprivileged process can be started: {error}")),
        }
    } else {
        check_read_only(folder.path());
    }
    rights(folder.path(), 0o755);
}

#[cfg(unix)]
fn check_read_only(folder: &Path) {
    assert!(!may_write(folder), "rights should bind this process");
    let path = folder.join("a.map");
    for map in [Map::open(&path), Map::open_read_only(&path)] {
        let map = map.expect("can be read");
        assert!(map.is_read_only());
        let mut next = Snapshot::clone(&map.snapshot());
        assert_eq!(next.summary().num_visits, 6);
        set_meta(&mut next, |meta| meta.preset = "another".into());
        let error = map.commit(&next).expect_err("cannot be written");
        assert_eq!(error.kind(), ErrorKind::Io);
        assert!(error.to_string().contains("a.map"), "{error}");
    }
    assert!(Map::verify(&path).expect("can be read").is_clean());
    // Of this one only the folder forbids the journal.
    let path = folder.join("b.map");
    let map = Map::open(&path).expect("can be read");
    let mut next = Snapshot::clone(&map.snapshot());
    set_meta(&mut next, |meta| meta.preset = "another".into());
    let error = map.commit(&next).expect_err("no journal can be made");
    assert_eq!(error.kind(), ErrorKind::Io);
    assert!(error.to_string().contains("folder"), "{error}");
    assert_eq!(
        Map::open(&path).expect("can be read").snapshot(),
        map.snapshot()
    );
    let error = Map::create(folder.join("new.map"), meta()).expect_err("cannot be written");
    assert!(error.to_string().contains("new.map"), "{error}");
    let files: Vec<_> = std::fs::read_dir(folder).expect("readable").collect();
    assert_eq!(files.len(), 2, "{files:?}");
}

/// Says that a test did not do what it is there for; `make test` counts these
/// (`CHRONOTOPE_SKIPS` names the file that it reads).
#[cfg(unix)]
fn skipped(reason: &str) {
    eprintln!("skipped: {reason}");
    if let Some(path) = std::env::var_os("CHRONOTOPE_SKIPS") {
        use std::io::Write as _;
        let mut options = std::fs::OpenOptions::new();
        let mut file = (options.append(true).create(true).open(path)).expect("writable");
        writeln!(file, "{reason}").expect("writable");
    }
}

/// A file system in memory, gone when dropped.
#[cfg(target_os = "linux")]
struct SmallDisk(tempfile::TempDir);

#[cfg(target_os = "linux")]
impl SmallDisk {
    /// `None` where this process may not mount.
    fn mount(kib: u32) -> Option<Self> {
        let folder = tempfile::tempdir().expect("temporary folder");
        let mounted = std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={kib}k"), "tmpfs"])
            .arg(folder.path())
            .output();
        mounted
            .is_ok_and(|output| output.status.success())
            .then_some(Self(folder))
    }
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = std::process::Command::new("umount")
            .arg(self.0.path())
            .status();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_loses_nothing() {
    let Some(disk) = SmallDisk::mount(256) else {
        skipped("this process may not mount a small tmpfs");
        return;
    };
    let path = disk.0.path().join("a.map");
    let (map, mut snapshot) = small(&path);
    let mut number = 100;
    let error = loop {
        let before = map.snapshot();
        let step = Step::Visit {
            place: 0,
            born: 100,
            seen: vec![true],
            hidden: None,
            located_by: vec![true, false],
            kept: true,
        };
        take(&mut snapshot, number, &step);
        number += 1;
        match map.commit(&snapshot) {
            Ok(generation) => assert_eq!(generation, before.generation() + 1),
            Err(error) => {
                assert_eq!(map.snapshot(), before);
                break error;
            }
        }
        assert!(number < 1000, "the disk never fills up");
    };
    assert_eq!(error.kind(), ErrorKind::Io);
    assert!(error.to_string().contains("disk is full"), "{error}");
    let reopened = Map::open(&path).expect("sound");
    assert_eq!(reopened.snapshot(), map.snapshot());
    assert!(Map::verify(&path).expect("sound").is_clean());
    std::fs::write(disk.0.path().join("filler"), vec![0; 1 << 20]).expect_err("full");
    let error = Map::create(disk.0.path().join("new.map"), meta()).expect_err("full");
    assert!(error.to_string().contains("disk is full"), "{error}");
    assert!(!disk.0.path().join("new.map").exists());
}

#[test]
fn summary_counts_what_is_there() {
    let (_folder, path) = folder();
    let (map, _) = small(&path);
    let summary = map.snapshot().summary();
    assert_eq!(summary.generation, 1);
    assert_eq!((summary.num_places, summary.num_visits), (2, 6));
    assert_eq!((summary.num_features, summary.num_sessions), (18, 3));
    assert_eq!((summary.num_appearances, summary.num_experiences), (1, 0));
    // 18 + 3 features of 48 bytes, 6 rows of seen and 1 of hidden bits; one of the places has
    // experiences, and for each of its 3 visits a row of their bits.
    assert_eq!(summary.num_bytes, 21 * 48 + (7 + 3) * 8);
    assert!(summary.first < summary.last);
}

#[test]
fn attachments_are_kept_replaced_and_removed_and_odd_ones_refused() {
    let (_folder, path) = folder();
    let (map, mut snapshot) = small(&path);
    let without = snapshot.digest();
    (snapshot.attach("a-b2", vec![0; 1 << 24])).expect("as large as may be");
    snapshot.attach("empty", Vec::new()).expect("a name");
    assert_eq!(map.commit(&snapshot).expect("extends"), 2);
    assert_eq!(map.commit(&snapshot).expect("nothing new"), 2);
    snapshot.detach("empty");
    assert!(same(&map.snapshot(), &snapshot), "an empty value is none");
    assert!(same(
        &Map::open(&path).expect("sound").snapshot(),
        &snapshot
    ));
    assert_ne!(snapshot.digest(), without);
    // Not taken over by a snapshot that leaves it out, but still in the past.
    snapshot.detach("a-b2");
    assert_eq!(map.commit(&snapshot).expect("extends"), 3);
    assert!(
        Map::open(&path)
            .expect("sound")
            .snapshot()
            .attachments()
            .is_empty()
    );
    assert_eq!(snapshot.digest(), without);
    assert_eq!(
        map.at(2).expect("there").attachments()["a-b2"].len(),
        1 << 24
    );
    for (name, len, expected) in [
        ("", 1, "no name"),
        ("Upper", 1, "no name"),
        ("a--b", 1, "no name"),
        ("-a", 1, "no name"),
        ("a_b", 1, "no name"),
        ("a".repeat(65).as_str(), 1, "at most 64 bytes"),
        ("large", (1 << 24) + 1, "16777217 bytes"),
    ] {
        let mut odd = snapshot.clone();
        let error = odd.attach(name, vec![1; len]).expect_err(name).to_string();
        assert!(error.contains(expected), "{name}: {error}");
        assert_eq!(odd, snapshot);
    }
    assert_eq!(map.snapshot().generation(), 3);
    assert!(Map::verify(&path).expect("sound").is_clean());
}

#[test]
fn a_rollback_to_what_is_not_there_or_not_newest_is_refused() {
    let (_folder, path) = folder();
    let (map, snapshot) = small(&path);
    let error = map.rollback(7).expect_err("never was").to_string();
    assert!(error.contains("no generation 7"), "{error}");
    assert!(error.contains("map log"), "{error}");
    assert_eq!(map.rollback(1).expect("it is there already"), 1);
    let other = Map::open(&path).expect("a map");
    assert_eq!(other.rollback(0).expect("there"), 2);
    assert!(other.snapshot().nodes().is_empty());
    let error = map.rollback(0).expect_err("not newest").to_string();
    assert!(error.contains("another process"), "{error}");
    assert!(map.refresh().expect("sound").nodes().is_empty());
    // Forward again, and the same visit may be learnt a second time after a rollback.
    assert_eq!(map.rollback(1).expect("there"), 3);
    assert!(same(&map.snapshot(), &snapshot));
    assert_eq!(map.rollback(0).expect("there"), 4);
    assert_eq!(map.commit(&snapshot).expect("extends"), 5);
    let generations = map.generations().expect("readable");
    let parents: Vec<_> = generations.iter().map(|it| it.parent).collect();
    assert_eq!(parents, [None, Some(0), Some(0), Some(1), Some(0), Some(4)]);
    assert!(Map::verify(&path).expect("a map").is_clean());
    let read_only = Map::open_read_only(&path).expect("a map");
    let error = read_only.rollback(0).expect_err("read-only").to_string();
    assert!(error.contains("read-only"), "{error}");
}

#[test]
fn replacing_writes_what_a_commit_refuses_and_keeps_the_past() {
    let (_folder, path) = folder();
    let (map, old) = small(&path);
    let mut new = Snapshot::empty(old.meta().clone());
    let first = old.find(&place(0)).expect("there");
    (new.push_node(Arc::clone(&old.nodes()[1]))).expect("only one");
    for (name, value) in old.attachments() {
        new.attach(name, Arc::clone(value)).expect("a name");
    }
    assert!(map.commit(&new).is_err());
    assert_eq!(map.replace(&new).expect("written"), 2);
    assert!(same(&map.snapshot(), &new));
    assert_eq!(new.find(&place(1)), Some(first));
    // What extends is an ordinary commit.
    set_meta(&mut new, |meta| meta.zone = Some("Europe/Prague".into()));
    assert_eq!(map.replace(&new).expect("written"), 3);
    let parents: Vec<_> = (map.generations().expect("readable").iter())
        .map(|it| it.parent)
        .collect();
    assert_eq!(parents, [None, Some(0), Some(0), Some(2)]);
    assert!(same(&Map::open(&path).expect("a map").snapshot(), &new));
    assert!(same(&map.at(1).expect("kept"), &old));
    set_meta(&mut new, |meta| meta.uuid = 1);
    let error = map.replace(&new).expect_err("another map").to_string();
    assert!(error.contains("uuid"), "{error}");
    assert!(Map::verify(&path).expect("a map").is_clean());
}

/// A map of many places, each with a few visits.
fn many_places(path: &Path, num_places: u8) -> (Map, Snapshot) {
    let map = Map::create(path, meta()).expect("new");
    let mut snapshot = Snapshot::clone(&map.snapshot());
    for number in 0..u64::from(num_places) * 3 {
        let step = Step::Visit {
            place: (number % u64::from(num_places)) as u8,
            born: 20,
            seen: vec![true, false, true],
            hidden: None,
            located_by: vec![true],
            kept: number % 2 == 0,
        };
        take(&mut snapshot, number, &step);
    }
    map.commit(&snapshot).expect("extends");
    (map, snapshot)
}

#[test]
fn a_place_that_forgets_is_written_anew_alone() {
    const NUM_PLACES: u8 = 100;
    let (_folder, path) = folder();
    let (map, before) = many_places(&path, NUM_PLACES);
    let reader = Map::open_read_only(&path).expect("is a map");
    let num_bytes = || std::fs::metadata(&path).expect("there").len();
    let num_bytes_before = num_bytes();
    let mut after = before.clone();
    let forgets = |place| Forget {
        place,
        visits: vec![true, false, true],
        features: vec![true, true, true, false],
    };
    lose(&mut after, &forgets(7));
    assert!(map.commit(&after).is_err());
    assert_eq!(map.replace(&after).expect("stored"), 2);
    let grown = num_bytes() - num_bytes_before;
    assert!(
        grown < num_bytes_before / 10,
        "{grown} of {num_bytes_before}"
    );
    // Once more, with a visit of another place, one that moves there, and one place that loses all.
    lose(&mut after, &forgets(8));
    let moved = after.nodes()[9].visits()[2].clone();
    lose(
        &mut after,
        &Forget {
            place: 9,
            visits: vec![true, true, false],
            ..forgets(9)
        },
    );
    lose(
        &mut after,
        &Forget {
            place: 10,
            visits: vec![false],
            ..forgets(10)
        },
    );
    let other = chronotope::map::NodeId(3);
    let node = after.node(other);
    let (seen, located_by) = (
        BitRow::zeros(node.features().len()),
        node.unlocated(moved.appearance_use),
    );
    (after.push_visit(other, moved, &Features::new(), seen, None, located_by)).expect("in step");
    assert_eq!(map.replace(&after).expect("stored"), 3);
    assert!(same(&reader.refresh().expect("sound"), &after));
    assert!(same(&Map::open(&path).expect("a map").snapshot(), &after));
    assert!(same(&map.at(1).expect("kept"), &before));
    let report = Map::verify(&path).expect("a map");
    assert!(report.is_clean(), "{:?}", report.faults);
    // Back, and forward on another branch, where the place can forget something else.
    assert_eq!(map.rollback(1).expect("there"), 4);
    let mut other = before.clone();
    lose(&mut other, &forgets(7));
    lose(&mut other, &forgets(11));
    assert_eq!(map.replace(&other).expect("stored"), 5);
    assert!(same(&map.at(3).expect("kept"), &after));
    let pruned = map.prune(&BTreeSet::from([3])).expect("sound");
    assert_eq!(pruned.num_dropped, 2);
    for map in [&map, &reader, &Map::open(&path).expect("a map")] {
        assert!(same(&map.refresh().expect("sound"), &other));
        assert!(same(&map.at(3).expect("kept"), &after));
        assert!(same(&map.at(1).expect("where lines part"), &before));
    }
    let report = Map::verify(&path).expect("a map");
    assert!(report.is_clean(), "{:?}", report.faults);
    // All alone it is what it would be at once.
    map.prune(&BTreeSet::new()).expect("sound");
    let at_once = Map::create(path.with_extension("other"), meta()).expect("new");
    at_once.commit(&other).expect("extends");
    let digest = |map: &Map| {
        map.generations()
            .expect("readable")
            .last()
            .map(|it| it.digest)
    };
    assert_eq!(digest(&map), digest(&at_once));
    let at_once = std::fs::metadata(at_once.path()).expect("there").len();
    assert!(
        num_bytes() <= at_once + 8192,
        "{} and {at_once}",
        num_bytes()
    );
    assert!(Map::verify(&path).expect("a map").is_clean());
}

#[test]
fn pruning_a_branch_away_makes_the_file_smaller() {
    let (_folder, path) = folder();
    let (map, snapshot) = small(&path);
    let mut large = snapshot.clone();
    large.attach("large", vec![7; 1 << 20]).expect("a name");
    map.commit(&large).expect("extends");
    map.rollback(1).expect("there");
    let pruned = map.prune(&BTreeSet::new()).expect("sound");
    assert_eq!(pruned.num_dropped, 2);
    assert!(pruned.num_bytes_before > 1 << 20);
    assert!(pruned.num_bytes_after < 1 << 17, "{pruned:?}");
    assert!(same(&map.snapshot(), &snapshot));
    let generations = map.generations().expect("readable");
    let left: Vec<_> = generations
        .iter()
        .map(|it| (it.number, it.parent))
        .collect();
    assert_eq!(left, [(0, None), (3, Some(0))]);
    assert_eq!(
        map.prune(&BTreeSet::new())
            .expect("nothing to do")
            .num_dropped,
        0
    );
    let error = map
        .prune(&BTreeSet::from([2]))
        .expect_err("gone")
        .to_string();
    assert!(error.contains("no generation 2"), "{error}");
    assert!(map.rollback(1).is_err());
    assert!(Map::verify(&path).expect("a map").is_clean());
}

/// The content of `maps/golden/format-1.map`: never to be changed.
fn golden() -> Snapshot {
    let mut snapshot = Snapshot::empty(MapMeta {
        uuid: 0x0123_4567_89ab_8def_8123_4567_89ab_cdef,
        extractor: "star-45+brief-32".into(),
        image_size: Some((752, 480)),
        crop: Some(Rect {
            x: 4,
            y: 8,
            width: 700,
            height: 400,
        }),
        preset: "lttl".into(),
        zone: Some("Europe/Prague".into()),
    });
    let keys = ["door", "lamp post", "tree ✓"].map(|key| PlaceKey::new(key).expect("valid"));
    for visit in 0..6_u64 {
        let key = &keys[visit as usize % 2];
        let id = snapshot.find_or_add(key);
        let node = snapshot.node(id);
        let mut born = Features::new();
        for i in 0..5 + visit {
            let keypoint = Keypoint {
                x: (visit * 100 + i) as f32 + 0.25,
                y: (i * 30) as f32 - 0.5,
                size: 7.0 + i as f32,
                response: -(i as f32) / 3.0,
            };
            let word = (visit * 64 + i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            born.push(keypoint, Descriptor([word, !word, word << 13, word >> 7]));
        }
        let len = node.features().len() + born.len();
        let mut seen = BitRow::zeros(len);
        let mut hidden = BitRow::zeros(len);
        for i in 0..len {
            match (i as u64 + visit) % 3 {
                0 => hidden.set(i),
                1 => seen.set(i),
                _ => {}
            }
        }
        let session = SessionId(0xa000 + u128::from(visit / 2));
        let time = Time::from_us(1_255_608_000_000_001 + visit as i64 * 86_400_000_000);
        let visit = Visit {
            id: VisitId(0xb000 + u128::from(visit)),
            session,
            time,
            source: format!("A{visit:03}/place.bmp"),
            appearance: (visit % 3 == 1).then(|| Arc::new(born.clone())),
            appearance_use: [AppearanceUse::Experience, AppearanceUse::Recognised]
                [visit as usize / 3],
        };
        let is_hidden = visit.id.0 % 2 == 1;
        let mut located_by = node.unlocated(visit.appearance_use);
        for i in (0..located_by.len()).filter(|i| i % 2 == 0) {
            located_by.set(i);
        }
        let hidden = is_hidden.then_some(hidden);
        (snapshot.push_visit(id, visit, &born, seen, hidden, located_by)).expect("in step");
    }
    let never_visited = snapshot.find_or_add(&keys[2]);
    (snapshot.set_pose(never_visited, Some([12.5, -0.0, 1e-3]))).expect("finite");
    for (from, to, name) in [(0, 1, "corridor"), (1, 2, "")] {
        let edge = Edge {
            from: keys[from].clone(),
            to: keys[to].clone(),
            name: name.into(),
        };
        snapshot.add_edge(edge).expect("both are there");
    }
    snapshot
}

/// The content of `maps/golden/format-2.map`: never to be changed.
fn golden_2() -> Snapshot {
    let mut snapshot = golden();
    let values: [(&str, &[u8]); 2] = [("calibration", &[0, 255, 1, 128]), ("held-visits", b"[]")];
    for (name, value) in values {
        snapshot.attach(name, value).expect("a name");
    }
    snapshot
}

fn golden_path(format: u32) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("maps/golden/format-{format}.map"))
}

fn hex(digest: [u8; 32]) -> String {
    digest.map(|byte| format!("{byte:02x}")).concat()
}

#[test]
fn golden_map_of_format_1_still_opens() {
    let path = golden_path(1);
    let bytes = std::fs::read(&path).expect("committed");
    assert!(bytes.len() < 64 * 1024);
    let map = Map::open_read_only(&path).expect("a map for ever");
    let snapshot = map.snapshot();
    assert!(same(&snapshot, &golden()));
    assert_eq!(snapshot.generation(), 2);
    assert_eq!(
        hex(snapshot.digest()),
        "53b28ba2c6d4145d992bd308e98ddbab58f879bfaf97b0137d72a8f17a61bd44"
    );
    let report = Map::verify(&path).expect("a map");
    assert!(report.is_clean(), "{:?}", report.faults);
    assert_eq!(std::fs::read(&path).expect("there"), bytes);
}

#[test]
fn a_map_of_format_1_becomes_one_of_today_at_its_first_commit() {
    let (folder, path) = folder();
    std::fs::copy(golden_path(1), &path).expect("writable");
    let before = std::fs::read(&path).expect("there");
    let map = Map::open(&path).expect("a map");
    let reader = Map::open_read_only(&path).expect("a map");
    let generations = map.generations().expect("readable");
    assert_eq!(map.commit(&map.snapshot()).expect("nothing new"), 2);
    assert_eq!(std::fs::read(&path).expect("there"), before);
    let mut next = golden_2();
    take(&mut next, 70, &Step::Zone(false));
    assert_eq!(map.commit(&next).expect("extends"), 3);
    assert_eq!(reader.refresh().expect("sound"), map.snapshot());
    assert_eq!(map.generations().expect("readable")[..3], generations);
    assert_eq!(map.rollback(2).expect("there"), 4);
    assert!(same(&map.snapshot(), &golden()));
    for map in [&map, &Map::open(&path).expect("a map"), &reader] {
        map.refresh().expect("sound");
        assert!(same(&map.snapshot(), &golden()));
        assert!(same(&map.at(3).expect("there"), &next));
    }
    let report = Map::verify(&path).expect("a map");
    assert!(report.is_clean(), "{:?}", report.faults);
    // A rollback can be what makes it one of today's, too.
    let path = folder.path().join("b.map");
    std::fs::copy(golden_path(1), &path).expect("writable");
    let map = Map::open(&path).expect("a map");
    assert_eq!(map.rollback(0).expect("there"), 3);
    assert!(
        Map::open(&path)
            .expect("a map")
            .snapshot()
            .nodes()
            .is_empty()
    );
    assert!(Map::verify(&path).expect("a map").is_clean());
}

#[test]
fn golden_map_of_format_2_still_opens() {
    let path = golden_path(2);
    let bytes = std::fs::read(&path).expect("committed");
    assert!(bytes.len() < 80 * 1024);
    let map = Map::open_read_only(&path).expect("a map for ever");
    let snapshot = map.snapshot();
    assert!(same(&snapshot, &golden_2()));
    assert_eq!(snapshot.generation(), 5);
    assert_eq!(
        hex(snapshot.digest()),
        "cbbd31faa89ead3af239625e725c1411b6c79953c4110753d6a09a9905f2f9fc"
    );
    let parents: Vec<_> = (map.generations().expect("readable").iter())
        .map(|it| it.parent)
        .collect();
    assert_eq!(parents, [None, Some(0), Some(1), Some(2), Some(2), Some(4)]);
    assert!(same(&map.at(2).expect("there"), &golden()));
    assert_eq!(map.at(3).expect("there").attachments().len(), 1);
    let report = Map::verify(&path).expect("a map");
    assert!(report.is_clean(), "{:?}", report.faults);
    assert_eq!(std::fs::read(&path).expect("there"), bytes);
}

/// The content of `maps/golden/format-3.map`: never to be changed.
fn golden_3() -> Snapshot {
    let mut snapshot = golden_2();
    let door = &snapshot.nodes()[0];
    let features = repeated(&[true, true, false], door.features().len());
    let (door, _) = (door.retained(&[false, true, true], &features)).expect("in step");
    (snapshot.replace_node(NodeId(0), door)).expect("the same place");
    snapshot
}

#[test]
fn golden_map_of_format_3_still_opens() {
    let path = golden_path(3);
    let bytes = std::fs::read(&path).expect("committed");
    assert!(bytes.len() < 96 * 1024);
    let map = Map::open_read_only(&path).expect("a map for ever");
    let snapshot = map.snapshot();
    assert!(same(&snapshot, &golden_3()));
    assert_eq!(snapshot.generation(), 6);
    assert_eq!(
        hex(snapshot.digest()),
        "575fc21e4215477c5c0f7de4fe22979b088c78947ecc418ea9851e4dee1e15db"
    );
    let parents: Vec<_> = (map.generations().expect("readable").iter())
        .map(|it| it.parent)
        .collect();
    let expected = [None, Some(0), Some(1), Some(2), Some(2), Some(4), Some(5)];
    assert_eq!(parents, expected);
    assert!(same(&map.at(2).expect("there"), &golden()));
    assert!(same(&map.at(5).expect("there"), &golden_2()));
    let report = Map::verify(&path).expect("a map");
    assert!(report.is_clean(), "{:?}", report.faults);
    assert_eq!(std::fs::read(&path).expect("there"), bytes);
    // Today's maps still are of format 3, or this test needs a sister.
    let (_folder, path) = folder();
    write_golden(&path);
    let today = Map::open(&path).expect("a map");
    assert_eq!(today.snapshot(), snapshot);
    assert_eq!(
        today.generations().expect("readable"),
        map.generations().expect("readable")
    );
}

/// In format 2 a place that forgot was written with all of the map; from the first commit on it is
/// alone.
#[test]
fn a_map_of_format_2_becomes_one_of_today_at_its_first_commit() {
    let (_folder, path) = folder();
    std::fs::copy(golden_path(2), &path).expect("writable");
    let map = Map::open(&path).expect("a map");
    let reader = Map::open_read_only(&path).expect("a map");
    let generations = map.generations().expect("readable");
    assert_eq!(map.replace(&golden_3()).expect("stored"), 6);
    assert_eq!(reader.refresh().expect("sound"), map.snapshot());
    assert_eq!(map.generations().expect("readable")[..6], generations);
    assert_eq!(map.generations().expect("readable")[6].parent, Some(5));
    assert!(same(&reader.at(5).expect("there"), &golden_2()));
    assert!(same(&reader.at(2).expect("there"), &golden()));
    let known = Map::open_read_only(golden_path(3)).expect("a map");
    assert_eq!(map.snapshot(), known.snapshot());
    let report = Map::verify(&path).expect("a map");
    assert!(report.is_clean(), "{:?}", report.faults);
}

fn write_golden(path: &Path) {
    let whole = golden();
    let map = Map::create_at(path, whole.meta().clone(), Time::from_s(1)).expect("new");
    // In two commits: the first place alone, then everything.
    let mut first = Snapshot::empty(whole.meta().clone());
    (first.push_node(Arc::clone(&whole.nodes()[0]))).expect("the first");
    map.commit_at(&first, Time::from_s(2)).expect("extends");
    map.commit_at(&whole, Time::from_s(3)).expect("extends");
    // One more that is taken back, then the attachments.
    let mut mistaken = whole.clone();
    mistaken.attach("calibration", [9; 40]).expect("a name");
    let lamp_post = mistaken.find(whole.nodes()[1].key()).expect("there");
    (mistaken.set_pose(lamp_post, Some([1.0, 2.0, 3.0]))).expect("finite");
    take(
        &mut mistaken,
        90,
        &Step::Visit {
            place: 0,
            born: 3,
            seen: vec![true],
            hidden: None,
            located_by: vec![true],
            kept: true,
        },
    );
    map.commit_at(&mistaken, Time::from_s(4)).expect("extends");
    map.rollback_at(2, Time::from_s(5)).expect("there");
    map.commit_at(&golden_2(), Time::from_s(6))
        .expect("extends");
    // A place that forgets.
    map.replace_at(&golden_3(), Time::from_s(7))
        .expect("stored");
}

/// For a new format, `CHRONOTOPE_WRITE_GOLDEN=1 cargo test --test it golden_map_is_written` writes
/// into `maps/golden`, where it overwrites nothing; otherwise into a temporary folder.
#[test]
fn golden_map_is_written() {
    if std::env::var_os("CHRONOTOPE_WRITE_GOLDEN").is_some() {
        return write_golden(&golden_path(3));
    }
    let dir = tempfile::tempdir().expect("temporary folder");
    let path = dir.path().join("golden.map");
    write_golden(&path);
    let written = Map::open(&path).expect("opens").snapshot();
    let known = Map::open_read_only(golden_path(3))
        .expect("opens")
        .snapshot();
    assert_eq!(written, known);
}

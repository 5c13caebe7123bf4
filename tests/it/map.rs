//! A map keeps what it was given, or says what is wrong.

use std::path::PathBuf;
use std::sync::Arc;

use chronotope::feature::{Descriptor, Features, Keypoint, Rect};
use chronotope::map::{
    AppearanceUse, Edge, Map, MapMeta, PlaceKey, SessionId, Snapshot, Visit, VisitId, derived_uuid,
    features_digest,
};
use chronotope::visibility::BitRow;
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
}

fn step() -> impl Strategy<Value = Step> {
    let bits = || proptest::collection::vec(any::<bool>(), 1..80);
    prop_oneof![
        8 => (0..4_u8, 0..40_usize, bits(), proptest::option::of(bits()), any::<bool>()).prop_map(
            |(place, born, seen, hidden, kept)| Step::Visit { place, born, seen, hidden, kept }
        ),
        1 => (0..4_u8, proptest::option::of(proptest::array::uniform3(-1e6..1e6)))
            .prop_map(|(place, pose)| Step::Pose { place, pose }),
        2 => (0..4_u8, 0..4_u8).prop_map(|(from, to)| Step::Edge { from, to }),
        1 => Just(Step::NoEdges),
        1 => any::<bool>().prop_map(Step::Zone),
    ]
}

fn place(number: u8) -> PlaceKey {
    PlaceKey::new(&format!("place {number} ✓")).expect("valid")
}

fn take(snapshot: &mut Snapshot, number: u64, step: &Step) {
    match step {
        Step::Visit {
            place: at,
            born,
            seen,
            hidden,
            kept,
        } => {
            let key = place(*at);
            let id = snapshot.find_or_add(&key);
            let node = snapshot.node_mut(id);
            let len = node.features.len() + born;
            let (mut seen_row, mut hidden_row) = (BitRow::zeros(len), BitRow::zeros(len));
            for i in 0..len {
                if seen[i % seen.len()] {
                    seen_row.set(i);
                } else if hidden.as_ref().is_some_and(|h| h[i % h.len()]) {
                    hidden_row.set(i);
                }
            }
            node.push_visit(
                visit(&key, number, *kept),
                &features(number + 1000, *born),
                seen_row,
                hidden.is_some().then_some(hidden_row),
            )
            .expect("in step");
        }
        Step::Pose { place: at, pose } => {
            let id = snapshot.find_or_add(&place(*at));
            snapshot.node_mut(id).pose = *pose;
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
        Step::NoEdges => snapshot.edges.clear(),
        Step::Zone(set) => snapshot.meta.zone = set.then(|| "Europe/Prague".into()),
    }
}

fn meta() -> MapMeta {
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

/// In memory where there is such a folder: every commit waits for the disk.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder");
    let path = folder.path().join("a.map");
    (folder, path)
}

fn same(a: &Snapshot, b: &Snapshot) -> bool {
    (&a.meta, &a.nodes, &a.edges) == (&b.meta, &b.nodes, &b.edges)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

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
                prop_assert_eq!(map.snapshot().generation, generation);
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
}

fn small(path: &PathBuf) -> (Map, Snapshot) {
    let map = Map::create_at(path, meta(), Time::from_s(0)).expect("new");
    let mut snapshot = Snapshot::clone(&map.snapshot());
    for number in 0..6 {
        let step = Step::Visit {
            place: (number % 2) as u8,
            born: 3,
            seen: vec![true, true, false],
            hidden: (number == 3).then(|| vec![true, false]),
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
    let refused = |change: &dyn Fn(&mut Snapshot)| {
        let mut changed = good.clone();
        change(&mut changed);
        let error = map.commit(&changed).expect_err("must not be stored");
        assert_eq!(map.snapshot().generation, 1);
        error.to_string()
    };
    let first = |s: &Snapshot| s.find(&place(0)).expect("there");
    let all = [
        refused(&|s| s.meta.uuid = 1),
        refused(&|s| s.meta.crop = None),
        refused(&|s| drop(s.nodes.pop())),
        refused(&|s| s.nodes.swap(0, 1)),
        refused(&|s| s.node_mut(first(s)).visits[0].source = "another".into()),
        refused(&|s| s.node_mut(first(s)).visits[1].appearance = Some(Arc::default())),
    ];
    for message in all {
        assert!(message.contains("does not extend"), "{message}");
        assert!(message.contains("a.map"), "{message}");
    }
    let message = refused(&|s| s.node_mut(first(s)).features.truncate(1));
    assert!(message.contains("do not pair"), "{message}");
    let message = refused(&|s| {
        let again = s.nodes[0].visits[0].clone();
        let node = s.node_mut(first(s));
        let seen = BitRow::zeros(node.features.len());
        node.push_visit(again, &Features::new(), seen, None)
            .expect("in step");
    });
    assert!(message.contains("already"), "{message}");
    let message = refused(&|s| s.node_mut(first(s)).pose = Some([0.0, f64::NAN, 0.0]));
    assert!(message.contains("not finite"), "{message}");
    assert_eq!(map.commit(&good).expect("nothing new"), 1);
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
    assert_eq!(missing.kind(), ErrorKind::Io);
    assert!(missing.to_string().contains("map build"), "{missing}");
    let error = Map::open(folder.path()).expect_err("a folder");
    assert!(error.to_string().contains("folder"), "{error}");
}

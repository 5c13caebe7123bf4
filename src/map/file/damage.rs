//! Tests: is every damage to a map file noticed?

use std::fs;
use std::path::Path;
use std::sync::Arc;

use chronotope_store::{ValueRef, row_crc};
use rusqlite::Connection;

use crate::feature::{Descriptor, Features, Keypoint};
use crate::map::file::tables;
use crate::map::*;
use fremen::time::Time;
use fremen::visibility::BitRow;

fn features(seed: u32, len: u32) -> Features {
    let mut features = Features::new();
    for i in 0..len {
        let keypoint = Keypoint {
            x: (seed * 7 + i) as f32,
            y: i as f32 + 0.5,
            size: 9.0,
            response: 1.0 / (i + 1) as f32,
        };
        let word = u64::from(seed * 31 + i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        features.push(keypoint, Descriptor([word, !word, word << 3, word >> 3]));
    }
    features
}

fn visit_once(snapshot: &mut Snapshot, place: &str, seed: u32) {
    let key = PlaceKey::new(place).expect("valid");
    let id = snapshot.find_or_add(&key);
    let node = snapshot.node_mut(id);
    let born = features(seed, 2 + seed % 3);
    let len = node.features().len() + born.len();
    let (mut seen, mut hidden) = (BitRow::zeros(len), BitRow::zeros(len));
    for i in 0..len {
        match (i + seed as usize) % 3 {
            0 => hidden.set(i),
            _ => seen.set(i),
        }
    }
    let time = Time::from_s(1_000 * i64::from(seed));
    let session = SessionId::derive("a session");
    let appearance_use = if seed.is_multiple_of(4) {
        AppearanceUse::Recognised
    } else {
        AppearanceUse::Experience
    };
    let visit = Visit {
        id: VisitId::derive(session, &key, time, &features_digest(&born)),
        session,
        time,
        source: format!("{seed}.png"),
        appearance: seed.is_multiple_of(2).then(|| Arc::new(features(seed, 2))),
        appearance_use,
    };
    let hidden = seed.is_multiple_of(3).then_some(hidden);
    let located_by = node.unlocated(appearance_use);
    node.push_visit(visit, &born, seen, hidden, located_by)
        .expect("in step");
}

fn in_memory() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder")
}

/// Three generations in pages of 512 bytes.
fn tiny(path: &Path) -> Map {
    let meta = MapMeta {
        image_size: Some((640, 480)),
        zone: Some("Europe/Prague".into()),
        ..MapMeta::new(derived_uuid("tiny"), "star+brief", "default")
    };
    let map = Map::create_with(path, meta, Time::from_s(0), 512).expect("new");
    let mut snapshot = Snapshot::clone(&map.snapshot());
    for seed in 1..=4 {
        visit_once(&mut snapshot, ["door", "lamp"][seed as usize % 2], seed);
        if seed == 2 {
            let pose = Some([1.0, -2.5, 0.0]);
            snapshot.set_pose(NodeId(0), pose).expect("finite");
            let edge = Edge {
                from: snapshot.nodes[0].key().clone(),
                to: snapshot.nodes[1].key().clone(),
                name: "corridor".into(),
            };
            snapshot.add_edge(edge).expect("both are there");
            attach(&mut snapshot, "calibration", &[1, 2, 3]);
            attach(&mut snapshot, "held-visits", b"none");
            map.commit_at(&snapshot, Time::from_s(10)).expect("extends");
        }
    }
    attach(&mut snapshot, "calibration", &[7; 90]);
    snapshot.attachments.remove("held-visits");
    map.commit_at(&snapshot, Time::from_s(20)).expect("extends");
    map
}

/// Two generations more: a place that forgets a visit and a feature is written anew, then visited
/// again.
fn renewed(path: &Path) -> Map {
    let map = tiny(path);
    let mut snapshot = Snapshot::clone(&map.snapshot());
    let node = &snapshot.nodes[0];
    let (forgetful, _) = node
        .retained(&[false, true], &vec![true; node.features().len()])
        .expect("in step");
    snapshot.nodes[0] = Arc::new(forgetful);
    (map.replace_at(&snapshot, Time::from_s(30))).expect("stored");
    visit_once(&mut snapshot, "lamp", 5);
    map.commit_at(&snapshot, Time::from_s(40)).expect("extends");
    map
}

fn attach(snapshot: &mut Snapshot, name: &str, value: &[u8]) {
    snapshot.attachments.insert(name.into(), value.into());
}

/// Whether the damage is noticed; if it is not, it must not matter.
fn is_noticed(path: &Path, damaged: &[u8], expected: &Snapshot, what: &str) -> bool {
    fs::write(path, damaged).expect("writable");
    let is_refused = is_refused(path, expected, what);
    let report = Map::verify(path);
    let is_clean = report.as_ref().is_ok_and(VerifyReport::is_clean);
    assert!(!(is_refused && is_clean), "{what}: verify is content");
    assert_eq!(fs::read(path).expect("there"), damaged, "{what}: changed");
    !is_clean
}

/// Whether the file is not opened; if it is, it must be the map it was.
fn is_refused(path: &Path, expected: &Snapshot, what: &str) -> bool {
    match Map::open_read_only(path) {
        Ok(map) => {
            assert_eq!(*map.snapshot(), *expected, "{what}");
            false
        }
        Err(error) => {
            assert!(error.path().is_some(), "{what}: {error}");
            true
        }
    }
}

/// A damaged file that opens for writing must neither lose nor bend what is committed next.
fn commit_is_safe(path: &Path, damaged: &[u8], expected: &Snapshot, what: &str) {
    fs::write(path, damaged).expect("writable");
    let Ok(map) = Map::open(path) else { return };
    assert_eq!(*map.snapshot(), *expected, "{what}");
    let mut next = expected.clone();
    visit_once(&mut next, "door", 9);
    if map.commit(&next).is_ok() {
        let reopened = Map::open_read_only(path).expect(what).snapshot();
        assert_eq!(reopened.nodes, next.nodes, "{what}");
    }
    drop(map);
    fs::remove_file(path).expect("ours");
}

#[test]
fn every_flipped_byte_is_noticed_or_harmless() {
    let folder = in_memory();
    let path = folder.path().join("whole.map");
    let expected = renewed(&path).snapshot();
    let whole = fs::read(&path).expect("there");
    let path = folder.path().join("damaged.map");
    let mut num_refused = 0;
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 1 << (at * 5 % 8);
        let what = format!("bit {} of byte {at}", at * 5 % 8);
        fs::write(&path, &damaged).expect("writable");
        num_refused += usize::from(is_refused(&path, &expected, &what));
        // The dear ways in: the header of the file, then samples from every page.
        if at < 100 || at % 23 == 0 {
            is_noticed(&path, &damaged, &expected, &what);
        }
        if at < 100 || at % 31 == 0 {
            commit_is_safe(&path, &damaged, &expected, &what);
        }
    }
    println!(
        "{num_refused} of {} flips refused, the rest harmless",
        whole.len()
    );
    assert!(num_refused > whole.len() / 4);
}

#[test]
fn every_truncation_and_every_lost_or_swapped_page_is_noticed() {
    let folder = in_memory();
    let path = folder.path().join("whole.map");
    let expected = renewed(&path).snapshot();
    let whole = fs::read(&path).expect("there");
    let path = folder.path().join("damaged.map");
    for len in (0..whole.len()).step_by(61).chain([1, 99, 100, 511, 512]) {
        let what = format!("cut to {len} bytes");
        assert!(is_noticed(&path, &whole[..len], &expected, &what), "{what}");
    }
    let pages = whole.len() / 512;
    for a in 0..pages {
        let mut zeros = whole.clone();
        zeros[a * 512..][..512].fill(0);
        let what = format!("page {a} is zero");
        assert!(is_noticed(&path, &zeros, &expected, &what), "{what}");
        for b in 0..a {
            let mut swapped = whole.clone();
            let (low, high) = swapped.split_at_mut(a * 512);
            low[b * 512..][..512].swap_with_slice(&mut high[..512]);
            let what = format!("pages {b} and {a} are swapped");
            assert!(is_noticed(&path, &swapped, &expected, &what), "{what}");
        }
    }
    let longer = [whole.as_slice(), &[0; 700]].concat();
    assert!(is_noticed(&path, &longer, &expected, "700 bytes too many"));
}

/// What somebody with the sqlite3 tool can do, and what is said of it.
const BY_HAND: &[(&str, &str)] = &[
    (
        "UPDATE visit SET time_us = time_us + 1 WHERE id = 2",
        "table visit, row 2",
    ),
    (
        "UPDATE visit SET seen = NULL WHERE id = 2",
        "table visit, row 2",
    ),
    (
        "UPDATE visit SET located_by = x'' WHERE id = 2",
        "table visit, row 2",
    ),
    (
        "UPDATE visit SET located_by = x'03' WHERE id = 2",
        "table visit, row 2, column located_by, byte 0: ",
    ),
    (
        "UPDATE visit SET seen = (SELECT seen FROM visit WHERE id = 4), \
             crc = (SELECT crc FROM visit WHERE id = 4) WHERE id = 2",
        "table visit, row 2",
    ),
    ("DELETE FROM visit WHERE id = 4", "table"),
    (
        "DELETE FROM visit WHERE id = 1",
        "visit 0 of place 1 is missing",
    ),
    ("DELETE FROM feature WHERE visit = 2", "table"),
    (
        "DELETE FROM appearance",
        "the rows are not those that were committed",
    ),
    (
        "DELETE FROM pose",
        "the rows are not those that were committed",
    ),
    (
        "DELETE FROM edge",
        "the rows are not those that were committed",
    ),
    ("DELETE FROM place WHERE id = 1", "there is no place 1"),
    (
        "DELETE FROM generation WHERE number = 1",
        "generation 1 is missing",
    ),
    ("DELETE FROM generation", "there is no generation"),
    (
        "DELETE FROM generation WHERE number = 2",
        "there is no generation 2",
    ),
    (
        "UPDATE generation SET parent = 0 WHERE number = 2",
        "table generation, row 2",
    ),
    (
        "DELETE FROM attachment WHERE id = 3",
        "the rows are not those that were committed",
    ),
    (
        "UPDATE attachment SET value = x'010303' WHERE id = 1",
        "table attachment, row 1, column value, byte 1: ",
    ),
    ("DELETE FROM meta", "table meta"),
    (
        "UPDATE place SET key = replace(key, 'lamp', 'lamq')",
        "column key, byte 3: ",
    ),
    ("UPDATE place SET crc = crc | 4294967296", "column crc"),
    ("UPDATE place SET key = zeroblob(8)", "table place, row 1"),
    (
        "UPDATE feature SET keypoints = zeroblob(20000000) WHERE visit = 1",
        "table feature, row 1, column keypoints, byte 16777216: ",
    ),
    ("DROP TABLE edge", "table edge: the table is missing"),
    ("ALTER TABLE pose ADD COLUMN w REAL", "table pose"),
    (
        "CREATE TRIGGER t AFTER INSERT ON visit BEGIN DELETE FROM place; END",
        "`t` is no part of format 3",
    ),
];

#[test]
fn rows_changed_by_hand_are_named() {
    let folder = in_memory();
    let whole = folder.path().join("whole.map");
    drop(tiny(&whole));
    let path = folder.path().join("changed.map");
    for &(sql, expected) in BY_HAND {
        fs::copy(&whole, &path).expect("writable");
        let connection = Connection::open(&path).expect("sound");
        let changed = connection
            .execute_batch("PRAGMA ignore_check_constraints = 1")
            .and_then(|()| connection.execute_batch(sql));
        drop(connection);
        if let Err(refused) = changed {
            // The tables are strict: SQLite itself keeps the wrong type out.
            assert!(
                sql.contains("NULL") || sql.contains("zeroblob(8)"),
                "{sql}: {refused}"
            );
            continue;
        }
        let error = Map::open(&path).expect_err(sql).to_string();
        assert!(error.contains(expected), "{sql}: {error}");
        let report = Map::verify(&path).expect("a map");
        let first = report.faults.first().expect(sql).to_string();
        assert!(first.contains(expected), "{sql}: {first}");
    }
}

/// The rows of a place that was written anew since are checked, too, if only by `verify`.
#[test]
fn what_a_renewal_leaves_behind_is_checked() {
    let folder = in_memory();
    let whole = folder.path().join("whole.map");
    drop(renewed(&whole));
    let path = folder.path().join("changed.map");
    for (sql, opens, expected) in [
        (
            "DELETE FROM renewal",
            false,
            "visit 2 of place 1 is missing",
        ),
        (
            "UPDATE renewal SET place = 3",
            false,
            "table renewal, row 1, column place, byte 0: ",
        ),
        (
            "UPDATE renewal SET generation = 9",
            false,
            "table renewal, row 1",
        ),
        (
            "UPDATE visit SET time_us = time_us + 1 WHERE id = 1",
            false,
            "table visit, row 1",
        ),
        (
            "DELETE FROM feature WHERE visit = 1",
            true,
            "table visit, row 1",
        ),
        (
            "DELETE FROM feature WHERE visit = 1; DELETE FROM visit WHERE id = 1",
            true,
            "visit 0 of place 1 is missing",
        ),
        (
            "DROP TABLE renewal",
            false,
            "table renewal: the table is missing",
        ),
    ] {
        fs::copy(&whole, &path).expect("writable");
        let connection = Connection::open(&path).expect("sound");
        connection.execute_batch(sql).expect(sql);
        drop(connection);
        let opened = Map::open(&path).map_err(|error| error.to_string());
        assert_eq!(opened.is_ok(), opens, "{sql}: {opened:?}");
        if let Err(error) = opened {
            assert!(error.contains(expected), "{sql}: {error}");
        }
        let report = Map::verify(&path).expect("a map");
        let first = report.faults.first().expect(sql).to_string();
        assert!(first.contains(expected), "{sql}: {first}");
    }
}

/// The checksum holds, but the bits are not one for each experience so far.
#[test]
fn bits_that_do_not_fit_the_experiences_are_named() {
    let folder = in_memory();
    for (bits, expected) in [
        (&[3_u8][..], "column located_by, byte 0: "),
        (&[1, 0], "column located_by, byte 1: "),
        (&[], "column located_by, byte 0: "),
    ] {
        let path = folder.path().join(format!("{bits:?}.map"));
        let map = tiny(&path);
        map.with_connection(|connection| {
            let columns = tables::VISIT.columns.join(", ");
            let sql = format!("SELECT {columns} FROM visit WHERE id = 2");
            let crc = connection
                .query_row(&sql, [], |row| {
                    let mut values = (0..tables::VISIT.columns.len())
                        .map(|column| row.get_ref(column))
                        .collect::<rusqlite::Result<Vec<_>>>()?;
                    values.pop();
                    values.push(ValueRef::Blob(bits));
                    Ok(row_crc(&tables::VISIT, &values))
                })
                .expect("there");
            connection
                .execute(
                    "UPDATE visit SET located_by = ?1, crc = ?2 WHERE id = 2",
                    (bits, crc),
                )
                .expect("sound");
        });
        drop(map);
        let error = Map::open(&path).expect_err("does not fit").to_string();
        assert!(error.contains(expected), "{bits:?}: {error}");
        let report = Map::verify(&path).expect("a map");
        let first = report.faults.first().expect("a fault").to_string();
        assert!(first.contains(expected), "{bits:?}: {first}");
    }
}

#[test]
fn a_full_disk_leaves_the_old_generation() {
    let folder = in_memory();
    let path = folder.path().join("full.map");
    let map = tiny(&path);
    let before = map.snapshot();
    map.with_connection(|connection| {
        let pages: i64 = connection
            .query_row("PRAGMA page_count", [], |row| row.get(0))
            .expect("sound");
        let limit: i64 = connection
            .query_row(&format!("PRAGMA max_page_count = {pages}"), [], |row| {
                row.get(0)
            })
            .expect("sound");
        assert_eq!(limit, pages);
    });
    let mut next = Snapshot::clone(&before);
    for seed in 20..40 {
        visit_once(&mut next, "door", seed);
    }
    let error = map.commit(&next).expect_err("full").to_string();
    assert!(error.contains("disk is full"), "{error}");
    assert!(error.contains("full.map"), "{error}");
    assert_eq!(map.snapshot(), before);
    assert_eq!(Map::open(&path).expect("sound").snapshot(), before);
    assert!(Map::verify(&path).expect("sound").is_clean());
    map.with_connection(|connection| {
        connection
            .query_row("PRAGMA max_page_count = 100000", [], |_| Ok(()))
            .expect("sound");
    });
    map.commit(&next).expect("there is room again");
    assert_eq!(Map::open(&path).expect("sound").snapshot(), map.snapshot());
}

/// The files as a power loss in the middle of a commit leaves them.
#[test]
fn an_interrupted_commit_is_undone() {
    let folder = in_memory();
    let path = folder.path().join("a.map");
    let map = tiny(&path);
    let before = map.snapshot();
    let torn = folder.path().join("torn.map");
    let torn_journal = folder.path().join("torn.map-journal");
    map.with_connection(|connection| {
        connection
            .execute_batch(
                "PRAGMA cache_size = 1; BEGIN IMMEDIATE; UPDATE visit SET source = 'gone', \
                 crc = 0; UPDATE feature SET keypoints = zeroblob(5000); DELETE FROM place;",
            )
            .expect("sound");
        connection.cache_flush().expect("sound");
        fs::copy(&path, &torn).expect("writable");
        fs::copy(folder.path().join("a.map-journal"), &torn_journal).expect("there");
        connection.execute_batch("ROLLBACK").expect("sound");
    });
    assert_ne!(
        fs::read(&torn).expect("there"),
        fs::read(&path).expect("there")
    );
    let undone = Map::open_read_only(&torn).expect("undone");
    assert_eq!(undone.snapshot(), before);
    assert!(!torn_journal.exists());
    assert!(Map::verify(&torn).expect("sound").is_clean());
}

//! A file holds what was committed, whatever is done to it.

use std::fs;

use fremen_grid::file::Access;
use fremen_grid::{CellState, ErrorKind, GridFile, GridSpec, History, Patch, Time};
use proptest::prelude::*;

use crate::twin::{Seen, arb_seen};

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("a folder")
}

fn history(spec: GridSpec, seen: &[Seen]) -> History {
    let mut history = History::new(spec);
    for it in seen {
        history
            .observe_as(it.observer, &it.patch, Time::from_us(it.us))
            .unwrap();
    }
    history
}

fn patrol(day: i64) -> (GridSpec, History) {
    let spec = GridSpec::new_2d([0.0; 2], 0.05, [50, 40]).unwrap();
    let mut history = History::new(spec);
    let mut patch = Patch::new([0; 3], [50, 40, 1], vec![CellState::Free; 2_000]).unwrap();
    for cell in 0..20 {
        patch.set([(7 * day as u32 + cell) % 50, cell, 0], CellState::Occupied);
    }
    history
        .observe_as("robot", &patch, Time::from_s(day * 86_400))
        .unwrap();
    (spec, history)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn what_was_added_in_steps_is_what_was_seen(
        (spec, seen, parts) in arb_seen(12).prop_flat_map(|(spec, seen)| {
            let num = seen.len();
            (Just(spec), Just(seen), prop::collection::vec(0_u8..4, num))
        }),
    ) {
        let folder = folder();
        let path = folder.path().join("a.grid");
        let part = |of: u8| {
            let mine: Vec<Seen> = (seen.iter().zip(&parts))
                .filter(|(_, part)| **part == of)
                .map(|(seen, _)| seen.clone())
                .collect();
            history(spec, &mine)
        };
        let mut file = GridFile::create(&path, part(0)).unwrap();
        for of in 1..4 {
            file.add(&part(of)).unwrap();
            // Once more is known already.
            prop_assert_eq!(file.add(&part(of)).unwrap(), 0);
        }
        let all = history(spec, &seen);
        prop_assert_eq!(file.history(), &all);
        let reread = GridFile::open(&path, Access::ReadOnly).unwrap();
        prop_assert_eq!(reread.history(), &all);
        let verified = GridFile::verify(&path).unwrap();
        prop_assert_eq!(verified.faults, vec![]);
        // Equal contents have equal digests, however they came.
        let once = folder.path().join("b.grid");
        let mut once = GridFile::create(&once, all).unwrap();
        let digest = |file: &mut GridFile| file.generations().unwrap().last().unwrap().digest;
        prop_assert_eq!(digest(&mut file), digest(&mut once));
    }
}

#[test]
fn generations_are_returned_to_forgotten_and_pruned() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut file = GridFile::create(&path, patrol(0).1).unwrap();
    for day in 1..8 {
        assert_eq!(file.add(&patrol(day).1).unwrap(), 1);
    }
    assert_eq!(file.generation(), 8);
    let fifth = file.at(5).unwrap();
    assert_eq!(fifth.num_observations(), 5);
    assert_eq!(file.forget_before(Time::from_s(6 * 86_400)).unwrap(), 6);
    assert_eq!(file.history().num_observations(), 2);
    assert_eq!(file.add(&patrol(9).1).unwrap(), 1);
    let reread = GridFile::open(&path, Access::ReadOnly).unwrap();
    assert_eq!(reread.history(), file.history());
    assert_eq!(file.rollback(5).unwrap(), 11);
    assert_eq!(file.history(), &fifth);
    assert_eq!(file.add(&patrol(20).1).unwrap(), 1);
    assert_eq!(file.at(10).unwrap().num_observations(), 3);
    assert_eq!(file.at(8).unwrap().num_observations(), 8);
    let before = file.history().clone();
    assert!(file.prune(&[10]).unwrap() > 5);
    assert_eq!(file.history(), &before);
    assert_eq!(file.at(10).unwrap().num_observations(), 3);
    assert_eq!(file.at(8).unwrap_err().kind(), ErrorKind::NotFound);
    assert!(GridFile::verify(&path).unwrap().faults.is_empty());
}

#[test]
fn files_merge_in_any_order() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    for day in 0..3 {
        GridFile::create(path(&format!("{day}.grid")), patrol(day).1).unwrap();
    }
    let merge = |to: &str, order: [usize; 4]| {
        let from = order.map(|day| path(&format!("{day}.grid")));
        GridFile::merge_into(path(to), &from)
            .unwrap()
            .into_history()
    };
    let merged = merge("a.grid", [0, 1, 2, 1]);
    assert_eq!(merged.num_observations(), 3);
    assert_eq!(merged, merge("b.grid", [2, 2, 0, 1]));
    let error = GridFile::merge_into(path("a.grid"), &[path("0.grid")]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::AlreadyExists);
    let other = GridSpec::new_2d([0.0; 2], 0.1, [50, 40]).unwrap();
    GridFile::create(path("other.grid"), History::new(other)).unwrap();
    let error = GridFile::merge_into(path("c.grid"), &[path("0.grid"), path("other.grid")]);
    assert_eq!(error.unwrap_err().kind(), ErrorKind::Shape);
    assert!(!path("c.grid").exists());
}

#[test]
fn every_flipped_byte_is_noticed_or_harmless() {
    let folder = folder();
    let path = folder.path().join("whole.grid");
    let mut file = GridFile::create(&path, patrol(0).1).unwrap();
    file.add(&patrol(1).1).unwrap();
    let whole = fs::read(&path).unwrap();
    let damaged_path = folder.path().join("damaged.grid");
    let mut num_refused = 0;
    for at in (0..whole.len()).step_by(37) {
        let mut damaged = whole.clone();
        damaged[at] ^= 1 << (at * 5 % 8);
        fs::write(&damaged_path, &damaged).unwrap();
        match GridFile::open(&damaged_path, Access::ReadOnly) {
            Ok(opened) => assert_eq!(opened.history(), file.history(), "byte {at}"),
            Err(error) => {
                assert!(error.path().is_some(), "byte {at}: {error}");
                let verified = GridFile::verify(&damaged_path);
                assert!(
                    verified.map_or(true, |it| !it.faults.is_empty()),
                    "byte {at}"
                );
                num_refused += 1;
            }
        }
    }
    assert!(num_refused > 20, "{num_refused}");
}

#[test]
fn what_is_no_grid_is_refused_and_a_reader_never_writes() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    assert_eq!(
        GridFile::open(&path, Access::ReadOnly).unwrap_err().kind(),
        ErrorKind::NotFound
    );
    fs::write(&path, "x,y\n").unwrap();
    let error = GridFile::open(&path, Access::ReadOnly)
        .unwrap_err()
        .to_string();
    assert!(error.contains("not a grid file"), "{error}");
    fs::remove_file(&path).unwrap();
    GridFile::create(&path, patrol(0).1).unwrap();
    let before = fs::read(&path).unwrap();
    let mut reader = GridFile::open(&path, Access::ReadOnly).unwrap();
    let error = reader.add(&patrol(1).1).unwrap_err().to_string();
    assert!(error.contains("read-only"), "{error}");
    assert_eq!(reader.history().num_observations(), 1);
    assert_eq!(fs::read(&path).unwrap(), before);
    // Two writers.
    let mut first = GridFile::open(&path, Access::ReadWrite).unwrap();
    let mut second = GridFile::open(&path, Access::ReadWrite).unwrap();
    first.add(&patrol(1).1).unwrap();
    let error = second.add(&patrol(2).1).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Conflict, "{error}");
}

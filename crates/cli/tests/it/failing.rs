//! A disk that is full or fails, and memory that runs out, at any call of an update: the map is the
//! old one or the new one, what went wrong is said, and the repetition gives what an update gives
//! that nothing disturbed.
//!
//! Faults come from `strace`, which lets the n-th call fail; without it the test counts as skipped.
//! `CHRONOTOPE_TEST_FAULTS` says how many calls of each kind fail in turn (all, where there are not
//! more).

use std::fs;
use std::process::{Command, Stdio};

use crate::fixture::{Fixture, Ran, may_trace};

/// Calls, and how they fail.
const FAULTS: [(&str, &str); 9] = [
    ("?pwrite64,?write", "ENOSPC"),
    ("?pwrite64", "EIO"),
    ("?fsync,?fdatasync", "EIO"),
    ("?pread64,?read", "EIO"),
    ("?openat", "EMFILE"),
    ("?openat", "ENOSPC"),
    ("?unlink,?unlinkat,?ftruncate", "EIO"),
    ("?pwrite64,?pread64,?fsync,?fdatasync,?openat", "EINTR"),
    ("?mmap,?brk,?mremap", "ENOMEM"),
];

const UPDATE: &str = "map update early.map --data data --commit-every 0";

fn traced(fixture: &Fixture, options: &[&str]) -> Ran {
    let output = (Command::new("strace").current_dir(fixture.dir.path()))
        .args(["-qq", "-o", "calls"])
        .args(options)
        .arg(env!("CARGO_BIN_EXE_chronotope"))
        .args(UPDATE.split_whitespace())
        .env("RAYON_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .output();
    Ran::from(output.expect("strace is there"))
}

#[test]
fn an_update_whose_disk_or_memory_fails_at_any_call_leaves_the_old_map_or_the_new_one() {
    let fixture = Fixture::with_map();
    if !may_trace(&fixture, "no faults at system calls") {
        return;
    }
    let num_faults: usize = std::env::var("CHRONOTOPE_TEST_FAULTS")
        .map_or(4, |number| number.parse().expect("a number"));
    let index = fixture.index();
    let first: Vec<&str> = index.lines().take(9).collect();
    fixture.write("data/index.csv", first.join("\n"));
    fixture.succeeds("map build --data data --out early.map");
    fixture.write("data/index.csv", &index);
    let early = fs::read(fixture.path("early.map")).expect("built");
    fixture.run(UPDATE);
    let expected = fixture.digest("early.map");
    let (mut num_failed, mut num_survived) = (0, 0);
    for (calls, error) in FAULTS {
        fixture.write("early.map", &early);
        // `-f` is not given: the first thread writes, and its calls are counted.
        traced(&fixture, &["-e", &format!("trace={calls}")]);
        let listed = fs::read_to_string(fixture.path("calls")).expect("written");
        let num_calls = listed.lines().count();
        assert!(num_calls > 0 || calls.contains("truncate"), "{calls}");
        let step = (num_calls / num_faults).max(1);
        for at in (1..=num_calls).step_by(step) {
            fixture.write("early.map", &early);
            let inject = format!("inject={calls}:error={error}:when={at}");
            let ran = traced(&fixture, &["-e", &inject]);
            let what = format!("{error} at call {at} of {num_calls} of {calls}: {ran:?}");
            assert!(!ran.stderr.contains("panicked"), "{what}");
            // 0, 1: it did not matter. 2: an error. Before `main`, and where memory is gone, the
            // process has no way to say anything but that.
            if ran.code < 0 || ran.code > 2 {
                assert!(error == "ENOMEM" || ran.code == 127 || at < 30, "{what}");
            }
            if ran.code == 2 {
                assert!(ran.stderr.contains("error: "), "{what}");
                num_failed += 1;
            } else {
                num_survived += 1;
            }
            let again = fixture.run("map verify early.map");
            assert_eq!(again.code, 0, "{what}: {again:?}");
            let again = fixture.run(UPDATE);
            assert!(again.code < 2, "{what}: {again:?}");
            let num_visits = fixture.open("early.map").summary().num_visits;
            assert_eq!(num_visits, index.lines().count() - 1, "{what}");
            // An image that could not be read is learnt after the others then.
            if !ran.stderr.contains("left out") {
                assert_eq!(fixture.digest("early.map"), expected, "{what}");
            }
        }
    }
    println!("{num_failed} updates failed and {num_survived} did not mind");
    assert!(num_failed > 0 && num_survived > 0);
}

/// A name is on the disk only once its folder is: after the last renaming the folder is synced.
#[test]
fn the_name_of_a_new_file_outlives_a_power_loss() {
    let fixture = Fixture::with_map();
    if !may_trace(&fixture, "no look at what is synced") {
        return;
    }
    fixture.succeeds("map export street.map out");
    for (line, name) in [
        ("map build --data data --out built.map", "built.map"),
        ("map import out --out imported.map", "imported.map"),
        (
            "map merge street.map street.map --out merged.map",
            "merged.map",
        ),
        ("map export street.map folder", "folder"),
        ("map calibrate street.map", "street.map-journal"),
    ] {
        let traced = (Command::new("strace").current_dir(fixture.dir.path()))
            .args(["-f", "-qq", "-y", "-o", "calls", "-e"])
            .arg("trace=?fsync,?fdatasync,?rename,?renameat,?renameat2,?link,?linkat,?unlink")
            .arg(env!("CARGO_BIN_EXE_chronotope"))
            .args(line.split_whitespace())
            .output();
        assert!(traced.expect("strace is there").status.success(), "{line}");
        let calls = fs::read_to_string(fixture.path("calls")).expect("written");
        let calls: Vec<&str> = calls.lines().collect();
        let is_named = |call: &&str| !call.contains("sync(") && call.contains(name);
        let named = calls.iter().rposition(is_named);
        let named = named.unwrap_or_else(|| panic!("{line}: {calls:#?}"));
        let folder = fixture.dir.path().canonicalize().expect("there");
        let synced = format!("<{}>)", folder.display());
        let is_synced = calls[named..].iter().any(|call| call.contains(&synced));
        assert!(is_synced, "{line}: {calls:#?}");
    }
}

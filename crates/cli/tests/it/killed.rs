//! A writing command that is killed at any call of the system: the next command of any kind works,
//! the repetition gives what an undisturbed command gives, and nothing stays behind.
//!
//! Kills come from `strace`, which ends the process as it enters its n-th call that touches a file;
//! without it the test says that it was skipped. `CHRONOTOPE_TEST_KILLS` says how many kills there
//! are for each command.

use std::fs;
use std::process::{Command, Stdio};

use crate::fixture::{Fixture, may_trace};

/// Calls that change what is on the disk, or decide who may. Those that a system has not are left
/// out.
const CALLS: &str = "?openat,?write,?pwrite64,?fsync,?fdatasync,?ftruncate,?unlink,?unlinkat,\
                     ?rename,?renameat,?renameat2,?link,?linkat,?mkdir,?mkdirat,?rmdir,?flock,\
                     ?fcntl";

/// A command that writes, and what it writes.
struct Case {
    line: &'static str,
    /// The map that holds the result; of an exported folder, the folder.
    result: &'static str,
    /// Whether the result must not be there before.
    is_new: bool,
}

const CASES: [Case; 9] = [
    new(
        "map build --data data --out new.map --config numbers.toml",
        "new.map",
    ),
    new("map import out --out new.map", "new.map"),
    new("map merge street.map street.map --out new.map", "new.map"),
    new("map export street.map new", "new"),
    change(
        "map update early.map --data data --commit-every 0",
        "early.map",
    ),
    change("map edge street.map add place-02 place-03", "street.map"),
    change("map calibrate street.map", "street.map"),
    change("map rollback street.map --to 0", "street.map"),
    change("map prune street.map --keep-last 1", "street.map"),
];

const fn new(line: &'static str, result: &'static str) -> Case {
    Case {
        line,
        result,
        is_new: true,
    }
}

const fn change(line: &'static str, result: &'static str) -> Case {
    Case {
        line,
        result,
        is_new: false,
    }
}

/// The command under `strace` with these options, without its output.
fn traced(fixture: &Fixture, options: &[&str], line: &str) -> Command {
    let mut command = Command::new("strace");
    (command.current_dir(fixture.dir.path()))
        .args(["-f", "-qq"])
        .args(options)
        .arg(env!("CARGO_BIN_EXE_chronotope"))
        .args(line.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// How many calls of a thread are listed: one that another thread interrupts has two lines.
fn calls_of(calls: &str, thread: &str) -> usize {
    let begun = calls.lines().filter(|it| !it.contains(" resumed>"));
    begun.filter(|it| it.starts_with(thread)).count()
}

fn digest(fixture: &Fixture, result: &str) -> serde_json::Value {
    if fixture.path(result).is_dir() {
        fixture.succeeds(&format!("map import {result} --out check.map"));
        let digest = fixture.digest("check.map");
        fs::remove_file(fixture.path("check.map")).expect("ours");
        return digest;
    }
    fixture.succeeds(&format!("map verify {result}"));
    fixture.digest(result)
}

fn names(fixture: &Fixture) -> Vec<String> {
    let mut names: Vec<String> = (fs::read_dir(fixture.dir.path()).expect("readable"))
        .map(|it| {
            it.expect("there")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    names.sort();
    names
}

/// A street with an early map of it, an exported one, and numbers by which no visit is held.
fn prepared() -> Fixture {
    let fixture = Fixture::with_map();
    fixture.write("numbers.toml", "[learn.guard]\njudge = \"never\"\n");
    let index = fixture.index();
    let first: Vec<&str> = index.lines().take(9).collect();
    fixture.write("data/index.csv", first.join("\n"));
    fixture.succeeds("map build --data data --out early.map --config numbers.toml");
    fixture.write("data/index.csv", index);
    fixture.succeeds("map export street.map out");
    fixture
}

#[test]
fn a_writing_command_that_is_killed_at_any_call_can_be_repeated() {
    let fixture = prepared();
    if !may_trace(&fixture, "no kills at system calls") {
        return;
    }
    let num_kills = std::env::var("CHRONOTOPE_TEST_KILLS")
        .map_or(3, |number| number.parse().expect("a number"));
    let mut num_killed = 0;
    for Case {
        line,
        result,
        is_new,
    } in CASES
    {
        let start = (!is_new).then(|| fs::read(fixture.path(result)).expect("there"));
        let reset = || match &start {
            Some(bytes) => fixture.write(result, bytes),
            None if fixture.path(result).is_dir() => {
                fs::remove_dir_all(fixture.path(result)).expect("ours");
            }
            None => {
                // It may not have come to be.
                let _ = fs::remove_file(fixture.path(result));
            }
        };
        let trace = format!("trace={CALLS}");
        assert!(
            traced(&fixture, &["-o", "calls", "-e", &trace], line)
                .status()
                .is_ok()
        );
        // `strace` counts the calls of each thread; those of the first one write the result.
        let calls = fs::read_to_string(fixture.path("calls")).expect("written");
        let thread = calls.split(' ').next().unwrap_or_default();
        let num_calls = calls_of(&calls, thread);
        fs::remove_file(fixture.path("calls")).expect("ours");
        let expected = digest(&fixture, result);
        let left = names(&fixture);
        for kill in 0..num_kills {
            reset();
            // Spread over all calls, the last ones among them: those of the commit.
            let at = num_calls - num_calls * kill / num_kills;
            let inject = format!("inject={CALLS}:signal=KILL:when={at}");
            let status = traced(&fixture, &["-o", "/dev/null", "-e", &inject], line).status();
            num_killed += usize::from(!status.expect("strace is there").success());
            if let Some(found) = fixture.path(result).exists().then_some(result)
                && !is_new
            {
                fixture.succeeds(&format!("map inspect {found}"));
            }
            if !(is_new && fixture.path(result).exists()) {
                fixture.succeeds(line);
            }
            assert_eq!(
                digest(&fixture, result),
                expected,
                "{line}, killed at call {at}"
            );
            assert_eq!(names(&fixture), left, "{line}, killed at call {at}");
        }
        reset();
    }
    println!("{num_killed} commands were killed");
    assert!(num_killed > CASES.len(), "{num_killed}");
}

/// Two robots learn into one map at once, and one of them is killed: the other does not notice, and
/// the killed one's repetition completes what both have.
#[test]
fn of_two_writers_one_is_killed_and_neither_loses_anything() {
    let fixture = prepared();
    if !may_trace(&fixture, "no kills of one of two writers") {
        return;
    }
    let num_kills = std::env::var("CHRONOTOPE_TEST_KILLS")
        .map_or(3, |number| number.parse().expect("a number"));
    // The visits that the early map has not, by turns.
    let index = fixture.index();
    fs::create_dir(fixture.path("other")).expect("writable");
    fs::create_dir(fixture.path("other/images")).expect("writable");
    let mut halves = [
        String::from("place,time,path\n"),
        String::from("place,time,path\n"),
    ];
    for (number, row) in index.lines().skip(9).enumerate() {
        halves[number % 2].extend([row, "\n"]);
    }
    for name in index
        .lines()
        .skip(9)
        .filter_map(|row| row.split(',').nth(2))
    {
        let (from, to) = (
            fixture.path("data").join(name),
            fixture.path("other").join(name),
        );
        fs::hard_link(from, to).expect("writable");
    }
    fixture.write("data/index.csv", &halves[0]);
    fixture.write("other/index.csv", &halves[1]);
    let early = fs::read(fixture.path("early.map")).expect("there");
    let line = |data: &str| {
        format!("map update early.map --data {data} --commit-every 0 --config numbers.toml")
    };
    let trace = format!("trace={CALLS}");
    let status = traced(&fixture, &["-o", "calls", "-e", &trace], &line("data")).status();
    assert!(status.is_ok());
    let calls = fs::read_to_string(fixture.path("calls")).expect("written");
    let thread = calls.split(' ').next().unwrap_or_default();
    let num_calls = calls_of(&calls, thread);
    fs::remove_file(fixture.path("calls")).expect("ours");
    let left = names(&fixture);
    for kill in 0..num_kills {
        fixture.write("early.map", &early);
        let at = num_calls - num_calls * kill / num_kills;
        let inject = format!("inject={CALLS}:signal=KILL:when={at}");
        let killed = traced(&fixture, &["-o", "/dev/null", "-e", &inject], &line("data")).spawn();
        let other = fixture.run(&line("other"));
        let killed = killed.expect("strace is there").wait();
        assert!(killed.is_ok());
        assert!(other.code < 2, "killed at call {at}: {other:?}");
        fixture.succeeds("map verify early.map");
        let again = fixture.run(&line("data"));
        assert!(again.code < 2, "killed at call {at}: {again:?}");
        fixture.succeeds("map verify early.map");
        let num_visits = fixture.open("early.map").summary().num_visits;
        assert_eq!(num_visits, index.lines().count() - 1, "killed at call {at}");
        assert_eq!(names(&fixture), left, "killed at call {at}");
    }
}

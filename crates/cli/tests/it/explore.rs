//! `chronotope explore` as its users run it: a real process and files.

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use chronotope::Time;
use serde_json::Value;

/// Two rooms of eight days, a row every ten minutes: somebody is in the kitchen from 7 to 8 h and
/// from 18 to 20 h, in the office from 9 to 17 h.
fn rooms(dir: &Path) {
    for (name, hours) in [("kitchen", vec![7, 18, 19]), ("office", (9..17).collect())] {
        let mut text = String::from("when,somebody\n");
        for row in 0..8 * 144 {
            let when = start().plus_us(row * 600_000_000);
            let state = u8::from(hours.contains(&(row / 6 % 24)));
            writeln!(text, "{when},{state}").expect("memory");
        }
        std::fs::write(dir.join(format!("{name}.csv")), text).expect("writable");
    }
    let roads = "node kitchen\nnode hall\nlink kitchen hall 30\nlink hall cellar 60\n";
    std::fs::write(dir.join("bad-roads.txt"), roads).expect("writable");
    let roads = "node hall\nlink kitchen hall 30\nlink hall office 60\n";
    std::fs::write(dir.join("roads.txt"), roads).expect("writable");
}

fn start() -> Time {
    Time::parse("2024-05-01T00:00:00Z").expect("valid")
}

fn explore(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_chronotope"))
        .current_dir(dir)
        .arg("explore")
        .args(args)
        .output()
        .expect("the command starts")
}

fn stdout(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    String::from_utf8(output.stdout.clone()).expect("text")
}

fn lines(output: &Output) -> Vec<Value> {
    let text = stdout(output);
    text.lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect()
}

const PLAN: [&str; 5] = [
    "plan",
    "kitchen.csv",
    "office.csv",
    "--from",
    "2024-05-09T00:00:00Z",
];

#[test]
fn a_plan_comes_as_json_csv_and_calendar_with_the_same_visits() {
    let dir = tempfile::tempdir().expect("a folder");
    rooms(dir.path());
    for strategy in [
        "information",
        "greedy",
        "monte-carlo",
        "novelty",
        "round-robin",
        "random",
    ] {
        let plan = |form: &str| {
            explore(
                dir.path(),
                &[
                    &PLAN[..],
                    &["--strategy", strategy, "--share", "0.25", form],
                ]
                .concat(),
            )
        };
        let visits = lines(&plan("--json"));
        assert_eq!(visits.len(), 36, "{strategy}");
        for visit in &visits {
            let time = |key: &str| Time::parse(visit[key].as_str().expect("text")).expect("a time");
            assert_eq!(time("end").since_s(time("start")), 600.0);
            assert!(visit["info_bits"].as_f64().expect("a number") >= 0.0);
            assert!(["kitchen", "office"].contains(&visit["place"].as_str().expect("text")));
            assert!(!visit["reason"].as_str().expect("text").is_empty());
        }
        let starts: Vec<&str> = visits
            .iter()
            .filter_map(|visit| visit["start"].as_str())
            .collect();
        assert!(starts.is_sorted_by(|a, b| a < b), "{strategy}");
        let csv = stdout(&plan("--csv"));
        let of_csv: Vec<&str> = csv
            .lines()
            .skip(1)
            .filter_map(|row| row.split(',').next())
            .collect();
        assert_eq!(of_csv, starts);
        let calendar = stdout(&plan("--ics"));
        assert!(
            calendar.starts_with("BEGIN:VCALENDAR\r\n") && calendar.ends_with("END:VCALENDAR\r\n")
        );
        assert_eq!(calendar.matches("BEGIN:VEVENT").count(), visits.len());
        assert!(calendar.contains(&format!("DTSTART:{}", starts[0].replace(['-', ':'], ""))));
        assert!(calendar.split("\r\n").all(|line| line.len() <= 75));
    }
}

#[test]
fn the_next_visit_is_the_first_of_a_plan_from_now_on() {
    let dir = tempfile::tempdir().expect("a folder");
    rooms(dir.path());
    let args = [
        "next",
        "kitchen.csv",
        "office.csv",
        "--now",
        "2024-05-09T06:00:00Z",
        "--json",
    ];
    let visits = lines(&explore(dir.path(), &args));
    assert_eq!(visits.len(), 1);
    let first = Time::parse(visits[0]["start"].as_str().expect("text")).expect("a time");
    assert!(first.since_s(Time::parse("2024-05-09T06:00:00Z").expect("valid")) >= 0.0);
}

/// `kitchen.csv` and `office.csv` without what was seen from the ninth day on, and looks of that day.
fn looks_of_the_ninth_day(dir: &Path, kitchen: &[&str]) {
    let mut text = std::fs::read_to_string(dir.join("kitchen.csv")).expect("readable");
    for time in kitchen {
        writeln!(text, "2024-05-09T{time}Z,0").expect("memory");
    }
    std::fs::write(dir.join("kitchen.csv"), text).expect("writable");
}

#[test]
fn visits_of_the_day_are_taken_off_its_share() {
    let dir = tempfile::tempdir().expect("a folder");
    rooms(dir.path());
    // Three slots, two looks in the first of them.
    looks_of_the_ninth_day(
        dir.path(),
        &["00:00:00", "00:05:00", "01:00:00", "02:00:00"],
    );
    let next = |more: &[&str]| {
        let args = [
            "next",
            "kitchen.csv",
            "office.csv",
            "--now",
            "2024-05-09T06:03:00Z",
            "--day-from",
            "2024-05-09T00:00:00Z",
            "--json",
            "--share",
        ];
        lines(&explore(dir.path(), &[&args[..], more].concat()))
    };
    // Four visits a day are 4 / 144 of it.
    let visits = next(&["0.028"]);
    assert_eq!(visits.len(), 1);
    let first = Time::parse(visits[0]["start"].as_str().expect("text")).expect("a time");
    assert!(first.since_s(Time::parse("2024-05-09T06:10:00Z").expect("valid")) >= 0.0);
    assert_eq!(next(&["0.021"]).len(), 0, "three are made already");
    let garage = ["0.028", "--visited", "garage=2024-05-09T05:00:00Z"];
    assert_eq!(next(&garage).len(), 0, "a visit elsewhere is one, too");
    let again = ["0.028", "--visited", "kitchen=2024-05-09T01:00:00Z"];
    assert_eq!(next(&again).len(), 1, "this one is in the file");
    for (more, says) in [
        (["--visited", "garage"], "PLACE=TIME"),
        (
            ["--visited", "garage=2024-05-09T07:00:00Z"],
            "is not between",
        ),
        (
            ["--visited", "garage=2024-05-08T23:00:00Z"],
            "is not between",
        ),
    ] {
        let args = ["next", "kitchen.csv", "--now", "2024-05-09T06:03:00Z"];
        let day = ["--day-from", "2024-05-09T00:00:00Z"];
        let output = explore(dir.path(), &[&args[..], &day, &more].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        assert!(
            String::from_utf8_lossy(&output.stderr).contains(says),
            "{more:?}"
        );
    }
}

#[test]
fn a_plan_knows_the_past_only() {
    let dir = tempfile::tempdir().expect("a folder");
    rooms(dir.path());
    let from = "2024-05-05T00:00:00Z";
    let plan = || {
        explore(
            dir.path(),
            &[
                "plan",
                "kitchen.csv",
                "office.csv",
                "--from",
                from,
                "--json",
            ],
        )
    };
    let with_future = plan();
    assert!(String::from_utf8_lossy(&with_future.stderr).contains("left out"));
    for name in ["kitchen.csv", "office.csv"] {
        let text = std::fs::read_to_string(dir.path().join(name)).expect("readable");
        let past: Vec<&str> = text
            .lines()
            .filter(|row| row.starts_with('w') || *row < from)
            .collect();
        std::fs::write(dir.path().join(name), past.join("\n")).expect("writable");
    }
    let without = plan();
    assert!(without.stderr.is_empty(), "{without:?}");
    assert_eq!(with_future.stdout, without.stdout);
}

#[test]
fn driving_takes_time_and_the_battery_is_charged() {
    let dir = tempfile::tempdir().expect("a folder");
    rooms(dir.path());
    let driving = [
        "--roads",
        "roads.txt",
        "--at",
        "kitchen",
        "--charger",
        "kitchen",
        "--run-s",
        "14400",
        "--charge-s",
        "3600",
        "--open",
        "office=2024-05-09T08:00:00Z/2024-05-09T18:00:00Z",
        "--json",
    ];
    let stops = lines(&explore(dir.path(), &[&PLAN[..], &driving].concat()));
    assert!(stops.iter().any(|stop| stop["reason"] == "charging"));
    let time =
        |stop: &Value, key: &str| Time::parse(stop[key].as_str().expect("text")).expect("a time");
    for pair in stops.windows(2) {
        let way_s = if pair[0]["place"] == pair[1]["place"] {
            0.0
        } else {
            90.0
        };
        assert!(time(&pair[1], "start").since_s(time(&pair[0], "end")) >= way_s);
    }
    let spent_s: f64 = (stops.iter())
        .filter(|stop| stop["reason"] != "charging")
        .map(|stop| time(stop, "end").since_s(time(stop, "start")))
        .sum();
    assert!(spent_s <= 43_200.0, "{spent_s}");
    for stop in stops.iter().filter(|stop| stop["place"] == "office") {
        let start = stop["start"].as_str().expect("text");
        assert!(
            ("2024-05-09T08:00:00Z".."2024-05-09T18:00:00Z").contains(&start),
            "{start}"
        );
    }
}

#[test]
fn a_simulation_is_repeated_with_other_seeds_and_explained() {
    let dir = tempfile::tempdir().expect("a folder");
    rooms(dir.path());
    let args = [
        "simulate",
        "kitchen.csv",
        "office.csv",
        "--seeds",
        "3",
        "--by-day",
        "--json",
    ];
    let rows = lines(&explore(dir.path(), &args));
    assert_eq!(rows.len(), 3);
    for row in &rows {
        let error = row["error"].as_f64().expect("a number");
        assert!((0.0..0.3).contains(&error), "{row}");
        assert_eq!(row["num_visits"], 8 * 72);
        assert_eq!(row["by_day"].as_array().expect("a list").len(), 8);
    }
    assert_eq!(
        lines(&explore(dir.path(), &args)),
        rows,
        "the same seeds give the same"
    );
    let args = [
        "explain",
        "kitchen.csv",
        "office.csv",
        "--at",
        "2024-05-09T08:30:00Z",
        "--json",
    ];
    let places = lines(&explore(dir.path(), &args));
    assert_eq!(places.len(), 2);
    assert!(places[0]["value"].as_f64() >= places[1]["value"].as_f64());
}

#[test]
fn what_cannot_be_explored_is_said_in_one_line() {
    let dir = tempfile::tempdir().expect("a folder");
    rooms(dir.path());
    std::fs::create_dir(dir.path().join("other")).expect("a folder");
    std::fs::copy(
        dir.path().join("kitchen.csv"),
        dir.path().join("other/kitchen.csv"),
    )
    .expect("copied");
    std::fs::write(dir.path().join("negative.txt"), "link kitchen office -5\n").expect("writable");
    let more = |args: &[&'static str]| [&PLAN[..], args].concat();
    for (args, says) in [
        (more(&["--share", "1.5"]), "0 to 1"),
        (more(&["--slot-s", "0"]), "longer than 0 s"),
        (more(&["--slots", "0"]), "1 to 40000"),
        (more(&["--roads", "bad-roads.txt"]), "line 4"),
        (more(&["--roads", "negative.txt"]), "-5"),
        (more(&["--roads", "roads.txt", "--at", "cellar"]), "cellar"),
        (
            more(&["--roads", "roads.txt", "--open", "office"]),
            "PLACE=FROM/TO",
        ),
        (more(&["other/kitchen.csv"]), "two files are the place"),
        (more(&["missing.csv"]), "missing.csv"),
        (vec!["plan", "--from", "2024-05-09T00:00:00Z"], "DATA"),
    ] {
        let output = explore(dir.path(), &args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(says), "{args:?}: {said}");
        assert!(output.stdout.is_empty(), "{args:?}");
    }
    // Nothing to do is a plan, too.
    assert!(lines(&explore(dir.path(), &more(&["--share", "0", "--json"]))).is_empty());
}

//! Grids from maps of `map_server`, as users run the commands.

use std::fmt::Write as _;
use std::fs;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::fixture::{Fixture, may_trace};

/// A corridor of 20 x 10 cells; the cupboard at its side is open from 8 to 18 o'clock.
fn map(hour: i64) -> Vec<u8> {
    let is_open = (8..18).contains(&(hour % 24));
    let mut pgm = b"P5\n20 10\n255\n".to_vec();
    for y in (0..10).rev() {
        for x in 0..20 {
            let is_wall = y == 0 || y == 9;
            let is_door = is_open && y == 5 && (8..12).contains(&x);
            // Behind the wall's far end nothing is known.
            let is_hidden = x == 19 && y == 8;
            pgm.push(if is_hidden {
                205
            } else if is_wall || is_door {
                0
            } else {
                254
            });
        }
    }
    pgm
}

fn yaml(image: &str) -> String {
    format!(
        "image: {image}\nresolution: 0.1\norigin: [-1.0, 2.0, 0]\nnegate: 0\nmode: trinary\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
}

/// A folder `NAME/` with the maps of these hours since the epoch.
fn patrols(fixture: &Fixture, name: &str, hours: impl Iterator<Item = i64>) {
    fs::create_dir(fixture.path(name)).unwrap();
    let mut index = String::from("time,path,observer\n");
    for hour in hours {
        fixture.write(format!("{name}/{hour}.pgm"), map(hour));
        fixture.write(format!("{name}/{hour}.yaml"), yaml(&format!("{hour}.pgm")));
        writeln!(index, "{},{hour}.yaml,robot", hour * 3_600).unwrap();
    }
    fixture.write(format!("{name}/index.csv"), index);
}

/// `week.grid` of a week of patrols every three hours.
fn prepared() -> Fixture {
    let fixture = Fixture::new();
    patrols(&fixture, "week", (0..56).map(|i| 3 * i));
    fixture.succeeds("grid build --maps week --out week.grid");
    fixture
}

fn digest(fixture: &Fixture, grid: &str) -> Value {
    let generations = fixture.succeeds(&format!("grid log {grid} --json")).lines();
    generations.last().unwrap()["digest"].clone()
}

#[test]
fn a_week_of_patrols_predicts_day_and_night() {
    let fixture = prepared();
    let inspected = fixture.succeeds("grid inspect week.grid --json --png rhythms.png");
    let inspected = &inspected.lines()[0];
    assert_eq!(inspected["num_observations"], 56);
    assert_eq!(inspected["num_varying_cells"], 4);
    assert!(fixture.path("rhythms.png").exists());
    let p = |at: &str, time: &str| {
        let line = format!("grid explain week.grid --at {at} --time {time} --json");
        fixture.succeeds(&line).lines()[0]["p"].clone()
    };
    let door = "-0.05 2.55";
    assert!(p(door, "1970-01-12T13:00:00Z").as_f64().unwrap() > 0.8);
    assert!(p(door, "1970-01-12T02:00:00Z").as_f64().unwrap() < 0.2);
    assert_eq!(p("0.95 2.85", "1970-01-12T02:00:00Z"), Value::Null);
    let explained = fixture.succeeds(&format!(
        "grid explain week.grid --at {door} --time 1970-01-12T13:00:00Z"
    ));
    explained.prints(&["cell [9, 5, 0]", "every 24.00 h", "seen 56 times"]);
    fixture.fails(
        "grid explain week.grid --at 5 5 --time 1970-01-12T13:00:00Z",
        &["outside of the grid", "it reaches from (-1, 2, 0)"],
    );
}

#[test]
fn a_predicted_map_is_one_of_map_server_and_can_be_added_again() {
    let fixture = prepared();
    for (time, name, hour) in [("13", "noon", 13), ("02", "night", 26)] {
        let line = format!("grid predict week.grid --time 1970-01-12T{time}:00:00Z");
        fixture.succeeds(&format!("{line} --out {name}.yaml --png {name}.png"));
        // The unknown cell stays unknown, every other one is right.
        let found = fs::read(fixture.path(format!("{name}.pgm"))).unwrap();
        assert_eq!(found, map(hour));
        fixture.succeeds(&format!(
            "{line} --out {name}.yaml --mode scale --model mean"
        ));
        fixture
            .succeeds(&format!("{line} --model last --json"))
            .prints(&["\"num_varying\":4"]);
    }
    fixture.succeeds(
        "grid export week.grid --from 1970-01-12T00:00:00Z --every-h 6 --count 4 --out day",
    );
    let rebuilt = fixture.succeeds("grid build --maps day --out day.grid --json");
    assert_eq!(rebuilt.lines()[0]["num_observations"], 4);
    fixture.fails(
        "grid export week.grid --from 1970-01-12T00:00:00Z --out day",
        &["day"],
    );
    fixture.fails(
        "grid predict week.grid --time 1970-01-12T00:00:00Z --out a.yaml --mode scale --png a.png",
        &["two pictures", "a.png"],
    );
}

#[test]
fn maps_are_added_once_merged_in_any_order_and_taken_back() {
    let fixture = prepared();
    patrols(&fixture, "next", (56..60).map(|i| 3 * i));
    let before = digest(&fixture, "week.grid");
    fixture.succeeds("grid build --maps next --out next.grid");
    fixture.succeeds("grid merge week.grid next.grid --out a.grid");
    fixture.succeeds("grid merge next.grid week.grid next.grid --out b.grid");
    assert_eq!(digest(&fixture, "a.grid"), digest(&fixture, "b.grid"));
    fixture
        .succeeds("grid add week.grid --maps next")
        .prints(&["4 observations added"]);
    assert_eq!(digest(&fixture, "week.grid"), digest(&fixture, "a.grid"));
    fixture
        .succeeds("grid add week.grid --maps next")
        .prints(&["(4 known already)"]);
    fixture
        .succeeds("grid verify week.grid")
        .prints(&["intact, generation 2"]);
    fixture.succeeds("grid rollback week.grid --to 1");
    assert_eq!(digest(&fixture, "week.grid"), before);
    fixture.succeeds("grid forget week.grid --before 1970-01-05T00:00:00Z");
    let left = fixture.succeeds("grid inspect week.grid --json").lines()[0].clone();
    assert_eq!(left["num_observations"], 24);
    fixture.succeeds("grid prune week.grid");
    assert_eq!(
        fixture.succeeds("grid log week.grid --json").lines().len(),
        2
    );
    fixture.fails(
        "grid build --maps next --out week.grid",
        &["never overwritten"],
    );
}

#[test]
fn maps_that_do_not_fit_are_refused_and_nothing_changes() {
    let fixture = prepared();
    let before = fs::read(fixture.path("week.grid")).unwrap();
    fixture.write("m.pgm", map(0));
    let add = "grid add week.grid --map m.yaml --time 1970-02-01T00:00:00Z";
    for (from, to, words) in [
        ("0.1\n", "0.05\n", ["cells of 0.05 m", "one resolution"]),
        ("-1.0", "-1.03", ["whole cells", "one raster"]),
        ("-1.0", "9.0", ["outside of the grid", "m.yaml"]),
        ("2.0, 0]", "2.0, 0.5]", ["rotated by 0.5 rad", "line 3"]),
        ("m.pgm", "../m.pgm", ["not in the folder", "m.yaml"]),
        ("m.pgm", "n.pgm", ["n.pgm", "error"]),
        ("0.196", "0.7", ["thresholds cross", "m.yaml"]),
    ] {
        fixture.write("m.yaml", yaml("m.pgm").replacen(from, to, 1));
        fixture.fails(add, &words);
    }
    fixture.write("m.yaml", yaml("m.pgm"));
    fixture.write("m.pgm", &map(0)[..90]);
    fixture.fails(add, &["the file ends after", "m.pgm"]);
    fixture.fails(&format!("{add} --free 0.9"), &["m.pgm"]);
    assert_eq!(fs::read(fixture.path("week.grid")).unwrap(), before);
    // One observer, one time, two maps.
    fixture.write("m.pgm", map(12));
    fixture.fails(
        "grid add week.grid --map m.yaml --time 1970-01-01T00:00:00Z --observer robot",
        &["two different things"],
    );
    assert_eq!(fs::read(fixture.path("week.grid")).unwrap(), before);
    fixture.fails("grid inspect m.pgm", &["not a grid file"]);
    // One bit of what was written.
    let mut damaged = before.clone();
    let at = before.windows(5).position(|it| it == b"robot").unwrap();
    damaged[at] ^= 4;
    fixture.write("week.grid", &damaged);
    let verified = fixture.run("grid verify week.grid");
    assert_eq!(verified.code, 1, "{verified:?}");
    verified.prints(&[
        "table batch, row 1, column observations",
        "one bit has flipped",
        "damaged",
    ]);
    fixture.fails("grid inspect week.grid", &["`chronotope grid verify`"]);
}

/// A map of the same corridor, turned by half a turn: where it is mapped, nothing of it is right.
fn wrong(hour: i64) -> Vec<u8> {
    let mut pgm = map(hour);
    let header = pgm.len() - 200;
    // The walls stand in the middle, and where they were it is free.
    for y in 0..10 {
        for x in 0..20 {
            let is_wall = y == 3 || y == 7;
            pgm[header + 20 * y + x] = if is_wall { 0 } else { 254 };
        }
    }
    pgm
}

/// A doubtful map changes nothing but the quarantine, which is in the file.
#[test]
fn a_doubtful_map_is_quarantined_listed_accepted_or_dropped() {
    let fixture = prepared();
    let line = "grid add week.grid --map m.yaml --observer robot --time 1970-01-08T02:00:00Z";
    fixture.write("m.pgm", wrong(2));
    fixture.write("m.yaml", yaml("m.pgm"));
    let before = digest(&fixture, "week.grid");
    let added = fixture.run(&format!("{line} --json"));
    assert_eq!(added.code, 1, "{added:?}");
    added.notes(&["grid quarantine list week.grid"]);
    let summary = &added.lines()[0];
    assert_eq!(summary["num_added"], 0);
    assert_eq!(summary["num_observations"], 56);
    let id = summary["quarantined"][0].as_str().unwrap().to_owned();
    let held = digest(&fixture, "week.grid");
    assert_ne!(held, before);
    // Once more it is still held, and no generation is made.
    assert_eq!(fixture.run(line).code, 1);
    assert_eq!(digest(&fixture, "week.grid"), held);
    fixture
        .succeeds("grid verify week.grid")
        .prints(&["intact, generation 2"]);
    let listed = fixture.succeeds("grid quarantine list week.grid --json --png evidence");
    let listed = &listed.lines()[0];
    assert_eq!(listed["id"], *id);
    assert_eq!(listed["observer"], "robot");
    assert!(
        listed["disagreement"].as_f64() > listed["limit"].as_f64() || listed["reason"] == "shift"
    );
    assert!(fixture.path(format!("evidence/{id}.png")).exists());
    fixture
        .succeeds("grid quarantine list week.grid")
        .prints(&[&id[..8], "robot", "usual"]);
    fixture.fails(
        "grid quarantine accept week.grid xyz",
        &["no map in quarantine begins with `xyz`", "quarantine list"],
    );
    // Neither a prune nor a rollback loses it.
    fixture.succeeds("grid prune week.grid");
    assert_eq!(digest(&fixture, "week.grid"), held);
    fixture
        .succeeds(&format!("grid quarantine drop week.grid {}", &id[..4]))
        .prints(&["1 maps dropped, 0 in quarantine"]);
    assert_eq!(digest(&fixture, "week.grid"), before);
    fixture
        .succeeds("grid quarantine list week.grid")
        .notes(&["no map is in quarantine"]);
    fixture.succeeds("grid rollback week.grid --to 2");
    assert_eq!(digest(&fixture, "week.grid"), held);
    fixture
        .succeeds("grid quarantine accept week.grid --all")
        .prints(&["1 maps integrated, 0 in quarantine"]);
    let inspected = fixture.succeeds("grid inspect week.grid --json");
    assert_eq!(inspected.lines()[0]["num_observations"], 57);
    assert!(fixture.run(line).code == 0, "it is known now");
    // Whoever trusts a map says so.
    fixture.succeeds("grid rollback week.grid --to 3");
    fixture
        .succeeds(&format!("{line} --trust"))
        .prints(&["1 observations added"]);
}

#[test]
fn a_killed_add_leaves_the_old_grid_or_the_new_one() {
    kill_adding(|fixture| patrols(fixture, "next", (56..60).map(|i| 3 * i)));
}

#[test]
fn a_killed_add_of_a_doubtful_map_has_quarantined_it_or_not() {
    kill_adding(|fixture| {
        patrols(fixture, "next", (56..60).map(|i| 3 * i));
        fixture.write("next/171.pgm", wrong(171));
    });
}

/// Killed at any call of the system, `grid add` leaves the old generation or the new one, and what it
/// is given again has the same outcome.
fn kill_adding(prepare: impl Fn(&Fixture)) {
    let fixture = prepared();
    if !may_trace(&fixture, "no kills of grid add") {
        return;
    }
    prepare(&fixture);
    let line = "grid add week.grid --maps next";
    let start = fs::read(fixture.path("week.grid")).unwrap();
    let old = digest(&fixture, "week.grid");
    let code = fixture.run(line).code;
    let new = digest(&fixture, "week.grid");
    assert!(code < 2 && new != old);
    let num_kills = std::env::var("CHRONOTOPE_TEST_KILLS")
        .map_or(12, |number| number.parse().expect("a number"));
    let calls = "?openat,?write,?pwrite64,?fsync,?fdatasync,?ftruncate,?unlink,?rename,?fcntl";
    let traced = |options: &[&str]| {
        let mut command = Command::new("strace");
        command
            .current_dir(fixture.dir.path())
            .args(["-f", "-qq"])
            .args(options);
        command
            .arg(env!("CARGO_BIN_EXE_chronotope"))
            .args(line.split_whitespace());
        command
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .unwrap()
    };
    fixture.write("week.grid", &start);
    traced(&["-o", "calls", "-e", &format!("trace={calls}")]);
    let listed = fs::read_to_string(fixture.path("calls")).unwrap();
    let thread = listed.split(' ').next().unwrap_or_default();
    let num_calls = listed.lines().filter(|it| it.starts_with(thread)).count();
    let (mut num_killed, mut num_new) = (0, 0);
    for kill in 0..num_kills {
        fixture.write("week.grid", &start);
        let at = num_calls - num_calls * kill / num_kills;
        let inject = format!("inject={calls}:signal=KILL:when={at}");
        // Without a code: ended by the signal.
        let status = traced(&["-o", "/dev/null", "-e", &inject]);
        num_killed += usize::from(status.code().is_none());
        fixture.succeeds("grid verify week.grid");
        let found = digest(&fixture, "week.grid");
        assert!(found == old || found == new, "killed at call {at}");
        num_new += usize::from(found == new);
        let again = fixture.run(line).code;
        assert_eq!(again, code, "repeated after call {at}");
        assert_eq!(
            digest(&fixture, "week.grid"),
            new,
            "repeated after call {at}"
        );
    }
    eprintln!("{num_killed} killed, {num_new} of them after the commit");
    assert!(num_killed > num_kills / 2, "{num_killed} of {num_kills}");
}

#[test]
fn a_robot_plans_by_the_hour_and_finds_itself_in_a_log() {
    let fixture = prepared();
    // By day the open cupboard leaves no room for a robot of half a metre.
    let line = "grid plan week.grid --from -0.6 2.5 --to 0.6 2.5 --radius 0.2 --json";
    let night = fixture.succeeds(&format!("{line} --time 1970-01-12T02:00:00Z"));
    let night = &night.lines()[0];
    assert!(
        (night["length_m"].as_f64().unwrap() - 1.2).abs() < 0.15,
        "{night}"
    );
    assert!(night["p_free"].as_f64().unwrap() > 0.9, "{night}");
    let day = fixture.run(&format!("{line} --time 1970-01-12T13:00:00Z"));
    assert_eq!(day.lines()[0]["is_found"], false);
    fixture.fails(
        "grid plan week.grid --from 9 9 --to 0.6 2.5 --time 1970-01-12T02:00:00Z",
        &["(9, 9) is outside of the grid"],
    );
    // Between the walls at 0.45 m, with three beams into the open.
    let scan = "FLASER 5 0.45 0.63 inf 0.63 0.45 9 9 0 0 0 0 1 host 1\n";
    let moved = scan.replace("0 0 0 1 host 1", "0.2 0 0 2 host 2");
    fixture.write("run.log", format!("{scan}{moved}"));
    let line = "grid localize week.grid --time 1970-01-12T02:00:00Z";
    let found = fixture.run(&format!("{line} --log run.log --at -0.6 2.5 0 --json"));
    let found = found.lines();
    assert_eq!(found.len(), 2);
    let y = found[1]["y_m"].as_f64().unwrap();
    assert!((y - 2.5).abs() < 0.1, "{}", found[1]);
    fixture.write("cut.log", format!("{scan}{}", &scan[..18]));
    fixture.fails(
        &format!("{line} --log cut.log"),
        &["cut.log", "line 2", "cut before"],
    );
}

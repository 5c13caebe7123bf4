//! Careless commands, killed writers and hostile neighbours: what was there stays.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use chronotope::map::Map;

use crate::fixture::{Fixture, QUERY_TIME, Ran};

fn journal_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push("-journal");
    name.into()
}

/// All files of the folder with their bytes.
fn contents(fixture: &Fixture) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = fs::read_dir(fixture.dir.path()).expect("readable");
    let mut found: Vec<(PathBuf, Vec<u8>)> = entries
        .map(|it| it.expect("there").path())
        .filter(|path| path.is_file())
        .map(|path| (path.clone(), fs::read(&path).expect("readable")))
        .collect();
    found.sort();
    found
}

#[test]
fn no_output_is_written_over_what_is_not_an_earlier_one() {
    let fixture = Fixture::with_map();
    let door = "time,state\n2024-05-01T08:00:00Z,1\n2024-05-01T09:00:00Z,0\n\
                2024-05-01T10:00:00Z,1\n2024-05-01T11:00:00Z,0\n";
    fixture.write("door.csv", door);
    fixture.write("drawing.svg", "<svg xmlns=\"http://www.w3.org/2000/svg\"/>");
    fixture.write("notes.json", "{\"mine\":1}\n");
    #[cfg(unix)]
    std::os::unix::fs::symlink(fixture.path("street.map"), fixture.path("link")).expect("a link");
    let before = contents(&fixture);
    for output in ["street.map", "query0.png", "door.csv", "notes.json", "link"] {
        for learn in ["", " --learn"] {
            let line = format!(
                "localize street.map query0.png --time {QUERY_TIME} --trace {output}{learn}"
            );
            fixture.fails(&line, &[output, "never overwritten"]);
        }
    }
    for output in ["street.map", "door.csv", "drawing.svg", "link"] {
        let line = format!("spectrum door.csv --svg {output}");
        fixture.fails(&line, &[output, "never overwritten"]);
    }
    assert_eq!(contents(&fixture), before);
    // An earlier output of the same kind is replaced.
    for _ in 0..2 {
        fixture.succeeds("spectrum door.csv --svg door.svg");
        let line = format!("localize street.map query0.png --time {QUERY_TIME} --trace t.jsonl");
        fixture.succeeds(&line);
        let trace = fs::read_to_string(fixture.path("t.jsonl")).expect("written");
        assert_eq!(trace.lines().count(), 1);
    }
    assert_eq!(contents(&fixture).len(), before.len() + 2);
}

/// The bytes of file and journal of a commit that is under way.
fn interrupted(path: &Path) -> (Vec<u8>, Vec<u8>) {
    let connection = rusqlite::Connection::open(path).expect("a map");
    connection
        .execute_batch(
            "PRAGMA cache_size = 1; BEGIN IMMEDIATE; UPDATE visit SET time_us = time_us + 1; \
             UPDATE feature SET keypoints = zeroblob(length(keypoints)); \
             UPDATE generation SET num_visits = 0;",
        )
        .expect("sound");
    let found = (
        fs::read(path).expect("there"),
        fs::read(journal_of(path)).expect("there"),
    );
    connection.execute_batch("ROLLBACK").expect("sound");
    found
}

#[test]
fn every_command_reads_a_map_whose_writer_was_killed() {
    let fixture = Fixture::with_map();
    let path = fixture.path("street.map");
    let digest = fixture.digest("street.map");
    let (file, journal) = interrupted(&path);
    assert_ne!(
        file,
        fs::read(&path).expect("there"),
        "nothing was written yet"
    );
    for line in [
        "map inspect street.map".to_owned(),
        "map verify street.map".to_owned(),
        "map log street.map".to_owned(),
        "map held street.map".to_owned(),
        "map edge street.map list".to_owned(),
        format!("predict street.map --time {QUERY_TIME} --node place-00"),
        format!("localize street.map query0.png --time {QUERY_TIME}"),
        "map export street.map out".to_owned(),
        "map merge street.map street.map --out both.map".to_owned(),
        "map calibrate street.map".to_owned(),
    ] {
        fs::write(&path, &file).expect("writable");
        fs::write(journal_of(&path), &journal).expect("writable");
        fixture.succeeds(&line);
        assert!(!journal_of(&path).exists(), "{line}");
        if !line.starts_with("map calibrate") {
            assert_eq!(fixture.digest("street.map"), digest, "{line}");
        }
    }
}

#[test]
fn the_journal_of_a_map_that_is_gone_spoils_no_new_one() {
    let fixture = Fixture::with_map();
    let (_, journal) = interrupted(&fixture.path("street.map"));
    fixture.succeeds("map export street.map out");
    let digest = fixture.digest("street.map");
    for (name, line) in [
        (
            "a.map",
            "map build --data data --out a.map --keep-appearances all",
        ),
        ("b.map", "map import out --out b.map"),
        ("c.map", "map merge street.map street.map --out c.map"),
    ] {
        fixture.write(format!("{name}-journal"), &journal);
        let made = fixture.succeeds(line);
        made.notes(&["the journal of a map that is gone", "stray-journal"]);
        let made = fixture.digest(name);
        fixture.succeeds(&format!("map edge {name} add place-02 place-03"));
        fixture.succeeds(&format!("map rollback {name} --to 1"));
        fixture.succeeds(&format!("map verify {name}"));
        assert_eq!(fixture.digest(name), made, "{name}");
    }
    assert_eq!(fixture.digest("b.map"), digest);
    // Nor a backup that is put in the place of a map whose writer was killed.
    let backup = fs::read(fixture.path("street.map")).expect("there");
    fixture.succeeds("map edge street.map add place-02 place-03");
    fixture.succeeds("map edge street.map add place-03 place-02");
    let (_, journal) = interrupted(&fixture.path("street.map"));
    fixture.write("street.map", backup);
    fixture.write("street.map-journal", journal);
    fixture.succeeds("map edge street.map add place-01 place-02");
    fixture.succeeds("map verify street.map");
    assert_eq!(fixture.open("street.map").edges().len(), 3);
}

#[test]
fn what_was_learnt_outlives_the_commits_of_others() {
    let fixture = Fixture::with_map();
    let num_before = fixture.open("street.map").summary().num_visits;
    fs::create_dir(fixture.path("drive")).expect("writable");
    let mut index = String::from("place,time,path\n");
    let image = fs::read(fixture.path("query0.png")).expect("there");
    for hour in 0..60 {
        fixture.write(format!("drive/{hour}.png"), &image);
        let day = 15 + hour / 24;
        let row = format!(
            "place-00,2023-11-{day}T{:02}:30:00Z,{hour}.png\n",
            hour % 24
        );
        index.push_str(&row);
    }
    fixture.write("drive/index.csv", index);
    let images: Vec<String> = (0..60).map(|hour| format!("drive/{hour}.png")).collect();
    let images = images.join(" ");
    let mut learner = fixture
        .command(&format!("localize street.map {images} --learn"))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut num_others = 0;
    while learner.try_wait().expect("ours").is_none() {
        let verb = ["add", "remove"][num_others % 2];
        fixture.succeeds(&format!("map edge street.map {verb} place-02 place-03"));
        num_others += 1;
    }
    let ran = crate::fixture::Ran::from(learner.wait_with_output().expect("ours"));
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(num_others > 0);
    let learnt = fixture.open("street.map").summary().num_visits - num_before;
    let held = fixture.succeeds("map held street.map --json").lines().len();
    assert_eq!(learnt + held, 60, "{learnt} learnt, {held} held: {ran:?}");
    fixture.succeeds("map verify street.map");
}

#[test]
fn a_killed_build_merge_or_import_does_not_block_its_repetition() {
    let fixture = Fixture::with_map();
    fixture.succeeds("map export street.map out");
    let lines = [
        "map build --data data --out new.map --keep-appearances all",
        "map import out --out new.map",
        "map merge street.map street.map --out new.map",
    ];
    for line in lines {
        fixture.succeeds(line);
        let expected = fixture.digest("new.map");
        fs::remove_file(fixture.path("new.map")).expect("ours");
        let begun = Instant::now();
        let mut num_killed = 0;
        for delay_ms in (0..400).step_by(37) {
            let mut process = (fixture.command(line))
                .stdout(std::process::Stdio::null())
                .stderr(std::process::Stdio::null())
                .spawn()
                .expect("the command starts");
            std::thread::sleep(Duration::from_millis(delay_ms));
            process.kill().expect("ours");
            process.wait().expect("ours");
            num_killed += usize::from(!fixture.path("new.map").exists());
            if begun.elapsed() > Duration::from_secs(20) || fixture.path("new.map").exists() {
                break;
            }
        }
        assert!(num_killed > 0, "{line}");
        if !fixture.path("new.map").exists() {
            fixture.succeeds(line);
        }
        assert_eq!(fixture.digest("new.map"), expected, "{line}");
        fs::remove_file(fixture.path("new.map")).expect("ours");
        let left: Vec<PathBuf> = (contents(&fixture).into_iter().map(|it| it.0))
            .filter(|path| path.to_string_lossy().contains("new.map"))
            .collect();
        assert!(left.is_empty(), "{line}: {left:?}");
    }
}

#[test]
fn a_part_without_content_is_begun_again() {
    let fixture = Fixture::new();
    fixture.write("a.map.part", "");
    fixture.succeeds("map build --data data --out a.map");
    assert!(!fixture.path("a.map.part").exists());
}

#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_a_file_is_an_error_at_once() {
    let fixture = Fixture::with_map();
    let made = std::process::Command::new("mkfifo")
        .arg(fixture.path("pipe"))
        .status();
    assert!(made.expect("mkfifo").success());
    for line in [
        "spectrum pipe".to_owned(),
        "map inspect pipe".to_owned(),
        "map import pipe --out a.map".to_owned(),
        "map build --data data --out a.map --config pipe".to_owned(),
        format!("localize street.map query0.png --time {QUERY_TIME} --trace pipe"),
    ] {
        let begun = Instant::now();
        fixture.fails(&line, &["pipe"]);
        assert!(begun.elapsed() < Duration::from_secs(20), "{line}");
    }
}

#[test]
fn a_map_that_appears_while_another_is_built_is_not_overwritten() {
    let fixture = Fixture::with_map();
    let path = fixture.path("late.map");
    let snapshot = fixture.open("street.map");
    fixture.write(
        "late.map.part",
        fs::read(fixture.path("street.map")).expect("there"),
    );
    fixture.write("late.map", "somebody's");
    let error = Map::rename(fixture.path("late.map.part"), &path).expect_err("taken");
    assert_eq!(error.kind(), chronotope::ErrorKind::AlreadyExists);
    assert!(Map::create_from(&path, &snapshot).is_err());
    assert_eq!(fs::read(&path).expect("there"), b"somebody's");
}

#[test]
fn a_run_of_learning_is_taken_back_alone_and_learns_no_image_twice() {
    let fixture = Fixture::with_map();
    let before = fixture.open("street.map").summary();
    let learn = |image: &str| {
        let line = format!("localize street.map {image} --time {QUERY_TIME} --learn");
        fixture.run(&line)
    };
    let first = learn("query0.png");
    first.notes(&["learnt: 1 visits", "--session "]);
    let second = learn("query1.png");
    second.notes(&["learnt: 1 visits"]);
    let session = |ran: &crate::fixture::Ran| {
        let at = ran.stderr.find("--session ").expect("named") + "--session ".len();
        ran.stderr[at..at + 32].to_owned()
    };
    assert_ne!(session(&first), session(&second));
    learn("query0.png").notes(&["learnt: 0 visits", "has learnt this visit"]);
    fixture.succeeds(&format!(
        "map forget street.map --session {}",
        session(&first)
    ));
    let after = fixture.open("street.map").summary();
    assert_eq!(after.num_visits, before.num_visits + 1);
    // What built the map is known, too.
    let built = fixture.run("localize street.map data/images/00.png --learn");
    built.notes(&["learnt: 0 visits", "has learnt this visit"]);
}

#[test]
fn names_from_outside_do_nothing_to_a_terminal() {
    let fixture = Fixture::with_map();
    let image = fs::read(fixture.path("query0.png")).expect("there");
    fixture.write("a\u{1b}[31mb\u{202e}.png", image);
    let mut command = fixture.command(&format!("localize street.map --time {QUERY_TIME}"));
    let ran = command
        .args(["a\u{1b}[31mb\u{202e}.png", "no\u{1b}[2J.png"])
        .output();
    let ran = crate::fixture::Ran::from(ran.expect("the command starts"));
    let said = format!("{}{}", ran.stdout, ran.stderr);
    assert!(said.contains("\\u{1b}[31mb\\u{202e}"), "{said}");
    assert!(!said.contains(['\u{1b}', '\u{202e}']), "{said}");
}

/// Names come from outside: nothing of them is obeyed, and none makes a line of its own.
#[cfg(unix)]
#[test]
fn no_name_makes_a_line_of_its_own() {
    let fixture = Fixture::with_map();
    let name = "a\nerror: b\u{1b}[2J\u{202e}gpj.png";
    fs::copy(fixture.path("query0.png"), fixture.path(name)).expect("writable");
    let missing = "none\n\u{9b}2J.png";
    for image in [name, missing] {
        for options in [vec![], vec!["--learn"], vec!["--track", "--top", "2"]] {
            for more in [vec![], vec!["query1.png"]] {
                let mut command = fixture.command("localize street.map");
                command.arg(image).args(&more).args(&options);
                command.args(["--time", QUERY_TIME]);
                let ran = Ran::from(command.output().expect("the command starts"));
                for said in [&ran.stdout, &ran.stderr] {
                    let obeyed = ['\u{1b}', '\u{9b}', '\u{202e}'];
                    assert!(!said.contains(obeyed), "{ran:?}");
                    let lines = said.lines().filter(|line| line.starts_with("error: b"));
                    assert_eq!(lines.count(), 0, "{ran:?}");
                }
            }
        }
    }
}

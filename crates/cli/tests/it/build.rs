//! `chronotope map build`: real processes, files and signals.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::fixture::{Fixture, QUERY_TIME, Ran, images, plain, png, query_time};
use chronotope::map::Map;

#[test]
fn a_map_is_built_and_says_what_it_holds() {
    let fixture = Fixture::new();
    let built = fixture.run("map build --data data --out street.map");
    assert_eq!((built.code, built.stderr.as_str()), (0, ""), "{built:?}");
    built.prints(&["4 places, 24 visits (24 learnt now)"]);
    assert!(!fixture.path("street.map.part").exists());

    let shown = fixture.succeeds("map inspect street.map");
    shown.prints(&[
        "places       4",
        "320 x 240 px",
        "place-02: 6 visits",
        "at (1.5, -2, 0) m",
    ]);
    let shown = &fixture.run("map inspect street.map --json").lines()[0];
    assert_eq!(shown["num_visits"], 24);
    assert_eq!(shown["preset"], "default");
    assert_eq!(shown["edges"][0]["name"], "street");
    assert_eq!(shown["first"], "2023-05-15T12:00:00Z");
    assert!(
        shown["extractor"]
            .as_str()
            .is_some_and(|id| id.starts_with("star-brief:"))
    );

    let verified = fixture.succeeds("map verify street.map --json");
    assert_eq!(verified.lines()[0]["clean"], true);
    assert_eq!(verified.lines()[0]["digest"], shown["digest"]);
}

#[test]
fn the_same_images_give_the_same_map() {
    let fixture = Fixture::new();
    for map in ["a.map", "b.map"] {
        let mut command = fixture.command(&format!("map build --data data --out {map}"));
        let threads = if map == "a.map" { "1" } else { "3" };
        let built = command.env("RAYON_NUM_THREADS", threads).output();
        assert!(built.expect("the command starts").status.success());
    }
    assert_eq!(fixture.digest("a.map"), fixture.digest("b.map"));
}

#[test]
fn problems_of_a_dataset_are_listed_and_the_rest_is_learnt() {
    let fixture = Fixture::new();
    let whole = &images()[0].3;
    fixture.write("data/images/cut.png", &whole[..whole.len() / 2]);
    fixture.write("data/images/empty.png", "");
    fixture.write("data/images/small.png", plain((48, 64), 7));
    let rows = [
        ("place-00", "2024-01-01T00:00:00Z", "images/none.png"),
        ("place-00", "2024-01-02T00:00:00Z", "images/empty.png"),
        ("place-00", "2024-01-03T00:00:00Z", "images/cut.png"),
        ("place-00", "2023-05-15T12:00:00Z", "images/01.png"),
        ("place-00", "2024-01-04T00:00:00Z", "images/small.png"),
    ];
    let rows: Vec<_> = rows
        .iter()
        .map(|(place, time, path)| format!("{place},{time},{path}\n"))
        .collect();
    fixture.write("data/index.csv", fixture.index() + &rows.concat());
    let built = fixture.run("map build --data data --out street.map");
    assert_eq!(built.code, 1, "{built:?}");
    built.prints(&["4 places, 24 visits"]);
    built.notes(&[
        "none.png` does not exist",
        "empty.png` is empty",
        "cut.png",
        "a second image of `place-00`",
        "48 x 64",
        "5 problems",
    ]);

    let checked = fixture.run("dataset check data");
    assert_eq!(checked.code, 1, "{checked:?}");
    checked.prints(&["problems  5"]);
    let checked = fixture.run("dataset check data --json");
    assert_eq!(
        checked.lines()[0]["problems"].as_array().map(Vec::len),
        Some(5)
    );

    let clean = Fixture::new();
    let checked = clean.run("dataset check data");
    assert_eq!(
        (checked.code, checked.stderr.as_str()),
        (0, ""),
        "{checked:?}"
    );
    checked.prints(&["24 listed, 24 readable"]);
}

#[test]
fn an_index_that_cannot_be_trusted_is_refused() {
    let fixture = Fixture::new();
    let good = fixture.index();
    for (index, words) in [
        (
            good.replacen("2023-05-15T12:00:00Z", "yesterday", 1),
            &["index.csv", "line 2", "yesterday"][..],
        ),
        (
            good.replacen("place,time,path", "place,time,path,colour", 1),
            &["index.csv", "colour"],
        ),
        ("place,time,path\n".into(), &["index.csv", "lists no image"]),
    ] {
        fixture.write("data/index.csv", index);
        fixture.fails("map build --data data --out street.map", words);
        fixture.fails("dataset check data", words);
        assert!(!fixture.path("street.map").exists() && !fixture.path("street.map.part").exists());
    }
    fixture.fails("dataset check nowhere", &["nowhere"]);
    fixture.fails("map build --data nowhere --out street.map", &["nowhere"]);
    fixture.fails("map build --out street.map", &["--data"]);
}

#[test]
fn a_finished_map_is_never_overwritten() {
    let fixture = Fixture::with_map();
    let before = fs::read(fixture.path("street.map")).expect("built");
    let build = "map build --data data --out street.map";
    fixture.fails(build, &["street.map", "exists", "never overwritten"]);
    assert_eq!(
        fs::read(fixture.path("street.map")).expect("still there"),
        before
    );
    fixture.fails(
        "map build --data data --out no/such/street.map",
        &["create the folder first"],
    );
}

/// A build in another process that is under way, and takes long.
struct HeldBuild {
    fixture: Fixture,
    process: std::process::Child,
    num_visits: usize,
}

impl HeldBuild {
    /// Starts `build`, and waits until it has begun to learn; `is_begun` says so of the folder.
    fn start(build: &str, is_begun: impl Fn(&Fixture) -> bool) -> Self {
        let fixture = Fixture::new();
        // Large images of the same shape, after all others.
        let mut state = 1_u32;
        let slow = image::GrayImage::from_fn(5_000, 3_750, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            image::Luma([(state >> 24) as u8])
        });
        let mut bytes = std::io::Cursor::new(Vec::new());
        slow.write_to(&mut bytes, image::ImageFormat::Pnm)
            .expect("memory");
        fixture.write("data/images/slow.pgm", bytes.into_inner());
        let mut index = fixture.index();
        let mut num_visits = images().len();
        for day in 1..=40 {
            let time = query_time().plus_us(day * 86_400_000_000);
            writeln!(index, "place-00,{time},images/slow.pgm").expect("memory");
            num_visits += 1;
        }
        fixture.write("data/index.csv", index);
        let mut process = (fixture.command(build).env("RAYON_NUM_THREADS", "1"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts");
        let begun = std::time::Instant::now();
        while !is_begun(&fixture) {
            assert!(begun.elapsed() < Duration::from_secs(120), "nothing begins");
            assert!(process.try_wait().expect("a child").is_none(), "it ended");
            std::thread::sleep(Duration::from_millis(10));
        }
        Self {
            fixture,
            process,
            num_visits,
        }
    }

    /// Presses Ctrl-C, and waits for the end.
    fn interrupt(self) -> (Fixture, usize, Ran) {
        let sent = Command::new("sh")
            .args(["-c", "kill -INT \"$0\"", &self.process.id().to_string()])
            .status();
        assert!(sent.expect("kill is there").success());
        let output = self.process.wait_with_output().expect("it ends");
        (self.fixture, self.num_visits, Ran::from(output))
    }
}

#[test]
fn an_interrupted_build_goes_on_where_it_stopped() {
    let build = "map build --data data --out street.map --commit-every 0";
    // Another process may read a map that is being built.
    let held = HeldBuild::start(build, |fixture| {
        Map::open_read_only(fixture.path("street.map.part"))
            .is_ok_and(|map| map.snapshot().summary().num_visits > 0)
    });
    let part = held.fixture.path("street.map.part");
    let (fixture, num_visits, stopped) = held.interrupt();
    assert_eq!(stopped.code, 130, "{stopped:?}");
    stopped.notes(&["give the same command again"]);
    assert!(!fixture.path("street.map").exists());
    fixture.succeeds("map verify street.map.part");
    let kept = fixture.open("street.map.part").summary().num_visits;
    assert!((1..num_visits).contains(&kept), "{kept}");

    // With other numbers it would be another map.
    let other = format!("{build} --keep-appearances none");
    fixture.fails(
        &other,
        &["street.map.part", "another dataset or with other numbers"],
    );

    let finished = fixture.succeeds(build);
    finished.notes(&[&format!("going on: {kept} of {num_visits} visits")]);
    let learnt = format!("{num_visits} visits ({} learnt now)", num_visits - kept);
    finished.prints(&[&learnt]);
    assert!(!part.exists());
    fixture.succeeds("map verify street.map");
}

#[test]
fn the_reference_preset_commits_once_at_the_end() {
    let fixture = Fixture::new();
    let build = "map build --data data --out street.map --preset lttl";
    let built = fixture.succeeds(build);
    built.prints(&["24 visits (24 learnt now)"]);
    let map = Map::open_read_only(fixture.path("street.map")).expect("built");
    assert_eq!(map.snapshot().meta().preset, "lttl");
    assert_eq!(map.generations().expect("readable").len(), 2);
    // The map says by which numbers it is queried.
    let queried = fixture.run("localize street.map --print-config");
    let preset = fixture.run("map build --print-config --preset lttl");
    assert_eq!(queried.stdout, preset.stdout);
    fixture.write("query0.png", png(0, query_time(), 9));
    let located = fixture.run(&format!(
        "localize street.map query0.png --time {QUERY_TIME} --json"
    ));
    assert_eq!(located.lines()[0]["place"], "place-00", "{located:?}");
}

#[test]
fn an_interrupted_reference_build_leaves_nothing_half_done() {
    let build = "map build --data data --out street.map --preset lttl";
    let held = HeldBuild::start(build, |fixture| fixture.path("street.map.part").exists());
    let part = held.fixture.path("street.map.part");
    assert!(part.exists());
    let (fixture, _, stopped) = held.interrupt();
    assert_eq!(stopped.code, 130, "{stopped:?}");
    stopped.notes(&["nothing is kept"]);
    assert!(!part.exists() && !fixture.path("street.map").exists());
}

#[test]
fn a_disk_that_is_full_is_an_error() {
    let fixture = Fixture::with_map();
    if Path::new("/dev/full").exists() {
        fixture.fails(
            &format!("localize street.map query0.png --time {QUERY_TIME} --trace /dev/full"),
            &["/dev/full", "only files are written"],
        );
    }
    // A small disk takes the right to mount one, in a namespace of our own.
    let script = "mount -t tmpfs -o size=64k none small \
                  && exec \"$0\" map build --data data --out small/street.map";
    fs::create_dir(fixture.path("small")).expect("writable");
    let ran = Command::new("unshare")
        .args(["-rm", "sh", "-c", script, env!("CARGO_BIN_EXE_chronotope")])
        .current_dir(fixture.dir.path())
        .output();
    match ran.map(Ran::from) {
        Ok(ran) if !ran.stderr.contains("unshare") && !ran.stderr.contains("mount:") => {
            assert_eq!(ran.code, 2, "{ran:?}");
            ran.notes(&["the disk is full"]);
        }
        other => eprintln!("not tested with a small disk: no right to mount one ({other:?})"),
    }
}

#[test]
fn a_folder_that_may_not_be_written_is_an_error() {
    let fixture = Fixture::new();
    let folder = fixture.path("locked");
    fs::create_dir(&folder).expect("writable");
    let mut rights = fs::metadata(&folder).expect("there").permissions();
    rights.set_readonly(true);
    fs::set_permissions(&folder, rights).expect("ours");
    if fs::write(folder.join("probe"), "").is_ok() {
        eprintln!("not tested: this user may write everywhere");
        return;
    }
    fixture.fails(
        "map build --data data --out locked/street.map",
        &["locked/street.map", "may be written"],
    );
}

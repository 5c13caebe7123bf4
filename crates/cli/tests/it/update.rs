//! `chronotope map update`, also when it is killed.

use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::time::Duration;

use crate::fixture::{Fixture, NUM_PLACES, NUM_VISITS, images, plain, png, query_time};
use chronotope::Period;
use chronotope::map::Map;

/// The dataset without the images of visits from `visit` on.
fn shorten(fixture: &Fixture, visit: i64) -> String {
    let whole = fixture.index();
    let short: String = (whole.lines())
        .take(1 + visit as usize * NUM_PLACES)
        .flat_map(|line| [line, "\n"])
        .collect();
    fixture.write("data/index.csv", short);
    whole
}

#[test]
fn an_update_ends_where_a_build_of_everything_does() {
    for preset in ["default", "lttl"] {
        let fixture = Fixture::new();
        let build = |out: &str| {
            fixture.succeeds(&format!(
                "map build --data data --out {out} --preset {preset}"
            ));
        };
        let whole_index = shorten(&fixture, 4);
        build("grown.map");
        fixture.write("data/index.csv", whole_index);
        build("whole.map");
        let update = || fixture.succeeds("map update grown.map --data data");
        let updated = update();
        updated.prints(&["(8 learnt now)"]);
        updated.notes(&["16 of 24 visits"]);
        let (grown, whole) = (fixture.open("grown.map"), fixture.open("whole.map"));
        assert_eq!(grown.nodes(), whole.nodes(), "{preset}");
        assert_eq!(grown.edges(), whole.edges());
        // Nothing is left to learn.
        update().prints(&["(0 learnt now)"]);
        assert_eq!(fixture.open("grown.map").generation(), grown.generation());
        fixture.succeeds("map rollback grown.map --to 1");
        assert!(fixture.open("grown.map").summary().num_visits <= 16);
        fixture.succeeds("map verify grown.map");
    }
}

#[test]
fn a_stay_is_one_visit_by_update_and_by_learning_live() {
    let fixture = Fixture::with_map();
    let num_visits = || fixture.open("street.map").summary().num_visits;
    let bytes = || {
        fs::metadata(fixture.path("street.map"))
            .expect("there")
            .len()
    };
    let (visits_before, bytes_before) = (num_visits(), bytes());
    let mut index = String::from("place,time,path\n");
    for i in 0..300 {
        let time = query_time().plus_us(i * 100_000);
        writeln!(index, "place-00,{time},still.png").expect("memory");
    }
    fs::create_dir(fixture.path("dock")).expect("writable");
    fixture.write("dock/index.csv", index);
    fixture.write("dock/still.png", png(0, query_time(), 7));
    let update = || fixture.succeeds("map update street.map --data dock");
    let updated = update();
    updated.prints(&["(1 learnt now)"]);
    updated.notes(&["299 more images belong to these visits"]);
    assert_eq!(num_visits(), visits_before + 1);
    let generation = fixture.open("street.map").generation();
    update().prints(&["(0 learnt now)"]);
    assert_eq!(fixture.open("street.map").generation(), generation);

    let stills = vec!["still.png"; 20].join(" ");
    fixture.write("still.png", png(0, query_time(), 8));
    let later = query_time().plus_us(Period::DAY.as_us());
    let ran = fixture.succeeds(&format!(
        "localize street.map --time {later} --learn {stills}"
    ));
    ran.notes(&["learnt: 1 visits"]);
    assert_eq!(num_visits(), visits_before + 2);
    assert!(bytes() < bytes_before + 200_000, "{} bytes", bytes());
    fixture.succeeds("map verify street.map");
}

/// `CHRONOTOPE_TEST_KILLS` makes it longer.
#[test]
fn a_killed_update_loses_nothing_it_acknowledged() {
    let fixture = Fixture::new();
    fixture.write("numbers.toml", "[learn.guard]\njudge = \"never\"\n");
    let build = |out: &str| {
        fixture.succeeds(&format!(
            "map build --data data --out {out} --config numbers.toml"
        ));
    };
    let mut index = String::from("place,time,path\n");
    // In order of time, so that the first rows are learnt first.
    for (first, day) in (0..NUM_VISITS).flat_map(|first| (0..4).map(move |day| (first, day))) {
        for (place, time, name, _) in &images()[first as usize * NUM_PLACES..][..NUM_PLACES] {
            let time = time.plus_us(day * Period::DAY.as_us());
            writeln!(index, "place-{place:02},{time},{name}").expect("memory");
        }
    }
    fixture.write("data/index.csv", &index);
    build("whole.map");
    let first: Vec<&str> = index.lines().take(1 + 2 * NUM_PLACES).collect();
    fixture.write("data/index.csv", first.join("\n"));
    build("first.map");
    fixture.write("data/index.csv", &index);
    let (path, start) = (fixture.path("grown.map"), fixture.path("first.map"));
    let whole = fixture.open("whole.map");
    let update = "map update grown.map --data data --commit-every 0 --config numbers.toml";
    let (mut num_visits, mut num_finished, mut num_seen) = (0, 0, 0);
    for round in 0..num_kills(8) {
        if !path.exists() {
            fs::copy(&start, &path).expect("writable");
            num_visits = 0;
        }
        let mut process = fixture
            .command(&format!("-v {update}"))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts");
        let stderr = process.stderr.take().expect("piped");
        let mut said = (BufReader::new(stderr).lines().map_while(Result::ok)).filter_map(|line| {
            let generation = line.split_once("generation=")?.1;
            generation.split(' ').next()?.parse::<u64>().ok()
        });
        // Some are killed before their first commit, others after up to three.
        let heard = said.by_ref().take(round as usize % 4).last();
        std::thread::sleep(Duration::from_micros(round * 7_919 % 30_000));
        process.kill().expect("ours");
        let acknowledged = said.last().or(heard).unwrap_or_default();
        let is_finished = process.wait().expect("ours").success();
        num_seen += u64::from(acknowledged > 0);
        let found = Map::open(&path).expect("sound").snapshot();
        assert!(
            found.generation() >= acknowledged,
            "{acknowledged} was acknowledged"
        );
        let report = Map::verify(&path).expect("a map");
        assert!(report.is_clean(), "{:?}", report.faults);
        let now = found.summary().num_visits;
        assert!(
            now >= num_visits.max(2 * NUM_PLACES),
            "{now} of {num_visits}"
        );
        num_visits = now;
        if is_finished {
            assert_eq!(found.nodes(), whole.nodes());
            fs::remove_file(&path).expect("ours");
            num_finished += 1;
        }
    }
    println!(
        "{num_finished} updates were finished, {num_seen} had committed when they were killed"
    );
    if !path.exists() {
        fs::copy(&start, &path).expect("writable");
    }
    fixture.succeeds(update);
    assert_eq!(fixture.open("grown.map").nodes(), whole.nodes());
}

#[test]
fn an_update_of_what_is_no_map_or_has_other_images_changes_nothing() {
    let fixture = Fixture::with_map();
    fixture.fails(
        "map update missing.map --data data",
        &["missing.map", "map build"],
    );
    fixture.fails("map update data --data data", &["folder"]);
    // Images of another size are problems, one by one.
    let before = fs::read(fixture.path("street.map")).expect("there");
    fs::create_dir_all(fixture.path("other")).expect("writable");
    fixture.write("other/a.png", plain((48, 64), 0));
    fixture.write(
        "other/index.csv",
        "place,time,path\nplace-00,2024-01-01T00:00:00Z,a.png\n",
    );
    let ran = fixture.run("map update street.map --data other");
    assert_eq!(ran.code, 1, "{ran:?}");
    ran.notes(&["1 problem", "48 x 64 px"]);
    assert_eq!(fs::read(fixture.path("street.map")).expect("there"), before);
}

/// Rounds of a test that kills processes: `CHRONOTOPE_TEST_KILLS`, or as many as usual.
fn num_kills(usual: u64) -> u64 {
    std::env::var("CHRONOTOPE_TEST_KILLS").map_or(usual, |number| number.parse().expect("a number"))
}

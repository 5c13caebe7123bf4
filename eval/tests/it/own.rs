//! Somebody's own images, from a folder to a report, and the suites of sets that few have.

#![allow(
    clippy::unwrap_used,
    reason = "a helper of tests; clippy only knows their functions"
)]

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use chronotope::Time;
use chronotope::dataset::synthetic::{World, WorldConfig};
use chronotope::feature::GrayImage;
use chronotope_eval::data::folds;
use chronotope_eval::results::SuiteResults;
use chronotope_eval::run::{RunOptions, run};
use chronotope_eval::suite::{Protocol, Suite};
use tempfile::TempDir;

/// Days of the rendered walks.
const DAYS: [&str; 3] = ["2024-05-01", "2024-05-02", "2024-05-03"];

/// Places that are passed on each day, 20 s apart.
const NUM_PLACES: usize = 4;

fn write_image(path: &Path, image: &GrayImage) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let (width, height) = image.size();
    let picture = image::GrayImage::from_raw(width, height, image.data().to_vec()).unwrap();
    picture.save(path).unwrap();
}

fn street() -> World {
    let cfg = WorldConfig::new(7).with_num_places(NUM_PLACES);
    World::new(&cfg.with_image_size(320, 240)).unwrap()
}

/// A folder of images with its index: the street, walked once on each of `days`.
fn walks(folder: &Path, days: &[&str]) {
    let world = street();
    let mut index = String::from("place,time,path\n");
    for (walk, day) in days.iter().enumerate() {
        for place in 0..NUM_PLACES {
            let time = format!("{day}T10:00:{:02}Z", 15 * place);
            let path = format!("images/{day}-{place}.png");
            let image = world.render(place, Time::parse(&time).unwrap(), walk as u64);
            write_image(&folder.join(&path), &image);
            writeln!(index, "p{place},{time},{path}").unwrap();
        }
    }
    fs::write(folder.join("index.csv"), index).unwrap();
}

fn chronotope_eval(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_chronotope-eval"))
        .args(args)
        .env_clear()
        .output()
        .unwrap()
}

/// Runs the command in a folder of walks and gives its results and what it printed.
fn evaluated(dir: &TempDir, args: &[&str]) -> (SuiteResults, String) {
    let photos = dir.path().join("photos");
    if !photos.exists() {
        walks(&photos, &DAYS);
    }
    let out = dir.path().join("out");
    let mut all = vec!["run", "--data", photos.to_str().unwrap()];
    all.extend(["--out", out.to_str().unwrap()]);
    all.extend(args);
    let output = chronotope_eval(&all);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let results = SuiteResults::read(&out.join("photos.json")).unwrap();
    assert!(out.join("report.html").is_file());
    (results, String::from_utf8(output.stdout).unwrap())
}

#[test]
fn one_command_evaluates_a_folder_against_all_baselines() {
    let dir = TempDir::new().unwrap();
    let (results, table) = evaluated(&dir, &["--tolerance", "places:1"]);
    assert_eq!(results.queries.len(), DAYS.len() * NUM_PLACES);
    assert!(results.split.contains("few visits"), "{}", results.split);
    let methods: std::collections::BTreeSet<_> = (results.rows.iter())
        .map(|row| (row.variant.method.as_str(), row.variant.score.as_str()))
        .collect();
    for method in [
        "static",
        "fremen",
        "experience",
        "experience-all",
        "freex",
        "fused",
    ] {
        for score in ["likelihood", "inliers"] {
            assert!(methods.contains(&(method, score)), "{method}, {score}");
        }
    }
    assert!(results.rows.iter().any(|row| row.is_default));
    for row in &results.rows {
        let within = row.within.unwrap();
        assert!(within.correct >= row.correct - 1e-9, "{row:?}");
        assert!(within.located_wrong <= within.located_wrong_exact);
    }
    let first = &results.queries[0];
    assert_eq!(first.truth.as_deref(), Some("p0"));
    assert_eq!(first.near, ["p1"]);
    assert_eq!(results.queries[1].near, ["p0", "p2"]);
    assert!(table.contains("Within 1 place, n = "), "{table}");
    let (_, body) = table.split_once("Wrong answers in %").unwrap();
    let is_narrow = |line: &str| line.chars().count() <= 100;
    assert!(body.lines().all(is_narrow), "{body}");
    let report = fs::read_to_string(dir.path().join("out/report.html")).unwrap();
    assert!(report.contains("right within 1 place") && report.contains("sure enough to act on"));
}

#[test]
fn what_is_learnt_and_queried_can_be_said() {
    let dir = TempDir::new().unwrap();
    let (results, _) = evaluated(&dir, &["--learn-until", "2024-05-03T00:00:00Z"]);
    assert_eq!(results.queries.len(), NUM_PLACES);
    assert_eq!(results.num_learnt_images, Some(2 * NUM_PLACES as u32));
    assert!(results.rows.iter().all(|row| row.within.is_none()));

    let list = dir.path().join("sides.csv");
    let rows = "path,side\nimages/2024-05-01-0.png,learn\n\"images/2024-05-02-1.png\",learn\n\
                images/2024-05-03-0.png,query\nimages/2024-05-03-2.png,query\n";
    fs::write(&list, rows).unwrap();
    let (results, _) = evaluated(&dir, &["--split", list.to_str().unwrap()]);
    let truths: Vec<_> = results
        .queries
        .iter()
        .map(|query| query.truth.as_deref())
        .collect();
    assert_eq!(
        truths,
        [Some("p0"), None],
        "the second shows a place that was not learnt"
    );
    assert!(
        results.notes.iter().any(|note| note.contains("not learnt")),
        "{:?}",
        results.notes
    );

    let june = dir.path().join("june");
    walks(&june, &["2024-06-05"]);
    let june = june.to_str().unwrap();
    let (results, _) = evaluated(&dir, &["--query", june]);
    assert_eq!(results.queries.len(), NUM_PLACES);
    assert_eq!(
        results.num_learnt_images,
        Some((DAYS.len() * NUM_PLACES) as u32)
    );
    assert!(results.queries[0].id.starts_with("query/images/2024-06-05"));
}

#[test]
fn what_cannot_be_evaluated_says_what_helps() {
    let dir = TempDir::new().unwrap();
    let once = dir.path().join("once");
    walks(&once, &DAYS[..1]);
    let once = once.to_str().unwrap();
    let list = dir.path().join("sides.csv");
    fs::write(&list, "images/nowhere.png,learn\n").unwrap();
    let list = list.to_str().unwrap();
    let out = dir.path().join("out");
    let out = out.to_str().unwrap();
    let nowhere = "/nowhere/photos";
    for (args, message) in [
        (vec!["run"], "--data DIR"),
        (vec!["run", "--data", nowhere], nowhere),
        (vec!["run", "--data", once, "--out", out], "--query DIR"),
        (
            vec!["run", "--data", once, "--leave-one-out"],
            "--query DIR",
        ),
        (
            vec!["run", "--data", once, "--split", list],
            "no image `images/nowhere.png`",
        ),
        (
            vec![
                "run",
                "--data",
                once,
                "--learn-until",
                "2030-01-01T00:00:00Z",
            ],
            "no image is queried",
        ),
        (
            vec!["run", "--data", once, "--tolerance", "near"],
            "places:K",
        ),
        (
            vec!["run", "floors", "--leave-one-out"],
            "suite `floors` says itself",
        ),
        (
            vec!["run", "door", "--tolerance", "places:1"],
            "one dataset",
        ),
    ] {
        let output = chronotope_eval(&args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            !output.status.success() && said.contains(message),
            "{args:?}: {said}"
        );
        assert!(!said.contains("panicked"), "{said}");
    }
    for (tolerance, file) in [("edges:1", "edges.csv"), ("metres:2", "poses.csv")] {
        let photos = dir.path().join("photos");
        walks(&photos, &DAYS[..2]);
        let output = chronotope_eval(&[
            "run",
            "--data",
            photos.to_str().unwrap(),
            "--out",
            out,
            "--tolerance",
            tolerance,
        ]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(file), "{said}");
    }
}

#[test]
fn a_suite_of_ones_own_runs_by_its_path() {
    let dir = TempDir::new().unwrap();
    walks(&dir.path().join("photos"), &DAYS);
    let path = dir.path().join("walk.toml");
    let suite = "title = 'One walk is learnt'\ndataset = 'photos'\ntolerance = 'places:1'\n\
                 sizes = [30]\nprotocol = { kind = 'few-visits', num-learn = 1 }\n\
                 [[arms]]\npreset = 'default'\nmethods = ['static']\nscores = ['likelihood']\n";
    fs::write(&path, suite).unwrap();
    let suite = Suite::find(path.to_str().unwrap()).unwrap();
    let options = RunOptions {
        cache: dir.path().join("cache"),
        ..RunOptions::default()
    };
    let run = run(&suite, &options).unwrap().remove(0);
    let results = run.results;
    results.validate().unwrap();
    // Three walks: each is learnt once, and the images of the two others are queried.
    assert_eq!(results.queries.len(), 2 * DAYS.len() * NUM_PLACES);
    let id = "images/2024-05-02-0.png (visit 01 learnt)";
    let query = results.queries.iter().find(|query| query.id == id).unwrap();
    assert_eq!(query.group.as_deref(), Some("images/2024-05-02-0.png"));
    assert_eq!(results.num_learnt_images, Some(NUM_PLACES as u32));
    assert_eq!(results.rows[0].queries as usize, results.queries.len());
}

/// A textured picture that differs from one name to the next.
fn texture(path: &Path) {
    let name = path.display().to_string();
    let data = (0..96 * 96)
        .map(|i| (256.0 * crate::sample::chance(&[&name, &(i / 6).to_string()])) as u8)
        .collect();
    write_image(path, &GrayImage::new(96, 96, data).unwrap());
}

/// What a built-in suite learns and queries in a folder, without extracting anything.
fn sides(suite: &str, folder: &Path) -> (Suite, Vec<String>, Vec<String>) {
    let suite = Suite::find(suite).unwrap();
    let manifest = chronotope::dataset::Manifest::find_builtin(&suite.dataset).unwrap();
    let dataset = chronotope::dataset::Dataset::open_with(&manifest, folder).unwrap();
    let (folds, _) = folds(&suite, &dataset, manifest.split.as_ref()).unwrap();
    assert_eq!(folds.len(), 1);
    let ids = |entries: &[usize]| {
        let entries = entries.iter().map(|&entry| &dataset.entries[entry]);
        entries
            .map(|entry| format!("{} {}", entry.place, entry.id))
            .collect()
    };
    let (learn, query) = (ids(&folds[0].learn), ids(&folds[0].query));
    (suite, learn, query)
}

#[test]
fn witham_wharf_is_learnt_for_a_week_and_queried_on_three_test_days() {
    let dir = TempDir::new().unwrap();
    let root = dir.path().join("witham_wharf");
    for place in 0..2 {
        // Images of the week's first and last hour; one of a day a week, three months and a year
        // after it.
        for number in [0, 1, 1007] {
            texture(&root.join(format!("training/place_{place}/{number:05}.bmp")));
        }
        for number in [0, 11_520, 52_560] {
            texture(&root.join(format!("testing/place_{place}/{number:05}.bmp")));
        }
    }
    let (suite, learn, query) = sides("witham", dir.path());
    assert_eq!((learn.len(), query.len()), (6, 6));
    assert!(learn.contains(&"place_1 training/place_1/01007.bmp".to_owned()));
    assert!(query.contains(&"place_0 testing/place_0/52560.bmp".to_owned()));
    assert!(suite.arms.iter().any(|arm| arm.preset.name() == "lttl"));
    let options = RunOptions {
        data: Some(dir.path().to_owned()),
        cache: dir.path().join("cache"),
        ..RunOptions::default()
    };
    let small = Suite {
        sizes: vec![50],
        ..suite
    };
    let results = run(&small, &options).unwrap().remove(0).results;
    assert_eq!(results.queries.len(), 6);
    let days: Vec<_> = results
        .notes
        .iter()
        .filter(|note| note.contains("on 20"))
        .collect();
    assert_eq!(days.len(), 3, "{:?}", results.notes);
}

#[test]
fn nclt_is_learnt_until_august_and_queried_later() {
    let dir = TempDir::new().unwrap();
    let root: PathBuf = dir.path().join("nclt");
    for (session, start_s) in [
        ("2012-01-08", 1_326_030_975_i64),
        ("2012-06-15", 1_339_760_000),
        ("2013-01-10", 1_357_840_000),
    ] {
        let mut poses = String::from("0,NaN,NaN,NaN,NaN,NaN,NaN\n");
        for second in 0..60_i64 {
            let us = (start_s + second) * 1_000_000;
            writeln!(poses, "{us},{second}.0,0.0,-1.0,0.0,0.0,0.0").unwrap();
            if second % 5 == 0 {
                texture(&root.join(format!("images/{session}/lb3/Cam5/{us}.tiff")));
            }
        }
        fs::create_dir_all(root.join("ground_truth")).unwrap();
        let truth = root.join(format!("ground_truth/groundtruth_{session}.csv"));
        fs::write(truth, poses).unwrap();
    }
    let (suite, learn, query) = sides("nclt", dir.path());
    // 60 m of a straight drive are three places, 20 m apart.
    assert_eq!(suite.tolerance.unwrap().to_string(), "metres:25");
    assert_eq!((learn.len(), query.len()), (6, 3), "{learn:?} {query:?}");
    let june = learn.iter().filter(|id| id.contains("2012-06-15")).count();
    assert_eq!(june, 3);
    assert!(
        query.iter().all(|id| id.contains("2013-01-10")),
        "{query:?}"
    );
    assert_eq!(&query[1][..5], "r0001");
}

#[test]
fn a_folder_of_many_visits_is_split_where_there_is_a_pause() {
    let dir = TempDir::new().unwrap();
    let mut index = String::from("place,time,path\n");
    texture(&dir.path().join("a.png"));
    for day in 1..=20 {
        for place in ["hall", "door"] {
            writeln!(index, "{place},2024-05-{day:02}T10:00:00Z,a.png").unwrap();
        }
    }
    fs::write(dir.path().join("index.csv"), index).unwrap();
    let dataset = chronotope::dataset::Dataset::open(dir.path()).unwrap();
    let suite = Suite::of_folder(dir.path(), Protocol::Auto, None).unwrap();
    let (folds, words) = folds(&suite, &dataset, None).unwrap();
    assert_eq!((folds[0].learn.len(), folds[0].query.len()), (28, 12));
    assert!(
        words.contains("2024-05-15T10:00:00Z, chosen because"),
        "{words}"
    );
}

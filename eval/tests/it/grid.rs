//! A suite of grids on a small folder, from files to a report; and what every suite of grids is.

use std::fmt::Write as _;

use anyhow::Context as _;
use chronotope_eval::grid::{self, GridResults};
use chronotope_eval::report;
use chronotope_eval::results::write_json;
use chronotope_eval::run::RunOptions;
use chronotope_eval::suite::{Protocol, Suite};

const DAY_S: i64 = 86_400;

/// Two days on which somebody stands at one place from 8 to 12 o'clock, and walks by at night.
fn run() -> anyhow::Result<GridResults> {
    let dir = tempfile::tempdir()?;
    let folder = dir.path().join("series/pedestrians");
    std::fs::create_dir_all(&folder)?;
    for day in [3, 9] {
        let mut text = format!("{} {}\n0 3\n0 2\n", day * DAY_S, (day + 1) * DAY_S);
        for minute in 8 * 60..12 * 60 {
            writeln!(text, "{} 0.5 0.5", day * DAY_S + 60 * minute + 7)?;
        }
        writeln!(text, "{} 2.5 1.5", day * DAY_S + 3_600 * (day % 7))?;
        std::fs::write(folder.join(format!("day-{day}.txt")), text)?;
    }
    let options = RunOptions {
        data: Some(dir.path().to_path_buf()),
        command: "chronotope-eval run grid-presence <and its escaping>".into(),
        ..RunOptions::default()
    };
    let results = grid::run(&Suite::find("grid-presence")?, &options)?;
    results.context("`grid-presence` is a suite of grids")
}

#[test]
fn a_day_is_learnt_another_judged_and_both_are_shown() {
    let results = run().unwrap();
    let [table] = &results.tables[..] else {
        panic!("one day is predicted: {:?}", results.tables);
    };
    let brier = |row: &str| table.value(row, "brier").unwrap().value;
    assert!(brier("histogram, 24 h") < 0.01 && brier("FreMEn, order 2") < 0.7 * brier("mean"));
    assert_eq!(table.value("mean", "gain").unwrap().value, 0.0);
    let text = grid::table(&results);
    assert!(
        text.contains("* FreMEn, order 2") && text.contains("day-9.txt is predicted"),
        "{text}"
    );
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("grid-presence.json");
    write_json(&results, &path).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    assert_eq!(json["schema_version"], 1);
    assert_eq!(json["tables"][0]["rows"][0]["name"], "mean");
    assert!(json["tables"][0]["rows"][0]["values"]["brier"]["value"].is_f64());
    let html = report::render_grid(&results);
    assert!(html.contains("&lt;and its escaping&gt;") && html.contains("<section id=\"summary\">"));
    for loads in ["http://", "https://", "url(h", "<link", "src=\"h"] {
        assert!(!html.contains(loads), "{loads}");
    }
}

#[test]
fn suites_of_grids_need_no_images_and_say_what_they_lack() {
    let mut num_grids = 0;
    for suite in Suite::builtin() {
        let suite = suite.unwrap();
        if let Protocol::Grid { .. } = suite.protocol {
            num_grids += 1;
            assert!(suite.arms.is_empty() && suite.name.starts_with("grid-"));
        }
    }
    assert_eq!(num_grids, 5);
    let options = RunOptions::default();
    for name in ["grid-presence", "grid-carmen"] {
        let error = grid::run(&Suite::find(name).unwrap(), &options).unwrap_err();
        assert!(error.to_string().contains("--data DIR"), "{error}");
    }
    let dir = tempfile::tempdir().unwrap();
    let options = RunOptions {
        data: Some(dir.path().to_path_buf()),
        ..RunOptions::default()
    };
    let error = grid::run(&Suite::find("grid-carmen").unwrap(), &options).unwrap_err();
    assert!(error.to_string().contains("no recordings *.log"), "{error}");
    assert!(
        grid::run(&Suite::find("door").unwrap(), &options)
            .unwrap()
            .is_none()
    );
}

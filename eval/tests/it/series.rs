//! A suite of series on a small folder, from files to a report.

use std::fmt::Write as _;

use anyhow::Context as _;
use chronotope_eval::report;
use chronotope_eval::results::{RowOrder, write_json};
use chronotope_eval::run::RunOptions;
use chronotope_eval::series::sampling::Sampling;
use chronotope_eval::series::{self, SeriesResults};
use chronotope_eval::suite::Suite;

/// Edges that can be traversed by day only, with every ninth traversal the other way round; one has
/// too few.
fn run() -> anyhow::Result<SeriesResults> {
    let dir = tempfile::tempdir()?;
    let edges = dir.path().join("series/edges");
    std::fs::create_dir_all(&edges)?;
    for (name, num) in [("a_b", 2_000), ("b_a", 1_500), ("c_d", 7)] {
        let mut text = String::new();
        for i in 0..num {
            let time_s = 1_404_700_000 + i * 2_711;
            let is_day = (6..18).contains(&(time_s / 3_600 % 24));
            writeln!(text, "{time_s} 12.5 {}", u8::from(is_day != (i % 9 == 0)))?;
        }
        std::fs::write(edges.join(format!("{name}.data")), text)?;
    }
    let options = RunOptions {
        data: Some(dir.path().to_path_buf()),
        out: dir.path().join("out"),
        cache: dir.path().join("cache"),
        command: "chronotope-eval run edges <and its escaping>".into(),
        ..RunOptions::default()
    };
    let results = series::run(&Suite::find("edges")?, &options)?;
    results.context("`edges` is a suite of series")
}

#[test]
fn edges_are_learnt_judged_and_drawn() {
    let results = run().unwrap();
    assert_eq!(results.num_series, 2);
    assert!(results.notes.iter().any(|note| note.contains("c_d")));
    for sampling in Sampling::ALL {
        let mean = results.row(sampling, "mean", RowOrder::Fixed(0)).unwrap();
        let zero = mean.brier_against_mean;
        assert_eq!((zero.value, zero.low, zero.high), (0.0, 0.0, 0.0));
        for row in results.rows.iter().filter(|row| row.sampling == sampling) {
            assert!((0.0..=1.0).contains(&row.brier.value), "{row:?}");
            assert!(row.brier.low <= row.brier.value && row.brier.value <= row.brier.high);
            assert!(row.log_loss.value.is_finite(), "{row:?}");
        }
    }
    let all = results.default_row(Sampling::All).unwrap();
    assert!(
        all.is_default && all.brier_against_mean.high < 0.0,
        "{all:?}"
    );
    assert!((all.num_learnt - 2_450.0).abs() < 1.0, "{all:?}");
    // One traversal in nine goes the other way.
    assert!((0.10..0.16).contains(&all.state_error.value), "{all:?}");
    let table = series::table(&results);
    assert!(
        table.contains("* natural") && table.contains("office-hours samples"),
        "{table}"
    );

    let html = report::render_series(&results);
    assert_eq!(html, report::render_series(&results));
    assert!(html.contains("&lt;and its escaping&gt;"));
    for id in ["curves", "order", "spectrum", "summary"] {
        assert!(html.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
    for loads in [
        "http://", "https://", "url(h", "@import", "<link", "src=\"h",
    ] {
        assert!(!html.contains(loads), "{loads}");
    }
    let (page, _) = html.split_once("<script>").unwrap();
    assert!(
        !page.contains("NaN") && !page.contains("inf"),
        "a number is missing"
    );
    for tag in html.split("<svg").skip(1) {
        let tag = tag.split('>').next().unwrap();
        assert!(
            tag.contains("aria-label=") || tag.contains("aria-hidden="),
            "{tag:.200}"
        );
    }
}

#[test]
fn the_file_has_every_row_once() {
    let results = run().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("edges.json");
    write_json(&results, &path).unwrap();
    let file: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let rows = file["rows"].as_array().unwrap();
    assert_eq!(rows.len(), results.rows.len());
    let mut keys: Vec<_> = rows
        .iter()
        .map(|row| [&row["sampling"], &row["model"], &row["order"]].map(ToString::to_string))
        .collect();
    keys.sort();
    keys.dedup();
    assert_eq!(keys.len(), rows.len());
}

#[test]
fn a_folder_without_the_series_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let options = RunOptions {
        data: Some(dir.path().to_path_buf()),
        out: dir.path().to_path_buf(),
        cache: dir.path().to_path_buf(),
        ..RunOptions::default()
    };
    let error = series::run(&Suite::find("door").unwrap(), &options).unwrap_err();
    assert!(
        format!("{error:#}").contains("no folder `door`"),
        "{error:#}"
    );
}

#[test]
fn one_thread_and_many_give_the_same_numbers() {
    let rows = |num_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads);
        let results = pool.build().unwrap().install(|| run().unwrap());
        serde_json::to_string(&results.rows).unwrap()
    };
    assert_eq!(rows(1), rows(4));
}

//! The made-up run, from answers to files and into a browser.

mod browser;
mod grid;
mod own;
mod pictures;
mod sample;
mod series;

use chronotope_eval::report::{self, Pictures, ReportInput};
use chronotope_eval::results::SuiteResults;

#[test]
fn the_sample_run_survives_its_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sample.json");
    let results = sample::sample_results();
    results.write(&path).unwrap();
    assert_eq!(SuiteResults::read(&path).unwrap(), results);
}

#[test]
fn a_report_is_one_file_that_loads_nothing_and_repeats_its_bytes() {
    let (results, pictures) = (sample::sample_results(), pictures::sample_pictures());
    let input = ReportInput {
        results: &results,
        pictures: &pictures,
    };
    let html = report::render(&input).unwrap();
    assert_eq!(html, report::render(&input).unwrap());
    for loads in [
        "http://", "https://", "url(h", "@import", "<link", "src=\"h",
    ] {
        assert!(!html.contains(loads), "{loads}");
    }
    assert!(html.contains("&lt;and its escaping&gt;"));
    for id in [
        "error",
        "summary",
        "features",
        "visibility",
        "reobservation",
        "judgement",
        "cost",
        "mistakes",
    ] {
        assert!(html.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
}

#[test]
fn every_picture_has_a_text() {
    let (results, pictures) = (sample::sample_results(), pictures::sample_pictures());
    let input = ReportInput {
        results: &results,
        pictures: &pictures,
    };
    let html = report::render(&input).unwrap();
    for tag in html.split("<svg").skip(1).chain(html.split("<img").skip(1)) {
        let tag = tag.split('>').next().unwrap();
        let described = ["aria-label=", "alt=", "aria-hidden="];
        assert!(
            described.iter().any(|text| tag.contains(text)),
            "{tag:.200}"
        );
    }
}

#[test]
fn a_report_without_pictures_rows_or_default_still_renders() {
    let mut results = sample::sample_results();
    for row in &mut results.rows {
        row.is_default = false;
    }
    let pictures = Pictures::default();
    let render = |results: &SuiteResults| {
        let input = ReportInput {
            results,
            pictures: &pictures,
        };
        report::render(&input).unwrap()
    };
    assert!(render(&results).contains("the configuration (fremen"));
    let empty = render(&SuiteResults::new("empty", "none"));
    assert!(empty.contains("Suite empty") && !empty.contains("<section"));
}

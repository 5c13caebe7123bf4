//! Models of one real state, learnt from irregular samples, where the data are.

#![allow(clippy::expect_used, reason = "a broken fixture ends the test")]

use std::collections::BTreeMap;
use std::io::Read;
use std::path::PathBuf;

use fremen::Time;
use fremen::visibility::{BitRow, HistoryLog, VisibilityConfig, Visits, fit};

/// Rows of time and state of a gzipped table with a header.
fn series(path: &str) -> Option<Vec<(i64, bool)>> {
    let Some(root) = std::env::var_os("CHRONOTOPE_DATA") else {
        eprintln!("SKIPPED: set CHRONOTOPE_DATA to the datasets' folder to test with {path}");
        return None;
    };
    let file = std::fs::File::open(PathBuf::from(root).join(path)).expect("the series is there");
    let mut text = String::new();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .expect("gzip");
    let row = |line: &str| {
        let (time_s, state) = line.split_once(',').expect("two columns");
        (time_s.parse().expect("seconds"), state.trim() == "1")
    };
    Some(text.lines().skip(1).map(row).collect())
}

fn bit(state: bool) -> BitRow {
    let mut row = BitRow::zeros(1);
    if state {
        row.set(0);
    }
    row
}

/// Prints the Brier score on the unseen week of each model learnt from 2 % of the office hours
/// (Monday to Friday, 8 to 18 h UTC) of ten weeks, over five draws.
#[test]
fn real_data_office_hours_alone_foretell_the_next_week() {
    let (Some(learn), Some(test)) = (
        series("series/door2016/learn_10_weeks.csv.gz"),
        series("series/door2016/test_week_1.csv.gz"),
    ) else {
        return;
    };
    let week = "candidates = { base-s = 604800.0, count = 168 }";
    let models = [
        ("mean", "kind = 'mean'".to_owned()),
        (
            "alpha-only",
            format!("kind = 'fremen', {week}, order = 2, balance = 'alpha-only'"),
        ),
        (
            "running-mean",
            format!("kind = 'fremen', {week}, order = 2, balance = 'running-mean'"),
        ),
        ("natural", "kind = 'natural'".to_owned()),
        ("fremen", format!("kind = 'fremen', {week}, order = 2")),
        ("least-squares", format!("kind = 'least-squares', {week}")),
        ("logistic", format!("kind = 'logistic', {week}")),
        (
            "least-squares-given",
            format!("kind = 'least-squares', {week}, harmonics = [1, 2, 7, 14]"),
        ),
        (
            "logistic-given",
            format!("kind = 'logistic', {week}, harmonics = [1, 2, 7, 14]"),
        ),
    ];
    let mut brier: BTreeMap<&str, f64> = BTreeMap::new();
    for draw in 0..5_u64 {
        let mut random = draw * 7_919 + 1;
        let mut log = HistoryLog::new();
        for &(time_s, state) in &learn {
            // The epoch was a Thursday.
            let is_weekday = (time_s / 86_400 + 3) % 7 < 5;
            let is_office = is_weekday && (8..18).contains(&(time_s / 3_600 % 24));
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            if is_office && (random >> 33) % 50 == 0 {
                log.push_visit(Time::from_s(time_s), bit(state), None)
                    .expect("one bit");
            }
        }
        for (name, model) in &models {
            let cfg = VisibilityConfig::from_toml(&format!("model = {{ {model} }}")).expect(name);
            let model = fit(&log, &cfg, Visits::All).expect("few visits");
            let squares = test.iter().map(|&(time_s, state)| {
                (model.predict_one(0, Time::from_s(time_s)) - f64::from(u8::from(state))).powi(2)
            });
            let score = squares.sum::<f64>() / test.len() as f64;
            *brier.entry(name).or_default() += score / 5.0;
        }
    }
    println!("door2016: {brier:.4?}");
    let literal = brier["running-mean"].min(brier["alpha-only"]);
    // Of nights and weekends, which were never sampled, it knows no more than the mean, and says so.
    assert!(brier["natural"] <= 0.9 * literal && brier["natural"] < brier["mean"]);
    // Where the rhythms are given; a choice made on office hours cannot know of the nights.
    assert!(brier["logistic-given"] <= 0.75 * literal);
    assert!(brier["least-squares-given"] <= 0.75 * literal);
    assert!(brier["logistic"] <= literal);
}

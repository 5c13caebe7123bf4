//! Are the models of a fleet those of one machine, in whatever order and how often its rows come?

use std::collections::BTreeMap;
use std::path::PathBuf;

use chronotope_fleet::table::{ReadConfig, read_observations};
use chronotope_fleet::{FeatureModel, FleetConfig, FleetLog, learn};
use fremen::spectrum::{CandidatePeriods, SpectralSums};
use fremen::visibility::{Order, VisibilityConfig, Visits, fit};
use fremen::{Period, Series};
use proptest::prelude::*;

use crate::fixture::{Row, log_of, observations, shuffled, write};

/// By the plainest way: one sum a feature, one observation after the other.
fn one_by_one(rows: &[Row], cfg: &FleetConfig) -> BTreeMap<(String, u32), SpectralSums> {
    let mut sums = BTreeMap::new();
    for row in rows {
        sums.entry((row.place.to_owned(), row.feature))
            .or_insert_with(|| SpectralSums::new(cfg.candidates().clone()))
            .add(row.time, row.state)
            .expect("few");
    }
    sums
}

fn by_feature(models: Vec<FeatureModel>) -> BTreeMap<(String, u32), SpectralSums> {
    (models.into_iter())
        .map(|it| ((it.place, it.feature), it.sums))
        .collect()
}

#[test]
fn models_are_those_that_one_process_fits_of_the_log() {
    let rows = observations();
    let candidates = CandidatePeriods::harmonic(Period::WEEK, 30).expect("valid");
    let cfg = (FleetConfig::default().with_candidates(candidates.clone())).with_order(3);
    let models = learn(&log_of(&rows), &cfg).expect("few");
    assert_eq!(models.len(), 270);
    let fremen = VisibilityConfig::fremen(candidates, Order::Fixed(3));
    for model in &models {
        let of_it =
            (rows.iter()).filter(|it| it.place == model.place && it.feature == model.feature);
        let series: Series = of_it.map(|it| (it.time, it.state)).collect();
        let expected = fit(&series.to_log().expect("one state"), &fremen, Visits::All);
        assert_eq!(Some(&model.model), expected.expect("few").encode().as_ref());
    }
    assert_eq!(by_feature(models), one_by_one(&rows, &cfg));
}

#[test]
fn shuffled_repeated_and_scattered_rows_give_the_same_sums() {
    let folder = tempfile::tempdir().expect("a folder");
    let rows = observations();
    let cfg = FleetConfig::default();
    let expected = learn(&log_of(&rows), &cfg).expect("few");
    let twice = shuffled([rows.clone(), rows[1_000..9_000].to_vec()].concat(), 5);
    for (name, rows, num_parts) in [
        ("in order", rows.clone(), 1),
        ("shuffled", shuffled(rows.clone(), 1), 3),
        ("twice", twice, 5),
    ] {
        let files: Vec<PathBuf> = (0..num_parts)
            .map(|part| folder.path().join(format!("{name} {part}.parquet")))
            .collect();
        for (part, file) in files.iter().enumerate() {
            let of_it = rows.iter().skip(part).step_by(num_parts);
            write(file, &of_it.copied().collect::<Vec<_>>());
        }
        for num_threads in [1, 3] {
            let read = ReadConfig::default().with_num_threads(num_threads);
            let (log, report) = read_observations(&files, &read).expect("sound");
            assert_eq!(report.num_rows, rows.len() as u64, "{name}");
            let num_known = rows.len() as u64 - report.num_duplicates;
            assert_eq!(num_known, observations().len() as u64, "{name}");
            assert!(
                learn(&log, &cfg).expect("few") == expected,
                "{name}, {num_threads} threads"
            );
        }
    }
}

#[test]
fn logs_that_contradict_each_other_do_not_merge() {
    let row = observations()[0];
    let other = Row {
        state: !row.state,
        ..row
    };
    let later = Row {
        time: row.time.plus_us(1),
        ..row
    };
    for (other, feature) in [(other, Some(row.feature)), (later, None)] {
        let merged = log_of(&[row]).merge(log_of(&[other]));
        let found = merged.expect_err("a contradiction");
        assert_eq!((found.visit, found.feature), (row.visit, feature));
    }
}

proptest! {
    #[test]
    fn merging_logs_is_a_union(parts in prop::collection::vec(0_usize..3, 1..400)) {
        let rows = &observations()[..parts.len()];
        let part = |of: usize| {
            let rows = rows.iter().zip(&parts).filter(|(_, part)| **part == of);
            log_of(&rows.map(|(row, _)| *row).collect::<Vec<_>>())
        };
        let cfg = FleetConfig::default();
        let merged = |order: &[usize]| {
            let mut all = FleetLog::new();
            for &of in order {
                all = all.merge(part(of)).expect("no contradiction");
            }
            learn(&all, &cfg).expect("few")
        };
        let expected = learn(&log_of(rows), &cfg).expect("few");
        for order in [&[0, 1, 2][..], &[2, 0, 1], &[1, 0, 1, 2, 0]] {
            prop_assert!(merged(order) == expected);
        }
    }
}

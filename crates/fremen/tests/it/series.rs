//! A state over time: reading, learning, and what comes of too little.

#![allow(clippy::expect_used, reason = "a broken fixture ends the test")]

use fremen::series::Columns;
use fremen::spectrum::SpectralSums;
use fremen::visibility::VisibilityConfig;
use fremen::{CandidatePeriods, ErrorKind, Period, Series, SeriesModel, Time};
use proptest::prelude::*;

fn hour(hour: i64) -> Time {
    Time::from_s(3_600 * hour)
}

/// Open from 6 to 18 h of every day of four weeks.
fn door() -> Series {
    (0..28 * 24)
        .map(|at| (hour(at), (6..18).contains(&(at % 24))))
        .collect()
}

proptest! {
    #[test]
    fn a_series_is_the_same_however_its_samples_come(
        samples in prop::collection::vec((-1_000_i64..1_000, any::<Option<bool>>()), 0..60),
    ) {
        let samples: Vec<_> = samples.into_iter().map(|(s, state)| (Time::from_s(s), state)).collect();
        let collected: Series = samples.iter().copied().collect();
        let mut pushed = Series::new();
        for &(time, state) in &samples {
            pushed.push(time, state);
        }
        prop_assert_eq!(&collected, &pushed);
        prop_assert!(collected.states().is_sorted_by_key(|state| state.0));
        prop_assert_eq!(collected.len() + collected.missing().len(), samples.len());
        let (earlier, later) = collected.split_at(Time::from_s(0));
        prop_assert!(earlier.states().iter().all(|state| state.0 < Time::from_s(0)));
        prop_assert_eq!(earlier.len() + later.len(), collected.len());
        prop_assert_eq!(
            earlier.missing().len() + later.missing().len(),
            collected.missing().len()
        );
    }

    /// The one implementation against the definition.
    #[test]
    fn a_periodogram_is_the_naive_transform(
        states in prop::collection::vec((-50_000_i64..50_000, any::<bool>()), 1..40),
    ) {
        let states: Vec<_> = states.into_iter().map(|(s, state)| (Time::from_s(s), state)).collect();
        let candidates = CandidatePeriods::harmonic(Period::DAY, 7).expect("valid");
        let series: Series = states.iter().copied().collect();
        let periodogram = series.periodogram(&candidates).expect("few");
        let m = states.len() as f64;
        let mean = series.mean().expect("not empty");
        for line in periodogram.lines() {
            let mut sums = [0.0; 4];
            for &(time, state) in &states {
                let (sin, cos) = (std::f64::consts::TAU * time.as_s() / line.period_s).sin_cos();
                let centred = f64::from(u8::from(state)) - mean;
                for (sum, term) in sums.iter_mut().zip([centred * cos, centred * sin, cos, sin]) {
                    *sum += term;
                }
            }
            prop_assert!((line.amplitude - 2.0 / m * sums[0].hypot(sums[1])).abs() < 1e-8);
            prop_assert!((line.window - sums[2].hypot(sums[3]) / m).abs() < 1e-8);
        }
        let mut sums = SpectralSums::new(candidates);
        for &(time, state) in &states {
            sums.add(time, state).expect("few");
        }
        prop_assert_eq!(sums.periodogram(), periodogram);
    }
}

#[test]
fn a_door_is_predicted_and_what_is_unusual_is_found() {
    let mut door = door();
    let model = door.learn().expect("few");
    assert!(model.p(hour(1_000 * 24 + 12)) > 0.9 && model.p(hour(1_000 * 24)) < 0.1);
    assert_eq!(model.components()[0].period_s, Period::DAY.as_s());
    assert!(model.brier(&door).expect("not empty") < 0.08);
    assert_eq!(model.anomalies(&door, 0.95).expect("valid").len(), 0);
    door.push(Time::from_s(3_600 * 24 * 30), Some(true));
    let found = model.anomalies(&door, 0.9).expect("valid");
    assert_eq!(found.len(), 1);
    assert_eq!((found[0].time, found[0].state), (hour(24 * 30), true));
    let error = model.anomalies(&door, 0.2).expect_err("no confidence");
    assert_eq!(error.kind(), ErrorKind::Config);

    let bytes = model.encode().expect("has bytes");
    let decoded = SeriesModel::decode(&bytes).expect("own bytes");
    assert_eq!(decoded.p(hour(7)), model.p(hour(7)));
}

#[test]
fn nothing_known_is_one_half_and_a_constant_is_nearly_sure() {
    let mut unknown = Series::new();
    unknown.push(hour(3), None);
    for cfg in [VisibilityConfig::natural(), VisibilityConfig::mean()] {
        for series in [&Series::new(), &unknown] {
            let model = series.learn_with(&cfg).expect("nothing");
            assert_eq!(model.p(hour(5)), 0.5);
            assert_eq!(model.brier(series), None);
            assert_eq!(series.mean(), None);
        }
        let always: Series = (0..500).map(|at| (hour(at), true)).collect();
        let p = always.learn_with(&cfg).expect("few").p(hour(9_999));
        assert_eq!(p, 500.5 / 501.0);
    }
}

/// A clock that is read at some hours only says nothing of the others, whatever the model.
#[test]
fn hours_that_were_never_sampled_are_near_the_mean_and_not_sure() {
    let office = (0..60).flat_map(|day| (8..18).map(move |at| (hour(24 * day + at), at >= 9)));
    let office: Series = office
        .map(|(time, open)| (time, open && time != hour(17)))
        .collect();
    let mean = office.mean().expect("some");
    let models = [
        "kind = 'natural'",
        "kind = 'mean'",
        "kind = 'markov'",
        "kind = 'fremen', candidates = { base-s = 86400.0, count = 6 }, order = 3",
        "kind = 'histogram', period-s = 86400.0, num-bins = 24",
        "kind = 'persistent', of = { kind = 'natural' }",
    ];
    for text in models {
        let cfg = VisibilityConfig::from_toml(&format!("model = {{ {text} }}")).expect("a model");
        let model = office.learn_with(&cfg).expect("few");
        for night in [0, 5, 21] {
            let at = model.estimate(hour(24 * 70 + night));
            assert!((at.p - mean).abs() < 0.05, "{text} at {night}: {at:?}");
            assert!(at.high - at.low > 0.6, "{text} at {night}: {at:?}");
        }
        let noon = model.estimate(hour(24 * 70 + 12));
        assert!(
            noon.low <= noon.p && noon.p <= noon.high,
            "{text}: {noon:?}"
        );
        assert!(noon.high - noon.low < 0.25, "{text}: {noon:?}");
    }
    let natural = office.learn().expect("few");
    assert!(natural.p(hour(24 * 70 + 12)) > 0.9);
    assert!((0.0..=1.0).contains(&natural.mean().expect("kept")));
}

#[test]
fn few_samples_are_not_certain_and_a_burst_is_one_look() {
    for text in ["kind = 'natural'", "kind = 'mean'", "kind = 'markov'"] {
        let cfg = VisibilityConfig::from_toml(&format!("model = {{ {text} }}")).expect("a model");
        let one: Series = [(hour(7), true)].into_iter().collect();
        let one = one.learn_with(&cfg).expect("few").estimate(hour(8));
        assert_eq!(one.p, 0.75, "{text}");
        assert!(one.low < 0.3, "{text}: {one:?}");
        let never: Series = (0..20).map(|day| (hour(24 * day), false)).collect();
        let never = never.learn_with(&cfg).expect("few").estimate(hour(24 * 30));
        assert!(
            never.p > 0.0 && never.p < 0.05 && never.high > 0.1,
            "{text}: {never:?}"
        );
    }
    let hourly = (0..672).map(|at| (hour(at), true));
    let start_us = hour(672).as_us() - 1_800_000_000;
    let burst = (0..500).map(|i| (Time::from_us(start_us + 600_000 * i), false));
    let series: Series = hourly.chain(burst).collect();
    let model = series.learn().expect("few");
    assert!(model.components().is_empty(), "{:?}", model.components());
    let p = model.p(hour(672 + 9));
    assert!(p > 0.97 && p < 1.0, "{p}");
}

#[test]
fn slices_that_do_not_pair_and_files_that_are_not_there_are_errors() {
    let error = Series::from_slices(&[hour(1)], &[]).expect_err("no pairs");
    assert_eq!(error.kind(), ErrorKind::Shape);
    let error = Series::read_csv("no such file.csv", Columns::default()).expect_err("missing");
    assert_eq!(error.kind(), ErrorKind::NotFound);
    assert!(error.to_string().contains("no such file.csv"), "{error}");
}

#[test]
fn a_model_of_many_states_is_none_of_a_series() {
    let mut log = fremen::visibility::HistoryLog::new();
    log.push_visit(hour(0), fremen::visibility::BitRow::zeros(2), None)
        .expect("fits");
    let pair = fremen::visibility::fit(
        &log,
        &VisibilityConfig::mean(),
        fremen::visibility::Visits::All,
    );
    let bytes = pair.expect("fits").encode().expect("has bytes");
    let error = SeriesModel::decode(&bytes).expect_err("two states");
    assert_eq!(error.kind(), ErrorKind::Shape);
}

//! Properties of sums and spectral models, and the papers' numbers for the door where the data are.

#![allow(clippy::expect_used, reason = "a broken fixture ends the test")]

use std::f64::consts::TAU;
use std::io::Read;
use std::path::PathBuf;

use fremen::spectrum::{
    Balance, CandidatePeriods, Encoding, LiteralFremen, SpectralSums, UniformLearner,
    UniformSpectrum, VisitSums,
};
use fremen::{ErrorKind, Period, Time};
use proptest::prelude::*;

const SECOND: i64 = 1_000_000;

fn second() -> Period {
    Period::from_us(SECOND).expect("positive")
}

fn harmonic(base: Period, count: usize) -> CandidatePeriods {
    CandidatePeriods::harmonic(base, count).expect("valid")
}

fn sums_of(candidates: &CandidatePeriods, observations: &[(i64, bool)]) -> SpectralSums {
    let mut sums = SpectralSums::new(candidates.clone());
    for &(us, state) in observations {
        sums.add(Time::from_us(us), state).expect("few");
    }
    sums
}

fn observations() -> impl Strategy<Value = Vec<(i64, bool)>> {
    prop::collection::vec((any::<i64>(), any::<bool>()), 0..40)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn merging_is_commutative_and_associative_and_subtracting_undoes_it(
        a in observations(),
        b in observations(),
        c in observations(),
        count in 1_usize..40,
    ) {
        let candidates = harmonic(Period::WEEK, count);
        let sum = |parts: &[&SpectralSums]| {
            let mut total = SpectralSums::new(candidates.clone());
            for part in parts {
                total.merge(part).expect("same candidates");
            }
            total
        };
        let (a, b, c) = (sums_of(&candidates, &a), sums_of(&candidates, &b), sums_of(&candidates, &c));
        let ab = sum(&[&a, &b]);
        prop_assert_eq!(&ab, &sum(&[&b, &a]));
        prop_assert_eq!(sum(&[&ab, &c]), sum(&[&a, &sum(&[&b, &c])]));
        let mut undone = sum(&[&ab, &c]);
        undone.subtract(&c).expect("was added");
        undone.subtract(&b).expect("was added");
        prop_assert_eq!(&undone, &a);
        prop_assert_eq!(&SpectralSums::from_bytes(&a.to_bytes()).expect("own bytes"), &a);
    }

    #[test]
    fn sums_equal_exact_phases_at_any_time(
        observations in observations(),
        order in 0_usize..4,
        us in any::<i64>(),
    ) {
        let (base, count) = (Period::YEAR, 50);
        let candidates = harmonic(base, count);
        let rhythms = sums_of(&candidates, &observations).rhythms(count);
        let total = observations.len().max(1) as f64;
        let mean = observations.iter().filter(|o| o.1).count() as f64 / total;
        let mean = if observations.is_empty() { 0.5 } else { mean };
        prop_assert!((rhythms.mean() - mean).abs() < 1e-15);
        for component in rhythms.components() {
            let k = (base.as_s() / component.period_s).round() as i128;
            let (mut re, mut im) = (0.0, 0.0);
            for &(us, state) in &observations {
                let turn = (i128::from(us) * k).rem_euclid(i128::from(base.as_us()));
                let (sin, cos) = (TAU * (turn as f64 / base.as_us() as f64)).sin_cos();
                re += (f64::from(u8::from(state)) - mean) * cos;
                im -= (f64::from(u8::from(state)) - mean) * sin;
            }
            prop_assert!((2.0 * re.hypot(im) / total - component.amplitude).abs() < 4e-12);
        }
        let p = sums_of(&candidates, &observations).rhythms(order).p(Time::from_us(us));
        prop_assert!((0.0..=1.0).contains(&p));
    }

    #[test]
    fn damaged_sums_are_refused(bit in 0_usize..10_000, cut in 0_usize..10_000) {
        let bytes = sums_of(&harmonic(Period::DAY, 5), &[(7, true), (9, false)]).to_bytes();
        let mut flipped = bytes.clone();
        flipped[bit / 8 % bytes.len()] ^= 1 << (bit % 8);
        prop_assert!(SpectralSums::from_bytes(&flipped).is_err());
        prop_assert!(SpectralSums::from_bytes(&bytes[..cut % bytes.len()]).is_err());
    }

    #[test]
    fn merging_by_visit_is_idempotent_and_forgets_exactly(
        observations in observations(),
        of_a in prop::collection::vec(any::<bool>(), 40),
        of_b in prop::collection::vec(any::<bool>(), 40),
        horizon in any::<i64>(),
    ) {
        let candidates = harmonic(Period::WEEK, 7);
        let part = |chosen: &dyn Fn(usize) -> bool| {
            let mut part = VisitSums::new(candidates.clone());
            for (visit, &(us, state)) in observations.iter().enumerate().filter(|(i, _)| chosen(*i)) {
                assert!(part.add(visit as u128, Time::from_us(us), state).expect("few"));
            }
            part
        };
        let merged = |parts: &[&VisitSums]| {
            let mut total = VisitSums::new(candidates.clone());
            for part in parts {
                total.merge(part).expect("the same candidates");
            }
            total
        };
        let (a, b, c) = (part(&|i| of_a[i]), part(&|i| of_b[i]), part(&|i| i % 3 == 0));
        let union = part(&|i| of_a[i] || of_b[i]);
        prop_assert_eq!(&merged(&[&a, &b]), &union);
        prop_assert_eq!(&merged(&[&b, &a, &b, &a]), &union);
        prop_assert_eq!(merged(&[&union, &c]), merged(&[&a, &merged(&[&b, &c])]));
        let horizon = Time::from_us(horizon);
        let late = part(&|i| Time::from_us(observations[i].0) >= horizon);
        let mut all = part(&|_| true);
        let forgotten = all.forget_before(horizon).expect("was added");
        prop_assert_eq!(all.sums().num_observed() + forgotten, observations.len());
        prop_assert_eq!(all, late);
    }

    #[test]
    fn a_damaged_uniform_spectrum_is_refused_or_still_gives_probabilities(
        states in prop::collection::vec(prop_oneof![5 => any::<bool>().prop_map(Some), 1 => Just(None)], 0..200),
        order in 0_usize..4,
        changes in prop::collection::vec((0_usize..10_000, any::<u8>()), 1..4),
        us in any::<i64>(),
    ) {
        let model = UniformSpectrum::build_with_missing(Time::from_s(9), second(), &states, order).expect("short");
        let bytes = model.to_bytes(Encoding::Lossless);
        let mut damaged = bytes.clone();
        for &(at, byte) in &changes {
            let at = at % damaged.len();
            damaged[at] = byte;
        }
        if damaged != bytes {
            prop_assert!(UniformSpectrum::from_bytes(&damaged).is_err(), "the checksum tells");
        }
        // As if written by a faulty program: the checksum fits.
        let body = damaged.len() - 4;
        let crc = crc32fast::hash(&damaged[..body]);
        damaged[body..].copy_from_slice(&crc.to_le_bytes());
        if let Ok(mut model) = UniformSpectrum::from_bytes(&damaged) {
            for time in [Time::from_us(us), Time::from_us(i64::MIN), Time::from_us(i64::MAX)] {
                prop_assert!((0.0..=1.0).contains(&model.p(time)));
            }
            prop_assert!(model.components().all(|c| c.period_s > 0.0 && c.phase_rad.is_finite()));
            let error = model.estimation_error(0..model.num_samples());
            prop_assert!((0.0..=1.0).contains(&error), "{}", error);
            let len = model.num_samples().min(1_000);
            prop_assert_eq!(model.reconstruct(0..len).len() as u64, len);
            if model.num_samples() < 10_000 {
                model.add(Some(true)).expect("short");
                model.update(1).expect("short");
            }
        }
    }

    #[test]
    fn a_uniform_spectrum_gives_every_sample_back(
        states in prop::collection::vec(prop_oneof![5 => any::<bool>().prop_map(Some), 1 => Just(None)], 0..300),
        added in prop::collection::vec(prop_oneof![5 => any::<bool>().prop_map(Some), 1 => Just(None)], 0..300),
        order in 0_usize..8,
        new_order in 0_usize..8,
        start in any::<i64>(),
    ) {
        let start = Time::from_us(start);
        let mut model = UniformSpectrum::build_with_missing(start, second(), &states, order).expect("short");
        let all = |model: &UniformSpectrum| model.reconstruct(0..model.num_samples());
        prop_assert_eq!(&all(&model), &states);
        let mut expected = states;
        for state in added {
            model.add(state).expect("short");
            expected.push(state);
        }
        prop_assert_eq!(&all(&model), &expected);
        let decoded = UniformSpectrum::from_bytes(&model.to_bytes(Encoding::Lossless)).expect("own bytes");
        prop_assert_eq!(&decoded, &model);
        prop_assert!(model.best_order(5).expect("short") <= 5);
        model.update(new_order).expect("short");
        prop_assert_eq!(&all(&model), &expected);
        // The outlier set alone tells the error of any interval.
        let (from, to) = (expected.len() / 3, expected.len());
        let mut wrong = 0;
        for (index, state) in expected.iter().enumerate().take(to).skip(from) {
            let outlier = model.outliers().contains(index as u64);
            prop_assert!(!(outlier && state.is_none()));
            wrong += u32::from(outlier);
        }
        let observed = expected[from..to].iter().flatten().count();
        let error = f64::from(wrong) / observed.max(1) as f64;
        prop_assert!((model.estimation_error(from as u64..to as u64) - error).abs() < 1e-12);
    }

    #[test]
    fn on_uniform_samples_sums_and_transform_agree(
        states in prop::collection::vec(any::<bool>(), 2..60),
    ) {
        let len = states.len();
        let cycle = Period::from_us(len as i64 * SECOND).expect("positive");
        let observations: Vec<_> =
            states.iter().enumerate().map(|(i, &s)| (i as i64 * SECOND, s)).collect();
        // Below half the sampling rate, where every rhythm has its twin.
        let count = ((len - 1) / 2).max(1);
        let rhythms = sums_of(&harmonic(cycle, count), &observations).rhythms(count);
        let model = UniformSpectrum::build(Time::from_s(0), second(), &states, len).expect("short");
        for component in rhythms.components().filter(|c| c.amplitude > 1e-3) {
            let twin = model.components().find(|c| (c.period_s / component.period_s - 1.0).abs() < 1e-9);
            let twin = twin.expect("the same rhythm");
            let is_half_rate = (component.period_s - 2.0).abs() < 1e-9;
            let expected = if is_half_rate { component.amplitude / 2.0 } else { component.amplitude };
            prop_assert!((twin.amplitude - expected).abs() < 3e-5);
            let turn = (twin.phase_rad - component.phase_rad).rem_euclid(TAU);
            prop_assert!(turn.min(TAU - turn) < 1e-4, "{:?} {:?}", twin, component);
        }
    }
}

#[test]
fn a_visit_with_two_meanings_is_refused_and_nothing_changes() {
    let day = harmonic(Period::DAY, 3);
    let mut sums = VisitSums::new(day.clone());
    assert!(sums.add(7, Time::from_s(1), true).expect("new"));
    assert!(!sums.add(7, Time::from_s(1), true).expect("known"));
    let mut other = VisitSums::new(day);
    other.add(3, Time::from_s(1), true).expect("new");
    other.add(7, Time::from_s(1), false).expect("new");
    let before = sums.clone();
    assert_eq!(
        sums.merge(&other).expect_err("two states").kind(),
        ErrorKind::Shape
    );
    assert_eq!(sums, before);
    let week = VisitSums::new(harmonic(Period::WEEK, 3));
    assert_eq!(
        sums.merge(&week).expect_err("other rhythms").kind(),
        ErrorKind::Config
    );
}

/// The direct sum with phases in whole microseconds.
#[test]
fn sums_stay_exact_beyond_2_to_the_31_seconds() {
    for epoch_s in [0, 1 << 31, 1 << 32, (1_i64 << 42) - 5, -(1_i64 << 33)] {
        let (base, count, num) = (Period::YEAR, 100, 500);
        let times: Vec<i64> = (0..num)
            .map(|i| epoch_s * SECOND + i * i * 7_919_000_003)
            .collect();
        let observations: Vec<_> = times.iter().map(|&us| (us, us % 3 == 0)).collect();
        let mean = observations.iter().filter(|o| o.1).count() as f64 / num as f64;
        for component in sums_of(&harmonic(base, count), &observations)
            .rhythms(count)
            .components()
        {
            let k = (base.as_s() / component.period_s).round() as i128;
            let (mut re, mut im) = (0.0, 0.0);
            for &(us, state) in &observations {
                let turn = (i128::from(us) * k).rem_euclid(i128::from(base.as_us()));
                let (sin, cos) = (TAU * (turn as f64 / base.as_us() as f64)).sin_cos();
                re += (f64::from(u8::from(state)) - mean) * cos;
                im += (f64::from(u8::from(state)) - mean) * sin;
            }
            let difference = component.amplitude * num as f64 / 2.0 - re.hypot(im);
            assert!(
                difference.abs() <= 1e-12 * num as f64,
                "{epoch_s} s, {k}: {difference}"
            );
        }
    }
}

#[test]
fn what_was_never_added_cannot_be_forgotten() {
    let day = harmonic(Period::DAY, 3);
    let mut sums = sums_of(&day, &[(1, true), (2, false)]);
    let error = sums
        .subtract(&sums_of(&day, &[(1, true), (2, true)]))
        .expect_err("only one was seen");
    assert_eq!(error.kind(), ErrorKind::Shape);
    let week = SpectralSums::new(harmonic(Period::WEEK, 3));
    assert_eq!(
        sums.merge(&week).expect_err("other rhythms").kind(),
        ErrorKind::Config
    );
}

#[test]
fn unchanging_and_single_samples_have_no_rhythm() {
    for states in [vec![], vec![true], vec![false; 7], vec![true; 9]] {
        let model = UniformSpectrum::build(Time::from_s(3), second(), &states, 5).expect("short");
        assert_eq!(model.order(), 0);
        assert_eq!(model.outliers().limits(), [0_u64; 0]);
        let expected = match states.first() {
            None => 0.5,
            Some(&state) => f64::from(u8::from(state)),
        };
        assert_eq!(model.p(Time::from_us(i64::MIN)), expected);
    }
}

#[test]
fn one_learner_learns_what_each_series_alone_gives() {
    let start = Time::from_s(11);
    for len in [0, 1, 2, 97, 1_000, 1_031] {
        let mut learner = UniformLearner::new(len).expect("short");
        for turn in 1..4 {
            let states: Vec<_> = (0..len).map(|i| i / 7 % (turn + 1) == 0).collect();
            let alone = UniformSpectrum::build(start, second(), &states, 3).expect("short");
            let shared = learner.build(start, second(), &states, 3).expect("fits");
            assert_eq!(shared, alone, "{len} samples");
            let shift_us = 5_000_000_000 * SECOND + 7;
            let later = learner.build(start.plus_us(shift_us), second(), &states, 3);
            let later = later.expect("fits");
            for us in [-1_000 * SECOND, 0, 3_456_789, 500 * SECOND] {
                let time = start.plus_us(us);
                assert_eq!(later.p(time.plus_us(shift_us)), alone.p(time), "at {us} us");
            }
            let gaps: Vec<_> = (states.iter().enumerate())
                .map(|(i, &state)| (i % 5 != turn).then_some(state))
                .collect();
            let alone = UniformSpectrum::build_with_missing(start, second(), &gaps, 3);
            let shared = learner.build_with_missing(start, second(), &gaps, 3);
            assert_eq!(
                shared.expect("fits"),
                alone.expect("short"),
                "{len} samples"
            );
        }
    }
    let mut learner = UniformLearner::new(10).expect("short");
    let states = [true, false, true];
    let error = learner.build(start, second(), &states, 1);
    assert_eq!(error.expect_err("another length").kind(), ErrorKind::Shape);
    assert!(UniformLearner::new(usize::MAX).is_err());
}

#[test]
fn the_literal_rules_agree_with_the_exact_form_where_they_must() {
    let candidates = harmonic(Period::DAY, 8);
    // Whole days, hourly: W_k is zero, so no balance is needed.
    let hours: Vec<_> = (0..240_i64)
        .map(|hour| (hour * 3_600 * SECOND, hour % 24 < 7))
        .collect();
    let exact = sums_of(&candidates, &hours).rhythms(2);
    for balance in [Balance::Exact, Balance::AlphaOnly, Balance::RunningMean] {
        let mut literal = LiteralFremen::new(candidates.clone(), balance);
        for &(us, state) in &hours {
            literal.add(Time::from_us(us), state);
        }
        let tolerance = match balance {
            Balance::RunningMean => 0.15, // The mean of the first days is not that of all.
            Balance::Exact | Balance::AlphaOnly => 1e-9,
        };
        for hour in 0..24 {
            let time = Time::from_s(hour * 3_600);
            let difference = literal.rhythms(2).p(time) - exact.p(time);
            assert!(difference.abs() < tolerance, "{balance:?} at {hour} h");
        }
    }
}

/// A file below the datasets' root, if the root is known; says that it skips otherwise.
fn dataset(path: &str) -> Option<PathBuf> {
    if let Some(root) = std::env::var_os("CHRONOTOPE_DATA") {
        return Some(PathBuf::from(root).join(path));
    }
    eprintln!("SKIPPED: set CHRONOTOPE_DATA to the datasets' folder to test with {path}");
    None
}

/// Start and states of a series with one sample a second.
fn door(name: &str) -> Option<(Time, Vec<bool>)> {
    let path = dataset(&format!("series/door/{name}.csv.gz"))?;
    let file = std::fs::File::open(&path).expect("the door's data are there");
    let mut text = String::new();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .expect("gzip");
    let rows: Vec<(i64, bool)> = text
        .lines()
        .skip(1)
        .map(|line| {
            let (time_s, open) = line.split_once(',').expect("two columns");
            (time_s.parse().expect("seconds"), open.trim() == "1")
        })
        .collect();
    assert!(rows.windows(2).all(|w| w[1].0 == w[0].0 + 1), "uniform");
    let start = Time::from_s(rows[0].0);
    Some((start, rows.into_iter().map(|row| row.1).collect()))
}

#[test]
fn real_data_of_a_door_gives_the_numbers_of_the_paper_by_transform_and_by_sums() {
    let (Some((start, week)), Some(day7), Some(day8)) = (door("week"), door("day7"), door("day8"))
    else {
        return;
    };
    let changes = week.windows(2).filter(|w| w[0] != w[1]).count();
    println!("door: {} samples, {changes} changes", week.len());
    let mut sums = SpectralSums::new(harmonic(Period::WEEK, 500));
    for (i, &state) in week.iter().enumerate() {
        sums.add(start.plus_us(i as i64 * SECOND), state)
            .expect("fits");
    }
    let error = |p: &dyn Fn(Time) -> f64, start: Time, states: &[bool]| {
        let wrong = states
            .iter()
            .enumerate()
            .filter(|&(i, &state)| (p(start.plus_us(i as i64 * SECOND)) >= 0.5) != state);
        100.0 * wrong.count() as f64 / states.len() as f64
    };
    for (order, expected) in [
        (0, [25.8, 35.8, 26.7]),
        (1, [20.1, 11.6, 10.6]),
        (2, [13.3, 3.2, 4.7]),
        (3, [11.3, 11.1, 9.5]),
        (5, [8.5, 7.2, 18.6]),
    ] {
        let model = UniformSpectrum::build(start, second(), &week, order).expect("fits");
        let by_transform = [
            100.0 * model.estimation_error(0..week.len() as u64),
            100.0 * model.state_error(day7.0, &day7.1),
            100.0 * model.state_error(day8.0, &day8.1),
        ];
        let rhythms = sums.rhythms(order);
        let by_sums = [(start, &week), (day7.0, &day7.1), (day8.0, &day8.1)]
            .map(|(start, states)| error(&|time| rhythms.p(time), start, states));
        println!(
            "door: order {order}: transform {by_transform:.1?}, sums {by_sums:.1?}, paper {expected:?}, \
             {} transitions, lossless 1:{:.0} ({} bytes), lossy 1:{:.0} ({} bytes)",
            model.outliers().limits().len(),
            model.compression_ratio(Encoding::Lossless),
            model.to_bytes(Encoding::Lossless).len(),
            model.compression_ratio(Encoding::Lossy),
            model.to_bytes(Encoding::Lossy).len(),
        );
        for found in [by_transform, by_sums] {
            for (found, expected) in found.into_iter().zip(expected) {
                assert!(
                    (found - expected).abs() <= 0.3,
                    "order {order}: {found} {expected}"
                );
            }
        }
        let states = model.reconstruct(0..week.len() as u64);
        assert!(states.iter().zip(&week).all(|(a, b)| *a == Some(*b)));
        assert!((330..=380).contains(&model.outliers().limits().len()));
    }
}

#[test]
fn real_data_of_a_door_are_compressed_as_the_paper_says() {
    let Some((start, week)) = door("week") else {
        return;
    };
    let build = |order| UniformSpectrum::build(start, second(), &week, order).expect("fits");
    assert!(build(2).compression_ratio(Encoding::Lossless) >= 140.0);
    for (order, ratio, wrong) in [(5, 1_500.0, 0.09), (15, 500.0, 0.05)] {
        let model = build(order);
        let lossy = UniformSpectrum::from_bytes(&model.to_bytes(Encoding::Lossy)).expect("own");
        let error = lossy.state_error(start, &week);
        println!(
            "door: order {order}: lossy 1:{:.0}, {:.1} % wrong",
            model.compression_ratio(Encoding::Lossy),
            100.0 * error
        );
        assert!(model.compression_ratio(Encoding::Lossy) >= ratio);
        assert!(error < wrong);
    }
}

#[test]
fn real_data_of_a_door_have_anomalies_that_are_rare_and_at_night() {
    let (Some((start, week)), Some((start8, day8))) = (door("week"), door("day8")) else {
        return;
    };
    let model = UniformSpectrum::build(start, second(), &week, 2).expect("fits");
    for (name, start, states) in [("week", start, &week), ("day8", start8, &day8)] {
        let anomalies: Vec<_> = (0..states.len())
            .filter(|&i| model.is_anomaly(start.plus_us(i as i64 * SECOND), states[i], 0.99))
            .collect();
        println!(
            "door: {name}: {} anomalous seconds of {}",
            anomalies.len(),
            states.len()
        );
        assert!(anomalies.len() * 20 < states.len());
    }
}

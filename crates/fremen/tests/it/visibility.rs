//! Properties of the models of visibility, against a plain oracle that reads the log one
//! observation at a time.

#![allow(clippy::expect_used, reason = "a broken fixture ends the test")]
use std::f64::consts::TAU;

use fremen::spectrum::CandidatePeriods;
use fremen::time::Zone;
use fremen::visibility::{
    BeforeBirth, BitRow, FeatureState, Guards, HeldOut, HistoryLog, ModelConfig, Order, Split,
    VisibilityConfig, VisibilityModel, Visits, decode, fit, in_zone,
};
use fremen::{Period, Time};
use proptest::prelude::*;

const HOUR_US: i64 = 3_600_000_000;

fn mask(visits: &[bool]) -> BitRow {
    let mut mask = BitRow::zeros(visits.len());
    for (visit, _) in visits.iter().enumerate().filter(|(_, chosen)| **chosen) {
        mask.set(visit);
    }
    mask
}

/// One visit: its time, features born, and for every feature so far 0 not seen, 1 seen, 2 hidden.
type Row = (i64, Vec<u8>);

fn log_of(rows: &[Row]) -> HistoryLog {
    let mut log = HistoryLog::new();
    for (time_us, states) in rows {
        let mut seen = BitRow::zeros(states.len());
        let mut hidden = BitRow::zeros(states.len());
        for (feature, &state) in states.iter().enumerate() {
            match state {
                1 => seen.set(feature),
                2 => hidden.set(feature),
                _ => {}
            }
        }
        let hidden = (hidden.count_ones() > 0).then_some(hidden);
        log.push_visit(Time::from_us(*time_us), seen, hidden)
            .expect("rows grow");
    }
    log
}

/// Logs of up to 24 visits in any order of time and up to 150 features born along the way.
fn rows() -> impl Strategy<Value = Vec<Row>> {
    prop::collection::vec((0_i64..40 * 24, 0_usize..20), 0..24).prop_flat_map(|visits| {
        let mut known = 0;
        visits
            .into_iter()
            .map(|(hour, born)| {
                known += born;
                let state = prop_oneof![6 => Just(0_u8), 5 => Just(1), 1 => Just(2)];
                let time_us = 1_400_000_000_000_000 + hour * HOUR_US;
                prop::collection::vec(state, known).prop_map(move |states| (time_us, states))
            })
            .collect::<Vec<_>>()
    })
}

fn candidates() -> impl Strategy<Value = CandidatePeriods> {
    prop_oneof![
        (1_usize..15).prop_map(|k| CandidatePeriods::harmonic(Period::WEEK, k).expect("valid")),
        Just(
            CandidatePeriods::list(vec![
                Period::from_us(17 * HOUR_US + 1).expect("positive"),
                Period::DAY,
                Period::from_us(101 * HOUR_US).expect("positive"),
            ])
            .expect("valid")
        ),
    ]
}

fn before_birth() -> impl Strategy<Value = BeforeBirth> {
    prop_oneof![Just(BeforeBirth::NotSeen), Just(BeforeBirth::NotObservable)]
}

/// What the chosen visits say of one feature: times and states.
fn observations(
    log: &HistoryLog,
    feature: usize,
    chosen: &[bool],
    before_birth: BeforeBirth,
) -> Vec<(Time, f64)> {
    (0..log.num_visits())
        .filter(|&visit| chosen[visit])
        .filter_map(|visit| {
            let state = match (log.state(visit, feature), before_birth) {
                (Some(FeatureState::Seen), _) => 1.0,
                (Some(FeatureState::NotSeen), _) | (None, BeforeBirth::NotSeen) => 0.0,
                (Some(FeatureState::NotObservable), _) | (None, BeforeBirth::NotObservable) => {
                    return None;
                }
            };
            Some((log.times()[visit], state))
        })
        .collect()
}

/// `cos` and `sin` of `w_k t` from the period in seconds, one at a time.
fn oracle_phasor(period_s: f64, time: Time) -> (f64, f64) {
    let (sin, cos) = (TAU * (time.as_s() / period_s).fract()).sin_cos();
    (cos, sin)
}

/// Mean and, for every candidate, `(re g_k, im g_k)`.
fn oracle(observed: &[(Time, f64)], periods_s: &[f64]) -> (f64, Vec<(f64, f64)>) {
    let count = observed.len() as f64;
    let mean = observed.iter().map(|(_, s)| s).sum::<f64>() / count;
    let coefficients = periods_s
        .iter()
        .map(|&period_s| {
            let (mut re, mut im) = (0.0, 0.0);
            for &(time, state) in observed {
                let (cos, sin) = oracle_phasor(period_s, time);
                re += (state - mean) * cos;
                im -= (state - mean) * sin;
            }
            (re / count, im / count)
        })
        .collect();
    (mean, coefficients)
}

fn periods_s(candidates: &CandidatePeriods) -> Vec<f64> {
    (0..candidates.len())
        .map(|k| candidates.period_s(k))
        .collect()
}

fn predict_all(model: &dyn VisibilityModel, time: Time) -> Vec<f64> {
    let mut p = vec![f64::NAN; model.num_features()];
    model.predict_into(time, &mut p);
    p
}

fn fremen(candidates: &CandidatePeriods, order: usize) -> VisibilityConfig {
    VisibilityConfig::fremen(candidates.clone(), Order::Fixed(order))
}

fn fitted(
    log: &HistoryLog,
    cfg: &VisibilityConfig,
    visits: Visits<'_>,
) -> Box<dyn VisibilityModel> {
    fit(log, cfg, visits).expect("one bit a visit")
}

/// Gauss-Jordan elimination of the normal equations, the first coefficient not penalised.
fn ridge_solution(
    rows: impl Iterator<Item = (Vec<f64>, f64)>,
    size: usize,
    ridge: f64,
) -> Vec<f64> {
    let mut matrix = vec![vec![0.0; size + 1]; size];
    for (x, state) in rows {
        for i in 0..size {
            for j in 0..size {
                matrix[i][j] += x[i] * x[j];
            }
            matrix[i][size] += x[i] * state;
        }
    }
    for (i, row) in matrix.iter_mut().enumerate().skip(1) {
        row[i] += ridge;
    }
    for i in 0..size {
        let largest = (i..size).max_by(|&a, &b| matrix[a][i].abs().total_cmp(&matrix[b][i].abs()));
        matrix.swap(i, largest.expect("not empty"));
        let pivot = matrix[i].clone();
        for (_, row) in matrix.iter_mut().enumerate().filter(|(j, _)| *j != i) {
            let factor = row[i] / pivot[i];
            for (value, pivot) in row.iter_mut().zip(&pivot) {
                *value -= factor * pivot;
            }
        }
    }
    (0..size).map(|i| matrix[i][size] / matrix[i][i]).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn every_p_is_a_probability_and_one_equals_all(
        rows in rows(),
        candidates in candidates(),
        order in 0_usize..5,
        before_birth in before_birth(),
        us in any::<i64>(),
    ) {
        let log = log_of(&rows);
        let cfg = fremen(&candidates, order).with_before_birth(before_birth);
        let model = fitted(&log, &cfg, Visits::All);
        prop_assert_eq!(model.num_features(), log.num_features());
        for time in [Time::from_us(us), Time::from_us(i64::MIN), Time::from_us(i64::MAX)] {
            for (feature, p) in predict_all(&*model, time).into_iter().enumerate() {
                prop_assert!((0.0..=1.0).contains(&p), "p = {} of {}", p, feature);
                prop_assert_eq!(model.predict_one(feature, time), p);
            }
        }
    }

    #[test]
    fn order_0_is_the_mean(
        rows in rows(),
        candidates in candidates(),
        before_birth in before_birth(),
        us in any::<i64>(),
    ) {
        let log = log_of(&rows);
        let flat = fremen(&candidates, 0).with_before_birth(before_birth);
        let mean = VisibilityConfig::mean().with_before_birth(before_birth);
        let time = Time::from_us(us);
        let p = predict_all(&*fitted(&log, &flat, Visits::All), time);
        prop_assert_eq!(&p, &predict_all(&*fitted(&log, &mean, Visits::All), time));
        for (feature, p) in p.into_iter().enumerate() {
            let observed = observations(&log, feature, &vec![true; log.num_visits()], before_birth);
            let expected = if observed.is_empty() { 0.5 } else { oracle(&observed, &[]).0 };
            prop_assert!((p - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn bulk_fit_equals_the_oracle_on_any_visits(
        rows in rows(),
        candidates in candidates(),
        before_birth in before_birth(),
        chosen in prop::collection::vec(any::<bool>(), 24),
        hour in 0_i64..10_000,
    ) {
        let log = log_of(&rows);
        let chosen = &chosen[..log.num_visits()];
        let cfg = fremen(&candidates, candidates.len()).with_before_birth(before_birth);
        let mask = mask(chosen);
        let model = fitted(&log, &cfg, Visits::Only(&mask));
        let periods_s = periods_s(&candidates);
        let time = Time::from_us(hour * HOUR_US);
        let p = predict_all(&*model, time);
        for (feature, p) in p.into_iter().enumerate() {
            let observed = observations(&log, feature, chosen, before_birth);
            if observed.is_empty() {
                prop_assert_eq!(p, 0.5);
                continue;
            }
            let (mean, coefficients) = oracle(&observed, &periods_s);
            // All candidates are kept: no choice between near-equals enters.
            let mut expected = mean;
            for (&(re, im), &period_s) in coefficients.iter().zip(&periods_s) {
                let (cos, sin) = oracle_phasor(period_s, time);
                expected += 2.0 * (re * cos - im * sin);
            }
            prop_assert!((p - expected.clamp(0.0, 1.0)).abs() < 1e-6, "{} {}", p, expected);
            // And the components are the strongest first, with the amplitudes of the oracle.
            let amplitudes: Vec<_> = model.components(feature).iter().map(|c| c.amplitude).collect();
            prop_assert!(amplitudes.windows(2).all(|w| w[0] >= w[1] * (1.0 - 1e-8)));
            let mut expected: Vec<_> = coefficients.iter().map(|c| 2.0 * c.0.hypot(c.1)).collect();
            expected.sort_by(|a, b| b.total_cmp(a));
            for (amplitude, expected) in amplitudes.iter().zip(expected) {
                prop_assert!((amplitude - expected).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn fitting_some_visits_is_fitting_a_log_of_only_these(
        rows in rows(),
        candidates in candidates(),
        order in 0_usize..4,
        before_birth in before_birth(),
        chosen in prop::collection::vec(any::<bool>(), 24),
        held_out in any::<bool>(),
        hour in 0_i64..10_000,
    ) {
        let log = log_of(&rows);
        let chosen = &chosen[..log.num_visits()];
        let kept: Vec<_> = rows.iter().zip(chosen).filter(|(_, c)| **c).map(|(r, _)| r.clone()).collect();
        let order = if held_out {
            Order::HeldOut(HeldOut::new(order, Split::Folds(3)).expect("valid"))
        } else {
            Order::Fixed(order)
        };
        let cfg = VisibilityConfig::fremen(candidates, order).with_before_birth(before_birth);
        let mask = mask(chosen);
        let time = Time::from_us(hour * HOUR_US);
        let some = predict_all(&*fitted(&log, &cfg, Visits::Only(&mask)), time);
        let only = predict_all(&*fitted(&log_of(&kept), &cfg, Visits::All), time);
        prop_assert_eq!(&some[..only.len()], &only[..]);
    }

    #[test]
    fn least_squares_from_sums_equals_least_squares_on_the_log(
        rows in rows(),
        before_birth in before_birth(),
        harmonics in prop::sample::subsequence(vec![1_u16, 2, 3, 7, 11], 0..5),
        ridge in 0.01_f64..3.0,
        hour in 0_i64..10_000,
    ) {
        let log = log_of(&rows);
        let cfg = VisibilityConfig::new(ModelConfig::LeastSquares {
            candidates: CandidatePeriods::harmonic(Period::WEEK, 11).expect("valid"),
            order: HeldOut::default(),
            harmonics: Some(harmonics.clone()),
            ridge,
        });
        let cfg = cfg.expect("valid").with_before_birth(before_birth);
        let model = fitted(&log, &cfg, Visits::All);
        let time = Time::from_us(hour * HOUR_US);
        let row = |time| {
            let mut row = vec![1.0];
            for &harmonic in &harmonics {
                let (cos, sin) = oracle_phasor(Period::WEEK.as_s() / f64::from(harmonic), time);
                row.extend([cos, sin]);
            }
            row
        };
        for feature in 0..log.num_features() {
            let observed = observations(&log, feature, &vec![true; log.num_visits()], before_birth);
            let expected = if observed.is_empty() {
                0.5
            } else {
                let rows = observed.iter().map(|&(time, state)| (row(time), state));
                let solution = ridge_solution(rows, 1 + 2 * harmonics.len(), ridge);
                row(time).iter().zip(solution).map(|(x, b)| x * b).sum()
            };
            let p = model.predict_one(feature, time);
            prop_assert!((p - expected.clamp(0.0, 1.0)).abs() < 1e-5, "{} {}", p, expected);
        }
    }

    #[test]
    fn shifting_all_times_shifts_the_prediction(
        rows in rows(),
        candidates in candidates(),
        before_birth in before_birth(),
        shift in -1_000_000_000_000_i64..1_000_000_000_000,
        hour in 0_i64..10_000,
    ) {
        let shifted: Vec<_> = rows.iter().map(|(us, s)| (us + shift, s.clone())).collect();
        // With all candidates kept no choice between near-equals enters.
        let cfg = fremen(&candidates, candidates.len()).with_before_birth(before_birth);
        let time = Time::from_us(hour * HOUR_US);
        let there = predict_all(&*fitted(&log_of(&rows), &cfg, Visits::All), time);
        let then = time.plus_us(shift);
        let here = predict_all(&*fitted(&log_of(&shifted), &cfg, Visits::All), then);
        for (a, b) in there.iter().zip(&here) {
            prop_assert!((a - b).abs() < 1e-9, "{} {}", a, b);
        }
    }

    #[test]
    fn the_order_of_arrival_is_of_no_importance_when_all_features_are_known(
        hours in prop::collection::vec(0_i64..900, 2..20),
        seed in any::<u64>(),
        candidates in candidates(),
    ) {
        let rows: Vec<_> = hours
            .iter()
            .enumerate()
            .map(|(i, h)| (h * HOUR_US, (0..64).map(|f| (seed >> ((f + 7 * i) % 64) & 1) as u8).collect()))
            .collect::<Vec<Row>>();
        let backwards: Vec<_> = rows.iter().rev().cloned().collect();
        let cfg = fremen(&candidates, candidates.len());
        let time = Time::from_us(12_345 * HOUR_US);
        let a = predict_all(&*fitted(&log_of(&rows), &cfg, Visits::All), time);
        let b = predict_all(&*fitted(&log_of(&backwards), &cfg, Visits::All), time);
        for (a, b) in a.iter().zip(&b) {
            prop_assert!((a - b).abs() < 1e-9);
        }
    }
}

/// `count` hourly visits of one feature that is seen in the first half of every day.
fn daily(count: i64) -> Vec<Row> {
    (0..count)
        .map(|hour| (hour * HOUR_US, vec![u8::from(hour % 24 < 12)]))
        .collect()
}

#[test]
fn a_daily_rhythm_is_found_with_its_amplitude_and_phase() {
    let candidates = CandidatePeriods::harmonic(Period::WEEK, 20).expect("valid");
    let log = log_of(&daily(14 * 24));
    let model = fitted(&log, &fremen(&candidates, 1), Visits::All);
    let components = model.components(0);
    assert_eq!(components.len(), 1);
    assert_eq!(components[0].period_s, 86_400.0);
    // A square wave's first harmonic has amplitude 2 / pi; sampling hourly changes it by 0.3 %.
    assert!((components[0].amplitude - 0.637).abs() < 0.003);
    let noon = model.predict_one(0, Time::from_us(1_000_000 * 24 * HOUR_US + 6 * HOUR_US));
    assert!(noon > 0.99, "{noon}");
}

#[test]
fn a_held_out_order_finds_the_rhythm_and_refuses_noise() {
    let candidates = CandidatePeriods::harmonic(Period::WEEK, 20).expect("valid");
    let order = Order::HeldOut(HeldOut::default());
    let cfg = VisibilityConfig::fremen(candidates, order);
    assert!(fitted(&log_of(&daily(14 * 24)), &cfg, Visits::All).order() >= 1);
    // Too few visits to judge.
    assert_eq!(fitted(&log_of(&daily(7)), &cfg, Visits::All).order(), 0);
    // Coin tosses of 128 features at 20 visits.
    let tosses: Vec<Row> = (0..20)
        .map(|visit: u64| {
            let word = (visit + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let states = (0..128).map(|f| (word.rotate_left(f).wrapping_mul(word | 1) >> 63) as u8);
            (visit as i64 * 7 * HOUR_US, states.collect())
        })
        .collect();
    assert_eq!(fitted(&log_of(&tosses), &cfg, Visits::All).order(), 0);
}

#[test]
fn guards_drop_what_the_visits_cannot_support() {
    let candidates = CandidatePeriods::list(vec![
        Period::WEEK,
        Period::DAY,
        Period::from_us(HOUR_US).expect("positive"),
    ])
    .expect("valid");
    let rows: Vec<Row> = daily(3 * 24)
        .into_iter()
        .map(|(us, _)| (us, vec![u8::from(us / HOUR_US % 5 == 0)]))
        .collect();
    let cfg = fremen(&candidates, 3).with_guards(Some(Guards::default()));
    let model = fitted(&log_of(&rows), &cfg, Visits::All);
    let periods: Vec<_> = model.components(0).iter().map(|c| c.period_s).collect();
    assert_eq!(
        periods,
        [86_400.0],
        "three hourly days support only the day"
    );
}

#[test]
fn thin_histories_have_defined_answers() {
    let candidates = CandidatePeriods::harmonic(Period::DAY, 12).expect("valid");
    let far = Time::from_us(i64::MAX);
    for before_birth in [BeforeBirth::NotSeen, BeforeBirth::NotObservable] {
        let cfg = fremen(&candidates, 2).with_before_birth(before_birth);
        let all = |rows: &[Row]| predict_all(&*fitted(&log_of(rows), &cfg, Visits::All), far);
        assert_eq!(all(&[]), [0.0; 0], "no visit");
        assert_eq!(all(&[(5, vec![1, 0])]), [1.0, 0.0], "one visit");
        let same = [(5, vec![1, 0, 1]), (5, vec![1, 0, 0]), (5, vec![1, 0, 0])];
        let p = all(&same);
        assert_eq!(p[..2], [1.0, 0.0], "all seen, never seen");
        assert!((p[2] - 1.0 / 3.0).abs() < 1e-12, "equal times: the mean");
    }
    let log = log_of(&[(5, vec![1, 0]), (6, vec![1, 2])]);
    let none = mask(&[false, false]);
    let model = fitted(&log, &fremen(&candidates, 2), Visits::Only(&none));
    assert_eq!(predict_all(&*model, far), [0.5, 0.5], "no visit chosen");
    let strict = fremen(&candidates, 2).with_before_birth(BeforeBirth::NotObservable);
    let second = mask(&[false, true]);
    let model = fitted(&log, &strict, Visits::Only(&second));
    assert_eq!(
        predict_all(&*model, far),
        [1.0, 0.5],
        "hidden whenever looked for"
    );
}

#[test]
fn more_candidates_than_visits_are_defined() {
    let log = log_of(&daily(6));
    for candidates in [
        CandidatePeriods::harmonic(Period::YEAR, 3_000).expect("valid"),
        CandidatePeriods::harmonic(Period::from_us(2_000).expect("positive"), 900).expect("valid"),
    ] {
        for order in [0, 1, 7, 5_000] {
            let model = fitted(&log, &fremen(&candidates, order), Visits::All);
            assert!(model.order() <= candidates.len());
            for hour in [-5, 3, 1_000_000] {
                let p = model.predict_one(0, Time::from_us(hour * HOUR_US));
                assert!((0.0..=1.0).contains(&p), "order {order} at {hour} h: {p}");
            }
        }
    }
}

/// `num` visits every so many hours, of features of which each is seen as `is_seen(feature, hour)`
/// says.
fn visits(num: i64, every_h: i64, is_seen: impl Fn(u64, i64) -> bool) -> Vec<Row> {
    (0..num)
        .map(|i| {
            let hour = i * every_h;
            (
                hour * HOUR_US,
                (0..20).map(|f| u8::from(is_seen(f, hour))).collect(),
            )
        })
        .collect()
}

fn coin(feature: u64, hour: i64) -> u64 {
    let z = (feature * 1_000_003 + hour as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z ^ (z >> 31)
}

#[test]
fn natural_rhythms_are_found_where_days_confirm_them_and_refused_where_not() {
    let natural = VisibilityConfig::natural();
    // A day, wrong once in five, from visits every 5 hours.
    let daily = |f, hour: i64| (hour.rem_euclid(24) < 12) != coin(f, hour).is_multiple_of(5);
    let model = fitted(&log_of(&visits(200, 5, daily)), &natural, Visits::All);
    assert!(model.order() >= 1);
    let strongest = model.components(3)[0];
    assert_eq!(strongest.period_s, 86_400.0);
    assert!((0.25..0.6).contains(&strongest.amplitude), "{strongest:?}");
    let p = |hour: i64| model.predict_one(3, Time::from_us(hour * HOUR_US));
    assert!(p(24 * 1_000 + 6) > 0.7 && p(24 * 1_000 + 18) < 0.3);
    // Coins, thrown for each feature, and for all together.
    for shared in [false, true] {
        let toss = |f, hour| coin(if shared { 0 } else { f }, hour).is_multiple_of(2);
        let log = log_of(&visits(200, 5, toss));
        assert_eq!(
            fitted(&log, &natural, Visits::All).order(),
            0,
            "shared: {shared}"
        );
    }
    // A state that keeps for days is no rhythm.
    let slow = |_, hour: i64| coin(0, hour / 60).is_multiple_of(2);
    assert_eq!(
        fitted(&log_of(&visits(300, 2, slow)), &natural, Visits::All).order(),
        0
    );
    // Two days are too few to leave one out, seven visits too few for anything.
    for (num, every_h) in [(24, 2), (7, 24)] {
        let log = log_of(&visits(num, every_h, |_, hour| hour % 24 < 12));
        assert_eq!(fitted(&log, &natural, Visits::All).order(), 0);
    }
}

#[test]
fn natural_rhythms_stay_calm_at_hours_that_were_never_seen() {
    // Five days from 8 to 18 h, seen more often about noon than at the ends, every ten minutes.
    let rows: Vec<Row> = (0..5 * 60)
        .map(|i| {
            let (day, tenth) = (i / 60, i % 60);
            let from_noon = (tenth - 30_i64).unsigned_abs();
            let seen = coin(day as u64, tenth / 6) % 40 > from_noon;
            let us = (day * 24 + 8) * HOUR_US + tenth * HOUR_US / 6;
            (us, vec![u8::from(seen)])
        })
        .collect();
    let log = log_of(&rows);
    let mean = fitted(&log, &VisibilityConfig::mean(), Visits::All).predict_one(0, Time::default());
    let model = fitted(&log, &VisibilityConfig::natural(), Visits::All);
    for hour in 0..24 {
        let p = model.predict_one(0, Time::from_us((7 * 24 + hour) * HOUR_US));
        assert!(
            p > 0.0 && p < 1.0 && p < mean + 0.35,
            "{p} at {hour} h, mean {mean}"
        );
    }
}

#[test]
fn one_thread_and_many_learn_the_same_bits() {
    let rows = visits(120, 7, |f, hour| {
        (hour + f as i64) % 24 < 11 || coin(f, hour).is_multiple_of(7)
    });
    let log = log_of(&rows);
    let candidates = CandidatePeriods::harmonic(Period::WEEK, 60).expect("valid");
    let configs = [
        VisibilityConfig::natural(),
        fremen(&candidates, 2),
        VisibilityConfig::rhythms(),
    ];
    let learn = || -> Vec<u64> {
        let models = configs.iter().map(|cfg| fitted(&log, cfg, Visits::All));
        models
            .flat_map(|model| predict_all(&*model, Time::from_us(1_234_567 * HOUR_US / 10)))
            .map(f64::to_bits)
            .collect()
    };
    let alone = learn();
    std::thread::scope(|scope| {
        let others: Vec<_> = (0..4).map(|_| scope.spawn(learn)).collect();
        for other in others {
            assert_eq!(other.join().expect("no panic"), alone);
        }
    });
}

#[test]
fn a_selection_of_another_length_is_refused() {
    let log = log_of(&daily(3));
    let error = fit(
        &log,
        &VisibilityConfig::mean(),
        Visits::Only(&mask(&[true])),
    )
    .expect_err("one bit for three visits");
    assert_eq!(error.kind(), fremen::ErrorKind::Shape);
}

/// An office of 9 to 17 h by the clocks of Prague, looked at every half hour from `start` on.
fn office(start: &str, num_days: i64) -> HistoryLog {
    let zone = Zone::new("Europe/Prague").expect("known");
    let start = Time::parse(start).expect("a time");
    let mut log = HistoryLog::new();
    for half_hour in 0..num_days * 48 {
        let time = start.plus_us(half_hour * HOUR_US / 2);
        let us_of_day = zone.wall(time).as_us().rem_euclid(24 * HOUR_US);
        let mut seen = BitRow::zeros(1);
        if (9 * HOUR_US..17 * HOUR_US).contains(&us_of_day) {
            seen.set(0);
        }
        log.push_visit(time, seen, None).expect("rows grow");
    }
    log
}

#[test]
fn an_office_keeps_its_hours_when_clocks_change() {
    let zone = Zone::new("Europe/Prague").expect("known");
    // Over the end of summer time, and over its beginning; a month later at 16:30 and 8:30 there.
    for (start, open, closed) in [
        (
            "2024-08-01T00:00:00Z",
            "2024-11-25T15:30:00Z",
            "2024-11-25T07:30:00Z",
        ),
        (
            "2024-01-08T00:00:00Z",
            "2024-04-29T14:30:00Z",
            "2024-04-29T06:30:00Z",
        ),
    ] {
        let log = office(start, 96);
        for cfg in [
            VisibilityConfig::natural(),
            VisibilityConfig::fremen(
                CandidatePeriods::harmonic(Period::DAY, 6).expect("periods"),
                Order::Fixed(2),
            ),
        ] {
            let fit = |log: &HistoryLog| fit(log, &cfg, Visits::All);
            let model = in_zone(Some(&zone), &log, fit).expect("fits");
            let p = |model: &dyn VisibilityModel, at: &str| {
                model.predict_one(0, Time::parse(at).expect("a time"))
            };
            assert!(p(&*model, open) > 0.5, "{start}: {}", p(&*model, open));
            assert!(p(&*model, closed) < 0.5, "{start}: {}", p(&*model, closed));
            // Bytes keep the clocks.
            let again = decode(&model.encode().expect("has bytes")).expect("whole");
            for at in [open, closed] {
                assert_eq!(p(&*again, at).to_bits(), p(&*model, at).to_bits());
            }
            let without = in_zone(None, &log, fit).expect("fits");
            assert_eq!(
                without.encode(),
                fit(&log).expect("fits").encode(),
                "without a zone nothing is added"
            );
        }
    }
}

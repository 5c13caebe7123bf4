//! Every model of visibility over every log of `tests/data/visibility.toml`.

#![allow(clippy::expect_used, reason = "a broken fixture ends the test")]

use fremen::visibility::{
    BitRow, HistoryLog, VisibilityConfig, VisibilityModel, Visits, decode, fit,
};
use fremen::{ErrorKind, Time};
use serde::Deserialize;

const HOUR_US: i64 = 3_600_000_000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Suite {
    model: Vec<Model>,
    log: Vec<Log>,
    case: Vec<Case>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Model {
    name: String,
    claims: Vec<Claim>,
    config: VisibilityConfig,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum Claim {
    Constant,
    ForgetsOrder,
    Shifts,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Log {
    name: String,
    visits: Vec<(i64, String)>,
    #[serde(default)]
    repeat: i64,
    #[serde(default)]
    repeat_h: i64,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Case {
    log: String,
    #[serde(default)]
    models: Vec<String>,
    #[serde(default)]
    except: Vec<String>,
    at_h: Vec<i64>,
    feature: usize,
    p: f64,
    #[serde(default = "tight")]
    within: f64,
}

fn tight() -> f64 {
    1e-9
}

fn suite() -> Suite {
    toml::from_str(include_str!("../data/visibility.toml")).expect("the suite reads")
}

impl Log {
    /// Hours and states of all visits, repeats included.
    fn rows(&self) -> Vec<(i64, &str)> {
        (0..=self.repeat)
            .flat_map(|i| {
                let visits = self.visits.iter();
                visits.map(move |(hour, states)| (hour + i * self.repeat_h, states.as_str()))
            })
            .collect()
    }
}

fn history(rows: &[(i64, &str)], shift_us: i64) -> HistoryLog {
    let mut log = HistoryLog::new();
    for (hour, states) in rows {
        // A row shorter than one before it says nothing of the features it leaves out.
        let len = states.len().max(log.num_features());
        let mut seen = BitRow::zeros(len);
        let mut hidden = BitRow::zeros(len);
        let states = states.bytes().chain(std::iter::repeat(b'-')).take(len);
        for (feature, state) in states.enumerate() {
            match state {
                b'1' => seen.set(feature),
                b'-' => hidden.set(feature),
                _ => {}
            }
        }
        let time = Time::from_us(hour * HOUR_US + shift_us);
        log.push_visit(time, seen, Some(hidden)).expect("rows grow");
    }
    log
}

fn all_at(model: &dyn VisibilityModel, time: Time) -> Vec<f64> {
    let mut p = vec![f64::NAN; model.num_features()];
    model.predict_into(time, &mut p);
    p
}

fn assert_close(a: &[f64], b: &[f64], what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() < 1e-7, "{what}: {a} and {b}");
    }
}

#[test]
fn every_model_keeps_its_promises_on_every_log() {
    let suite = suite();
    for log in &suite.log {
        let rows = log.rows();
        let history = history(&rows, 0);
        let last_h = rows.iter().map(|row| row.0).max().unwrap_or(0);
        for model in &suite.model {
            let what = format!("{} on {}", model.name, log.name);
            let fitted = fit(&history, &model.config, Visits::All).expect("all visits");
            assert_eq!(fitted.num_features(), history.num_features(), "{what}");
            let mut every = BitRow::zeros(history.num_visits());
            (0..history.num_visits()).for_each(|visit| every.set(visit));
            let named = fit(&history, &model.config, Visits::Only(&every)).expect("all visits");

            let hours = [
                -1_000_003,
                -7,
                0,
                5,
                11,
                last_h,
                last_h + 1,
                last_h + 100_000,
            ];
            let far = [i64::MIN, i64::MAX].map(Time::from_us);
            let times = hours.map(|hour| Time::from_us(hour * HOUR_US + 1_234_567));
            for &time in times.iter().chain(&far) {
                let p = all_at(&*fitted, time);
                assert!(
                    p.iter().all(|p| (0.0..=1.0).contains(p)),
                    "{what} at {time}: {p:?}"
                );
                for (feature, &p) in p.iter().enumerate() {
                    assert_eq!(fitted.predict_one(feature, time), p, "{what} at {time}");
                    assert!(fitted.components(feature).len() <= fitted.order(), "{what}");
                }
                assert_eq!(
                    all_at(&*named, time),
                    p,
                    "{what} at {time}: all visits by name"
                );
            }
            for claim in &model.claims {
                keeps_claim(*claim, model, &rows, &*fitted, &times, &what);
            }
        }
    }
}

fn keeps_claim(
    claim: Claim,
    model: &Model,
    rows: &[(i64, &str)],
    fitted: &dyn VisibilityModel,
    times: &[Time],
    what: &str,
) {
    let refit = |rows: &[(i64, &str)], shift_us| {
        fit(&history(rows, shift_us), &model.config, Visits::All).expect("all visits")
    };
    match claim {
        Claim::Constant => {
            for &time in times {
                assert_eq!(all_at(fitted, time), all_at(fitted, times[0]), "{what}");
            }
        }
        Claim::ForgetsOrder => {
            // Reversing a log in which features are born would change who is born when.
            if rows.iter().any(|row| row.1.len() != rows[0].1.len()) {
                return;
            }
            let reversed: Vec<_> = rows.iter().rev().copied().collect();
            let backwards = refit(&reversed, 0);
            for &time in times {
                assert_close(&all_at(fitted, time), &all_at(&*backwards, time), what);
            }
        }
        Claim::Shifts => {
            let shift_us = 5 * HOUR_US + 17_000_001;
            let shifted = refit(rows, shift_us);
            for &time in times {
                let later = all_at(&*shifted, time.plus_us(shift_us));
                assert_close(&all_at(fitted, time), &later, what);
            }
        }
    }
}

#[test]
fn every_case_has_its_answer() {
    let suite = suite();
    let mut num_answers = 0;
    for case in &suite.case {
        let log = suite.log.iter().find(|log| log.name == case.log);
        let history = history(&log.expect("a log of that name").rows(), 0);
        for name in case.models.iter().chain(&case.except) {
            assert!(
                suite.model.iter().any(|model| model.name == *name),
                "{name}"
            );
        }
        for model in &suite.model {
            let named = case.models.is_empty() || case.models.contains(&model.name);
            if !named || case.except.contains(&model.name) {
                continue;
            }
            let fitted = fit(&history, &model.config, Visits::All).expect("all visits");
            for &hour in &case.at_h {
                let p = fitted.predict_one(case.feature, Time::from_us(hour * HOUR_US));
                assert!(
                    (p - case.p).abs() <= case.within + 1e-12,
                    "{} on {}: p = {p} at {hour} h, not {}",
                    model.name,
                    case.log,
                    case.p
                );
                num_answers += 1;
            }
        }
    }
    assert!(num_answers > 60, "{num_answers}");
}

#[test]
fn configs_give_back_their_text_and_refuse_nonsense() {
    for model in suite().model {
        let text = toml::to_string(&model.config).expect("serialises");
        let read = VisibilityConfig::from_toml(&text).expect("own text");
        assert_eq!(read, model.config, "{text}");
    }
    for text in [
        "model = { kind = 'least-squares', candidates = { periods-s = [60.0] } }",
        "model = { kind = 'least-squares', candidates = { base-s = 60.0, count = 2 }, ridge = 0.0 }",
        "model = { kind = 'logistic', candidates = { base-s = 60.0, count = 60000 } }",
        "model = { kind = 'logistic', candidates = { base-s = 60.0, count = 6 }, harmonics = [7] }",
        "model = { kind = 'logistic', candidates = { base-s = 60.0, count = 6 }, harmonics = [2, 2] }",
        "model = { kind = 'histogram', period-s = 0.0, num-bins = 3 }",
        "model = { kind = 'histogram', period-s = 60.0, num-bins = 0 }",
        "model = { kind = 'histogram', period-s = 60.0, num-bins = 3, prior = -1.0 }",
        "model = { kind = 'pergam', period-s = 60.0, num-bins = 3, order = 0 }",
        "model = { kind = 'persistent', of = { kind = 'pergam', period-s = 60.0, num-bins = 3, order = 0 } }",
        "model = { kind = 'markov', tau = 3 }",
    ] {
        let error = VisibilityConfig::from_toml(text).expect_err(text);
        assert_eq!(error.kind(), ErrorKind::Config, "{text}");
    }
}

#[test]
fn every_model_comes_back_from_its_bytes_bit_for_bit() {
    let suite = suite();
    let mut num_models = 0;
    for log in &suite.log {
        let history = history(&log.rows(), 0);
        for model in &suite.model {
            let what = format!("{} on {}", model.name, log.name);
            let fitted = fit(&history, &model.config, Visits::All).expect("all visits");
            let bytes = fitted.encode().expect("every model here has bytes");
            let decoded = decode(&bytes).expect("own bytes");
            assert_eq!(decoded.encode().as_ref(), Some(&bytes), "{what}");
            assert_eq!(decoded.num_features(), fitted.num_features(), "{what}");
            assert_eq!(decoded.order(), fitted.order(), "{what}");
            for hour in [-1_000_003, -7, 0, 5, 11, 100_000] {
                let time = Time::from_us(hour * HOUR_US);
                assert_eq!(
                    all_at(&*decoded, time),
                    all_at(&*fitted, time),
                    "{what} at hour {hour}"
                );
            }
            for feature in 0..fitted.num_features() {
                assert_eq!(decoded.level(feature), fitted.level(feature), "{what}");
                assert_eq!(decoded.components(feature), fitted.components(feature));
            }
            num_models += 1;
        }
    }
    assert!(num_models > 100, "only {num_models} models were fitted");
}

/// Damage is named by the checksum; behind a right checksum, any bytes are a model or an error.
#[test]
fn bytes_that_are_no_model_are_refused() {
    let suite = suite();
    for model in &suite.model {
        let history = history(&suite.log[0].rows(), 0);
        let fitted = fit(&history, &model.config, Visits::All).expect("all visits");
        let bytes = fitted.encode().expect("every model here has bytes");
        for at in 0..bytes.len() {
            assert!(decode(&bytes[..at]).is_err(), "{} cut at {at}", model.name);
            let mut flipped = bytes.clone();
            flipped[at] ^= 0x41;
            let error = decode(&flipped).expect_err(&model.name);
            assert!(matches!(
                error.kind(),
                ErrorKind::Checksum | ErrorKind::Format
            ));
            // The same with a checksum that fits: whatever it is, it predicts or is refused.
            let body = bytes.len() - 4;
            if at < body {
                let crc = crc32fast::hash(&flipped[..body]);
                flipped[body..].copy_from_slice(&crc.to_le_bytes());
                if let Ok(model) = decode(&flipped) {
                    let p = all_at(&*model, Time::from_s(12_345));
                    assert!(p.iter().all(|p| (0.0..=1.0).contains(p)), "{p:?}");
                }
            }
        }
    }
    assert_eq!(decode(&[]).expect_err("empty").kind(), ErrorKind::Format);
}

/// Thousands of models round each other would overflow the stack.
#[test]
fn models_round_models_are_bounded() {
    let history = history(&[(0, "1"), (1, "0")], 0);
    let mut config = "model = { kind = 'mean' }".to_owned();
    for depth in 0..20 {
        config = config.replacen("model = ", "model = { kind = 'persistent', of = ", 1) + " }";
        let cfg = VisibilityConfig::from_toml(&config).expect("a model");
        let fitted = fit(&history, &cfg, Visits::All).expect("all visits");
        let bytes = fitted.encode().expect("persistent round a mean");
        assert_eq!(decode(&bytes).is_ok(), depth < 8, "depth {depth}");
    }
}

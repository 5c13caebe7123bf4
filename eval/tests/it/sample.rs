//! A made-up run that looks like a real one: six places, sixty queries, every method.

#![allow(
    clippy::unwrap_used,
    reason = "a helper of tests; clippy only knows their functions"
)]

use std::collections::BTreeMap;

use chronotope_eval::judge::judge_all;
use chronotope_eval::judge::rates::Tally;
use chronotope_eval::judge::statistics::Sample;
use chronotope_eval::results::{
    Answer, Decision, LeakCheck, OFF_MAP, Query, Reobservation, RowKey, StageLatency, SuiteResults,
    Variant,
};

/// Numbers of features per place of every suite.
pub(crate) const ALL_N: [u32; 13] = [5, 10, 15, 20, 25, 30, 40, 50, 75, 100, 150, 200, 300];

/// Keys of places.
pub(crate) const PLACES: [&str; 6] = ["bridge", "gate", "meadow", "orchard", "pond", "tower"];

const NUM_QUERIES: usize = 60;

/// One made-up method.
struct Made {
    /// preset/method/model/score/order.
    variant: &'static str,
    /// Share of wrong answers at n = 10.
    wrong_at_10: f64,
    /// Features seen again, %.
    reobserved: f64,
    /// Appearances compared per place.
    experiences: f64,
}

const fn made(variant: &'static str, wrong_at_10: f64, reobserved: f64, experiences: f64) -> Made {
    Made {
        variant,
        wrong_at_10,
        reobserved,
        experiences,
    }
}

const METHODS: [Made; 14] = [
    made("lttl/static/mean/count/0", 0.55, 40.0, 1.0),
    made("lttl/fremen/harmonics/count/1", 0.42, 47.0, 1.0),
    made("lttl/fremen/harmonics/count/2", 0.46, 46.0, 1.0),
    made("lttl/fremen/annual/count/1", 0.35, 52.0, 1.0),
    made("lttl/experience/none/count/0", 0.4, 44.0, 4.0),
    made("lttl/experience-all/none/count/0", 0.25, 48.0, 11.0),
    made("lttl/freex/annual/count/1", 0.3, 50.0, 5.0),
    made("default/static/mean/inliers/0", 0.4, 40.0, 1.0),
    made("default/fremen/annual/inliers/1", 0.26, 52.0, 1.0),
    made("default/experience-all/none/inliers/0", 0.18, 48.0, 11.0),
    made("default/static/mean/likelihood/0", 0.3, 40.0, 1.0),
    made("default/fremen/pooled/likelihood/auto", 0.14, 54.0, 1.0),
    made("default/experience-all/none/likelihood/0", 0.16, 48.0, 11.0),
    made("default/fused/pooled/likelihood/auto", 0.1, 54.0, 3.0),
];

/// Uniform in 0..1, the same for the same words.
pub(crate) fn chance(words: &[&str]) -> f64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in words.join("/").bytes() {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
    hash ^= hash >> 31;
    hash = hash.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}

impl Made {
    fn at(&self, n: u32) -> RowKey {
        format!("{}/{n}", self.variant).parse().unwrap()
    }

    fn answer(&self, query: usize, truth: &str, n: u32) -> Answer {
        let (query, name) = (query.to_string(), self.variant);
        // Hard images are hard for everybody: most of the luck belongs to the query.
        let luck =
            0.8 * chance(&["hard", &query]) + 0.2 * chance(&["luck", &query, name, &n.to_string()]);
        let threshold = 0.04 + 1.25 * self.wrong_at_10 * (10.0 / f64::from(n)).powf(0.4);
        let other = PLACES[(PLACES.len() as f64 * chance(&["other", &query])) as usize];
        let first = if luck < threshold { other } else { truth };
        let is_tied = self.variant.contains("count")
            && n <= 20
            && other != truth
            && chance(&["tie", &query, name]) < 0.08;
        let sure = 0.5 + 0.49 * chance(&["sure", &query, name]);
        let mut posterior = BTreeMap::new();
        if self.variant.contains("likelihood") {
            posterior.insert(first.to_owned(), sure);
            posterior.insert(OFF_MAP.to_owned(), 1.0 - sure);
        }
        Answer {
            first: Some(first.to_owned()),
            decision: if !posterior.is_empty() && sure < 0.55 {
                Decision::Unknown
            } else {
                Decision::At(first.to_owned())
            },
            posterior,
            ties: if is_tied {
                vec![other.to_owned(), truth.to_owned()]
            } else {
                Vec::new()
            },
        }
    }
}

/// The run.
pub(crate) fn sample_results() -> SuiteResults {
    let mut results = SuiteResults::new("sample", "Made-up park, one image a place and month");
    results.dataset_sha256 = "9f2c".repeat(16);
    results.commit = "0123abcd".into();
    results.machine = "2-core x86-64 with AVX2, 1 thread".into();
    results.command = "chronotope-eval run sample --data DIR --out target/sample".into();
    results.clock = "UTC, one visit a month".into();
    results.split = "each visit is queried once, the other eleven are learnt".into();
    results.num_places = Some(PLACES.len() as u32);
    results.num_learnt_images = Some(66);
    results.num_broken_images = Some(1);
    results.leak_check = Some(LeakCheck {
        num_checked: 72,
        num_removed: 0,
        note: String::new(),
    });
    results
        .notes
        .push("made up to test the report <and its escaping>".into());

    let variants = METHODS.map(|made| made.at(ALL_N[0]).variant);
    for i in 0..NUM_QUERIES {
        let truth = PLACES[i % PLACES.len()];
        let mut answers = BTreeMap::new();
        for made in &METHODS {
            for n in ALL_N {
                answers.insert(made.at(n).to_string(), made.answer(i, truth, n));
            }
        }
        results.queries.push(Query {
            id: format!("{truth}/{:02}.jpg", i / PLACES.len() + 1),
            truth: Some(truth.to_owned()),
            near: Vec::new(),
            group: None,
            answers,
        });
    }
    for (made, variant) in METHODS.iter().zip(&variants) {
        for n in ALL_N {
            let may_be_unknown = variant.score == "likelihood";
            let tally = Tally::of(&results.queries, &variant.at(n), may_be_unknown);
            let mut row = tally.into_row(&variant.at(n), variant.method == "fused");
            row.reobserved = Some(made.reobserved - f64::from(n) / 30.0);
            row.pairs_compared = 500.0 * PLACES.len() as f64 * f64::from(n) * made.experiences;
            row.ms_p50 = 0.05 + row.pairs_compared * 1.1e-6;
            row.ms_p99 = row.ms_p50 * 1.7;
            results.rows.push(row);
        }
    }
    for (made, variant) in METHODS.iter().zip(variants) {
        if variant.score == "inliers" || variant.score == "likelihood" && variant.method != "fused"
        {
            continue;
        }
        let spread = |query: usize| 0.3 * (chance(&[made.variant, &query.to_string()]) - 0.5);
        let sample = Sample::new((0..NUM_QUERIES).map(|i| made.reobserved / 100.0 + spread(i)));
        let rate = sample.rate().scaled(100.0);
        results.reobservation.push(Reobservation {
            variant: Variant {
                score: String::new(),
                ..variant
            },
            top: 10,
            percent: rate.mean,
            ci_low: rate.interval.low,
            ci_high: rate.interval.high,
        });
    }
    for (of, scale) in [("lttl, n = 50", 1.0), ("default, n = 50", 1.3)] {
        for (stage, ms) in [
            ("extract", 9.1),
            ("predict", 0.2),
            ("match", 0.8),
            ("verify", 0.3),
            ("score", 0.1),
        ] {
            results.latency.push(StageLatency {
                of: of.into(),
                stage: stage.into(),
                ms_p50: ms * scale,
                ms_p99: ms * scale * 1.6,
            });
        }
    }
    results.judgement = judge_all(&results, &[]);
    results
}

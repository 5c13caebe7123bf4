//! How fast are temporal models learnt and asked, next to the same sums written plainly?
//!
//! The plain twin takes a cosine and a sine per state, component and observation, as the reference
//! implementation of the papers does, compiled with the same optimisation and run in the same process on
//! one thread. Every comparison first checks that both sides computed the same. Times are of processor time
//! where the system tells it, so that a busy machine disturbs little; compare ratios only.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Instant;

use anyhow::{Result, ensure};
use chronotope::spectrum::{CandidatePeriods, UniformSpectrum};
use chronotope::visibility::{
    BitRow, HistoryLog, Order, VisibilityConfig, VisibilityModel, Visits, fit,
};
use chronotope::{Period, Time};
use serde::Serialize;

/// One comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// What is done.
    pub name: String,
    /// What it costs us.
    pub ours: f64,
    /// What it costs the twin; none where a number stands alone.
    pub twin: Option<f64>,
    /// Twin over ours: how many times faster; for the transform ours over twin.
    pub ratio: Option<f64>,
    /// Of `ours` and `twin`.
    pub unit: &'static str,
    /// How many results were found to agree.
    pub num_checked: usize,
}

/// The sizes to measure.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Features of the place.
    pub num_features: usize,
    /// Visits of it.
    pub num_visits: usize,
    /// Candidate periods while learning.
    pub num_candidates: usize,
    /// Features that the plain twin learns; it takes seconds for ten.
    pub num_plain: usize,
    /// Predictions in a row.
    pub num_predictions: usize,
    /// Samples of a uniform series: any number, a product of small primes, a prime.
    pub num_samples: [usize; 3],
    /// Each measurement repeats its work for so long.
    pub least_s: f64,
}

impl Default for Sizes {
    fn default() -> Self {
        Self {
            num_features: 500,
            num_visits: 1_000,
            num_candidates: 1_000,
            num_plain: 10,
            num_predictions: 2_000,
            num_samples: [1_000_000, 604_800, 999_983],
            least_s: 0.4,
        }
    }
}

/// Measures everything, on the calling thread.
pub fn temporal(sizes: &Sizes) -> Result<Vec<Row>> {
    let mut rows = learning(sizes)?;
    rows.push(predicting(sizes)?);
    for len in sizes.num_samples {
        rows.push(transform(sizes, len)?);
    }
    Ok(rows)
}

/// Seconds that this thread has spent on a processor, where the system tells; else on the clock.
fn now_s(started: Instant) -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse::<f64>().ok())
        .map_or_else(|| started.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Seconds a run, and what the last one gave.
fn seconds_a_run<R>(least_s: f64, mut run: impl FnMut() -> R) -> (f64, R) {
    let started = Instant::now();
    let start_s = now_s(started);
    let mut runs = 0.0;
    loop {
        let result = black_box(run());
        runs += 1.0;
        let passed_s = now_s(started) - start_s;
        if passed_s > least_s {
            return (passed_s / runs, result);
        }
    }
}

/// Xorshift (Marsaglia 2003).
fn random(state: &mut u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    *state
}

/// Visits about 10 h apart; every feature is seen at about half of them.
fn log(num_features: usize, num_visits: usize) -> Result<HistoryLog> {
    let mut state = 0x1234_5678_9ABC_DEF1;
    let mut log = HistoryLog::new();
    let mut time_s = 1_400_000_000;
    for _ in 0..num_visits {
        time_s += 18_000 + (random(&mut state) % 36_000) as i64;
        let mut row = BitRow::zeros(num_features);
        for feature in 0..num_features {
            if random(&mut state) >> 63 == 1 {
                row.set(feature);
            }
        }
        log.push_visit(Time::from_s(time_s), row, None)?;
    }
    Ok(log)
}

/// `alpha` and `beta` averages of one state, one observation at a time.
struct Plain {
    periods_s: Vec<f64>,
    count: f64,
    mean: f64,
    averages: Vec<[f64; 4]>,
}

impl Plain {
    fn new(candidates: &CandidatePeriods) -> Self {
        let count = candidates.len();
        Self {
            periods_s: (0..count).map(|k| candidates.period_s(k)).collect(),
            count: 0.0,
            mean: 0.0,
            averages: vec![[0.0; 4]; count],
        }
    }

    fn add(&mut self, time_s: f64, state: f64) {
        let next = self.count + 1.0;
        self.mean = (self.count * self.mean + state) / next;
        for (period_s, [re_s, im_s, re_w, im_w]) in self.periods_s.iter().zip(&mut self.averages) {
            let angle = TAU * time_s / period_s;
            let (cos, sin) = (angle.cos(), angle.sin());
            *re_s = (self.count * *re_s + state * cos) / next;
            *im_s = (self.count * *im_s + state * sin) / next;
            *re_w = (self.count * *re_w + cos) / next;
            *im_w = (self.count * *im_w + sin) / next;
        }
        self.count = next;
    }

    /// Period and amplitude of the strongest rhythms.
    fn strongest(&self, order: usize) -> Vec<(f64, f64)> {
        let averages = self.averages.iter().zip(&self.periods_s);
        let mut all: Vec<(f64, f64)> = averages
            .map(|([re_s, im_s, re_w, im_w], &period_s)| {
                let (re, im) = (re_s - self.mean * re_w, im_s - self.mean * im_w);
                (period_s, 2.0 * re.hypot(im))
            })
            .collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all.truncate(order);
        all
    }
}

fn fremen(
    log: &HistoryLog,
    candidates: &CandidatePeriods,
    order: usize,
) -> chronotope::Result<Box<dyn VisibilityModel>> {
    let cfg = VisibilityConfig::fremen(candidates.clone(), Order::Fixed(order));
    fit(log, &cfg, Visits::All)
}

fn learning(sizes: &Sizes) -> Result<Vec<Row>> {
    let candidates = CandidatePeriods::harmonic(Period::YEAR, sizes.num_candidates)?;
    let log = log(sizes.num_features, sizes.num_visits)?;
    let (ours_s, model) = seconds_a_run(sizes.least_s, || fremen(&log, &candidates, 2));
    let model = model?;
    let num_plain = sizes.num_plain.min(sizes.num_features);
    let (plain_s, plain) = seconds_a_run(sizes.least_s, || {
        let learnt = (0..num_plain).map(|feature| {
            let mut state = Plain::new(&candidates);
            for (visit, time) in log.times().iter().enumerate() {
                let seen = log.seen_row(visit).get(feature);
                state.add(time.as_s(), f64::from(u8::from(seen)));
            }
            state
        });
        learnt.collect::<Vec<_>>()
    });
    let mut num_checked = 0;
    for (feature, state) in plain.iter().enumerate() {
        let ours = model.components(feature);
        for (ours, (period_s, amplitude)) in ours.iter().zip(state.strongest(2)) {
            ensure!(
                (ours.amplitude - amplitude).abs() < 1e-6
                    && (ours.period_s - period_s).abs() < 1e-6,
                "feature {feature}: {ours:?}, the twin has {amplitude} at {period_s} s"
            );
            num_checked += 1;
        }
    }
    let num_observations = (sizes.num_features * sizes.num_visits) as f64;
    let plain_s = plain_s * sizes.num_features as f64 / num_plain as f64;
    let bytes = |name: String, bytes: f64| Row {
        name,
        ours: bytes,
        twin: None,
        ratio: None,
        unit: "bytes a feature",
        num_checked: 0,
    };
    Ok(vec![
        Row {
            name: format!(
                "learn {} features x {} visits x {} candidates",
                sizes.num_features, sizes.num_visits, sizes.num_candidates
            ),
            ours: ours_s * 1e3,
            twin: Some(plain_s * 1e3),
            ratio: Some(plain_s / ours_s),
            unit: "ms",
            num_checked,
        },
        Row {
            name: format!("observations learnt, {} candidates", sizes.num_candidates),
            ours: num_observations / ours_s,
            twin: Some(num_observations / plain_s),
            ratio: Some(plain_s / ours_s),
            unit: "1/s",
            num_checked,
        },
        bytes("model of order 2".into(), f64::from(8 + 18 * 2)),
        bytes(
            format!("log of {} visits", sizes.num_visits),
            sizes.num_visits as f64 / 8.0,
        ),
    ])
}

fn predicting(sizes: &Sizes) -> Result<Row> {
    let candidates = CandidatePeriods::harmonic(Period::WEEK, 168)?;
    let log = log(sizes.num_features, sizes.num_visits)?;
    let model = fremen(&log, &candidates, 2)?;
    let components: Vec<_> = (0..sizes.num_features)
        .map(|feature| {
            (
                model.level(feature).unwrap_or_default(),
                model.components(feature),
            )
        })
        .collect();
    let time_s = |i: usize| 1_500_000_000 + i as i64 * 777;
    let mut p = vec![0.0; sizes.num_features];
    let (ours_s, ()) = seconds_a_run(sizes.least_s, || {
        for i in 0..sizes.num_predictions {
            model.predict_into(Time::from_s(time_s(i)), &mut p);
            black_box(&p);
        }
    });
    let (plain_s, last) = seconds_a_run(sizes.least_s, || {
        let mut last = Vec::new();
        for i in 0..sizes.num_predictions {
            let time_s = time_s(i) as f64;
            last = (components.iter())
                .map(|(mean, components)| {
                    let rhythms = components
                        .iter()
                        .map(|c| c.amplitude * (TAU * time_s / c.period_s + c.phase_rad).cos());
                    (mean + rhythms.sum::<f64>()).clamp(0.0, 1.0)
                })
                .collect();
            black_box(&last);
        }
        last
    });
    for (feature, (ours, twin)) in p.iter().zip(&last).enumerate() {
        ensure!(
            (ours - twin).abs() < 1e-6,
            "feature {feature}: p = {ours}, the twin has {twin}"
        );
    }
    let us = 1e6 / sizes.num_predictions as f64;
    Ok(Row {
        name: format!(
            "predict {} features, order 2, 168 candidates",
            sizes.num_features
        ),
        ours: ours_s * us,
        twin: Some(plain_s * us),
        ratio: Some(plain_s / ours_s),
        unit: "us",
        num_checked: p.len(),
    })
}

/// Our model, planning left out, against the transform alone.
fn transform(sizes: &Sizes, len: usize) -> Result<Row> {
    let mut state = 88_172_645_463_325_252;
    let states: Vec<bool> = (0..len)
        .map(|i| (i / 30_000) % 3 == 0 || random(&mut state).is_multiple_of(1_000))
        .collect();
    let second = Period::from_s(1.0)?;
    let plan = || realfft::RealFftPlanner::<f64>::new().plan_fft_forward(len);
    let fft = plan();
    let mut input = fft.make_input_vec();
    let mut output = fft.make_output_vec();
    let mut scratch = fft.make_scratch_vec();
    let (fft_s, transformed) = seconds_a_run(sizes.least_s, || {
        for (sample, &state) in input.iter_mut().zip(&states) {
            *sample = f64::from(u8::from(state));
        }
        fft.process_with_scratch(&mut input, &mut output, &mut scratch)
    });
    transformed?;
    let (plan_s, _) = seconds_a_run(sizes.least_s, plan);
    let (build_s, model) = seconds_a_run(sizes.least_s, || {
        UniformSpectrum::build(Time::default(), second, &states, 2)
    });
    let model = model?;
    ensure!(
        model
            .reconstruct(0..len as u64)
            .iter()
            .zip(&states)
            .all(|(a, b)| *a == Some(*b)),
        "a sample of {len} is not given back"
    );
    let ours_s = (build_s - plan_s).max(0.0);
    Ok(Row {
        name: format!("FFT model of {len} samples, against realfft's transform"),
        ours: ours_s * 1e3,
        twin: Some(fft_s * 1e3),
        ratio: Some(ours_s / fft_s),
        unit: "ms",
        num_checked: len,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_agree_on_small_sizes() {
        let sizes = Sizes {
            num_features: 70,
            num_visits: 60,
            num_candidates: 40,
            num_plain: 3,
            num_predictions: 2,
            num_samples: [4_000, 3_600, 3_001],
            least_s: 0.0,
        };
        let rows = temporal(&sizes).expect("both sides agree");
        assert_eq!(rows.len(), 8);
        assert_eq!(rows[0].num_checked, 6);
        assert!(rows.iter().all(|row| row.ours.is_finite()));
    }
}

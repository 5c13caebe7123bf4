//! How fast are temporal models learnt and evaluated, next to the same sums written plainly?
//!
//! The plain twin takes a cosine and a sine per state, component and observation, as the reference
//! implementation of the papers does in batches, compiled with the same optimisation and run in the
//! same process on one thread. Every comparison first checks that both sides computed the same.
//! Times are of processor time where the system reports it, so that a busy machine disturbs little;
//! compare ratios only.
//!
//! Shared by `cargo bench --bench spectrum` and `chronotope-eval speed`.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Instant;

use anyhow::{Result, ensure};
use fremen::spectrum::{CandidatePeriods, UniformLearner};
use fremen::visibility::{
    BitRow, HistoryLog, Order, VisibilityConfig, VisibilityModel, Visits, fit,
};
use fremen::{Period, Time};

/// Each measurement is of so many batches of runs, of which the fastest counts.
const NUM_BATCHES: usize = 5;

/// Two ways to the same result.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Comparison {
    /// What is done.
    pub(super) case: String,
    /// Milliseconds of a run, one value a batch.
    pub(super) ours_ms: Vec<f64>,
    /// What it is measured by.
    pub(super) twin: &'static str,
    pub(super) twin_ms: Vec<f64>,
    /// Results that were found to agree.
    pub(super) num_checked: usize,
    /// What else is known of either side.
    pub(super) ours_note: String,
    pub(super) twin_note: String,
}

/// The sizes to measure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    /// Features of the place.
    pub(super) num_features: usize,
    /// Visits of it.
    pub(super) num_visits: usize,
    /// Candidate periods while learning, in turn.
    pub(super) num_candidates: [usize; 2],
    /// Features that the plain twin learns; it takes seconds for a hundred.
    pub(super) num_plain: usize,
    /// Predictions in a row.
    pub(super) num_predictions: usize,
    /// Samples of a uniform series: any number, a product of small primes, a prime.
    pub(super) num_samples: [usize; 3],
    /// Each batch repeats its work for so long.
    pub(super) least_s: f64,
}

impl Default for Sizes {
    fn default() -> Self {
        Self {
            num_features: 500,
            num_visits: 1_000,
            num_candidates: [168, 1_000],
            num_plain: 5,
            num_predictions: 2_000,
            num_samples: [1_000_000, 604_800, 999_983],
            least_s: 0.15,
        }
    }
}

/// Measures everything, on the calling thread.
pub(super) fn temporal(sizes: &Sizes) -> Result<Vec<Comparison>> {
    let mut comparisons = Vec::new();
    for num_candidates in sizes.num_candidates {
        comparisons.push(learning(sizes, num_candidates)?);
    }
    comparisons.push(predicting(sizes)?);
    for len in sizes.num_samples {
        comparisons.push(transform(sizes, len)?);
    }
    Ok(comparisons)
}

/// The fastest batch.
pub(super) fn best(ms: &[f64]) -> f64 {
    ms.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Seconds that this thread has spent on a processor, where the system reports it; else on the
/// clock.
fn now_s(started: Instant) -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse::<f64>().ok())
        .map_or_else(|| started.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Milliseconds a run of each batch, and what the last run gave. Batches last at least `least_s`,
/// because processor time is counted in steps.
pub(super) fn ms_a_run<R>(least_s: f64, mut run: impl FnMut() -> R) -> (Vec<f64>, R) {
    let mut result = black_box(run());
    let batches = (0..NUM_BATCHES).map(|_| {
        let started = Instant::now();
        let start_s = now_s(started);
        let mut runs = 0.0;
        loop {
            result = black_box(run());
            runs += 1.0;
            let passed_s = now_s(started) - start_s;
            if passed_s > least_s {
                return passed_s * 1e3 / runs;
            }
        }
    });
    (batches.collect(), result)
}

/// Xorshift (Marsaglia 2003).
fn random(state: &mut u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    *state
}

/// Visits about 10 h apart; every feature is seen at `share` of them.
pub(super) fn log(num_features: usize, num_visits: usize, share: f64) -> Result<HistoryLog> {
    let mut state = 0x1234_5678_9ABC_DEF1;
    let mut log = HistoryLog::new();
    let mut time_s = 1_400_000_000;
    for _ in 0..num_visits {
        time_s += 18_000 + (random(&mut state) % 36_000) as i64;
        let mut row = BitRow::zeros(num_features);
        for feature in 0..num_features {
            if (random(&mut state) >> 11) as f64 / (1_u64 << 53) as f64 <= share {
                row.set(feature);
            }
        }
        log.push_visit(Time::from_s(time_s), row, None)?;
    }
    Ok(log)
}

/// The sums of one state, one observation at a time.
struct Plain {
    periods_s: Vec<f64>,
    num_observed: f64,
    num_seen: f64,
    /// Of each candidate: cosine and sine where the state was 1, then of all observations.
    sums: Vec<[f64; 4]>,
}

impl Plain {
    fn new(candidates: &CandidatePeriods) -> Self {
        let count = candidates.len();
        Self {
            periods_s: (0..count).map(|k| candidates.period_s(k)).collect(),
            num_observed: 0.0,
            num_seen: 0.0,
            sums: vec![[0.0; 4]; count],
        }
    }

    fn add(&mut self, time_s: f64, state: f64) {
        self.num_observed += 1.0;
        self.num_seen += state;
        for (period_s, [cos_s, sin_s, cos_w, sin_w]) in self.periods_s.iter().zip(&mut self.sums) {
            let angle = TAU * time_s / period_s;
            let (cos, sin) = (angle.cos(), angle.sin());
            *cos_s += state * cos;
            *sin_s += state * sin;
            *cos_w += cos;
            *sin_w += sin;
        }
    }

    /// Period and amplitude of the strongest rhythms.
    fn strongest(&self, order: usize) -> Vec<(f64, f64)> {
        let mean = self.num_seen / self.num_observed;
        let mut all: Vec<(f64, f64)> = (self.sums.iter().zip(&self.periods_s))
            .map(|([cos_s, sin_s, cos_w, sin_w], &period_s)| {
                let balanced = f64::hypot(cos_s - mean * cos_w, sin_s - mean * sin_w);
                (period_s, 2.0 * balanced / self.num_observed)
            })
            .collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all.truncate(order);
        all
    }
}

/// FreMEn of a fixed order.
pub(super) fn fremen(
    log: &HistoryLog,
    candidates: &CandidatePeriods,
    order: usize,
) -> fremen::Result<Box<dyn VisibilityModel>> {
    let cfg = VisibilityConfig::fremen(candidates.clone(), Order::Fixed(order));
    fit(log, &cfg, Visits::All)
}

/// What a feature of a FreMEn of some order takes: a mean; for each rhythm a candidate and two
/// factors.
pub(super) const fn model_bytes(order: usize) -> usize {
    8 + 18 * order
}

fn learning(sizes: &Sizes, num_candidates: usize) -> Result<Comparison> {
    let candidates = CandidatePeriods::harmonic(Period::YEAR, num_candidates)?;
    let log = log(sizes.num_features, sizes.num_visits, 0.5)?;
    let (ours_ms, model) = ms_a_run(sizes.least_s, || fremen(&log, &candidates, 2));
    let model = model?;
    let num_plain = sizes.num_plain.min(sizes.num_features);
    let (mut plain_ms, plain) = ms_a_run(sizes.least_s, || {
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
    for ms in &mut plain_ms {
        *ms *= sizes.num_features as f64 / num_plain as f64;
    }
    let rate = |ms: &[f64]| {
        let num_observations = (sizes.num_features * sizes.num_visits) as f64;
        format!("{:.2e} observations/s", num_observations * 1e3 / best(ms))
    };
    let bytes = format!(
        "; {} bytes a feature of order 2, {} of log",
        model_bytes(2),
        sizes.num_visits.div_ceil(8)
    );
    Ok(Comparison {
        case: format!(
            "learn {} x {} x {num_candidates}",
            sizes.num_features, sizes.num_visits
        ),
        ours_note: rate(&ours_ms) + &bytes,
        twin: "plain scalar twin",
        twin_note: format!(
            "{}; {num_plain} features learnt, times {}",
            rate(&plain_ms),
            sizes.num_features / num_plain
        ),
        ours_ms,
        twin_ms: plain_ms,
        num_checked,
    })
}

fn predicting(sizes: &Sizes) -> Result<Comparison> {
    let candidates = CandidatePeriods::harmonic(Period::WEEK, 168)?;
    let log = log(sizes.num_features, sizes.num_visits, 0.5)?;
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
    let (mut ours_ms, ()) = ms_a_run(sizes.least_s, || {
        for i in 0..sizes.num_predictions {
            model.predict_into(Time::from_s(time_s(i)), &mut p);
            black_box(&p);
        }
    });
    let (mut twin_ms, last) = ms_a_run(sizes.least_s, || {
        let mut last = Vec::new();
        for i in 0..sizes.num_predictions {
            let time_s = time_s(i) as f64;
            last.clear();
            last.extend(components.iter().map(|(mean, components)| {
                let rhythms = components
                    .iter()
                    .map(|c| c.amplitude * (TAU * time_s / c.period_s + c.phase_rad).cos());
                (mean + rhythms.sum::<f64>()).clamp(0.0, 1.0)
            }));
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
    for ms in ours_ms.iter_mut().chain(&mut twin_ms) {
        *ms /= sizes.num_predictions as f64;
    }
    let rate = |ms: &[f64]| {
        let predictions = sizes.num_features as f64 * 1e3 / best(ms);
        format!("{predictions:.2e} p/s; order 2, 168 candidates")
    };
    Ok(Comparison {
        case: format!("predict {} features", sizes.num_features),
        ours_note: rate(&ours_ms),
        twin: "plain scalar twin",
        twin_note: rate(&twin_ms),
        ours_ms,
        twin_ms,
        num_checked: p.len(),
    })
}

/// Our model of order 2 with plan and buffers made before, against the transform alone with its
/// own.
fn transform(sizes: &Sizes, len: usize) -> Result<Comparison> {
    let mut state = 88_172_645_463_325_252;
    // Eleven times on and off, with a stray sample now and then.
    let third = len.div_ceil(33);
    let states: Vec<bool> = (0..len)
        .map(|i| (i / third).is_multiple_of(3) || random(&mut state).is_multiple_of(1_000))
        .collect();
    let second = Period::from_s(1.0)?;
    let plan = || realfft::RealFftPlanner::<f64>::new().plan_fft_forward(len);
    let fft = plan();
    let mut input = fft.make_input_vec();
    let mut output = fft.make_output_vec();
    let mut scratch = fft.make_scratch_vec();
    let (twin_ms, transformed) = ms_a_run(sizes.least_s, || {
        for (sample, &state) in input.iter_mut().zip(&states) {
            *sample = f64::from(u8::from(state));
        }
        fft.process_with_scratch(&mut input, &mut output, &mut scratch)
    });
    transformed?;
    let (plan_ms, _) = ms_a_run(sizes.least_s, plan);
    let mut learner = UniformLearner::new(len)?;
    let (ours_ms, model) = ms_a_run(sizes.least_s, || {
        learner.build(Time::default(), second, &states, 2)
    });
    let model = model?;
    ensure!(model.order() == 2, "{} rhythms of {len}", model.order());
    let given_back = model.reconstruct(0..len as u64);
    ensure!(
        given_back.len() == len && given_back.iter().zip(&states).all(|(a, b)| *a == Some(*b)),
        "a sample of {len} is not given back"
    );
    let plan_ms = best(&plan_ms);
    Ok(Comparison {
        case: format!("FFT of {len} samples"),
        ours_note: format!(
            "whole model, {:.2} times the transform; planning, left out, {plan_ms:.1} ms",
            best(&ours_ms) / best(&twin_ms)
        ),
        twin: "realfft's transform",
        twin_note: "the transform alone".into(),
        ours_ms,
        twin_ms,
        num_checked: len,
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn both_sides_agree_on_small_sizes() {
        use super::{Sizes, temporal};

        let sizes = Sizes {
            num_features: 70,
            num_visits: 60,
            num_candidates: [12, 40],
            num_plain: 3,
            num_predictions: 2,
            num_samples: [4_000, 3_600, 3_001],
            least_s: 0.0,
        };
        let comparisons = temporal(&sizes).expect("both sides agree");
        let num_checked: Vec<usize> = comparisons.iter().map(|c| c.num_checked).collect();
        assert_eq!(num_checked, [6, 6, 70, 4_000, 3_600, 3_001]);
        assert!(comparisons[1].case.contains("70 x 60 x 40"));
        assert!(comparisons[1].ours_note.contains("44 bytes a feature"));
    }
}

//! How fast are time models learnt and asked, against the same sums written plainly?
//!
//! The plain twin takes a cosine and a sine per state, component and observation, as the reference
//! implementation of the papers does. Every run checks what it computed. `cargo bench --bench spectrum`.

#![allow(missing_docs, reason = "a benchmark has no users")]
#![allow(clippy::expect_used, reason = "a broken fixture ends the run")]
#![allow(clippy::print_stdout, reason = "the printed ratios are the result")]

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Instant;

use chronotope::spectrum::{CandidatePeriods, UniformSpectrum};
use chronotope::visibility::{
    BitRow, HistoryLog, Order, VisibilityConfig, VisibilityModel, Visits, fit,
};
use chronotope::{Period, Time};

/// Seconds that this process has spent on a processor, where the system tells; else on the clock.
fn now_s(started: Instant) -> f64 {
    std::fs::read_to_string("/proc/self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse::<f64>().ok())
        .map_or_else(|| started.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Seconds a run, over at least a few tenths of a second: processor time is counted in steps.
fn seconds_a_run<R>(mut run: impl FnMut() -> R) -> (f64, R) {
    let started = Instant::now();
    let start_s = now_s(started);
    let mut runs = 0.0;
    loop {
        let result = black_box(run());
        runs += 1.0;
        let passed_s = now_s(started) - start_s;
        if passed_s > 0.4 {
            return (passed_s / runs, result);
        }
    }
}

fn random(state: &mut u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    *state
}

/// Visits about 10 h apart; every feature is seen at `share` of them.
fn log(num_features: usize, num_visits: usize, share: f64) -> HistoryLog {
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
        log.push_visit(Time::from_s(time_s), row, None)
            .expect("rows fit");
    }
    log
}

/// `alpha` and `beta` averages of one state, one observation at a time.
struct Plain {
    periods_s: Vec<f64>,
    count: f64,
    mean: f64,
    averages: Vec<[f64; 4]>,
}

impl Plain {
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

    /// Factors of cosine and sine of the strongest, as (candidate, re, im).
    fn strongest(&self, order: usize) -> Vec<(usize, f64, f64)> {
        let mut all: Vec<_> = (self.averages.iter().enumerate())
            .map(|(k, [re_s, im_s, re_w, im_w])| {
                (
                    k,
                    2.0 * (re_s - self.mean * re_w),
                    2.0 * (im_s - self.mean * im_w),
                )
            })
            .collect();
        all.sort_by(|a, b| b.1.hypot(b.2).total_cmp(&a.1.hypot(a.2)));
        all.truncate(order);
        all
    }
}

fn fremen(candidates: &CandidatePeriods, order: usize) -> VisibilityConfig {
    VisibilityConfig::fremen(candidates.clone(), Order::Fixed(order))
}

fn learned(log: &HistoryLog, cfg: &VisibilityConfig) -> Box<dyn VisibilityModel> {
    fit(log, cfg, Visits::All).expect("all visits")
}

fn learning_and_predicting() {
    let (num_features, num_visits, num_candidates) = (500, 1_000, 1_000);
    let candidates = CandidatePeriods::harmonic(Period::YEAR, num_candidates).expect("valid");
    let log = log(num_features, num_visits, 0.5);
    let (ours_s, model) = seconds_a_run(|| learned(&log, &fremen(&candidates, 2)));

    // The twin learns a tenth of the features: it takes seconds for each ten.
    let sample = num_features / 50;
    let (plain_s, plain) = seconds_a_run(|| {
        let mut states = Vec::new();
        for feature in 0..sample {
            let mut state = Plain {
                periods_s: (0..num_candidates)
                    .map(|k| candidates.period_s(k))
                    .collect(),
                count: 0.0,
                mean: 0.0,
                averages: vec![[0.0; 4]; num_candidates],
            };
            for (visit, time) in log.times().iter().enumerate() {
                let seen = log.seen_row(visit).get(feature);
                state.add(time.as_s(), f64::from(u8::from(seen)));
            }
            states.push(state);
        }
        states
    });
    for (feature, state) in plain.iter().enumerate() {
        let ours = model.components(feature);
        for (ours, (k, re, im)) in ours.iter().zip(state.strongest(2)) {
            assert!(
                (ours.amplitude - re.hypot(im)).abs() < 1e-6,
                "feature {feature}"
            );
            assert!((ours.period_s - candidates.period_s(k)).abs() < 1e-6);
        }
    }
    let plain_s = plain_s * (num_features / sample) as f64;
    let num_observations = (num_features * num_visits) as f64;
    println!(
        "learn {num_features} features x {num_visits} visits x {num_candidates} candidates: {:.1} ms \
         ({:.2e} observations/s); plain {:.2e} observations/s; {:.0} times faster",
        ours_s * 1e3,
        num_observations / ours_s,
        num_observations / plain_s,
        plain_s / ours_s
    );

    let candidates = CandidatePeriods::harmonic(Period::WEEK, 168).expect("valid");
    let model = learned(&log, &fremen(&candidates, 2));
    let components: Vec<_> = (0..num_features).map(|f| model.components(f)).collect();
    let means: Vec<_> = {
        let mean = learned(&log, &VisibilityConfig::mean());
        (0..num_features)
            .map(|f| mean.predict_one(f, Time::default()))
            .collect()
    };
    let mut p = vec![0.0; num_features];
    let rounds = 2_000_i64;
    let (ours_s, ()) = seconds_a_run(|| {
        for i in 0..rounds {
            model.predict_into(Time::from_s(1_500_000_000 + i * 777), &mut p);
            black_box(&p);
        }
    });
    let (plain_s, last) = seconds_a_run(|| {
        let mut last = Vec::new();
        for i in 0..rounds {
            let time_s = (1_500_000_000 + i * 777) as f64;
            last = (components.iter().zip(&means))
                .map(|(components, mean)| {
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
    assert!(p.iter().zip(&last).all(|(a, b)| (a - b).abs() < 1e-6));
    println!(
        "predict {num_features} features, order 2, 168 candidates: {:.2} us; plain {:.2} us; {:.1} times faster",
        ours_s / rounds as f64 * 1e6,
        plain_s / rounds as f64 * 1e6,
        plain_s / ours_s
    );
}

fn a_large_place() {
    let log = log(100_000, 600, 0.03);
    let candidates = CandidatePeriods::harmonic(Period::DAY, 12).expect("valid");
    let bytes_of_log = log.num_visits() * log.num_features() / 8;
    for (name, cfg) in [
        ("mean", VisibilityConfig::mean()),
        ("fremen, order 2", fremen(&candidates, 2)),
    ] {
        let (learn_s, model) = seconds_a_run(|| learned(&log, &cfg));
        let mut p = vec![0.0; log.num_features()];
        let (predict_s, ()) = seconds_a_run(|| model.predict_into(Time::default(), &mut p));
        println!(
            "place of 100,000 features x 600 visits x 12 candidates, {name}: learn {:.1} ms, predict {:.2} ms",
            learn_s * 1e3,
            predict_s * 1e3
        );
    }
    println!(
        "bytes a feature: log {} (600 visits, 1 bit each), mean 8, fremen of order 2 {}",
        bytes_of_log / log.num_features(),
        8 + 18 * 2
    );
}

fn transform() {
    for len in [1_000_000_usize, 604_800, 999_983] {
        let mut state = 88_172_645_463_325_252;
        let states: Vec<bool> = (0..len)
            .map(|i| (i / 30_000) % 3 == 0 || random(&mut state).is_multiple_of(1_000))
            .collect();
        let second = Period::from_us(1_000_000).expect("positive");
        let mut planner = realfft::RealFftPlanner::<f64>::new();
        let fft = planner.plan_fft_forward(len);
        let mut input = fft.make_input_vec();
        let mut output = fft.make_output_vec();
        let mut scratch = fft.make_scratch_vec();
        let (fft_s, ()) = seconds_a_run(|| {
            for (sample, &state) in input.iter_mut().zip(&states) {
                *sample = f64::from(u8::from(state));
            }
            fft.process_with_scratch(&mut input, &mut output, &mut scratch)
                .expect("its own buffers");
        });
        let (plan_s, _) =
            seconds_a_run(|| realfft::RealFftPlanner::<f64>::new().plan_fft_forward(len));
        let (build_s, model) = seconds_a_run(|| {
            UniformSpectrum::build(Time::default(), second, &states, 2).expect("fits")
        });
        assert_eq!(model.order(), 2);
        println!(
            "spectral model of {len} samples, order 2: {:.1} ms with {:.1} ms of planning; transform alone {:.1} ms; ratio {:.2}",
            build_s * 1e3,
            plan_s * 1e3,
            fft_s * 1e3,
            (build_s - plan_s) / fft_s
        );
    }
}

fn main() {
    learning_and_predicting();
    a_large_place();
    transform();
}

//! Which forecasts are compared?
//!
//! Every temporal model of the papers and those of this library. None is tuned to a suite.

use anyhow::Result;
use chronotope::spectrum::{
    Balance, CandidatePeriods, LiteralFremen, Rhythms, UniformLearner, UniformSpectrum,
};
use chronotope::visibility::{HistoryLog, VisibilityConfig, VisibilityModel, Visits, fit};
use chronotope::{Period, Time};

use super::data::State;
use crate::results::RowOrder;

/// The highest order of FreMEn that is tried.
pub const MAX_ORDER: usize = 10;

/// Candidates of FreMEn: the fractions of a week down to an hour, as the papers use indoors.
const NUM_CANDIDATES: usize = 168;

/// The name of the model that the documentation recommends.
pub const DEFAULT: &str = "natural";

/// The baseline that every forecast is paired with.
pub const BASELINE: &str = "mean";

/// FreMEn as the two papers print it.
pub const LITERAL: [&str; 2] = ["fremen-alpha-only", "fremen-running-mean"];

const FFT: &str = "fft";

const LOGISTIC: &str = "logistic-week-day";

/// Logistic regression walks through its samples dozens of times, so it gets evenly spaced ones of
/// many.
const MAX_LOGISTIC: usize = 20_000;

/// With fewer samples to judge by, the order is 0.
const MIN_HELD_OUT: usize = 4;

/// p(t) of one model.
pub struct Forecast {
    /// Its name in tables.
    pub model: &'static str,
    /// How many rhythms it has, or that it chooses.
    pub order: RowOrder,
    predictor: Predictor,
}

enum Predictor {
    Rhythms(Rhythms),
    Uniform(UniformSpectrum),
    Fitted(Box<dyn VisibilityModel>),
}

/// A time, with what the forecasts share at it.
pub struct Instant {
    candidates: CandidatePeriods,
    time: Time,
    phasors: Vec<f64>,
}

impl Instant {
    /// An instant at the epoch; [`set`](Self::set) moves it.
    pub fn new() -> Result<Self> {
        let candidates = candidates()?;
        let phasors = vec![0.0; 2 * candidates.len()];
        let mut instant = Self {
            candidates,
            time: Time::default(),
            phasors,
        };
        instant.set(Time::default());
        Ok(instant)
    }

    /// Goes to another time.
    pub fn set(&mut self, time: Time) {
        self.time = time;
        self.candidates.phasors_into(time, &mut self.phasors);
    }
}

impl Forecast {
    /// p(t).
    pub fn p(&self, at: &Instant) -> f64 {
        let time = at.time;
        match &self.predictor {
            Predictor::Rhythms(rhythms) => rhythms.p_of(&at.phasors),
            Predictor::Uniform(spectrum) => spectrum.p(time),
            Predictor::Fitted(model) => model.predict_one(0, time),
        }
    }
}

/// Models that `fit` makes, in TOML.
const FITTED: [(&str, &str); 8] = [
    (BASELINE, "kind = 'mean'"),
    (DEFAULT, "kind = 'natural'"),
    (
        LOGISTIC,
        "kind = 'logistic', candidates = { base-s = 604800.0, count = 28 }, harmonics = [1, 2, 7, 14]",
    ),
    (
        "histogram-day",
        "kind = 'histogram', period-s = 86400.0, num-bins = 24",
    ),
    (
        "histogram-week",
        "kind = 'histogram', period-s = 604800.0, num-bins = 168",
    ),
    (
        "pergam-day",
        "kind = 'pergam', period-s = 86400.0, num-bins = 48, order = 3",
    ),
    ("markov", "kind = 'markov'"),
    (
        "persistent-natural",
        "kind = 'persistent', of = { kind = 'natural' }",
    ),
];

/// What FreMEn looks for in a series.
pub fn candidates() -> chronotope::Result<CandidatePeriods> {
    CandidatePeriods::harmonic(Period::WEEK, NUM_CANDIDATES)
}

/// The forecasts whose names are `wanted`, learnt from `states`.
pub fn forecasts(states: &[State], wanted: impl Fn(&str) -> bool) -> Result<Vec<Forecast>> {
    let mut forecasts = Vec::new();
    let all = HistoryLog::of_states(states.iter().copied())?;
    let step = states.len().div_ceil(MAX_LOGISTIC).max(1);
    let few = HistoryLog::of_states(states.iter().step_by(step).copied())?;
    for (model, text) in FITTED.into_iter().filter(|(model, _)| wanted(model)) {
        let log = if model == LOGISTIC { &few } else { &all };
        let cfg = VisibilityConfig::from_toml(&format!("model = {{ {text} }}"))?;
        forecasts.push(Forecast {
            model,
            order: match model {
                BASELINE => RowOrder::Fixed(0),
                _ => RowOrder::Auto,
            },
            predictor: Predictor::Fitted(fit(log, &cfg, Visits::All)?),
        });
    }
    let [alpha_only, running_mean] = LITERAL;
    for (model, balance) in [
        ("fremen", Balance::Exact),
        (alpha_only, Balance::AlphaOnly),
        (running_mean, Balance::RunningMean),
    ] {
        if !wanted(model) {
            continue;
        }
        let mut fremen = LiteralFremen::new(candidates()?, balance);
        for &(time, state) in states {
            fremen.add(time, state);
        }
        forecasts.push(Forecast {
            model,
            order: RowOrder::Auto,
            predictor: Predictor::Rhythms(fremen.rhythms(held_out_order(states, balance)?)),
        });
        forecasts.extend((1..=MAX_ORDER).map(|order| Forecast {
            model,
            order: RowOrder::Fixed(order as u32),
            predictor: Predictor::Rhythms(fremen.rhythms(order)),
        }));
    }
    if wanted(FFT)
        && let Some((step, samples)) = uniform(states)
    {
        let mut learner = UniformLearner::new(samples.len())?;
        for order in 0..=MAX_ORDER {
            let spectrum = learner.build_with_missing(states[0].0, step, &samples, order)?;
            forecasts.push(Forecast {
                model: FFT,
                order: RowOrder::Fixed(order as u32),
                predictor: Predictor::Uniform(spectrum),
            });
        }
    }
    Ok(forecasts)
}

/// The order that predicts the latest fifth of the samples best, learnt from those before (T-RO
/// IV-B): the lower one of equals, 0 with few samples.
fn held_out_order(states: &[State], balance: Balance) -> Result<usize> {
    let (earlier, latest) = states.split_at(states.len() - states.len() / 5);
    if latest.len() < MIN_HELD_OUT {
        return Ok(0);
    }
    let mut fremen = LiteralFremen::new(candidates()?, balance);
    for &(time, state) in earlier {
        fremen.add(time, state);
    }
    let rhythms: Vec<Rhythms> = (0..=MAX_ORDER).map(|order| fremen.rhythms(order)).collect();
    let mut errors = vec![0.0; rhythms.len()];
    let mut at = Instant::new()?;
    for &(time, state) in latest {
        at.set(time);
        for (error, rhythms) in errors.iter_mut().zip(&rhythms) {
            *error += (rhythms.p_of(&at.phasors) - f64::from(u8::from(state))).powi(2);
        }
    }
    let first_lowest = |best: usize, order: usize| {
        if errors[order] < errors[best] {
            order
        } else {
            best
        }
    };
    Ok((0..=MAX_ORDER).fold(0, first_lowest))
}

/// Step and samples, if at most half of a steady rate's samples are missing.
fn uniform(states: &[State]) -> Option<(Period, Vec<Option<bool>>)> {
    let (first, last) = (states.first()?.0.as_us(), states.last()?.0.as_us());
    let step = states
        .windows(2)
        .map(|w| w[1].0.as_us() - w[0].0.as_us())
        .min()?;
    let step = Period::from_us(step).ok()?;
    let len = usize::try_from((last - first) / step.as_us()).ok()? + 1;
    if len > 2 * states.len() {
        return None;
    }
    let mut samples = vec![None; len];
    for &(time, state) in states {
        let since = time.as_us() - first;
        if since % step.as_us() != 0 {
            return None;
        }
        samples[(since / step.as_us()) as usize] = Some(state);
    }
    Some((step, samples))
}

//! How probable is it, in the sense that forecasts of 70 % come true 7 times in 10?
//!
//! `p(t) = 1 / (1 + e^{-b x(t)})`, `x(t) = (1, cos w_a t, sin w_a t, ...)` with the rhythms that
//! the place follows (chosen as for least squares), b the most probable coefficients under normal
//! priors that are themselves learnt from all features of the place (empirical Bayes): the mean is
//! drawn to the place's, the rhythms to none, more so the fewer visits a feature has. p never
//! reaches 0 or 1, so a likelihood can be taken of it.
//!
//! Learning: Newton steps, O(visits x coefficients^2) each, about six a feature. Not for maps
//! that are refitted at every visit; least squares costs a hundredth.

use super::codec;
use super::evidence::Evidence;
use super::shared_rhythms::SharedRhythms;
use super::{Fremen, VisibilityModel};
use crate::error::Result;
use crate::spectrum::{Cholesky, Component, Reader, Writer};
use crate::time::Time;

/// Features from which the priors are learnt.
const MAX_VOTERS: usize = 1_024;
/// Rounds of learning the priors.
const NUM_ROUNDS: usize = 5;
/// Newton steps at most.
const MAX_STEPS: usize = 30;
/// No prior is narrower than this standard deviation, in log odds.
const MIN_SIGMA: f64 = 0.1;

/// Logistic regression of every feature on the rhythms of the place; `8 (1 + 2 l) + 10 l` bytes a
/// feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Logistic {
    /// Log odds in place of probabilities.
    log_odds: Fremen,
}

/// Normal priors: mean of the first coefficient, variance of the first and of the others.
#[derive(Clone, Copy)]
struct Prior {
    mean: f64,
    variance: f64,
    rhythm_variance: f64,
}

/// The visits as rows of x, and one feature's states at them.
struct Design {
    rows: Vec<f64>,
    size: usize,
}

fn sigmoid(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

pub(super) fn fit(evidence: &Evidence<'_>, shared: &SharedRhythms<'_>) -> Result<Logistic> {
    let harmonics = shared.choose(evidence)?;
    let num_features = evidence.num_features();
    let size = 1 + 2 * harmonics.len();
    let mut rows = Vec::with_capacity(evidence.visits.len() * size);
    for time in evidence.times() {
        rows.push(1.0);
        for &harmonic in &harmonics {
            let (cos, sin) = shared.candidates.phasor(usize::from(harmonic) - 1, time);
            rows.extend([cos, sin]);
        }
    }
    let design = Design { rows, size };

    let counts = evidence.counts();
    let total = |n: &[u32]| n.iter().map(|&n| f64::from(n)).sum::<f64>();
    let mean = (total(&counts.seen) + 0.5) / (total(&counts.observed) + 1.0);
    let mut prior = Prior {
        mean: (mean / (1.0 - mean)).ln(),
        variance: 25.0,
        rhythm_variance: 25.0,
    };
    let mut observations = Vec::with_capacity(evidence.visits.len());
    let step = num_features.div_ceil(MAX_VOTERS).max(1);
    for _ in 0..NUM_ROUNDS {
        let mut moments = [0.0; 4]; // Of the first coefficient: number, sum, squares; of the others: squares.
        for feature in (0..num_features).step_by(step) {
            states(evidence, feature, &mut observations);
            let (solution, variances) = design.most_probable(&observations, prior);
            moments[0] += 1.0;
            moments[1] += solution[0];
            moments[2] += solution[0] * solution[0] + variances[0];
            let rhythms = solution[1..].iter().zip(&variances[1..]);
            moments[3] += rhythms.map(|(b, v)| b * b + v).sum::<f64>();
        }
        // One feature is no population, but its rhythms are.
        if moments[0] >= 2.0 {
            prior.mean = moments[1] / moments[0];
            let variance = moments[2] / moments[0] - prior.mean * prior.mean;
            prior.variance = variance.max(MIN_SIGMA * MIN_SIGMA);
        }
        if size > 1 && moments[0] > 0.0 {
            let rhythm_variance = moments[3] / (moments[0] * (size - 1) as f64);
            prior.rhythm_variance = rhythm_variance.max(MIN_SIGMA * MIN_SIGMA);
        }
    }
    let mut log_odds = Fremen::of_means(
        shared.candidates.clone(),
        harmonics.len(),
        vec![prior.mean; num_features],
    );
    for feature in 0..num_features {
        states(evidence, feature, &mut observations);
        if observations.is_empty() {
            log_odds.set(feature, 0.0, &[], &[]); // Unknown: one half.
            continue;
        }
        let (solution, _) = design.most_probable(&observations, prior);
        log_odds.set(feature, solution[0], &harmonics, &solution[1..]);
    }
    Ok(Logistic { log_odds })
}

/// The visits at which a feature could be observed, as indices, and its states.
fn states(evidence: &Evidence<'_>, feature: usize, out: &mut Vec<(usize, f64)>) {
    out.clear();
    for index in evidence.first_visit(feature)..evidence.visits.len() {
        let visit = evidence.visits[index];
        if (evidence.log.hidden_row(visit)).is_none_or(|hidden| !hidden.get(feature)) {
            let state = evidence.log.seen_row(visit).get(feature);
            out.push((index, f64::from(u8::from(state))));
        }
    }
}

impl Design {
    /// The coefficients of the highest posterior and their variances.
    fn most_probable(&self, observations: &[(usize, f64)], prior: Prior) -> (Vec<f64>, Vec<f64>) {
        let size = self.size;
        let precision = |i: usize| match i {
            0 => 1.0 / prior.variance,
            _ => 1.0 / prior.rhythm_variance,
        };
        let centre = |i: usize| if i == 0 { prior.mean } else { 0.0 };
        let row = |index: usize| &self.rows[index * size..(index + 1) * size];
        let log_odds =
            |b: &[f64], index: usize| -> f64 { b.iter().zip(row(index)).map(|(b, x)| b * x).sum() };
        let loss = |b: &[f64]| {
            let prior: f64 = b
                .iter()
                .enumerate()
                .map(|(i, b)| 0.5 * precision(i) * (b - centre(i)).powi(2))
                .sum();
            observations.iter().fold(prior, |loss, &(index, state)| {
                let z = log_odds(b, index);
                // ln(1 + e^z) without overflow.
                loss + z.max(0.0) + (-z.abs()).exp().ln_1p() - state * z
            })
        };
        let mut b: Vec<f64> = (0..size).map(centre).collect();
        let mut b_loss = loss(&b);
        let mut variances: Vec<f64> = (0..size).map(|i| 1.0 / precision(i)).collect();
        for _ in 0..MAX_STEPS {
            let mut hessian = vec![0.0; size * size];
            let mut gradient: Vec<f64> = (0..size)
                .map(|i| precision(i) * (b[i] - centre(i)))
                .collect();
            for &(index, state) in observations {
                let x = row(index);
                let p = sigmoid(log_odds(&b, index));
                let weight = p * (1.0 - p);
                for i in 0..size {
                    gradient[i] += (p - state) * x[i];
                    for j in 0..=i {
                        hessian[i * size + j] += weight * x[i] * x[j];
                    }
                }
            }
            for i in 0..size {
                hessian[i * size + i] += precision(i);
            }
            // Only the lower triangle is read.
            let Some(factor) = Cholesky::new(hessian, size) else {
                break;
            };
            variances = factor.inverse_diagonal();
            factor.solve(&mut gradient);
            let mut scale = 1.0;
            let next = loop {
                let next: Vec<_> = b
                    .iter()
                    .zip(&gradient)
                    .map(|(b, g)| b - scale * g)
                    .collect();
                let next_loss = loss(&next);
                if next_loss <= b_loss {
                    b_loss = next_loss;
                    break Some(next);
                }
                scale *= 0.5;
                if scale < 1e-6 {
                    break None;
                }
            };
            let Some(next) = next else { break };
            b = next;
            if gradient.iter().all(|step| step.abs() < 1e-9) {
                break;
            }
        }
        (b, variances)
    }
}

impl Logistic {
    fn write(&self, writer: &mut Writer) {
        self.log_odds.write(writer);
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let log_odds = Fremen::read(reader)?;
        Ok(Self { log_odds })
    }
}

impl VisibilityModel for Logistic {
    fn num_features(&self) -> usize {
        self.log_odds.num_features()
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        self.log_odds.sums_into(time, out);
        for p in out {
            *p = sigmoid(*p);
        }
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        sigmoid(self.log_odds.sum_of(feature, time))
    }

    fn order(&self) -> usize {
        self.log_odds.order()
    }

    fn encode(&self) -> Option<Vec<u8>> {
        Some(codec::encode(codec::Kind::Logistic, |writer| {
            self.write(writer);
        }))
    }

    /// Amplitudes are in log odds.
    fn components(&self, feature: usize) -> Vec<Component> {
        self.log_odds.components(feature)
    }
}

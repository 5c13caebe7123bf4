//! How much is a score worth as evidence?
//!
//! Features of one image are not independent, so a sum of their log ratios claims too much. A
//! [`Temper`] turns the score `x_l` of each place into a posterior over places and "elsewhere":
//!
//! ```text
//! P(l)         ~ (1 - e) / N * exp(scale * x_l)
//! P(elsewhere) ~      e      * exp(bias)
//! ```
//!
//! with the prior probability `e` of being nowhere in a map of N places. `scale` and `bias` minimise the
//! log loss over held-out images, each asked twice: with its place in the map (the answer is the place)
//! and without it (the answer is elsewhere), both with e = 1/2. That loss is convex in both; a weak
//! normal prior keeps them finite where there are few images. (Temperature scaling with a bias for the
//! extra class; Guo et al. 2017.)

/// Slope and threshold of a score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Temper {
    /// Nats of evidence a unit of score.
    pub scale: f64,
    /// Nats of evidence that "elsewhere" starts with.
    pub bias: f64,
}

/// The scores of one held-out image.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Of its own place; `None` if it was not asked with it.
    pub own: Option<f64>,
    /// Of the other places.
    pub others: Vec<f64>,
}

impl Temper {
    /// Fits `asked`, starting from (and drawn to) `prior`.
    pub fn fit(asked: &[Asked], prior: Self) -> Self {
        let mut temper = prior;
        let mut loss = temper.loss(asked, prior);
        for _ in 0..50 {
            let (gradient, hessian) = temper.derivatives(asked, prior);
            let determinant = hessian[0] * hessian[2] - hessian[1] * hessian[1];
            if !(determinant.is_finite() && determinant > 0.0) {
                break;
            }
            let step = [
                (hessian[2] * gradient[0] - hessian[1] * gradient[1]) / determinant,
                (hessian[0] * gradient[1] - hessian[1] * gradient[0]) / determinant,
            ];
            // Newton's step, halved until the loss falls: it is convex, so this ends at its minimum.
            let mut share = 1.0;
            let improved = loop {
                let next = Self {
                    scale: (temper.scale - share * step[0]).max(1e-4),
                    bias: temper.bias - share * step[1],
                };
                let next_loss = next.loss(asked, prior);
                if next_loss < loss - 1e-12 {
                    break Some((next, next_loss));
                }
                share /= 2.0;
                if share < 1e-6 {
                    break None;
                }
            };
            match improved {
                Some((next, next_loss)) => (temper, loss) = (next, next_loss),
                None => break,
            }
        }
        temper
    }

    /// Writes the posterior of each place and returns that of "elsewhere", for its prior probability
    /// `elsewhere`.
    pub fn posterior_into(self, scores: &[f64], elsewhere: f64, out: &mut Vec<f64>) -> f64 {
        let prior = ((1.0 - elsewhere) / scores.len().max(1) as f64).ln();
        let of_elsewhere = elsewhere.ln() + self.bias;
        out.clear();
        out.extend(scores.iter().map(|score| prior + self.scale * score));
        let most = out.iter().copied().fold(of_elsewhere, f64::max);
        let mut total = (of_elsewhere - most).exp();
        for share in out.iter_mut() {
            *share = (*share - most).exp();
            total += *share;
        }
        for share in out.iter_mut() {
            *share /= total;
        }
        (of_elsewhere - most).exp() / total
    }

    /// Each of the two questions an image asks: the scores, and which of them is right (`None` for
    /// elsewhere).
    fn questions(asked: &Asked) -> impl Iterator<Item = (impl Iterator<Item = f64> + Clone, bool)> {
        let with_own = asked
            .own
            .map(|own| (asked.others.iter().copied().chain(Some(own)), true));
        let without = (asked.others.iter().copied().chain(None), false);
        with_own.into_iter().chain(Some(without))
    }

    fn loss(self, asked: &[Asked], prior: Self) -> f64 {
        let mut loss = 0.5 * ((self.scale - prior.scale) / prior.scale).powi(2)
            + 0.5 * ((self.bias - prior.bias) / PRIOR_WIDTH).powi(2);
        for asked in asked {
            for (scores, is_native) in Self::questions(asked) {
                let log_n = (scores.clone().count().max(1) as f64).ln();
                let logs = scores.clone().map(|score| self.scale * score - log_n);
                let total = log_sum_exp(logs.chain(Some(self.bias)));
                let right = match asked.own {
                    Some(own) if is_native => self.scale * own - log_n,
                    _ => self.bias,
                };
                loss += total - right;
            }
        }
        loss
    }

    /// Gradient, and the upper triangle of the Hessian, of the loss by scale and bias.
    fn derivatives(self, asked: &[Asked], prior: Self) -> ([f64; 2], [f64; 3]) {
        let mut gradient = [
            (self.scale - prior.scale) / prior.scale.powi(2),
            (self.bias - prior.bias) / PRIOR_WIDTH.powi(2),
        ];
        let mut hessian = [prior.scale.powi(-2), 0.0, PRIOR_WIDTH.powi(-2)];
        for asked in asked {
            for (scores, is_native) in Self::questions(asked) {
                let log_n = (scores.clone().count().max(1) as f64).ln();
                let logs = scores.clone().map(|score| self.scale * score - log_n);
                let total = log_sum_exp(logs.clone().chain(Some(self.bias)));
                let elsewhere = (self.bias - total).exp();
                let (mut mean, mut square) = (0.0, 0.0);
                for (score, log) in scores.zip(logs) {
                    let share = (log - total).exp();
                    mean += share * score;
                    square += share * score * score;
                }
                let right = if is_native { asked.own } else { None };
                gradient[0] += mean - right.unwrap_or(0.0);
                gradient[1] += elsewhere - if right.is_some() { 0.0 } else { 1.0 };
                hessian[0] += square - mean * mean;
                hessian[1] -= mean * elsewhere;
                hessian[2] += elsewhere * (1.0 - elsewhere);
            }
        }
        (gradient, hessian)
    }
}

/// Standard deviation of the bias before anything was asked, nats.
const PRIOR_WIDTH: f64 = 3.0;

/// `ln(sum of exp)` without overflow; minus infinity for nothing.
fn log_sum_exp(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY {
        return most;
    }
    most + logs.map(|log| (log - most).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIOR: Temper = Temper {
        scale: 0.5,
        bias: 1.0,
    };

    fn asked(own: f64, others: &[f64]) -> Asked {
        Asked {
            own: Some(own),
            others: others.to_vec(),
        }
    }

    #[test]
    fn nothing_asked_leaves_the_prior() {
        assert_eq!(Temper::fit(&[], PRIOR), PRIOR);
    }

    #[test]
    fn derivatives_are_those_of_the_loss() {
        let all = [asked(3.0, &[0.0, 1.0]), asked(1.0, &[2.0, -1.0])];
        let at = Temper {
            scale: 0.7,
            bias: 0.4,
        };
        let (gradient, hessian) = at.derivatives(&all, PRIOR);
        let step = 1e-5;
        let moved = |scale: f64, bias: f64| Temper {
            scale: at.scale + scale,
            bias: at.bias + bias,
        };
        let slope = |scale: f64, bias: f64| {
            (moved(scale, bias).loss(&all, PRIOR) - moved(-scale, -bias).loss(&all, PRIOR))
                / (2.0 * step)
        };
        assert!((slope(step, 0.0) - gradient[0]).abs() < 1e-6);
        assert!((slope(0.0, step) - gradient[1]).abs() < 1e-6);
        let bend = |i: usize, scale: f64, bias: f64| {
            (moved(scale, bias).derivatives(&all, PRIOR).0[i]
                - moved(-scale, -bias).derivatives(&all, PRIOR).0[i])
                / (2.0 * step)
        };
        assert!((bend(0, step, 0.0) - hessian[0]).abs() < 1e-5);
        assert!((bend(0, 0.0, step) - hessian[1]).abs() < 1e-5);
        assert!((bend(1, 0.0, step) - hessian[2]).abs() < 1e-5);
    }

    #[test]
    fn a_score_that_tells_places_apart_is_believed_and_one_that_does_not_is_not() {
        let telling: Vec<Asked> = (0..50).map(|_| asked(8.0, &[0.0, 1.0, -1.0])).collect();
        let good = Temper::fit(&telling, PRIOR);
        let mut posterior = Vec::new();
        let elsewhere = good.posterior_into(&[8.0, 0.0, 1.0], 0.5, &mut posterior);
        assert!(posterior[0] > 0.9 && elsewhere < 0.1, "{good:?}");
        let elsewhere = good.posterior_into(&[1.0, 0.0, -1.0], 0.5, &mut posterior);
        assert!(elsewhere > 0.9, "{good:?}");
        let blind: Vec<Asked> = (0..50)
            .map(|i| {
                asked(
                    f64::from(i % 4),
                    &[f64::from((i + 1) % 4), f64::from((i + 2) % 4)],
                )
            })
            .collect();
        assert!(Temper::fit(&blind, PRIOR).scale < 0.2);
    }

    #[test]
    fn shares_add_up_to_one_even_for_extreme_scores() {
        let mut posterior = Vec::new();
        for scores in [&[1e6, -1e6][..], &[-1e6, -1e6], &[]] {
            let elsewhere = PRIOR.posterior_into(scores, 0.1, &mut posterior);
            let total: f64 = posterior.iter().sum::<f64>() + elsewhere;
            assert!((total - 1.0).abs() < 1e-12);
        }
    }
}

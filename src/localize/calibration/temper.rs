//! How much is a score worth as evidence?
//!
//! Features of one image are not independent, so a sum of their log ratios claims too much; and an image
//! in which little can be seen scores low at every place, its own among them. A [`Temper`] turns the
//! score `x_l` of each place into a posterior over places and "elsewhere":
//!
//! ```text
//! P(l)         ~ (1 - e) / N * exp(scale * x_l)
//! P(elsewhere) ~      e      * exp(bias + level * m)
//! ```
//!
//! with the prior probability `e` of being nowhere in a map of N places, and `m` the mean score of all
//! places but the best: what this image scores at places that it does not show. The three weights
//! minimise the log loss over held-out images, each asked twice: with its place in the map (the answer is
//! the place) and without it (the answer is elsewhere), both with e = 1/2. That loss is convex; a weak
//! normal prior keeps its minimum finite where there are few images. (Multinomial logistic regression;
//! with `scale` alone it is temperature scaling, Guo et al. 2017.)

use serde::{Deserialize, Serialize};

/// The worth of a score.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Temper {
    /// Nats of evidence a unit of score.
    pub scale: f64,
    /// Nats of evidence that "elsewhere" starts with.
    pub bias: f64,
    /// Nats of evidence for "elsewhere" a unit of what the other places score.
    pub level: f64,
}

/// The scores of one held-out image.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Of its own place; `None` if it was not asked with it.
    pub own: Option<f64>,
    /// Of the other places.
    pub others: Vec<f64>,
}

/// What one of the two questions says to the three weights.
struct Question {
    scores: Vec<f64>,
    level: f64,
    /// The right place's score; `None` for elsewhere.
    right: Option<f64>,
}

impl Question {
    /// With the image's place in the map, and without.
    fn both(asked: &Asked) -> impl Iterator<Item = Self> {
        let with_own = asked.own.map(|own| {
            let scores = (asked.others.iter().copied().chain(Some(own))).collect();
            Self::new(scores, Some(own))
        });
        with_own
            .into_iter()
            .chain(Some(Self::new(asked.others.clone(), None)))
    }

    fn new(scores: Vec<f64>, right: Option<f64>) -> Self {
        Self {
            level: level(&scores),
            scores,
            right,
        }
    }

    /// The log odds of each place, then of elsewhere, without what they share.
    fn logs(&self, temper: Temper) -> impl Iterator<Item = f64> + Clone {
        let log_n = (self.scores.len().max(1) as f64).ln();
        (self.scores.iter())
            .map(move |score| temper.scale * score - log_n)
            .chain(Some(temper.bias + temper.level * self.level))
    }
}

/// The mean score of all places but the best; 0 where there is at most one.
fn level(scores: &[f64]) -> f64 {
    if scores.len() < 2 {
        return 0.0;
    }
    let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (scores.iter().sum::<f64>() - best) / (scores.len() - 1) as f64
}

impl Temper {
    /// Fits `asked`, starting from (and drawn to) `prior`.
    pub fn fit(asked: &[Asked], prior: Self) -> Self {
        let questions: Vec<Question> = asked.iter().flat_map(Question::both).collect();
        let mut temper = prior;
        let mut loss = temper.loss(&questions, prior);
        for _ in 0..50 {
            let (gradient, hessian) = temper.derivatives(&questions, prior);
            let step = solve(hessian, gradient);
            // Newton's step, halved until the loss falls: it is convex, so this ends at its minimum.
            let mut share = 1.0;
            let improved = loop {
                let next = Self {
                    scale: (temper.scale - share * step[0]).max(1e-4),
                    bias: temper.bias - share * step[1],
                    level: temper.level - share * step[2],
                };
                let next_loss = next.loss(&questions, prior);
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
        let of_elsewhere = elsewhere.ln() + self.bias + self.level * level(scores);
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

    /// How far each weight is from the prior, in its widths.
    fn off(self, prior: Self) -> [(f64, f64); 3] {
        [
            (self.scale - prior.scale, prior.scale),
            (self.bias - prior.bias, BIAS_WIDTH),
            (self.level - prior.level, LEVEL_WIDTH),
        ]
    }

    fn loss(self, questions: &[Question], prior: Self) -> f64 {
        let drawn: f64 = (self.off(prior).iter())
            .map(|(by, width)| 0.5 * (by / width).powi(2))
            .sum();
        questions.iter().fold(drawn, |loss, question| {
            let right = match question.right {
                Some(own) => self.scale * own - (question.scores.len() as f64).ln(),
                None => self.bias + self.level * question.level,
            };
            loss + log_sum_exp(question.logs(self)) - right
        })
    }

    /// Gradient and Hessian of the loss.
    fn derivatives(self, questions: &[Question], prior: Self) -> ([f64; 3], [[f64; 3]; 3]) {
        let mut gradient = [0.0; 3];
        let mut hessian = [[0.0; 3]; 3];
        for (at, (by, width)) in self.off(prior).into_iter().enumerate() {
            gradient[at] = by / width.powi(2);
            hessian[at][at] = width.powi(-2);
        }
        for question in questions {
            let total = log_sum_exp(question.logs(self));
            let of_elsewhere = [0.0, 1.0, question.level];
            let what = (question.scores.iter())
                .map(|&score| [score, 0.0, 0.0])
                .chain(Some(of_elsewhere));
            let mut mean = [0.0; 3];
            for (log, what) in question.logs(self).zip(what) {
                let share = (log - total).exp();
                for i in 0..3 {
                    mean[i] += share * what[i];
                    for j in 0..3 {
                        hessian[i][j] += share * what[i] * what[j];
                    }
                }
            }
            let right = question.right.map_or(of_elsewhere, |own| [own, 0.0, 0.0]);
            for i in 0..3 {
                gradient[i] += mean[i] - right[i];
                for j in 0..3 {
                    hessian[i][j] -= mean[i] * mean[j];
                }
            }
        }
        (gradient, hessian)
    }
}

/// `a^-1 b` for a positive definite `a`, by elimination.
fn solve(mut a: [[f64; 3]; 3], mut b: [f64; 3]) -> [f64; 3] {
    for pivot in 0..3 {
        for row in pivot + 1..3 {
            let share = a[row][pivot] / a[pivot][pivot];
            let above = a[pivot];
            for (entry, above) in a[row].iter_mut().zip(above) {
                *entry -= share * above;
            }
            b[row] -= share * b[pivot];
        }
    }
    for row in (0..3).rev() {
        for column in row + 1..3 {
            b[row] -= a[row][column] * b[column];
        }
        b[row] /= a[row][row];
    }
    b
}

/// Standard deviations of bias and level before anything was asked.
const BIAS_WIDTH: f64 = 3.0;
const LEVEL_WIDTH: f64 = 0.5;

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
        level: 0.0,
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
        let questions: Vec<Question> = all.iter().flat_map(Question::both).collect();
        let moved = |weight: usize, by: f64| {
            let mut weights = [0.7, 0.4, 0.2];
            weights[weight] += by;
            let [scale, bias, level] = weights;
            Temper { scale, bias, level }
        };
        let step = 1e-5;
        let (gradient, hessian) = moved(0, 0.0).derivatives(&questions, PRIOR);
        for i in 0..3 {
            let [up, down] = [step, -step].map(|by| moved(i, by));
            let slope = (up.loss(&questions, PRIOR) - down.loss(&questions, PRIOR)) / (2.0 * step);
            assert!((slope - gradient[i]).abs() < 1e-6, "{i}: {slope}");
            let [up, down] = [up, down].map(|at| at.derivatives(&questions, PRIOR).0);
            for j in 0..3 {
                let bend = (up[j] - down[j]) / (2.0 * step);
                assert!((bend - hessian[i][j]).abs() < 1e-5, "{i} {j}: {bend}");
            }
        }
    }

    #[test]
    fn equations_are_solved() {
        let a = [[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]];
        let x = [1.0, -2.0, 0.5];
        let b = a.map(|row| row.iter().zip(&x).map(|(a, x)| a * x).sum());
        let solved = solve(a, b);
        assert!(solved.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn a_dark_image_is_judged_by_what_it_scores_elsewhere() {
        // Every third image scores 20 less at every place.
        let dark: Vec<Asked> = (0..60)
            .map(|i| {
                let dark = if i % 3 == 0 { -20.0 } else { 0.0 };
                asked(8.0 + dark, &[dark - 1.0, dark, dark + 1.0])
            })
            .collect();
        let temper = Temper::fit(&dark, PRIOR);
        assert!(temper.level > 0.2, "{temper:?}");
        let mut posterior = Vec::new();
        temper.posterior_into(&[-12.0, -20.0, -21.0], 0.5, &mut posterior);
        assert!(posterior[0] > 0.8, "{temper:?} {posterior:?}");
        let elsewhere = temper.posterior_into(&[-19.0, -20.0, -21.0], 0.5, &mut posterior);
        assert!(elsewhere > 0.8, "{temper:?} {elsewhere}");
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

//! How much is a score worth as evidence?
//!
//! Features of one image are not independent, so a sum of their log ratios claims too much; and an
//! image in which little can be seen scores low at every place, its own among them. A
//! [`PosteriorCalibration`] turns the score `x_l` of each place into a posterior over the places
//! and being off the map:
//!
//! ```text
//! P(l)       ~ (1 - e) / N * exp(scale * x_l)
//! P(off map) ~      e      * exp(bias + level * m)
//! ```
//!
//! with the prior probability `e` of being nowhere in a map of N places, and `m` the mean score of
//! all places but the best: what this image scores at places that it does not show. The three
//! weights minimise the log loss over held-out images, each of which counts as two cases: with its
//! place in the map (the answer is the place) and without it (the answer is off the map), both with
//! e = 1/2. That loss is convex; a weak normal prior keeps its minimum finite where there are few
//! images. (Multinomial logistic regression; with `scale` alone it is temperature scaling, Guo et
//! al. 2017.)

use serde::{Deserialize, Serialize};

use crate::localize::config::Score;

/// Log odds do not enter the posterior beyond this.
const MAX_LOG_ODDS: f64 = 60.0;

/// How much a score is worth as evidence (temperature scaling with a bias and a level).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PosteriorCalibration {
    /// Nats of evidence a unit of score.
    pub scale: f64,
    /// Nats of evidence that being off the map starts with.
    pub bias: f64,
    /// Nats of evidence for being off the map, a unit of what the other places score.
    pub level: f64,
}

/// The scores of one held-out image.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct HeldOutScores {
    /// Of its own place; `None` if it was not matched with it.
    pub(super) own: Option<f64>,
    /// Of the other places.
    pub(super) others: Vec<f64>,
}

/// A held-out image with its place in the map, or without: what the three weights are fitted to.
struct Case {
    scores: Vec<f64>,
    level: f64,
    /// The right place's score; `None` for off the map.
    right: Option<f64>,
}

impl Case {
    /// With the image's place in the map, and without.
    fn both(held_out: &HeldOutScores) -> impl Iterator<Item = Self> {
        let with_own = held_out.own.map(|own| {
            let scores = (held_out.others.iter().copied().chain(Some(own))).collect();
            Self::new(scores, Some(own))
        });
        with_own
            .into_iter()
            .chain(Some(Self::new(held_out.others.clone(), None)))
    }

    fn new(scores: Vec<f64>, right: Option<f64>) -> Self {
        Self {
            level: level(&scores),
            scores,
            right,
        }
    }

    /// The log odds of each place, then of being off the map, without what they share.
    fn logs(&self, calibration: PosteriorCalibration) -> impl Iterator<Item = f64> + Clone {
        let log_n = (self.scores.len().max(1) as f64).ln();
        (self.scores.iter())
            .map(move |score| calibration.scale * score - log_n)
            .chain(Some(calibration.bias + calibration.level * self.level))
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

impl PosteriorCalibration {
    /// Fits `held_out`, starting from (and drawn to) `prior`.
    pub(super) fn fit(held_out: &[HeldOutScores], prior: Self) -> Self {
        let cases: Vec<Case> = held_out.iter().flat_map(Case::both).collect();
        let mut fitted = prior;
        let mut loss = fitted.loss(&cases, prior);
        for _ in 0..50 {
            let (gradient, hessian) = fitted.derivatives(&cases, prior);
            let step = solve(hessian, gradient);
            // Newton's step, halved until the loss falls: it is convex, so this ends at its
            // minimum.
            let mut share = 1.0;
            let improved = loop {
                let next = Self {
                    scale: (fitted.scale - share * step[0]).max(1e-4),
                    bias: fitted.bias - share * step[1],
                    level: fitted.level - share * step[2],
                };
                let next_loss = next.loss(&cases, prior);
                if next_loss < loss - 1e-12 {
                    break Some((next, next_loss));
                }
                share /= 2.0;
                if share < 1e-6 {
                    break None;
                }
            };
            match improved {
                Some((next, next_loss)) => (fitted, loss) = (next, next_loss),
                None => break,
            }
        }
        fitted
    }

    /// Writes the posterior of each place and returns that of being off the map, whose prior
    /// probability is `off_map`.
    pub(in crate::localize) fn posterior_into(
        self,
        scores: &[f64],
        off_map: f64,
        out: &mut Vec<f64>,
    ) -> f64 {
        let prior = ((1.0 - off_map) / scores.len().max(1) as f64).ln();
        let of_off_map = off_map.ln() + self.bias + self.level * level(scores);
        out.clear();
        out.extend(scores.iter().map(|score| prior + self.scale * score));
        let most = out.iter().copied().fold(of_off_map, f64::max);
        let mut total = (of_off_map - most).exp();
        for share in out.iter_mut() {
            *share = (*share - most).exp();
            total += *share;
        }
        for share in out.iter_mut() {
            *share /= total;
        }
        (of_off_map - most).exp() / total
    }

    /// How far each weight is from the prior, in its widths.
    fn off(self, prior: Self) -> [(f64, f64); 3] {
        [
            (self.scale - prior.scale, prior.scale),
            (self.bias - prior.bias, BIAS_WIDTH),
            (self.level - prior.level, LEVEL_WIDTH),
        ]
    }

    fn loss(self, cases: &[Case], prior: Self) -> f64 {
        let drawn: f64 = (self.off(prior).iter())
            .map(|(by, width)| 0.5 * (by / width).powi(2))
            .sum();
        cases.iter().fold(drawn, |loss, case| {
            let right = match case.right {
                Some(own) => self.scale * own - (case.scores.len() as f64).ln(),
                None => self.bias + self.level * case.level,
            };
            loss + log_sum_exp(case.logs(self)) - right
        })
    }

    /// Gradient and Hessian of the loss.
    fn derivatives(self, cases: &[Case], prior: Self) -> ([f64; 3], [[f64; 3]; 3]) {
        let mut gradient = [0.0; 3];
        let mut hessian = [[0.0; 3]; 3];
        for (at, (by, width)) in self.off(prior).into_iter().enumerate() {
            gradient[at] = by / width.powi(2);
            hessian[at][at] = width.powi(-2);
        }
        for case in cases {
            let total = log_sum_exp(case.logs(self));
            let of_off_map = [0.0, 1.0, case.level];
            let what = (case.scores.iter())
                .map(|&score| [score, 0.0, 0.0])
                .chain(Some(of_off_map));
            let mut mean = [0.0; 3];
            for (log, what) in case.logs(self).zip(what) {
                let share = (log - total).exp();
                for i in 0..3 {
                    mean[i] += share * what[i];
                    for j in 0..3 {
                        hessian[i][j] += share * what[i] * what[j];
                    }
                }
            }
            let right = case.right.map_or(of_off_map, |own| [own, 0.0, 0.0]);
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

/// A score as it enters the posterior: log odds beyond what any image can prove count as that.
pub(in crate::localize) fn as_evidence(score: Score, value: f64) -> f64 {
    match score {
        Score::Count | Score::Inliers => value,
        Score::Likelihood => value.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS),
    }
}

/// What a score is taken to be worth before anything is learnt.
pub(super) fn prior_calibration(score: Score) -> PosteriorCalibration {
    match score {
        Score::Count | Score::Inliers => PosteriorCalibration {
            scale: 0.5,
            bias: 2.0,
            level: 0.0,
        },
        Score::Likelihood => PosteriorCalibration {
            scale: 0.5,
            bias: 1.0,
            level: 0.0,
        },
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

/// Standard deviations of bias and level before anything is learnt.
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

    const PRIOR: PosteriorCalibration = PosteriorCalibration {
        scale: 0.5,
        bias: 1.0,
        level: 0.0,
    };

    fn held_out(own: f64, others: &[f64]) -> HeldOutScores {
        HeldOutScores {
            own: Some(own),
            others: others.to_vec(),
        }
    }

    #[test]
    fn nothing_held_out_leaves_the_prior() {
        assert_eq!(PosteriorCalibration::fit(&[], PRIOR), PRIOR);
    }

    #[test]
    fn derivatives_are_those_of_the_loss() {
        let all = [held_out(3.0, &[0.0, 1.0]), held_out(1.0, &[2.0, -1.0])];
        let cases: Vec<Case> = all.iter().flat_map(Case::both).collect();
        let moved = |weight: usize, by: f64| {
            let mut weights = [0.7, 0.4, 0.2];
            weights[weight] += by;
            let [scale, bias, level] = weights;
            PosteriorCalibration { scale, bias, level }
        };
        let step = 1e-5;
        let (gradient, hessian) = moved(0, 0.0).derivatives(&cases, PRIOR);
        for i in 0..3 {
            let [up, down] = [step, -step].map(|by| moved(i, by));
            let slope = (up.loss(&cases, PRIOR) - down.loss(&cases, PRIOR)) / (2.0 * step);
            assert!((slope - gradient[i]).abs() < 1e-6, "{i}: {slope}");
            let [up, down] = [up, down].map(|at| at.derivatives(&cases, PRIOR).0);
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
    fn a_dark_image_is_judged_by_what_it_scores_at_other_places() {
        // Every third image scores 20 less at every place.
        let dark: Vec<HeldOutScores> = (0..60)
            .map(|i| {
                let dark = if i % 3 == 0 { -20.0 } else { 0.0 };
                held_out(8.0 + dark, &[dark - 1.0, dark, dark + 1.0])
            })
            .collect();
        let calibration = PosteriorCalibration::fit(&dark, PRIOR);
        assert!(calibration.level > 0.2, "{calibration:?}");
        let mut posterior = Vec::new();
        calibration.posterior_into(&[-12.0, -20.0, -21.0], 0.5, &mut posterior);
        assert!(posterior[0] > 0.8, "{calibration:?} {posterior:?}");
        let off_map = calibration.posterior_into(&[-19.0, -20.0, -21.0], 0.5, &mut posterior);
        assert!(off_map > 0.8, "{calibration:?} {off_map}");
    }

    #[test]
    fn a_score_that_tells_places_apart_is_believed_and_one_that_does_not_is_not() {
        let distinct: Vec<HeldOutScores> =
            (0..50).map(|_| held_out(8.0, &[0.0, 1.0, -1.0])).collect();
        let good = PosteriorCalibration::fit(&distinct, PRIOR);
        let mut posterior = Vec::new();
        let off_map = good.posterior_into(&[8.0, 0.0, 1.0], 0.5, &mut posterior);
        assert!(posterior[0] > 0.9 && off_map < 0.1, "{good:?}");
        let off_map = good.posterior_into(&[1.0, 0.0, -1.0], 0.5, &mut posterior);
        assert!(off_map > 0.9, "{good:?}");
        let blind: Vec<HeldOutScores> = (0..50)
            .map(|i| {
                held_out(
                    f64::from(i % 4),
                    &[f64::from((i + 1) % 4), f64::from((i + 2) % 4)],
                )
            })
            .collect();
        assert!(PosteriorCalibration::fit(&blind, PRIOR).scale < 0.2);
    }

    #[test]
    fn shares_add_up_to_one_even_for_extreme_scores() {
        let mut posterior = Vec::new();
        for scores in [&[1e6, -1e6][..], &[-1e6, -1e6], &[]] {
            let off_map = PRIOR.posterior_into(scores, 0.1, &mut posterior);
            let total: f64 = posterior.iter().sum::<f64>() + off_map;
            assert!((total - 1.0).abs() < 1e-12);
        }
    }
}

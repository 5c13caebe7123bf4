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
//! with the prior probability `e` of being nowhere in a map of N places, and `m` what the image would
//! score at the best place if it did not show it: what that place scores in an image in which
//! nothing of it is found, `n_l`, and the mean of `x_l - n_l` over all other places, which it does
//! not show. (The scores of the others alone will not do: a place of few features loses less by
//! missing them all, so that images of nowhere would all be taken for it.) The three weights minimise the log loss over held-out images, each of which counts as two cases: with its
//! place in the map and without it, both with e = 1/2. In the first case the right answer is the
//! place or one that looks alike because it is next to it; in the second, which leaves these out
//! too, it is off the map. (Multinomial logistic regression; with `scale` alone it is temperature
//! scaling, Guo et al. 2017.)
//!
//! Which of the places that look alike it is, is another question, and an image says less about it
//! than about the whole neighbourhood of the best place: there its probability is shared out anew,
//! by `exp(near * scale * x_l)` ([`share_near`](PosteriorCalibration::share_near)).
//!
//! All four weights are drawn to what is usual over many maps by a normal prior, whose widths are
//! the spread between those maps: a map of one visit has the usual weights, one of a thousand its
//! own, and each image that is held out moves them a little.

use serde::{Deserialize, Serialize};

use crate::localize::config::Score;

/// Log odds beyond this enter the posterior by a quarter: features are not independent, but of two
/// places that are both beyond all doubt the better one is still the better one.
const LARGE_LOG_ODDS: f64 = 60.0;
const SLOPE_BEYOND: f64 = 0.25;

/// How much a score is worth as evidence (temperature scaling with a bias and a level).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PosteriorCalibration {
    /// Nats of evidence a unit of score.
    pub scale: f64,
    /// Nats of evidence that being off the map starts with.
    pub bias: f64,
    /// Nats of evidence for being off the map, a unit of what the image would score at a place that
    /// it does not show.
    pub level: f64,
    /// How much of the evidence tells places that look alike apart.
    pub near: f64,
}

/// The score of one place, as evidence.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::localize) struct PlaceEvidence {
    pub(in crate::localize) score: f64,
    /// What it scores in an image in which nothing of it is found.
    pub(in crate::localize) of_nothing: f64,
}

impl PlaceEvidence {
    /// What the image adds to nothing.
    fn gain(self) -> f64 {
        self.score - self.of_nothing
    }
}

/// The scores of one held-out image.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct HeldOutScores {
    /// Of its own place; `None` if it was not matched with it.
    pub(super) own: Option<PlaceEvidence>,
    /// Of the places next to it that look alike.
    pub(super) alike: Vec<PlaceEvidence>,
    /// Of the other places.
    pub(super) others: Vec<PlaceEvidence>,
}

/// A held-out image with its place in the map, or without: what the weights are fitted to.
struct Case {
    /// The right places' first.
    scores: Vec<f64>,
    level: f64,
    /// How many of the scores are of right places; 0 for off the map.
    num_right: usize,
    /// How much it counts.
    weight: f64,
}

impl Case {
    /// Each image with its place in the map, and without.
    ///
    /// Images without a right answer are weighed so that they do not outnumber those with one by
    /// more than [`SPARE_CASES`]: to be off the map would else be the answer that costs least. (In
    /// a map of one run nothing is left of an image's own place; the places next to it, of the same
    /// minute, are matched far better than any image of the field, and are no right answer.)
    fn of(held_out: &[HeldOutScores]) -> Vec<Self> {
        let num_right = |it: &HeldOutScores| it.own.map_or(0, |_| 1 + it.alike.len());
        let num_inside = held_out.iter().filter(|it| num_right(it) > 0).count();
        let weight = (num_inside as f64 + SPARE_CASES) / held_out.len().max(1) as f64;
        let cases = held_out.iter().flat_map(|it| {
            let inside = (num_right(it) > 0).then(|| {
                let right = it.own.iter().chain(&it.alike);
                let scores = right.chain(&it.others).copied().collect();
                Self::new(scores, num_right(it), 1.0)
            });
            let outside = Self::new(it.others.clone(), 0, weight.min(1.0));
            inside.into_iter().chain(Some(outside))
        });
        cases.collect()
    }

    fn new(scores: Vec<PlaceEvidence>, num_right: usize, weight: f64) -> Self {
        Self {
            level: level(&scores, 0),
            scores: scores.into_iter().map(|it| it.score).collect(),
            num_right,
            weight,
        }
    }

    /// The log odds of each place, then of being off the map, without what they share.
    fn logs(&self, calibration: PosteriorCalibration) -> impl Iterator<Item = f64> + Clone {
        let log_n = (self.scores.len().max(1) as f64).ln();
        (self.scores.iter())
            .map(move |score| calibration.scale * score - log_n)
            .chain(Some(calibration.bias + calibration.level * self.level))
    }

    /// Those of the right answers.
    fn right_logs(&self, calibration: PosteriorCalibration) -> impl Iterator<Item = f64> + Clone {
        let right = match self.num_right {
            0 => self.scores.len()..self.scores.len() + 1,
            num => 0..num,
        };
        (self.logs(calibration).skip(right.start)).take(right.len())
    }
}

/// What the image would score at its best place if it did not show it; 0 where there is at most
/// one place. `num_others` places score what the worst does.
fn level(scores: &[PlaceEvidence], num_others: usize) -> f64 {
    let better = |a: PlaceEvidence, b: PlaceEvidence| if b.score > a.score { b } else { a };
    let Some(best) = scores.iter().copied().reduce(better) else {
        return 0.0;
    };
    let num_places = scores.len() + num_others;
    if num_places < 2 {
        return 0.0;
    }
    let mut total: f64 = scores.iter().map(|it| it.gain()).sum();
    if num_others > 0 {
        total += num_others as f64 * worst(scores).gain();
    }
    best.of_nothing + (total - best.gain()) / (num_places - 1) as f64
}

/// The score of the place that scores least.
fn worst(scores: &[PlaceEvidence]) -> PlaceEvidence {
    let less = |a: PlaceEvidence, b: PlaceEvidence| if b.score < a.score { b } else { a };
    scores.iter().copied().reduce(less).unwrap_or_default()
}

impl PosteriorCalibration {
    /// Fits `held_out`, starting from (and drawn to) `prior`.
    pub(super) fn fit(held_out: &[HeldOutScores], prior: Self) -> Self {
        let cases = Case::of(held_out);
        let mut fitted = prior;
        let mut loss = fitted.loss(&cases, prior);
        for _ in 0..50 {
            let (gradient, hessian) = fitted.derivatives(&cases, prior);
            let step = solve(hessian, gradient);
            // Newton's step, halved until the loss falls.
            let mut share = 1.0;
            let improved = loop {
                let next = Self {
                    scale: (fitted.scale - share * step[0]).max(1e-4),
                    bias: fitted.bias - share * step[1],
                    level: fitted.level - share * step[2],
                    near: fitted.near,
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
        fitted.near = near(held_out, fitted.scale, prior.near);
        fitted
    }

    /// Writes the posterior of each place and returns that of being off the map, whose prior
    /// probability is `off_map`. `num_others` places were not worth matching: they count as the
    /// worst one that was.
    pub(in crate::localize) fn posterior_into(
        self,
        scores: &[PlaceEvidence],
        num_others: usize,
        off_map: f64,
        out: &mut Vec<f64>,
    ) -> f64 {
        let prior = ((1.0 - off_map) / (scores.len() + num_others).max(1) as f64).ln();
        let of_off_map = off_map.ln() + self.bias + self.level * level(scores, num_others);
        out.clear();
        out.extend(scores.iter().map(|it| prior + self.scale * it.score));
        let most = out.iter().copied().fold(of_off_map, f64::max);
        let mut total = (of_off_map - most).exp();
        for share in out.iter_mut() {
            *share = (*share - most).exp();
            total += *share;
        }
        if num_others > 0 {
            let log = prior + self.scale * worst(scores).score;
            total += num_others as f64 * (log - most).exp();
        }
        for share in out.iter_mut() {
            *share /= total;
        }
        (of_off_map - most).exp() / total
    }

    /// Shares the probability of places that look alike out anew: `members`, positions in `scores`
    /// and `posterior`, are the best place and those around it.
    pub(in crate::localize) fn share_near(
        self,
        scores: &[PlaceEvidence],
        members: impl Iterator<Item = usize> + Clone,
        posterior: &mut [f64],
    ) {
        let total: f64 = members.clone().map(|at| posterior[at]).sum();
        let log = |at: usize| self.near * self.scale * scores[at].score;
        let all = log_sum_exp(members.clone().map(log));
        for at in members {
            posterior[at] = total * (log(at) - all).exp();
        }
    }

    /// How far each weight is from the prior, and its width.
    fn off(self, prior: Self) -> [(f64, f64); 3] {
        [
            (self.scale - prior.scale, SCALE_WIDTH * prior.scale),
            (self.bias - prior.bias, BIAS_WIDTH),
            (self.level - prior.level, LEVEL_WIDTH),
        ]
    }

    fn loss(self, cases: &[Case], prior: Self) -> f64 {
        let drawn: f64 = (self.off(prior).iter())
            .map(|(by, width)| 0.5 * (by / width).powi(2))
            .sum();
        cases.iter().fold(drawn, |loss, case| {
            loss + case.weight * (log_sum_exp(case.logs(self)) - log_sum_exp(case.right_logs(self)))
        })
    }

    /// Gradient of the loss, and the Hessian without what several right answers take from it: no
    /// smaller than the whole one, so that Newton's step goes downhill where the loss is not convex.
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
                let share = case.weight * (log - total).exp();
                for i in 0..3 {
                    mean[i] += share * what[i];
                    for j in 0..3 {
                        hessian[i][j] += share * what[i] * what[j];
                    }
                }
            }
            let mut right = of_off_map;
            if case.num_right > 0 {
                let total = log_sum_exp(case.right_logs(self));
                let shares = case.right_logs(self).map(|log| (log - total).exp());
                right = [0.0; 3];
                right[0] = (shares.zip(&case.scores).map(|(share, score)| share * score)).sum();
            }
            for i in 0..3 {
                gradient[i] += mean[i] - case.weight * right[i];
                for j in 0..3 {
                    hessian[i][j] -= mean[i] * mean[j] / case.weight;
                }
            }
        }
        (gradient, hessian)
    }
}

/// A score as it enters the posterior, and the log odds of an image in which nothing of the place
/// is found: log odds beyond what any image can prove count as that.
pub(in crate::localize) fn as_evidence(score: Score, value: f64, of_nothing: f64) -> PlaceEvidence {
    let bounded = |value: f64| {
        if value > LARGE_LOG_ODDS {
            LARGE_LOG_ODDS + SLOPE_BEYOND * (value - LARGE_LOG_ODDS)
        } else {
            value.max(-LARGE_LOG_ODDS)
        }
    };
    match score {
        Score::Count | Score::Inliers => PlaceEvidence {
            score: value,
            of_nothing: 0.0,
        },
        Score::Likelihood => PlaceEvidence {
            score: bounded(value),
            of_nothing: bounded(of_nothing),
        },
    }
}

/// What a score is usually worth: chosen so that maps of one to six visits of the development sets
/// accept at most about 3 % of the images of another set (eval/METHODOLOGY.md).
pub(super) fn prior_calibration(score: Score) -> PosteriorCalibration {
    match score {
        Score::Count => PosteriorCalibration {
            scale: 0.5,
            bias: 2.0,
            level: 0.0,
            near: NEAR,
        },
        Score::Inliers => PosteriorCalibration {
            scale: 0.8,
            bias: 4.0,
            level: 0.0,
            near: NEAR,
        },
        Score::Likelihood => PosteriorCalibration {
            scale: 1.0,
            bias: 2.0,
            level: 1.0,
            near: NEAR,
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

/// The usual worth of evidence between places that look alike, and the factor within which it is in
/// two maps out of three.
const NEAR: f64 = 0.3;
const NEAR_SPREAD: f64 = 3.0;

/// What part of the evidence tells places that look alike apart: the `near` of the least log loss
/// over held-out images, by golden section in its logarithm.
fn near(held_out: &[HeldOutScores], scale: f64, usual: f64) -> f64 {
    if !(held_out.iter()).any(|it| it.own.is_some() && !it.alike.is_empty()) {
        return usual;
    }
    let loss = |log_near: f64| {
        let near = log_near.exp();
        let drawn = 0.5 * ((log_near - usual.ln()) / NEAR_SPREAD.ln()).powi(2);
        (held_out.iter().filter(|it| !it.alike.is_empty())).fold(drawn, |loss, it| {
            let Some(own) = it.own else { return loss };
            let log = |it: PlaceEvidence| near * scale * it.score;
            let all = std::iter::once(own).chain(it.alike.iter().copied());
            loss + log_sum_exp(all.map(log)) - log(own)
        })
    };
    let golden = (5.0_f64.sqrt() - 1.0) / 2.0;
    let (mut low, mut high) = (0.01_f64.ln(), 0.0);
    while high - low > 1e-3 {
        let step = golden * (high - low);
        if loss(high - step) < loss(low + step) {
            high = low + step;
        } else {
            low = high - step;
        }
    }
    (0.5 * (low + high)).exp()
}

/// So many images off the map count although there are none with a right answer.
const SPARE_CASES: f64 = 2.0;
/// Standard deviation of the scale, in units of the usual one; of bias and level.
const SCALE_WIDTH: f64 = 0.3;
const BIAS_WIDTH: f64 = 1.0;
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
        near: NEAR,
    };

    /// Of places that say nothing where nothing of them is found.
    fn scored(scores: &[f64]) -> Vec<PlaceEvidence> {
        let of_nothing = 0.0;
        let with = |&score: &f64| PlaceEvidence { score, of_nothing };
        scores.iter().map(with).collect()
    }

    fn held_out(own: f64, others: &[f64]) -> HeldOutScores {
        HeldOutScores {
            own: Some(scored(&[own])[0]),
            alike: Vec::new(),
            others: scored(others),
        }
    }

    #[test]
    fn nothing_held_out_leaves_the_prior() {
        assert_eq!(PosteriorCalibration::fit(&[], PRIOR), PRIOR);
    }

    #[test]
    fn derivatives_are_those_of_the_loss() {
        let cases = Case::of(&[held_out(3.0, &[0.0, 1.0]), held_out(1.0, &[2.0, -1.0])]);
        let moved = |weight: usize, by: f64| {
            let mut weights = [0.7, 0.4, 0.2];
            weights[weight] += by;
            let [scale, bias, level] = weights;
            PosteriorCalibration {
                scale,
                bias,
                level,
                near: NEAR,
            }
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
    fn neighbours_that_look_alike_are_right_answers_and_share_what_they_get() {
        // The place next door scores nearly as much as the own one, others nothing.
        let overlapping = |i: usize| HeldOutScores {
            alike: scored(&[11.0]),
            ..held_out(10.0 + (i % 3) as f64, &[0.0, 1.0, -1.0])
        };
        let images: Vec<HeldOutScores> = (0..60).map(overlapping).collect();
        let calibration = PosteriorCalibration::fit(&images, PRIOR);
        let mut posterior = Vec::new();
        let scores = scored(&[11.0, 10.0, 0.0, 1.0]);
        let off_map = calibration.posterior_into(&scores, 0, 0.1, &mut posterior);
        let (both, first) = (posterior[0] + posterior[1], posterior[0]);
        assert!(
            both > 0.99 && off_map < 0.01,
            "{calibration:?} {posterior:?}"
        );
        calibration.share_near(&scores, [0, 1].into_iter(), &mut posterior);
        assert!((posterior[0] + posterior[1] - both).abs() < 1e-12);
        assert!(posterior[0] < first && posterior[0] > posterior[1]);
    }

    #[test]
    fn images_of_one_run_alone_do_not_outvote_what_is_usual() {
        let others = vec![6.0, 0.0, -1.0, 0.0];
        let image = HeldOutScores {
            own: None,
            alike: scored(&[40.0]),
            others: scored(&others),
        };
        let calibration = PosteriorCalibration::fit(&vec![image; 40], PRIOR);
        assert!(calibration.scale > 0.5 * PRIOR.scale, "{calibration:?}");
        assert!(calibration.bias < PRIOR.bias + 2.0, "{calibration:?}");
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
        calibration.posterior_into(&scored(&[-12.0, -20.0, -21.0]), 0, 0.5, &mut posterior);
        assert!(posterior[0] > 0.8, "{calibration:?} {posterior:?}");
        let off_map =
            calibration.posterior_into(&scored(&[-19.0, -20.0, -21.0]), 0, 0.5, &mut posterior);
        assert!(off_map > 0.8, "{calibration:?} {off_map}");
    }

    #[test]
    fn an_image_of_nowhere_is_not_taken_for_the_place_that_has_least_to_miss() {
        let calibration = prior_calibration(Score::Likelihood);
        let place = |score: f64, of_nothing: f64| PlaceEvidence { score, of_nothing };
        let mut posterior = Vec::new();
        let scores = [place(-9.0, -11.0), place(-27.0, -29.0), place(-27.5, -29.0)];
        let off_map = calibration.posterior_into(&scores, 0, 0.1, &mut posterior);
        assert!(off_map > posterior[0], "{off_map} {posterior:?}");
        let scores = [place(9.0, -11.0), scores[1], scores[2]];
        let off_map = calibration.posterior_into(&scores, 0, 0.1, &mut posterior);
        assert!(off_map < 0.01 && posterior[0] > 0.99, "{off_map}");
    }

    #[test]
    fn a_score_that_tells_places_apart_is_believed_and_one_that_does_not_is_not() {
        let distinct: Vec<HeldOutScores> =
            (0..50).map(|_| held_out(8.0, &[0.0, 1.0, -1.0])).collect();
        let good = PosteriorCalibration::fit(&distinct, PRIOR);
        let mut posterior = Vec::new();
        let off_map = good.posterior_into(&scored(&[8.0, 0.0, 1.0]), 0, 0.5, &mut posterior);
        assert!(posterior[0] > 0.9 && off_map < 0.1, "{good:?}");
        let off_map = good.posterior_into(&scored(&[1.0, 0.0, -1.0]), 0, 0.5, &mut posterior);
        assert!(off_map > 0.9, "{good:?}");
        let blind: Vec<HeldOutScores> = (0..200)
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
    fn places_that_were_not_matched_count_as_the_worst_that_was() {
        let calibration = prior_calibration(Score::Likelihood);
        let listed = scored(&[14.0, 3.0, -2.0, 1.0]);
        let mut all = listed.clone();
        all.extend(vec![listed[2]; 500]);
        let (mut some, mut whole) = (Vec::new(), Vec::new());
        let off_map = calibration.posterior_into(&listed, 500, 0.1, &mut some);
        let off_map_of_all = calibration.posterior_into(&all, 0, 0.1, &mut whole);
        assert!((off_map - off_map_of_all).abs() < 1e-12);
        assert_eq!(some.len(), 4);
        for (a, b) in some.iter().zip(&whole) {
            assert!((a - b).abs() < 1e-12, "{some:?}");
        }
    }

    #[test]
    fn shares_add_up_to_one_even_for_extreme_scores() {
        let mut posterior = Vec::new();
        for scores in [&[1e6, -1e6][..], &[-1e6, -1e6], &[]] {
            let off_map = PRIOR.posterior_into(&scored(scores), 0, 0.1, &mut posterior);
            let total: f64 = posterior.iter().sum::<f64>() + off_map;
            assert!((total - 1.0).abs() < 1e-12);
        }
    }
}

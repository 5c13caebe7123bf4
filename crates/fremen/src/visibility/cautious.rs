//! What should be said of times and states that were hardly ever sampled?
//!
//! Round any model `p_0(t)`: nothing is certain because a few looks agreed, and nothing is known of
//! hours, weekdays and seasons that nobody has seen.
//!
//! - *Looks.* Bursts are one look ([`independence`](super::independence)), and so is an hour at
//!   most: a state was looked at N times, and the share m was 1.
//! - *Hours.* [`Coverage`] says how well moments like t were sampled, `c(t)` from 0 to 1. The model
//!   is believed so far, and the mean for the rest: `q = m + c (p_0 - m)`.
//! - *Prior.* `p = (N q + 1/2) / (N + 1)`, the mean of a Beta distribution with the prior of
//!   Krichevsky and Trofimov: one look at a 1 gives 3/4, twenty at a 0 give 0.02.
//! - *Interval.* Of Wilson (1927), at 95 %, for p and `n = 1 + M c / (1 + 2 l)` looks, where l is
//!   the order: a model with l rhythms spends its looks on 1 + 2 l numbers. M is less than N where
//!   residuals r of one day repeat each other: by `phi = sum over days of (sum of w r)^2 / sum of
//!   w r^2`, at least 1, `M = sum of w / phi`.
//!
//! Season counts in the interval always, and in p only where the model has a rhythm of the year: a
//! day goes on in the next month, but how the year goes is not known from one of its parts.
//!
//! Not for the papers' models where their own numbers are wanted: [`fit`](super::fit) gives those.

use super::coverage::Coverage;
use super::evidence::Evidence;
use super::independence::weights;
use super::{Estimate, VisibilityModel, codec};
use crate::error::Result;
use crate::spectrum::{Component, Reader};
use crate::time::{Period, Time};

/// The quantile of the normal distribution for 95 %.
const Z: f64 = 1.959_963_984_540_054;

/// Rhythms as slow as half a year are rhythms of the year.
const YEARLY_S: f64 = 15_778_476.0;

/// The least of its looks that another season leaves.
const OTHER_SEASON: f64 = 0.1;

/// A model that is believed as far as its visits reach; 24 bytes a feature and about 700 more than
/// the model.
#[derive(Debug)]
pub struct Cautious {
    of: Box<dyn VisibilityModel>,
    coverage: Coverage,
    features: Vec<Known>,
    /// Whether any feature follows a rhythm of the year.
    has_year: bool,
}

/// What is known of one feature.
#[derive(Clone, Copy, Debug)]
struct Known {
    /// The share of looks at which it was seen.
    share: f64,
    /// Looks, an hour or a burst being one.
    looks: f64,
    /// Looks that do not repeat others of their day.
    independent: f64,
}

/// O(visits x features).
pub(super) fn fit(evidence: &Evidence<'_>, of: Box<dyn VisibilityModel>) -> Cautious {
    let times: Vec<Time> = evidence.times().collect();
    let weights = weights(&times);
    let mut by_time: Vec<usize> = (0..times.len()).collect();
    by_time.sort_by_key(|&index| (times[index], index));
    let mut sums = Sums::new(of.num_features());
    let mut p = vec![0.0; of.num_features()];
    let mut today = None;
    for index in by_time {
        let since_us = i128::from(times[index].as_us()) - i128::from(sums.origin(times[index]));
        let day = since_us / i128::from(Period::DAY.as_us());
        let hour = since_us / i128::from(Period::HOUR.as_us());
        if today != Some(day) {
            sums.end_day();
            today = Some(day);
        }
        of.predict_into(times[index], &mut p);
        evidence.for_each_state(evidence.visits[index], |feature, state| {
            sums.add(feature, (state, p[feature]), weights[index], hour);
        });
    }
    sums.end_day();
    Cautious {
        coverage: Coverage::new(times.iter().copied()),
        features: sums.features(),
        has_year: has_year(&*of),
        of,
    }
}

/// Whether any feature follows a rhythm of the year.
fn has_year(model: &dyn VisibilityModel) -> bool {
    (0..model.num_features()).any(|feature| {
        let components = model.components(feature);
        components.iter().any(|it| it.period_s >= YEARLY_S)
    })
}

/// What the visits add up to, feature by feature.
struct Sums {
    first_us: Option<i64>,
    weight: Vec<f64>,
    seen: Vec<f64>,
    /// Hours with a look, and the last of them.
    hours: Vec<f64>,
    last_hour: Vec<Option<i128>>,
    /// Residuals of this day, their squares by day, and those of single visits.
    today: Vec<f64>,
    of_days: Vec<f64>,
    of_visits: Vec<f64>,
}

impl Sums {
    fn new(count: usize) -> Self {
        let zeros = || vec![0.0; count];
        Self {
            first_us: None,
            weight: zeros(),
            seen: zeros(),
            hours: zeros(),
            last_hour: vec![None; count],
            today: zeros(),
            of_days: zeros(),
            of_visits: zeros(),
        }
    }

    /// When days begin.
    fn origin(&mut self, time: Time) -> i64 {
        *self.first_us.get_or_insert(time.as_us())
    }

    fn add(&mut self, feature: usize, (state, p): (bool, f64), weight: f64, hour: i128) {
        if self.last_hour[feature] != Some(hour) {
            self.last_hour[feature] = Some(hour);
            self.hours[feature] += 1.0;
        }
        let state = f64::from(u8::from(state));
        let residual = state - p;
        self.weight[feature] += weight;
        self.seen[feature] += weight * state;
        self.today[feature] += weight * residual;
        self.of_visits[feature] += weight * residual * residual;
    }

    fn end_day(&mut self) {
        for (today, of_days) in self.today.iter_mut().zip(&mut self.of_days) {
            *of_days += *today * *today;
            *today = 0.0;
        }
    }

    fn features(&self) -> Vec<Known> {
        (0..self.weight.len())
            .map(|feature| {
                let weight = self.weight[feature];
                if weight <= 0.0 {
                    return Known {
                        share: 0.5,
                        looks: 0.0,
                        independent: 0.0,
                    };
                }
                let of_visits = self.of_visits[feature];
                let dispersion = if of_visits > 1e-12 {
                    (self.of_days[feature] / of_visits).max(1.0)
                } else {
                    1.0
                };
                Known {
                    share: (self.seen[feature] / weight).clamp(0.0, 1.0),
                    looks: weight.min(self.hours[feature]),
                    independent: weight / dispersion,
                }
            })
            .collect()
    }
}

impl Cautious {
    /// The share of independent looks at which a feature was seen; 1/2 if it was never observed.
    ///
    /// # Panics
    /// If there is no such feature.
    pub fn share(&self, feature: usize) -> f64 {
        self.features[feature].share
    }

    /// What is believed of p, and how many of a feature's looks speak of moments like this.
    fn reach(&self, time: Time) -> (f64, f64) {
        let support = self.coverage.at(time);
        let season = if self.has_year { support.season } else { 1.0 };
        let believed = support.habit * season;
        (believed, support.habit * support.season.max(OTHER_SEASON))
    }

    pub(super) fn read(reader: &mut Reader<'_>, of: Box<dyn VisibilityModel>) -> Result<Self> {
        let coverage = Coverage::read(reader)?;
        let count = reader.count(24)?;
        if count != of.num_features() {
            return Err(reader.impossible("features and those of the model differ"));
        }
        let numbers = reader.floats(3 * count)?;
        let features: Vec<Known> = (numbers.chunks_exact(3))
            .map(|it| Known {
                share: it[0],
                looks: it[1],
                independent: it[2],
            })
            .collect();
        let is_count = |it: f64| it.is_finite() && it >= 0.0;
        let is_sound = |it: &Known| {
            (0.0..=1.0).contains(&it.share) && is_count(it.looks) && is_count(it.independent)
        };
        if !features.iter().all(is_sound) {
            return Err(reader.impossible("these are no looks at a state"));
        }
        Ok(Self {
            has_year: has_year(&*of),
            of,
            coverage,
            features,
        })
    }
}

impl Known {
    fn p(self, model: f64, believed: f64) -> f64 {
        let q = self.share + believed * (model.clamp(0.0, 1.0) - self.share);
        ((self.looks * q + 0.5) / (self.looks + 1.0)).clamp(0.0, 1.0)
    }
}

impl VisibilityModel for Cautious {
    fn num_features(&self) -> usize {
        self.features.len()
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        self.of.predict_into(time, out);
        let (believed, _) = self.reach(time);
        for (p, known) in out.iter_mut().zip(&self.features) {
            *p = known.p(*p, believed);
        }
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        let (believed, _) = self.reach(time);
        self.features[feature].p(self.of.predict_one(feature, time), believed)
    }

    fn estimate(&self, feature: usize, time: Time) -> Estimate {
        let p = self.predict_one(feature, time);
        let (_, reach) = self.reach(time);
        let spent = 1.0 + 2.0 * self.of.order() as f64;
        let looks = 1.0 + self.features[feature].independent * reach / spent;
        let shrink = 1.0 + Z * Z / looks;
        let middle = (p + Z * Z / (2.0 * looks)) / shrink;
        let variance = p * (1.0 - p) / looks + Z * Z / (4.0 * looks * looks);
        let half = Z * variance.sqrt() / shrink;
        Estimate {
            p,
            low: (middle - half).clamp(0.0, p),
            high: (middle + half).clamp(p, 1.0),
        }
    }

    fn order(&self) -> usize {
        self.of.order()
    }

    fn level(&self, feature: usize) -> Option<f64> {
        self.of.level(feature)
    }

    fn components(&self, feature: usize) -> Vec<Component> {
        self.of.components(feature)
    }

    fn mean(&self, feature: usize) -> Option<f64> {
        Some(self.share(feature))
    }

    /// `None` if the model inside has no such form.
    fn encode(&self) -> Option<Vec<u8>> {
        let of = self.of.encode()?;
        Some(codec::encode(codec::Kind::Cautious, |writer| {
            writer.bytes(&of);
            self.coverage.write(writer);
            writer.varint(self.features.len() as u64);
            let numbers = self
                .features
                .iter()
                .flat_map(|it| [it.share, it.looks, it.independent]);
            writer.floats(numbers);
        }))
    }
}

//! How often are features found, at their place and elsewhere, and what does that say?
//!
//! A [`Calibration`] is what a localizer knows of its own evidence. It is learnt in `learn.rs`;
//! here it is read:
//!
//! - the *detection curve*: how often a feature of a given score is found at its place ([`Curve`]),
//!   and how much more or less often than that at each single place;
//! - for every feature, how often it is found where it is not (`q_f`), drawn to the mean over all
//!   features by [`FALSE_RATE_PRIOR`] trials;
//! - how often a feature that is not found has an outlier match, one that does not agree with the
//!   others: at each place in images of others, and how much more often in its own;
//! - how much a matching distance tells: g1 (seen again) against g0 (found at wrong places);
//! - how much a displacement tells: the camera's spread between visits against anywhere;
//! - how much of what was learnt of the map alone is believed: by the visits of its places, and not
//!   by how many images there are, since those of one run share their weather;
//! - what a score is worth as evidence ([`PosteriorCalibration`]), for each score and several n.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::conditions::{Conditions, PRIOR};
use super::curve::Curve;
use super::posterior::{PosteriorCalibration, prior_calibration};
use crate::feature::FeaturesView;
use crate::localize::config::{EvidencePart, Score};
use crate::localize::neighbours::Neighbours;
use crate::map::{NodeId, Snapshot};
use crate::matching::Displacement;

/// So many trials at the mean rate are added to those of each feature.
pub(super) const FALSE_RATE_PRIOR: f64 = 20.0;
/// So many times as many more where nothing was held out: what is found elsewhere is then also what
/// is found again.
const FEW_VISITS_PRIOR: f64 = 4.0;
/// The rate of false matches while nothing is known.
pub(super) const FALSE_RATE: f64 = 0.01;
const FALSE_RATES: std::ops::RangeInclusive<f64> = 0.001..=0.9;
pub(super) const MAX_OUTLIER_RATE: f64 = 0.9;
/// The share of visits whose displacement may be anything.
const UNIFORM_SHARE: f64 = 0.1;
/// Numbers of features at which the worth of scores is learnt.
pub(super) const SIZES: [usize; 8] = [10, 20, 30, 50, 100, 200, 300, 600];

/// What a [`Localizer`](crate::localize::Localizer) knows about its own evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    pub(super) detection: Curve,
    /// How often each of the conditions is met under which images are taken.
    pub(super) conditions: Conditions,
    /// How far these are apart, as a power.
    pub(super) spread: f64,
    /// How much more often than that features of each place are found.
    pub(super) repeatability: Vec<f64>,
    pub(super) false_rate: f64,
    /// The same at each place, drawn to the mean over all of them.
    pub(super) place_false_rates: Vec<f64>,
    /// What each place scores in images that do not show it, on average.
    pub(super) levels: Vec<f64>,
    /// Of each place and hypothesis (its predicted map, or each visit): trials of each feature.
    pub(super) false_counts: Vec<Vec<Vec<Trials>>>,
    /// How often a feature that is not found has an outlier match, at each place in images of
    /// others.
    #[serde(rename = "stray_rates")]
    pub(super) outlier_rates: Vec<f64>,
    /// How much more often it does in images of its own place.
    #[serde(rename = "stray_ratio")]
    pub(super) outlier_ratio: f64,
    pub(super) distance_log_ratios: Vec<f64>,
    pub(super) displacement: Option<DisplacementPrior>,
    /// Whether features that were seen together are expected together.
    #[serde(rename = "hears_witnesses")]
    pub(super) uses_references: bool,
    /// For each score, at each of [`SIZES`].
    #[serde(rename = "tempers")]
    pub(super) posteriors: [[PosteriorCalibration; SIZES.len()]; Score::ALL.len()],
    pub(super) num_images: usize,
    /// How much of what was learnt of this map alone is believed, 0 to 1.
    pub(super) trust: f64,
    /// Which places may share an answer.
    pub(in crate::localize) neighbours: Neighbours,
}

/// How often a feature was looked for where it is not, and found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "(u32, u32)", into = "(u32, u32)")]
pub(super) struct Trials {
    pub(super) tried: u32,
    pub(super) found: u32,
}

impl From<(u32, u32)> for Trials {
    fn from((tried, found): (u32, u32)) -> Self {
        Self { tried, found }
    }
}

impl From<Trials> for (u32, u32) {
    fn from(trials: Trials) -> Self {
        (trials.tried, trials.found)
    }
}

/// Where the camera stands between visits: normal around the place's frame, or anywhere.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct DisplacementPrior {
    pub(super) spread_px: (f64, f64),
    /// Area of displacements that leave some overlap, px^2.
    pub(super) area_px2: f64,
}

/// What a feature says that is not found, as log ratios of being here against being at another
/// place.
///
/// A true match may lie beside the others, since the camera stands a little off and near things
/// shift more than far ones; so outlier matches are somewhat more frequent at the place itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct OutlierRatios {
    /// ln((1 - a) / (1 - b)): nothing like it in the image.
    pub(super) missing: f64,
    /// ln(a / b): something like it, but not where the others are.
    pub(super) outlier: f64,
}

impl OutlierRatios {
    /// Of the probabilities, both between 0 and 1, that a feature that is not found has an outlier
    /// match: `here`, at its place, and at `others`.
    pub(super) fn new(here: f64, others: f64) -> Self {
        Self {
            missing: ((1.0 - here) / (1.0 - others)).ln(),
            outlier: (here / others).ln(),
        }
    }

    fn weighted(self, weight: f64) -> Self {
        Self {
            missing: weight * self.missing,
            outlier: weight * self.outlier,
        }
    }
}

impl Calibration {
    /// What is assumed while nothing is known.
    pub fn uninformed() -> Self {
        Self {
            detection: Curve::constant(0.3),
            conditions: PRIOR,
            spread: 1.0,
            repeatability: Vec::new(),
            false_rate: FALSE_RATE,
            place_false_rates: Vec::new(),
            levels: Vec::new(),
            false_counts: Vec::new(),
            outlier_rates: Vec::new(),
            outlier_ratio: 1.0,
            distance_log_ratios: vec![0.0; 257],
            displacement: None,
            uses_references: true,
            posteriors: Score::ALL.map(|score| [prior_calibration(score); SIZES.len()]),
            num_images: 0,
            trust: 0.0,
            neighbours: Neighbours::default(),
        }
    }

    /// Leaves out what the configuration does not want.
    pub(super) fn forget(&mut self, without: &[EvidencePart]) {
        for evidence in without {
            match evidence {
                EvidencePart::Appearances => self.uses_references = false,
                EvidencePart::Distances => self.distance_log_ratios.fill(0.0),
                EvidencePart::Displacement => self.displacement = None,
                EvidencePart::FalseRates => {
                    self.false_counts.clear();
                    self.place_false_rates.clear();
                }
                EvidencePart::Repeatability => self.repeatability.clear(),
                EvidencePart::OutlierMatches => self.outlier_rates.clear(),
            }
        }
    }

    /// What a place scores in images that do not show it, on average.
    pub(super) fn level(&self, node: NodeId) -> f64 {
        self.spread * self.levels.get(node.0 as usize).copied().unwrap_or(0.0)
    }

    /// What part of the log odds of an image in which nothing of a place is found is left out.
    ///
    /// Which places have more features to miss than others is known only as well as how often they
    /// are seen again; with few visits it would outweigh what was found. (In a map of one run the
    /// levels of its places, which are believed in full there, say the same.)
    pub(super) fn discount(&self) -> f64 {
        let is_one_run = self.spread >= 1.0;
        (1.0 - self.trust).powi(2) * f64::from(u8::from(!is_one_run))
    }

    /// What outlier matches say at a place.
    pub(super) fn outlier_ratios(&self, node: NodeId) -> OutlierRatios {
        let others = self.outlier_rates.get(node.0 as usize);
        others.map_or_else(OutlierRatios::default, |&others| {
            let here = (others * self.outlier_ratio).min(MAX_OUTLIER_RATE);
            // Of few visits hundreds of features are predicted, and a small error of the ratio
            // would be raised to that power: it is believed a little later than the rest.
            OutlierRatios::new(here, others).weighted(self.trust * self.trust)
        })
    }

    /// From a model's score to the probability that the feature is matched at its place.
    pub fn detection(&self) -> &Curve {
        &self.detection
    }

    /// How often a feature is matched in an image of another place, on average.
    pub fn mean_false_rate(&self) -> f64 {
        self.false_rate
    }

    /// How many past visits it was learnt from.
    pub fn num_images(&self) -> usize {
        self.num_images
    }

    /// ln(g1 / g0) at a distance, as far as it is believed.
    pub fn distance_log_ratio(&self, distance_bits: u16) -> f64 {
        self.trust * self.distance_log_ratios[usize::from(distance_bits).min(256)]
    }

    /// The worth of a score at `n` features, between learnt sizes by ln n.
    pub fn posterior_calibration(&self, score: Score, n: usize) -> PosteriorCalibration {
        let posteriors = &self.posteriors[score as usize];
        let n = n.clamp(SIZES[0], SIZES[SIZES.len() - 1]);
        let above = SIZES.partition_point(|&size| size < n);
        if SIZES[above] == n {
            return posteriors[above];
        }
        let (low, high) = (SIZES[above - 1] as f64, SIZES[above] as f64);
        let share = (n as f64 / low).ln() / (high / low).ln();
        let between = |low: f64, high: f64| low + share * (high - low);
        PosteriorCalibration {
            scale: between(posteriors[above - 1].scale, posteriors[above].scale),
            bias: between(posteriors[above - 1].bias, posteriors[above].bias),
            level: between(posteriors[above - 1].level, posteriors[above].level),
            near: between(posteriors[above - 1].near, posteriors[above].near),
        }
    }

    /// The log ratio of the camera being displaced so far at the place, against anywhere, as far as it
    /// is believed.
    pub(super) fn displacement_log_ratio(&self, displacement: Displacement) -> f64 {
        let Some(prior) = self.displacement else {
            return 0.0;
        };
        let (sx, sy) = prior.spread_px;
        let square = (displacement.dx_px / sx).powi(2) + (displacement.dy_px / sy).powi(2);
        let density = (-0.5 * square).exp() / (std::f64::consts::TAU * sx * sy);
        self.trust * ((1.0 - UNIFORM_SHARE) * density * prior.area_px2 + UNIFORM_SHARE).ln()
    }

    /// What is known, for a newer snapshot of the map; `is_same` says which of its places have not
    /// changed.
    ///
    /// False rates go with their features where a budget has numbered them anew, and are forgotten
    /// of kept appearances, whose visits are numbered anew then.
    pub(in crate::localize) fn with_snapshot(
        known: &Arc<Self>,
        older: &Snapshot,
        newer: &Snapshot,
        is_same: &[bool],
    ) -> Arc<Self> {
        let mut known = Arc::clone(known);
        let places = older.nodes().iter().zip(newer.nodes()).zip(is_same);
        for (index, ((old, new), _)) in places.enumerate().filter(|(_, (_, is_same))| !**is_same) {
            let extends = new
                .features()
                .descriptors()
                .starts_with(old.features().descriptors())
                && new.visits().len() >= old.visits().len();
            if extends || known.false_counts.len() <= index {
                continue;
            }
            let of_place = &mut Arc::make_mut(&mut known).false_counts[index];
            of_place.truncate(1);
            for counts in of_place {
                *counts = renumbered(counts, old.features().view(), new.features().view());
            }
        }
        known
    }

    /// The probability that a feature of this score is matched at this place.
    pub(super) fn detection_at(&self, node: NodeId, score: f64) -> f64 {
        let of_place = self.repeatability.get(node.0 as usize).copied();
        (self.detection.rate(score) * of_place.unwrap_or(1.0).powf(self.trust)).min(1.0)
    }

    /// `q_f`, without the trials `but`.
    pub(super) fn false_rate_of(
        &self,
        node: NodeId,
        hypothesis: usize,
        feature: usize,
        but: Trials,
    ) -> f64 {
        let counts = (self.false_counts.get(node.0 as usize))
            .and_then(|place| place.get(hypothesis))
            .and_then(|features| features.get(feature));
        let trials = counts.copied().unwrap_or_default();
        let found = f64::from(trials.found.saturating_sub(but.found));
        let tried = f64::from(trials.tried.saturating_sub(but.tried));
        let usual = (self.place_false_rates.get(node.0 as usize)).unwrap_or(&self.false_rate);
        let prior = FALSE_RATE_PRIOR * (1.0 + FEW_VISITS_PRIOR * self.spread);
        let rate = (found + prior * usual) / (tried + prior);
        rate.clamp(*FALSE_RATES.start(), *FALSE_RATES.end())
    }

    /// Whether a copy from outside can be used without surprises.
    pub(in crate::localize) fn holds_together(&self, snapshot: &Snapshot) -> bool {
        let num_places = snapshot.nodes().len();
        let is_rate = |rate: &f64| (0.0..=1.0).contains(rate);
        let knots = self.detection.knots();
        let posteriors = self.posteriors.iter().flatten();
        !knots.is_empty()
            && knots.is_sorted_by(|a, b| a.0 <= b.0 && a.1 <= b.1)
            && knots
                .iter()
                .all(|(score, rate)| score.is_finite() && is_rate(rate))
            && is_rate(&self.false_rate)
            && is_rate(&self.spread)
            && is_rate(&self.trust)
            && self
                .conditions
                .iter()
                .all(|share| *share > 0.0 && *share <= 1.0)
            && self.neighbours.holds_together(num_places)
            && [0, num_places].contains(&self.repeatability.len())
            && self
                .repeatability
                .iter()
                .all(|it| it.is_finite() && *it >= 0.0)
            && [0, num_places].contains(&self.place_false_rates.len())
            && self.place_false_rates.iter().all(is_rate)
            && [0, num_places].contains(&self.levels.len())
            && self.levels.iter().all(|level| level.is_finite())
            && [0, num_places].contains(&self.outlier_rates.len())
            && (self.outlier_rates.iter()).all(|rate| *rate > 0.0 && *rate < 1.0)
            && self.outlier_ratio.is_finite()
            && self.outlier_ratio > 0.0
            && [0, num_places].contains(&self.false_counts.len())
            && self.distance_log_ratios.len() == 257
            && self.distance_log_ratios.iter().all(|it| it.is_finite())
            && self.displacement.is_none_or(|it| {
                it.spread_px.0 > 0.0 && it.spread_px.1 > 0.0 && it.area_px2.is_finite()
            })
            && posteriors
                .flat_map(|it| [it.scale, it.bias, it.level, it.near])
                .all(f64::is_finite)
            && self.posteriors.iter().all(|it| it.len() == SIZES.len())
    }
}

/// What was counted of the features of `old`, for those of them that are left in `new`, in the same
/// order.
fn renumbered(counts: &[Trials], old: FeaturesView<'_>, new: FeaturesView<'_>) -> Vec<Trials> {
    let mut first = 0;
    let of_feature = (0..new.len()).map(|id| {
        let is_it = |was: &usize| {
            (old.keypoints[*was], old.descriptors[*was]) == (new.keypoints[id], new.descriptors[id])
        };
        let Some(was) = (first..old.len()).find(is_it) else {
            return Trials::default();
        };
        first = was + 1;
        counts.get(was).copied().unwrap_or_default()
    });
    of_feature.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Features, Keypoint};

    #[test]
    fn counts_follow_their_features() {
        let features = |numbers: &[u64]| {
            let mut features = Features::new();
            for &number in numbers {
                let keypoint = Keypoint {
                    x: number as f32,
                    y: 0.0,
                    size: 1.0,
                    response: 1.0,
                };
                features.push(keypoint, Descriptor([number % 3, 0, 0, 0]));
            }
            features
        };
        let trials = |tried: u32| Trials { tried, found: 0 };
        let old = features(&[10, 11, 12, 13, 14]);
        let counts = [0, 1, 2, 3].map(trials);
        let new = features(&[11, 13, 14, 20, 10]);
        let expected = [1, 3, 0, 0, 0].map(trials);
        let found = renumbered(&counts, old.view(), new.view());
        assert_eq!(
            found, expected,
            "nothing is known of 14, 20 is new, 10 is out of order"
        );
    }
}

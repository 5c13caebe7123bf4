//! What can every model of visibility do?

use std::fmt::Debug;

use crate::spectrum::Component;
use crate::time::Time;

/// A probability with what is known of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The probability of a 1.
    pub p: f64,
    /// Lower end of its 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Estimate {
    /// `p` with nothing known of it.
    pub(crate) fn of_nothing(p: f64) -> Self {
        let (low, high) = (0.0, 1.0);
        Self { p, low, high }
    }
}

/// The visibility p(t) of every feature of one place.
pub trait VisibilityModel: Debug + Send + Sync {
    /// Features of the place when the model was fitted.
    fn num_features(&self) -> usize;

    /// Writes p(`time`) of every feature; each is in [0, 1].
    ///
    /// # Panics
    /// If `out` is not [`num_features`](Self::num_features) long.
    fn predict_into(&self, time: Time, out: &mut [f64]);

    /// p(`time`) of one feature, equal to its entry of [`predict_into`](Self::predict_into) bit for
    /// bit.
    ///
    /// # Panics
    /// If there is no such feature.
    fn predict_one(&self, feature: usize, time: Time) -> f64;

    /// Writes what features are ranked by: p(`time`) before it is clamped to [0, 1], where the
    /// model has such a number, so that features whose p is clamped alike still differ.
    ///
    /// # Panics
    /// If `out` is not [`num_features`](Self::num_features) long.
    fn score_into(&self, time: Time, out: &mut [f64]) {
        self.predict_into(time, out);
    }

    /// p(`time`) of one feature with its 95 % interval; from 0 to 1 for a model that does not know
    /// how sure it is ([`fit_cautious`](super::fit_cautious) makes one that does).
    ///
    /// # Panics
    /// If there is no such feature.
    fn estimate(&self, feature: usize, time: Time) -> Estimate {
        Estimate::of_nothing(self.predict_one(feature, time))
    }

    /// The share of looks at which a feature was seen, bursts counted as one; `None` for a model
    /// that does not keep it.
    ///
    /// # Panics
    /// If there is no such feature.
    fn mean(&self, feature: usize) -> Option<f64> {
        assert!(feature < self.num_features(), "no feature {feature}");
        None
    }

    /// The most rhythms that a feature may have: 0 if p does not depend on time through rhythms.
    fn order(&self) -> usize {
        0
    }

    /// What the rhythms of one feature swing about; `None` for a model that is not a level and
    /// rhythms.
    ///
    /// # Panics
    /// If there is no such feature.
    fn level(&self, feature: usize) -> Option<f64> {
        assert!(feature < self.num_features(), "no feature {feature}");
        None
    }

    /// The rhythms of one feature, strongest first: none for a model that has none.
    ///
    /// # Panics
    /// If there is no such feature.
    fn components(&self, feature: usize) -> Vec<Component> {
        assert!(feature < self.num_features(), "no feature {feature}");
        Vec::new()
    }

    /// The model as bytes, from which [`decode`](super::decode) makes one that predicts the same
    /// bits. `None` if this kind of model has no such form; every model of this crate has one.
    fn encode(&self) -> Option<Vec<u8>> {
        None
    }
}

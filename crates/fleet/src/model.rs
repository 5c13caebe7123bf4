//! What does a fleet know of one feature of a place?
//!
//! Its sums, of which any model of [FreMEn](fremen::visibility::Fremen) follows, and the one of a certain
//! order. Sums of other days or robots can be merged into it; a model is what a robot needs.

use fremen::spectrum::{CandidatePeriods, Rhythms, SpectralSums};
use fremen::visibility::{Fremen, VisibilityModel};
use fremen::{Result, SeriesModel};
use rayon::prelude::*;

use crate::log::FleetLog;
use crate::sums::FeatureSums;

/// How a fleet learns.
#[derive(Clone, Debug, PartialEq)]
pub struct FleetConfig {
    candidates: CandidatePeriods,
    order: usize,
}

impl Default for FleetConfig {
    /// Two rhythms of the [calendar](CandidatePeriods::calendar).
    fn default() -> Self {
        Self {
            candidates: CandidatePeriods::calendar(),
            order: 2,
        }
    }
}

impl FleetConfig {
    /// The rhythms that are looked for.
    #[must_use]
    pub fn with_candidates(mut self, candidates: CandidatePeriods) -> Self {
        self.candidates = candidates;
        self
    }

    /// How many of them a model keeps, at most.
    #[must_use]
    pub fn with_order(mut self, order: usize) -> Self {
        self.order = order;
        self
    }

    /// The rhythms that are looked for.
    pub fn candidates(&self) -> &CandidatePeriods {
        &self.candidates
    }

    /// How many of them a model keeps, at most.
    pub fn order(&self) -> usize {
        self.order
    }
}

/// What is known of one feature of a place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FeatureModel {
    /// The place's key.
    pub place: String,
    /// The feature's number in the place.
    pub feature: u32,
    /// Of all that was observed of it.
    pub sums: SpectralSums,
    /// The model as bytes: what [`SeriesModel::decode`] takes.
    pub model: Vec<u8>,
}

impl FeatureModel {
    /// Of the sums of a feature, with at most so many rhythms.
    pub fn of_sums(place: &str, feature: FeatureSums, order: usize) -> Self {
        Self {
            place: place.to_owned(),
            feature: feature.feature,
            model: model_of(&feature.sums, order),
            sums: feature.sums,
        }
    }

    /// The mean and at most `order` rhythms of the sums; the model has as many as it was made with.
    pub fn rhythms(&self, order: usize) -> Rhythms {
        self.sums.rhythms(order)
    }

    /// The model.
    pub fn decode(&self) -> Result<SeriesModel> {
        SeriesModel::decode(&self.model)
    }
}

/// The model of sums as bytes, with at most so many rhythms.
pub fn model_of(sums: &SpectralSums, order: usize) -> Vec<u8> {
    // Every model of this kind has a form as bytes.
    Fremen::of_sums(sums, order).encode().unwrap_or_default()
}

/// What follows from a log, in order of places and features.
pub fn learn(log: &FleetLog, cfg: &FleetConfig) -> Result<Vec<FeatureModel>> {
    let places: Result<Vec<Vec<FeatureModel>>> = (log.places().into_par_iter())
        .map(|place| {
            let sums = place.sums(&cfg.candidates)?;
            let models = sums.into_par_iter();
            Ok(models
                .map(|it| FeatureModel::of_sums(place.key(), it, cfg.order))
                .collect())
        })
        .collect();
    Ok(places?.into_iter().flatten().collect())
}

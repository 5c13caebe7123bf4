//! What memory does a localisation work in?

use super::candidates::ShortlistScratch;
use super::evidence::{Expectation, Hits, PlaceEvidence};
use super::verify::Verifier;
use crate::feature::Features;
use crate::matching::{Match, MatchScratch};
use crate::predict::PredictedMap;

/// Memory that a [`Localizer`](super::Localizer) works in; owned by the caller, one for each
/// thread, and used again and again.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    pub(super) predicted: PredictedMap,
    /// The features of the predicted maps, most likely first, place by place.
    pub(super) ranked: Features,
    /// p(t) of each experience.
    pub(super) likely: Vec<f64>,
    /// The visits whose appearances are matched.
    pub(super) visits: Vec<u32>,
    pub(super) matching: MatchScratch,
    pub(super) matches: Vec<Match>,
    pub(super) verifier: Verifier,
    pub(super) hits: Hits,
    pub(super) expectation: Expectation,
    pub(super) shortlist: ShortlistScratch,
    /// The places on the short list, and where the features of each end in `ranked`.
    pub(super) places: Vec<u32>,
    pub(super) ends: Vec<usize>,
    pub(super) scores: Vec<PlaceEvidence>,
    /// What each place scores in an image in which nothing of it is found.
    pub(super) of_nothing: Vec<f64>,
    pub(super) posterior: Vec<f64>,
}

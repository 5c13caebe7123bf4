//! How are candidates found in this map?

use std::sync::Arc;

use super::shortlist::LENGTH;
#[cfg(feature = "hnsw")]
use super::signatures::Signatures;
use super::words::learn_words;
use crate::localize::config::{LocalizerConfig, PlaceSearch};
use crate::map::Snapshot;
use crate::matching::BinaryWords;
use crate::predict::Selection;

/// Predicted features from which on places vote: there it was measured to be twice as fast as
/// matching them all. It is faster from about half of them on; below, nothing that an exact answer
/// finds shall be missed for the two milliseconds that are left to win.
const MIN_PREDICTED: usize = 50_000;

/// The same where places of few visits are predicted by more features than was asked for. They are
/// predicted so because each of their images counts, so more time is spent before one is missed:
/// 400 places of a single visit are all matched.
const MIN_PREDICTED_OF_FEW_VISITS: usize = 250_000;

/// What a localizer finds candidates with; made once a map.
#[derive(Clone, Debug)]
pub(in crate::localize) enum Finder {
    /// Every place is one.
    Exact,
    /// The words of the lists that are made of each forecast.
    Inverted(Arc<BinaryWords>),
    #[cfg(feature = "hnsw")]
    Words(Arc<Signatures>),
}

impl Finder {
    pub(in crate::localize) fn new(snapshot: &Snapshot, cfg: &LocalizerConfig) -> Self {
        match Self::kind(snapshot, cfg) {
            PlaceSearch::Auto | PlaceSearch::Exact => Self::Exact,
            // The configuration was refused before.
            #[cfg(not(feature = "hnsw"))]
            PlaceSearch::Words => Self::Exact,
            PlaceSearch::Inverted => {
                let words = learn_words(snapshot, Self::num_words(snapshot, cfg));
                Self::Inverted(Arc::new(words))
            }
            #[cfg(feature = "hnsw")]
            PlaceSearch::Words => Self::Words(Arc::new(Signatures::of(snapshot))),
        }
    }

    /// For a newer snapshot of the same map: words are kept until it needs more than twice as many.
    pub(in crate::localize) fn with_snapshot(
        &self,
        snapshot: &Snapshot,
        cfg: &LocalizerConfig,
    ) -> Self {
        match self {
            Self::Inverted(words)
                if Self::kind(snapshot, cfg) == PlaceSearch::Inverted
                    && Self::num_words(snapshot, cfg) <= 2 * words.len() =>
            {
                self.clone()
            }
            _ => Self::new(snapshot, cfg),
        }
    }

    /// Whether forecasts that were made for the other hold for this one.
    pub(in crate::localize) fn reads_same_words(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Inverted(words), Self::Inverted(others)) => Arc::ptr_eq(words, others),
            (Self::Inverted(_), _) | (_, Self::Inverted(_)) => false,
            _ => true,
        }
    }

    /// What candidates are found by in this map.
    fn kind(snapshot: &Snapshot, cfg: &LocalizerConfig) -> PlaceSearch {
        match cfg.place_search() {
            _ if snapshot.nodes().len() <= LENGTH => PlaceSearch::Exact,
            PlaceSearch::Auto if Self::is_large(snapshot, cfg) => PlaceSearch::Inverted,
            PlaceSearch::Auto => PlaceSearch::Exact,
            chosen => chosen,
        }
    }

    /// Whether matching everything takes longer than it is worth.
    fn is_large(snapshot: &Snapshot, cfg: &LocalizerConfig) -> bool {
        let of_many_visits = match cfg.selection() {
            Selection::Top(n) => snapshot.nodes().len().saturating_mul(n.get()),
            Selection::Threshold(_) => Self::num_predicted(snapshot, cfg),
        };
        of_many_visits >= MIN_PREDICTED
            || Self::num_predicted(snapshot, cfg) >= MIN_PREDICTED_OF_FEW_VISITS
    }

    /// Features that are predicted of all places, at most.
    fn num_predicted(snapshot: &Snapshot, cfg: &LocalizerConfig) -> usize {
        match cfg.selection() {
            Selection::Top(n) => (snapshot.nodes().iter())
                .map(|node| {
                    let wanted = cfg.num_predicted(n.get(), node.log().num_visits());
                    wanted.min(node.features().len())
                })
                .sum(),
            Selection::Threshold(_) => snapshot.nodes().iter().map(|it| it.features().len()).sum(),
        }
    }

    /// The power of two nearest to four times the root of what is predicted.
    fn num_words(snapshot: &Snapshot, cfg: &LocalizerConfig) -> usize {
        let num_predicted = Self::num_predicted(snapshot, cfg) as f64;
        1 << (4.0 * num_predicted.sqrt()).log2().round() as u32
    }
}

//! What must name the places that are worth matching, and in what memory?

use std::fmt::Debug;

use super::tally::Tally;
use crate::feature::FeaturesView;
use crate::matching::SearchScratch;

/// Places on a short list.
pub(in crate::localize) const LENGTH: usize = 256;

/// Names the places that are worth matching exactly.
pub(in crate::localize) trait Shortlist: Debug + Send + Sync {
    /// Writes the `count` places that may explain `live` best, ascending; all, if there are fewer.
    fn shortlist_into(
        &self,
        scratch: &mut ShortlistScratch,
        live: FeaturesView<'_>,
        count: usize,
        out: &mut Vec<u32>,
    );
}

/// Memory that a short list is made in.
#[derive(Clone, Debug, Default)]
pub(in crate::localize) struct ShortlistScratch {
    pub(super) search: SearchScratch,
    pub(super) tally: Tally,
    #[cfg(feature = "hnsw")]
    pub(super) words: Vec<u32>,
    #[cfg(feature = "hnsw")]
    pub(super) signature: Vec<f32>,
}

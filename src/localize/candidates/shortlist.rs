//! What must name the places that are worth matching, and in what memory?

use std::fmt::Debug;

use crate::feature::Descriptor;
use crate::matching::SearchScratch;

/// Places on a short list.
pub(in crate::localize) const LENGTH: usize = 256;

/// Names the places that are worth matching exactly.
pub(in crate::localize) trait Shortlist: Debug + Send + Sync {
    /// Writes the `count` places that may explain `live` best, ascending; all, if there are fewer.
    fn shortlist_into(
        &self,
        scratch: &mut ShortlistScratch,
        live: &[Descriptor],
        count: usize,
        out: &mut Vec<u32>,
    );
}

/// Memory that a short list is made in.
#[derive(Clone, Debug, Default)]
pub(in crate::localize) struct ShortlistScratch {
    pub(super) search: SearchScratch,
    /// Distance of the nearest live feature to each row; all ones between searches.
    pub(super) nearest: Vec<u16>,
    pub(super) found: Vec<u32>,
    #[cfg(feature = "hnsw")]
    pub(super) words: Vec<u32>,
    #[cfg(feature = "hnsw")]
    pub(super) signature: Vec<f32>,
    /// What speaks for each place.
    pub(super) votes: Vec<(f32, u32)>,
}

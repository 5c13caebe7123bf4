//! Which places are worth matching exactly?
//!
//! In a map of ten thousand places, matching every predicted feature takes a tenth of a second, and
//! all but a few places have nothing to do with the image. A [`Shortlist`] names those that are
//! worth it, and only these are matched, verified and scored, by the very path that otherwise
//! serves all places. That path is the oracle: what a short list may lose is the best place itself,
//! and `chronotope-eval speed` reports how often it does. Two kinds are compared there:
//!
//! - [`Voting`]: the features predicted at all places in an inverted file over binary words. Live
//!   features search the lists of their nearest words; each predicted feature that is found within
//!   the matching threshold adds to its place what its match is worth, on top of what the place
//!   would score if nothing matched; only what agrees on one displacement counts. So votes are the
//!   log odds without uniqueness, and the list follows the time of the query. `words + predicted x
//!   probes / words` distances a live feature.
//! - [`Signatures`]: one vector a place, its binary words weighted by how often their features were
//!   seen and by how few places have them (tf-idf; Sivic & Zisserman 2003), in a navigable graph
//!   (`hnsw_rs`; Malkov & Yashunin 2018) into which places are inserted one after the other, so
//!   that it is the same in every run. One search an image. The signature knows no time; what is
//!   matched afterwards does.
//!
//! Voting is what `auto` uses from 50,000 predicted features on (250,000 where places have few
//! visits, which are predicted by more features): in a map of 10,000 places grown from real images,
//! the first place was that of the exact answer for all held-out images. With signatures, whose
//! words many look-alike places share, it was so for 65 % in 1,000 places and for none in 10,000
//! (`eval/record/speed.md`).
//!
//! Invariants: a list depends on map, configuration, time bucket and image alone; ties go to the
//! lowest place. With voting nothing is allocated once warm; the graph allocates in every search.
//!
//! Not for: small maps, where matching all places is as fast and misses nothing.

mod finder;
mod shortlist;
#[cfg(feature = "hnsw")]
mod signatures;
mod tally;
mod voting;
mod words;

pub(super) use finder::Finder;
pub(super) use shortlist::{LENGTH, Shortlist, ShortlistScratch};
pub(super) use voting::{PredictedPlaces, Voting};

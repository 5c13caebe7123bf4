//! Which descriptors are the same, and do they agree on a displacement?
//!
//! Two sets of features meet here: those of the *map* and those of the *live* image. A [`Matcher`]
//! pairs them by Hamming distance under the rules of its [`MatchConfig`]; [`vote_displacement`]
//! then finds the pairs whose displacement `(dx, dy) = live - map`, in px, agrees. [`TwoWay`] is
//! the reference recipe's comparison for building a map.
//!
//! Rules, in the order in which they are applied; with `d1 <= d2` the distances in bits of a
//! feature's nearest and second nearest feature of the other side:
//!
//! 1. nearest: every feature of the querying side names its nearest of the other side, ties by
//!    lowest id;
//! 2. threshold: `d1 <= max_bits`;
//! 3. ratio (Lowe 2004): `d1 < ratio * d2`, strictly; a feature without a rival (the other side has
//!    one feature only) fails, unless [`accept_lone`](MatchConfigBuilder::with_accept_lone) says
//!    otherwise;
//! 4. mutual: the nearest of the nearest is the feature itself;
//! 5. window: `|dx| < a` and `|dy| < b`, strictly;
//! 6. unique: a feature of the other side that several claim goes to the smallest distance, ties to
//!    the lowest querying id.
//!
//! Cost: `O(map * live)` distances for rules 1 to 4 (twice for the mutual check), `O(map + live)`
//! for the rest. Voting costs `O(m k)` for `m` matches of which `k` share a window's `dx`.
//!
//! Invariants: results depend on neither threads nor kernel; matches are ordered by the querying
//! side's id; nothing is allocated once a [`MatchScratch`] has seen the largest input.
//!
//! Not for: time (a match is a match at any time), geometry beyond one displacement, deciding where
//! the camera is.

mod config;
mod displacement;
mod inverted;
mod matcher;
mod two_way;
mod vote;

pub use config::{Direction, MatchConfig, MatchConfigBuilder, Window, passes_ratio};
pub use displacement::Displacement;
pub use inverted::{BinaryWords, ExactSearch, InvertedFile, NearestNeighbours, SearchScratch};
pub use matcher::{Match, MatchScratch, Matcher};
pub use two_way::{TwoWay, TwoWayConfig, Verdict};
pub use vote::{
    Vote, VoteConfig, VoteConfigBuilder, VoteScratch, displacements_into, vote_displacement,
    vote_subset,
};

use crate::feature::Descriptor;
use crate::simd::Bits256;

impl Bits256 for Descriptor {
    #[inline]
    fn words(&self) -> [u64; 4] {
        self.0
    }
}

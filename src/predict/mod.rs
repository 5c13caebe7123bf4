//! What will the place look like then?
//!
//! A [`PredictedMap`] is the part of a place's features that a [`Selection`] keeps for one time:
//! the n most likely visible (T-RO 2017 VII, "the n most likely visible features at each location
//! were selected"), or all above a probability.
//!
//! Features are ranked by the model's score *before* it is clamped to [0, 1]: with few visits many
//! features reach 1, and the unclamped score still says which of them overshoots. Scores closer
//! than 1e-9 count as equal (sums in another order differ by less), and equal ones rank by lowest
//! id, so that a ranking is the same for every kernel and number of threads.
//!
//! The n most likely features often belong to one season: a place that was snowy in half of its
//! visits is then predicted without snow only. [`Choice::Covering`] takes features in turn so that
//! every past appearance of the place keeps some ([`PredictedMap::predict_covering`]).
//!
//! Of a place that has been seen often, the features that last are known, and they are among the
//! strongest of an image: weak ones need not be chosen any more ([`weak_features`]).
//!
//! Not for choosing by what tells this place from others: that needs the other places.

mod predicted_map;
mod reference_visits;
mod selection;

pub use predicted_map::{GOOD_ENOUGH, PredictedMap};
pub use reference_visits::{ReferenceVisits, weak_features};
pub use selection::{Choice, Selection};

//! Where am I, how sure?
//!
//! A [`Localizer`] reads one [`Snapshot`](crate::map::Snapshot) of a map. For each place it
//! predicts what should be visible at the query's time, matches that with the live image, finds the
//! displacement that most matches agree on, and scores the place: by the number of matches, by
//! those that agree ([`Score`]), or by the log odds of "this place" against "another place", to
//! which matched and missing features both contribute (`evidence/`). What matches are worth is
//! learnt from the map's own past visits ([`Calibration`]), so that the posterior over places, and
//! over being at none of them, can be taken at its word; the answer is [`Decision::At`] a place
//! only if the probability of being wrong is at most [`LocalizerConfig::risk`]. Everything that led
//! to the answer is part of it ([`Localization`]), so that a dashboard needs nothing else.
//!
//! The experience methods differ in one step only: instead of one predicted map, a place has
//! several remembered appearances. The best of them speaks for the place where matches are counted;
//! their mean likelihood does where evidence is weighed.
//!
//! Cost: with N places, n features each and m live ones, N (F + n log n) to predict, once a time
//! bucket (`forecast.rs`); N n m Hamming distances to match and at most 64 additions a match to
//! score, for each image. In a large map a short list takes the place of all N (`candidates/`), and
//! the places of a prior do where the image decides for one of them ([`Query::with_prior`]). The
//! experience methods match E appearances a place, E n m distances. [`Localizer::new`] fits and
//! calibrates, which takes from a tenth of a second to a few seconds.
//!
//! Invariants: localising never changes the map; the answer depends on snapshot, configuration and
//! query alone, not on earlier queries or threads (ties go to the lowest node and are counted);
//! with a warmed-up [`Scratch`] and output, nothing is allocated.
//!
//! Places of a dense route overlap, and an image between two of them shows both. They are no
//! impostors of each other: their probabilities are added up, and where only the sum is as sure as
//! the risk asks for, the decision is [`Decision::Near`] with the places that are left open
//! ([`Localization::region`]; `neighbours.rs` says which places that may be).
//!
//! Each query stands alone; a [`Tracker`] follows a robot from image to image along the map's
//! edges.
//!
//! Not for: metric poses (a displacement in px is all that one image gives).

mod candidates;
mod config;
mod evidence;
mod forecast;
mod index_cache;
mod localization;
mod localizer;
mod motion;
mod neighbours;
mod place_scores;
mod plan;
mod query;
mod scratch;
mod sweep;
mod tracking;
mod verify;

pub use config::{EvidencePart, LocalizerConfig, Method, PlaceSearch, Preset, Score};
pub use evidence::{ATTACHMENT, Calibration, Curve, PosteriorCalibration};
pub use index_cache::IndexCache;
pub use localization::{Candidate, Decision, EvidenceMatch, Localization, Reason};
pub use localizer::Localizer;
pub use motion::{EdgeMotion, Motion, MotionConfig, Transitions};
pub use place_scores::PlaceScores;
pub use query::Query;
pub use scratch::Scratch;
pub use sweep::Sweep;
pub use tracking::Tracker;

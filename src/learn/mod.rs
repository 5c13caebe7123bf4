//! What is worth remembering of this visit?
//!
//! A [`Learner`] takes one [`Observation`] after another (an image's features with their place and
//! time) and keeps a map: the features of each place, the log of which was seen when, and the
//! appearances the experience methods need. [`Learner::snapshot`] gives an immutable state to
//! localise with. Two recipes ([`Recipe`]):
//!
//! - `online` (preset `default`): each feature of the place takes its nearest live feature; the
//!   pairs that agree on one displacement were seen, live features that were not matched are born.
//!   A visit costs O(features of the place), whatever its history.
//! - `reference` (preset `lttl`): a live feature is born if the ratio test fails both ways;
//!   visibility is found afterwards by looking for every feature of the place in every image of it.
//!   Every image is kept, and the log is written when a snapshot is taken.
//!
//! `Deviation:` the reference's pruning is left out, because it hands descriptors of removed
//! features to others.
//!
//! Experiences (T-RO 2017 VII-A after Churchill & Newman): an appearance becomes an experience of
//! its place if the experiences so far, of all places, do not locate it there. For FreEx, each
//! visit also logs which experiences of its place would have located it by themselves.
//!
//! Images of one place seconds apart are one visit with more evidence, not many visits (`stay`).
//!
//! What does not agree with what was predicted of its place is not learnt but held
//! ([`GuardConfig`], [`Quarantine`](crate::map::Quarantine)), until [`Learner::accept`] or
//! [`Learner::reject`] says which. A map that may only grow so far forgets what is least useful
//! ([`BudgetConfig`]).

mod budget;
mod budget_config;
mod config;
mod correct;
mod expectation;
mod forget;
mod guard;
mod guard_config;
mod held;
mod learner;
mod merge;
mod online;
mod overlap;
mod reference;
mod stay;
mod visit;

pub use budget_config::BudgetConfig;
pub use config::{KeepAppearances, LearnConfig, Recipe};
pub use correct::{drop_visit, join_places, remove_place, rename_place};
pub use forget::forget_session;
pub use guard::Circumstances;
pub use guard_config::{ClockPolicy, GuardConfig, Judge};
pub use held::accept_held;
pub use learner::Learner;
pub use merge::{join, merge, relearn};
pub use overlap::{have_in_common, stranger_among};
pub use visit::{Learnt, Observation};

//! Does a patrol's map belong into the grid, and where?
//!
//! A new map is laid onto the predicted one ([`register`]), so that small errors of its poses do not
//! add up over hundreds of patrols. Then a [`Guard`] judges how much contradicts the prediction and
//! integrates the map, or keeps it in quarantine until it comes again.

mod align;
mod compare;
mod guard;
mod resample;

pub use align::{Registration, Search, register};
pub use compare::{Comparison, compare};
pub use guard::{Believed, Decision, Guard, GuardConfig, Judgement, Quarantined, Reason};
pub use resample::resampled;

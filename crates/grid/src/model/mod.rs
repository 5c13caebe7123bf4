//! Which rhythm and which persistence has each cell?
//!
//! Derived from the [history](crate::history) whenever it is needed: the candidate periods and the
//! order can be chosen anew at any time.
//!
//! # The exact run-length form
//!
//! Cells that share their observation times share the prefix sums
//! `W_k(n) = sum over i < n of e^{-j w_k t_i}`. A cell whose state is 1 in the runs
//! `[a_1, b_1), [a_2, b_2), ...` has `S_k = sum over runs of W_k(b) - W_k(a)`, and
//! `g_k = (S_k - mu W_k) / m`: the same spectrum as from all observations, for the price of the
//! changes. Sums are whole numbers (multiples of 2^-40), so that neither order nor threads show.

mod choice;
mod columns;
mod config;
mod errors;
mod fit;
mod folded;
mod stats;
mod tile_model;

pub use choice::{BasePeriod, ModelChoice, ModelKind};
pub use config::{CellModel, GridConfig, MAX_FOLDED, MAX_ORDER, Persistence};
pub use errors::Errors;
pub(crate) use errors::{errors, errors_by_day};
pub(crate) use fit::fit;
pub(crate) use stats::Stats;
pub(crate) use tile_model::{CellRecord, Moment, Term, TileModel};

//! How well is one state predicted, and from which samples?
//!
//! A series' suite learns 0/1 series (a door, a person in a room, an edge that can be traversed)
//! and predicts a stretch of time that no model has seen. What may be learnt is thinned in three
//! ways (`Sampling`); every model is judged by the share of wrong states at p >= 1/2, by the
//! Brier score and by the log loss. Intervals are bootstraps over blocks of time, because a door
//! that is open stays open; the difference to the mean is paired block by block.

pub mod data;
mod drawing;
mod judge;
pub mod models;
mod results;
pub mod sampling;
mod score;
mod spectrum;
mod table;

use anyhow::{Result, bail};

use crate::provenance::{commit, machine};
use crate::run::RunOptions;
use crate::suite::{Protocol, Suite};
pub use results::{Drawing, Measured, Row, SeriesResults};
pub(crate) use results::{facts, is_in_table};
pub use spectrum::Spectrum;
pub use table::table;

/// Runs a suite of series; `None` if it is none.
pub fn run(suite: &Suite, options: &RunOptions) -> Result<Option<SeriesResults>> {
    let Protocol::Series { form, share } = suite.protocol else {
        return Ok(None);
    };
    let data = options.folder_of_series(suite)?;
    let dataset = data::read(form, data)?;
    let share = options.share.unwrap_or(share);
    if !(share > 0.0 && share <= 1.0) {
        bail!("--share must be above 0 and at most 1, not {share}");
    }
    let mut results = judge::judge(suite, &dataset, share)?;
    results.commit = commit();
    results.machine = machine();
    results.command.clone_from(&options.command);
    Ok(Some(results))
}

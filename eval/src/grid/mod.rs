//! How well does a grid predict, localise, plan, and keep wrong maps out?
//!
//! The experiments are those of `fremen_grid::experiment`, functions of a seed or of recorded data; here
//! they are run with their baselines (a static map of the night, the averaged map, the last observation,
//! the oracle), get intervals that resample whole worlds, and are held against what is wanted of them.
//! Constants were chosen in other worlds than those of the suites: other seeds and, for offices, another
//! layout.

mod boxes;
mod carmen;
mod office;
mod patrol;
mod presence;
mod process;
mod recordings;
mod results;
mod table;

use anyhow::{Result, ensure};

use recordings::files;

use crate::provenance::{commit, machine};
use crate::run::RunOptions;
use crate::suite::{GridExperiment, Protocol, Suite};
pub(crate) use results::facts;
pub use results::{Cell, Column, Curve, GridResults, GridTable, Picture, Plot, Row, Target};
pub(crate) use table::show;
pub use table::table;

/// Runs a suite of grids; `None` if it is none.
pub fn run(suite: &Suite, options: &RunOptions) -> Result<Option<GridResults>> {
    let Protocol::Grid {
        experiment,
        first_seed,
        num_seeds,
    } = suite.protocol
    else {
        return Ok(None);
    };
    let num_seeds = options.worlds.unwrap_or(num_seeds);
    let seeds: Vec<u64> = (first_seed..first_seed.saturating_add(num_seeds)).collect();
    ensure!(!seeds.is_empty(), "a suite of grids needs a world");
    let mut results = GridResults::new(suite);
    match experiment {
        GridExperiment::Office => office::run(&seeds, &mut results)?,
        GridExperiment::Patrol => patrol::run(&seeds, &mut results)?,
        GridExperiment::Boxes => boxes::run(&seeds, &mut results)?,
        GridExperiment::Presence => presence::run(&files(suite, options)?, &mut results)?,
        GridExperiment::Carmen => carmen::run(&files(suite, options)?, &mut results)?,
    }
    results.commit = commit();
    results.machine = machine();
    results.command.clone_from(&options.command);
    Ok(Some(results))
}

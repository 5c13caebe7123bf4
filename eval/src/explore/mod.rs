//! Which way of exploring knows a world best, and what does driving leave of that?
//!
//! A suite plays the protocol of RAS 2016, section 7, through with every strategy and every model
//! (`study`), or drives between the places of a topological map (`travel`). Intervals are over seeds, as
//! a robot that explores has one life only.

mod data;
mod results;
mod study;
mod table;
mod travel;
mod views;

use anyhow::Result;

use crate::provenance::{commit, machine};
use crate::run::RunOptions;
use crate::suite::{Protocol, Suite, World};
pub use results::{Curve, Day, DayPlace, ExploreResults, Row};
pub use table::table;

/// Runs a suite of exploration; `None` if it is none.
pub fn run(suite: &Suite, options: &RunOptions) -> Result<Option<ExploreResults>> {
    let Protocol::Explore { world, num_seeds } = suite.protocol else {
        return Ok(None);
    };
    let dataset = match world {
        World::LasVegas => views::read(suite, options)?,
        _ => data::read(world, options.folder_of_series(suite)?)?,
    };
    let mut results = match world {
        World::Aruba | World::Witham | World::LasVegas => study::study(&dataset, num_seeds)?,
        World::ArubaTravel => travel::travel(&dataset, num_seeds)?,
    };
    results.suite.clone_from(&suite.name);
    results.title.clone_from(&suite.title);
    results.dataset_sha256.clone_from(&dataset.sha256);
    results.commit = commit();
    results.machine = machine();
    results.command.clone_from(&options.command);
    Ok(Some(results))
}

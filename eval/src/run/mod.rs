//! How is a suite run, from a name to finished results?

mod answer;
mod dataset;
mod fold;
mod multi_dataset;
mod options;
pub mod replay;
mod route;
mod showcase;
mod tallies;
mod timing;
mod truth;
mod worlds;

use anyhow::Result;

pub(crate) use fold::{learn_all, live};
pub use options::RunOptions;
pub use showcase::{Showcase, Shown, SuiteRun};

use crate::data::Worlds;
use crate::judge::judge_all;
use crate::provenance::{commit, machine};
use crate::suite::{Protocol, Suite};

/// Runs a suite and gives its results, with what pictures can show of them; a synthetic suite also
/// those of its control world.
pub fn run(suite: &Suite, options: &RunOptions) -> Result<Vec<SuiteRun>> {
    let mut parts: &[String] = &[];
    let mut all = match &suite.protocol {
        Protocol::Synthetic {
            num_seeds,
            num_learn,
            num_query,
        } => {
            let worlds = Worlds {
                seeds: options.worlds.unwrap_or(*num_seeds),
                learn: *num_learn,
                query: *num_query,
            };
            worlds::run_worlds(suite, &worlds, &*options.extractor()?)?.into()
        }
        Protocol::MultiDataset {
            suites,
            leave_place_out,
            num_seeds,
        } => {
            parts = suites;
            let parts = multi_dataset::MultiDataset {
                suites,
                leave_place_out: *leave_place_out,
                num_seeds: *num_seeds,
            };
            vec![SuiteRun {
                results: parts.run(suite, options)?,
                shown: None,
            }]
        }
        _ => vec![dataset::run_images(suite, options)?],
    };
    let other_features = match &options.extractor {
        Some(_) => Some(format!(
            "features of {}, not those of the shipped recipe",
            options.extractor()?.id()
        )),
        None => None,
    };
    for SuiteRun { results, .. } in &mut all {
        results.notes.extend(other_features.clone());
        results.judgement = judge_all(results, parts);
        results.commit = commit();
        results.machine = machine();
        results.command.clone_from(&options.command);
    }
    Ok(all)
}

//! How is a grid made, filled, looked into and kept?

mod add;
mod generations;
mod model;
mod predict;
mod quarantine;
mod robot;
mod show;

use anyhow::Result;
use clap::Subcommand;

use chronotope_terminal::{Outcome, Output};

/// The commands of grids.
#[derive(Debug, Subcommand)]
#[command(after_help = "\
Examples:
  chronotope grid build --maps patrols/ --out office.grid
  chronotope grid add office.grid --map patrol.yaml --time 2024-05-06T10:00:00Z
  chronotope grid predict office.grid --time 2024-05-07T14:00:00Z --out now.yaml
  chronotope grid explain office.grid --at 1.25 3.5 --time 2024-05-07T14:00:00Z
  chronotope grid verify office.grid")]
pub(super) enum GridCommand {
    Build(add::BuildArgs),
    Add(add::AddArgs),
    Predict(predict::PredictArgs),
    Export(predict::ExportArgs),
    Inspect(show::InspectArgs),
    Explain(show::ExplainArgs),
    Localize(robot::LocalizeArgs),
    Plan(robot::PlanArgs),
    Merge(add::MergeArgs),
    Verify(generations::VerifyArgs),
    Log(generations::LogArgs),
    Rollback(generations::RollbackArgs),
    Prune(generations::PruneArgs),
    Forget(generations::ForgetArgs),
    #[command(subcommand)]
    Quarantine(quarantine::QuarantineCommand),
}

pub(super) fn run(command: &GridCommand, out: &mut Output) -> Result<Outcome> {
    match command {
        GridCommand::Build(args) => add::build(args, out),
        GridCommand::Add(args) => add::add(args, out),
        GridCommand::Predict(args) => predict::predict(args, out),
        GridCommand::Export(args) => predict::export(args, out),
        GridCommand::Inspect(args) => show::inspect(args, out),
        GridCommand::Explain(args) => show::explain(args, out),
        GridCommand::Localize(args) => robot::localize(args, out),
        GridCommand::Plan(args) => robot::plan(args, out),
        GridCommand::Merge(args) => add::merge(args, out),
        GridCommand::Verify(args) => generations::verify(args, out),
        GridCommand::Log(args) => generations::log(args, out),
        GridCommand::Rollback(args) => generations::rollback(args, out),
        GridCommand::Prune(args) => generations::prune(args, out),
        GridCommand::Forget(args) => generations::forget(args, out),
        GridCommand::Quarantine(command) => quarantine::run(command, out),
    }
}

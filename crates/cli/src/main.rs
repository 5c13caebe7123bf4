//! How is the engine used from a terminal?
//!
//! The command `chronotope`. Results go to stdout (JSON Lines with `--json`), diagnostics, warnings
//! and progress to stderr. Exit codes: 0 located or done, 1 unknown, ambiguous or problems found, 2
//! an error, 130 interrupted. Nothing here computes: each command reads its arguments, calls the
//! rooms below and shows what they say.

#[macro_use]
extern crate chronotope_terminal;

mod build;
mod calibrate;
mod check;
mod edge;
mod exchange;
mod explore;
mod explore_data;
mod explore_output;
mod generations;
mod grid;
mod held;
mod inspect;
mod live;
mod localize;
mod make_index;
mod merge;
mod pictures;
mod place;
mod predict;
mod progress;
mod spectrum;
mod spectrum_svg;
#[cfg(feature = "parquet")]
mod tables;
mod unpacked;
mod warnings;
mod way_map_file;
mod way_maps;
mod within;

use std::process::ExitCode;

use anyhow::Result;
use clap::{ArgAction, Parser, Subcommand};

use chronotope_terminal::{Outcome, Output, begin, end};

/// Visual topological localisation that knows what each place looks like at a given time.
#[derive(Debug, Parser)]
#[command(
    name = "chronotope",
    version,
    after_help = "\
Exit codes: 0 located or done; 1 unknown, ambiguous or problems found; 2 an error; 130 interrupted.

Examples:
  chronotope dataset check photos/
  chronotope map build --data photos/ --out street.map
  chronotope localize street.map now.jpg --time 2024-05-01T08:30:00Z
  chronotope predict street.map --time 2024-05-01T08:30:00Z --node door
  chronotope spectrum door.csv"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print more on stderr; twice for details.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    verbose: u8,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Build maps, look into them, keep them.
    #[command(subcommand)]
    Map(MapCommand),
    Localize(localize::LocalizeArgs),
    Predict(predict::PredictArgs),
    Spectrum(spectrum::SpectrumArgs),
    #[command(subcommand)]
    Explore(explore::ExploreCommand),
    /// Learn occupancy grids that know the hour, and predict maps of any time.
    #[command(subcommand)]
    Grid(grid::GridCommand),
    /// Look into folders of images.
    #[command(subcommand)]
    Dataset(DatasetCommand),
}

#[derive(Debug, Subcommand)]
#[command(after_help = "\
Examples:
  chronotope map build --data photos/ --out street.map
  chronotope map update street.map --data june/
  chronotope map inspect street.map
  chronotope map verify street.map
  chronotope map log street.map
  chronotope map held street.map
  chronotope map merge monday.map tuesday.map --out week.map")]
enum MapCommand {
    Build(build::BuildArgs),
    Update(build::UpdateArgs),
    Inspect(inspect::InspectArgs),
    Verify(inspect::VerifyArgs),
    Calibrate(calibrate::CalibrateArgs),
    Merge(merge::MergeArgs),
    Export(exchange::ExportArgs),
    Import(exchange::ImportArgs),
    Log(generations::LogArgs),
    Rollback(generations::RollbackArgs),
    Prune(generations::PruneArgs),
    Edge(edge::EdgeArgs),
    Place(place::PlaceArgs),
    Visit(place::VisitArgs),
    Held(held::HeldArgs),
    Accept(held::AcceptArgs),
    Drop(held::DropArgs),
    Forget(held::ForgetArgs),
}

#[derive(Debug, Subcommand)]
#[command(after_help = "\
Examples:
  chronotope dataset check photos/
  chronotope dataset index photos/ --from folders")]
enum DatasetCommand {
    Check(check::CheckArgs),
    Index(make_index::MakeIndexArgs),
}

/// The error where Parquet was left out of this command.
#[cfg(not(feature = "parquet"))]
fn without_parquet(path: &std::path::Path) -> anyhow::Error {
    use fremen::{Error, ErrorKind};
    let message = "this command was built without Parquet";
    let error = Error::new(ErrorKind::Config, message).with_path(path);
    let help = "build it with `cargo install --path crates/cli --features parquet`";
    error.with_help(help).into()
}

/// Runs the command that the process's arguments name; usage errors and `--help` end the process.
fn main() -> ExitCode {
    let cli = Cli::parse();
    end(begin(cli.verbose).and_then(|()| cli.run()))
}

impl Cli {
    fn run(self) -> Result<Outcome> {
        let mut out = Output::stdout();
        match self.command {
            Command::Map(MapCommand::Build(args)) => build::run(&args, &mut out),
            Command::Map(MapCommand::Update(args)) => build::update(&args, &mut out),
            Command::Map(MapCommand::Inspect(args)) => inspect::inspect(&args, &mut out),
            Command::Map(MapCommand::Verify(args)) => inspect::verify(&args, &mut out),
            Command::Map(MapCommand::Calibrate(args)) => calibrate::run(&args, &mut out),
            Command::Map(MapCommand::Merge(args)) => merge::run(&args, &mut out),
            Command::Map(MapCommand::Export(args)) => exchange::export(&args, &mut out),
            Command::Map(MapCommand::Import(args)) => exchange::import(&args, &mut out),
            Command::Map(MapCommand::Log(args)) => generations::log(&args, &mut out),
            Command::Map(MapCommand::Rollback(args)) => generations::rollback(&args, &mut out),
            Command::Map(MapCommand::Prune(args)) => generations::prune(&args, &mut out),
            Command::Map(MapCommand::Edge(args)) => edge::run(&args, &mut out),
            Command::Map(MapCommand::Place(args)) => place::place(&args, &mut out),
            Command::Map(MapCommand::Visit(args)) => place::visit(&args, &mut out),
            Command::Map(MapCommand::Held(args)) => held::held(&args, &mut out),
            Command::Map(MapCommand::Accept(args)) => held::accept(&args, &mut out),
            Command::Map(MapCommand::Drop(args)) => held::drop_held(&args, &mut out),
            Command::Map(MapCommand::Forget(args)) => held::forget(&args, &mut out),
            Command::Localize(args) => localize::run(&args, &mut out),
            Command::Predict(args) => predict::run(&args, &mut out),
            Command::Spectrum(args) => spectrum::run(&args, &mut out),
            Command::Explore(command) => explore::run(&command, &mut out),
            Command::Grid(command) => grid::run(&command, &mut out),
            Command::Dataset(DatasetCommand::Check(args)) => check::run(&args, &mut out),
            Command::Dataset(DatasetCommand::Index(args)) => make_index::run(&args, &mut out),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn arguments_are_declared_without_contradiction() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_shows_an_example() {
        fn visit(command: &clap::Command) {
            let help = command.get_after_help().map(ToString::to_string);
            assert!(
                help.is_some_and(|help| help.contains("chronotope ")),
                "{} has no example",
                command.get_name()
            );
            command.get_subcommands().for_each(visit);
        }
        let command = Cli::command();
        visit(&command);
    }
}

//! How are bags used from a terminal?
//!
//! The command `chronotope-bags`, with the words of `chronotope`. Results go to stdout (JSON Lines
//! with `--json`), diagnostics and warnings to stderr. Exit codes: 0 located or done, 1 unknown,
//! ambiguous or problems found, 2 an error, 130 interrupted.

#[macro_use]
extern crate chronotope_terminal;

mod command;

use std::process::ExitCode;

use anyhow::Result;
use clap::{ArgAction, Parser, Subcommand};

use chronotope_terminal::{Outcome, Output, begin, end};
use command::{build, check, layout, localize};

/// Visual localisation from ROS 2 bags: maps from what a robot has recorded, answers back into bags.
#[derive(Debug, Parser)]
#[command(
    name = "chronotope-bags",
    version,
    after_help = "\
A BAG is an MCAP file, a .db3 file, or the folder that `ros2 bag record` has written.
Exit codes: 0 located or done; 1 unknown, ambiguous or problems found; 2 an error; 130 interrupted.

Examples:
  chronotope-bags check monday.mcap
  chronotope-bags build monday.mcap --out site.map --places poses:/odom
  chronotope-bags update site.map tuesday.mcap --places poses:/odom
  chronotope-bags localize site.map wednesday.mcap --out answers.mcap
  chronotope-bags layout > foxglove.json"
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
    Check(check::CheckArgs),
    Build(build::BuildArgs),
    Update(build::UpdateArgs),
    Localize(localize::LocalizeArgs),
    Layout(layout::LayoutArgs),
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
            Command::Check(args) => check::run(&args, &mut out),
            Command::Build(args) => build::build(&args, &mut out),
            Command::Update(args) => build::update(&args, &mut out),
            Command::Localize(args) => localize::run(&args, &mut out),
            Command::Layout(args) => layout::run(&args, &mut out),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn arguments_are_declared_without_contradiction_and_every_command_shows_an_example() {
        Cli::command().debug_assert();
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string);
            assert!(
                help.is_some_and(|help| help.contains("chronotope-bags ")),
                "{} has no example",
                command.get_name()
            );
        }
    }
}

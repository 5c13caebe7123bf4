//! How does a robot with ROS 2 know at which place it is?
//!
//! The node `chronotope_node`: images in, the place out, in the topics that planners know. It is
//! thin: the loop is the engine's [`Robot`](chronotope::robot::Robot), images are read as those of
//! bags are, and the middleware is written in Rust, so no ROS is needed to build or run it.

mod arguments;
mod clerk;
mod diagnostics;
mod engine;
mod lettering;
mod lifecycle;
mod messages;
mod node;
mod overlay;
mod parameters;
mod planner;
mod services;
mod topics;

use std::process::ExitCode;

use anyhow::Result;
use chronotope_terminal::{Outcome, Output, begin, end, interrupt};
use clap::{ArgAction, Parser};

use crate::arguments::{RosArguments, split};
use crate::parameters::{Declared, PARAMETERS};

/// A ROS 2 node that says at which place of a map its camera is, and learns from what it sees.
#[derive(Debug, Parser)]
#[command(
    name = "chronotope_node",
    version,
    after_help = "\
Behind --ros-args stand parameters (-p name:=value, --params-file FILE) and names (-r from:=to).
ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST and RMW_IMPLEMENTATION (fastrtps or cyclonedds: how
services are called) count as for every node.

Subscribes: image, /clock. Publishes: current_node, closest_node, closest_node_distance, closest_edges,
~/localization, ~/debug/image, ~/transition_event, /diagnostics. Services: ~/pause_learning, ~/commit, ~/reload_map,
~/list_visits, ~/accept_visits, ~/drop_visits, ~/set_place, and those of parameters and of managed nodes (autostart).

Examples:
  chronotope_node --ros-args -p map:=site.map -r image:=/camera/image_raw
  chronotope_node --ros-args -p map:=site.map -p transport:=compressed -r image:=/camera/image/compressed
  chronotope_node --ros-args -p map:=site.map -p learn:=true -p use_sim_time:=true"
)]
struct Cli {
    /// Print all parameters with their defaults and descriptions, as a file for --params-file.
    #[arg(long)]
    parameters: bool,
    /// Print more on stderr; twice for details.
    #[arg(short, long, action = ArgAction::Count)]
    verbose: u8,
}

fn main() -> ExitCode {
    let (own, ros) = split(std::env::args());
    let cli = Cli::parse_from(own);
    end(begin(cli.verbose).and_then(|()| cli.run(&ros)))
}

impl Cli {
    fn run(&self, ros: &[String]) -> Result<Outcome> {
        if self.parameters {
            return print_parameters(&mut Output::stdout());
        }
        let names = RosArguments::parse(ros)?;
        interrupt::watch()?;
        node::run(&names)?;
        Ok(if interrupt::is_requested() {
            Outcome::Interrupted
        } else {
            Outcome::Good
        })
    }
}

fn print_parameters(out: &mut Output) -> Result<Outcome> {
    out.line("/**:\n  ros__parameters:")?;
    for declared in PARAMETERS {
        let fixed = if declared.is_read_only {
            " Read-only."
        } else {
            ""
        };
        out.line(format_args!("    # {}{fixed}", declared.description))?;
        out.line(format_args!("    {}: {}", declared.name, shown(declared)))?;
    }
    Ok(Outcome::Good)
}

fn shown(declared: &Declared) -> String {
    match declared.default {
        parameters::Default::Bool(value) => value.to_string(),
        parameters::Default::Integer(value) => value.to_string(),
        parameters::Default::Double(value) => format!("{value:?}"),
        parameters::Default::Text(value) => format!("\"{value}\""),
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
}

//! Which ways lead from place to place?

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};
use serde_json::json;

use chronotope::error::{Error, ErrorKind};
use chronotope::map::{Edge, Map, PlaceKey, Snapshot};
use chronotope_terminal::{Outcome, Output};

/// List, add or remove ways between places.
///
/// An edge has a direction; a way that can be gone both ways is two edges. A change is one
/// generation, which `map rollback` can take back.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map edge street.map list
  chronotope map edge street.map add door lamp --name corridor
  chronotope map edge street.map remove door lamp")]
pub(super) struct EdgeArgs {
    /// The map file.
    map: PathBuf,
    #[command(subcommand)]
    command: EdgeCommand,
}

#[derive(Debug, Subcommand)]
enum EdgeCommand {
    /// Show all edges.
    #[command(after_help = "Example:\n  chronotope map edge street.map list --json")]
    List {
        /// One JSON object an edge.
        #[arg(long)]
        json: bool,
    },
    /// Add an edge.
    #[command(after_help = "Example:\n  chronotope map edge street.map add door lamp")]
    Add(EndArgs),
    /// Remove the edges from one place to another.
    #[command(after_help = "Example:\n  chronotope map edge street.map remove door lamp")]
    Remove(EndArgs),
}

#[derive(Debug, Args)]
struct EndArgs {
    /// The place where it starts.
    #[arg(value_parser = key)]
    from: PlaceKey,
    /// The place where it ends.
    #[arg(value_parser = key)]
    to: PlaceKey,
    /// What it is called; without this, `remove` removes all edges between the two.
    #[arg(long)]
    name: Option<String>,
}

fn key(text: &str) -> chronotope::Result<PlaceKey> {
    PlaceKey::written(text)
}

pub(super) fn run(args: &EdgeArgs, out: &mut Output) -> Result<Outcome> {
    let is_list = matches!(args.command, EdgeCommand::List { .. });
    let map = if is_list {
        Map::open_read_only(&args.map)?
    } else {
        Map::open(&args.map)?
    };
    if let EdgeCommand::List { json } = &args.command {
        for edge in map.snapshot().edges() {
            if *json {
                out.json(&json!(edge))?;
            } else {
                let line = format!("{} -> {}  {}", edge.from, edge.to, edge.name);
                out.line(line.trim_end())?;
            }
        }
        return Ok(Outcome::Good);
    }
    let mut num_before = 0;
    let generation = map
        .update(|snapshot| {
            num_before = snapshot.edges().len();
            changed(snapshot, &args.command)
        })
        .map_err(|error| error.with_path(&args.map))?;
    out.line(format_args!(
        "{}: {} edges, {num_before} before, generation {generation}",
        args.map.display(),
        map.snapshot().edges().len()
    ))?;
    Ok(Outcome::Good)
}

/// The map with an edge more or less.
fn changed(snapshot: &Snapshot, command: &EdgeCommand) -> chronotope::Result<Snapshot> {
    let mut snapshot = snapshot.clone();
    let num_before = snapshot.edges().len();
    match command {
        EdgeCommand::List { .. } => {}
        EdgeCommand::Add(ends) => {
            snapshot.add_edge(Edge {
                from: ends.from.clone(),
                to: ends.to.clone(),
                name: ends.name.clone().unwrap_or_default(),
            })?;
        }
        EdgeCommand::Remove(ends) => {
            snapshot.retain_edges(|edge| {
                let is_meant = (&edge.from, &edge.to) == (&ends.from, &ends.to);
                !(is_meant && ends.name.as_ref().is_none_or(|name| *name == edge.name))
            });
            if snapshot.edges().len() == num_before {
                let what = format!(
                    "there is no such edge from `{}` to `{}`",
                    ends.from, ends.to
                );
                return Err(Error::new(ErrorKind::NotFound, what)
                    .with_help("`chronotope map edge MAP list` shows all"));
            }
        }
    }
    Ok(snapshot)
}

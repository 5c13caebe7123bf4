//! How are places and visits of a map corrected by hand?

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};
use serde_json::json;

use chronotope::error::{Error, ErrorKind};
use chronotope::learn::{drop_visit, join_places, remove_place, rename_place};
use chronotope::map::{Map, PlaceKey, Snapshot, VisitId};
use chronotope_terminal::{Outcome, Output};

/// Rename, remove or join places.
///
/// Each change is a generation that `map rollback` takes back.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map place street.map rename door gate
  chronotope map place street.map remove scaffold
  chronotope map place street.map join gate gate-from-the-left")]
pub(super) struct PlaceArgs {
    /// The map file.
    map: PathBuf,
    #[command(subcommand)]
    command: PlaceCommand,
}

#[derive(Debug, Subcommand)]
enum PlaceCommand {
    /// Give a place another name.
    #[command(after_help = "Example:\n  chronotope map place street.map rename door gate")]
    Rename {
        /// Its name so far.
        from: String,
        /// Its name from now on.
        to: String,
    },
    /// Remove a place with its visits and edges.
    #[command(after_help = "Example:\n  chronotope map place street.map remove scaffold")]
    Remove {
        /// Its name.
        place: String,
    },
    /// Make two places one: the visits of the second become visits of the first.
    #[command(after_help = "Example:\n  chronotope map place street.map join gate door")]
    Join {
        /// The place that stays.
        place: String,
        /// The place that becomes part of it.
        other: String,
    },
}

/// List visits, or drop one.
///
/// Dropping is a generation that `map rollback` takes back.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map visit street.map list door
  chronotope map visit street.map drop 5f3a01c2")]
pub(super) struct VisitArgs {
    /// The map file.
    map: PathBuf,
    #[command(subcommand)]
    command: VisitCommand,
}

#[derive(Debug, Subcommand)]
enum VisitCommand {
    /// List the visits that the map has learnt.
    #[command(after_help = "Example:\n  chronotope map visit street.map list door")]
    List {
        /// Only of this place.
        place: Option<String>,
        /// One JSON object a visit.
        #[arg(long)]
        json: bool,
    },
    /// Drop a visit, as if it had never been.
    #[command(after_help = "Example:\n  chronotope map visit street.map drop 5f3a01c2")]
    Drop {
        /// Its identity, or the first digits of it.
        id: String,
    },
}

pub(super) fn place(args: &PlaceArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.map)?;
    let before = map.snapshot();
    let key = |text: &str| known_or_written(&before, text);
    let changed = match &args.command {
        PlaceCommand::Rename { from, to } => {
            rename_place(&before, &key(from)?, &PlaceKey::written(to)?)
        }
        PlaceCommand::Remove { place } => remove_place(&before, &key(place)?),
        PlaceCommand::Join { place, other } => join_places(&before, &key(place)?, &key(other)?),
    }
    .map_err(|error| error.with_path(&args.map))?;
    let generation = map.replace(&changed)?;
    out.line(format_args!(
        "{}: {} places, generation {generation} (to undo: map rollback --to {})",
        args.map.display(),
        changed.nodes().len(),
        before.generation()
    ))?;
    Ok(Outcome::Good)
}

pub(super) fn visit(args: &VisitArgs, out: &mut Output) -> Result<Outcome> {
    match &args.command {
        VisitCommand::List { place, json } => {
            let map = Map::open_read_only(&args.map)?;
            list(&map.snapshot(), place.as_deref(), *json, out)?;
        }
        VisitCommand::Drop { id } => {
            let map = Map::open(&args.map)?;
            let before = map.snapshot();
            let id = one(&before, id).map_err(|error| error.with_path(&args.map))?;
            let (left, place) = drop_visit(&before, id)?;
            let generation = map.replace(&left)?;
            out.line(format_args!(
                "{}: a visit of {place} dropped, generation {generation} (to undo: map rollback \
                 --to {})",
                args.map.display(),
                before.generation()
            ))?;
        }
    }
    Ok(Outcome::Good)
}

fn list(map: &Snapshot, place: Option<&str>, json: bool, out: &mut Output) -> Result<()> {
    let only = place.map(|text| known_or_written(map, text)).transpose()?;
    for node in map.nodes() {
        if only.as_ref().is_some_and(|only| only != node.key()) {
            continue;
        }
        for visit in node.visits() {
            let id = visit.id.to_string();
            if json {
                out.json(&json!({
                    "visit": id,
                    "place": node.key(),
                    "session": visit.session.to_string(),
                    "time": visit.time.to_string(),
                    "source": visit.source,
                }))?;
            } else {
                let start = id.get(..8).unwrap_or(&id);
                let line = format!("{start}  {}  {}  {}", visit.time, node.key(), visit.source);
                out.line(line.trim_end())?;
            }
        }
    }
    Ok(())
}

/// The place that is called so, however its letters are composed.
fn known_or_written(map: &Snapshot, text: &str) -> chronotope::Result<PlaceKey> {
    let as_it_is = PlaceKey::new(text)?;
    match map.find(&as_it_is) {
        Some(_) => Ok(as_it_is),
        None => PlaceKey::written(text),
    }
}

/// The one visit whose identity begins like this.
fn one(map: &Snapshot, text: &str) -> chronotope::Result<VisitId> {
    let text = text.to_lowercase();
    let visits = map.nodes().iter().flat_map(|node| node.visits());
    let mut found = visits.filter(|visit| visit.id.to_string().starts_with(&text));
    let (kind, message) = match (found.next(), found.next()) {
        (Some(visit), None) => return Ok(visit.id),
        (Some(_), Some(_)) => (
            ErrorKind::Config,
            format!("several visits begin with `{text}`"),
        ),
        (None, _) => (
            ErrorKind::NotFound,
            format!("no visit begins with `{text}`"),
        ),
    };
    Err(Error::new(kind, message).with_help("`chronotope map visit MAP list` shows all"))
}

//! Which visits does the map doubt, and what becomes of them?

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use chronotope::error::printable;
use chronotope::learn::{accept_held, forget_session};
use chronotope::map::{Map, Quarantine, SessionId, Snapshot, VisitId};
use chronotope_terminal::arguments::ShownMap;
use chronotope_terminal::config::Config;
use chronotope_terminal::{Outcome, Output};

/// List the visits that a map holds without having learnt them, each with the reason.
///
/// While it learns on, a map holds what does not agree with what was predicted of its place, images
/// on which next to nothing is to be seen, and times that cannot be right. `map accept` learns such
/// a visit after all, `map drop` forgets it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map held street.map
  chronotope map held street.map --json | jq .doubt")]
#[command(mut_arg("json", |arg| arg.help("One JSON object a visit")))]
pub(super) struct HeldArgs {
    #[command(flatten)]
    shown: ShownMap,
}

/// Learn visits that a map holds, after all.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map accept street.map 3f2a9c
  chronotope map accept street.map --all")]
pub(super) struct AcceptArgs {
    #[command(flatten)]
    which: Which,
    /// TOML with the table [learn]; a key that is given replaces that of the map's preset.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

/// Forget visits that a map holds.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map drop street.map 3f2a9c
  chronotope map drop street.map --all")]
pub(super) struct DropArgs {
    #[command(flatten)]
    which: Which,
}

#[derive(Debug, Args)]
struct Which {
    /// The map file.
    map: PathBuf,
    /// The visits, or the first digits of their identities, as `map held` lists them.
    #[arg(value_name = "ID", required_unless_present = "all")]
    ids: Vec<String>,
    /// Every visit that is held.
    #[arg(long, conflicts_with = "ids")]
    all: bool,
}

/// Forget all visits of one run of the robot.
///
/// This is a new generation: `map rollback` brings them back. Places stay, also where no visits are
/// left.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map forget street.map --session june
  chronotope map forget street.map --session a8288f34900a84daf29e082e068f2780")]
pub(super) struct ForgetArgs {
    /// The map file.
    map: PathBuf,
    /// The session's UUID, or the name it was derived from: that of the dataset that was learnt.
    #[arg(long, value_name = "UUID|NAME")]
    session: String,
}

pub(super) fn held(args: &HeldArgs, out: &mut Output) -> Result<Outcome> {
    let args = &args.shown;
    let map = Map::open_read_only(&args.map)?;
    let held = held_by(&map)?;
    let given_up = held.given_up().iter().map(|it| (it, true));
    for (it, is_given_up) in given_up.chain(held.visits().iter().map(|it| (it, false))) {
        if args.json {
            out.json(&json!({
                "visit": it.id.to_string(),
                "place": it.place,
                "session": it.session.to_string(),
                "time": it.time.to_string(),
                "source": it.source,
                "num_features": it.features.len(),
                "given_up": is_given_up,
                "doubt": it.reason,
                "reason": it.reason.to_string(),
            }))?;
        } else {
            let id = it.id.to_string();
            out.line(format_args!(
                "{}  {}  {}  {}: {}{}",
                id.get(..8).unwrap_or(&id),
                it.time,
                printable(it.place.as_str()),
                printable(&it.source),
                it.reason,
                if is_given_up {
                    " (its features were given up)"
                } else {
                    ""
                }
            ))?;
        }
    }
    if !held.given_up().is_empty() {
        note!(
            "note: of the {} oldest visits the features were given up, because more are not kept: they \
             cannot be accepted. `map drop` forgets them, and then their images can be learnt again",
            held.given_up().len()
        );
    }
    if held.num_forgotten() > 0 {
        note!(
            "note: {} more were held before these and are forgotten",
            held.num_forgotten()
        );
    }
    Ok(Outcome::Good)
}

pub(super) fn accept(args: &AcceptArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.which.map)?;
    let snapshot = map.snapshot();
    let config = Config::read_for(snapshot.meta(), args.config.as_deref())?;
    let ids = args.which.find(&map, false)?;
    let generation = accept_held(&map, &config.learn, &ids)?;
    out.line(format_args!(
        "{}: {} visits learnt, generation {generation}",
        map.path().display(),
        ids.len()
    ))?;
    Ok(Outcome::Good)
}

pub(super) fn drop_held(args: &DropArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.which.map)?;
    let ids = args.which.find(&map, true)?;
    let generation = map.drop_held(&ids)?;
    out.line(format_args!(
        "{}: {} visits dropped, generation {generation}",
        map.path().display(),
        ids.len()
    ))?;
    Ok(Outcome::Good)
}

pub(super) fn forget(args: &ForgetArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.map)?;
    let session = session_of(&map.snapshot(), &args.session);
    let (mut num_visits, mut before) = (0, 0);
    let generation = map
        .update(|snapshot| {
            let (forgotten, num_forgotten) = forget_session(snapshot, session)?;
            (num_visits, before) = (num_forgotten, snapshot.generation());
            Ok(forgotten)
        })
        .map_err(|error| error.with_path(&args.map))?;
    out.line(format_args!(
        "{}: {num_visits} visits forgotten, generation {generation} (to undo: map rollback --to \
         {before})",
        args.map.display(),
    ))?;
    Ok(Outcome::Good)
}

/// The session with this UUID, if the map has one, else the one derived from this name.
fn session_of(snapshot: &Arc<Snapshot>, text: &str) -> SessionId {
    let digits: String = text.chars().filter(|&c| c != '-').collect();
    let named = SessionId::derive(text);
    let uuid = (digits.len() == 32)
        .then(|| u128::from_str_radix(&digits, 16).ok())
        .flatten();
    let is_known = |session: SessionId| {
        let mut visits = snapshot.nodes().iter().flat_map(|node| node.visits());
        visits.any(|visit| visit.session == session)
    };
    match uuid.map(SessionId) {
        Some(session) if !is_known(named) => session,
        _ => named,
    }
}

fn held_by(map: &Map) -> Result<Quarantine> {
    Ok(Quarantine::of(&map.snapshot()).map_err(|error| error.with_path(map.path()))?)
}

impl Which {
    /// The visits that are meant; `with_given_up`: also of those that cannot be accepted.
    fn find(&self, map: &Map, with_given_up: bool) -> Result<Vec<VisitId>> {
        let held = held_by(map)?;
        if self.all {
            return Ok(held.ids(with_given_up));
        }
        Ok(held.choose(&self.ids, with_given_up).map_err(|error| {
            (error.with_path(map.path())).with_help("`chronotope map held` lists the visits")
        })?)
    }
}

//! How did this map come about, and how does it become again what it was?

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use chronotope::map::{Generation, Map, SessionId, Snapshot};
use chronotope::time::{Period, Time};
use chronotope_terminal::arguments::ShownMap;
use chronotope_terminal::output::{contents, hex};
use chronotope_terminal::{Outcome, Output};

/// List the generations of a map, oldest first.
///
/// A generation is what one commit left. Any of them can be returned to with `map rollback`. Below
/// them stand the runs (sessions) whose visits the newest one holds: `map forget` takes one back.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map log street.map
  chronotope map log street.map --json | jq .number")]
#[command(mut_arg("json", |arg| arg.help("One JSON object a generation")))]
pub(super) struct LogArgs {
    #[command(flatten)]
    shown: ShownMap,
}

/// Make a map again what it was at a generation.
///
/// This is a new generation on top of the old one: nothing is lost, and what is rolled back now can
/// be returned to in the same way.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map log street.map
  chronotope map rollback street.map --to 41")]
pub(super) struct RollbackArgs {
    /// The map file.
    map: PathBuf,
    /// The generation, as `map log` numbers them.
    #[arg(long, value_name = "GENERATION")]
    to: u64,
}

/// Forget old generations and make the file smaller.
///
/// The map stays what it is; only the way back to the generations that go is lost. Those that are
/// named by any of the options stay, the first, the newest and those where two lines part do
/// anyway.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map prune street.map --keep-last 10 --keep-daily
  chronotope map prune street.map --keep-last 1
  chronotope map prune street.map --keep 41 --dry-run")]
pub(super) struct PruneArgs {
    /// The map file.
    map: PathBuf,
    /// Keep so many of the newest.
    #[arg(long, value_name = "N", required_unless_present_any = ["keep_daily", "keep"])]
    keep_last: Option<usize>,
    /// Keep the last one of each day (UTC).
    #[arg(long)]
    keep_daily: bool,
    /// Keep this one, too; may be given several times.
    #[arg(long, value_name = "GENERATION")]
    keep: Vec<u64>,
    /// Only say what would go.
    #[arg(long)]
    dry_run: bool,
}

pub(super) fn log(args: &LogArgs, out: &mut Output) -> Result<Outcome> {
    let args = &args.shown;
    let map = Map::open_read_only(&args.map)?;
    let generations = map.generations()?;
    let sessions = sessions_of(&map.snapshot());
    let newest = generations.last().map(|it| it.number);
    let lead_here = line_of(&generations);
    let by_number: BTreeMap<u64, &Generation> =
        generations.iter().map(|it| (it.number, it)).collect();
    for it in &generations {
        let before = it.parent.and_then(|parent| by_number.get(&parent).copied());
        let is_in_line = lead_here.contains(&it.number);
        let is_rollback = before.is_some_and(|before| before.digest == it.digest);
        let added = |count: fn(&Generation) -> usize| {
            count(it) as i64 - before.map_or(0, |before| count(before) as i64)
        };
        let places = added(|it| it.num_places);
        let visits = added(|it| it.num_visits);
        let features = added(|it| it.num_features);
        if args.json {
            let sessions: Vec<_> = (sessions.iter())
                .filter(|_| newest == Some(it.number))
                .map(|(session, run)| {
                    json!({
                        "session": session.to_string(),
                        "num_visits": run.num_visits,
                        "first": run.first.to_string(),
                        "last": run.last.to_string(),
                    })
                })
                .collect();
            out.json(&json!({
                "number": it.number,
                "parent": it.parent,
                "time": it.time.to_string(),
                "is_in_line": is_in_line,
                "is_rollback": is_rollback,
                "num_places": it.num_places,
                "num_visits": it.num_visits,
                "num_features": it.num_features,
                "added_places": places,
                "added_visits": visits,
                "added_features": features,
                "digest": hex(&it.digest),
                "sessions": sessions,
            }))?;
            continue;
        }
        let what = match it.parent {
            None => "the empty map".into(),
            Some(parent) if is_rollback => format!("back to generation {parent}"),
            Some(0) if it.number > 1 => {
                format!("written anew: {places} places, {visits} visits, {features} features")
            }
            // Poses, edges, attachments, preset and zone are not counted.
            Some(_) if (places, visits, features) == (0, 0, 0) => "no visits, other changes".into(),
            Some(_) => format!("{places:+} places, {visits:+} visits, {features:+} features"),
        };
        out.line(format_args!(
            "{:>6}  {}  {what}{}",
            it.number,
            it.time,
            if is_in_line { "" } else { " (rolled back)" }
        ))?;
    }
    if !args.json {
        for (session, run) in &sessions {
            out.line(format_args!(
                "session {session}  {} visits, {} to {}",
                run.num_visits, run.first, run.last
            ))?;
        }
    }
    Ok(Outcome::Good)
}

/// What a map holds of one run.
struct Run {
    num_visits: usize,
    first: Time,
    last: Time,
}

/// The runs whose visits a map holds, in order of their first one.
fn sessions_of(snapshot: &Snapshot) -> Vec<(SessionId, Run)> {
    let mut runs: BTreeMap<SessionId, Run> = BTreeMap::new();
    for visit in snapshot.nodes().iter().flat_map(|node| node.visits()) {
        let run = runs.entry(visit.session).or_insert(Run {
            num_visits: 0,
            first: visit.time,
            last: visit.time,
        });
        run.num_visits += 1;
        run.first = run.first.min(visit.time);
        run.last = run.last.max(visit.time);
    }
    let mut runs: Vec<(SessionId, Run)> = runs.into_iter().collect();
    runs.sort_by_key(|(session, run)| (run.first, *session));
    runs
}

/// The generations that lead to the newest one.
fn line_of(generations: &[Generation]) -> BTreeSet<u64> {
    let parents: BTreeMap<u64, Option<u64>> = generations
        .iter()
        .map(|it| (it.number, it.parent))
        .collect();
    let newest = generations.last().map(|it| it.number);
    std::iter::successors(newest, |number| parents.get(number).copied().flatten()).collect()
}

pub(super) fn rollback(args: &RollbackArgs, out: &mut Output) -> Result<Outcome> {
    let map = Map::open(&args.map)?;
    let before = map.snapshot().generation();
    let generation = map.rollback(args.to)?;
    let state = contents(&map.snapshot().summary(), "");
    if generation == before {
        out.line(format_args!(
            "{}: generation {generation} is the newest already: {state}",
            args.map.display()
        ))?;
    } else {
        out.line(format_args!(
            "{}: generation {generation} is as {} was: {state} (to undo: --to {before})",
            args.map.display(),
            args.to
        ))?;
    }
    Ok(Outcome::Good)
}

pub(super) fn prune(args: &PruneArgs, out: &mut Output) -> Result<Outcome> {
    let map = if args.dry_run {
        Map::open_read_only(&args.map)?
    } else {
        Map::open(&args.map)?
    };
    let generations = map.generations()?;
    let keep = kept(&generations, args);
    if args.dry_run {
        let goes = |it: &&Generation| !keep.contains(&it.number);
        let numbers: Vec<String> = (generations.iter().filter(goes))
            .map(|it| it.number.to_string())
            .collect();
        out.line(format_args!(
            "{}: {} of {} generations may go: {}",
            args.map.display(),
            numbers.len(),
            generations.len(),
            numbers.join(" ")
        ))?;
        return Ok(Outcome::Good);
    }
    let pruned = map.prune(&keep)?;
    out.line(format_args!(
        "{}: {} of {} generations forgotten, {} bytes are now {}",
        args.map.display(),
        pruned.num_dropped,
        generations.len(),
        pruned.num_bytes_before,
        pruned.num_bytes_after
    ))?;
    Ok(Outcome::Good)
}

/// The generations that the options name, with the first and the newest.
fn kept(generations: &[Generation], args: &PruneArgs) -> BTreeSet<u64> {
    let mut keep: BTreeSet<u64> = args.keep.iter().copied().collect();
    keep.extend(generations.first().map(|it| it.number));
    let num_last = args.keep_last.unwrap_or(0).max(1);
    keep.extend(generations.iter().rev().take(num_last).map(|it| it.number));
    if args.keep_daily {
        let day = |it: &Generation| it.time.as_us().div_euclid(Period::DAY.as_us());
        // The last one of a day replaces those before it.
        let last_of_day: BTreeMap<i64, u64> =
            generations.iter().map(|it| (day(it), it.number)).collect();
        keep.extend(last_of_day.into_values());
    }
    keep
}

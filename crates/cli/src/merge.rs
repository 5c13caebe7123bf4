//! How do maps of several robots or days become one?

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use clap::Args;

use chronotope::error::{Error, ErrorKind};
use chronotope::learn::{self, LearnConfig};
use chronotope::map::{Map, Quarantine, Snapshot};
use chronotope_terminal::config::Config;
use chronotope_terminal::output::contents;
use chronotope_terminal::{Outcome, Output};

/// Merge maps of the same places into a new one.
///
/// Visits that several maps share are one visit. The order of the maps does not matter, and merging
/// what was merged already changes nothing. Maps of other images (extractor, size, crop), or that
/// disagree on where a place is, are refused and the conflicts named; so are maps that have nothing
/// in common, neither a visit nor a place that looks alike, because equal names may stand for
/// different places. --disjoint merges them all the same.
///
/// Every feature keeps the history that its own map gave it: two robots' features of one thing stay
/// two. With --relearn all visits are learnt again instead, as if one robot had made them; that
/// needs maps built with --keep-appearances all (or with preset `lttl`).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map merge monday.map tuesday.map --out week.map
  chronotope map merge a.map b.map c.map --out fleet.map --relearn
  chronotope map merge street.map park.map --out town.map --disjoint")]
pub(super) struct MergeArgs {
    /// The map files.
    #[arg(required = true, num_args = 2.., value_name = "MAP")]
    maps: Vec<PathBuf>,
    /// The file to write; one that exists is never overwritten.
    #[arg(long, value_name = "MAP")]
    out: PathBuf,
    /// Learn all visits again, in order of time.
    #[arg(long)]
    relearn: bool,
    /// Merge maps that have nothing in common: of places with different names.
    #[arg(long)]
    disjoint: bool,
    /// TOML with the table [learn], for --relearn; a key replaces that of the maps' preset.
    #[arg(long, value_name = "FILE", requires = "relearn")]
    config: Option<PathBuf>,
}

pub(super) fn run(args: &MergeArgs, out: &mut Output) -> Result<Outcome> {
    Map::refuse_existing(&args.out)?;
    let maps = (args.maps.iter())
        .map(|path| Ok(Map::open_read_only(path)?.snapshot()))
        .collect::<Result<Vec<Arc<Snapshot>>>>()?;
    let mut num_visits = 0;
    for (path, map) in args.maps.iter().zip(&maps) {
        num_visits += map.summary().num_visits;
        let others = (map.attachments().keys())
            .filter(|name| *name != "reobservation" && !Quarantine::is_named(name));
        for name in others {
            note!(
                "note: the attachment `{name}` of {} describes that map alone and is left out",
                path.display()
            );
        }
    }
    let maps: Vec<&Snapshot> = maps.iter().map(|map| &**map).collect();
    if !args.disjoint {
        refuse_strangers(&args.maps, &maps)?;
    }
    let mut merged = learn::merge(&maps)?;
    if args.relearn {
        let config = Config::read_for(merged.meta(), args.config.as_deref())?;
        merged = learn::relearn(config.learn, &merged)?;
    }
    Map::create_from(&args.out, &merged)?;
    let summary = merged.summary();
    let num_shared = num_visits - summary.num_visits;
    let contents = contents(
        &summary,
        format_args!(" ({num_shared} were in more than one map)"),
    );
    out.line(format_args!("{}: {contents}", args.out.display()))?;
    Ok(Outcome::Good)
}

/// An error if a map has nothing in common with the first one, also not by way of others.
fn refuse_strangers(paths: &[PathBuf], maps: &[&Snapshot]) -> Result<()> {
    let Some(stranger) = learn::stranger_among(&LearnConfig::default(), maps) else {
        return Ok(());
    };
    let message = format!(
        "this map has nothing in common with {}: no visit, and no place of one name that looks \
         alike",
        paths[0].display()
    );
    Err(Error::new(ErrorKind::Config, message)
        .with_path(&paths[stranger])
        .with_help("--disjoint merges maps of different places")
        .into())
}

//! Which maps does a grid not believe, and what becomes of them?

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, Subcommand};
use serde_json::json;

use super::super::progress::Progress;
use super::model::ModelArgs;
use super::predict::write_png;
use chronotope_terminal::{Outcome, Output};
use fremen::Error;
use fremen_grid::file::Access;
use fremen_grid::lifelong::{LifelongGrid, MapId, choose};
use fremen_grid::picture::contradictions_png;
use fremen_grid::registration::{GuardConfig, Quarantined, Reason};

/// Look at maps that `grid add` has not believed, and decide what becomes of them.
#[derive(Debug, Subcommand)]
#[command(after_help = "\
Examples:
  chronotope grid quarantine list office.grid
  chronotope grid quarantine accept office.grid 3f2a9c
  chronotope grid quarantine drop office.grid --all")]
pub(crate) enum QuarantineCommand {
    List(ListArgs),
    Accept(WhichArgs),
    Drop(DropArgs),
}

/// List the maps in quarantine, oldest first, each with the reason.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid quarantine list office.grid
  chronotope grid quarantine list office.grid --png evidence/
  chronotope grid quarantine list office.grid --json | jq .disagreement")]
pub(crate) struct ListArgs {
    /// The grid file.
    grid: PathBuf,
    /// A folder, which may be there, for a picture of each: what the map shows in shades of grey, new
    /// surfaces in red, lost ones in blue.
    #[arg(long, value_name = "FOLDER")]
    png: Option<PathBuf>,
    /// One JSON object a map.
    #[arg(long)]
    json: bool,
}

/// Integrate maps in quarantine, after all.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid quarantine accept office.grid 3f2a9c
  chronotope grid quarantine accept office.grid --all")]
pub(crate) struct WhichArgs {
    /// The grid file.
    grid: PathBuf,
    /// The maps, or the first digits of their identities, as `grid quarantine list` shows them.
    #[arg(value_name = "ID", required_unless_present = "all")]
    ids: Vec<String>,
    /// Every map in quarantine.
    #[arg(long, conflicts_with = "ids")]
    all: bool,
}

/// Forget maps in quarantine.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid quarantine drop office.grid 3f2a9c
  chronotope grid quarantine drop office.grid --all")]
pub(crate) struct DropArgs {
    #[command(flatten)]
    which: WhichArgs,
}

pub(super) fn run(command: &QuarantineCommand, out: &mut Output) -> Result<Outcome> {
    match command {
        QuarantineCommand::List(args) => list(args, out),
        QuarantineCommand::Accept(args) => accept(args, out),
        QuarantineCommand::Drop(args) => discard(&args.which, out),
    }
}

/// Opens a grid with its quarantine, by the model that judges maps.
pub(super) fn open(path: &Path, access: Access, model: &ModelArgs) -> Result<LifelongGrid> {
    let mut progress: Option<Progress> = None;
    let config = model.config()?;
    let opened = LifelongGrid::open(
        path,
        access,
        &config,
        GuardConfig::default(),
        |done, all| {
            let bar = progress.get_or_insert_with(|| Progress::new("looking at its maps", all));
            bar.reach(done);
        },
    )?;
    Ok(opened)
}

fn list(args: &ListArgs, out: &mut Output) -> Result<Outcome> {
    let grid = open(&args.grid, Access::ReadOnly, &ModelArgs::default())?;
    if let Some(folder) = &args.png {
        std::fs::create_dir_all(folder).map_err(|cause| Error::io(folder, cause))?;
    }
    for held in grid.quarantined() {
        let id = MapId::of(held).to_string();
        let judgement = &held.judgement;
        let picture = match &args.png {
            Some(folder) => {
                let path = folder.join(format!("{id}.png"));
                let [appeared, vanished] = &held.contradictions;
                let bytes = contradictions_png(&held.map, appeared, vanished)?;
                write_png(&path, &bytes, &[&args.grid])?;
                Some(path)
            }
            None => None,
        };
        if args.json {
            out.json(&json!({
                "id": id,
                "time": judgement.time.to_string(),
                "observer": held.observer,
                "reason": judgement.reason.map(Reason::name),
                "disagreement": judgement.disagreement,
                "expected": judgement.expected,
                "limit": finite(judgement.limit),
                "shift_m": judgement.registration.map(|it| it.shift_m),
                "shift_limit_m": finite(judgement.shift_limit_m),
                "num_new_surfaces": held.contradictions[0].len(),
                "num_lost_surfaces": held.contradictions[1].len(),
                "picture": picture,
            }))?;
        } else {
            out.line(format_args!(
                "{}  {}  {}: {}",
                &id[..8],
                judgement.time,
                named(&held.observer),
                judgement.why()
            ))?;
        }
    }
    if grid.quarantined().is_empty() {
        note!("{}: no map is in quarantine", args.grid.display());
    }
    if grid.num_dropped() > 0 {
        note!(
            "note: {} maps were dropped from quarantine, because no more than {} are kept",
            grid.num_dropped(),
            GuardConfig::default().num_kept
        );
    }
    Ok(Outcome::Good)
}

fn accept(args: &WhichArgs, out: &mut Output) -> Result<Outcome> {
    let mut grid = open(&args.grid, Access::ReadWrite, &ModelArgs::default())?;
    let ids = args.find(grid.quarantined())?;
    for &id in &ids {
        grid.accept(id)?;
    }
    finish(&mut grid, args, ids.len(), "integrated", out)
}

fn discard(args: &WhichArgs, out: &mut Output) -> Result<Outcome> {
    let mut grid = open(&args.grid, Access::ReadWrite, &ModelArgs::default())?;
    let ids = args.find(grid.quarantined())?;
    for &id in &ids {
        grid.discard(id);
    }
    finish(&mut grid, args, ids.len(), "dropped", out)
}

fn finish(
    grid: &mut LifelongGrid,
    args: &WhichArgs,
    num: usize,
    what: &str,
    out: &mut Output,
) -> Result<Outcome> {
    grid.commit().map_err(|error| error.with_path(&args.grid))?;
    out.line(format_args!(
        "{}: {num} maps {what}, {} in quarantine, generation {}",
        args.grid.display(),
        grid.quarantined().len(),
        grid.file().generation()
    ))?;
    Ok(Outcome::Good)
}

impl WhichArgs {
    fn find(&self, held: &[Quarantined]) -> Result<Vec<MapId>> {
        if self.all {
            return Ok(held.iter().map(MapId::of).collect());
        }
        choose(held, &self.ids).map_err(|error| {
            error
                .with_path(&self.grid)
                .with_help("`chronotope grid quarantine list` shows them")
                .into()
        })
    }
}

/// JSON knows no infinity.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn named(observer: &str) -> &str {
    if observer.is_empty() {
        "without a name"
    } else {
        observer
    }
}

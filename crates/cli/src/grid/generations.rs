//! How did this grid come about, is it sound, and how does it become again what it was?

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use chronotope_terminal::output::hex;
use chronotope_terminal::{Outcome, Output};
use fremen::Time;
use fremen_grid::GridFile;
use fremen_grid::file::Access;

/// Check a grid file and change nothing: pages, checksums of rows, the digest of the content.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid verify office.grid")]
pub(crate) struct VerifyArgs {
    /// The grid file.
    grid: PathBuf,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

/// List the generations of a grid, oldest first.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid log office.grid")]
pub(crate) struct LogArgs {
    /// The grid file.
    grid: PathBuf,
    /// One JSON object a generation.
    #[arg(long)]
    json: bool,
}

/// Make a grid again what it was at a generation, as a new generation.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid log office.grid
  chronotope grid rollback office.grid --to 41")]
pub(crate) struct RollbackArgs {
    /// The grid file.
    grid: PathBuf,
    /// The generation, as `grid log` numbers them.
    #[arg(long, value_name = "GENERATION")]
    to: u64,
}

/// Forget old generations and make the file smaller; the grid stays what it is.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid prune office.grid --keep-last 10")]
pub(crate) struct PruneArgs {
    /// The grid file.
    grid: PathBuf,
    /// Keep so many of the newest.
    #[arg(long, value_name = "N", default_value_t = 1)]
    keep_last: usize,
    /// Keep this one, too; may be given several times.
    #[arg(long, value_name = "GENERATION")]
    keep: Vec<u64>,
}

/// Forget what was observed before a time, from the next generation on.
///
/// Earlier generations have it until `grid prune`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid forget office.grid --before 2023-01-01T00:00:00Z")]
pub(crate) struct ForgetArgs {
    /// The grid file.
    grid: PathBuf,
    /// When, in RFC 3339 with an offset.
    #[arg(long, value_name = "TIME")]
    before: Time,
}

pub(super) fn verify(args: &VerifyArgs, out: &mut Output) -> Result<Outcome> {
    let verified = GridFile::verify(&args.grid)?;
    let is_clean = verified.faults.is_empty();
    if args.json {
        let faults: Vec<_> = verified.faults.iter().map(ToString::to_string).collect();
        out.json(&json!({
            "grid": args.grid,
            "clean": is_clean,
            "generation": verified.generation,
            "faults": faults,
        }))?;
        return Ok(Outcome::of_check(is_clean));
    }
    for fault in &verified.faults {
        out.line(format_args!("{}: {fault}", args.grid.display()))?;
    }
    if is_clean {
        out.line(format_args!(
            "{}: intact, generation {}",
            args.grid.display(),
            verified.generation.unwrap_or_default()
        ))?;
    } else {
        out.line(format_args!(
            "{}: damaged, {} faults (help: restore a copy, or build it again)",
            args.grid.display(),
            verified.faults.len()
        ))?;
    }
    Ok(Outcome::of_check(is_clean))
}

pub(super) fn log(args: &LogArgs, out: &mut Output) -> Result<Outcome> {
    let mut file = GridFile::open(&args.grid, Access::ReadOnly)?;
    for it in file.generations()? {
        let time = Time::from_us(it.time_us);
        let num_observations = it.notes.first().copied().unwrap_or_default();
        if args.json {
            out.json(&json!({
                "number": it.number,
                "parent": it.parent,
                "time": time.to_string(),
                "num_observations": num_observations,
                "digest": hex(&it.digest),
            }))?;
            continue;
        }
        let parent = match it.parent {
            Some(parent) if parent + 1 != it.number => format!(", on top of {parent}"),
            _ => String::new(),
        };
        out.line(format_args!(
            "{:>6}  {time}  {num_observations} observations{parent}",
            it.number
        ))?;
    }
    Ok(Outcome::Good)
}

pub(super) fn rollback(args: &RollbackArgs, out: &mut Output) -> Result<Outcome> {
    let mut file = GridFile::open(&args.grid, Access::ReadWrite)?;
    let before = file.generation();
    let generation = file.rollback(args.to)?;
    out.line(format_args!(
        "{}: generation {generation} is as {} was: {} observations (to undo: --to {before})",
        args.grid.display(),
        args.to,
        file.history().num_observations()
    ))?;
    Ok(Outcome::Good)
}

pub(super) fn prune(args: &PruneArgs, out: &mut Output) -> Result<Outcome> {
    let mut file = GridFile::open(&args.grid, Access::ReadWrite)?;
    let numbers: Vec<u64> = file.generations()?.iter().map(|it| it.number).collect();
    let newest = numbers.iter().rev().take(args.keep_last.max(1));
    let keep: BTreeSet<u64> = newest.chain(&args.keep).copied().collect();
    let keep: Vec<u64> = keep.into_iter().collect();
    let num_dropped = file.prune(&keep)?;
    out.line(format_args!(
        "{}: {num_dropped} generations forgotten, {} bytes",
        args.grid.display(),
        file.num_bytes()?
    ))?;
    Ok(Outcome::Good)
}

pub(super) fn forget(args: &ForgetArgs, out: &mut Output) -> Result<Outcome> {
    let mut file = GridFile::open(&args.grid, Access::ReadWrite)?;
    let num = file.forget_before(args.before)?;
    out.line(format_args!(
        "{}: {num} observations forgotten, {} left, generation {}",
        args.grid.display(),
        file.history().num_observations(),
        file.generation()
    ))?;
    Ok(Outcome::Good)
}

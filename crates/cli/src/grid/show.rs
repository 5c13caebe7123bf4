//! What is in a grid, and why is a cell predicted as it is?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use super::model::ModelArgs;
use super::predict::write_png;
use chronotope_terminal::{Outcome, Output};
use fremen::{Component, Error, ErrorKind, Time};
use fremen_grid::file::Access;
use fremen_grid::picture::rhythms_png;
use fremen_grid::{GridFile, TemporalGrid};

/// Show what a grid holds.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid inspect office.grid
  chronotope grid inspect office.grid --png rhythms.png --base week
  chronotope grid inspect office.grid --json | jq .num_observations")]
pub(crate) struct InspectArgs {
    /// The grid file.
    grid: PathBuf,
    /// A picture of the strongest rhythm of each cell: a week is red, a day green, an hour blue.
    #[arg(long, value_name = "PNG")]
    png: Option<PathBuf>,
    /// One JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    model: ModelArgs,
}

/// Show why a cell is predicted as it is: its rhythms, when it was last seen, how often it changed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid explain office.grid --at 1.25 3.5 --time 2024-05-07T14:00:00Z
  chronotope grid explain office.grid --at 1.25 3.5 --time 2024-05-07T14:00:00Z --base week --json")]
pub(crate) struct ExplainArgs {
    /// The grid file.
    grid: PathBuf,
    /// Where, in metres: x and y, in 3-D also z.
    #[arg(long, num_args = 2..=3, value_names = ["X", "Y"], allow_negative_numbers = true)]
    at: Vec<f64>,
    /// When, in RFC 3339 with an offset.
    #[arg(long)]
    time: Time,
    /// One JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    model: ModelArgs,
}

pub(super) fn inspect(args: &InspectArgs, out: &mut Output) -> Result<Outcome> {
    let config = args.model.config()?;
    let file = GridFile::open(&args.grid, Access::ReadOnly)?;
    let (generation, num_bytes) = (file.generation(), file.num_bytes()?);
    let mut grid = TemporalGrid::from_history(file.into_history(), config);
    let spec = *grid.spec();
    let memory = grid.memory();
    let span = {
        let mut names = grid.history().observation_names().map(|it| it.0);
        names
            .next()
            .map(|first| (first, names.last().unwrap_or(first)))
    };
    let num_observations = grid.history().num_observations();
    let fitted = grid.fitted();
    let num_varying = fitted.num_varying();
    if let Some(path) = &args.png {
        let last = span.map_or(Time::from_s(0), |(_, last)| last);
        write_png(path, &rhythms_png(&fitted, &spec, last)?, &[&args.grid])?;
    }
    let [x, y, z] = spec.origin_m();
    let [w, h, d] = spec.dims();
    if args.json {
        out.json(&json!({
            "grid": args.grid,
            "generation": generation,
            "num_bytes": num_bytes,
            "is_2d": spec.is_2d(),
            "origin_m": [x, y, z],
            "resolution_m": spec.resolution_m(),
            "dims": [w, h, d],
            "num_observations": num_observations,
            "first": span.map(|it| it.0.to_string()),
            "last": span.map(|it| it.1.to_string()),
            "num_tiles": memory.num_tiles,
            "num_changing_cells": memory.num_changing_cells,
            "num_varying_cells": num_varying,
            "memory_bytes": memory.total_bytes(),
        }))?;
        return Ok(Outcome::Good);
    }
    out.line(format_args!(
        "file          {num_bytes} bytes, generation {generation}"
    ))?;
    out.line(format_args!(
        "cells         {w} x {h} x {d} of {} m",
        spec.resolution_m()
    ))?;
    out.line(format_args!("origin        ({x}, {y}, {z}) m"))?;
    out.line(format_args!("observations  {num_observations}"))?;
    if let Some((first, last)) = span {
        out.line(format_args!("from, to      {first}, {last}"))?;
    }
    out.line(format_args!(
        "changing      {} cells, {num_varying} of them both free and occupied",
        memory.num_changing_cells
    ))?;
    out.line(format_args!("memory        {} bytes", memory.total_bytes()))?;
    Ok(Outcome::Good)
}

pub(super) fn explain(args: &ExplainArgs, out: &mut Output) -> Result<Outcome> {
    let config = args.model.config()?;
    let file = GridFile::open(&args.grid, Access::ReadOnly)?;
    let mut grid = TemporalGrid::from_history(file.into_history(), config);
    let spec = *grid.spec();
    let point = [0, 1, 2].map(|axis| args.at.get(axis).copied().unwrap_or(0.0));
    let Some(cell) = spec.cell_at(point) else {
        let ([x, y, z], size) = (spec.origin_m(), spec.resolution_m());
        let [w, h, d] = spec.dims().map(|n| f64::from(n) * size);
        return Err(Error::new(
            ErrorKind::NotFound,
            format!("{:?} m is outside of the grid", args.at),
        )
        .with_path(&args.grid)
        .with_help(format!(
            "it reaches from ({x}, {y}, {z}) to ({}, {}, {}) m",
            x + w,
            y + h,
            z + d
        ))
        .into());
    };
    let found = grid.fitted().explain(cell, args.time)?;
    if args.json {
        let rhythms = found.rhythms.iter().map(|it| {
            json!({
                "period_s": it.period_s,
                "amplitude": it.amplitude,
                "phase_rad": it.phase_rad,
            })
        });
        out.json(&json!({
            "cell": cell,
            "time": args.time.to_string(),
            "p": found.probability,
            "periodic": found.periodic,
            "persistence": found.persistence,
            "last_seen": found.last_seen.map(|(time, _)| time.to_string()),
            "last_state": found.last_seen.map(|(_, it)| it.name()),
            "num_observed": found.num_observed,
            "num_occupied": found.num_occupied,
            "num_changes": found.num_changes,
            "tau_s": found.tau_s,
            "rhythms": rhythms.collect::<Vec<_>>(),
        }))?;
        return Ok(Outcome::Good);
    }
    let Some(p) = found.probability else {
        out.line(format_args!("cell {cell:?} was never seen"))?;
        return Ok(Outcome::Good);
    };
    out.line(format_args!(
        "cell {cell:?} at {}: occupied with p = {p:.3}",
        args.time
    ))?;
    out.line(format_args!(
        "  rhythms say {:.3}, the last observation has weight {:.3}",
        found.periodic, found.persistence
    ))?;
    if let Some((time, it)) = found.last_seen {
        out.line(format_args!("  last seen {} at {time}", it.name()))?;
    }
    out.line(format_args!(
        "  seen {} times, {} times occupied, {} changes",
        found.num_observed, found.num_occupied, found.num_changes
    ))?;
    if let Some(tau_s) = found.tau_s {
        out.line(format_args!(
            "  a state lasts {:.1} h on average",
            tau_s / 3_600.0
        ))?;
    }
    for rhythm in &found.rhythms {
        out.line(format_args!("  {}", describe(rhythm)))?;
    }
    Ok(Outcome::Good)
}

fn describe(rhythm: &Component) -> String {
    // The cosine is highest where its argument is a multiple of 2 pi; periods begin at 1970 UTC.
    let cycle = -rhythm.phase_rad / std::f64::consts::TAU;
    let peak_h = cycle.rem_euclid(1.0) * rhythm.period_s / 3_600.0;
    format!(
        "every {:.2} h by {:.3}, most occupied {peak_h:.2} h after the period's start",
        rhythm.period_s / 3_600.0,
        rhythm.amplitude
    )
}

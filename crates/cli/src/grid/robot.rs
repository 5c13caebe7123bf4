//! Where is a robot in a predicted map, and which way will be free?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use super::model::ModelArgs;
use chronotope_terminal::{Outcome, Output};
use fremen::Time;
use fremen_grid::file::Access;
use fremen_grid::localize::{
    Estimate, FilterConfig, FreeSpace, LikelihoodField, LikelihoodFieldConfig, MonteCarlo,
};
use fremen_grid::plan::Planner;
use fremen_grid::pose::Pose2;
use fremen_grid::scan::{CarmenScan, read_carmen};
use fremen_grid::{GridFile, OccupancyMap, TemporalGrid, Thresholds};

/// Localise the scans of a CARMEN log in the map that is predicted for a time; the motion between
/// scans is that of the log's odometry.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid localize office.grid --log run.log.gz --time 2024-05-07T14:00:00Z --at 1.5 2 0
  chronotope grid localize office.grid --log run.log.gz --time 2024-05-07T14:00:00Z --json")]
pub(crate) struct LocalizeArgs {
    /// The grid file.
    grid: PathBuf,
    /// The log, which may be packed by gzip.
    #[arg(long)]
    log: PathBuf,
    /// When the log began, in RFC 3339 with an offset.
    #[arg(long)]
    time: Time,
    /// Where the robot is at the first scan, in metres and radians; left out, it may be anywhere.
    #[arg(long, num_args = 3, value_names = ["X", "Y", "HEADING"], allow_negative_numbers = true)]
    at: Vec<f64>,
    /// Trim the scans to this range, in metres.
    #[arg(long, value_name = "M")]
    range: Option<f64>,
    /// The seed of the particles.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object a scan.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    model: ModelArgs,
}

/// Plan a way through what is predicted for the time of arrival at each cell.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid plan office.grid --from 1.5 2 --to 12 3.5 --time 2024-05-07T14:00:00Z
  chronotope grid plan office.grid --from 1.5 2 --to 12 3.5 --time 2024-05-07T14:00:00Z --json")]
pub(crate) struct PlanArgs {
    /// The grid file.
    grid: PathBuf,
    /// Where the robot is, in metres.
    #[arg(long, num_args = 2, value_names = ["X", "Y"], allow_negative_numbers = true)]
    from: Vec<f64>,
    /// Where it is to go.
    #[arg(long, num_args = 2, value_names = ["X", "Y"], allow_negative_numbers = true)]
    to: Vec<f64>,
    /// When it departs, in RFC 3339 with an offset.
    #[arg(long)]
    time: Time,
    /// How far it keeps from surfaces, in metres.
    #[arg(long, default_value_t = 0.25)]
    radius: f64,
    /// How fast it drives, in metres a second.
    #[arg(long, default_value_t = 0.5)]
    speed: f64,
    /// One JSON object with all points.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    model: ModelArgs,
}

pub(super) fn localize(args: &LocalizeArgs, out: &mut Output) -> Result<Outcome> {
    let config = args.model.config()?;
    let file = GridFile::open(&args.grid, Access::ReadOnly)?;
    let mut grid = TemporalGrid::from_history(file.into_history(), config);
    let log = read_carmen(&args.log)?;
    let mut map = OccupancyMap::new_unknown(*grid.spec());
    grid.predict_into(args.time, &mut map)?;
    let sensor = LikelihoodField::new(&map, LikelihoodFieldConfig::default())?;
    let space =
        FreeSpace::of(&map, Thresholds::default()).map_err(|error| error.with_path(&args.grid))?;
    let config = FilterConfig::default();
    let mut filter = match args.at[..] {
        [x, y, heading] => {
            let pose = Pose2::new(x, y, heading);
            MonteCarlo::around(&pose, 0.2, 0.1, config, args.seed)?
        }
        _ => MonteCarlo::anywhere(&space, config, args.seed)?,
    };
    let mut last: Option<(&CarmenScan, Estimate)> = None;
    for scan in &log.scans {
        let motion = last.map_or_else(Pose2::default, |(before, _)| {
            before.odometry.to(&scan.odometry)
        });
        let seen = match args.range {
            Some(range_m) => scan.scan.trimmed(range_m)?,
            None => scan.scan.clone(),
        };
        let estimate = filter.step(&motion, &seen, &sensor, &space)?;
        show(scan, &estimate, args.json, out)?;
        last = Some((scan, estimate));
    }
    // Surely at one place, by the last scan.
    let is_located = last.is_some_and(|(_, estimate)| estimate.share > 0.9);
    Ok(Outcome::of_check(is_located))
}

fn show(scan: &CarmenScan, estimate: &Estimate, json: bool, out: &mut Output) -> Result<()> {
    let pose = estimate.pose;
    if json {
        return out.json(&json!({
            "log_s": scan.time.as_s(),
            "x_m": pose.x_m,
            "y_m": pose.y_m,
            "heading_rad": pose.heading_rad,
            "deviation_m": estimate.deviation_m,
            "share": estimate.share,
            "fit": estimate.fit,
        }));
    }
    out.line(format_args!(
        "{:9.2} s  ({:.2}, {:.2}) m {:+.2} rad  +- {:.2} m, {:.0} % of the particles",
        scan.time.as_s(),
        pose.x_m,
        pose.y_m,
        pose.heading_rad,
        estimate.deviation_m,
        100.0 * estimate.share,
    ))
}

pub(super) fn plan(args: &PlanArgs, out: &mut Output) -> Result<Outcome> {
    let config = args.model.config()?;
    let file = GridFile::open(&args.grid, Access::ReadOnly)?;
    let mut grid = TemporalGrid::from_history(file.into_history(), config);
    let planner = Planner {
        radius_m: args.radius,
        speed_m_s: args.speed,
        ..Planner::default()
    };
    let place = |place: &[f64]| [0, 1].map(|axis| place.get(axis).copied().unwrap_or(f64::NAN));
    let (from, to) = (place(&args.from), place(&args.to));
    let found = planner.plan(&mut grid, from, to, args.time)?;
    let Some(plan) = found else {
        if args.json {
            out.json(&json!({ "is_found": false }))?;
        } else {
            out.line("there is no way")?;
        }
        return Ok(Outcome::Doubtful);
    };
    let arrival = plan.times.last().copied().unwrap_or(args.time);
    if args.json {
        out.json(&json!({
            "is_found": true,
            "length_m": plan.length_m,
            "p_free": plan.p_free,
            "arrival": arrival.to_string(),
            "points_m": plan.points_m,
        }))?;
        return Ok(Outcome::Good);
    }
    out.line(format_args!(
        "{:.1} m, there at {arrival}, free with p = {:.2}",
        plan.length_m, plan.p_free
    ))?;
    Ok(Outcome::Good)
}

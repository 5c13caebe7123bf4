//! What will the map be at a time?

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, ValueEnum};
use serde_json::json;

use super::super::progress::Progress;
use super::model::ModelArgs;
use chronotope_terminal::{Outcome, Output};
use fremen::file::{OutputFile, OutputKind};
use fremen::{Error, ErrorKind, Time};
use fremen_grid::exchange::{MapMode, write_map};
use fremen_grid::file::Access;
use fremen_grid::picture::occupancy_png;
use fremen_grid::{FittedGrid, GridFile, OccupancyMap, TemporalGrid};

const PNG: OutputKind = OutputKind {
    noun: "a picture",
    begins: b"\x89PNG",
};

/// Predict the map of a time.
///
/// It is written for ROS's `map_server`, for `OctoMap` or as points with --out, as a picture with
/// --png, or summed up.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid predict office.grid --time 2024-05-07T14:00:00Z
  chronotope grid predict office.grid --time 2024-05-07T14:00:00Z --out now.yaml --mode scale
  chronotope grid predict office.grid --time 2024-05-07T14:00:00Z --png now.png --base week")]
pub(crate) struct PredictArgs {
    /// The grid file.
    grid: PathBuf,
    /// When, in RFC 3339 with an offset.
    #[arg(long)]
    time: Time,
    /// The map to write: `*.yaml` with its picture beside it, of a 3-D grid `*.bt` (an octree),
    /// or a list of the centres of occupied cells with their probabilities, `*.ply` or `*.csv`.
    #[arg(long, value_name = "MAP")]
    out: Option<PathBuf>,
    /// What the shades of that picture mean.
    #[arg(long, value_enum, default_value_t = Mode::Trinary)]
    mode: Mode,
    /// A picture for people to write; of a 3-D grid it shows each column of voxels.
    #[arg(long, value_name = "PNG")]
    png: Option<PathBuf>,
    /// One JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    model: ModelArgs,
}

/// Write the predicted maps of several times into a folder, with an `index.csv` of them.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid export office.grid --from 2024-05-07T00:00:00Z --every-h 1 --count 24 --out day/")]
pub(crate) struct ExportArgs {
    /// The grid file.
    grid: PathBuf,
    /// The time of the first map.
    #[arg(long)]
    from: Time,
    /// Hours from one map to the next.
    #[arg(long, default_value_t = 1.0, value_name = "HOURS")]
    every_h: f64,
    /// How many maps.
    #[arg(long, default_value_t = 24)]
    count: u32,
    /// The folder, which must not be there yet.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// What the shades of the pictures mean.
    #[arg(long, value_enum, default_value_t = Mode::Trinary)]
    mode: Mode,
    #[command(flatten)]
    model: ModelArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Mode {
    /// Free, occupied or unknown.
    Trinary,
    /// Probabilities as shades.
    Scale,
    /// Percents as they are.
    Raw,
}

impl Mode {
    const fn of_map(self) -> MapMode {
        match self {
            Self::Trinary => MapMode::Trinary,
            Self::Scale => MapMode::Scale,
            Self::Raw => MapMode::Raw,
        }
    }
}

pub(super) fn predict(args: &PredictArgs, out: &mut Output) -> Result<Outcome> {
    if let (Some(map), Some(png)) = (&args.out, &args.png)
        && map.with_extension("png") == *png
        && matches!(args.mode, Mode::Scale)
    {
        return Err(
            Error::new(ErrorKind::Config, "two pictures would have this name")
                .with_path(png)
                .with_help("in mode scale the map's own picture is a PNG: choose another --png")
                .into(),
        );
    }
    let mut grid = open(&args.grid, &args.model)?;
    let spec = *grid.spec();
    let fitted = grid.fitted();
    let mut map = OccupancyMap::new_unknown(spec);
    fitted.predict_into(args.time, &mut map)?;
    if let Some(path) = &args.out {
        write_map(&map, path, args.mode.of_map(), &[&args.grid])?;
    }
    if let Some(path) = &args.png {
        write_png(path, &occupancy_png(&map)?, &[&args.grid])?;
    }
    let counts = Counts::of(&map);
    let entropy_bits = fitted.entropy([0; 3], spec.dims(), args.time)?;
    if args.json {
        out.json(&json!({
            "grid": args.grid,
            "time": args.time.to_string(),
            "num_occupied": counts.occupied,
            "num_free": counts.free,
            "num_unknown": counts.unknown,
            "num_varying": fitted.num_varying(),
            "entropy_bits": entropy_bits,
        }))?;
    } else {
        out.line(format_args!(
            "{} at {}: {} cells occupied, {} free, {} never seen; {} of them vary, {:.0} bits of \
             doubt",
            args.grid.display(),
            args.time,
            counts.occupied,
            counts.free,
            counts.unknown,
            fitted.num_varying(),
            entropy_bits
        ))?;
    }
    Ok(Outcome::Good)
}

/// Cells by what they most likely are.
#[derive(Default)]
struct Counts {
    occupied: usize,
    free: usize,
    unknown: usize,
}

impl Counts {
    fn of(map: &OccupancyMap) -> Self {
        let mut counts = Self::default();
        for &p in map.probabilities() {
            if p.is_nan() {
                counts.unknown += 1;
            } else if p > 0.5 {
                counts.occupied += 1;
            } else {
                counts.free += 1;
            }
        }
        counts
    }
}

pub(super) fn export(args: &ExportArgs, out: &mut Output) -> Result<Outcome> {
    let step_us = args.every_h * 3.6e9;
    if !(step_us.is_finite() && step_us >= 1.0) {
        anyhow::bail!("--every-h {} is no positive number of hours", args.every_h);
    }
    let mut grid = open(&args.grid, &args.model)?;
    std::fs::create_dir(&args.out).map_err(|cause| Error::io(&args.out, cause))?;
    let spec = *grid.spec();
    let fitted: FittedGrid<'_> = grid.fitted();
    let mut map = OccupancyMap::new_unknown(spec);
    let mut index = String::from("time,path\n");
    let progress = Progress::new("predicting", args.count as usize);
    for number in 0..args.count {
        let time = args
            .from
            .plus_us((f64::from(number) * step_us).round() as i64);
        fitted.predict_into(time, &mut map)?;
        let ending = if spec.is_2d() { "yaml" } else { "bt" };
        let name = format!("{number:05}.{ending}");
        write_map(
            &map,
            args.out.join(&name),
            args.mode.of_map(),
            &[&args.grid],
        )?;
        index.push_str(&[&time.to_string(), ",", &name, "\n"].concat());
        progress.reach(number as usize + 1);
    }
    let path = args.out.join("index.csv");
    let mut file = OutputFile::begin_new(&path)?;
    file.write_all(index.as_bytes())
        .map_err(|cause| Error::io(&path, cause))?;
    file.finish()?;
    out.line(format_args!("{}: {} maps", args.out.display(), args.count))?;
    Ok(Outcome::Good)
}

fn open(path: &Path, model: &ModelArgs) -> Result<TemporalGrid> {
    let config = model.config()?;
    let file = GridFile::open(path, Access::ReadOnly)?;
    Ok(TemporalGrid::from_history(file.into_history(), config))
}

/// Writes a picture in place of an earlier one.
pub(super) fn write_png(path: &Path, bytes: &[u8], inputs: &[&Path]) -> Result<()> {
    let mut file = OutputFile::replace(path, PNG, inputs)?;
    file.write_all(bytes)
        .map_err(|cause| Error::io(path, cause))?;
    Ok(file.finish()?)
}

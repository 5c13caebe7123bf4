//! How do maps come into a grid?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use super::super::outcome::Outcome;
use super::super::output::Output;
use super::super::progress::Progress;
use fremen::{Error, ErrorKind, Time};
use fremen_grid::exchange::{IndexEntry, MapServerMap, common_spec, patch_of, read_index};
use fremen_grid::file::Access;
use fremen_grid::{GridFile, History, Thresholds};

/// Make a grid of maps that were made at known times.
///
/// The maps are those of ROS's `map_server`: a YAML file with a PGM or PNG picture beside it. They
/// must be on one raster, with one resolution and origins that differ by whole cells. The grid
/// covers them all.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid build --maps patrols/ --out office.grid
  chronotope grid build --map a.yaml --time 2024-05-06T10:00:00Z --out office.grid")]
pub(crate) struct BuildArgs {
    #[command(flatten)]
    maps: MapArgs,
    /// The file to write; one that exists is never overwritten.
    #[arg(long, value_name = "GRID")]
    out: PathBuf,
}

/// Add maps to a grid.
///
/// A map that was added before, by its time and observer, is known and changes nothing.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid add office.grid --map patrol.yaml --time 2024-05-06T10:00:00Z
  chronotope grid add office.grid --maps june/")]
pub(crate) struct AddArgs {
    /// The grid file.
    grid: PathBuf,
    #[command(flatten)]
    maps: MapArgs,
}

/// Merge grids of the same cells into a new one.
///
/// The order of the grids does not matter, and what several of them saw is counted once.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid merge monday.grid tuesday.grid --out week.grid")]
pub(crate) struct MergeArgs {
    /// The grid files.
    #[arg(required = true, num_args = 2.., value_name = "GRID")]
    grids: Vec<PathBuf>,
    /// The file to write; one that exists is never overwritten.
    #[arg(long, value_name = "GRID")]
    out: PathBuf,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

/// Which maps, made when.
#[derive(Debug, Args)]
struct MapArgs {
    /// A folder with `index.csv`: columns time, path (of a YAML file in it), perhaps observer.
    #[arg(long, value_name = "FOLDER", required_unless_present = "map")]
    maps: Option<PathBuf>,
    /// One map's YAML file.
    #[arg(long, value_name = "YAML", requires = "time", conflicts_with = "maps")]
    map: Option<PathBuf>,
    /// When that map was made, in RFC 3339 with an offset.
    #[arg(long, requires = "map")]
    time: Option<Time>,
    /// Who made it: a robot, a sensor.
    #[arg(long, default_value = "", requires = "map")]
    observer: String,
    /// From which probability on a cell is occupied; what lies between is unknown.
    #[arg(long, default_value_t = 0.65, value_name = "P")]
    occupied: f32,
    /// Up to which probability a cell is free.
    #[arg(long, default_value_t = 0.196, value_name = "P")]
    free: f32,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

impl MapArgs {
    /// The maps, oldest first.
    fn read(&self) -> Result<Vec<(IndexEntry, MapServerMap)>> {
        let mut entries = match (&self.maps, &self.map, self.time) {
            (Some(folder), _, _) => read_index(folder.join("index.csv"))?,
            (None, Some(path), Some(time)) => {
                let (path, observer) = (path.clone(), self.observer.clone());
                vec![IndexEntry {
                    time,
                    path,
                    observer,
                }]
            }
            _ => anyhow::bail!("--maps, or --map and --time, are missing"),
        };
        entries.sort_by(|a, b| (a.time, &a.observer).cmp(&(b.time, &b.observer)));
        let progress = Progress::new("reading", entries.len());
        let mut maps = Vec::with_capacity(entries.len());
        for (done, entry) in entries.into_iter().enumerate() {
            let map = MapServerMap::read(&entry.path)?;
            maps.push((entry, map));
            progress.reach(done + 1);
        }
        Ok(maps)
    }

    /// Puts them into a history.
    fn observe(&self, history: &mut History, maps: &[(IndexEntry, MapServerMap)]) -> Result<()> {
        let thresholds = Thresholds::new(self.free, self.occupied)?;
        for (entry, map) in maps {
            let mut observe = || -> fremen::Result<()> {
                let patch = patch_of(history.spec(), map, thresholds)?;
                history
                    .observe_as(&entry.observer, &patch, entry.time)
                    .map(drop)
            };
            observe().map_err(|error| error.with_path(&entry.path))?;
        }
        Ok(())
    }
}

pub(super) fn build(args: &BuildArgs, out: &mut Output) -> Result<Outcome> {
    refuse_existing(&args.out)?;
    let maps = args.maps.read()?;
    let spec = common_spec(maps.iter().map(|(_, map)| map.spec()))?;
    let mut history = History::new(spec);
    args.maps.observe(&mut history, &maps)?;
    let file = GridFile::create(&args.out, history)?;
    let num_new = file.history().num_observations();
    say(&args.out, &file, num_new, maps.len(), args.maps.json, out)
}

pub(super) fn add(args: &AddArgs, out: &mut Output) -> Result<Outcome> {
    let maps = args.maps.read()?;
    let mut file = GridFile::open(&args.grid, Access::ReadWrite)?;
    let mut new = History::new(*file.history().spec());
    args.maps.observe(&mut new, &maps)?;
    let num_new = file
        .add(&new)
        .map_err(|error| error.with_path(&args.grid))?;
    say(&args.grid, &file, num_new, maps.len(), args.maps.json, out)
}

pub(super) fn merge(args: &MergeArgs, out: &mut Output) -> Result<Outcome> {
    refuse_existing(&args.out)?;
    let file = GridFile::merge_into(&args.out, &args.grids)?;
    let num = file.history().num_observations();
    say(&args.out, &file, num, num, args.json, out)
}

/// Before anything long is done.
fn refuse_existing(path: &std::path::Path) -> Result<()> {
    if path.symlink_metadata().is_ok() {
        return Err(Error::new(ErrorKind::AlreadyExists, "this file exists")
            .with_path(path)
            .with_help("a grid is never overwritten: choose another name, or use `grid add`")
            .into());
    }
    Ok(())
}

fn say(
    path: &std::path::Path,
    file: &GridFile,
    num_new: usize,
    num_given: usize,
    as_json: bool,
    out: &mut Output,
) -> Result<Outcome> {
    let history = file.history();
    let [w, h, d] = history.spec().dims();
    if as_json {
        out.json(&json!({
            "grid": path,
            "generation": file.generation(),
            "num_added": num_new,
            "num_known_already": num_given - num_new,
            "num_observations": history.num_observations(),
            "dims": [w, h, d],
        }))?;
        return Ok(Outcome::Good);
    }
    let known = match num_given - num_new {
        0 => String::new(),
        num => format!(" ({num} known already)"),
    };
    out.line(format_args!(
        "{}: {num_new} observations added{known}, {} in all, {w} x {h} x {d} cells, generation {}",
        path.display(),
        history.num_observations(),
        file.generation()
    ))?;
    Ok(Outcome::Good)
}

//! How do maps come into a grid?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use super::super::progress::Progress;
use super::model::ModelArgs;
use super::quarantine;
use chronotope_terminal::{Outcome, Output};
use fremen::{Error, ErrorKind, Time};
use fremen_grid::exchange::{IndexEntry, common_spec, patch_of_occupancy, read_index, read_map};
use fremen_grid::file::Access;
use fremen_grid::lifelong::{LifelongGrid, MapId, TakenIn};
use fremen_grid::registration::{GuardConfig, Quarantined};
use fremen_grid::{GridFile, History, OccupancyMap, Thresholds};

/// Make a grid of maps that were made at known times.
///
/// The maps are those of ROS's `map_server`: a YAML file with a PGM or PNG picture beside it; or in 3-D
/// `OctoMap` trees (`*.bt`) and lists of points (`*.ply`, `*.csv`, with --resolution). They must be on
/// one raster, with one resolution and origins that differ by whole cells. The grid covers them all.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid build --maps patrols/ --out office.grid
  chronotope grid build --map a.yaml --time 2024-05-06T10:00:00Z --out office.grid
  chronotope grid build --map a.bt --time 2024-05-06T10:00:00Z --out hall.grid")]
pub(crate) struct BuildArgs {
    #[command(flatten)]
    maps: MapArgs,
    /// The file to write; one that exists is never overwritten.
    #[arg(long, value_name = "GRID")]
    out: PathBuf,
}

/// Add maps to a grid.
///
/// Each is laid onto the map that the grid predicts for its time. One that contradicts it more than
/// usual is not added but kept in quarantine, and the exit code is 1; `grid quarantine` shows such
/// maps, accepts or drops them. A map that was added before, by its time and observer, is known and
/// changes nothing. Maps of a 3-D grid are not judged: they need --trust.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope grid add office.grid --map patrol.yaml --time 2024-05-06T10:00:00Z
  chronotope grid add office.grid --maps june/
  chronotope grid add office.grid --maps after-the-move/ --trust")]
pub(crate) struct AddArgs {
    /// The grid file.
    grid: PathBuf,
    #[command(flatten)]
    maps: MapArgs,
    /// Integrate all of them, whatever they show.
    #[arg(long)]
    trust: bool,
    #[command(flatten)]
    model: ModelArgs,
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
    /// A folder with `index.csv`: columns time, path (of a map in it), perhaps observer.
    #[arg(long, value_name = "FOLDER", required_unless_present = "map")]
    maps: Option<PathBuf>,
    /// One map: `*.yaml`, `*.bt`, `*.ply` or `*.csv`.
    #[arg(long, value_name = "MAP", requires = "time", conflicts_with = "maps")]
    map: Option<PathBuf>,
    /// When that map was made, in RFC 3339 with an offset.
    #[arg(long, requires = "map")]
    time: Option<Time>,
    /// Who made it: a robot, a sensor.
    #[arg(long, default_value = "", requires = "map")]
    observer: String,
    /// Side of a voxel in metres, for lists of points.
    #[arg(long, value_name = "METRES")]
    resolution: Option<f64>,
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
    fn read(&self) -> Result<Vec<(IndexEntry, OccupancyMap)>> {
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
            let map = read_map(&entry.path, self.resolution).map_err(|error| {
                if self.resolution.is_none() && error.kind() == ErrorKind::Config {
                    return error
                        .with_help("say how large they are, for instance --resolution 0.1");
                }
                error
            })?;
            maps.push((entry, map));
            progress.reach(done + 1);
        }
        Ok(maps)
    }

    /// Puts them into a history.
    fn observe(&self, history: &mut History, maps: &[(IndexEntry, OccupancyMap)]) -> Result<()> {
        let thresholds = Thresholds::new(self.free, self.occupied)?;
        for (entry, map) in maps {
            let mut observe = || -> fremen::Result<()> {
                let patch = patch_of_occupancy(history.spec(), map, thresholds)?;
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
    // What is usual is learnt now, by the model that `grid add` judges with by default.
    let mut progress: Option<Progress> = None;
    let config = ModelArgs::default().config()?;
    let guard = GuardConfig::default();
    let file = LifelongGrid::create(&args.out, history, &config, guard, |done, all| {
        let bar = progress.get_or_insert_with(|| Progress::new("looking at its maps", all));
        bar.reach(done);
    })?;
    drop(progress);
    let num_new = file.history().num_observations();
    let added = Added {
        num_new,
        num_known: maps.len() - num_new,
        ..Added::default()
    };
    say(&args.out, &file, &added, args.maps.json, out)
}

/// What became of the maps that were given.
#[derive(Debug, Default)]
struct Added {
    num_new: usize,
    num_known: usize,
    /// Of the new ones, those that came out of quarantine by themselves.
    num_adopted: usize,
    /// Identities of those that are in quarantine now.
    quarantined: Vec<String>,
    /// How many went from quarantine for want of room.
    num_dropped: u64,
}

pub(super) fn add(args: &AddArgs, out: &mut Output) -> Result<Outcome> {
    let maps = args.maps.read()?;
    let mut grid = quarantine::open(&args.grid, Access::ReadWrite, &args.model)?;
    let thresholds = Thresholds::new(args.maps.free, args.maps.occupied)?;
    let spec = *grid.file().history().spec();
    let dropped_before = grid.num_dropped();
    let (mut added, mut doubts) = (Added::default(), Vec::new());
    let progress = Progress::new("adding", maps.len());
    for (done, (entry, map)) in maps.iter().enumerate() {
        let mut take_in = || -> fremen::Result<TakenIn> {
            let patch = patch_of_occupancy(&spec, map, thresholds)?;
            grid.take_in(&entry.observer, &patch, entry.time, args.trust)
        };
        match take_in().map_err(|error| error.with_path(&entry.path))? {
            TakenIn::Known => added.num_known += 1,
            TakenIn::Integrated(_) => {}
            TakenIn::Adopted { num_maps, .. } => {
                added.num_adopted += num_maps;
                doubts.push(format!(
                    "{}: shows what {} maps in quarantine show: all are integrated",
                    entry.path.display(),
                    num_maps - 1
                ));
            }
            TakenIn::Quarantined(judgement) | TakenIn::QuarantinedBefore(judgement) => {
                doubts.push(format!(
                    "{}: quarantined: {}",
                    entry.path.display(),
                    judgement.why()
                ));
            }
        }
        progress.reach(done + 1);
    }
    drop(progress);
    added.num_new = grid.commit().map_err(|error| error.with_path(&args.grid))?;
    added.num_dropped = grid.num_dropped() - dropped_before;
    let given = |held: &&Quarantined| {
        let is_it = |(entry, _): &(IndexEntry, OccupancyMap)| {
            (entry.time, &entry.observer) == (held.judgement.time, &held.observer)
        };
        maps.iter().any(is_it)
    };
    let held = grid.quarantined().iter().filter(given);
    added.quarantined = held.map(|it| MapId::of(it).to_string()).collect();
    for doubt in doubts {
        note!("{doubt}");
    }
    say(&args.grid, grid.file(), &added, args.maps.json, out)
}

pub(super) fn merge(args: &MergeArgs, out: &mut Output) -> Result<Outcome> {
    refuse_existing(&args.out)?;
    let file = GridFile::merge_into(&args.out, &args.grids)?;
    let added = Added {
        num_new: file.history().num_observations(),
        ..Added::default()
    };
    say(&args.out, &file, &added, args.json, out)
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
    added: &Added,
    as_json: bool,
    out: &mut Output,
) -> Result<Outcome> {
    let history = file.history();
    let [w, h, d] = history.spec().dims();
    let outcome = Outcome::of_check(added.quarantined.is_empty());
    if as_json {
        out.json(&json!({
            "grid": path,
            "generation": file.generation(),
            "num_added": added.num_new,
            "num_known_already": added.num_known,
            "num_adopted": added.num_adopted,
            "quarantined": added.quarantined,
            "num_dropped_from_quarantine": added.num_dropped,
            "num_observations": history.num_observations(),
            "dims": [w, h, d],
        }))?;
    } else {
        let known = match added.num_known {
            0 => String::new(),
            num => format!(" ({num} known already)"),
        };
        out.line(format_args!(
            "{}: {} observations added{known}, {} in all, {w} x {h} x {d} cells, generation {}",
            path.display(),
            added.num_new,
            history.num_observations(),
            file.generation()
        ))?;
    }
    if added.num_dropped > 0 {
        note!(
            "note: {} older maps were dropped from quarantine for want of room",
            added.num_dropped
        );
    }
    if !added.quarantined.is_empty() {
        note!(
            "{} maps are in quarantine (help: look at them with `chronotope grid quarantine list {}`, \
             then `accept` or `drop` them)",
            added.quarantined.len(),
            path.display()
        );
    }
    Ok(outcome)
}

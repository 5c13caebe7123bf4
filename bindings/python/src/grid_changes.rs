//! How does a grid change, and what becomes of it when a change fails or is interrupted?
//!
//! The sentences of the commands `grid build`, `add`, `merge`, `quarantine`, `forget` and `prune`, for
//! the methods of `Grid`. A change is made of a file first, so that what fails there has changed
//! nothing.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use chronotope::{Error, ErrorKind, Result, Time};
use fremen_grid::exchange::{IndexEntry, common_spec, patch_of_occupancy, read_index, read_map};
use fremen_grid::file::Access;
use fremen_grid::history::Verdict;
use fremen_grid::lifelong::{LifelongGrid, MapId, choose};
use fremen_grid::registration::{GuardConfig, Quarantined};
use fremen_grid::{GridConfig, GridFile, GridSpec, History, OccupancyMap, Patch, Thresholds};
use pyo3::prelude::*;

use crate::failure::{self, check_interrupt, detached, detached_with};
use crate::grid_answer::PyVerdict;
use crate::grid_cells::{Cells, Laid};
use crate::grid_state::{Shared, State};
use crate::python::times_of;

/// How maps of files are read.
#[derive(Clone, Copy)]
pub(crate) struct Reading {
    pub(crate) thresholds: Thresholds,
    /// Of lists of points.
    pub(crate) voxel_m: Option<f64>,
}

impl Reading {
    /// Above and below which values cells are occupied and free, and how large voxels are.
    pub(crate) fn of(occupied: f32, free: f32, voxel_m: Option<f64>) -> Result<Self> {
        Ok(Self {
            thresholds: Thresholds::new(free, occupied)?,
            voxel_m,
        })
    }

    pub(crate) fn read(&self, path: &Path) -> Result<OccupancyMap> {
        read_map(path, self.voxel_m).map_err(|error| {
            if self.voxel_m.is_none() && error.kind() == ErrorKind::Config {
                return error.with_help("say how large they are, for instance voxel=0.1");
            }
            error
        })
    }

    pub(crate) fn patch(&self, spec: &GridSpec, map: &OccupancyMap) -> Result<Patch> {
        patch_of_occupancy(spec, map, self.thresholds)
    }
}

/// A grid is never overwritten.
pub(crate) fn refuse_existing(path: &Path) -> Result<()> {
    if path.symlink_metadata().is_ok() {
        return Err(Error::new(ErrorKind::AlreadyExists, "this file exists")
            .with_path(path)
            .with_help("a grid is never overwritten: choose another name, or add to it"));
    }
    Ok(())
}

/// A new file of what is believed.
pub(crate) fn created(
    py: Python<'_>,
    path: &Path,
    history: History,
    config: &GridConfig,
) -> failure::Result<GridFile> {
    detached(py, || {
        LifelongGrid::create(path, history, config, GuardConfig::default(), |_, _| {})
    })
}

/// The maps of a folder's index, oldest first.
fn entries_of(folder: &Path) -> Result<Vec<IndexEntry>> {
    let mut entries = read_index(folder.join("index.csv"))?;
    entries.sort_by(|a, b| (a.time, &a.observer).cmp(&(b.time, &b.observer)));
    Ok(entries)
}

/// `chronotope grid build --maps`.
pub(crate) fn build(
    py: Python<'_>,
    folder: &Path,
    path: &Path,
    reading: Reading,
    config: &GridConfig,
) -> failure::Result<GridFile> {
    refuse_existing(path)?;
    let history = detached_with(py, || {
        let mut maps = Vec::new();
        for entry in entries_of(folder)? {
            check_interrupt()?;
            let map = reading.read(&entry.path)?;
            maps.push((entry, map));
        }
        let mut history = History::new(common_spec(maps.iter().map(|(_, map)| map.spec()))?);
        for (entry, map) in &maps {
            check_interrupt()?;
            let patch = reading.patch(history.spec(), map);
            patch
                .and_then(|patch| history.observe_as(&entry.observer, &patch, entry.time))
                .map_err(|error| error.with_path(&entry.path))?;
        }
        Ok(history)
    })?;
    created(py, path, history, config)
}

/// One of several grids that are to be merged.
pub(crate) enum Part {
    Open(Arc<Shared>),
    File(PathBuf),
}

/// The files of grids that are to be merged into one.
pub(crate) fn paths(parts: &[Part]) -> Result<Vec<PathBuf>> {
    let path = |(at, part): (usize, &Part)| match part {
        Part::File(path) => Ok(path.clone()),
        Part::Open(grid) => grid.path.clone().ok_or_else(|| {
            let message = "a grid in memory cannot be merged into a file";
            Error::new(ErrorKind::Config, message)
                .with_place(format!("grids[{at}]"))
                .with_help("save it first, or merge without `path` and save what comes of it")
        }),
    };
    parts.iter().enumerate().map(path).collect()
}

/// What several grids have seen, together.
pub(crate) fn union(py: Python<'_>, parts: &[Part]) -> failure::Result<History> {
    let mut union: Option<History> = None;
    for (at, part) in parts.iter().enumerate() {
        let history = match part {
            Part::Open(grid) => grid.glance(py, State::history_cloned)?,
            Part::File(path) => {
                detached(py, || GridFile::open(path, Access::ReadOnly))?.into_history()
            }
        };
        union = Some(match union {
            None => history,
            Some(mut union) => detached(py, || {
                union.merge(&history)?;
                Ok(union)
            })
            .map_err(|failure| failure.at(format!("grids[{at}]")))?,
        });
    }
    union.ok_or_else(|| {
        let error = Error::new(ErrorKind::Config, "no grid to merge");
        error.with_help("give one or more").into()
    })
}

/// One observation, of the file first.
pub(crate) fn observe(
    state: &mut State,
    observer: &str,
    patch: &Patch,
    time: Time,
) -> Result<Verdict> {
    let (file, grid) = state.parts();
    if let Some(file) = file {
        let mut single = History::new(*grid.spec());
        single.observe_as(observer, patch, time)?;
        file.add(&single)?;
    }
    grid.observe_as(observer, patch, time)
}

/// All observations of a history that the grid does not have.
pub(crate) fn include(state: &mut State, new: &History) -> Result<usize> {
    let (file, grid) = state.parts();
    if let Some(file) = file {
        file.add(new)?;
    }
    grid.merge(new)
}

/// What was observed before a time.
pub(crate) fn forget(state: &mut State, before: Time) -> Result<usize> {
    let (file, grid) = state.parts();
    if let Some(file) = file {
        file.forget_before(before)?;
    }
    Ok(grid.forget_before(before).num_observations)
}

/// A history of arrays and as many times.
pub(crate) fn history_of(
    py: Python<'_>,
    spec: &GridSpec,
    maps: &Bound<'_, PyAny>,
    times: &Bound<'_, PyAny>,
    observer: &str,
    laid: Laid,
) -> failure::Result<History> {
    let times = times_of(times)?;
    let mut history = History::new(*spec);
    let mut num_maps = 0;
    for (at, map) in maps.try_iter()?.enumerate() {
        num_maps = at + 1;
        let Some(&time) = times.get(at) else { continue };
        py.check_signals()?;
        let name = format!("maps[{at}]");
        let patch = Cells::of(&map?, &name)?.patch(py, spec, laid, &name)?;
        detached(py, || history.observe_as(observer, &patch, time))
            .map_err(|failure| failure.at(name))?;
    }
    if num_maps != times.len() {
        return Err(Error::new(
            ErrorKind::Shape,
            format!("{num_maps} maps and {} times", times.len()),
        )
        .with_place("times")
        .with_help("give a time for each map")
        .into());
    }
    Ok(history)
}

/// `chronotope grid add --maps`.
pub(crate) fn add_folder(
    grid: &mut LifelongGrid,
    spec: &GridSpec,
    folder: &Path,
    reading: Reading,
    is_trusted: bool,
) -> failure::Result<Vec<PyVerdict>> {
    let mut verdicts = Vec::new();
    for entry in entries_of(folder)? {
        check_interrupt()?;
        let taken = reading
            .read(&entry.path)
            .and_then(|map| reading.patch(spec, &map))
            .and_then(|patch| grid.take_in(&entry.observer, &patch, entry.time, is_trusted))
            .map_err(|error| error.with_path(&entry.path))?;
        verdicts.push(PyVerdict::of(taken, &entry.observer, entry.time));
    }
    Ok(verdicts)
}

/// The maps that are named, or all.
fn chosen(held: &[Quarantined], ids: Option<&[String]>) -> Result<Vec<MapId>> {
    match ids {
        None => Ok(held.iter().map(MapId::of).collect()),
        Some(ids) => choose(held, ids).map_err(|error| {
            let error = error.with_place("ids");
            error.with_help("grid.held() lists the maps")
        }),
    }
}

pub(crate) fn accept(grid: &mut LifelongGrid, ids: Option<&[String]>) -> Result<usize> {
    let ids = chosen(grid.quarantined(), ids)?;
    for &id in &ids {
        grid.accept(id)?;
    }
    Ok(ids.len())
}

pub(crate) fn discard(grid: &mut LifelongGrid, ids: Option<&[String]>) -> Result<usize> {
    let ids = chosen(grid.quarantined(), ids)?;
    for &id in &ids {
        grid.discard(id);
    }
    Ok(ids.len())
}

/// All generations go but these.
pub(crate) fn prune(file: &mut GridFile, keep_last: usize, keep: &[u64]) -> Result<usize> {
    let numbers: Vec<u64> = file.generations()?.iter().map(|it| it.number).collect();
    let newest = numbers.iter().rev().take(keep_last.max(1));
    let kept: BTreeSet<u64> = newest.chain(keep).copied().collect();
    file.prune(&kept.into_iter().collect::<Vec<_>>())
}

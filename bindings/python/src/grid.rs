//! How is a grid of cells made, filled, asked and kept?

use std::path::PathBuf;
use std::sync::Arc;

use chronotope::{Error, ErrorKind, Time};
use fremen_grid::exchange::{MapMode, write_map};
use fremen_grid::file::Access;
use fremen_grid::plan::Planner;
use fremen_grid::{GridConfig, GridFile, GridSpec, OccupancyMap, Patch, Thresholds};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::failure::{Result, detached};
use crate::grid_answer::{PyCellExplanation, PyObserved, PyVerdict};
use crate::grid_cells::{
    Cells, Laid, array_of, cell_of, point_of, ros_values, shape_of, shape_text,
};
use crate::grid_changes::{self, Part, Reading};
use crate::grid_json;
use crate::grid_robot::{Laser, PyGridLocalizer, PyGridPath, Sensed};
use crate::grid_state::{Shared, State, Wish};
use crate::hints::{
    CellsLike, FloatsLike, GridLike, Index, Json, Occupancy, PathLike, Point, Probabilities,
    Stamps, TimeLike, TimesLike,
};
use crate::python::{column, json_line, loads, path_of, time_of};

/// A grid of occupancy that remembers when each cell was free and when occupied, and predicts the map
/// of any time.
///
/// ``Grid(shape, resolution)`` begins one in memory, ``save`` keeps it in a file, ``Grid.open`` opens
/// one, ``Grid.build`` makes one of a folder of maps. In a file every change is a generation that
/// ``rollback`` can return to. A ``with`` block closes it. Threads may share it, and wait for each
/// other.
///
/// **Arrays** are (height, width), and (depth, height, width) in 3-D; **row 0 has the lowest y**,
/// column 0 the lowest x, layer 0 the lowest z, as in ``nav_msgs/OccupancyGrid``
/// (``data.reshape(height, width)``). Show one with ``imshow(grid.predict(time), origin="lower")``.
/// Given are
///
/// - bool: occupied or free;
/// - int8 as in ROS: percent from 0 to 100, -1 where unknown;
/// - floats: probabilities, NaN where unknown.
///
/// Percent and probabilities above ``occupied`` are occupied, below ``free`` free, and unknown between,
/// which leaves the cell as it was. uint8 is refused, because it may be any of these or a picture's
/// shades.
///
/// ``shape`` counts cells, ``resolution`` is their side in metres, ``origin`` the lower left corner (x,
/// y) of the first cell, in 3-D (x, y, z). A cell is predicted by ``model``: ``"fremen"`` (a mean and
/// the ``order`` strongest rhythms), ``"histogram"``, ``"folded"``, ``"mean"`` or ``"last"``; ``base``
/// is the longest period, ``"day"``, ``"week"`` or ``"year"``, and ``parts`` into how many it is
/// divided (hours unless said otherwise). ``persistence``, 0 to 1, is how much a fresh observation
/// counts against the rhythms, and ``surprise=True`` counts of it only what the rhythms had not
/// foreseen.
///
/// Source: T. Krajník et al., FreMEn, IEEE Transactions on Robotics 2017, eq. 10; persistence: T.
/// Krajník et al., Persistent localization and life-long mapping, IROS 2016, eq. 2.
///
/// Errors: ``ShapeError`` for other shapes, ``ConfigError`` for numbers that make no grid and unknown
/// models.
#[pyclass(frozen, module = "chronotope", name = "Grid")]
pub(crate) struct PyGrid {
    pub(crate) shared: Arc<Shared>,
}

/// Above and below which values cells are occupied and free, as `map_server` has it.
fn thresholds(occupied: f32, free: f32) -> Result<Thresholds> {
    Ok(Thresholds::new(free, occupied)?)
}

/// The cells of a grid by the shape of its arrays.
fn spec_of(shape: &[i64], resolution_m: f64, origin: &[f64]) -> Result<GridSpec> {
    let side = |&side: &i64| {
        u32::try_from(side).map_err(|_| {
            Error::new(ErrorKind::Shape, format!("{side} cells along one axis")).with_place("shape")
        })
    };
    let sides = shape.iter().map(side).collect::<Result<Vec<u32>, _>>()?;
    Ok(match (&sides[..], origin) {
        (&[h, w], &[x, y]) => GridSpec::new_2d([x, y], resolution_m, [w, h])?,
        (&[d, h, w], &[x, y]) => GridSpec::new_3d([x, y, 0.0], resolution_m, [w, h, d])?,
        (&[d, h, w], &[x, y, z]) => GridSpec::new_3d([x, y, z], resolution_m, [w, h, d])?,
        (sides, origin) => {
            let message = format!("{sides:?} cells at {origin:?} are no grid");
            return Err(Error::new(ErrorKind::Shape, message)
                .with_help(
                    "give (height, width) at (x, y), in 3-D (depth, height, width) at (x, y, z)",
                )
                .into());
        }
    })
}

fn told<'py>(py: Python<'py>, value: &serde_json::Value) -> Result<Json<'py>> {
    loads(py, &json_line(value)?)
}

impl PyGrid {
    pub(crate) fn of(shared: Arc<Shared>) -> Self {
        Self { shared }
    }

    /// The map that is expected at a time.
    fn predicted(&self, py: Python<'_>, time: Time) -> Result<OccupancyMap> {
        let spec = self.shared.spec;
        self.shared.ask(py, move |fitted| {
            let mut map = OccupancyMap::new_unknown(spec);
            fitted.predict_into(time, &mut map)?;
            Ok(map)
        })
    }

    /// What a map says of this grid's cells: of an array, or of a file.
    fn patch(
        &self,
        py: Python<'_>,
        map: &Bound<'_, PyAny>,
        origin: Option<Vec<f64>>,
        reading: Reading,
    ) -> Result<Patch> {
        if let Ok(path) = map.extract::<PathBuf>() {
            return detached(py, || {
                let map = reading.read(&path)?;
                let patch = reading.patch(&self.shared.spec, &map);
                patch.map_err(|error| error.with_path(&path))
            });
        }
        let origin_m = (origin.map(|origin| point_of(&origin, "origin"))).transpose()?;
        let laid = Laid {
            origin_m,
            thresholds: reading.thresholds,
        };
        Cells::of(map, "map")?.patch(py, &self.shared.spec, laid, "map")
    }

    /// One cell by its place in metres.
    fn cell_at(&self, at: &[f64]) -> Result<[u32; 3]> {
        let spec = &self.shared.spec;
        let point = point_of(at, "at")?;
        let cell = spec.cell_at(point).ok_or_else(|| {
            let [x, y, z] = spec.origin_m();
            let [w, h, d] = spec.dims().map(|n| f64::from(n) * spec.resolution_m());
            Error::new(
                ErrorKind::NotFound,
                format!("{at:?} m is outside of the grid"),
            )
            .with_place("at")
            .with_help(format!(
                "it reaches from ({x}, {y}, {z}) to ({}, {}, {}) m",
                x + w,
                y + h,
                z + d
            ))
        })?;
        Ok(cell)
    }
}

#[pymethods]
impl PyGrid {
    #[new]
    #[pyo3(signature = (shape, resolution, origin=vec![0.0, 0.0], *, model="fremen", base="day",
                        parts=None, order=2, persistence=1.0, surprise=false))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn new(
        shape: Vec<i64>,
        resolution: f64,
        origin: Vec<f64>,
        model: &str,
        base: &str,
        parts: Option<usize>,
        order: usize,
        persistence: f32,
        surprise: bool,
    ) -> Result<Self> {
        let config = Wish {
            model,
            base,
            parts,
            order,
            persistence,
            surprise,
        }
        .config()?;
        let spec = spec_of(&shape, resolution, &origin)?;
        let history = fremen_grid::History::new(spec);
        Ok(Self::of(Shared::in_memory(history, config)))
    }

    /// Opens a grid file: to be written where file and folder allow it, else read-only. Reads and
    /// checks all of its newest generation. The other arguments are those of ``Grid``.
    ///
    /// Errors: ``NotFoundError``, ``FormatError`` if it is no grid, ``ChecksumError`` if it is damaged.
    #[staticmethod]
    #[pyo3(name = "open", signature = (path, *, read_only=false, model="fremen", base="day",
                                       parts=None, order=2, persistence=1.0, surprise=false))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn open_file(
        py: Python<'_>,
        path: PathLike<'_>,
        read_only: bool,
        model: &str,
        base: &str,
        parts: Option<usize>,
        order: usize,
        persistence: f32,
        surprise: bool,
    ) -> Result<Self> {
        let path = path_of(&path)?;
        let config = Wish {
            model,
            base,
            parts,
            order,
            persistence,
            surprise,
        }
        .config()?;
        let access = if read_only {
            Access::ReadOnly
        } else {
            Access::ReadWrite
        };
        let file = detached(py, || GridFile::open(&path, access))?;
        Ok(Self::of(Shared::of_file(file, config)))
    }

    /// Makes a grid file of a folder of maps that are believed, as ``chronotope grid build --maps``
    /// does.
    ///
    /// The folder has an ``index.csv`` with the columns time, path and perhaps observer; maps are those
    /// of ``map_server`` (YAML), in 3-D ``OctoMap`` trees (``*.bt``) and lists of points (``*.ply``, ``*.csv``,
    /// in voxels of ``voxel`` metres). They must be on one raster; the grid covers them all.
    ///
    /// Errors: ``AlreadyExistsError`` if ``path`` exists, ``FormatError`` and ``NotFoundError`` for
    /// what cannot be read, ``ShapeError`` for maps of other rasters.
    #[staticmethod]
    #[pyo3(signature = (folder, path, *, occupied=0.65, free=0.196, voxel=None))]
    fn build(
        py: Python<'_>,
        folder: PathLike<'_>,
        path: PathLike<'_>,
        occupied: f32,
        free: f32,
        voxel: Option<f64>,
    ) -> Result<Self> {
        let (folder, path) = (path_of(&folder)?, path_of(&path)?);
        let reading = Reading::of(occupied, free, voxel)?;
        let config = GridConfig::default();
        let file = grid_changes::build(py, &folder, &path, reading, &config)?;
        Ok(Self::of(Shared::of_file(file, config)))
    }

    /// Makes one grid of several, the union of what they saw, the same in any order.
    ///
    /// With ``path`` a new file of grids that are in files, as ``chronotope grid merge`` does;
    /// otherwise a grid in memory.
    ///
    /// Errors: ``ShapeError`` for grids of other cells, ``ConflictError`` where one observer saw two
    /// things at one time, ``AlreadyExistsError`` if ``path`` exists.
    #[staticmethod]
    #[pyo3(signature = (grids, path=None))]
    fn merge(py: Python<'_>, grids: Vec<GridLike<'_>>, path: Option<PathLike<'_>>) -> Result<Self> {
        let part = |grid: &GridLike<'_>| match grid.0.cast::<Self>() {
            Ok(grid) => Ok(Part::Open(Arc::clone(&grid.get().shared))),
            Err(_) => Ok(Part::File(grid.0.extract()?)),
        };
        let parts = grids.iter().map(part).collect::<Result<Vec<_>>>()?;
        let config = GridConfig::default();
        let Some(path) = path else {
            let union = grid_changes::union(py, &parts)?;
            return Ok(Self::of(Shared::in_memory(union, config)));
        };
        let (path, others) = (path_of(&path)?, grid_changes::paths(&parts)?);
        let file = detached(py, || GridFile::merge_into(&path, &others))?;
        Ok(Self::of(Shared::of_file(file, config)))
    }

    /// Checks every byte of a grid file and changes nothing: a dictionary as ``chronotope grid verify
    /// --json`` prints it, with ``clean`` and ``faults``.
    ///
    /// Errors: ``NotFoundError``, ``FormatError`` if it is no grid at all.
    #[staticmethod]
    fn verify_file<'py>(py: Python<'py>, path: PathLike<'py>) -> Result<Json<'py>> {
        let path = path_of(&path)?;
        let verified = detached(py, || GridFile::verify(&path))?;
        told(py, &grid_json::verified(&path, &verified))
    }

    /// Checks every byte of this grid's file, as ``verify_file``.
    fn verify<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let path = self.shared.change(py, |state| {
            Ok(state.look_into_file("file to verify", |file| Ok(file.path().to_owned()))?)
        })?;
        let verified = detached(py, || GridFile::verify(&path))?;
        told(py, &grid_json::verified(&path, &verified))
    }

    /// Keeps a grid in a new file, and gives that one; what is in it counts as usual for ``add``.
    ///
    /// Errors: ``AlreadyExistsError``, ``IoError``.
    fn save(&self, py: Python<'_>, path: PathLike<'_>) -> Result<Self> {
        let path = path_of(&path)?;
        grid_changes::refuse_existing(&path)?;
        let look = |state: &State| (state.history_cloned(), state.config.clone());
        let (history, config) = self.shared.glance(py, look)?;
        let file = grid_changes::created(py, &path, history, &config)?;
        Ok(Self::of(Shared::of_file(file, config)))
    }

    /// Lets go of what it holds, and of the file.
    fn close(&self, py: Python<'_>) -> Result<()> {
        self.shared.close(py)
    }

    /// Whether ``close`` was called.
    #[getter]
    fn closed(&self, py: Python<'_>) -> Result<bool> {
        self.shared.is_closed(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_exception: "object"))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> Result<()> {
        self.close(py)
    }

    /// The shape of its maps: (height, width), in 3-D (depth, height, width).
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> Result<Index<'py>> {
        let shape = PyTuple::new(py, shape_of(&self.shared.spec))?;
        Ok(Index(shape.into_any()))
    }

    /// The side of a cell, m.
    #[getter]
    fn resolution(&self) -> f64 {
        self.shared.spec.resolution_m()
    }

    /// The lower corner of the first cell, (x, y, z) in m; z is 0 in 2-D.
    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        let [x, y, z] = self.shared.spec.origin_m();
        (x, y, z)
    }

    /// The file; None for a grid in memory.
    #[getter]
    fn path(&self) -> Option<PathBuf> {
        self.shared.path.clone()
    }

    /// Whether a change is known to fail: the file was opened to be read, or may not be written.
    #[getter]
    fn read_only(&self, py: Python<'_>) -> Result<bool> {
        let look = |state: &State| state.file().is_some_and(GridFile::is_read_only);
        self.shared.glance(py, look)
    }

    /// Which commit was read last, counted from 0; None for a grid in memory.
    #[getter]
    fn generation(&self, py: Python<'_>) -> Result<Option<u64>> {
        let look = |state: &State| state.file().map(GridFile::generation);
        self.shared.glance(py, look)
    }

    /// How many observations it has.
    #[getter]
    fn num_observations(&self, py: Python<'_>) -> Result<usize> {
        self.shared
            .glance(py, |state| state.history().num_observations())
    }

    /// When each observation was, int64 (n,), microseconds since 1970 in UTC, oldest first:
    /// ``.view("datetime64[us]")``.
    #[getter]
    fn times_us<'py>(&self, py: Python<'py>) -> Result<Stamps<'py>> {
        let times = self.shared.glance(py, |state| {
            let names = state.history().observation_names();
            names.map(|(time, _)| time.as_us()).collect::<Vec<i64>>()
        })?;
        Ok(Stamps(column(py, times)?))
    }

    /// Who made each observation, in the same order.
    #[getter]
    fn observers(&self, py: Python<'_>) -> Result<Vec<String>> {
        self.shared.glance(py, |state| {
            let names = state.history().observation_names();
            names.map(|(_, observer)| observer.to_owned()).collect()
        })
    }

    /// Predicts by another model from now on; nothing that was observed is lost.
    #[pyo3(signature = (*, model="fremen", base="day", parts=None, order=2, persistence=1.0,
                        surprise=false))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn set_model(
        &self,
        py: Python<'_>,
        model: &str,
        base: &str,
        parts: Option<usize>,
        order: usize,
        persistence: f32,
        surprise: bool,
    ) -> Result<()> {
        let config = Wish {
            model,
            base,
            parts,
            order,
            persistence,
            surprise,
        }
        .config()?;
        self.shared.change(py, |state| {
            state.set_config(config);
            Ok(())
        })
    }

    /// Adds a map that is believed, as it is; ``add`` judges maps first.
    ///
    /// ``map`` is an array (see ``Grid``) of the grid's shape or, with ``origin`` (the lower corner of
    /// its first cell in metres), of any: its cells must coincide with the grid's. A path is read as
    /// for ``add``. ``time`` is when it was made: an aware datetime, a datetime64 (of UTC), text with
    /// an offset, or seconds since 1970. Observer and time are an observation's identity: the same once
    /// more changes nothing. Observations may come in any order. Of a grid in a file each call is a
    /// generation; ``observe_many`` makes one of many.
    ///
    /// Errors: ``ShapeError``, ``ConfigError`` for values that are none, ``TimeError``,
    /// ``ConflictError`` where this observer saw something else at this time.
    #[pyo3(signature = (map, time, *, observer="", origin=None, occupied=0.65, free=0.196, voxel=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn observe(
        &self,
        py: Python<'_>,
        map: CellsLike<'_>,
        time: TimeLike<'_>,
        observer: &str,
        origin: Option<Vec<f64>>,
        occupied: f32,
        free: f32,
        voxel: Option<f64>,
    ) -> Result<PyObserved> {
        let reading = Reading::of(occupied, free, voxel)?;
        let time = time_of(&time.0)?;
        let patch = self.patch(py, &map.0, origin, reading)?;
        let verdict = self.shared.change(py, |state| {
            Ok(grid_changes::observe(state, observer, &patch, time)?)
        })?;
        Ok(PyObserved { verdict })
    }

    /// Adds many maps that are believed, in one step: arrays of the grid's shape, or one array with an
    /// axis more, and as many times. Gives how many are new. If one of them is refused, nothing has
    /// changed.
    ///
    /// Errors: as ``observe``, with the number of the map; ``ShapeError`` if maps and times are not as
    /// many.
    #[pyo3(signature = (maps, times, *, observer="", occupied=0.65, free=0.196))]
    fn observe_many(
        &self,
        py: Python<'_>,
        maps: CellsLike<'_>,
        times: TimesLike<'_>,
        observer: &str,
        occupied: f32,
        free: f32,
    ) -> Result<usize> {
        let laid = Laid {
            origin_m: None,
            thresholds: thresholds(occupied, free)?,
        };
        let spec = &self.shared.spec;
        let new = grid_changes::history_of(py, spec, &maps.0, &times.0, observer, laid)?;
        self.shared
            .change(py, |state| Ok(grid_changes::include(state, &new)?))
    }

    /// Judges a map and adds it, or keeps it in quarantine, as ``chronotope grid add`` does: it is laid
    /// onto the map that the grid predicts for its time, and what contradicts that more than usual is
    /// not believed.
    ///
    /// ``map`` is an array as for ``observe``, or the path of a map (YAML of ``map_server``, ``*.bt``,
    /// ``*.ply``, ``*.csv``). ``trust=True`` integrates it whatever it shows, which a map of a 3-D grid
    /// has to be. Only grids in files have a quarantine. Each call is a generation; ``add_folder``
    /// makes one of many maps.
    ///
    /// Errors: as ``observe``; ``ConfigError`` for a grid in memory.
    #[pyo3(signature = (map, time, *, observer="", trust=false, origin=None, occupied=0.65, free=0.196,
                        voxel=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn add(
        &self,
        py: Python<'_>,
        map: CellsLike<'_>,
        time: TimeLike<'_>,
        observer: &str,
        trust: bool,
        origin: Option<Vec<f64>>,
        occupied: f32,
        free: f32,
        voxel: Option<f64>,
    ) -> Result<PyVerdict> {
        let reading = Reading::of(occupied, free, voxel)?;
        let time = time_of(&time.0)?;
        let patch = self.patch(py, &map.0, origin, reading)?;
        let taken = self.shared.change(py, |state| {
            state.guarded(|grid| Ok(grid.take_in(observer, &patch, time, trust)?))
        })?;
        Ok(PyVerdict::of(taken, observer, time))
    }

    /// Judges the maps of a folder with an ``index.csv`` (see ``build``), oldest first, as ``chronotope
    /// grid add --maps`` does, and gives what became of each. All of them become one generation; after
    /// Ctrl-C none.
    #[pyo3(signature = (folder, *, trust=false, occupied=0.65, free=0.196, voxel=None))]
    fn add_folder(
        &self,
        py: Python<'_>,
        folder: PathLike<'_>,
        trust: bool,
        occupied: f32,
        free: f32,
        voxel: Option<f64>,
    ) -> Result<Vec<PyVerdict>> {
        let folder = path_of(&folder)?;
        let reading = Reading::of(occupied, free, voxel)?;
        let spec = self.shared.spec;
        self.shared.change(py, |state| {
            state.guarded(|grid| grid_changes::add_folder(grid, &spec, &folder, reading, trust))
        })
    }

    /// The maps in quarantine, oldest first, as ``chronotope grid quarantine list --json`` prints them.
    fn held<'py>(&self, py: Python<'py>) -> Result<Vec<Json<'py>>> {
        let held = self.shared.change(py, |state| {
            let held = state.guard()?.quarantined();
            Ok(held.iter().map(grid_json::held).collect::<Vec<_>>())
        })?;
        held.iter().map(|it| told(py, it)).collect()
    }

    /// Integrates maps in quarantine after all: by the first digits of their identities, all of them
    /// where none is named. Gives how many.
    ///
    /// Errors: ``NotFoundError``, ``ConfigError`` for digits that begin several.
    #[pyo3(signature = (ids=None))]
    fn accept(&self, py: Python<'_>, ids: Option<Vec<String>>) -> Result<usize> {
        self.shared.change(py, |state| {
            state.guarded(|grid| Ok(grid_changes::accept(grid, ids.as_deref())?))
        })
    }

    /// Forgets maps in quarantine, named likewise. Gives how many.
    #[pyo3(signature = (ids=None))]
    fn drop_held(&self, py: Python<'_>, ids: Option<Vec<String>>) -> Result<usize> {
        self.shared.change(py, |state| {
            state.guarded(|grid| Ok(grid_changes::discard(grid, ids.as_deref())?))
        })
    }

    /// Adds all observations of another grid of the same cells that this one does not have; gives how
    /// many.
    ///
    /// Errors: ``ShapeError``, ``ConflictError``.
    fn include(&self, py: Python<'_>, other: &Self) -> Result<usize> {
        let new = (other.shared).glance(py, State::history_cloned)?;
        self.shared
            .change(py, |state| Ok(grid_changes::include(state, &new)?))
    }

    /// Forgets what was observed before a time, and gives how many observations that were. Of a file
    /// earlier generations have them until ``prune``.
    fn forget(&self, py: Python<'_>, before: TimeLike<'_>) -> Result<usize> {
        let before = time_of(&before.0)?;
        self.shared
            .change(py, |state| Ok(grid_changes::forget(state, before)?))
    }

    /// Every commit, oldest first, as ``chronotope grid log --json`` prints them.
    fn log<'py>(&self, py: Python<'py>) -> Result<Vec<Json<'py>>> {
        let generations = self.shared.change(py, |state| {
            Ok(state.look_into_file("generations", GridFile::generations)?)
        })?;
        let lines = generations.iter().map(grid_json::generation);
        lines.map(|it| told(py, &it)).collect()
    }

    /// Returns to what the grid was at a generation, as a new generation, and gives its number.
    ///
    /// Errors: ``NotFoundError``.
    fn rollback(&self, py: Python<'_>, to: u64) -> Result<u64> {
        self.shared.change(py, |state| {
            Ok(state.change_file("generations", |file| file.rollback(to))?)
        })
    }

    /// Forgets generations but the newest ``keep_last`` and those in ``keep``; gives how many are gone.
    #[pyo3(signature = (*, keep_last=1, keep=Vec::new()))]
    fn prune(&self, py: Python<'_>, keep_last: usize, keep: Vec<u64>) -> Result<usize> {
        self.shared.change(py, |state| {
            Ok(state.change_file("generations", |file| {
                grid_changes::prune(file, keep_last, &keep)
            })?)
        })
    }

    /// Reads what other processes have committed, and gives the newest generation.
    ///
    /// Errors: ``ConflictError`` if a grid of other cells has taken its place.
    fn refresh(&self, py: Python<'_>) -> Result<u64> {
        self.shared.refresh(py)
    }

    /// What it holds, as ``chronotope grid inspect --json`` prints it.
    fn inspect<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let path = self.shared.path.clone();
        let (generation, num_bytes, memory) = self.shared.change(py, |state| {
            let file = state.file();
            let num_bytes = file.map(GridFile::num_bytes).transpose()?;
            let memory = state.history().memory();
            Ok((file.map(GridFile::generation), num_bytes, memory))
        })?;
        let value = self.shared.ask(py, move |fitted| {
            let mut value = grid_json::inspected(&memory, fitted);
            value["grid"] = serde_json::json!(path);
            value["generation"] = serde_json::json!(generation);
            value["num_bytes"] = serde_json::json!(num_bytes);
            Ok(value)
        })?;
        told(py, &value)
    }

    /// The map that is expected at a time: probabilities of being occupied, float32 of the grid's
    /// ``shape``, row 0 at the lowest y, NaN where a cell was never seen (T-RO 2017 eq. 10, IROS 2016
    /// eq. 2).
    ///
    /// Models are fitted when they are needed, and again only where something new was observed.
    ///
    /// Errors: ``TimeError``.
    fn predict<'py>(&self, py: Python<'py>, time: TimeLike<'py>) -> Result<Probabilities<'py>> {
        let map = self.predicted(py, time_of(&time.0)?)?;
        let values = map.probabilities().to_vec();
        Ok(Probabilities(array_of(py, values, &self.shared.spec)?))
    }

    /// ``predict`` as ``nav_msgs/OccupancyGrid`` has it, int8: 100 where p > ``occupied``, 0 where p <
    /// ``free``, -1 between and where a cell was never seen.
    ///
    /// Errors: ``TimeError``, ``ConfigError`` for thresholds that cross.
    #[pyo3(signature = (time, *, occupied=0.65, free=0.196))]
    fn occupancy<'py>(
        &self,
        py: Python<'py>,
        time: TimeLike<'py>,
        occupied: f32,
        free: f32,
    ) -> Result<Occupancy<'py>> {
        let thresholds = thresholds(occupied, free)?;
        let map = self.predicted(py, time_of(&time.0)?)?;
        let values = ros_values(&map, thresholds);
        Ok(Occupancy(array_of(py, values, &self.shared.spec)?))
    }

    /// How uncertain the grid is at a time, in bits: the sum of the entropies of its cells, 1 for one
    /// that was never seen. ``start`` and ``stop`` are a box of numpy indices, (row, column) or (layer,
    /// row, column), without ``stop``: ``grid.entropy(time, (10, 20), (40, 60))`` is of ``[10:40,
    /// 20:60]``.
    ///
    /// Errors: ``ShapeError`` for a box that is not in the grid.
    #[pyo3(signature = (time, start=None, stop=None))]
    fn entropy(
        &self,
        py: Python<'_>,
        time: TimeLike<'_>,
        start: Option<Vec<i64>>,
        stop: Option<Vec<i64>>,
    ) -> Result<f64> {
        let (time, spec) = (time_of(&time.0)?, self.shared.spec);
        let from = start.map_or(Ok([0; 3]), |start| cell_of(&start, &spec, "start"))?;
        let until = match stop {
            None => spec.dims(),
            Some(stop) => {
                // The last cell of the box lies in the grid.
                let last: Vec<i64> = stop.iter().map(|at| at.saturating_sub(1)).collect();
                cell_of(&last, &spec, "stop")?.map(|at| at + 1)
            }
        };
        if (0..3).any(|axis| from[axis] >= until[axis]) {
            return Err(Error::new(ErrorKind::Shape, "this box has no cells")
                .with_place("stop")
                .with_help("each number of `stop` is above that of `start`")
                .into());
        }
        let dims = std::array::from_fn(|axis| until[axis] - from[axis]);
        self.shared
            .ask(py, move |fitted| fitted.entropy(from, dims, time))
    }

    /// Why a cell is predicted as it is: its rhythms, when it was last seen, how often it changed.
    /// ``at`` is its place (x, y) in metres, in 3-D (x, y, z); ``center`` gives that of a cell of an
    /// array.
    ///
    /// Errors: ``NotFoundError`` for a place outside of the grid, ``TimeError``.
    fn explain(
        &self,
        py: Python<'_>,
        at: Vec<f64>,
        time: TimeLike<'_>,
    ) -> Result<PyCellExplanation> {
        let (cell, time) = (self.cell_at(&at)?, time_of(&time.0)?);
        let found = (self.shared).ask(py, move |fitted| fitted.explain(cell, time))?;
        Ok(PyCellExplanation { cell, time, found })
    }

    /// The strongest rhythm of each cell: its period in s and its amplitude, two arrays, float32 of the
    /// grid's ``shape``, NaN where a cell has none.
    fn rhythms<'py>(&self, py: Python<'py>) -> Result<(Probabilities<'py>, Probabilities<'py>)> {
        let spec = self.shared.spec;
        let (periods, amplitudes) = self.shared.ask(py, move |fitted| {
            let rhythms = (0..spec.num_cells()).map(|index| {
                let found = fitted.strongest_rhythm(spec.cell(index));
                found.map_or((f32::NAN, f32::NAN), |(period_s, it)| {
                    (period_s as f32, it as f32)
                })
            });
            Ok(rhythms.unzip::<f32, f32, Vec<_>, Vec<_>>())
        })?;
        Ok((
            Probabilities(array_of(py, periods, &spec)?),
            Probabilities(array_of(py, amplitudes, &spec)?),
        ))
    }

    /// Where in an array the cell at a place in metres is: (row, column), in 3-D (layer, row, column).
    ///
    /// Errors: ``NotFoundError`` for a place outside of the grid.
    fn cell<'py>(&self, py: Python<'py>, at: Vec<f64>) -> Result<Index<'py>> {
        let [x, y, z] = self.cell_at(&at)?;
        let index = [z, y, x];
        let first = usize::from(self.shared.spec.is_2d());
        Ok(Index(PyTuple::new(py, &index[first..])?.into_any()))
    }

    /// The centre in metres, (x, y) or (x, y, z), of a cell of an array, (row, column) or (layer, row,
    /// column).
    ///
    /// Errors: ``ShapeError`` for a cell outside of the grid.
    fn center<'py>(&self, py: Python<'py>, index: Vec<i64>) -> Result<Point<'py>> {
        let spec = &self.shared.spec;
        let point = spec.center(cell_of(&index, spec, "index")?);
        let num_axes = if spec.is_2d() { 2 } else { 3 };
        Ok(Point(PyTuple::new(py, &point[..num_axes])?.into_any()))
    }

    /// Writes the map that is expected at a time, as ``chronotope grid predict --out`` does:
    /// ``NAME.yaml`` with its picture beside it for ``map_server``, in 3-D ``*.bt`` (``OctoMap``), or a list of
    /// points, ``*.ply``, ``*.csv``. ``mode`` says what shades mean: ``"trinary"``, ``"scale"`` or
    /// ``"raw"``. An earlier map is replaced.
    ///
    /// Errors: ``ConfigError``, ``ShapeError`` for a 3-D grid as a picture, ``AlreadyExistsError`` for
    /// a file of another kind, ``IoError``.
    #[pyo3(signature = (time, path, *, mode="trinary"))]
    fn export(
        &self,
        py: Python<'_>,
        time: TimeLike<'_>,
        path: PathLike<'_>,
        mode: &str,
    ) -> Result<()> {
        let (time, path) = (time_of(&time.0)?, path_of(&path)?);
        let mode = MapMode::parse(mode).ok_or_else(|| {
            Error::new(ErrorKind::Config, format!("there is no mode `{mode}`"))
                .with_place("mode")
                .with_help("use one of trinary, scale, raw")
        })?;
        let map = self.predicted(py, time)?;
        let own = self.shared.path.as_deref();
        let inputs: Vec<&std::path::Path> = own.into_iter().collect();
        detached(py, || {
            write_map(&map, &path, mode, &inputs).map_err(|error| match error.path() {
                Some(_) => error,
                None => error.with_path(&path),
            })
        })
    }

    /// What a laser has seen, as a map for ``observe`` and ``add``: float32 of the grid's ``shape``,
    /// NaN where no beam came. ``ranges`` is (beams,) or (scans, beams) in metres, ``poses`` (3,) or
    /// (scans, 3): x, y and heading of the laser in metres and radians. Beam i looks to heading +
    /// ``first`` + i ``step``, counted anticlockwise; a range of ``max_range`` and more, or infinity,
    /// says that nothing is nearer, and NaN nothing at all (REP 117). ``sensor`` is ``"ideal"`` (one
    /// scan is nearly sure; the default for one) or ``"reduced"`` (several must agree; the default for
    /// several).
    ///
    /// Errors: ``ShapeError`` for other shapes and 3-D grids, ``ConfigError`` for numbers that are
    /// none.
    #[pyo3(signature = (ranges, poses, *, first, step, max_range, sensor=None))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn map_of_scans<'py>(
        &self,
        py: Python<'py>,
        ranges: FloatsLike<'py>,
        poses: FloatsLike<'py>,
        first: f64,
        step: f64,
        max_range: f64,
        sensor: Option<&str>,
    ) -> Result<Probabilities<'py>> {
        let laser = Laser {
            first_rad: first,
            step_rad: step,
            max_range_m: max_range,
        };
        let sensed = Sensed::of(&ranges.0, &poses.0, laser)?;
        let spec = self.shared.spec;
        let map = sensed.map(py, &spec, sensor)?;
        let values = map.probabilities().to_vec();
        Ok(Probabilities(array_of(py, values, &spec)?))
    }

    /// Localises a laser in the map that is expected at ``time``: see ``GridLocalizer``. ``first``,
    /// ``step`` and ``max_range`` describe its beams as for ``map_of_scans``. ``pose`` (x, y, heading)
    /// is about where it is at first, within 0.2 m and 0.1 rad; without it, it may be anywhere.
    ///
    /// Errors: ``ShapeError`` for a 3-D grid, ``NotFoundError`` if nothing is free, ``TimeError``.
    #[pyo3(signature = (time, *, first, step, max_range, pose=None, seed=1))]
    #[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
    fn localizer(
        &self,
        py: Python<'_>,
        time: TimeLike<'_>,
        first: f64,
        step: f64,
        max_range: f64,
        pose: Option<(f64, f64, f64)>,
        seed: u64,
    ) -> Result<PyGridLocalizer> {
        let laser = Laser {
            first_rad: first,
            step_rad: step,
            max_range_m: max_range,
        };
        let map = self.predicted(py, time_of(&time.0)?)?;
        PyGridLocalizer::new(py, &map, laser, pose, seed)
    }

    /// The way of a robot that departs at ``time``, through what is predicted for the time of its
    /// arrival at each cell, as ``chronotope grid plan`` finds it; None where there is none. ``start``
    /// and ``goal`` are (x, y) in metres; it keeps ``radius`` metres from surfaces and drives ``speed``
    /// metres a second.
    ///
    /// Errors: ``NotFoundError`` for places outside of the grid, ``ShapeError`` for a 3-D grid,
    /// ``ConfigError``.
    #[pyo3(signature = (start, goal, time, *, radius=0.25, speed=0.5))]
    fn plan(
        &self,
        py: Python<'_>,
        start: (f64, f64),
        goal: (f64, f64),
        time: TimeLike<'_>,
        radius: f64,
        speed: f64,
    ) -> Result<Option<PyGridPath>> {
        let ends = [[start.0, start.1], [goal.0, goal.1]];
        let planner = Planner {
            radius_m: radius,
            speed_m_s: speed,
            ..Planner::default()
        };
        PyGridPath::plan(py, &self.shared, ends, time_of(&time.0)?, planner)
    }

    fn __repr__(&self, py: Python<'_>) -> Result<String> {
        let spec = &self.shared.spec;
        let cells = shape_text(&shape_of(spec));
        let is_in = match &self.shared.path {
            Some(path) => format!(" {}", path.display()),
            None => " in memory".to_owned(),
        };
        if self.shared.is_closed(py)? {
            return Ok(format!("<Grid{is_in}, closed>"));
        }
        let num = self.num_observations(py)?;
        let side = spec.resolution_m();
        Ok(format!(
            "<Grid{is_in}: {cells} cells of {side} m, {num} observations>"
        ))
    }
}

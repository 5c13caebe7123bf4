//! How do maps of cells pass between numpy and a grid?
//!
//! Row 0 of an array has the lowest y, as in a ROS `OccupancyGrid`, and in 3-D layer 0 the lowest z:
//! the order of an array's bytes is that of the grid's cells. A contiguous array of bool, int8 or
//! float32 is read where it lies.

use chronotope::{Error, ErrorKind};
use fremen_grid::exchange::patch_of_occupancy;
use fremen_grid::{CellState, GridSpec, OccupancyMap, Patch, Thresholds};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::failure::{Result, detached};

/// The largest value of a cell in a ROS `OccupancyGrid`.
const OCCUPIED: i8 = 100;

/// A map as somebody gave it.
pub(crate) enum Cells<'py> {
    /// Of bool: occupied or free, as bytes, because nobody promises that these are 0 and 1 alone.
    Bool(PyReadonlyArrayDyn<'py, u8>),
    /// Percent, -1 where unknown.
    Percent(PyReadonlyArrayDyn<'py, i8>),
    /// Probabilities, NaN where unknown.
    Probability(PyReadonlyArrayDyn<'py, f32>),
}

/// Of a caller: how a map is read.
#[derive(Clone, Copy)]
pub(crate) struct Laid {
    /// The lower corner of its first cell, in metres; that of the grid where it is not given.
    pub(crate) origin_m: Option<[f64; 3]>,
    pub(crate) thresholds: Thresholds,
}

fn borrowed<'py, T: numpy::Element>(
    array: &Bound<'py, PyArrayDyn<T>>,
) -> Result<PyReadonlyArrayDyn<'py, T>> {
    Ok(array.try_readonly().map_err(|_| {
        Error::new(ErrorKind::Conflict, "somebody is writing to this array")
            .with_help("wait for them, or give a copy")
    })?)
}

impl<'py> Cells<'py> {
    /// `name` is that of the argument, for errors.
    pub(crate) fn of(object: &Bound<'py, PyAny>, name: &str) -> Result<Self> {
        let module = object.py().import("chronotope._grids")?;
        let array = module.getattr("as_cells")?.call1((object, name))?;
        if let Ok(array) = array.cast::<PyArrayDyn<u8>>() {
            return Ok(Self::Bool(borrowed(array)?));
        }
        if let Ok(array) = array.cast::<PyArrayDyn<i8>>() {
            return Ok(Self::Percent(borrowed(array)?));
        }
        let array = array.cast::<PyArrayDyn<f32>>().map_err(PyErr::from)?;
        Ok(Self::Probability(borrowed(array)?))
    }

    fn shape(&self) -> &[usize] {
        match self {
            Self::Bool(array) => array.shape(),
            Self::Percent(array) => array.shape(),
            Self::Probability(array) => array.shape(),
        }
    }

    /// The states of all cells.
    fn states(&self, py: Python<'_>, thresholds: Thresholds, name: &str) -> Result<Vec<CellState>> {
        let of = Of {
            name,
            shape: self.shape(),
        };
        match self {
            Self::Bool(array) => {
                let cells = array.as_slice().map_err(not_contiguous)?;
                detached(py, || {
                    let state = |&byte: &u8| match byte {
                        0 => CellState::Free,
                        _ => CellState::Occupied,
                    };
                    Ok(cells.iter().map(state).collect())
                })
            }
            Self::Percent(array) => {
                let cells = array.as_slice().map_err(not_contiguous)?;
                detached(py, || states_of_percent(cells, of, thresholds))
            }
            Self::Probability(array) => {
                let cells = array.as_slice().map_err(not_contiguous)?;
                detached(py, || states_of_p(cells, of, thresholds))
            }
        }
    }

    /// What the map says of the cells of a grid.
    pub(crate) fn patch(
        &self,
        py: Python<'_>,
        grid: &GridSpec,
        laid: Laid,
        name: &str,
    ) -> Result<Patch> {
        let dims = dims_of(self.shape(), grid).map_err(|error| error.with_place(name))?;
        if let Some(origin_m) = laid.origin_m {
            let spec = if grid.is_2d() {
                let [x, y, _] = origin_m;
                GridSpec::new_2d([x, y], grid.resolution_m(), [dims[0], dims[1]])?
            } else {
                GridSpec::new_3d(origin_m, grid.resolution_m(), dims)?
            };
            let states = self.states(py, laid.thresholds, name)?;
            return detached(py, || {
                let mut map = OccupancyMap::new_unknown(spec);
                for (index, state) in states.iter().enumerate() {
                    map.set(index, state.as_probability());
                }
                patch_of_occupancy(grid, &map, Thresholds::default())
            });
        }
        if dims != grid.dims() {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "a map of {} for a grid of {}",
                    shape_text(self.shape()),
                    shape_text(&shape_of(grid))
                ),
            )
            .with_place(name)
            .with_help("say where its lower corner is: origin=(x, y) in metres, and z in 3-D")
            .into());
        }
        Ok(Patch::new(
            [0; 3],
            dims,
            self.states(py, laid.thresholds, name)?,
        )?)
    }
}

fn not_contiguous(_: impl Sized) -> Error {
    Error::new(ErrorKind::Shape, "the cells do not lie one after another")
        .with_help("give numpy.ascontiguousarray(map)")
}

/// Cells along x, y and z of an array.
fn dims_of(shape: &[usize], grid: &GridSpec) -> chronotope::Result<[u32; 3]> {
    let num_axes = if grid.is_2d() { 2 } else { 3 };
    if shape.len() != num_axes {
        let axes = if grid.is_2d() {
            "(height, width)"
        } else {
            "(depth, height, width)"
        };
        let message = format!("an array of {} for a {num_axes}-D grid", shape_text(shape));
        return Err(Error::new(ErrorKind::Shape, message).with_help(format!(
            "give {axes}; of several maps one at a time, or observe_many"
        )));
    }
    let mut dims = [1; 3];
    for (dim, &side) in dims.iter_mut().zip(shape.iter().rev()) {
        *dim = u32::try_from(side)
            .map_err(|_| Error::new(ErrorKind::Shape, format!("{side} cells along one axis")))?;
    }
    Ok(dims)
}

/// As numpy has it: (height, width), or (depth, height, width).
pub(crate) fn shape_of(spec: &GridSpec) -> Vec<usize> {
    let [w, h, d] = spec.dims().map(|n| n as usize);
    if spec.is_2d() {
        vec![h, w]
    } else {
        vec![d, h, w]
    }
}

pub(crate) fn shape_text(shape: &[usize]) -> String {
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    format!("({})", sides.join(", "))
}

/// Of which argument cells are.
#[derive(Clone, Copy)]
struct Of<'a> {
    name: &'a str,
    shape: &'a [usize],
}

impl Of<'_> {
    /// Where the `at`-th cell is.
    fn place(self, mut at: usize) -> String {
        let mut index = vec![0; self.shape.len()];
        for (axis, &side) in self.shape.iter().enumerate().rev() {
            index[axis] = at % side;
            at /= side;
        }
        let index: Vec<String> = index.iter().map(ToString::to_string).collect();
        format!("{}[{}]", self.name, index.join(", "))
    }
}

fn states_of_percent(
    cells: &[i8],
    of: Of<'_>,
    thresholds: Thresholds,
) -> chronotope::Result<Vec<CellState>> {
    if let Some(at) = cells.iter().position(|it| !(-1..=OCCUPIED).contains(it)) {
        return Err(Error::new(
            ErrorKind::Config,
            format!("{} is no value of a cell", cells[at]),
        )
        .with_place(of.place(at))
        .with_help("int8 is percent from 0 to 100, and -1 where unknown"));
    }
    if cells.iter().max() == Some(&1) {
        return Err(Error::new(
            ErrorKind::Config,
            "the largest value is 1 percent: this looks like a map of 0 and 1",
        )
        .with_place(of.name)
        .with_help("give map.astype(bool) if 1 is occupied, map * 100 where -1 is unknown too"));
    }
    // As a map of map_server is read.
    let state = |&percent: &i8| match percent {
        ..0 => CellState::Unknown,
        percent => thresholds.state(f32::from(percent) / f32::from(OCCUPIED)),
    };
    Ok(cells.iter().map(state).collect())
}

fn states_of_p(
    cells: &[f32],
    of: Of<'_>,
    thresholds: Thresholds,
) -> chronotope::Result<Vec<CellState>> {
    let is_wrong = |p: &f32| !p.is_nan() && !(0.0..=1.0).contains(p);
    if let Some(at) = cells.iter().position(is_wrong) {
        return Err(Error::new(
            ErrorKind::Config,
            format!("{} is no probability", cells[at]),
        )
        .with_place(of.place(at))
        .with_help("floats are probabilities from 0 to 1, and NaN where unknown"));
    }
    let state = |&p: &f32| {
        if p.is_nan() {
            CellState::Unknown
        } else {
            thresholds.state(p)
        }
    };
    Ok(cells.iter().map(state).collect())
}

/// A new array of the shape of a grid.
pub(crate) fn array_of<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    spec: &GridSpec,
) -> Result<Bound<'py, PyAny>> {
    let array = PyArray1::from_vec(py, values);
    Ok(array.reshape(shape_of(spec))?.into_any())
}

/// The states of cells as ROS has them: 100, 0 and -1.
pub(crate) fn ros_values(map: &OccupancyMap, thresholds: Thresholds) -> Vec<i8> {
    let value = |&p: &f32| match p {
        p if p.is_nan() => -1,
        p => match thresholds.state(p) {
            CellState::Occupied => OCCUPIED,
            CellState::Free => 0,
            CellState::Unknown => -1,
        },
    };
    map.probabilities().iter().map(value).collect()
}

/// A point of two or three numbers, z 0 where it is not given.
pub(crate) fn point_of(numbers: &[f64], name: &str) -> Result<[f64; 3]> {
    match *numbers {
        [x, y] => Ok([x, y, 0.0]),
        [x, y, z] => Ok([x, y, z]),
        _ => Err(Error::new(
            ErrorKind::Shape,
            format!("{} numbers are no point", numbers.len()),
        )
        .with_place(name)
        .with_help("give (x, y) in metres, and z in 3-D")
        .into()),
    }
}

/// The cell of an index of numpy: (row, column), or (layer, row, column).
pub(crate) fn cell_of(index: &[i64], spec: &GridSpec, name: &str) -> Result<[u32; 3]> {
    let shape = shape_of(spec);
    let fits = index.len() == shape.len()
        && (index.iter().zip(&shape)).all(|(&at, &side)| (0..side as i64).contains(&at));
    if !fits {
        return Err(Error::new(
            ErrorKind::Shape,
            format!("{index:?} is no cell of a grid of {}", shape_text(&shape)),
        )
        .with_place(name)
        .with_help("give (row, column), row 0 at the lowest y; in 3-D (layer, row, column)")
        .into());
    }
    let mut cell = [0; 3];
    for (axis, &at) in cell.iter_mut().zip(index.iter().rev()) {
        *axis = at as u32;
    }
    Ok(cell)
}

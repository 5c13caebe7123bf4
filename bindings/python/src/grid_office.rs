//! What does the simulated office look like, for examples and tests without data?

use chronotope::Time;
use fremen_grid::simulation::{Layout, Office};
use fremen_grid::{GridConfig, GridSpec, History, Thresholds};
use pyo3::prelude::*;

use crate::failure::{Result, detached};
use crate::grid::PyGrid;
use crate::grid_cells::{array_of, ros_values};
use crate::grid_state::Shared;
use crate::hints::{Occupancy, TimeLike};
use crate::python::time_of;

/// An office that is drawn: two rooms, a corridor between cupboards that are open by day, a second way
/// through doors, desks and chairs; all of it follows hour and weekday (UTC), the same on every
/// machine.
///
/// ``resolution`` is the side of a cell in metres. After T. Krajník et al., IROS 2016, sections V and
/// VI.
///
/// Errors: ``ConfigError`` for a resolution that makes no grid.
#[pyclass(frozen, module = "chronotope", name = "Office")]
pub(crate) struct PyOffice {
    office: Office,
    spec: GridSpec,
    seed: u64,
}

#[pymethods]
impl PyOffice {
    #[new]
    #[pyo3(signature = (seed=1, *, resolution=0.05))]
    fn new(seed: u64, resolution: f64) -> Result<Self> {
        let office = Office::new(seed, Layout::Paper);
        let spec = office.spec(resolution)?;
        Ok(Self { office, spec, seed })
    }

    /// The map of a moment, without the people who walk by, int8 (height, width) as in ROS: 100
    /// occupied, 0 free, -1 unknown; row 0 has the lowest y.
    ///
    /// Errors: ``TimeError``.
    fn render<'py>(&self, py: Python<'py>, time: TimeLike<'py>) -> Result<Occupancy<'py>> {
        let time: Time = time_of(&time.0)?;
        let map = detached(py, || Ok(self.office.true_map(time, self.spec)))?;
        let values = ros_values(&map, Thresholds::default());
        Ok(Occupancy(array_of(py, values, &self.spec)?))
    }

    /// An empty grid in memory over the whole office.
    fn grid(&self) -> PyGrid {
        let history = History::new(self.spec);
        PyGrid::of(Shared::in_memory(history, GridConfig::default()))
    }

    /// Two places (x, y) in m where nothing ever stands: in the first room, and in the second.
    #[getter]
    fn places(&self) -> ((f64, f64), (f64, f64)) {
        let [[ax, ay], [bx, by]] = self.office.places();
        ((ax, ay), (bx, by))
    }

    fn __repr__(&self) -> String {
        let [width, height, _] = self.spec.dims();
        format!(
            "<Office {}: ({height}, {width}) cells of {} m>",
            self.seed,
            self.spec.resolution_m()
        )
    }
}

//! What does a robot with a laser do in a grid: map, localise, plan?

use std::sync::{Mutex, PoisonError};

use chronotope::{Error, ErrorKind, Time};
use fremen_grid::localize::{
    Estimate, FilterConfig, FreeSpace, LikelihoodField, LikelihoodFieldConfig, MonteCarlo,
};
use fremen_grid::plan::{Forecast, Plan, Planner};
use fremen_grid::pose::Pose2;
use fremen_grid::scan::{InverseSensorModel, LaserScan, ScanMapper};
use fremen_grid::{FittedGrid, GridSpec, OccupancyMap, Thresholds};
use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};
use std::sync::Arc;

use crate::failure::{Result, detached};
use crate::grid_cells::shape_text;
use crate::grid_state::Shared;
use crate::hints::{FloatsLike, Json, Moment, Numbers, Stamps};
use crate::python::{column, json_line, loads, moment, table};

/// Numbers of an array, and its shape.
fn floats<T: numpy::Element + Copy>(
    object: &Bound<'_, PyAny>,
    dtype: &str,
    name: &str,
) -> Result<(Vec<T>, Vec<usize>)> {
    let module = object.py().import("chronotope._grids")?;
    let array = module.getattr("as_floats")?.call1((object, dtype, name))?;
    let array = array.cast::<PyArrayDyn<T>>().map_err(PyErr::from)?;
    let array = array.try_readonly().map_err(|_| {
        Error::new(ErrorKind::Conflict, "somebody is writing to this array").with_place(name)
    })?;
    Ok((
        array.as_array().iter().copied().collect(),
        array.shape().to_vec(),
    ))
}

/// Of what takes layers of cells for a plane.
fn refuse_3d(spec: &GridSpec) -> Result<()> {
    if spec.is_2d() {
        return Ok(());
    }
    Err(
        Error::new(ErrorKind::Shape, "a planar laser needs a 2-D grid")
            .with_help("make a grid of the height at which it looks")
            .into(),
    )
}

/// A laser: the angle of its first beam, from one to the next, and how far it sees.
#[derive(Clone, Copy)]
pub(crate) struct Laser {
    pub(crate) first_rad: f64,
    pub(crate) step_rad: f64,
    pub(crate) max_range_m: f64,
}

impl Laser {
    fn scan(&self, ranges: &[f32]) -> chronotope::Result<LaserScan> {
        LaserScan::new(
            self.first_rad,
            self.step_rad,
            self.max_range_m,
            ranges.to_vec(),
        )
    }
}

/// Scans and where they were made.
pub(crate) struct Sensed {
    scans: Vec<(Pose2, LaserScan)>,
}

impl Sensed {
    pub(crate) fn of(
        ranges: &Bound<'_, PyAny>,
        poses: &Bound<'_, PyAny>,
        laser: Laser,
    ) -> Result<Self> {
        let (ranges, ranges_shape) = floats::<f32>(ranges, "float32", "ranges")?;
        let (poses, poses_shape) = floats::<f64>(poses, "float64", "poses")?;
        let num_scans = match (&ranges_shape[..], &poses_shape[..]) {
            ([_], [3]) => 1,
            (&[scans, _], &[poses, 3]) if scans == poses => scans,
            (ranges, poses) => {
                let message = format!(
                    "ranges of {} at poses of {}",
                    shape_text(ranges),
                    shape_text(poses)
                );
                return Err(Error::new(ErrorKind::Shape, message)
                    .with_help("give (beams,) and (3,) for one scan, (scans, beams) and (scans, 3)")
                    .into());
            }
        };
        let num_beams = ranges_shape.last().copied().unwrap_or_default();
        let poses = poses
            .chunks_exact(3)
            .map(|it| Pose2::new(it[0], it[1], it[2]));
        let scan = |(at, pose): (usize, Pose2)| {
            let ranges = &ranges[at * num_beams..(at + 1) * num_beams];
            Ok((pose, laser.scan(ranges)?))
        };
        let scans = poses.enumerate().take(num_scans).map(scan);
        Ok(Self {
            scans: scans.collect::<chronotope::Result<_>>()?,
        })
    }

    /// What they say of the cells of a grid.
    pub(crate) fn map(
        &self,
        py: Python<'_>,
        spec: &GridSpec,
        sensor: Option<&str>,
    ) -> Result<OccupancyMap> {
        refuse_3d(spec)?;
        let one_or_several = if self.scans.len() == 1 {
            "ideal"
        } else {
            "reduced"
        };
        let model = match sensor.unwrap_or(one_or_several) {
            "ideal" => InverseSensorModel::ideal(),
            "reduced" => InverseSensorModel::reduced(),
            other => {
                let message = format!("there is no sensor `{other}`");
                return Err(Error::new(ErrorKind::Config, message)
                    .with_place("sensor")
                    .with_help("use one of ideal, reduced")
                    .into());
            }
        };
        detached(py, || {
            let mut mapper = ScanMapper::new(*spec, model);
            for (at, (pose, scan)) in self.scans.iter().enumerate() {
                (mapper.add(pose, scan))
                    .map_err(|error| error.with_place(format!("poses[{at}]")))?;
            }
            Ok(mapper.to_map())
        })
    }
}

/// Says where a laser is in one predicted map, scan by scan: adaptive Monte Carlo localisation with a
/// likelihood field. The same seed gives the same poses for any number of threads.
///
/// Made by ``Grid.localizer``. Sources: S. Thrun, W. Burgard, D. Fox: Probabilistic Robotics, sections
/// 6.4 and 8.3; the map of the time: T. Krajník et al., IROS 2016.
#[pyclass(frozen, module = "chronotope", name = "GridLocalizer")]
pub(crate) struct PyGridLocalizer {
    sensor: LikelihoodField,
    space: FreeSpace,
    laser: Laser,
    now: Mutex<Now>,
}

/// What is believed, and where the odometry was at the last scan.
struct Now {
    filter: MonteCarlo,
    odometry: Option<Pose2>,
}

/// How surely the pose is known that a caller gives.
const DEVIATION_M: f64 = 0.2;
const DEVIATION_RAD: f64 = 0.1;

impl PyGridLocalizer {
    pub(crate) fn new(
        py: Python<'_>,
        map: &OccupancyMap,
        laser: Laser,
        pose: Option<(f64, f64, f64)>,
        seed: u64,
    ) -> Result<Self> {
        refuse_3d(map.spec())?;
        laser.scan(&[])?;
        detached(py, || {
            let sensor = LikelihoodField::new(map, LikelihoodFieldConfig::default())?;
            let space = FreeSpace::of(map, Thresholds::default())?;
            let config = FilterConfig::default();
            let filter = match pose {
                Some((x, y, heading)) => {
                    let pose = Pose2::new(x, y, heading);
                    MonteCarlo::around(&pose, DEVIATION_M, DEVIATION_RAD, config, seed)?
                }
                None => MonteCarlo::anywhere(&space, config, seed)?,
            };
            Ok(Self {
                sensor,
                space,
                laser,
                now: Mutex::new(Now {
                    filter,
                    odometry: None,
                }),
            })
        })
    }
}

#[pymethods]
impl PyGridLocalizer {
    /// Where the laser is after this scan.
    ///
    /// ``ranges`` is (beams,) in metres; ``odometry`` (x, y, heading) in metres and radians is where
    /// the laser believes to be by its wheels, in any frame: what counts is how it moved since the last
    /// scan. A scan after less than 0.2 m and 0.2 rad only moves the estimate.
    ///
    /// Errors: ``ShapeError``, ``ConfigError`` for an odometry that is not finite.
    fn see(
        &self,
        py: Python<'_>,
        ranges: FloatsLike<'_>,
        odometry: (f64, f64, f64),
    ) -> Result<PyPoseEstimate> {
        let (ranges, shape) = floats::<f32>(&ranges.0, "float32", "ranges")?;
        if shape.len() != 1 {
            let message = format!("an array of {} is no scan", shape_text(&shape));
            return Err(Error::new(ErrorKind::Shape, message)
                .with_place("ranges")
                .with_help("give (beams,): one scan at a time")
                .into());
        }
        let odometry = Pose2::new(odometry.0, odometry.1, odometry.2);
        let estimate = detached(py, || {
            let scan = self.laser.scan(&ranges)?;
            let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
            let motion = match now.odometry {
                Some(before) => before.to(&odometry),
                // Says so if it is not finite.
                None if !odometry.is_finite() => odometry,
                None => Pose2::default(),
            };
            let estimate = (now.filter).step(&motion, &scan, &self.sensor, &self.space)?;
            now.odometry = Some(odometry);
            Ok(estimate)
        })?;
        Ok(PyPoseEstimate { estimate })
    }

    /// All beliefs, float64 (n, 4): x and y in m, heading in rad, weight; weights add up to 1.
    #[getter]
    fn particles<'py>(&self, py: Python<'py>) -> Result<Numbers<'py>> {
        let rows = detached(py, || {
            let now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
            let rows = now.filter.particles().iter();
            let rows =
                rows.flat_map(|it| [it.pose.x_m, it.pose.y_m, it.pose.heading_rad, it.weight]);
            Ok(rows.collect::<Vec<f64>>())
        })?;
        Ok(Numbers(table(py, rows, 4)?))
    }

    fn __repr__(&self, py: Python<'_>) -> Result<String> {
        let num = detached(py, || {
            let now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
            Ok(now.filter.particles().len())
        })?;
        Ok(format!("<GridLocalizer: {num} particles>"))
    }
}

/// Where a laser is, and how surely.
#[pyclass(frozen, module = "chronotope", name = "PoseEstimate")]
pub(crate) struct PyPoseEstimate {
    estimate: Estimate,
}

#[pymethods]
impl PyPoseEstimate {
    /// x and y in m, heading in rad: the mean of the heaviest group of particles.
    #[getter]
    fn pose(&self) -> (f64, f64, f64) {
        let pose = self.estimate.pose;
        (pose.x_m, pose.y_m, pose.heading_rad)
    }

    /// Their standard deviation in x and y together, m.
    #[getter]
    fn deviation_m(&self) -> f64 {
        self.estimate.deviation_m
    }

    /// Their standard deviation in heading, rad.
    #[getter]
    fn deviation_rad(&self) -> f64 {
        self.estimate.deviation_rad
    }

    /// The share of all weight that they have: low where the laser may be in several places.
    #[getter]
    fn share(&self) -> f64 {
        self.estimate.share
    }

    /// Particles of all groups.
    #[getter]
    fn num_particles(&self) -> usize {
        self.estimate.num_particles
    }

    /// How well the scan fits the map: the geometric mean of the likelihood of a beam.
    #[getter]
    fn fit(&self) -> f64 {
        self.estimate.fit
    }

    /// As ``chronotope grid localize --json`` prints it, but for the log's time.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let it = &self.estimate;
        let value = json!({
            "x_m": it.pose.x_m,
            "y_m": it.pose.y_m,
            "heading_rad": it.pose.heading_rad,
            "deviation_m": it.deviation_m,
            "share": it.share,
            "fit": it.fit,
        });
        loads(py, &json_line(&value)?)
    }

    fn __repr__(&self) -> String {
        let it = &self.estimate;
        format!(
            "<PoseEstimate ({:.2}, {:.2}) m {:+.2} rad, within {:.2} m, {:.0} % of the particles>",
            it.pose.x_m,
            it.pose.y_m,
            it.pose.heading_rad,
            it.deviation_m,
            100.0 * it.share
        )
    }
}

/// A fitted grid as a planner asks it.
struct Ahead<'a, 'g>(&'a FittedGrid<'g>);

impl Forecast for Ahead<'_, '_> {
    fn spec(&self) -> GridSpec {
        *self.0.history().spec()
    }

    fn predict_into(&mut self, time: Time, map: &mut OccupancyMap) -> chronotope::Result<()> {
        self.0.predict_into(time, map)
    }
}

/// A way through a grid, and when the robot is where on it.
#[pyclass(frozen, module = "chronotope", name = "GridPath")]
pub(crate) struct PyGridPath {
    plan: Plan,
    depart: Time,
}

impl PyGridPath {
    pub(crate) fn plan(
        py: Python<'_>,
        grid: &Arc<Shared>,
        [start_m, goal_m]: [[f64; 2]; 2],
        depart: Time,
        planner: Planner,
    ) -> Result<Option<Self>> {
        refuse_3d(&grid.spec)?;
        let plan = grid.ask(py, move |fitted| {
            planner.plan(&mut Ahead(fitted), start_m, goal_m, depart)
        })?;
        Ok(plan.map(|plan| Self { plan, depart }))
    }

    fn end(&self) -> Time {
        self.plan.times.last().copied().unwrap_or(self.depart)
    }

    fn value(&self) -> Value {
        json!({
            "is_found": true,
            "length_m": self.plan.length_m,
            "p_free": self.plan.p_free,
            "arrival": self.end().to_string(),
            "points_m": self.plan.points_m,
        })
    }
}

#[pymethods]
impl PyGridPath {
    /// The centres of its cells from start to goal, float64 (n, 2), m.
    #[getter]
    fn xy<'py>(&self, py: Python<'py>) -> Result<Numbers<'py>> {
        let points = self.plan.points_m.iter().flatten().copied();
        Ok(Numbers(table(py, points.collect(), 2)?))
    }

    /// When the robot comes to each, int64 (n,), microseconds since 1970 in UTC:
    /// ``.view("datetime64[us]")``.
    #[getter]
    fn times_us<'py>(&self, py: Python<'py>) -> Result<Stamps<'py>> {
        let times = self.plan.times.iter().map(|time| time.as_us());
        Ok(Stamps(column(py, times.collect())?))
    }

    /// Its length, m.
    #[getter]
    fn length_m(&self) -> f64 {
        self.plan.length_m
    }

    /// How likely nothing stops the robot on it.
    #[getter]
    fn p_free(&self) -> f64 {
        self.plan.p_free
    }

    /// When it is there, in UTC.
    #[getter]
    fn arrival<'py>(&self, py: Python<'py>) -> Result<Moment<'py>> {
        moment(py, self.end())
    }

    /// As ``chronotope grid plan --json`` prints it.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &self.to_json()?)
    }

    /// The line that ``chronotope grid plan --json`` prints.
    fn to_json(&self) -> Result<String> {
        json_line(&self.value())
    }

    fn __len__(&self) -> usize {
        self.plan.points_m.len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<GridPath: {:.1} m, there at {}, free with p = {:.2}>",
            self.plan.length_m,
            self.end(),
            self.plan.p_free
        )
    }
}

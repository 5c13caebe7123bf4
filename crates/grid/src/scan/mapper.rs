//! What do scans at known poses say about each cell?

use std::ops::ControlFlow;

use fremen::{Error, ErrorKind, Result};

use crate::cells::{GridSpec, OccupancyMap};
use crate::pose::Pose2;
use crate::scan::laser::{Beam, LaserScan};
use crate::scan::ray::walk;

/// How much one scan says about a cell, in log odds (natural logarithm).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseSensorModel {
    hit: f32,
    pass: f32,
    limit: f32,
}

impl InverseSensorModel {
    /// A cell in which a beam ends gains `hit`, one through which it passes loses `pass`; the sum
    /// stays within `limit` of 0, so that a cell can change its mind.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where one is not a positive number.
    pub fn new(hit: f32, pass: f32, limit: f32) -> Result<Self> {
        if [hit, pass, limit].iter().all(|x| x.is_finite() && *x > 0.0) {
            return Ok(Self { hit, pass, limit });
        }
        let message = format!("log odds of {hit}, {pass} and {limit} are not all positive");
        Err(Error::new(ErrorKind::Config, message))
    }

    /// An exact laser at an exact pose: what it says is nearly sure.
    pub const fn ideal() -> Self {
        Self {
            hit: 3.0,
            pass: 3.0,
            limit: 6.0,
        }
    }

    /// The "reduced" ideal model of the thesis: the same cells with smaller steps, because the pose
    /// is not known exactly, and a hit counts more than a ray that may only have grazed the cell.
    pub const fn reduced() -> Self {
        Self {
            hit: 0.85,
            pass: 0.4,
            limit: 4.0,
        }
    }
}

impl Default for InverseSensorModel {
    fn default() -> Self {
        Self::reduced()
    }
}

/// A map in the making: scans at given poses, added up as log odds.
///
/// A cell gains or loses once a scan, however many of its beams meet it, and a beam that ends in a
/// cell outweighs those of the same scan that pass it: a wall that is seen at a flat angle is not
/// worn away by its own scan.
///
/// A beam that ends in a cell also speaks against a surface in the next one, without making it free:
/// otherwise the noise of the laser gives every wall a second row of cells behind it, which no beam
/// ever passes to take it away again.
#[derive(Clone, Debug)]
pub struct ScanMapper {
    spec: GridSpec,
    model: InverseSensorModel,
    /// NaN where no beam came.
    log_odds: Vec<f32>,
    /// The last scan that met the cell.
    met_by: Vec<u32>,
    /// Whether a beam ever passed the cell.
    is_passed: Vec<bool>,
    num_scans: u32,
}

impl ScanMapper {
    /// An empty map of a 2-D grid.
    pub fn new(spec: GridSpec, model: InverseSensorModel) -> Self {
        Self {
            spec,
            model,
            log_odds: vec![f32::NAN; spec.num_cells()],
            met_by: vec![0; spec.num_cells()],
            is_passed: vec![false; spec.num_cells()],
            num_scans: 0,
        }
    }

    /// Adds the scan of a laser at `pose` of the map.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the pose is not finite; the map is then as it was.
    pub fn add(&mut self, pose: &Pose2, scan: &LaserScan) -> Result<()> {
        if !pose.is_finite() {
            let message = format!("a scan at {pose:?} has no place in a map");
            return Err(Error::new(ErrorKind::Config, message)
                .with_help("leave out scans whose pose is not known"));
        }
        self.num_scans += 1;
        let end = |angle: f64, range: f64| {
            let (sin, cos) = (pose.heading_rad + angle).sin_cos();
            [pose.x_m + range * cos, pose.y_m + range * sin]
        };
        for (angle, beam) in scan.beams() {
            if let Beam::Hit(range) = beam {
                let [x, y] = end(angle, range);
                if let Some(cell) = self.spec.cell_at([x, y, 0.0]) {
                    self.change(self.spec.index(cell), self.model.hit);
                }
            }
        }
        let spec = self.spec;
        for (angle, beam) in scan.beams() {
            let (range, hit) = match beam {
                Beam::Hit(range) => (range, true),
                Beam::Free(range) => (range, false),
                Beam::Invalid => continue,
            };
            let to = end(angle, range);
            let last = (spec.cell_at([to[0], to[1], 0.0])).map(|cell| spec.index(cell));
            // Just long enough to reach the cell behind the end.
            let further = end(
                angle,
                range + if hit { 2.0 * spec.resolution_m() } else { 0.0 },
            );
            let mut is_behind = false;
            walk(&spec, [pose.x_m, pose.y_m], further, |crossing| {
                if is_behind {
                    self.deny(crossing.index);
                    return ControlFlow::Break(());
                }
                is_behind = hit && last == Some(crossing.index);
                if !is_behind && crossing.enter_m <= range {
                    self.change(crossing.index, -self.model.pass);
                    self.is_passed[crossing.index] = true;
                }
                ControlFlow::Continue(())
            });
        }
        Ok(())
    }

    fn change(&mut self, index: usize, by: f32) {
        if self.met_by[index] == self.num_scans {
            return;
        }
        self.met_by[index] = self.num_scans;
        let before = self.log_odds[index];
        let sum = if before.is_nan() { by } else { before + by };
        self.log_odds[index] = sum.clamp(-self.model.limit, self.model.limit);
    }

    /// The surface is in the cell before, hence not in this one; that does not make it free.
    fn deny(&mut self, index: usize) {
        if !self.log_odds[index].is_nan() {
            self.change(index, -self.model.pass);
        }
    }

    /// Number of scans since the beginning or the last [`clear`](Self::clear).
    pub const fn num_scans(&self) -> u32 {
        self.num_scans
    }

    /// Forgets everything: the local map of the next few seconds begins (the thesis).
    pub fn clear(&mut self) {
        self.log_odds.fill(f32::NAN);
        self.met_by.fill(0);
        self.is_passed.fill(false);
        self.num_scans = 0;
    }

    /// The probabilities so far.
    pub fn to_map(&self) -> OccupancyMap {
        let mut map = OccupancyMap::new_unknown(self.spec);
        let cells = self.log_odds.iter().zip(&self.is_passed);
        for (p, (log_odds, is_passed)) in map.probabilities_mut().iter_mut().zip(cells) {
            // What is no surface and was never passed is behind one. NaN stays NaN.
            if *is_passed || *log_odds > 0.0 {
                *p = 1.0 / (1.0 + (-log_odds).exp());
            }
        }
        map
    }
}

/// A 2-D grid that holds all poses and all surfaces that were hit, and `margin_m` around them.
///
/// # Errors
/// [`ErrorKind::Config`] where nothing is given, or it is too far apart for one grid.
pub fn grid_around<'a>(
    scans: impl IntoIterator<Item = (&'a Pose2, &'a LaserScan)>,
    resolution_m: f64,
    margin_m: f64,
) -> Result<GridSpec> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut include = |point: [f64; 2]| {
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    };
    for (pose, scan) in scans {
        if !pose.is_finite() {
            continue;
        }
        include([pose.x_m, pose.y_m]);
        for (angle, beam) in scan.beams() {
            if let Beam::Hit(range) = beam {
                let (sin, cos) = angle.sin_cos();
                include(pose.place([range * cos, range * sin]));
            }
        }
    }
    if low[0] > high[0] {
        return Err(Error::new(ErrorKind::Config, "no scan has a known pose"));
    }
    // On whole cells, so that maps of the same place have the same cells.
    let first = [0, 1].map(|axis| ((low[axis] - margin_m) / resolution_m).floor());
    let last = [0, 1].map(|axis| ((high[axis] + margin_m) / resolution_m).ceil());
    let size = [0, 1].map(|axis| (last[axis] - first[axis]).max(1.0) as u32);
    GridSpec::new_2d(first.map(|cells| cells * resolution_m), resolution_m, size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// One beam straight ahead.
    fn beam(range: f32) -> LaserScan {
        LaserScan::new(0.0, 0.1, 8.0, vec![range]).expect("a scan")
    }

    #[test]
    fn a_beam_frees_its_way_marks_its_end_and_says_nothing_of_what_is_behind() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 1.0, [10, 1])?;
        let mut mapper = ScanMapper::new(spec, InverseSensorModel::ideal());
        mapper.add(&Pose2::new(0.5, 0.5, 0.0), &beam(4.0))?;
        let map = mapper.to_map();
        for x in 0..4 {
            assert!(map.get(x).is_some_and(|p| p < 0.1), "{x}");
        }
        assert!(map.get(4).is_some_and(|p| p > 0.9));
        assert_eq!(map.get(5), None);
        mapper.clear();
        mapper.add(&Pose2::new(0.5, 0.5, 0.0), &beam(f32::INFINITY))?;
        assert!(mapper.to_map().get(8).is_some_and(|p| p < 0.1));
        assert_eq!(mapper.to_map().get(9), None);
        mapper.clear();
        mapper.add(&Pose2::new(0.5, 0.5, 0.0), &beam(f32::NAN))?;
        assert_eq!(mapper.to_map(), OccupancyMap::new_unknown(spec));
        Ok(())
    }

    #[test]
    fn a_pose_without_a_place_is_refused_and_changes_nothing() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 1.0, [10, 1])?;
        let mut mapper = ScanMapper::new(spec, InverseSensorModel::default());
        for wrong in [f64::NAN, f64::INFINITY] {
            assert!(
                mapper
                    .add(&Pose2::new(0.5, wrong, 0.0), &beam(2.0))
                    .is_err()
            );
            assert!(
                mapper
                    .add(&Pose2::new(0.5, 0.5, wrong), &beam(2.0))
                    .is_err()
            );
        }
        assert_eq!(mapper.num_scans(), 0);
        assert_eq!(mapper.to_map(), OccupancyMap::new_unknown(spec));
        Ok(())
    }

    #[test]
    fn a_wall_at_a_flat_angle_is_not_worn_away_by_its_own_scan() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 0.1, [100, 20])?;
        let pose = Pose2::new(0.05, 0.5, 0.0);
        // A wall at y = 1.05, which is inside of the cells of row 10.
        let ranges = (1..90).map(|i| (0.55 / (f64::from(i) * PI / 180.0).sin()) as f32);
        let scan = LaserScan::new(PI / 180.0, PI / 180.0, 9.0, ranges.collect())?;
        let mut mapper = ScanMapper::new(spec, InverseSensorModel::reduced());
        for _ in 0..5 {
            mapper.add(&pose, &scan)?;
        }
        let map = mapper.to_map();
        for (angle, hit) in scan.beams() {
            let Beam::Hit(range) = hit else { continue };
            let (sin, cos) = angle.sin_cos();
            let cell = spec.cell_at([0.05 + range * cos, 0.5 + range * sin, 0.0]);
            let p = cell.and_then(|cell| map.get(spec.index(cell)));
            assert!(p.is_none_or(|p| p > 0.9));
        }
        Ok(())
    }

    #[test]
    fn a_grid_around_scans_holds_them_on_whole_cells() -> Result<()> {
        let scans = [(Pose2::new(1.0, 2.0, PI), beam(3.0))];
        let spec = grid_around(scans.iter().map(|(p, s)| (p, s)), 0.05, 0.5)?;
        assert!(spec.cell_at([-2.4, 1.6, 0.0]).is_some());
        assert!(spec.cell_at([1.4, 2.4, 0.0]).is_some());
        let cells = spec.origin_m()[0] / 0.05;
        assert!((cells - cells.round()).abs() < 1e-9);
        assert!(grid_around([], 0.05, 0.5).is_err());
        Ok(())
    }
}

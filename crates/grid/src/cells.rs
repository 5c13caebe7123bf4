//! Where is a cell, and in which state?

use fremen::{Error, ErrorKind, Result};

/// The most cells that one grid may have: indices fit 32 bits with room to spare.
pub const MAX_CELLS: u64 = 1 << 31;

/// Where a grid lies in the world, how large its cells are and how many it has.
///
/// The grid is an axis-aligned box of cubic cells (of squares in 2-D, where `dims[2]` is 1).
/// Cell `[x, y, z]` covers `origin + resolution * [x, x + 1)` along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridSpec {
    origin_m: [f64; 3],
    resolution_m: f64,
    dims: [u32; 3],
    planar: bool,
}

impl GridSpec {
    /// A 2-D grid of `size` = width x height cells, whose lower left corner is at `origin_m`.
    ///
    /// A 2-D grid takes any z: only x and y place a point.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where a number is not finite, the resolution is not positive, a side
    /// is zero, the cells are more than [`MAX_CELLS`], or are too small to be told apart at
    /// that distance from zero.
    pub fn new_2d(origin_m: [f64; 2], resolution_m: f64, size: [u32; 2]) -> Result<Self> {
        let [x, y] = origin_m;
        Self::checked([x, y, 0.0], resolution_m, [size[0], size[1], 1], true)
    }

    /// A 3-D grid of `dims` cells, whose lowest corner is at `origin_m`.
    ///
    /// # Errors
    /// As for [`Self::new_2d`].
    pub fn new_3d(origin_m: [f64; 3], resolution_m: f64, dims: [u32; 3]) -> Result<Self> {
        Self::checked(origin_m, resolution_m, dims, false)
    }

    fn checked(
        origin_m: [f64; 3],
        resolution_m: f64,
        dims: [u32; 3],
        planar: bool,
    ) -> Result<Self> {
        if origin_m.iter().any(|value| !value.is_finite()) {
            return Err(config(format!(
                "the origin {origin_m:?} of a grid is not finite"
            )));
        }
        if !(resolution_m.is_finite() && resolution_m > 0.0) {
            return Err(config(format!(
                "a resolution of {resolution_m} m per cell is not positive"
            )));
        }
        if dims.contains(&0) {
            return Err(config(format!("a grid of {dims:?} cells has none")));
        }
        let cells = dims
            .iter()
            .try_fold(1_u64, |product, &n| product.checked_mul(u64::from(n)));
        if cells.is_none_or(|cells| cells > MAX_CELLS) {
            return Err(config(format!(
                "a grid of {dims:?} cells has more than {MAX_CELLS}"
            ))
            .with_help("use larger cells or a smaller area"));
        }
        for (axis, &start) in origin_m.iter().enumerate() {
            let end = start + resolution_m * f64::from(dims[axis]);
            let step = (start.abs().max(end.abs())) * f64::EPSILON;
            if !end.is_finite() || step > resolution_m * 1e-3 {
                return Err(config(format!(
                    "cells of {resolution_m} m at {start} m from zero cannot be told apart"
                ))
                .with_help("choose an origin nearer to zero"));
            }
        }
        Ok(Self {
            origin_m,
            resolution_m,
            dims,
            planar,
        })
    }

    /// The lowest corner of cell `[0, 0, 0]`; z is 0 in 2-D.
    pub const fn origin_m(&self) -> [f64; 3] {
        self.origin_m
    }

    /// Side of a cell.
    pub const fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// Cells along x, y and z; 1 along z in 2-D.
    pub const fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// Whether it was made by [`Self::new_2d`].
    pub const fn is_2d(&self) -> bool {
        self.planar
    }

    /// Number of cells.
    pub const fn num_cells(&self) -> usize {
        self.dims[0] as usize * self.dims[1] as usize * self.dims[2] as usize
    }

    /// The cell that covers `point_m`; none for a point outside, or one that is not finite.
    ///
    /// A point outside never becomes a cell of the border.
    pub fn cell_at(&self, point_m: [f64; 3]) -> Option<[u32; 3]> {
        let mut cell = [0; 3];
        let axes = if self.planar { 2 } else { 3 };
        for axis in 0..axes {
            let steps = ((point_m[axis] - self.origin_m[axis]) / self.resolution_m).floor();
            // NaN fails both comparisons.
            if !(steps >= 0.0 && steps < f64::from(self.dims[axis])) {
                return None;
            }
            cell[axis] = steps as u32;
        }
        Some(cell)
    }

    /// The index of `cell`: x runs fastest, then y, then z.
    ///
    /// `cell` must lie inside; elsewhere the index is one that [`Self::num_cells`] excludes or
    /// that of another cell.
    pub const fn index(&self, cell: [u32; 3]) -> usize {
        cell[0] as usize
            + self.dims[0] as usize * (cell[1] as usize + self.dims[1] as usize * cell[2] as usize)
    }

    /// The cell of an index: the inverse of [`Self::index`].
    pub const fn cell(&self, index: usize) -> [u32; 3] {
        let (w, h) = (self.dims[0] as usize, self.dims[1] as usize);
        [
            (index % w) as u32,
            (index / w % h) as u32,
            (index / w / h) as u32,
        ]
    }

    /// The centre of `cell`; z is 0 in 2-D.
    pub fn center(&self, cell: [u32; 3]) -> [f64; 3] {
        let mut point = [0.0; 3];
        let axes = if self.planar { 2 } else { 3 };
        for axis in 0..axes {
            point[axis] = self.origin_m[axis] + (f64::from(cell[axis]) + 0.5) * self.resolution_m;
        }
        point
    }

    /// Whether `cell` is one of the grid's.
    pub const fn contains(&self, cell: [u32; 3]) -> bool {
        cell[0] < self.dims[0] && cell[1] < self.dims[1] && cell[2] < self.dims[2]
    }
}

fn config(message: String) -> Error {
    Error::new(ErrorKind::Config, message)
}

/// What is known of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum CellState {
    /// Seen through.
    Free,
    /// Something is there.
    Occupied,
    /// Hidden, out of range, or never looked at.
    #[default]
    Unknown,
}

impl CellState {
    /// Whether it is free or occupied.
    pub const fn is_known(self) -> bool {
        !matches!(self, Self::Unknown)
    }

    /// `free`, `occupied` or `unknown`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Occupied => "occupied",
            Self::Unknown => "unknown",
        }
    }

    /// How likely a cell in this state is occupied; none where it is unknown.
    pub const fn as_probability(self) -> Option<f32> {
        match self {
            Self::Free => Some(0.0),
            Self::Occupied => Some(1.0),
            Self::Unknown => None,
        }
    }
}

/// The probability of being occupied of each cell of a grid at one time.
#[derive(Clone, Debug)]
pub struct OccupancyMap {
    spec: GridSpec,
    // NaN: never observed. One f32 a cell keeps prediction bound by memory bandwidth, not size.
    probabilities: Vec<f32>,
}

impl OccupancyMap {
    /// A map in which no cell was observed.
    pub fn new_unknown(spec: GridSpec) -> Self {
        Self {
            spec,
            probabilities: vec![f32::NAN; spec.num_cells()],
        }
    }

    /// A map of given probabilities, in the order of [`GridSpec::index`], NaN where unknown.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where they are not as many as the cells, [`ErrorKind::Config`] where
    /// one is neither NaN nor in [0, 1].
    pub fn from_probabilities(spec: GridSpec, probabilities: Vec<f32>) -> Result<Self> {
        if probabilities.len() != spec.num_cells() {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "{} probabilities for {} cells",
                    probabilities.len(),
                    spec.num_cells()
                ),
            ));
        }
        if let Some(wrong) = probabilities
            .iter()
            .find(|p| !p.is_nan() && !(0.0..=1.0).contains(*p))
        {
            return Err(config(format!("{wrong} is no probability")));
        }
        Ok(Self {
            spec,
            probabilities,
        })
    }

    /// Where its cells are.
    pub const fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// The probability that a cell is occupied; none where it was never observed or the index is
    /// outside.
    pub fn get(&self, index: usize) -> Option<f32> {
        self.probabilities
            .get(index)
            .copied()
            .filter(|p| !p.is_nan())
    }

    /// Sets the probability of a cell, none for "never observed".
    ///
    /// A value outside [0, 1] is moved to the nearer end, and NaN is "never observed". An index
    /// outside does nothing.
    pub fn set(&mut self, index: usize, probability: Option<f32>) {
        if let Some(cell) = self.probabilities.get_mut(index) {
            *cell = probability.map_or(f32::NAN, |p| p.clamp(0.0, 1.0));
        }
    }

    /// All probabilities in the order of [`GridSpec::index`]; NaN where never observed.
    pub fn probabilities(&self) -> &[f32] {
        &self.probabilities
    }

    /// All probabilities, to be written: each NaN or in [0, 1].
    pub fn probabilities_mut(&mut self) -> &mut [f32] {
        &mut self.probabilities
    }

    /// The state of a cell by two thresholds: occupied where p > `occupied`, free where p <
    /// `free`, else unknown.
    pub fn state(&self, index: usize, thresholds: Thresholds) -> CellState {
        self.get(index)
            .map_or(CellState::Unknown, |p| thresholds.state(p))
    }
}

impl PartialEq for OccupancyMap {
    /// Equal where never-observed cells are the same and all other probabilities are.
    fn eq(&self, other: &Self) -> bool {
        let same = |(a, b): (&f32, &f32)| a == b || (a.is_nan() && b.is_nan());
        self.spec == other.spec
            && self.probabilities.len() == other.probabilities.len()
            && self
                .probabilities
                .iter()
                .zip(&other.probabilities)
                .all(same)
    }
}

/// From which probability on a cell is occupied, and up to which it is free.
///
/// Uses differ: a planner may treat as free only what is surely free, a localiser as occupied
/// what is more likely so than not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    free: f32,
    occupied: f32,
}

impl Thresholds {
    /// Free below `free`, occupied above `occupied`, unknown from one to the other.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where one is outside [0, 1] or `free` is above `occupied`.
    pub fn new(free: f32, occupied: f32) -> Result<Self> {
        let inside = (0.0..=1.0).contains(&free) && (0.0..=1.0).contains(&occupied);
        if !inside || free > occupied {
            return Err(
                config(format!("thresholds free {free}, occupied {occupied} cross"))
                    .with_help("0 <= free <= occupied <= 1"),
            );
        }
        Ok(Self { free, occupied })
    }

    /// The state that a probability stands for.
    pub fn state(self, probability: f32) -> CellState {
        if probability > self.occupied {
            CellState::Occupied
        } else if probability < self.free {
            CellState::Free
        } else {
            CellState::Unknown
        }
    }

    /// Below which a cell is free.
    pub const fn free(self) -> f32 {
        self.free
    }

    /// Above which a cell is occupied.
    pub const fn occupied(self) -> f32 {
        self.occupied
    }
}

impl Default for Thresholds {
    /// Free below 0.5, occupied above it: the most likely state.
    fn default() -> Self {
        Self {
            free: 0.5,
            occupied: 0.5,
        }
    }
}

/// The states of a box of cells that were observed at one time.
///
/// A patrol's map, a local map, a camera's view. `Unknown` cells of the box were not observed and
/// leave the grid as it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patch {
    min: [u32; 3],
    dims: [u32; 3],
    states: Vec<CellState>,
}

impl Patch {
    /// A box of `dims` cells from cell `min` of the grid on; `states` with x fastest, then y, z.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where `states` are not as many as the cells of the box.
    pub fn new(min: [u32; 3], dims: [u32; 3], states: Vec<CellState>) -> Result<Self> {
        let cells = dims
            .iter()
            .try_fold(1_usize, |product, &n| product.checked_mul(n as usize));
        if cells != Some(states.len()) {
            return Err(Error::new(
                ErrorKind::Shape,
                format!("{} states for a box of {dims:?} cells", states.len()),
            ));
        }
        Ok(Self { min, dims, states })
    }

    /// A box in which nothing is known yet.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where it has more than [`MAX_CELLS`] cells.
    pub fn new_unknown(min: [u32; 3], dims: [u32; 3]) -> Result<Self> {
        let cells = dims
            .iter()
            .try_fold(1_u64, |product, &n| product.checked_mul(u64::from(n)));
        match cells {
            Some(cells) if cells <= MAX_CELLS => Ok(Self {
                min,
                dims,
                states: vec![CellState::Unknown; cells as usize],
            }),
            _ => Err(Error::new(
                ErrorKind::Shape,
                format!("a box of {dims:?} cells has more than {MAX_CELLS}"),
            )),
        }
    }

    /// The patch that covers a whole grid, nothing known yet.
    pub fn new_whole(spec: &GridSpec) -> Self {
        Self {
            min: [0; 3],
            dims: spec.dims(),
            states: vec![CellState::Unknown; spec.num_cells()],
        }
    }

    /// The states of a map by two thresholds, as a patch of the map's whole grid.
    pub fn from_map(map: &OccupancyMap, thresholds: Thresholds) -> Self {
        let states = (0..map.spec().num_cells()).map(|index| map.state(index, thresholds));
        Self {
            min: [0; 3],
            dims: map.spec().dims(),
            states: states.collect(),
        }
    }

    /// Its lowest cell, in cells of the grid.
    pub const fn min(&self) -> [u32; 3] {
        self.min
    }

    /// Cells along x, y and z.
    pub const fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// All states, x fastest, then y, then z.
    pub fn states(&self) -> &[CellState] {
        &self.states
    }

    /// The state of cell `cell` of the *grid*; unknown outside of the box.
    pub fn get(&self, cell: [u32; 3]) -> CellState {
        self.position(cell)
            .map_or(CellState::Unknown, |index| self.states[index])
    }

    /// Sets the state of cell `cell` of the *grid*; outside of the box it does nothing.
    pub fn set(&mut self, cell: [u32; 3], state: CellState) {
        if let Some(index) = self.position(cell) {
            self.states[index] = state;
        }
    }

    /// How many of its cells were observed.
    pub fn num_known(&self) -> usize {
        self.states.iter().filter(|state| state.is_known()).count()
    }

    fn position(&self, cell: [u32; 3]) -> Option<usize> {
        let mut steps = [0_usize; 3];
        for axis in 0..3 {
            let step = cell[axis].checked_sub(self.min[axis])?;
            if step >= self.dims[axis] {
                return None;
            }
            steps[axis] = step as usize;
        }
        let [w, h, _] = self.dims.map(|n| n as usize);
        Some(steps[0] + w * (steps[1] + h * steps[2]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_outside_is_in_no_cell() -> Result<()> {
        let spec = GridSpec::new_2d([-1.0, 2.0], 0.5, [4, 3])?;
        assert_eq!(spec.cell_at([-1.0, 2.0, 99.0]), Some([0, 0, 0]));
        assert_eq!(spec.cell_at([0.99, 3.49, 0.0]), Some([3, 2, 0]));
        for outside in [
            [-1.01, 2.0],
            [1.0, 2.0],
            [0.0, 1.99],
            [0.0, 3.5],
            [f64::NAN, 2.0],
        ] {
            assert_eq!(spec.cell_at([outside[0], outside[1], 0.0]), None);
        }
        assert_eq!(spec.cell_at([f64::INFINITY, 2.0, 0.0]), None);
        Ok(())
    }

    #[test]
    fn indices_and_centres_are_inverse() -> Result<()> {
        let spec = GridSpec::new_3d([1.0, -2.0, 0.5], 0.25, [5, 4, 3])?;
        for index in 0..spec.num_cells() {
            let cell = spec.cell(index);
            assert_eq!(spec.index(cell), index);
            assert_eq!(spec.cell_at(spec.center(cell)), Some(cell));
        }
        Ok(())
    }

    #[test]
    fn what_is_no_grid_is_refused() {
        assert!(GridSpec::new_2d([f64::NAN, 0.0], 0.1, [1, 1]).is_err());
        assert!(GridSpec::new_2d([0.0, 0.0], 0.0, [1, 1]).is_err());
        assert!(GridSpec::new_2d([0.0, 0.0], f64::NAN, [1, 1]).is_err());
        assert!(GridSpec::new_2d([0.0, 0.0], -0.1, [1, 1]).is_err());
        assert!(GridSpec::new_2d([0.0, 0.0], 0.1, [0, 1]).is_err());
        assert!(GridSpec::new_3d([0.0; 3], 0.1, [u32::MAX; 3]).is_err());
        assert!(GridSpec::new_2d([1e18, 0.0], 0.1, [1, 1]).is_err());
    }

    #[test]
    fn unknown_is_neither_free_nor_occupied() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 1.0, [2, 1])?;
        let mut map = OccupancyMap::new_unknown(spec);
        map.set(1, Some(0.7));
        assert_eq!(map.get(0), None);
        assert_eq!(map.state(0, Thresholds::default()), CellState::Unknown);
        assert_eq!(map.state(1, Thresholds::default()), CellState::Occupied);
        assert_eq!(map.state(1, Thresholds::new(0.2, 0.8)?), CellState::Unknown);
        assert!(Thresholds::new(0.8, 0.2).is_err());
        Ok(())
    }

    #[test]
    fn a_patch_is_indexed_by_cells_of_the_grid() -> Result<()> {
        let mut patch = Patch::new_unknown([2, 3, 0], [2, 2, 1])?;
        patch.set([3, 4, 0], CellState::Occupied);
        patch.set([1, 3, 0], CellState::Free);
        assert_eq!(patch.get([3, 4, 0]), CellState::Occupied);
        assert_eq!(patch.get([1, 3, 0]), CellState::Unknown);
        assert_eq!(patch.num_known(), 1);
        assert!(Patch::new([0; 3], [2, 2, 1], vec![CellState::Free; 3]).is_err());
        Ok(())
    }
}

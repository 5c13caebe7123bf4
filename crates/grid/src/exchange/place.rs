//! Where in a grid do the cells of another map lie?
//!
//! Programs that make maps choose an origin of their own for each. Maps of one resolution whose
//! origins differ by whole cells are one grid; all others are refused, because to resample a map is
//! to invent cells.

use fremen::{Error, ErrorKind, Result};

use super::map_server::MapServerMap;
use crate::cells::{GridSpec, OccupancyMap, Patch, Thresholds};

/// By how much of a cell maps may be off.
const MAX_OFFSET: f64 = 1e-3;

/// The smallest grid that holds all cells of these grids, all in 2-D or all in 3-D; its origin is that
/// of the first, moved by whole cells.
///
/// # Errors
/// [`ErrorKind::Config`] where there is none, [`ErrorKind::Shape`] where their cells do not
/// coincide.
pub fn common_spec<'a>(specs: impl IntoIterator<Item = &'a GridSpec>) -> Result<GridSpec> {
    let mut specs = specs.into_iter();
    let first = specs.next().ok_or_else(|| {
        Error::new(ErrorKind::Config, "no map to make a grid of").with_help("give at least one")
    })?;
    let mut from = [0; 3];
    let mut to = first.dims().map(i64::from);
    for spec in specs {
        let offset = offset_of(first, spec)?;
        let dims = spec.dims();
        for axis in 0..3 {
            from[axis] = from[axis].min(offset[axis]);
            to[axis] = to[axis].max(offset[axis] + i64::from(dims[axis]));
        }
    }
    let resolution_m = first.resolution_m();
    let origin_m: [f64; 3] =
        std::array::from_fn(|axis| first.origin_m()[axis] + from[axis] as f64 * resolution_m);
    let size = |axis: usize| u32::try_from(to[axis] - from[axis]).unwrap_or(u32::MAX);
    if first.is_2d() {
        let [x, y, _] = origin_m;
        return GridSpec::new_2d([x, y], resolution_m, [size(0), size(1)]);
    }
    GridSpec::new_3d(origin_m, resolution_m, std::array::from_fn(size))
}

/// The states of a map's cells as a patch of a grid.
///
/// # Errors
/// [`ErrorKind::Shape`] where the cells do not coincide with those of the grid, or known ones lie
/// outside of it.
pub fn patch_of(grid: &GridSpec, map: &MapServerMap, thresholds: Thresholds) -> Result<Patch> {
    patch_of_occupancy(grid, &map.to_map(), thresholds)
}

/// The states of a 2-D or 3-D map's cells as a patch of a grid.
///
/// # Errors
/// As [`patch_of`].
pub fn patch_of_occupancy(
    grid: &GridSpec,
    map: &OccupancyMap,
    thresholds: Thresholds,
) -> Result<Patch> {
    let offset = offset_of(grid, map.spec())?;
    let all = grid.dims().map(i64::from);
    let mut patch = Patch::new_whole(grid);
    for index in 0..map.spec().num_cells() {
        let state = map.state(index, thresholds);
        if !state.is_known() {
            continue;
        }
        let from = map.spec().cell(index);
        let cell: [i64; 3] = std::array::from_fn(|axis| offset[axis] + i64::from(from[axis]));
        if (0..3).any(|axis| cell[axis] < 0 || cell[axis] >= all[axis]) {
            let [w, h, d] = grid.dims();
            return Err(Error::new(
                ErrorKind::Shape,
                format!("the map has known cells outside of the grid of {w} x {h} x {d} cells"),
            )
            .with_help("cut the map, or build a grid of all maps together"));
        }
        patch.set(cell.map(|it| it as u32), state);
    }
    Ok(patch)
}

/// By how many cells the origin of `other` is above that of `grid`.
fn offset_of(grid: &GridSpec, other: &GridSpec) -> Result<[i64; 3]> {
    let (a, b) = (grid.resolution_m(), other.resolution_m());
    let largest = other.dims().into_iter().max().unwrap_or(1);
    if grid.is_2d() != other.is_2d() {
        let message = "2-D and 3-D maps have no common grid";
        return Err(Error::new(ErrorKind::Shape, message));
    }
    // The far edge may not be off, either.
    if (a - b).abs() * f64::from(largest) > MAX_OFFSET * a {
        return Err(Error::new(
            ErrorKind::Shape,
            format!("cells of {b} m, where the grid has cells of {a} m"),
        )
        .with_help("make all maps with one resolution"));
    }
    let mut offset = [0; 3];
    for (axis, offset) in offset.iter_mut().enumerate() {
        let cells = (other.origin_m()[axis] - grid.origin_m()[axis]) / a;
        if (cells - cells.round()).abs() > MAX_OFFSET || cells.abs() > 1e9 {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the origin {:?} m is {cells:.3} cells from that of the grid, not whole cells",
                    other.origin_m()
                ),
            )
            .with_help("make all maps on one raster: with origins that differ by whole cells"));
        }
        *offset = cells.round() as i64;
    }
    Ok(offset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells::CellState;

    #[test]
    fn solid_maps_share_a_grid_and_none_with_planar_ones() -> Result<()> {
        let a = GridSpec::new_3d([0.0, 0.0, 0.0], 0.5, [4, 4, 4])?;
        let b = GridSpec::new_3d([-1.0, 0.5, 1.0], 0.5, [2, 2, 8])?;
        let common = common_spec([&a, &b])?;
        assert_eq!((common.dims(), common.origin_m()[0]), ([6, 4, 10], -1.0));
        let mut map = OccupancyMap::new_unknown(b);
        map.set(b.index([1, 1, 7]), Some(1.0));
        let patch = patch_of_occupancy(&common, &map, Thresholds::default())?;
        assert_eq!(patch.num_known(), 1);
        assert_eq!(patch.get([1, 2, 9]), CellState::Occupied);
        assert!(patch_of_occupancy(&a, &map, Thresholds::default()).is_err());
        let planar = GridSpec::new_2d([0.0, 0.0], 0.5, [4, 4])?;
        assert!(common_spec([&a, &planar]).is_err());
        Ok(())
    }

    #[test]
    fn maps_on_one_raster_share_a_grid() -> Result<()> {
        let spec = |origin, resolution, size| GridSpec::new_2d(origin, resolution, size);
        let a = spec([0.0, 0.0], 0.05, [40, 20])?;
        let b = spec([-0.5, 0.25], 0.05, [20, 30])?;
        let common = common_spec([&a, &b])?;
        assert_eq!(common.dims(), [50, 35, 1]);
        let map = MapServerMap::new(b, vec![100; 600])?;
        let patch = patch_of(&common, &map, Thresholds::default())?;
        assert_eq!(patch.num_known(), 600);
        let centre = common.cell_at([-0.475, 0.275, 0.0]);
        assert_eq!(centre, Some([0, 5, 0]));
        assert_eq!(patch.get([0, 5, 0]), CellState::Occupied);
        assert_eq!(patch.get([0, 4, 0]), CellState::Unknown);
        assert!(patch_of(&a, &map, Thresholds::default()).is_err());
        assert!(common_spec([&a, &spec([0.01, 0.0], 0.05, [1, 1])?]).is_err());
        assert!(common_spec([&a, &spec([0.0, 0.0], 0.1, [1, 1])?]).is_err());
        assert!(common_spec([]).is_err());
        Ok(())
    }
}

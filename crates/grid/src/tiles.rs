//! Which cells share their observation times?
//!
//! A *tile* is a block of 16 x 16 cells, in 3-D of 8 x 8 x 8 voxels. Its cells are observed
//! together: what is kept once for a tile (when it was observed) costs its cells next to nothing,
//! and only tiles that were observed exist.

use crate::cells::GridSpec;

/// The most cells that a tile has.
pub(crate) const MAX_TILE_CELLS: usize = 512;

/// How a grid is divided into tiles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tiling {
    spec: GridSpec,
    /// Logarithms to base 2 of a tile's sides.
    shifts: [u32; 3],
    /// Tiles along each axis.
    counts: [u32; 3],
}

impl Tiling {
    pub(crate) fn new(spec: GridSpec) -> Self {
        let shifts = if spec.is_2d() { [4, 4, 0] } else { [3, 3, 3] };
        let mut counts = [0; 3];
        for axis in 0..3 {
            counts[axis] = spec.dims()[axis].div_ceil(1 << shifts[axis]);
        }
        Self {
            spec,
            shifts,
            counts,
        }
    }

    pub(crate) const fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// Tiles along each axis.
    pub(crate) const fn counts(&self) -> [u32; 3] {
        self.counts
    }

    /// How many tiles there can be.
    pub(crate) const fn num_tiles(&self) -> u32 {
        self.counts[0] * self.counts[1] * self.counts[2]
    }

    /// Cells along each axis of a tile.
    pub(crate) const fn sides(&self) -> [u32; 3] {
        [
            1 << self.shifts[0],
            1 << self.shifts[1],
            1 << self.shifts[2],
        ]
    }

    /// Cells of a tile, those beyond the border among them.
    pub(crate) const fn num_cells(&self) -> usize {
        1 << (self.shifts[0] + self.shifts[1] + self.shifts[2])
    }

    /// The key of the tile of a cell, and where in the tile the cell is.
    #[inline]
    pub(crate) const fn locate(&self, cell: [u32; 3]) -> (u32, usize) {
        let [a, b, c] = self.shifts;
        let tile = [cell[0] >> a, cell[1] >> b, cell[2] >> c];
        let [x, y, z] = [
            cell[0] & ((1 << a) - 1),
            cell[1] & ((1 << b) - 1),
            cell[2] & ((1 << c) - 1),
        ];
        (self.key(tile), (x | (y << a) | (z << (a + b))) as usize)
    }

    /// The key of tile `tile`, counted in tiles: x fastest, then y, then z.
    pub(crate) const fn key(&self, tile: [u32; 3]) -> u32 {
        tile[0] + self.counts[0] * (tile[1] + self.counts[1] * tile[2])
    }

    /// The lowest cell of a tile.
    pub(crate) const fn min(&self, key: u32) -> [u32; 3] {
        let [w, h, _] = self.counts;
        [
            (key % w) << self.shifts[0],
            (key / w % h) << self.shifts[1],
            (key / w / h) << self.shifts[2],
        ]
    }

    /// How many cells of a tile lie inside of the grid, along each axis.
    pub(crate) fn extent(&self, key: u32) -> [u32; 3] {
        let (min, sides, dims) = (self.min(key), self.sides(), self.spec.dims());
        std::array::from_fn(|axis| sides[axis].min(dims[axis] - min[axis]))
    }

    /// The cell of a grid at position `at` of a tile, which may lie beyond the border.
    pub(crate) const fn cell(&self, key: u32, at: usize) -> [u32; 3] {
        let [a, b, _] = self.shifts;
        let min = self.min(key);
        let at = at as u32;
        [
            min[0] + (at & ((1 << a) - 1)),
            min[1] + ((at >> a) & ((1 << b) - 1)),
            min[2] + (at >> (a + b)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_cell_has_one_place_in_one_tile() -> fremen::Result<()> {
        let planar = GridSpec::new_2d([0.0; 2], 1.0, [37, 20])?;
        let solid = GridSpec::new_3d([0.0; 3], 1.0, [9, 17, 8])?;
        for spec in [planar, solid] {
            let tiling = Tiling::new(spec);
            let mut seen = std::collections::BTreeSet::new();
            for index in 0..spec.num_cells() {
                let cell = spec.cell(index);
                let (key, at) = tiling.locate(cell);
                assert!(key < tiling.num_tiles() && at < tiling.num_cells());
                assert!(seen.insert((key, at)));
                assert_eq!(tiling.cell(key, at), cell);
                let (min, extent) = (tiling.min(key), tiling.extent(key));
                assert!((0..3).all(|i| cell[i] >= min[i] && cell[i] - min[i] < extent[i]));
            }
        }
        Ok(())
    }
}

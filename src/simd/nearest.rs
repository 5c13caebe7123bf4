//! Which two rows are nearest, and how do keys of 32 bits say so?

use super::packed::ROWS_PER_GROUP;

/// Position of the distance in a key; the bits below hold the row in its block.
pub(super) const DISTANCE_SHIFT: u32 = 23;
/// Greater than every key of a row.
pub(super) const NO_KEY: u32 = u32::MAX;

/// The smallest keys of 16 queries, and their second smallest.
pub(super) type LaneKeys = [[u32; ROWS_PER_GROUP]; 2];

/// The nearest and second nearest train row of one query.
///
/// Ordered by (distance, row), so ties are won by the lowest row. With fewer than two rows the
/// missing ids are [`NONE`](Self::NONE) and the missing distances
/// [`NO_DISTANCE_BITS`](Self::NO_DISTANCE_BITS), which is greater than every distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NearestTwo {
    /// The number of the nearest row.
    pub best: u32,
    /// The second nearest row.
    pub second: u32,
    /// Distance of the nearest row, 0 to 256.
    pub best_bits: u16,
    /// Distance of the second nearest row, 0 to 256, never below `best_bits`.
    pub second_bits: u16,
}

impl NearestTwo {
    /// The id that stands for no row.
    pub const NONE: u32 = u32::MAX;
    /// The distance to no row; greater than every distance.
    pub const NO_DISTANCE_BITS: u16 = u16::MAX;
    /// The answer where there is no row.
    pub const EMPTY: Self = Self {
        best: Self::NONE,
        second: Self::NONE,
        best_bits: Self::NO_DISTANCE_BITS,
        second_bits: Self::NO_DISTANCE_BITS,
    };

    /// Whether there is a nearest row.
    #[inline]
    pub fn has_best(&self) -> bool {
        self.best != Self::NONE
    }

    /// Whether there is a second nearest row.
    #[inline]
    pub fn has_second(&self) -> bool {
        self.second != Self::NONE
    }

    /// Takes in `row` at `bits`, which must have a higher number than every row before.
    #[inline]
    pub(super) fn integrate(&mut self, row: u32, bits: u16) {
        if bits < self.best_bits {
            self.second = self.best;
            self.second_bits = self.best_bits;
            self.best = row;
            self.best_bits = bits;
        } else if bits < self.second_bits {
            self.second = row;
            self.second_bits = bits;
        }
    }

    /// Takes in the two smallest keys of a block whose row 0 is `base`.
    #[inline]
    pub(super) fn integrate_keys(&mut self, keys: [u32; 2], base: u32) {
        for key in keys {
            if key != NO_KEY {
                let row = key & ((1 << DISTANCE_SHIFT) - 1);
                self.integrate(base + row, (key >> DISTANCE_SHIFT) as u16);
            }
        }
    }
}

impl Default for NearestTwo {
    fn default() -> Self {
        Self::EMPTY
    }
}

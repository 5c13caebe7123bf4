//! How do descriptors lie in memory for a kernel?
//!
//! Row `r` is in group `r / 16`; within a group, word `w` of row `2 * i + j` (of 16) is at
//! `16 * w + 8 * j + i`. A vector of 64-bit lanes then holds one word of the even (`j = 0`) or odd
//! (`j = 1`) rows, and the distances of both, the odd ones shifted to the upper halves, are 32-bit
//! lanes in row order.

use super::bits256::Bits256;

/// Rows in a group.
pub(super) const ROWS_PER_GROUP: usize = 16;

/// 16 rows of 256 bits, interleaved; 512 bytes on cache lines of their own.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(C, align(64))]
pub(super) struct Group(pub(super) [u64; 4 * ROWS_PER_GROUP]);

impl Group {
    /// 16 rows of zeros.
    pub(super) const ZERO: Self = Self([0; 4 * ROWS_PER_GROUP]);

    #[inline]
    fn position(row: usize, word: usize) -> usize {
        16 * word + 8 * (row % 2) + row / 2
    }

    #[inline]
    pub(super) fn row(&self, row: usize) -> [u64; 4] {
        std::array::from_fn(|word| self.0[Self::position(row, word)])
    }

    #[inline]
    fn set_row(&mut self, row: usize, words: [u64; 4]) {
        for (word, bits) in words.into_iter().enumerate() {
            self.0[Self::position(row, word)] = bits;
        }
    }
}

/// Interleaves `rows` into the first groups and says how many; `groups` must be large enough.
///
/// Rows of the last group that are not overwritten keep what they were: kernels never count them.
#[inline]
pub(super) fn pack<D: Bits256>(rows: &[D], groups: &mut [Group]) -> usize {
    let filled = rows.len().div_ceil(ROWS_PER_GROUP);
    for (group, rows) in groups[..filled].iter_mut().zip(rows.chunks(ROWS_PER_GROUP)) {
        for (row, descriptor) in rows.iter().enumerate() {
            group.set_row(row, descriptor.words());
        }
    }
    filled
}

/// Train rows interleaved for the kernels: built once, searched many times.
///
/// Takes 32 bytes a row, rounded up to 16 rows. [`repack`](Self::repack) reuses the memory.
#[derive(Clone, Default)]
pub struct PackedDescriptors {
    groups: Vec<Group>,
    len: usize,
}

impl PackedDescriptors {
    /// A set without rows.
    pub const fn new() -> Self {
        Self {
            groups: Vec::new(),
            len: 0,
        }
    }

    /// Packs `rows`, in this order.
    ///
    /// # Panics
    /// If there are more than `u32::MAX` rows.
    pub fn pack<D: Bits256>(rows: &[D]) -> Self {
        let mut packed = Self::new();
        packed.repack(rows);
        packed
    }

    /// Replaces the content by `rows`; allocates only if they are more than ever before.
    ///
    /// # Panics
    /// If there are more than `u32::MAX` rows.
    pub fn repack<D: Bits256>(&mut self, rows: &[D]) {
        assert!(
            u32::try_from(rows.len()).is_ok(),
            "a train set has at most u32::MAX rows"
        );
        self.groups
            .resize(rows.len().div_ceil(ROWS_PER_GROUP), Group::ZERO);
        pack(rows, &mut self.groups);
        self.len = rows.len();
    }

    /// Appends one row.
    ///
    /// # Panics
    /// If there are `u32::MAX` rows already.
    pub fn push<D: Bits256>(&mut self, row: &D) {
        assert!(
            self.len < u32::MAX as usize,
            "a train set has at most u32::MAX rows"
        );
        if self.len == self.groups.len() * ROWS_PER_GROUP {
            self.groups.push(Group::ZERO);
        }
        self.groups[self.len / ROWS_PER_GROUP].set_row(self.len % ROWS_PER_GROUP, row.words());
        self.len += 1;
    }

    /// Removes all rows and keeps the memory.
    pub fn clear(&mut self) {
        self.groups.clear();
        self.len = 0;
    }

    /// How many rows there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The words of row `id`.
    ///
    /// # Panics
    /// If `id` is not below [`len`](Self::len).
    pub fn row(&self, id: usize) -> [u64; 4] {
        assert!(id < self.len, "row {id} of {}", self.len);
        self.groups[id / ROWS_PER_GROUP].row(id % ROWS_PER_GROUP)
    }

    pub(super) fn groups(&self) -> &[Group] {
        &self.groups
    }
}

impl std::fmt::Debug for PackedDescriptors {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PackedDescriptors({} rows)", self.len)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unpacking_gives_back_what_was_packed_or_pushed() {
        let rows: Vec<[u64; 4]> = (0..37_u64).map(|r| [r, r + 100, r << 40, !r]).collect();
        let mut packed = PackedDescriptors::pack(&rows);
        let mut pushed = PackedDescriptors::new();
        for row in &rows {
            pushed.push(row);
        }
        for (id, &row) in rows.iter().enumerate() {
            assert_eq!(packed.row(id), row);
            assert_eq!(pushed.row(id), row);
        }
        packed.repack(&rows[30..]);
        assert_eq!(packed.len(), 7);
        assert_eq!(packed.row(6), rows[36]);
        packed.clear();
        assert!(packed.is_empty());
    }
}

//! How does NEON count? Byte counts of two rows per vector, four rows per key vector.
//!
//! Not verified: this kernel has been neither compiled nor run yet.

use std::arch::aarch64::{
    uint32x4_t, uint64x2_t, vaddq_u8, vaddq_u64, vaddvq_u64, vcntq_u8, vdupq_n_u8, vdupq_n_u32,
    vdupq_n_u64, veorq_u64, vld1q_u32, vld1q_u64, vmaxq_u32, vminq_u32, vorrq_u32, vorrq_u64,
    vpaddlq_u8, vpaddlq_u16, vpaddlq_u32, vreinterpretq_u8_u64, vreinterpretq_u32_u64, vshlq_n_u64,
    vst1q_u32,
};
use std::ops::Range;

use super::nearest::{DISTANCE_SHIFT, LaneKeys, NO_KEY};
use super::packed::{Group, ROWS_PER_GROUP};

/// Rows of a group whose 32-bit keys fill a vector.
const ROWS_PER_QUARTER: usize = 4;

/// The two smallest keys of `rows`, counted from `groups[0]`, for each query.
#[target_feature(enable = "neon")]
pub(super) fn two_smallest_keys(
    queries: &[[u64; 4]],
    groups: &[Group],
    rows: Range<u32>,
    keys: &mut [[u32; 2]],
) {
    for (query, keys) in queries.iter().zip(keys) {
        *keys = pass(query, groups, &rows);
    }
}

#[target_feature(enable = "neon")]
#[inline]
fn pass(query: &[u64; 4], groups: &[Group], rows: &Range<u32>) -> [u32; 2] {
    let query = spread(query);
    let mut best = vdupq_n_u32(NO_KEY);
    let mut second = best;
    let first_group = rows.start as usize / ROWS_PER_GROUP;
    let group_end = (rows.end as usize).div_ceil(ROWS_PER_GROUP);
    for (index, group) in groups[..group_end].iter().enumerate().skip(first_group) {
        for quarter in 0..4 {
            let first_row = (index * ROWS_PER_GROUP + quarter * ROWS_PER_QUARTER) as u32;
            let row = row_numbers(first_row, rows);
            let key = keys_of_quarter(&query, group, quarter, row);
            second = vminq_u32(second, vmaxq_u32(best, key));
            best = vminq_u32(best, key);
        }
    }
    let mut smallest = [NO_KEY; 2];
    for (best, second) in lanes(best).into_iter().zip(lanes(second)) {
        smallest[1] = smallest[1].min(smallest[0].max(best)).min(second);
        smallest[0] = smallest[0].min(best);
    }
    smallest
}

/// Four numbers from `first_row` on; all ones where they lie outside `rows`, which makes the key of
/// such a row `NO_KEY`.
#[target_feature(enable = "neon")]
#[inline]
fn row_numbers(first_row: u32, rows: &Range<u32>) -> uint32x4_t {
    let mut numbers: [u32; ROWS_PER_QUARTER] =
        [first_row, first_row + 1, first_row + 2, first_row + 3];
    if first_row < rows.start || first_row + ROWS_PER_QUARTER as u32 > rows.end {
        for number in &mut numbers {
            if !rows.contains(number) {
                *number = NO_KEY;
            }
        }
    }
    // SAFETY: `numbers` are 16 readable bytes.
    unsafe { vld1q_u32(numbers.as_ptr()) }
}

#[target_feature(enable = "neon")]
#[inline]
fn lanes(vector: uint32x4_t) -> [u32; ROWS_PER_QUARTER] {
    let mut lanes = [0; ROWS_PER_QUARTER];
    // SAFETY: `lanes` are 16 writable bytes.
    unsafe { vst1q_u32(lanes.as_mut_ptr(), vector) };
    lanes
}

#[target_feature(enable = "neon")]
#[inline]
fn spread(query: &[u64; 4]) -> [uint64x2_t; 4] {
    [
        vdupq_n_u64(query[0]),
        vdupq_n_u64(query[1]),
        vdupq_n_u64(query[2]),
        vdupq_n_u64(query[3]),
    ]
}

/// Distances to the even and to the odd rows of a quarter of a group, in 64-bit lanes.
#[target_feature(enable = "neon")]
#[inline]
fn distances_of_quarter(
    query: &[uint64x2_t; 4],
    group: &Group,
    quarter: usize,
) -> (uint64x2_t, uint64x2_t) {
    let words = group.0.as_chunks::<2>().0;
    let mut sums = [vdupq_n_u64(0); 2];
    for (parity, sum) in sums.iter_mut().enumerate() {
        let mut counts = vdupq_n_u8(0);
        for (word, &query) in query.iter().enumerate() {
            let words = &words[8 * word + 4 * parity + quarter];
            // SAFETY: `words` are 16 readable bytes.
            let words = unsafe { vld1q_u64(words.as_ptr()) };
            let bits = vreinterpretq_u8_u64(veorq_u64(words, query));
            counts = vaddq_u8(counts, vcntq_u8(bits));
        }
        *sum = vpaddlq_u32(vpaddlq_u16(vpaddlq_u8(counts)));
    }
    (sums[0], sums[1])
}

/// The keys of a quarter of a group, whose rows have the numbers `row`.
#[target_feature(enable = "neon")]
#[inline]
fn keys_of_quarter(
    query: &[uint64x2_t; 4],
    group: &Group,
    quarter: usize,
    row: uint32x4_t,
) -> uint32x4_t {
    let (even, odd) = distances_of_quarter(query, group, quarter);
    let distances = vorrq_u64(
        vshlq_n_u64::<{ DISTANCE_SHIFT.cast_signed() }>(even),
        vshlq_n_u64::<{ DISTANCE_SHIFT.cast_signed() + 32 }>(odd),
    );
    vorrq_u32(vreinterpretq_u32_u64(distances), row)
}

/// The two smallest keys of `rows` for each of the 16 queries of a group.
#[target_feature(enable = "neon")]
pub(super) fn smallest_keys_of_lanes(group: &Group, rows: &[[u64; 4]]) -> LaneKeys {
    let mut keys = LaneKeys::default();
    for quarter in 0..4 {
        let mut best = vdupq_n_u32(NO_KEY);
        let mut second = best;
        for (row, words) in (0..).zip(rows) {
            let key = keys_of_quarter(&spread(words), group, quarter, vdupq_n_u32(row));
            second = vminq_u32(second, vmaxq_u32(best, key));
            best = vminq_u32(best, key);
        }
        for (keys, smallest) in keys.iter_mut().zip([best, second]) {
            let at = quarter * ROWS_PER_QUARTER;
            keys[at..at + ROWS_PER_QUARTER].copy_from_slice(&lanes(smallest));
        }
    }
    keys
}

/// The distance of `query` to the first `out.len()` rows.
#[target_feature(enable = "neon")]
pub(super) fn distances(query: &[u64; 4], groups: &[Group], out: &mut [u16]) {
    let query = spread(query);
    for (group, out) in groups.iter().zip(out.chunks_mut(ROWS_PER_GROUP)) {
        for (quarter, out) in out.chunks_mut(ROWS_PER_QUARTER).enumerate() {
            let (even, odd) = distances_of_quarter(&query, group, quarter);
            let both = vorrq_u64(even, vshlq_n_u64::<32>(odd));
            for (out, distance) in out.iter_mut().zip(lanes(vreinterpretq_u32_u64(both))) {
                *out = distance as u16;
            }
        }
    }
}

/// The sum of the distances of all `queries` to all rows.
#[target_feature(enable = "neon")]
pub(super) fn sum_of_distances(queries: &[[u64; 4]], groups: &[Group]) -> u64 {
    let mut total = 0;
    for query in queries {
        let query = spread(query);
        let mut sum = vdupq_n_u64(0);
        for group in groups {
            for quarter in 0..4 {
                let (even, odd) = distances_of_quarter(&query, group, quarter);
                sum = vaddq_u64(sum, vaddq_u64(even, odd));
            }
        }
        total += vaddvq_u64(sum);
    }
    total
}

//! What is the right answer? The plain twin that every other kernel must equal bit for bit.

use std::ops::Range;

use super::nearest::{DISTANCE_SHIFT, LaneKeys, NO_KEY};
use super::packed::{Group, ROWS_PER_GROUP};

#[inline]
fn distance_bits(a: &[u64; 4], b: &[u64; 4]) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

/// The two smallest keys of `rows`, counted from `groups[0]`, for each query.
pub(super) fn two_smallest_keys(
    queries: &[[u64; 4]],
    groups: &[Group],
    rows: Range<u32>,
    keys: &mut [[u32; 2]],
) {
    keys.fill([NO_KEY; 2]);
    for row in rows {
        let words = groups[row as usize / ROWS_PER_GROUP].row(row as usize % ROWS_PER_GROUP);
        for (query, [best, second]) in queries.iter().zip(keys.iter_mut()) {
            let key = (distance_bits(query, &words) << DISTANCE_SHIFT) | row;
            *second = (*second).min((*best).max(key));
            *best = (*best).min(key);
        }
    }
}

/// The two smallest keys of `rows` for each of the 16 queries of a group.
pub(super) fn smallest_keys_of_lanes(group: &Group, rows: &[[u64; 4]]) -> LaneKeys {
    let [mut all_best, mut all_second] = [[NO_KEY; ROWS_PER_GROUP]; 2];
    for (lane, (best, second)) in all_best.iter_mut().zip(&mut all_second).enumerate() {
        let query = group.row(lane);
        for (row, words) in (0..).zip(rows) {
            let key = (distance_bits(&query, words) << DISTANCE_SHIFT) | row;
            *second = (*second).min((*best).max(key));
            *best = (*best).min(key);
        }
    }
    [all_best, all_second]
}

/// The distance of `query` to the first `out.len()` rows.
pub(super) fn distances(query: &[u64; 4], groups: &[Group], out: &mut [u16]) {
    for (group, out) in groups.iter().zip(out.chunks_mut(ROWS_PER_GROUP)) {
        for (row, out) in out.iter_mut().enumerate() {
            *out = distance_bits(query, &group.row(row)) as u16;
        }
    }
}

/// The sum of the distances of all `queries` to all rows.
pub(super) fn sum_of_distances(queries: &[[u64; 4]], groups: &[Group]) -> u64 {
    let mut sum = 0;
    for group in groups {
        for row in 0..ROWS_PER_GROUP {
            let words = group.row(row);
            let distances = queries.iter().map(|query| distance_bits(query, &words));
            sum += distances.map(u64::from).sum::<u64>();
        }
    }
    sum
}

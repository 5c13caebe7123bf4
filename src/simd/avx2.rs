//! How does AVX2 count? By looking up both nibbles of every byte, eight rows at once.
//!
//! The lookup is the one of Muła, Kurz and Lemire (2018); byte counts of the four words of a row
//! are added (at most 32) before one horizontal sum.

use std::arch::x86_64::{
    __m256i, _mm256_add_epi8, _mm256_add_epi32, _mm256_add_epi64, _mm256_and_si256,
    _mm256_andnot_si256, _mm256_cmpgt_epi32, _mm256_load_si256, _mm256_max_epu32, _mm256_min_epu32,
    _mm256_or_si256, _mm256_sad_epu8, _mm256_set_epi32, _mm256_set1_epi8, _mm256_set1_epi32,
    _mm256_set1_epi64x, _mm256_setr_epi8, _mm256_setzero_si256, _mm256_shuffle_epi8,
    _mm256_slli_epi64, _mm256_srli_epi16, _mm256_storeu_si256, _mm256_xor_si256,
};
use std::ops::Range;

use super::nearest::{DISTANCE_SHIFT, LaneKeys, NO_KEY};
use super::packed::{Group, ROWS_PER_GROUP};

/// Queries whose state stays in registers while a group of rows is read once.
const QUERIES_PER_PASS: usize = 2;
/// Rows of a group whose 32-bit keys fill a vector.
const ROWS_PER_HALF: usize = 8;

/// A query's words, each in every lane.
type Spread = [__m256i; 4];

/// The two smallest keys of `rows`, counted from `groups[0]`, for each query.
#[target_feature(enable = "avx2")]
pub(super) fn two_smallest_keys(
    queries: &[[u64; 4]],
    groups: &[Group],
    rows: Range<u32>,
    keys: &mut [[u32; 2]],
) {
    let (passes, rest) = queries.as_chunks::<QUERIES_PER_PASS>();
    let (keys_of_passes, keys_of_rest) = keys.as_chunks_mut::<QUERIES_PER_PASS>();
    for (queries, keys) in passes.iter().zip(keys_of_passes) {
        pass(queries, groups, &rows, keys);
    }
    for (query, keys) in rest.iter().zip(keys_of_rest) {
        pass(
            std::array::from_ref(query),
            groups,
            &rows,
            std::array::from_mut(keys),
        );
    }
}

#[target_feature(enable = "avx2")]
#[inline]
fn pass<const N: usize>(
    queries: &[[u64; 4]; N],
    groups: &[Group],
    rows: &Range<u32>,
    keys: &mut [[u32; 2]; N],
) {
    let no_key = _mm256_set1_epi32(NO_KEY.cast_signed());
    let mut queries_spread = [[no_key; 4]; N];
    for (spread, query) in queries_spread.iter_mut().zip(queries) {
        *spread = self::spread(query);
    }
    let mut best = [no_key; N];
    let mut second = [no_key; N];
    let before = _mm256_set1_epi32(rows.start.cast_signed());
    let end = _mm256_set1_epi32(rows.end.cast_signed());
    let first_group = rows.start as usize / ROWS_PER_GROUP;
    let group_end = (rows.end as usize).div_ceil(ROWS_PER_GROUP);
    for (index, group) in groups[..group_end].iter().enumerate().skip(first_group) {
        for half in 0..2 {
            let first_row = (index * ROWS_PER_GROUP + half * ROWS_PER_HALF) as u32;
            let mut row = _mm256_add_epi32(
                _mm256_set_epi32(7, 6, 5, 4, 3, 2, 1, 0),
                _mm256_set1_epi32(first_row.cast_signed()),
            );
            if first_row < rows.start || first_row + ROWS_PER_HALF as u32 > rows.end {
                // All ones, once merged into a key, make the key of a row outside the range
                // `NO_KEY`.
                let below = _mm256_cmpgt_epi32(before, row);
                let inside = _mm256_andnot_si256(below, _mm256_cmpgt_epi32(end, row));
                row = _mm256_or_si256(row, _mm256_andnot_si256(inside, no_key));
            }
            for n in 0..N {
                let key = keys_of_half(&queries_spread[n], group, half, row);
                second[n] = _mm256_min_epu32(second[n], _mm256_max_epu32(best[n], key));
                best[n] = _mm256_min_epu32(best[n], key);
            }
        }
    }
    for n in 0..N {
        keys[n] = two_smallest(lanes(best[n]), lanes(second[n]));
    }
}

#[target_feature(enable = "avx2")]
#[inline]
fn lanes(vector: __m256i) -> [u32; ROWS_PER_HALF] {
    let mut lanes = [0; ROWS_PER_HALF];
    // SAFETY: `lanes` are 32 writable bytes, and this store needs no alignment.
    unsafe { _mm256_storeu_si256(lanes.as_mut_ptr().cast(), vector) };
    lanes
}

/// The two smallest of all lanes, where no `second` is below the `best` of its lane.
fn two_smallest(best: [u32; ROWS_PER_HALF], second: [u32; ROWS_PER_HALF]) -> [u32; 2] {
    let mut smallest = [NO_KEY; 2];
    for (best, second) in best.into_iter().zip(second) {
        smallest[1] = smallest[1].min(smallest[0].max(best)).min(second);
        smallest[0] = smallest[0].min(best);
    }
    smallest
}

#[target_feature(enable = "avx2")]
#[inline]
fn spread(query: &[u64; 4]) -> Spread {
    let mut spread = [_mm256_setzero_si256(); 4];
    for (lanes, word) in spread.iter_mut().zip(query) {
        *lanes = _mm256_set1_epi64x(word.cast_signed());
    }
    spread
}

/// Distances to the even and to the odd rows of half a group, in 64-bit lanes.
#[target_feature(enable = "avx2")]
#[inline]
fn distances_of_half(query: &Spread, group: &Group, half: usize) -> (__m256i, __m256i) {
    let words = group.0.as_chunks::<4>().0;
    let mut sums = [_mm256_setzero_si256(); 2];
    for (parity, sum) in sums.iter_mut().enumerate() {
        let mut counts = _mm256_setzero_si256();
        for (word, &query) in query.iter().enumerate() {
            let words = &words[4 * word + 2 * parity + half];
            // SAFETY: `words` are 32 readable bytes, on a multiple of 32 because `Group` is aligned
            // so.
            let words = unsafe { _mm256_load_si256(words.as_ptr().cast()) };
            counts = _mm256_add_epi8(counts, byte_counts(_mm256_xor_si256(words, query)));
        }
        *sum = _mm256_sad_epu8(counts, _mm256_setzero_si256());
    }
    (sums[0], sums[1])
}

/// The number of ones of every byte.
#[target_feature(enable = "avx2")]
#[inline]
fn byte_counts(bits: __m256i) -> __m256i {
    let ones_of_nibble = _mm256_setr_epi8(
        0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4, 0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3,
        3, 4,
    );
    let low = _mm256_set1_epi8(0x0F);
    let low_nibbles = _mm256_and_si256(bits, low);
    let high_nibbles = _mm256_and_si256(_mm256_srli_epi16::<4>(bits), low);
    _mm256_add_epi8(
        _mm256_shuffle_epi8(ones_of_nibble, low_nibbles),
        _mm256_shuffle_epi8(ones_of_nibble, high_nibbles),
    )
}

/// The keys of half a group, whose rows have the numbers `row`.
#[target_feature(enable = "avx2")]
#[inline]
fn keys_of_half(query: &Spread, group: &Group, half: usize, row: __m256i) -> __m256i {
    let (even, odd) = distances_of_half(query, group, half);
    let distances = _mm256_or_si256(
        _mm256_slli_epi64::<{ DISTANCE_SHIFT.cast_signed() }>(even),
        _mm256_slli_epi64::<{ DISTANCE_SHIFT.cast_signed() + 32 }>(odd),
    );
    _mm256_or_si256(distances, row)
}

/// The two smallest keys of `rows` for each of the 16 queries of a group.
#[target_feature(enable = "avx2")]
pub(super) fn smallest_keys_of_lanes(group: &Group, rows: &[[u64; 4]]) -> LaneKeys {
    let mut keys = LaneKeys::default();
    for half in 0..2 {
        let mut best = _mm256_set1_epi32(NO_KEY.cast_signed());
        let mut second = best;
        for (row, words) in (0..).zip(rows) {
            let key = keys_of_half(&spread(words), group, half, _mm256_set1_epi32(row));
            second = _mm256_min_epu32(second, _mm256_max_epu32(best, key));
            best = _mm256_min_epu32(best, key);
        }
        for (keys, smallest) in keys.iter_mut().zip([best, second]) {
            let at = half * ROWS_PER_HALF;
            keys[at..at + ROWS_PER_HALF].copy_from_slice(&lanes(smallest));
        }
    }
    keys
}

/// The distance of `query` to the first `out.len()` rows.
#[target_feature(enable = "avx2")]
pub(super) fn distances(query: &[u64; 4], groups: &[Group], out: &mut [u16]) {
    let query = spread(query);
    for (group, out) in groups.iter().zip(out.chunks_mut(ROWS_PER_GROUP)) {
        for (half, out) in out.chunks_mut(ROWS_PER_HALF).enumerate() {
            let (even, odd) = distances_of_half(&query, group, half);
            let both = lanes(_mm256_or_si256(even, _mm256_slli_epi64::<32>(odd)));
            for (out, distance) in out.iter_mut().zip(both) {
                *out = distance as u16;
            }
        }
    }
}

/// The sum of the distances of all `queries` to all rows.
#[target_feature(enable = "avx2")]
pub(super) fn sum_of_distances(queries: &[[u64; 4]], groups: &[Group]) -> u64 {
    let (passes, rest) = queries.as_chunks::<QUERIES_PER_PASS>();
    let passes = passes.iter().map(|queries| sum_of_pass(queries, groups));
    let rest = rest
        .iter()
        .map(|query| sum_of_pass(std::array::from_ref(query), groups));
    passes.chain(rest).sum()
}

#[target_feature(enable = "avx2")]
#[inline]
fn sum_of_pass<const N: usize>(queries: &[[u64; 4]; N], groups: &[Group]) -> u64 {
    let mut spreads = [[_mm256_setzero_si256(); 4]; N];
    for (spread, query) in spreads.iter_mut().zip(queries) {
        *spread = self::spread(query);
    }
    let mut sums = [_mm256_setzero_si256(); N];
    for group in groups {
        for half in 0..2 {
            for n in 0..N {
                let (even, odd) = distances_of_half(&spreads[n], group, half);
                sums[n] = _mm256_add_epi64(sums[n], _mm256_add_epi64(even, odd));
            }
        }
    }
    let mut total = 0;
    for sum in sums {
        let [a, b, c, d, e, f, g, h] = lanes(sum).map(u64::from);
        // Lanes of 64 bits, low halves first.
        total += a + c + e + g + ((b + d + f + h) << 32);
    }
    total
}

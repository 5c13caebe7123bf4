//! How does AVX-512 with VPOPCNTDQ count? Sixteen rows at once, several queries per pass.

use std::arch::x86_64::{
    __m256i, __m512i, _mm256_storeu_si256, _mm512_add_epi32, _mm512_add_epi64,
    _mm512_cmpeq_epu32_mask, _mm512_cmpge_epu32_mask, _mm512_cmplt_epu32_mask,
    _mm512_cvtepi32_epi16, _mm512_load_si512, _mm512_mask_mov_epi32, _mm512_max_epu32,
    _mm512_min_epu32, _mm512_or_si512, _mm512_popcnt_epi64, _mm512_reduce_add_epi64,
    _mm512_reduce_min_epu32, _mm512_set_epi32, _mm512_set1_epi32, _mm512_set1_epi64,
    _mm512_setzero_si512, _mm512_slli_epi64, _mm512_storeu_si512, _mm512_ternarylogic_epi64,
    _mm512_xor_si512,
};
use std::ops::Range;

use super::packed::{Group, ROWS_PER_GROUP};
use super::{DISTANCE_SHIFT, LaneKeys, NO_KEY};

/// Queries whose state stays in registers while a group of rows is read once.
const QUERIES_PER_PASS: usize = 4;

/// A query's words, each in every lane.
type Spread = [__m512i; 4];

/// The two smallest keys of `rows`, counted from `groups[0]`, for each query.
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
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

#[target_feature(enable = "avx512f,avx512vpopcntdq")]
#[inline]
fn pass<const N: usize>(
    queries: &[[u64; 4]; N],
    groups: &[Group],
    rows: &Range<u32>,
    keys: &mut [[u32; 2]; N],
) {
    let no_key = _mm512_set1_epi32(NO_KEY.cast_signed());
    let mut spreads = [[no_key; 4]; N];
    for (spread, query) in spreads.iter_mut().zip(queries) {
        *spread = self::spread(query);
    }
    let mut best = [no_key; N];
    let mut second = [no_key; N];
    let first = rows.start as usize / ROWS_PER_GROUP;
    let last = (rows.end as usize).div_ceil(ROWS_PER_GROUP);
    let first_whole = (rows.start as usize).div_ceil(ROWS_PER_GROUP);
    let last_whole = rows.end as usize / ROWS_PER_GROUP;
    // Where all rows lie within one group, there is no whole one and the border is that group.
    let border = first_whole.min(last);
    for index in (first..border).chain(border.max(last_whole)..last) {
        let row = numbers_inside(index, rows);
        step(&spreads, &groups[index], row, &mut best, &mut second);
    }
    if border < last_whole {
        let mut row = row_numbers(border);
        for group in &groups[border..last_whole] {
            step(&spreads, group, row, &mut best, &mut second);
            row = _mm512_add_epi32(row, _mm512_set1_epi32(ROWS_PER_GROUP as i32));
        }
    }
    for n in 0..N {
        // Keys differ in their rows, so exactly one lane holds the best; there its second competes.
        let smallest = _mm512_reduce_min_epu32(best[n]);
        let lane = _mm512_cmpeq_epu32_mask(best[n], _mm512_set1_epi32(smallest.cast_signed()));
        let others = _mm512_mask_mov_epi32(best[n], lane, no_key);
        keys[n] = [
            smallest,
            _mm512_reduce_min_epu32(_mm512_min_epu32(others, second[n])),
        ];
    }
}

/// Takes the rows of one group into the two smallest keys of each lane and query.
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
#[inline]
fn step<const N: usize>(
    spreads: &[Spread; N],
    group: &Group,
    row: __m512i,
    best: &mut [__m512i; N],
    second: &mut [__m512i; N],
) {
    for n in 0..N {
        let (even, odd) = distances_of_group(&spreads[n], group);
        let key = _mm512_ternarylogic_epi64::<0xFE>(
            _mm512_slli_epi64::<DISTANCE_SHIFT>(even),
            _mm512_slli_epi64::<{ DISTANCE_SHIFT + 32 }>(odd),
            row,
        );
        second[n] = _mm512_min_epu32(second[n], _mm512_max_epu32(best[n], key));
        best[n] = _mm512_min_epu32(best[n], key);
    }
}

/// The numbers of the rows of a group, lane by lane.
#[target_feature(enable = "avx512f")]
#[inline]
fn row_numbers(index: usize) -> __m512i {
    _mm512_add_epi32(
        _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0),
        _mm512_set1_epi32((index * ROWS_PER_GROUP) as i32),
    )
}

/// As [`row_numbers`], but all ones for rows outside `rows`, which makes their key `NO_KEY`.
#[target_feature(enable = "avx512f")]
#[inline]
fn numbers_inside(index: usize, rows: &Range<u32>) -> __m512i {
    let row = row_numbers(index);
    let start = _mm512_set1_epi32(rows.start.cast_signed());
    let end = _mm512_set1_epi32(rows.end.cast_signed());
    let inside = _mm512_cmpge_epu32_mask(row, start) & _mm512_cmplt_epu32_mask(row, end);
    _mm512_mask_mov_epi32(_mm512_set1_epi32(NO_KEY.cast_signed()), inside, row)
}

#[target_feature(enable = "avx512f")]
#[inline]
fn spread(query: &[u64; 4]) -> Spread {
    let mut spread = [_mm512_setzero_si512(); 4];
    for (lanes, word) in spread.iter_mut().zip(query) {
        *lanes = _mm512_set1_epi64(word.cast_signed());
    }
    spread
}

/// Distances to the even and to the odd rows of a group, in 64-bit lanes.
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
#[inline]
fn distances_of_group(query: &Spread, group: &Group) -> (__m512i, __m512i) {
    let words = group.0.as_chunks::<8>().0;
    let mut counts = [_mm512_setzero_si512(); 8];
    for ((counts, words), half) in counts.iter_mut().zip(words).zip(0..) {
        // SAFETY: `words` are 64 readable bytes, on a multiple of 64 because `Group` is aligned so.
        let words = unsafe { _mm512_load_si512(words.as_ptr().cast()) };
        *counts = _mm512_popcnt_epi64(_mm512_xor_si512(words, query[half / 2]));
    }
    (
        _mm512_add_epi64(
            _mm512_add_epi64(counts[0], counts[2]),
            _mm512_add_epi64(counts[4], counts[6]),
        ),
        _mm512_add_epi64(
            _mm512_add_epi64(counts[1], counts[3]),
            _mm512_add_epi64(counts[5], counts[7]),
        ),
    )
}

/// The two smallest keys of `rows` for each of the 16 queries of a group.
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
pub(super) fn smallest_keys_of_lanes(group: &Group, rows: &[[u64; 4]]) -> LaneKeys {
    let mut best = [_mm512_set1_epi32(NO_KEY.cast_signed())];
    let mut second = best;
    for (row, words) in (0..).zip(rows) {
        let row = _mm512_set1_epi32(row);
        step(&[spread(words)], group, row, &mut best, &mut second);
    }
    let mut keys = LaneKeys::default();
    for (keys, lanes) in keys.iter_mut().zip([best, second]) {
        // SAFETY: `keys` are 64 writable bytes, and this store needs no alignment.
        unsafe { _mm512_storeu_si512(keys.as_mut_ptr().cast(), lanes[0]) };
    }
    keys
}

/// The distance of `query` to the first `out.len()` rows.
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
pub(super) fn distances(query: &[u64; 4], groups: &[Group], out: &mut [u16]) {
    let query = spread(query);
    for (group, out) in groups.iter().zip(out.chunks_mut(ROWS_PER_GROUP)) {
        let (even, odd) = distances_of_group(&query, group);
        let both = _mm512_or_si512(even, _mm512_slli_epi64::<32>(odd));
        let narrow: __m256i = _mm512_cvtepi32_epi16(both);
        let mut lanes = [0_u16; ROWS_PER_GROUP];
        // SAFETY: `lanes` are 32 writable bytes, and this store needs no alignment.
        unsafe { _mm256_storeu_si256(lanes.as_mut_ptr().cast(), narrow) };
        out.copy_from_slice(&lanes[..out.len()]);
    }
}

/// The sum of the distances of all `queries` to all rows.
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
pub(super) fn sum_of_distances(queries: &[[u64; 4]], groups: &[Group]) -> u64 {
    let (passes, rest) = queries.as_chunks::<QUERIES_PER_PASS>();
    let passes = passes.iter().map(|queries| sum_of_pass(queries, groups));
    let rest = rest
        .iter()
        .map(|query| sum_of_pass(std::array::from_ref(query), groups));
    passes.chain(rest).sum()
}

#[target_feature(enable = "avx512f,avx512vpopcntdq")]
#[inline]
fn sum_of_pass<const N: usize>(queries: &[[u64; 4]; N], groups: &[Group]) -> u64 {
    let mut spreads = [[_mm512_setzero_si512(); 4]; N];
    for (spread, query) in spreads.iter_mut().zip(queries) {
        *spread = self::spread(query);
    }
    let mut sums = [_mm512_setzero_si512(); N];
    for group in groups {
        for n in 0..N {
            let (even, odd) = distances_of_group(&spreads[n], group);
            sums[n] = _mm512_add_epi64(sums[n], _mm512_add_epi64(even, odd));
        }
    }
    sums.into_iter()
        .map(|sum| _mm512_reduce_add_epi64(sum).cast_unsigned())
        .sum()
}

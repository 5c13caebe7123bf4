//! How does AVX-512 with VPOPCNTDQ count? Sixteen rows at once, several queries per pass.
//!
//! While a query has no two neighbours yet, the two best of each lane are kept
//! ([`two_smallest_keys`]). From then on a group is only searched for a row that is nearer
//! than the second best so far ([`integrate_nearer`]): one minimum and one comparison in place of
//! six operations. Every group that says yes lowers the sum of the two best distances, so that
//! there are at most 512 of them for a query, whatever the rows are; of 40,000 real descriptors
//! there are about six.
//!
//! What else was tried at 500 x 40,000 on Zen 4, side by side in processor time, as many times as
//! fast as keys alone: this 1.18 (the popcounts alone would be 1.27); one question for two groups
//! 1.12; the rows in registers and the queries passing by 1.12, in 16-bit lanes with 15 words added
//! by carry-save 1.14; carry-save of three words here 1.05, because popcounts are not what is
//! short; prefetching 1.17; blocks of 512 to 4,096 rows within 2 %; testing after three of four
//! words, which 95 % of the groups fail, 0.75, because the other 5 % cannot be predicted.

use std::arch::x86_64::{
    __m256i, __m512i, __mmask16, _mm256_storeu_si256, _mm512_add_epi32, _mm512_add_epi64,
    _mm512_cmpeq_epu32_mask, _mm512_cmpge_epu32_mask, _mm512_cmplt_epu32_mask,
    _mm512_cmplt_epu64_mask, _mm512_cvtepi32_epi16, _mm512_load_si512, _mm512_mask_mov_epi32,
    _mm512_max_epu32, _mm512_min_epu32, _mm512_or_si512, _mm512_popcnt_epi64,
    _mm512_reduce_add_epi64, _mm512_reduce_min_epu32, _mm512_set_epi32, _mm512_set1_epi32,
    _mm512_set1_epi64, _mm512_setzero_si512, _mm512_slli_epi64, _mm512_storeu_si512,
    _mm512_ternarylogic_epi64, _mm512_xor_si512,
};
use std::ops::Range;

use super::nearest::{DISTANCE_SHIFT, LaneKeys, NO_KEY, NearestTwo};
use super::packed::{Group, ROWS_PER_GROUP};

/// Queries whose state stays in registers while a group of rows is read once.
const QUERIES_PER_PASS: usize = 4;

/// The same where only the second best distance of a query is kept beside its words. With a fourth
/// query registers run out, and time depends on where the stack lies.
const QUERIES_PER_CHECK: usize = 3;

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

/// Takes `rows`, counted from `groups[0]`, into the two nearest of each query; row 0 has the number
/// `base`, and every row a higher number than those taken before.
///
/// Exact for every state; fast if there are two neighbours already.
#[target_feature(enable = "avx512f,avx512vpopcntdq")]
pub(super) fn integrate_nearer(
    queries: &[[u64; 4]],
    groups: &[Group],
    rows: &Range<u32>,
    base: u32,
    state: &mut [NearestTwo],
) {
    let (passes, rest) = queries.as_chunks::<QUERIES_PER_CHECK>();
    let (states, states_of_rest) = state.as_chunks_mut::<QUERIES_PER_CHECK>();
    for (queries, state) in passes.iter().zip(states) {
        check(queries, groups, rows, base, state);
    }
    for (query, state) in rest.iter().zip(states_of_rest) {
        let state = std::array::from_mut(state);
        check(std::array::from_ref(query), groups, rows, base, state);
    }
}

#[target_feature(enable = "avx512f,avx512vpopcntdq")]
#[inline]
fn check<const N: usize>(
    queries: &[[u64; 4]; N],
    groups: &[Group],
    rows: &Range<u32>,
    base: u32,
    state: &mut [NearestTwo; N],
) {
    let mut spreads = [[_mm512_setzero_si512(); 4]; N];
    let mut second = [_mm512_setzero_si512(); N];
    for n in 0..N {
        spreads[n] = spread(&queries[n]);
        second[n] = _mm512_set1_epi64(state[n].second_bits.into());
    }
    let first = rows.start as usize / ROWS_PER_GROUP;
    let last = (rows.end as usize).div_ceil(ROWS_PER_GROUP);
    for (index, group) in (first..last).zip(&groups[first..last]) {
        for n in 0..N {
            let (even, odd) = distances_of_group(&spreads[n], group);
            let nearest = _mm512_min_epu32(even, odd);
            if _mm512_cmplt_epu64_mask(nearest, second[n]) != 0 {
                take_in_group((even, odd), index, rows, base, &mut state[n]);
                second[n] = _mm512_set1_epi64(state[n].second_bits.into());
            }
        }
    }
}

/// Takes those rows of a group that are nearer than the second best, and inside `rows`, into the
/// two nearest.
#[target_feature(enable = "avx512f")]
#[cold]
#[inline(never)]
fn take_in_group(
    (even, odd): (__m512i, __m512i),
    index: usize,
    rows: &Range<u32>,
    base: u32,
    state: &mut NearestTwo,
) {
    let bits = _mm512_or_si512(even, _mm512_slli_epi64::<32>(odd));
    let second = _mm512_set1_epi32(i32::from(state.second_bits));
    let mut nearer = _mm512_cmplt_epu32_mask(bits, second) & mask_inside(row_numbers(index), rows);
    let mut lanes = [0_u32; ROWS_PER_GROUP];
    // SAFETY: `lanes` are 64 writable bytes, and this store needs no alignment.
    unsafe { _mm512_storeu_si512(lanes.as_mut_ptr().cast(), bits) };
    let base = base + (index * ROWS_PER_GROUP) as u32;
    while nearer != 0 {
        let lane = nearer.trailing_zeros();
        nearer &= nearer - 1;
        state.integrate(base + lane, lanes[lane as usize] as u16);
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
    let inside = mask_inside(row, rows);
    _mm512_mask_mov_epi32(_mm512_set1_epi32(NO_KEY.cast_signed()), inside, row)
}

/// Which of the rows with these numbers are in `rows`.
#[target_feature(enable = "avx512f")]
#[inline]
fn mask_inside(row: __m512i, rows: &Range<u32>) -> __mmask16 {
    let start = _mm512_set1_epi32(rows.start.cast_signed());
    let end = _mm512_set1_epi32(rows.end.cast_signed());
    _mm512_cmpge_epu32_mask(row, start) & _mm512_cmplt_epu32_mask(row, end)
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

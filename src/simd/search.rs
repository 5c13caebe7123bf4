//! How are rows searched: block by block, with a kernel of this CPU?

use std::ops::Range;

#[cfg(target_arch = "x86_64")]
use super::avx2;
#[cfg(target_arch = "x86_64")]
use super::avx512;
use super::bits256::Bits256;
use super::kernel::{Kernel, Kind};
use super::nearest::{LaneKeys, NO_KEY, NearestTwo};
#[cfg(target_arch = "aarch64")]
use super::neon;
use super::packed::{Group, PackedDescriptors, ROWS_PER_GROUP, pack};
use super::scalar;

/// Groups that stay in the first-level cache while all queries pass over them: 1024 rows, 32 KiB.
const GROUPS_PER_BLOCK: usize = 64;
/// Groups packed on the stack where the train rows come as a slice: 512 rows, 16 KiB.
const GROUPS_PER_STACK_BLOCK: usize = 32;
/// Queries whose words and keys wait on the stack for one block.
const QUERIES_PER_TILE: usize = 64;
/// Rows whose words wait on the stack while all queries pass by.
const ROWS_PER_TILE: usize = 128;
impl Kernel {
    /// Writes the two nearest rows of `train` to `out[i]` for every `queries[i]`.
    ///
    /// # Panics
    /// If `out` has another length than `queries`.
    pub fn nearest_two<D: Bits256>(
        self,
        queries: &[D],
        train: &PackedDescriptors,
        out: &mut [NearestTwo],
    ) {
        assert_eq!(queries.len(), out.len(), "one answer per query");
        out.fill(NearestTwo::EMPTY);
        self.scan_packed(queries, train, 0..train.len(), out);
    }

    /// As [`nearest_two`](Self::nearest_two), among the given rows only, which keep their
    /// numbers: one of many small sets that are packed together.
    ///
    /// # Panics
    /// If `out` has another length than `queries`, or `train` has no such rows.
    pub(crate) fn nearest_two_of_rows<D: Bits256>(
        self,
        queries: &[D],
        train: &PackedDescriptors,
        rows: Range<usize>,
        out: &mut [NearestTwo],
    ) {
        assert_eq!(queries.len(), out.len(), "one answer per query");
        assert!(rows.end <= train.len(), "rows {rows:?} of {}", train.len());
        out.fill(NearestTwo::EMPTY);
        self.scan_packed(queries, train, rows, out);
    }

    /// The two nearest among the first `checkpoints[c]` rows of `train`, for every `c`, in one
    /// pass.
    ///
    /// Calls `sink(c, state)` in ascending order of `c`, where `state[i]` is what
    /// [`nearest_two`](Self::nearest_two) gives for `queries[i]` and `train[..checkpoints[c]]`. A
    /// checkpoint beyond the last row means all rows. `state` is overwritten.
    ///
    /// # Panics
    /// If `state` has another length than `queries`, `checkpoints` descends somewhere, or `train`
    /// has more than `u32::MAX` rows.
    pub(crate) fn nearest_two_prefixes<D: Bits256>(
        self,
        queries: &[D],
        train: &[D],
        checkpoints: &[usize],
        state: &mut [NearestTwo],
        mut sink: impl FnMut(usize, &[NearestTwo]),
    ) {
        assert_eq!(queries.len(), state.len(), "one answer per query");
        state.fill(NearestTwo::EMPTY);
        for_prefixes(checkpoints, train.len(), |index, rows| {
            self.scan_slice(queries, &train[rows.clone()], rows.start, state);
            sink(index, state);
        });
    }

    /// For each part of `rows`, the two nearest of its rows for every query: the first part ends
    /// before row `ends[0]`, each next one begins where the one before ended.
    ///
    /// Calls `sink(part, state)` in ascending order of parts, where `state[i]` is what
    /// [`nearest_two`](Self::nearest_two) gives for query `i` and the rows of the part alone,
    /// counted from its first. Here the queries lie side by side in the lanes and the rows pass by,
    /// so that a part of few rows leaves no lane idle. `state` is overwritten.
    ///
    /// # Panics
    /// If `state` has another length than `queries`, or `ends` descends somewhere or leads beyond
    /// `rows`.
    pub(crate) fn nearest_two_of_parts<D: Bits256>(
        self,
        queries: &PackedDescriptors,
        rows: &[D],
        ends: &[usize],
        state: &mut [NearestTwo],
        mut sink: impl FnMut(usize, &[NearestTwo]),
    ) {
        assert_eq!(queries.len(), state.len(), "one answer per query");
        let mut words = [[0; 4]; ROWS_PER_TILE];
        let mut start = 0;
        for (part, &end) in ends.iter().enumerate() {
            state.fill(NearestTwo::EMPTY);
            for (tile, rows) in rows[start..end].chunks(ROWS_PER_TILE).enumerate() {
                let words = &mut words[..rows.len()];
                for (words, row) in words.iter_mut().zip(rows) {
                    *words = row.words();
                }
                let base = (tile * ROWS_PER_TILE) as u32;
                let states = state.chunks_mut(ROWS_PER_GROUP);
                for (group, state) in queries.groups().iter().zip(states) {
                    let [best, second] = self.smallest_keys_of_lanes(group, words);
                    for ((state, best), second) in state.iter_mut().zip(best).zip(second) {
                        state.integrate_keys([best, second], base);
                    }
                }
            }
            sink(part, state);
            start = end;
        }
    }

    /// The smallest and second smallest key of `rows` for each of the 16 queries of a group.
    #[inline]
    fn smallest_keys_of_lanes(self, group: &Group, rows: &[[u64; 4]]) -> LaneKeys {
        match self.0 {
            Kind::Scalar => scalar::smallest_keys_of_lanes(group, rows),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
            Kind::Avx2 => unsafe { avx2::smallest_keys_of_lanes(group, rows) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a kernel of this kind exists only after its CPU features were detected.
            Kind::Avx512 => unsafe { avx512::smallest_keys_of_lanes(group, rows) },
            #[cfg(target_arch = "aarch64")]
            // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
            Kind::Neon => unsafe { neon::smallest_keys_of_lanes(group, rows) },
        }
    }

    /// Writes the distance in bits of `query` to every row of `train`.
    ///
    /// # Panics
    /// If `out` has another length than `train`.
    pub(crate) fn distances_into<D: Bits256>(
        self,
        query: &D,
        train: &PackedDescriptors,
        out: &mut [u16],
    ) {
        assert_eq!(train.len(), out.len(), "one distance per row");
        self.distances_of_groups(&query.words(), train.groups(), out);
    }

    /// Calls `found(row, bits)` for each of the given rows of `train` that is within `max_bits` of
    /// `query`, in ascending order.
    ///
    /// # Panics
    /// If `train` has no such rows.
    pub(crate) fn rows_within<D: Bits256>(
        self,
        query: &D,
        train: &PackedDescriptors,
        rows: Range<usize>,
        max_bits: u16,
        mut found: impl FnMut(u32, u16),
    ) {
        assert!(rows.end <= train.len(), "rows {rows:?} of {}", train.len());
        let query = query.words();
        let mut distances = [0; GROUPS_PER_BLOCK * ROWS_PER_GROUP];
        let mut start = rows.start / ROWS_PER_GROUP * ROWS_PER_GROUP;
        while start < rows.end {
            let end = rows.end.min(start + distances.len());
            let distances = &mut distances[..end - start];
            let groups = &train.groups()[start / ROWS_PER_GROUP..];
            self.distances_of_groups(&query, groups, distances);
            for (first, distances) in (start..)
                .step_by(ROWS_PER_GROUP)
                .zip(distances.chunks(ROWS_PER_GROUP))
            {
                // One comparison for most groups: few rows are near.
                if distances
                    .iter()
                    .fold(u16::MAX, |least, &bits| least.min(bits))
                    > max_bits
                {
                    continue;
                }
                for (row, &bits) in (first..).zip(distances) {
                    if bits <= max_bits && row >= rows.start {
                        found(row as u32, bits);
                    }
                }
            }
            start = end;
        }
    }

    /// The distance of `query` to the first `out.len()` rows.
    #[inline]
    fn distances_of_groups(self, query: &[u64; 4], groups: &[Group], out: &mut [u16]) {
        match self.0 {
            Kind::Scalar => scalar::distances(query, groups, out),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
            Kind::Avx2 => unsafe { avx2::distances(query, groups, out) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a kernel of this kind exists only after its CPU features were detected.
            Kind::Avx512 => unsafe { avx512::distances(query, groups, out) },
            #[cfg(target_arch = "aarch64")]
            // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
            Kind::Neon => unsafe { neon::distances(query, groups, out) },
        }
    }

    /// The sum of the distances in bits of all `queries` to all rows of `train`.
    ///
    /// It takes the loads, exclusive ors, popcounts and additions of a search, in the same order of
    /// memory, and nothing else: the limit that a search on this CPU is measured against.
    // Hidden: it is no search, and public for the evaluation alone, which times it beside the
    // searches.
    #[doc(hidden)]
    pub fn sum_of_distances<D: Bits256>(self, queries: &[D], train: &PackedDescriptors) -> u64 {
        let (whole, rest) = train.groups().split_at(train.len() / ROWS_PER_GROUP);
        let mut sum = 0;
        let mut words = [[0; 4]; QUERIES_PER_TILE];
        for groups in whole.chunks(GROUPS_PER_BLOCK) {
            for queries in queries.chunks(QUERIES_PER_TILE) {
                let words = &mut words[..queries.len()];
                for (words, query) in words.iter_mut().zip(queries) {
                    *words = query.words();
                }
                sum += match self.0 {
                    Kind::Scalar => scalar::sum_of_distances(words, groups),
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
                    Kind::Avx2 => unsafe { avx2::sum_of_distances(words, groups) },
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: a kernel of this kind exists only after its CPU features were
                    // detected.
                    Kind::Avx512 => unsafe { avx512::sum_of_distances(words, groups) },
                    #[cfg(target_arch = "aarch64")]
                    // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
                    Kind::Neon => unsafe { neon::sum_of_distances(words, groups) },
                };
            }
        }
        let mut distances = [0; ROWS_PER_GROUP];
        let distances = &mut distances[..train.len() % ROWS_PER_GROUP];
        for query in queries {
            scalar::distances(&query.words(), rest, distances);
            sum += distances.iter().map(|&bits| u64::from(bits)).sum::<u64>();
        }
        sum
    }

    /// Takes `train` into `state`; its row 0 has the number `base`, above all rows taken before.
    fn scan_slice<D: Bits256>(
        self,
        queries: &[D],
        train: &[D],
        base: usize,
        state: &mut [NearestTwo],
    ) {
        assert!(
            u32::try_from(base + train.len()).is_ok(),
            "a train set has at most u32::MAX rows"
        );
        let mut groups = [Group::ZERO; GROUPS_PER_STACK_BLOCK];
        for (index, rows) in train
            .chunks(GROUPS_PER_STACK_BLOCK * ROWS_PER_GROUP)
            .enumerate()
        {
            let filled = pack(rows, &mut groups);
            let base = base + index * GROUPS_PER_STACK_BLOCK * ROWS_PER_GROUP;
            self.scan_block(
                queries,
                &groups[..filled],
                0..rows.len() as u32,
                base as u32,
                state,
            );
        }
    }

    /// Takes the given rows of `train` into `state`; they lie above all rows taken before.
    fn scan_packed<D: Bits256>(
        self,
        queries: &[D],
        train: &PackedDescriptors,
        rows: Range<usize>,
        state: &mut [NearestTwo],
    ) {
        let mut start = rows.start;
        while start < rows.end {
            let first_group = start / ROWS_PER_GROUP;
            let base = first_group * ROWS_PER_GROUP;
            let end = rows.end.min(base + GROUPS_PER_BLOCK * ROWS_PER_GROUP);
            self.scan_block(
                queries,
                &train.groups()[first_group..end.div_ceil(ROWS_PER_GROUP)],
                (start - base) as u32..(end - base) as u32,
                base as u32,
                state,
            );
            start = end;
        }
    }

    /// Takes `rows`, counted from `groups[0]`, into `state`; row 0 has the number `base`.
    fn scan_block<D: Bits256>(
        self,
        queries: &[D],
        groups: &[Group],
        rows: Range<u32>,
        base: u32,
        state: &mut [NearestTwo],
    ) {
        debug_assert!(rows.start < rows.end && rows.end as usize <= groups.len() * ROWS_PER_GROUP);
        debug_assert!(groups.len() <= GROUPS_PER_BLOCK);
        let mut words = [[0; 4]; QUERIES_PER_TILE];
        let mut keys = [[NO_KEY; 2]; QUERIES_PER_TILE];
        for (queries, state) in queries
            .chunks(QUERIES_PER_TILE)
            .zip(state.chunks_mut(QUERIES_PER_TILE))
        {
            let words = &mut words[..queries.len()];
            let keys = &mut keys[..queries.len()];
            for (words, query) in words.iter_mut().zip(queries) {
                *words = query.words();
            }
            #[cfg(target_arch = "x86_64")]
            if self.0 == Kind::Avx512 && state.iter().all(NearestTwo::has_second) {
                // SAFETY: a kernel of this kind exists only after its CPU features were detected.
                unsafe { avx512::integrate_nearer(words, groups, &rows, base, state) };
                continue;
            }
            match self.0 {
                Kind::Scalar => scalar::two_smallest_keys(words, groups, rows.clone(), keys),
                #[cfg(target_arch = "x86_64")]
                // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
                Kind::Avx2 => unsafe {
                    avx2::two_smallest_keys(words, groups, rows.clone(), keys);
                },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: a kernel of this kind exists only after its CPU features were detected.
                Kind::Avx512 => unsafe {
                    avx512::two_smallest_keys(words, groups, rows.clone(), keys);
                },
                #[cfg(target_arch = "aarch64")]
                // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
                Kind::Neon => unsafe {
                    neon::two_smallest_keys(words, groups, rows.clone(), keys);
                },
            }
            for (state, &keys) in state.iter_mut().zip(keys.iter()) {
                state.integrate_keys(keys, base);
            }
        }
    }
}

/// Calls `visit(index, rows added)` for each ascending checkpoint, clamped to `len`.
fn for_prefixes(checkpoints: &[usize], len: usize, mut visit: impl FnMut(usize, Range<usize>)) {
    assert!(checkpoints.is_sorted(), "checkpoints must ascend");
    let mut done = 0;
    for (index, &checkpoint) in checkpoints.iter().enumerate() {
        let end = checkpoint.min(len);
        visit(index, done..end);
        done = end;
    }
}

//! How fast are the two nearest of 256 bits on this CPU?
//!
//! Exact Hamming search: for a query `q` and train rows `t_0..t_m`,
//! `d_j = popcount(q xor t_j)` in bits, 0 to 256; the answer is the `j` with the smallest `(d_j, j)`
//! and the one with the second smallest. Work is `O(queries * rows)`, memory is the train rows once
//! more, interleaved ([`PackedDescriptors`]), or a fixed block of the stack where they come as a slice.
//!
//! A [`Kernel`] is a value that exists only if the CPU can run it, so holding one is the proof that
//! its instructions are safe to execute. [`Kernel::scalar`] is the plain twin of all others.
//!
//! How a kernel works: 16 rows form a group of 512 bytes in which equal words of different rows lie
//! side by side, so that no lane is ever added to its neighbour. The 9-bit distance and the row's
//! number in its block form one 32-bit key `distance << 23 | row`; the unsigned minimum of keys is then
//! the nearest row *with* the tie rule, and best and second best cost one maximum and two minima per
//! 16 rows (with AVX-512 that holds for the first block; of later ones it only asks what is nearer still).
//! Blocks of 1024 rows stay in the first-level cache while all queries pass over them. The
//! popcount instruction is the one of Muła, Kurz and Lemire, "Faster population counts using AVX2
//! instructions" (2018) where the CPU has none for vectors.
//!
//! Invariants: every kernel returns the same bits as the scalar twin; ties go to the lowest row;
//! nothing is allocated except in [`PackedDescriptors`].
//!
//! Not for: other lengths than 256 bits, more than two neighbours, approximate search.
//! The NEON kernel was held against its twin under qemu (`scripts/neon.sh`), never timed on a real processor.
#![allow(unsafe_code)] // reason: vector instructions are unsafe to call before the CPU is asked.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
pub(crate) mod image;
#[cfg(target_arch = "aarch64")]
mod neon;
mod packed;
mod scalar;

use std::fmt;
use std::ops::Range;
use std::str::FromStr;
use std::sync::OnceLock;

use fremen::error::{Error, ErrorKind, Result};

pub use packed::PackedDescriptors;
use packed::{Group, ROWS_PER_GROUP, pack};

/// The environment variable that forces a kernel: `scalar`, `avx2`, `avx512` or `neon`.
pub const KERNEL_VARIABLE: &str = "CHRONOTOPE_KERNEL";

/// Groups that stay in the first-level cache while all queries pass over them: 1024 rows, 32 KiB.
const GROUPS_PER_BLOCK: usize = 64;
/// Groups packed on the stack where the train rows come as a slice: 512 rows, 16 KiB.
const GROUPS_PER_STACK_BLOCK: usize = 32;
/// Queries whose words and keys wait on the stack for one block.
const QUERIES_PER_TILE: usize = 64;
/// Rows whose words wait on the stack while all queries pass by.
const ROWS_PER_TILE: usize = 128;
/// Position of the distance in a key; the bits below hold the row in its block.
const DISTANCE_SHIFT: u32 = 23;
/// Greater than every key of a row.
const NO_KEY: u32 = u32::MAX;

/// The smallest keys of 16 queries, and their second smallest.
type LaneKeys = [[u32; ROWS_PER_GROUP]; 2];

/// 256 bits as four words; what a descriptor must be able to say for its distances to be taken.
pub trait Bits256: Copy {
    /// The bits; their order does not matter as long as it is always the same.
    fn words(&self) -> [u64; 4];
}

impl Bits256 for [u64; 4] {
    #[inline]
    fn words(&self) -> [u64; 4] {
        *self
    }
}

/// The nearest and second nearest train row of one query.
///
/// Ordered by (distance, row), so ties are won by the lowest row. With fewer than two rows the missing
/// ids are [`NONE`](Self::NONE) and the missing distances [`NO_DISTANCE_BITS`](Self::NO_DISTANCE_BITS),
/// which is greater than every distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NearestTwo {
    /// The nearest row.
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
    fn integrate(&mut self, row: u32, bits: u16) {
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
    fn integrate_keys(&mut self, keys: [u32; 2], base: u32) {
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// The instructions that distances are computed with; it exists only if this CPU can run them.
///
/// Every kernel gives the same answers; only their speed differs.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Kernel(Kind);

impl Kernel {
    /// The plain twin of all other kernels; runs everywhere.
    pub const fn scalar() -> Self {
        Self(Kind::Scalar)
    }

    /// Every kernel this CPU can run, slowest first; the first one is [`scalar`](Self::scalar).
    pub fn available() -> impl Iterator<Item = Self> {
        [
            Some(Self::scalar()),
            Self::avx2(),
            Self::neon(),
            Self::avx512(),
        ]
        .into_iter()
        .flatten()
    }

    /// The fastest kernel this CPU can run, or the one that [`KERNEL_VARIABLE`] asks for.
    ///
    /// A value of the variable that cannot be used is ignored here, because answers do not depend on
    /// the kernel; a command calls [`from_env`](Self::from_env) once at its start to report it. The
    /// variable is read once per process.
    pub fn best() -> Self {
        static BEST: OnceLock<Kernel> = OnceLock::new();
        *BEST.get_or_init(|| Self::from_env().unwrap_or_else(|_| Self::detect()))
    }

    /// What [`KERNEL_VARIABLE`] asks for, the fastest kernel where it is unset or empty, and an
    /// [`ErrorKind::Config`] error where its value is unknown or not for this CPU.
    pub fn from_env() -> Result<Self> {
        match std::env::var_os(KERNEL_VARIABLE) {
            None => Ok(Self::detect()),
            Some(value) if value.is_empty() => Ok(Self::detect()),
            Some(value) => value
                .to_string_lossy()
                .parse()
                .map_err(|error: Error| error.with_place(KERNEL_VARIABLE)),
        }
    }

    /// `scalar`, `avx2`, `avx512` or `neon`.
    pub const fn name(self) -> &'static str {
        match self.0 {
            Kind::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512",
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => "neon",
        }
    }

    fn detect() -> Self {
        Self::available().last().unwrap_or(Self::scalar())
    }

    #[cfg(target_arch = "x86_64")]
    fn avx2() -> Option<Self> {
        is_x86_feature_detected!("avx2").then_some(Self(Kind::Avx2))
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn avx2() -> Option<Self> {
        None
    }

    #[cfg(target_arch = "x86_64")]
    fn avx512() -> Option<Self> {
        // Every CPU that counts ones of vectors has the others too, but for one accelerator card.
        (is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512vpopcntdq"))
        .then_some(Self(Kind::Avx512))
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn avx512() -> Option<Self> {
        None
    }

    #[cfg(target_arch = "aarch64")]
    fn neon() -> Option<Self> {
        std::arch::is_aarch64_feature_detected!("neon").then_some(Self(Kind::Neon))
    }

    #[cfg(not(target_arch = "aarch64"))]
    fn neon() -> Option<Self> {
        None
    }

    /// Writes the two nearest rows of `train` to `out[i]` for every `queries[i]`.
    ///
    /// Packs `train` block by block on the stack; where it is searched more than once, pack it once
    /// and use [`nearest_two_packed`](Self::nearest_two_packed).
    ///
    /// # Panics
    /// If `out` has another length than `queries`, or `train` has more than `u32::MAX` rows.
    pub fn nearest_two<D: Bits256>(self, queries: &[D], train: &[D], out: &mut [NearestTwo]) {
        assert_eq!(queries.len(), out.len(), "one answer per query");
        out.fill(NearestTwo::EMPTY);
        self.scan_slice(queries, train, 0, out);
    }

    /// As [`nearest_two`](Self::nearest_two), for rows packed beforehand.
    ///
    /// # Panics
    /// If `out` has another length than `queries`.
    pub fn nearest_two_packed<D: Bits256>(
        self,
        queries: &[D],
        train: &PackedDescriptors,
        out: &mut [NearestTwo],
    ) {
        assert_eq!(queries.len(), out.len(), "one answer per query");
        out.fill(NearestTwo::EMPTY);
        self.scan_packed(queries, train, 0..train.len(), out);
    }

    /// As [`nearest_two_packed`](Self::nearest_two_packed), among the given rows only, which keep their
    /// numbers: one of many small sets that are packed together.
    ///
    /// # Panics
    /// If `out` has another length than `queries`, or `train` has no such rows.
    pub fn nearest_two_of_rows<D: Bits256>(
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

    /// The two nearest among the first `checkpoints[c]` rows of `train`, for every `c`, in one pass.
    ///
    /// Calls `sink(c, state)` in ascending order of `c`, where `state[i]` is what
    /// [`nearest_two`](Self::nearest_two) gives for `queries[i]` and `train[..checkpoints[c]]`. A
    /// checkpoint beyond the last row means all rows. `state` is overwritten.
    ///
    /// # Panics
    /// If `state` has another length than `queries`, `checkpoints` descends somewhere, or `train` has
    /// more than `u32::MAX` rows.
    pub fn nearest_two_prefixes<D: Bits256>(
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

    /// As [`nearest_two_prefixes`](Self::nearest_two_prefixes), for rows packed beforehand.
    ///
    /// # Panics
    /// If `state` has another length than `queries`, or `checkpoints` descends somewhere.
    pub fn nearest_two_prefixes_packed<D: Bits256>(
        self,
        queries: &[D],
        train: &PackedDescriptors,
        checkpoints: &[usize],
        state: &mut [NearestTwo],
        mut sink: impl FnMut(usize, &[NearestTwo]),
    ) {
        assert_eq!(queries.len(), state.len(), "one answer per query");
        state.fill(NearestTwo::EMPTY);
        for_prefixes(checkpoints, train.len(), |index, rows| {
            self.scan_packed(queries, train, rows, state);
            sink(index, state);
        });
    }

    /// For each part of `rows`, the two nearest of its rows for every query: the first part ends before
    /// row `ends[0]`, each next one begins where the one before ended.
    ///
    /// Calls `sink(part, state)` in ascending order of parts, where `state[i]` is what
    /// [`nearest_two`](Self::nearest_two) gives for query `i` and the rows of the part alone, counted from
    /// its first. Here the queries lie side by side in the lanes and the rows pass by, so that a part of
    /// few rows leaves no lane idle. `state` is overwritten.
    ///
    /// # Panics
    /// If `state` has another length than `queries`, or `ends` descends somewhere or leads beyond `rows`.
    pub fn nearest_two_of_parts<D: Bits256>(
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
    pub fn distances_into<D: Bits256>(self, query: &D, train: &PackedDescriptors, out: &mut [u16]) {
        assert_eq!(train.len(), out.len(), "one distance per row");
        self.distances_of_groups(&query.words(), train.groups(), out);
    }

    /// Calls `found(row, bits)` for each of the given rows of `train` that is within `max_bits` of `query`,
    /// in ascending order.
    ///
    /// # Panics
    /// If `train` has no such rows.
    pub fn rows_within<D: Bits256>(
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
                    // SAFETY: a kernel of this kind exists only after its CPU features were detected.
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

impl Default for Kernel {
    fn default() -> Self {
        Self::best()
    }
}

impl fmt::Debug for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Kernel({})", self.name())
    }
}

impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kernel {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        if let Some(kernel) = Self::available().find(|kernel| kernel.name() == name) {
            return Ok(kernel);
        }
        let message = if ["avx2", "avx512", "neon"].contains(&name) {
            format!("this CPU cannot run the kernel `{name}`")
        } else {
            format!("there is no kernel `{name}`")
        };
        let names: Vec<_> = Self::available().map(Self::name).collect();
        Err(Error::new(ErrorKind::Config, message)
            .with_help(format!("this CPU can run: {}", names.join(", "))))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back_and_strangers_are_refused_with_the_choice() {
        for kernel in Kernel::available() {
            assert_eq!(kernel.name().parse::<Kernel>().unwrap(), kernel);
        }
        let error = "sse9".parse::<Kernel>().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Config);
        assert!(error.to_string().contains("scalar"), "{error}");
        let absent = if cfg!(target_arch = "aarch64") {
            "avx2"
        } else {
            "neon"
        };
        let error = absent.parse::<Kernel>().unwrap_err();
        assert!(error.to_string().contains("this CPU cannot run"), "{error}");
    }

    #[test]
    fn no_row_and_one_row_have_defined_answers() {
        for kernel in Kernel::available() {
            let mut out = [NearestTwo::default(); 1];
            kernel.nearest_two(&[[1, 0, 0, 0]], &[], &mut out);
            assert_eq!(out[0], NearestTwo::EMPTY);
            kernel.nearest_two(&[[1, 0, 0, 0]], &[[u64::MAX; 4]], &mut out);
            assert_eq!((out[0].best, out[0].best_bits), (0, 255));
            assert!(!out[0].has_second());
            assert_eq!(out[0].second_bits, NearestTwo::NO_DISTANCE_BITS);
        }
    }

    #[test]
    fn the_greatest_distance_fits_its_key() {
        for kernel in Kernel::available() {
            let mut out = [NearestTwo::default(); 3];
            kernel.nearest_two(&[[0; 4]; 3], &[[u64::MAX; 4]; 40], &mut out);
            for nearest in out {
                assert_eq!((nearest.best, nearest.best_bits), (0, 256), "{kernel}");
                assert_eq!((nearest.second, nearest.second_bits), (1, 256), "{kernel}");
            }
        }
    }
}

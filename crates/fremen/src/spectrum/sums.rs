//! What must be kept of a history to know its rhythms?
//!
//! `S_k` (over the observations at which the state was 1) and `W_k` (over all observations) for
//! every candidate, and how many there were of each. Times themselves are not needed.
//!
//! The sums are whole numbers: every cosine and sine is rounded to a multiple of 2^-40 (an error
//! below 5e-13 a visit) and added as an integer. So adding is exactly commutative and associative,
//! what was added can be taken away without a trace, merged maps equal one map bit for bit, and no
//! order of threads can be seen in a result.

use super::candidates::CandidatePeriods;
use super::codec::{Reader, Writer};
use super::rhythms::Rhythms;
use super::select::strongest;
use crate::error::{Error, ErrorKind, Result};
use crate::time::Time;

/// One, in the fixed point of the sums.
const ONE: f64 = (1_u64 << 40) as f64;

/// No sum has more observations than this, so that none overflows: 2^23 - 1.
pub const MAX_OBSERVATIONS: usize = (1 << 23) - 1;

/// Columns that are summed at once: what fits into the registers of every x86-64 CPU.
const TILE: usize = 16;

/// p of a state without any observation (RAS 4.1.2: "a completely unknown state").
pub const P_UNKNOWN: f64 = 0.5;

/// A [`PhasorTable`] may take so many bytes.
const MAX_TABLE_BYTES: usize = 1 << 34;

/// Rounds a number of at most 2^10 to a multiple of 2^-40.
#[inline]
pub(crate) fn to_fixed(value: f64) -> i64 {
    // Adding 1.5 * 2^52 leaves the rounded integer in the low bits.
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    (value * ONE + MAGIC).to_bits() as i64 - MAGIC.to_bits() as i64
}

/// The real number that a sum stands for.
#[inline]
pub(crate) fn from_fixed(sum: i64) -> f64 {
    sum as f64 / ONE
}

/// The phasors of many times, ready to be summed over any of them.
///
/// `2 K` columns a time, cosines then sines, in tiles of 16 columns so that a sum over
/// times stays in registers: O(n K) additions for n times, one load each. `16 K` bytes a time.
#[derive(Clone, Debug)]
pub struct PhasorTable {
    /// Tile after tile; within a tile, time after time.
    tiles: Vec<[i64; TILE]>,
    num_times: usize,
    width: usize,
}

impl PhasorTable {
    /// Of `candidates` at `times`, of which there are at most [`MAX_OBSERVATIONS`]; also an error
    /// where they need more than 16 GiB, or than the system gives.
    pub fn new(
        candidates: &CandidatePeriods,
        times: impl ExactSizeIterator<Item = Time>,
    ) -> Result<Self> {
        let (num_times, width) = (times.len(), 2 * candidates.len());
        if num_times > MAX_OBSERVATIONS {
            return Err(too_many(num_times));
        }
        // Millions of times and a thousand periods are many gigabytes: nothing to die of, as a process
        // does where the system promises memory that it does not have.
        let num_tiles = width.div_ceil(TILE) * num_times;
        let mut tiles = Vec::new();
        if num_tiles > MAX_TABLE_BYTES / size_of::<[i64; TILE]>()
            || tiles.try_reserve_exact(num_tiles).is_err()
        {
            return Err(too_large(num_times, candidates.len()));
        }
        tiles.resize(num_tiles, [0; TILE]);
        let mut phasors = vec![0.0; width];
        for (i, time) in times.enumerate() {
            candidates.phasors_into(time, &mut phasors);
            for (tile, phasors) in phasors.chunks(TILE).enumerate() {
                let row = &mut tiles[tile * num_times + i];
                for (fixed, &phasor) in row.iter_mut().zip(phasors) {
                    *fixed = to_fixed(phasor);
                }
            }
        }
        Ok(Self {
            tiles,
            num_times,
            width,
        })
    }

    /// Columns: twice the number of candidates.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Writes, for each list of indices, the sums over the times of these indices: one row of
    /// [`width`](Self::width) columns a list.
    ///
    /// Where lists are many and hold more than a third of all times, the 16 sums of every four
    /// times are made first and each list picks one of them: half the additions or less, and the
    /// same sums, because they are whole numbers.
    ///
    /// # Panics
    /// If an index has no time, or `out` does not have one row a list.
    pub fn sums_into(&self, lists: &[&[u32]], out: &mut [i64]) {
        assert_eq!(out.len(), lists.len() * self.width, "one row a list");
        let num_indices: usize = lists.iter().map(|list| list.len()).sum();
        let is_dense = lists.len() >= 32 && 3 * num_indices > lists.len() * self.num_times;
        let is_ascending = |list: &&[u32]| list.windows(2).all(|pair| pair[0] < pair[1]);
        let picks = (is_dense && lists.iter().all(is_ascending)).then(|| self.picks(lists));
        for (tile, first) in (0..self.width).step_by(TILE).enumerate() {
            let rows = &self.tiles[tile * self.num_times..(tile + 1) * self.num_times];
            let columns = first..(first + TILE).min(self.width);
            let fours = picks.as_ref().map(|_| sums_of_fours(rows));
            for (i, out) in out.chunks_exact_mut(self.width).enumerate() {
                let sum = match (&picks, &fours) {
                    (Some(picks), Some(fours)) => {
                        sum_of_picks(fours, &picks[i * fours.len()..(i + 1) * fours.len()])
                    }
                    _ => sum_of_rows(rows, lists[i]),
                };
                out[columns.clone()].copy_from_slice(&sum[..columns.len()]);
            }
        }
    }

    /// For each list and every four times, which of the four are in the list, as bits.
    fn picks(&self, lists: &[&[u32]]) -> Vec<u8> {
        let num_fours = self.num_times.div_ceil(4);
        let mut picks = vec![0; lists.len() * num_fours];
        for (list, picks) in lists.iter().zip(picks.chunks_exact_mut(num_fours)) {
            for &index in *list {
                picks[index as usize / 4] |= 1 << (index % 4);
            }
        }
        picks
    }

    /// Calls `with` with every column of time `index`, as a real number.
    pub(crate) fn for_each_phasor(&self, index: usize, mut with: impl FnMut(usize, f64)) {
        for column in 0..self.width {
            let tile = &self.tiles[column / TILE * self.num_times + index];
            with(column, from_fixed(tile[column % TILE]));
        }
    }

    /// Adds the phasors of time `index` to `sums`.
    ///
    /// # Panics
    /// If there is no such time, or `sums` is not [`width`](Self::width) long.
    pub fn add_to(&self, index: usize, sums: &mut [i64]) {
        assert!(index < self.num_times, "no time {index}");
        for (tile, sums) in sums.chunks_mut(TILE).enumerate() {
            add(sums, &self.tiles[tile * self.num_times + index]);
        }
    }
}

/// The sums of every subset of every four rows; the last rows may be fewer.
fn sums_of_fours(rows: &[[i64; TILE]]) -> Vec<[[i64; TILE]; 16]> {
    let fours = rows.chunks(4).map(|four| {
        let mut sums = [[0; TILE]; 16];
        for (i, row) in four.iter().enumerate() {
            for subset in 0..1 << i {
                sums[subset | 1 << i] = std::array::from_fn(|c| sums[subset][c] + row[c]);
            }
        }
        sums
    });
    fours.collect()
}

/// Apart from the loops around it, which would push the sums out of the registers.
#[inline(never)]
fn sum_of_picks(fours: &[[[i64; TILE]; 16]], picks: &[u8]) -> [i64; TILE] {
    let mut sum = [0_i64; TILE];
    for (four, &pick) in fours.iter().zip(picks) {
        for (sum, term) in sum.iter_mut().zip(&four[usize::from(pick & 15)]) {
            *sum = sum.wrapping_add(*term);
        }
    }
    sum
}

/// Apart from the loops around it, which would push the sums out of the registers.
#[inline(never)]
fn sum_of_rows(rows: &[[i64; TILE]], indices: &[u32]) -> [i64; TILE] {
    let mut sum = [0_i64; TILE];
    for &i in indices {
        for (sum, term) in sum.iter_mut().zip(&rows[i as usize]) {
            *sum = sum.wrapping_add(*term);
        }
    }
    sum
}

#[inline]
fn add(sums: &mut [i64], terms: &[i64]) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum = sum.wrapping_add(*term);
    }
}

fn too_large(num_times: usize, num_candidates: usize) -> Error {
    let gigabytes = 16e-9 * num_times as f64 * num_candidates as f64;
    Error::new(
        ErrorKind::Shape,
        format!(
            "{num_times} observations and {num_candidates} periods need {gigabytes:.1} GB of memory at \
             once"
        ),
    )
    .with_help("learn with fewer candidate periods, or from a part of the history")
}

pub(crate) fn too_many(count: usize) -> Error {
    Error::new(
        ErrorKind::Shape,
        format!("{count} observations are more than the {MAX_OBSERVATIONS} that sums can hold"),
    )
}

/// FreMEn of one state, learnt one observation at a time (T-RO eq. 11 and RAS eq. 3 in exact form).
///
/// O(K) an observation, O(K l) a [model](Self::rhythms), `32 K` bytes. Observations may come in any
/// order of time. For many states that share observation times, a [`PhasorTable`] is faster.
///
/// Not for finding out *which* observations there were: that is the log's job; merging two sums
/// that contain the same visit counts it twice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpectralSums {
    candidates: CandidatePeriods,
    num_observed: u32,
    num_seen: u32,
    seen: Vec<i64>,
    observed: Vec<i64>,
}

impl SpectralSums {
    const TAG: [u8; 4] = *b"CSS\x01";

    /// No observations.
    pub fn new(candidates: CandidatePeriods) -> Self {
        let width = 2 * candidates.len();
        Self {
            candidates,
            num_observed: 0,
            num_seen: 0,
            seen: vec![0; width],
            observed: vec![0; width],
        }
    }

    /// Of what was summed elsewhere, by a [`PhasorTable`] of the same candidates: over all observations, and
    /// over those at which the state was 1.
    ///
    /// Fails with [`ErrorKind::Shape`] if the sums have not two values a candidate, or are larger than so
    /// many observations allow.
    pub fn of_parts(
        candidates: CandidatePeriods,
        (num_observed, observed): (usize, Vec<i64>),
        (num_seen, seen): (usize, Vec<i64>),
    ) -> Result<Self> {
        if num_observed > MAX_OBSERVATIONS {
            return Err(too_many(num_observed));
        }
        let width = 2 * candidates.len();
        let fits = |sums: &[i64], count: usize| {
            let is_possible = |sum: &i64| sum.unsigned_abs() <= (count as u64) << 40;
            sums.len() == width && sums.iter().all(is_possible)
        };
        if num_seen > num_observed || !fits(&observed, num_observed) || !fits(&seen, num_seen) {
            let message = format!(
                "these are no sums of {num_observed} observations, {num_seen} of them 1, over {} periods",
                candidates.len()
            );
            return Err(Error::new(ErrorKind::Shape, message));
        }
        Ok(Self {
            candidates,
            num_observed: num_observed as u32,
            num_seen: num_seen as u32,
            seen,
            observed,
        })
    }

    /// The rhythms looked for.
    pub fn candidates(&self) -> &CandidatePeriods {
        &self.candidates
    }

    /// Observations.
    pub fn num_observed(&self) -> usize {
        self.num_observed as usize
    }

    /// Observations at which the state was 1.
    pub fn num_seen(&self) -> usize {
        self.num_seen as usize
    }

    /// Adds one observation; fails only beyond [`MAX_OBSERVATIONS`].
    pub fn add(&mut self, time: Time, state: bool) -> Result<()> {
        if self.num_observed() == MAX_OBSERVATIONS {
            return Err(too_many(MAX_OBSERVATIONS + 1));
        }
        let mut phasors = vec![0.0; self.observed.len()];
        self.candidates.phasors_into(time, &mut phasors);
        for (i, phasor) in phasors.into_iter().enumerate() {
            let phasor = to_fixed(phasor);
            self.observed[i] = self.observed[i].wrapping_add(phasor);
            if state {
                self.seen[i] = self.seen[i].wrapping_add(phasor);
            }
        }
        self.num_observed += 1;
        self.num_seen += u32::from(state);
        Ok(())
    }

    /// Adds all observations of `other`, which has the same candidates.
    pub fn merge(&mut self, other: &Self) -> Result<()> {
        self.check_same_candidates(other)?;
        let total = self.num_observed() + other.num_observed();
        if total > MAX_OBSERVATIONS {
            return Err(too_many(total));
        }
        self.num_observed += other.num_observed;
        self.num_seen += other.num_seen;
        add(&mut self.seen, &other.seen);
        add(&mut self.observed, &other.observed);
        Ok(())
    }

    /// Forgets all observations of `other`, which must have been added before.
    ///
    /// Exact: afterwards the sums are bit for bit as if they had never been added. Fails if `other`
    /// has more observations, of either state, than there are.
    pub fn subtract(&mut self, other: &Self) -> Result<()> {
        self.check_same_candidates(other)?;
        let unseen = |sums: &Self| sums.num_observed - sums.num_seen;
        if other.num_seen > self.num_seen || unseen(other) > unseen(self) {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "cannot forget {} observations ({} seen) of {} ({} seen)",
                    other.num_observed, other.num_seen, self.num_observed, self.num_seen
                ),
            ));
        }
        self.num_observed -= other.num_observed;
        self.num_seen -= other.num_seen;
        for (sums, others) in [
            (&mut self.seen, &other.seen),
            (&mut self.observed, &other.observed),
        ] {
            for (sum, other) in sums.iter_mut().zip(others) {
                // Sums that were never added can be as large as the others with the other sign.
                *sum = sum.wrapping_sub(*other);
            }
        }
        Ok(())
    }

    fn check_same_candidates(&self, other: &Self) -> Result<()> {
        if self.candidates == other.candidates {
            return Ok(());
        }
        Err(Error::new(
            ErrorKind::Config,
            "sums of different candidate periods cannot be combined",
        ))
    }

    /// The share of observations at which the state was 1; 1/2 without any.
    pub fn mean(&self) -> f64 {
        if self.num_observed == 0 {
            P_UNKNOWN
        } else {
            f64::from(self.num_seen) / f64::from(self.num_observed)
        }
    }

    /// The balanced coefficients `g_k = (S_k - mu W_k) / m`: all real parts, then all imaginary
    /// parts with their sign turned.
    pub(super) fn coefficients(&self) -> Vec<f64> {
        let mean = self.mean();
        let scale = 1.0 / f64::from(self.num_observed.max(1));
        (self.seen.iter().zip(&self.observed))
            .map(|(&s, &w)| (from_fixed(s) - mean * from_fixed(w)) * scale)
            .collect()
    }

    /// `abs(W_k) / m` of candidate `k`.
    pub(super) fn window(&self, k: usize) -> f64 {
        let (cos, sin) = (self.observed[k], self.observed[self.candidates.len() + k]);
        from_fixed(cos).hypot(from_fixed(sin)) / f64::from(self.num_observed.max(1))
    }

    /// p(t) with the `order` strongest rhythms.
    pub fn rhythms(&self, order: usize) -> Rhythms {
        let count = self.candidates.len();
        let mean = self.mean();
        let coefficients = self.coefficients();
        let (cos, sin) = coefficients.split_at(count);
        let mut powers: Vec<_> = cos.iter().zip(sin).map(|(c, s)| c * c + s * s).collect();
        let mut selected = vec![0; order.min(count)];
        let num_selected = strongest(&mut powers, &mut selected);
        let terms = selected[..num_selected]
            .iter()
            .map(|&k| (k, 2.0 * cos[usize::from(k)], 2.0 * sin[usize::from(k)]))
            .collect();
        Rhythms::new(self.candidates.clone(), mean, terms)
    }

    /// Everything, as bytes with a checksum.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut writer = Writer::new(Self::TAG);
        self.candidates.write(&mut writer);
        writer.varint(self.num_observed.into());
        writer.varint(self.num_seen.into());
        for &sum in self.seen.iter().chain(&self.observed) {
            writer.signed(sum);
        }
        writer.finish()
    }

    /// What [`to_bytes`](Self::to_bytes) wrote; anything else is an error.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let mut reader = Reader::new(bytes, Self::TAG, "a set of spectral sums")?;
        let candidates = CandidatePeriods::read(&mut reader)?;
        let mut sums = Self::new(candidates);
        let num_observed = reader.varint()?;
        let num_seen = reader.varint()?;
        if num_observed > MAX_OBSERVATIONS as u64 || num_seen > num_observed {
            return Err(reader.impossible("impossible numbers of observations"));
        }
        (sums.num_observed, sums.num_seen) = (num_observed as u32, num_seen as u32);
        for (sums, count) in [
            (&mut sums.seen, num_seen),
            (&mut sums.observed, num_observed),
        ] {
            for sum in sums {
                *sum = reader.signed()?;
                if sum.unsigned_abs() > count << 40 {
                    return Err(reader.impossible("a sum is larger than its terms allow"));
                }
            }
        }
        reader.finish()?;
        Ok(sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Period;

    #[test]
    fn fixed_point_rounds_to_nearest() {
        for value in [0.0, 1.0, -1.0, 0.123_456_789, -0.999_999_999, 3e-13, -3e-13] {
            assert!((from_fixed(to_fixed(value)) - value).abs() <= 0.5 / ONE);
        }
    }

    #[test]
    fn a_table_of_more_memory_than_there_is_is_an_error() {
        let candidates = CandidatePeriods::harmonic(Period::WEEK, 1_000).expect("valid");
        let times = (0..4_000_000).map(|i| Time::from_s(60 * i64::from(i)));
        let error = PhasorTable::new(&candidates, times).expect_err("64 GB");
        assert_eq!(error.kind(), ErrorKind::Shape);
        assert!(error.to_string().contains("64.0 GB"), "{error}");
    }

    #[test]
    fn a_table_sums_what_single_observations_sum() {
        let candidates = CandidatePeriods::harmonic(Period::WEEK, 23).expect("valid");
        let times: Vec<_> = (0..50).map(|i| Time::from_s(i * i * 1_234)).collect();
        let table = PhasorTable::new(&candidates, times.iter().copied()).expect("few");
        let indices: Vec<u32> = (0..50).filter(|i| i % 5 != 0).collect();
        let mut sums = SpectralSums::new(candidates);
        for &i in &indices {
            sums.add(times[i as usize], true).expect("few");
        }
        // One list is summed time by time, many are picked from sums of fours.
        for num_lists in [1, 40] {
            let mut from_table = vec![0; num_lists * table.width()];
            table.sums_into(&vec![&indices[..]; num_lists], &mut from_table);
            for row in from_table.chunks_exact(table.width()) {
                assert_eq!(row, sums.seen);
            }
        }
    }
}

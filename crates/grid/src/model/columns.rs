//! What is summed over the times at which a cell was occupied?

use fremen::{CandidatePeriods, Period, Time};

use super::config::CellModel;

/// One, in the fixed point of the sums: phasors are rounded to multiples of 2^-40.
const ONE: f64 = (1_u64 << 40) as f64;

/// The real number that a sum of phasors stands for.
pub(super) fn from_fixed(sum: i64) -> f64 {
    sum as f64 / ONE
}

/// The numbers that a time stands for.
#[derive(Clone, Debug)]
pub(super) enum Columns {
    /// `cos(w_k t)` for each candidate, then `sin(w_k t)`, in fixed point.
    Phasors(CandidatePeriods),
    /// 1 in the bin of the time, 0 in the others.
    Bins(Period, usize),
    /// 1 in the part of one candidate period in which the time lies, 0 in the others.
    Folded(CandidatePeriods, usize, usize),
    /// None at all.
    None,
}

impl Columns {
    pub(super) fn of(model: &CellModel) -> Self {
        match model {
            CellModel::Fremen { candidates, order } if *order > 0 => {
                Self::Phasors(candidates.clone())
            }
            // Which one is the strongest comes first.
            CellModel::Folded { candidates, .. } => Self::Phasors(candidates.clone()),
            CellModel::Histogram { period, num_bins } => Self::Bins(*period, *num_bins),
            _ => Self::None,
        }
    }

    pub(super) fn width(&self) -> usize {
        match self {
            Self::Phasors(candidates) => 2 * candidates.len(),
            Self::Bins(_, num_bins) | Self::Folded(_, _, num_bins) => *num_bins,
            Self::None => 0,
        }
    }

    /// Adds the numbers of a time to `sums`; `scratch` is as long.
    fn add(&self, time: Time, scratch: &mut [f64], sums: &mut [i64]) {
        match self {
            Self::Phasors(candidates) => {
                candidates.phasors_into(time, scratch);
                for (sum, phasor) in sums.iter_mut().zip(scratch) {
                    *sum += to_fixed(*phasor);
                }
            }
            Self::Bins(period, num_bins) => sums[bin(time, *period, *num_bins)] += 1,
            Self::Folded(candidates, k, num_bins) => {
                sums[bin_of_phase(phase(candidates, *k, time), *num_bins)] += 1;
            }
            Self::None => {}
        }
    }
}

/// The part of a period in which a time lies.
pub(super) fn bin(time: Time, period: Period, num_bins: usize) -> usize {
    bin_of_phase(time.phase(period), num_bins)
}

/// The phase of a time in candidate period k, in [0, 1).
pub(super) fn phase(candidates: &CandidatePeriods, k: usize, time: Time) -> f64 {
    match candidates.as_harmonic() {
        Some((base, _)) => {
            let turns = time.phase(base) * (k + 1) as f64;
            turns - turns.floor()
        }
        None => candidates
            .as_list()
            .get(k)
            .map_or(0.0, |period| time.phase(*period)),
    }
}

/// The part of a period in which a phase in [0, 1) lies.
pub(super) fn bin_of_phase(phase: f64, num_bins: usize) -> usize {
    ((phase * num_bins as f64) as usize).min(num_bins - 1)
}

/// Rounds a number of at most 2^10 to a multiple of 2^-40.
#[inline]
fn to_fixed(value: f64) -> i64 {
    // Adding 1.5 * 2^52 leaves the rounded integer in the low bits.
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    (value * ONE + MAGIC).to_bits() as i64 - MAGIC.to_bits() as i64
}

/// The sums over all times before each of a block of times.
#[derive(Debug)]
pub(super) struct Prefixes {
    width: usize,
    /// One row a time, and one behind the last.
    rows: Vec<i64>,
    first: usize,
}

impl Prefixes {
    /// Of no times yet.
    pub(super) fn new(columns: &Columns) -> Self {
        let width = columns.width();
        Self {
            width,
            rows: vec![0; width],
            first: 0,
        }
    }

    /// Goes on to the block of times behind the present one.
    pub(super) fn advance(&mut self, columns: &Columns, times_us: &[i64]) {
        let width = self.width;
        if width == 0 {
            return;
        }
        let last = self.rows.len() - width;
        self.first += last / width;
        self.rows.copy_within(last.., 0);
        self.rows.resize((times_us.len() + 1) * width, 0);
        let mut scratch = vec![0.0; width];
        for (i, &us) in times_us.iter().enumerate() {
            let (before, after) = self.rows.split_at_mut((i + 1) * width);
            let row = &mut after[..width];
            row.copy_from_slice(&before[i * width..]);
            columns.add(Time::from_us(us), &mut scratch, row);
        }
    }

    /// The sums over all times before the one with number `at`, which is in the block or the next
    /// one.
    #[inline]
    pub(super) fn before(&self, at: usize) -> &[i64] {
        let start = at.saturating_sub(self.first) * self.width;
        &self.rows[start..start + self.width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_do_not_show_in_prefix_sums() -> fremen::Result<()> {
        let times: Vec<i64> = (0..50).map(|i| i * i * 777_000_000).collect();
        let phasors = Columns::Phasors(CandidatePeriods::harmonic(Period::DAY, 7)?);
        for columns in [phasors, Columns::Bins(Period::DAY, 5)] {
            let mut whole = Prefixes::new(&columns);
            whole.advance(&columns, &times);
            let mut blocks = Prefixes::new(&columns);
            for (block, part) in times.chunks(17).enumerate() {
                blocks.advance(&columns, part);
                for at in block * 17..=block * 17 + part.len() {
                    assert_eq!(blocks.before(at), whole.before(at));
                }
            }
        }
        Ok(())
    }
}

//! At which samples is a prediction wrong?
//!
//! The outlier set O of T-RO III-B: intervals `[t_2k, t_2k+1)` of sample indices, kept as their
//! ascending limits and written as differences (delta encoding), one or two bytes a limit.

use super::codec::{Reader, Writer};
use crate::error::Result;

/// A set of sample indices made of few intervals.
///
/// Membership is O(log n) and the measure of an interval O(log n + limits inside) for n limits.
/// Not for sets that change from sample to sample: a limit costs 8 bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OutlierSet {
    /// Strictly ascending; the set begins at even and ends at odd places. Always an even number.
    limits: Vec<u64>,
}

impl OutlierSet {
    /// Starts and ends of the intervals, ascending.
    pub fn limits(&self) -> &[u64] {
        &self.limits
    }

    /// Whether sample `index` is in the set.
    pub fn contains(&self, index: u64) -> bool {
        self.limits.partition_point(|&limit| limit <= index) % 2 == 1
    }

    /// Adds an index behind all others.
    pub(crate) fn push(&mut self, index: u64) {
        self.push_interval(index, index + 1);
    }

    /// Adds the indices `[from, to)`, of which there is one at least, behind all others.
    pub(crate) fn push_interval(&mut self, from: u64, to: u64) {
        match self.limits.last_mut() {
            Some(end) if *end == from => *end = to,
            _ => self.limits.extend([from, to]),
        }
    }

    /// How many samples of `[from, to)` are in the set.
    pub fn measure(&self, from: u64, to: u64) -> u64 {
        let first = self.limits.partition_point(|&limit| limit <= from) / 2 * 2;
        (self.limits[first..].chunks_exact(2))
            .take_while(|interval| interval[0] < to)
            .map(|interval| interval[1].min(to).saturating_sub(interval[0].max(from)))
            .sum()
    }

    /// The intervals.
    pub fn intervals(&self) -> impl Iterator<Item = std::ops::Range<u64>> + '_ {
        self.limits.chunks_exact(2).map(|i| i[0]..i[1])
    }

    pub(crate) fn write(&self, writer: &mut Writer) {
        writer.varint(self.limits.len() as u64 / 2);
        let mut last = 0;
        for &limit in &self.limits {
            writer.varint(limit - last);
            last = limit;
        }
    }

    /// Limits of which none is above `len`.
    pub(crate) fn read(reader: &mut Reader<'_>, len: u64) -> Result<Self> {
        let count = reader.varint()?;
        if count > reader.rest().len() as u64 {
            return Err(reader.impossible("more intervals than bytes"));
        }
        let mut limits = Vec::with_capacity(2 * count as usize);
        let mut last = 0_u64;
        for i in 0..2 * count {
            let step = reader.varint()?;
            last = last.saturating_add(step);
            if last > len || (i > 0 && step == 0) {
                return Err(reader.impossible("an interval is empty or beyond the end"));
            }
            limits.push(last);
        }
        Ok(Self { limits })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measures_what_it_contains() {
        let inside = [0, 1, 2, 7, 8, 20];
        let mut set = OutlierSet::default();
        set.push_interval(0, 2);
        for index in &inside[2..] {
            set.push(*index);
        }
        assert_eq!(set.limits(), [0, 3, 7, 9, 20, 21]);
        for from in 0..25 {
            assert_eq!(set.contains(from), inside.contains(&from));
            for to in from..25 {
                let expected = inside.iter().filter(|i| (from..to).contains(i)).count();
                assert_eq!(set.measure(from, to), expected as u64, "{from}..{to}");
            }
        }
    }
}

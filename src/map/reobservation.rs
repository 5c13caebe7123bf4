//! How do features that are seen again differ from when they were learnt?
//!
//! Each time a visit is recognised, the distances of the descriptors that were seen again and the
//! camera's displacement are counted here. These sums say what a true match looks like; they are
//! part of a snapshot as the attachment `reobservation`.
//!
//! Each map counts for itself, under its UUID. Where maps are merged, all their counts are kept
//! side by side, and of two counts under one UUID the larger one of each number: so merging twice
//! counts nothing twice, and neither order nor grouping matter. (Of two copies of one map that
//! learnt on separately, the fewer of what they counted since is lost.)
//!
//! Bytes of the attachment: 257 + 128 + 128 little-endian `u64` (distances 0 to 256 bits; then
//! horizontal and vertical displacements in parts of [`PART_PX`], the last part open). Where others
//! than the map itself have counted: for each, in order of UUID, the 16 bytes of the UUID and then
//! these numbers.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::snapshot::Snapshot;
use fremen::error::{Error, ErrorKind, Result};

/// The attachment's name.
const NAME: &str = "reobservation";
/// Width of a part of a displacement's histogram, px.
const PART_PX: f64 = 4.0;
const NUM_PARTS: usize = 128;
const NUM_DISTANCES: usize = 257;
const NUM_COUNTS: usize = NUM_DISTANCES + 2 * NUM_PARTS;
const COUNTS_BYTES: usize = 8 * NUM_COUNTS;
const UUID_BYTES: usize = 16;

/// Distances, then parts of |dx|, then of |dy|.
type Counts = [u64; NUM_COUNTS];

/// Counts over all recognised visits of a map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reobservation {
    /// The map that counts.
    own: u128,
    /// By UUID of the map that has counted.
    counts: BTreeMap<u128, Box<Counts>>,
    total: Box<Counts>,
}

impl Reobservation {
    /// Nothing counted yet by the map with this UUID.
    pub fn new(own: u128) -> Self {
        Self {
            own,
            counts: BTreeMap::new(),
            total: Box::new([0; NUM_COUNTS]),
        }
    }

    /// What `snapshot` knows; nothing, if nothing was counted.
    ///
    /// Fails with [`ErrorKind::Format`] if the attachment has another length.
    pub fn of(snapshot: &Snapshot) -> Result<Self> {
        let own = snapshot.meta.uuid;
        match snapshot.attachments.get(NAME) {
            Some(bytes) => Self::decode(own, bytes),
            None => Ok(Self::new(own)),
        }
    }

    /// Makes it part of `snapshot`, if anything was counted.
    pub fn attach(&self, snapshot: &mut Snapshot) {
        if !self.counts.is_empty() {
            let bytes = Arc::from(self.encode(snapshot.meta.uuid));
            snapshot.attachments.insert(NAME.into(), bytes);
        }
    }

    /// Adds what a map of the same UUID has counted at other visits: a part of one map.
    pub fn add(&mut self, other: &Self) {
        for (&uuid, theirs) in &other.counts {
            let ours = (self.counts.entry(uuid)).or_insert_with(|| Box::new([0; NUM_COUNTS]));
            for (ours, &theirs) in ours.iter_mut().zip(theirs.iter()) {
                *ours = ours.saturating_add(theirs);
            }
        }
        self.add_up();
    }

    /// Adds what `other` has counted, for the map with the smaller UUID of the two.
    pub fn merge(&mut self, other: &Self) {
        self.own = self.own.min(other.own);
        for (&uuid, theirs) in &other.counts {
            let ours = (self.counts.entry(uuid)).or_insert_with(|| Box::new([0; NUM_COUNTS]));
            for (ours, &theirs) in ours.iter_mut().zip(theirs.iter()) {
                *ours = theirs.max(*ours);
            }
        }
        self.add_up();
    }

    fn add_up(&mut self) {
        self.total.fill(0);
        for counts in self.counts.values() {
            for (total, &count) in self.total.iter_mut().zip(counts.iter()) {
                *total = total.saturating_add(count);
            }
        }
    }

    fn count(&mut self, at: usize) {
        let own = (self.counts.entry(self.own)).or_insert_with(|| Box::new([0; NUM_COUNTS]));
        own[at] = own[at].saturating_add(1);
        self.total[at] = self.total[at].saturating_add(1);
    }

    /// Counts one feature that was seen again.
    pub fn count_distance(&mut self, distance_bits: u16) {
        self.count(usize::from(distance_bits).min(NUM_DISTANCES - 1));
    }

    /// Counts the displacement of one recognised visit.
    pub fn count_displacement(&mut self, dx_px: f64, dy_px: f64) {
        for (start, px) in [(NUM_DISTANCES, dx_px), (NUM_DISTANCES + NUM_PARTS, dy_px)] {
            // The cast saturates, and takes NaN for 0.
            self.count(start + ((px.abs() / PART_PX) as usize).min(NUM_PARTS - 1));
        }
    }

    /// How often a feature was seen again at each distance, 0 to 256 bits.
    pub fn distances(&self) -> &[u64] {
        &self.total[..NUM_DISTANCES]
    }

    /// Counts of |dx| and of |dy|.
    fn displacements(&self) -> (&[u64], &[u64]) {
        self.total[NUM_DISTANCES..].split_at(NUM_PARTS)
    }

    /// How many visits were recognised.
    pub fn num_displacements(&self) -> u64 {
        let counts = self.displacements().0.iter();
        counts.fold(0, |sum, &count| sum.saturating_add(count))
    }

    /// The spread of displacements, px: the upper end of the part in which two thirds of the
    /// horizontal ones, and of the vertical ones, are reached (one standard deviation of a normal
    /// distribution holds 68 %); `None` without recognised visits.
    pub fn spread_px(&self) -> Option<(f64, f64)> {
        let total = u128::from(self.num_displacements());
        let spread = |parts: &[u64]| {
            let mut sum = 0;
            let reached = parts.iter().position(|&count| {
                sum += u128::from(count);
                3 * sum >= 2 * total
            });
            (reached.unwrap_or(NUM_PARTS - 1) + 1) as f64 * PART_PX
        };
        let (dx, dy) = self.displacements();
        (total > 0).then(|| (spread(dx), spread(dy)))
    }

    fn encode(&self, own: u128) -> Vec<u8> {
        let is_own_only = self.counts.keys().all(|&uuid| uuid == own);
        let mut bytes = Vec::with_capacity(self.counts.len() * (UUID_BYTES + COUNTS_BYTES));
        for (uuid, counts) in &self.counts {
            if !is_own_only {
                bytes.extend(uuid.to_be_bytes());
            }
            bytes.extend(counts.iter().flat_map(|count| count.to_le_bytes()));
        }
        bytes
    }

    fn decode(own: u128, bytes: &[u8]) -> Result<Self> {
        let mut found = Self::new(own);
        let counts = |bytes: &[u8]| {
            let (words, _) = bytes.as_chunks::<8>();
            let mut counts = Box::new([0; NUM_COUNTS]);
            for (count, word) in counts.iter_mut().zip(words) {
                *count = u64::from_le_bytes(*word);
            }
            counts
        };
        if bytes.len() == COUNTS_BYTES {
            found.counts.insert(own, counts(bytes));
        } else if bytes.len().is_multiple_of(UUID_BYTES + COUNTS_BYTES) {
            for part in bytes.chunks(UUID_BYTES + COUNTS_BYTES) {
                let (uuid, part) = part.split_at(UUID_BYTES);
                let uuid = uuid
                    .iter()
                    .fold(0, |uuid, &byte| uuid << 8 | u128::from(byte));
                found.counts.insert(uuid, counts(part));
            }
        } else {
            return Err(Error::new(
                ErrorKind::Format,
                format!(
                    "the attachment `{NAME}` has {} bytes instead of {COUNTS_BYTES}",
                    bytes.len(),
                ),
            )
            .with_help("build the map again from its images"));
        }
        found.add_up();
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_survive_the_attachment() {
        let mut counted = Reobservation::new(7);
        counted.count_distance(0);
        counted.count_distance(256);
        counted.count_displacement(-9.0, f64::NAN);
        let back = |own, counted: &Reobservation| {
            Reobservation::decode(own, &counted.encode(own)).expect("own bytes")
        };
        assert_eq!(back(7, &counted), counted);
        let mut other = Reobservation::new(9);
        other.count_distance(0);
        counted.merge(&other);
        assert_eq!(back(7, &counted), counted);
        assert_eq!(counted.distances()[0], 2);
        let error = Reobservation::decode(7, &[0; 9]).expect_err("too short");
        assert!(error.to_string().contains("9 bytes"), "{error}");
    }

    #[test]
    fn what_is_merged_again_is_not_counted_again() {
        let counted = |own, distances: &[u16]| {
            let mut counted = Reobservation::new(own);
            for &distance_bits in distances {
                counted.count_distance(distance_bits);
            }
            counted
        };
        let merged = |a: &Reobservation, b: &Reobservation| {
            let mut merged = a.clone();
            merged.merge(b);
            merged
        };
        let (a, b, c) = (
            counted(3, &[1, 2]),
            counted(2, &[1]),
            counted(3, &[2, 2, 9]),
        );
        let ab = merged(&a, &b);
        assert_eq!(ab.distances()[1], 2);
        assert_eq!(merged(&ab, &a), ab);
        assert_eq!(ab, merged(&b, &a));
        assert_eq!(merged(&ab, &c), merged(&a, &merged(&b, &c)));
    }

    #[test]
    fn two_thirds_of_the_displacements_lie_within_the_spread() {
        let mut counted = Reobservation::new(1);
        assert_eq!(counted.spread_px(), None);
        for dx in [1.0, -6.0, 100.0] {
            counted.count_displacement(dx, 0.0);
        }
        assert_eq!(counted.spread_px(), Some((8.0, 4.0)));
    }
}

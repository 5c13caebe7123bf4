//! How do features that are seen again differ from when they were learnt?
//!
//! Each time a visit is recognised, the distances of the descriptors that were seen again and the
//! camera's displacement are counted here. These sums say what a true match looks like; they are part
//! of a snapshot as the attachment `reobservation`, and add up when maps are merged.
//!
//! Bytes of the attachment: 257 + 128 + 128 little-endian `u64` (distances 0 to 256 bits; |dx|, then
//! |dy| in parts of [`PART_PX`], the last part open).

use std::sync::Arc;

use super::types::Snapshot;
use crate::error::{Error, ErrorKind, Result};

/// The attachment's name.
const NAME: &str = "reobservation";
/// Width of a part of a displacement's histogram, px.
const PART_PX: f64 = 4.0;
const NUM_PARTS: usize = 128;
const NUM_DISTANCES: usize = 257;

/// Counts over all recognised visits of a map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reobservation {
    distances: Vec<u64>,
    dx: Vec<u64>,
    dy: Vec<u64>,
}

impl Default for Reobservation {
    fn default() -> Self {
        Self {
            distances: vec![0; NUM_DISTANCES],
            dx: vec![0; NUM_PARTS],
            dy: vec![0; NUM_PARTS],
        }
    }
}

impl Reobservation {
    /// What `snapshot` knows; nothing, if nothing was counted.
    ///
    /// Fails with [`ErrorKind::Format`] if the attachment has another length.
    pub fn of(snapshot: &Snapshot) -> Result<Self> {
        match snapshot.attachments.get(NAME) {
            Some(bytes) => Self::decode(bytes),
            None => Ok(Self::default()),
        }
    }

    /// Makes it part of `snapshot`.
    pub fn attach(&self, snapshot: &mut Snapshot) {
        snapshot
            .attachments
            .insert(NAME.into(), Arc::from(self.encode()));
    }

    /// Counts one feature that was seen again.
    pub fn count_distance(&mut self, distance_bits: u16) {
        self.distances[usize::from(distance_bits).min(NUM_DISTANCES - 1)] += 1;
    }

    /// Counts the displacement of one recognised visit.
    pub fn count_displacement(&mut self, dx_px: f64, dy_px: f64) {
        for (parts, px) in [(&mut self.dx, dx_px), (&mut self.dy, dy_px)] {
            // The cast saturates, and takes NaN for 0.
            parts[((px.abs() / PART_PX) as usize).min(NUM_PARTS - 1)] += 1;
        }
    }

    /// How often a feature was seen again at each distance, 0 to 256 bits.
    pub fn distances(&self) -> &[u64] {
        &self.distances
    }

    /// How many visits were recognised.
    pub fn num_displacements(&self) -> u64 {
        self.dx.iter().sum()
    }

    /// The spread of displacements, px: the upper end of the part in which two thirds of |dx|, and of
    /// |dy|, are reached (one standard deviation of a normal distribution holds 68 %); `None` without
    /// recognised visits.
    pub fn spread_px(&self) -> Option<(f64, f64)> {
        let total = self.num_displacements();
        let spread = |parts: &[u64]| {
            let mut sum = 0;
            let reached = parts.iter().position(|&count| {
                sum += count;
                3 * sum >= 2 * total
            });
            (reached.unwrap_or(NUM_PARTS - 1) + 1) as f64 * PART_PX
        };
        (total > 0).then(|| (spread(&self.dx), spread(&self.dy)))
    }

    fn encode(&self) -> Vec<u8> {
        [&self.distances, &self.dx, &self.dy]
            .into_iter()
            .flatten()
            .flat_map(|count| count.to_le_bytes())
            .collect()
    }

    fn decode(bytes: &[u8]) -> Result<Self> {
        let (words, rest) = bytes.as_chunks::<8>();
        if !rest.is_empty() || words.len() != NUM_DISTANCES + 2 * NUM_PARTS {
            return Err(Error::new(
                ErrorKind::Format,
                format!(
                    "the attachment `{NAME}` has {} bytes instead of {}",
                    bytes.len(),
                    8 * (NUM_DISTANCES + 2 * NUM_PARTS)
                ),
            )
            .with_help("build the map again from its images"));
        }
        let mut counts = words.iter().map(|word| u64::from_le_bytes(*word));
        let mut take = |len: usize| counts.by_ref().take(len).collect();
        Ok(Self {
            distances: take(NUM_DISTANCES),
            dx: take(NUM_PARTS),
            dy: take(NUM_PARTS),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_survive_the_attachment() {
        let mut counted = Reobservation::default();
        counted.count_distance(0);
        counted.count_distance(256);
        counted.count_displacement(-9.0, f64::NAN);
        assert_eq!(
            Reobservation::decode(&counted.encode()).expect("own bytes"),
            counted
        );
        let error = Reobservation::decode(&[0; 9]).expect_err("too short");
        assert!(error.to_string().contains("9 bytes"), "{error}");
    }

    #[test]
    fn two_thirds_of_the_displacements_lie_within_the_spread() {
        let mut counted = Reobservation::default();
        assert_eq!(counted.spread_px(), None);
        for dx in [1.0, -6.0, 100.0] {
            counted.count_displacement(dx, 0.0);
        }
        assert_eq!(counted.spread_px(), Some((8.0, 4.0)));
    }
}

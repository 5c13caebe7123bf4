//! What is written down of a commit?

use chronotope_store::Fault;

use super::tables::MAP;
use crate::map::digest::ContentDigest;
use fremen::time::Time;

/// One row of table `generation`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Generation {
    /// Counted from 0, the empty map.
    pub number: u64,
    /// The generation that this one extends; `None` for 0.
    pub parent: Option<u64>,
    pub(super) prunes: u64,
    /// When it was committed.
    pub time: Time,
    /// Places after it.
    pub num_places: usize,
    /// Visits after it.
    pub num_visits: usize,
    /// Features after it, without those of appearances.
    pub num_features: usize,
    /// [`Snapshot::digest`](crate::map::Snapshot::digest) after it.
    pub digest: ContentDigest,
    pub(super) meta: u64,
    pub(super) edges: u64,
}

impl Generation {
    /// What the store has read.
    pub(super) fn of(stored: &chronotope_store::Generation) -> Self {
        // In the order of their columns.
        let note = |at: usize| stored.notes.get(at).copied().unwrap_or_default();
        Self {
            number: stored.number,
            parent: stored.parent,
            prunes: stored.prunes,
            time: Time::from_us(stored.time_us),
            meta: note(0),
            edges: note(1),
            num_places: note(2) as usize,
            num_visits: note(3) as usize,
            num_features: note(4) as usize,
            digest: stored.digest,
        }
    }

    /// What the store writes.
    pub(super) fn to_stored(&self) -> chronotope_store::Generation {
        chronotope_store::Generation {
            number: self.number,
            parent: self.parent,
            prunes: self.prunes,
            time_us: self.time.as_us(),
            notes: vec![
                self.meta,
                self.edges,
                self.num_places as u64,
                self.num_visits as u64,
                self.num_features as u64,
            ],
            digest: self.digest,
        }
    }

    /// Whether the rows give what was written down at the commit.
    pub(super) fn compare(&self, found: &Self) -> Result<(), Fault> {
        let notes = [
            ("meta", found.meta),
            ("num_places", found.num_places as u64),
            ("num_visits", found.num_visits as u64),
            ("num_features", found.num_features as u64),
        ];
        self.to_stored().compare(&MAP, &notes, &found.digest)
    }
}

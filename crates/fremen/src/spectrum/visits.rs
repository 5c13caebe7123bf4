//! How are sums merged that may share visits?
//!
//! Sums alone cannot tell whether two of them hold the same visit. [`VisitSums`] remembers who gave
//! what: each observation has an identity of 128 bits (a map's visit has one), and is counted once
//! however often and from whichever side it comes. So merging is commutative, associative *and
//! idempotent*, and what is older than a horizon can be forgotten exactly.
//!
//! O(K + log n) to add, O(n (K + log n)) to merge n observations; 40 bytes an observation beside
//! the sums. Not for whole maps, whose features share visits: there the log is merged, and
//! everything fitted from it again.

use std::collections::BTreeMap;

use super::candidates::CandidatePeriods;
use super::sums::SpectralSums;
use crate::error::{Error, ErrorKind, Result};
use crate::time::Time;

/// The sums of one state with the observations in them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VisitSums {
    sums: SpectralSums,
    observations: BTreeMap<u128, (Time, bool)>,
}

impl VisitSums {
    /// No observations.
    pub fn new(candidates: CandidatePeriods) -> Self {
        Self {
            sums: SpectralSums::new(candidates),
            observations: BTreeMap::new(),
        }
    }

    /// The sums of every observation, each counted once.
    pub fn sums(&self) -> &SpectralSums {
        &self.sums
    }

    /// Adds the observation of a visit and returns whether it is new; one that is known changes
    /// nothing. Fails if the visit is known with another time or state: then an identity was given
    /// twice.
    pub fn add(&mut self, visit: u128, time: Time, state: bool) -> Result<bool> {
        match self.observations.get(&visit) {
            Some(known) if *known == (time, state) => Ok(false),
            Some(known) => Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "visit {visit:032x} is known with state {} at {}, not {} at {time}",
                    u8::from(known.1),
                    known.0,
                    u8::from(state)
                ),
            )
            .with_help("give every visit an identity of its own")),
            None => {
                self.sums.add(time, state)?;
                self.observations.insert(visit, (time, state));
                Ok(true)
            }
        }
    }

    /// Adds what `other` has and this has not. Where it fails, nothing has changed.
    pub fn merge(&mut self, other: &Self) -> Result<()> {
        let mut merged = self.clone();
        // Other candidates are refused also where there is nothing to add.
        merged
            .sums
            .merge(&SpectralSums::new(other.sums.candidates().clone()))?;
        for (&visit, &(time, state)) in &other.observations {
            merged.add(visit, time, state)?;
        }
        *self = merged;
        Ok(())
    }

    /// Forgets every observation before `horizon`, as if it had never been, and returns how many
    /// there were.
    pub fn forget_before(&mut self, horizon: Time) -> Result<usize> {
        let mut old = SpectralSums::new(self.sums.candidates().clone());
        for (time, state) in self
            .observations
            .values()
            .filter(|(time, _)| *time < horizon)
        {
            old.add(*time, *state)?;
        }
        self.sums.subtract(&old)?;
        self.observations.retain(|_, (time, _)| *time >= horizon);
        Ok(old.num_observed())
    }
}

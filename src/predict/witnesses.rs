//! Which past visits can vouch for a feature?
//!
//! Features of a place do not appear independently: those of its snowy visits come together, those of
//! its nights do. [`Witnesses`] keeps, for at most 64 visits of a place, which features each saw, as one
//! word a feature; that is what a covering choice and a mixture over past appearances need to know of
//! the log.
//!
//! The visits are spread evenly over the place's visits in order of arrival, the middle one of each of
//! up to 64 equal runs. Cost: O(features + visits x features / 64), 8 bytes a feature.
//!
//! Not for histories: times are not kept.

use crate::error::Result;
use crate::visibility::{HistoryLog, Visits};

/// What some visits of one place saw.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Witnesses {
    seen: Vec<u64>,
    num_visits: usize,
}

impl Witnesses {
    /// No place has more.
    pub const MAX_VISITS: usize = 64;

    /// Of the given visits of `log`; fails if their mask does not fit.
    pub fn of(log: &HistoryLog, visits: Visits<'_>) -> Result<Self> {
        let visits = visits.of(log)?;
        let count = visits.len().min(Self::MAX_VISITS);
        let mut seen = vec![0; log.num_features()];
        for bit in 0..count {
            let visit = visits[(2 * bit + 1) * visits.len() / (2 * count)];
            for feature in log.seen_row(visit).ones() {
                seen[feature] |= 1 << bit;
            }
        }
        Ok(Self {
            seen,
            num_visits: count,
        })
    }

    /// How many visits testify.
    pub fn num_visits(&self) -> usize {
        self.num_visits
    }

    /// For each feature of the place, one bit a visit: whether it was seen there.
    pub fn seen(&self) -> &[u64] {
        &self.seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Time;
    use crate::visibility::BitRow;

    fn log(num_visits: usize) -> HistoryLog {
        let mut log = HistoryLog::new();
        for visit in 0..num_visits {
            // Feature f is seen at visit f only.
            let mut seen = BitRow::zeros(visit + 1);
            seen.set(visit);
            log.push_visit(Time::from_s(visit as i64), seen, None)
                .expect("fits");
        }
        log
    }

    #[test]
    fn few_visits_all_testify() {
        let witnesses = Witnesses::of(&log(3), Visits::All).expect("fits");
        assert_eq!(witnesses.num_visits(), 3);
        assert_eq!(witnesses.seen(), [0b001, 0b010, 0b100]);
    }

    #[test]
    fn of_many_visits_64_testify_evenly_spread() {
        let witnesses = Witnesses::of(&log(640), Visits::All).expect("fits");
        assert_eq!(witnesses.num_visits(), 64);
        let chosen: Vec<usize> = (0..640).filter(|&f| witnesses.seen()[f] != 0).collect();
        assert_eq!(chosen.len(), 64);
        assert!(chosen.windows(2).all(|pair| pair[1] - pair[0] == 10));
    }

    #[test]
    fn visits_left_out_do_not_testify() {
        let mut mask = BitRow::zeros(3);
        mask.set(2);
        let witnesses = Witnesses::of(&log(3), Visits::Only(&mask)).expect("fits");
        assert_eq!(witnesses.seen(), [0, 0, 1]);
    }
}

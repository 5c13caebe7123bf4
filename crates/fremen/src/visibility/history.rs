//! The three-valued log of what was seen when: the source of truth of every temporal model.

use crate::error::{Error, ErrorKind, Result};
use crate::time::Time;

/// What one visit says of one feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FeatureState {
    /// It was matched.
    Seen,
    /// It could have been matched and was not.
    NotSeen,
    /// Nothing can be said: masked, outside the view, black image.
    NotObservable,
}

/// A row of bits, one a feature; bits at and beyond [`len`](Self::len) are zero.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BitRow {
    words: Vec<u64>,
    len: usize,
}

impl BitRow {
    /// `len` zero bits.
    pub fn zeros(len: usize) -> Self {
        Self {
            words: vec![0; len.div_ceil(64)],
            len,
        }
    }

    /// From little-endian words; surplus bits must be zero.
    pub fn from_words(words: Vec<u64>, len: usize) -> Result<Self> {
        let surplus_is_zero = match (words.last(), len % 64) {
            (Some(last), tail) if tail > 0 => last >> tail == 0,
            _ => true,
        };
        if words.len() == len.div_ceil(64) && surplus_is_zero {
            Ok(Self { words, len })
        } else {
            Err(Error::new(
                ErrorKind::Shape,
                format!("{} words are no row of {len} bits", words.len()),
            ))
        }
    }

    /// Bits in the row.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether the row has no bits.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The bits in words of 64, lowest first.
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// Bit `i`; false beyond the end.
    pub fn get(&self, i: usize) -> bool {
        i < self.len && self.words[i / 64] >> (i % 64) & 1 == 1
    }

    /// Sets bit `i`.
    ///
    /// # Panics
    /// If `i` is not below [`len`](Self::len).
    pub fn set(&mut self, i: usize) {
        assert!(i < self.len, "bit {i} of a row of {}", self.len);
        self.words[i / 64] |= 1 << (i % 64);
    }

    /// How many bits are one.
    pub fn count_ones(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// The indices of the one bits, ascending.
    pub fn ones(&self) -> impl Iterator<Item = usize> + '_ {
        self.words.iter().enumerate().flat_map(|(w, &word)| {
            std::iter::successors((word != 0).then_some(word), |rest| {
                let rest = rest & (rest - 1);
                (rest != 0).then_some(rest)
            })
            .map(move |rest| w * 64 + rest.trailing_zeros() as usize)
        })
    }
}

/// Which feature of one place was seen at which of its visits.
///
/// Visits are in order of arrival (their times need not ascend), features in order of birth. A
/// visit's rows are as long as the place had features *after* it; a feature's bits of earlier
/// visits do not exist: it was not yet known ([`birth`](Self::birth)).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HistoryLog {
    times: Vec<Time>,
    seen: Vec<BitRow>,
    hidden: Vec<Option<BitRow>>,
    births: Vec<u32>,
}

impl HistoryLog {
    /// No visits, no features.
    pub fn new() -> Self {
        Self::default()
    }

    /// Of one state in order of arrival: a place with one feature. Without any, the feature is there
    /// and nothing is known of it.
    ///
    /// Fails beyond 2^32 states.
    pub fn of_states(states: impl IntoIterator<Item = (Time, bool)>) -> Result<Self> {
        let one_bit = |is_set: bool| {
            let mut row = BitRow::zeros(1);
            if is_set {
                row.set(0);
            }
            row
        };
        let mut log = Self::new();
        for (time, state) in states {
            log.push_visit(time, one_bit(state), None)?;
        }
        if log.num_visits() == 0 {
            log.push_visit(Time::default(), one_bit(false), Some(one_bit(true)))?;
        }
        Ok(log)
    }

    /// Appends a visit: `seen` has one bit for each feature known after it, so `seen.len()` minus
    /// [`num_features`](Self::num_features) new features are born here; `hidden`, where given, is
    /// as long and marks what could not be observed (never a feature that is also seen).
    pub fn push_visit(&mut self, time: Time, seen: BitRow, hidden: Option<BitRow>) -> Result<()> {
        let shape = |message: String| Error::new(ErrorKind::Shape, message);
        if seen.len() < self.births.len() {
            return Err(shape(format!(
                "a visit of {} bits does not cover the {} known features",
                seen.len(),
                self.births.len()
            )));
        }
        if let Some(hidden) = &hidden {
            if hidden.len() != seen.len() {
                return Err(shape(format!(
                    "{} hidden bits do not pair with {} seen bits",
                    hidden.len(),
                    seen.len()
                )));
            }
            if seen
                .words()
                .iter()
                .zip(hidden.words())
                .any(|(s, h)| s & h != 0)
            {
                return Err(shape("a feature is both seen and not observable".into()));
            }
        }
        let visit = u32::try_from(self.times.len())
            .map_err(|_| shape("a place holds at most 2^32 visits".into()))?;
        self.births.resize(seen.len(), visit);
        self.times.push(time);
        self.seen.push(seen);
        self.hidden.push(hidden);
        Ok(())
    }

    /// What the log was when it had only its first `num_visits` visits: all of it, if it has fewer.
    #[must_use]
    pub fn first(&self, num_visits: usize) -> Self {
        let num_visits = num_visits.min(self.num_visits());
        let num_features = self.seen[..num_visits].last().map_or(0, BitRow::len);
        Self {
            times: self.times[..num_visits].to_vec(),
            seen: self.seen[..num_visits].to_vec(),
            hidden: self.hidden[..num_visits].to_vec(),
            births: self.births[..num_features].to_vec(),
        }
    }

    /// Visits.
    pub fn num_visits(&self) -> usize {
        self.times.len()
    }

    /// Features.
    pub fn num_features(&self) -> usize {
        self.births.len()
    }

    /// The time of each visit, in order of arrival.
    pub fn times(&self) -> &[Time] {
        &self.times
    }

    /// The same visits at the times of another clock.
    #[must_use]
    pub fn by_clock(&self, clock: impl Fn(Time) -> Time) -> Self {
        Self {
            times: self.times.iter().map(|&time| clock(time)).collect(),
            ..self.clone()
        }
    }

    /// The visit at which `feature` was first seen.
    ///
    /// # Panics
    /// If there is no such feature.
    pub fn birth(&self, feature: usize) -> usize {
        self.births[feature] as usize
    }

    /// The bits of what was seen at `visit`.
    ///
    /// # Panics
    /// If there is no such visit.
    pub fn seen_row(&self, visit: usize) -> &BitRow {
        &self.seen[visit]
    }

    /// The bits of what could not be observed at `visit`; `None` if everything could.
    ///
    /// # Panics
    /// If there is no such visit.
    pub fn hidden_row(&self, visit: usize) -> Option<&BitRow> {
        self.hidden[visit].as_ref()
    }

    /// What `visit` says of `feature`; `None` before its birth.
    pub fn state(&self, visit: usize, feature: usize) -> Option<FeatureState> {
        if feature >= self.seen[visit].len() {
            None
        } else if self.seen[visit].get(feature) {
            Some(FeatureState::Seen)
        } else if self.hidden[visit].as_ref().is_some_and(|h| h.get(feature)) {
            Some(FeatureState::NotObservable)
        } else {
            Some(FeatureState::NotSeen)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(len: usize, ones: &[usize]) -> BitRow {
        let mut row = BitRow::zeros(len);
        for &i in ones {
            row.set(i);
        }
        row
    }

    #[test]
    fn ones_gives_back_what_was_set() {
        let set = [0, 1, 63, 64, 130];
        assert_eq!(row(131, &set).ones().collect::<Vec<_>>(), set);
        assert_eq!(row(131, &[]).ones().count(), 0);
    }

    #[test]
    fn a_feature_has_no_observation_before_its_birth() {
        let mut log = HistoryLog::new();
        log.push_visit(Time::from_s(0), row(1, &[0]), None)
            .expect("fits");
        log.push_visit(Time::from_s(1), row(2, &[1]), Some(row(2, &[0])))
            .expect("fits");
        assert_eq!(log.state(0, 1), None);
        assert_eq!(log.state(1, 0), Some(FeatureState::NotObservable));
        assert_eq!(log.birth(1), 1);
    }

    #[test]
    fn rows_that_do_not_fit_are_refused() {
        let mut log = HistoryLog::new();
        log.push_visit(Time::from_s(0), row(2, &[0, 1]), None)
            .expect("fits");
        assert!(log.push_visit(Time::from_s(1), row(1, &[]), None).is_err());
        let both = log.push_visit(Time::from_s(1), row(2, &[0]), Some(row(2, &[0])));
        assert!(both.is_err());
        assert!(BitRow::from_words(vec![0b100], 2).is_err());
    }
}

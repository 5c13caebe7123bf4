//! What do the chosen visits say of each feature?

use super::config::BeforeBirth;
use super::{BitRow, HistoryLog};
use crate::spectrum::P_UNKNOWN;
use crate::time::Time;

/// Some visits of a log, read one way.
pub(super) struct Evidence<'a> {
    pub(super) log: &'a HistoryLog,
    /// Ascending, that is, in order of arrival.
    pub(super) visits: Vec<usize>,
    pub(super) before_birth: BeforeBirth,
}

/// How often each feature was seen and could have been seen.
pub(super) struct Counts {
    pub(super) seen: Vec<u32>,
    pub(super) observed: Vec<u32>,
}

impl Counts {
    pub(super) fn mean(&self, feature: usize) -> f64 {
        match self.observed[feature] {
            0 => P_UNKNOWN,
            observed => f64::from(self.seen[feature]) / f64::from(observed),
        }
    }

    pub(super) fn means(&self) -> Vec<f64> {
        (0..self.seen.len()).map(|f| self.mean(f)).collect()
    }
}

/// For each feature of a block, the visits (as indices into [`Evidence::visits`]) with its bit set.
pub(super) struct Lists {
    ends: Vec<usize>,
    indices: Vec<u32>,
}

impl Lists {
    /// The lists, feature by feature.
    pub(super) fn rows(&self) -> Vec<&[u32]> {
        let mut start = 0;
        let cut = |&end: &usize| &self.indices[std::mem::replace(&mut start, end)..end];
        self.ends.iter().map(cut).collect()
    }
}

impl<'a> Evidence<'a> {
    pub(super) fn num_features(&self) -> usize {
        self.log.num_features()
    }

    /// The same reading of other visits.
    pub(super) fn of_visits(&self, visits: Vec<usize>) -> Self {
        Self { visits, ..*self }
    }

    /// The times of the visits.
    pub(super) fn times(&self) -> impl ExactSizeIterator<Item = Time> {
        self.visits.iter().map(|&visit| self.log.times()[visit])
    }

    /// The visits in order of time; of equal times, in order of arrival.
    pub(super) fn by_time(&self) -> Vec<usize> {
        let mut by_time = self.visits.clone();
        by_time.sort_by_key(|&visit| (self.log.times()[visit], visit));
        by_time
    }

    /// Index into `visits` of the first at which `feature` counts.
    pub(super) fn first_visit(&self, feature: usize) -> usize {
        match self.before_birth {
            BeforeBirth::NotSeen => 0,
            BeforeBirth::NotObservable => {
                let birth = self.log.birth(feature);
                self.visits.partition_point(|&visit| visit < birth)
            }
        }
    }

    /// How many features, from the first, count at `visit`.
    pub(super) fn num_known(&self, visit: usize) -> usize {
        match self.before_birth {
            BeforeBirth::NotSeen => self.num_features(),
            BeforeBirth::NotObservable => self.log.seen_row(visit).len(),
        }
    }

    /// Calls `with(feature, state)` for every feature that could be observed at `visit`.
    pub(super) fn for_each_state(&self, visit: usize, mut with: impl FnMut(usize, bool)) {
        let seen = self.log.seen_row(visit);
        let hidden = self.log.hidden_row(visit);
        for feature in 0..self.num_known(visit) {
            if hidden.is_none_or(|hidden| !hidden.get(feature)) {
                with(feature, seen.get(feature));
            }
        }
    }

    pub(super) fn any_hidden(&self) -> bool {
        let hidden = |&visit: &usize| self.log.hidden_row(visit).is_some();
        self.visits.iter().any(hidden)
    }

    pub(super) fn counts(&self) -> Counts {
        let num_features = self.num_features();
        let mut counts = Counts {
            seen: vec![0; num_features],
            observed: (0..num_features)
                .map(|feature| (self.visits.len() - self.first_visit(feature)) as u32)
                .collect(),
        };
        for &visit in &self.visits {
            for feature in self.log.seen_row(visit).ones() {
                counts.seen[feature] += 1;
            }
            if let Some(hidden) = self.log.hidden_row(visit) {
                for feature in hidden.ones() {
                    counts.observed[feature] -= 1;
                }
            }
        }
        counts
    }

    /// When the features `first..last` were seen; `first` is a multiple of 64.
    pub(super) fn seen_lists(&self, first: usize, last: usize) -> Lists {
        self.lists(first, last, |visit| Some(self.log.seen_row(visit)))
    }

    /// When the features `first..last` could not be observed; `first` is a multiple of 64.
    pub(super) fn hidden_lists(&self, first: usize, last: usize) -> Lists {
        self.lists(first, last, |visit| self.log.hidden_row(visit))
    }

    fn lists(&self, first: usize, last: usize, row: impl Fn(usize) -> Option<&'a BitRow>) -> Lists {
        let mut ends = vec![0; last - first];
        self.for_each_one(first, last, &row, |feature, _| ends[feature] += 1);
        let mut next = Vec::with_capacity(ends.len());
        let mut total = 0;
        for end in &mut ends {
            next.push(total);
            total += *end;
            *end = total;
        }
        let mut indices = vec![0; total];
        self.for_each_one(first, last, &row, |feature, index| {
            indices[next[feature]] = index;
            next[feature] += 1;
        });
        Lists { ends, indices }
    }

    /// Calls `with(feature - first, index of the visit)` for every one bit of the features
    /// `first..last`, visit by visit.
    fn for_each_one(
        &self,
        first: usize,
        last: usize,
        row: impl Fn(usize) -> Option<&'a BitRow>,
        mut with: impl FnMut(usize, u32),
    ) {
        for (index, &visit) in self.visits.iter().enumerate() {
            let words = row(visit).map_or(&[][..], BitRow::words);
            let end = last.div_ceil(64).min(words.len());
            for (w, &word) in words.get(first / 64..end).into_iter().flatten().enumerate() {
                let mut rest = word;
                while rest != 0 {
                    with(w * 64 + rest.trailing_zeros() as usize, index as u32);
                    rest &= rest - 1;
                }
            }
        }
    }
}

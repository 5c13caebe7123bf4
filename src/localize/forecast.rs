//! What should be visible at every place now?
//!
//! Visibility changes over hours, images come ten a second. So time is cut into buckets, and
//! everything that depends on the time but not on the image is worked out once a bucket: which
//! features are predicted at each place, where they are, what they look like, and what each says if
//! it is matched or missing. All of it is laid out place after place, as matching reads it.
//!
//! A [`Forecast`] is always made for the *middle* of its bucket, so an answer depends on the bucket
//! of its time and never on earlier queries. [`Forecasts`] keeps the last two: now, and the
//! bucket to come ([`Localizer::prefetch`](super::Localizer::prefetch)) or just gone. They belong
//! to the localizer and not to each thread's [`Scratch`](super::Scratch), because in a large map a
//! forecast takes a second to make and over 100 bytes a predicted feature to hold; threads share it
//! behind an `Arc`. The lock is held to look it up, never while one is made: two threads that need
//! the same new forecast at the same moment both make it, and make the same. A localizer that goes
//! on with a newer map ([`Localizer::with_snapshot`](super::Localizer::with_snapshot)) copies what
//! has not changed and predicts the rest.
//!
//! Cost: what predicting costs, once a bucket; a lock and a reference count a query. Memory of a
//! forecast that nobody holds any more is used for the next one, so in a map of up to some hundred
//! places a thread alone allocates nothing once warm; a larger one is predicted on all threads,
//! each of which allocates its part.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::candidates::{Finder, PredictedPlaces, Shortlist, Voting};
use super::evidence::{Calibration, Expectation};
use super::plan::{Plan, PlannedMap};
use crate::feature::{Features, FeaturesView};
use crate::map::NodeId;
use crate::matching::SearchScratch;
use crate::predict::PredictedMap;
use fremen::time::Time;

/// Forecasts that are kept: now and next.
const NUM_KEPT: usize = 2;
/// Places that one thread predicts at a time.
const PLACES_PER_TASK: usize = 64;
/// From so many places on an image that comes first in its bucket waits for the threads of the pool
/// and not for one: a thousand places take a tenth of a second.
const MIN_SHARED: usize = 512;

/// What forecasts are made from.
#[derive(Clone, Copy, Debug)]
pub(super) struct ForecastSource<'a> {
    pub(super) map: &'a PlannedMap,
    pub(super) calibration: Option<&'a Calibration>,
    pub(super) finder: &'a Finder,
}

/// The predicted maps of all places at one time.
#[derive(Clone, Debug, Default)]
pub(super) struct Forecast {
    time: Time,
    /// Where the features of each place end.
    ends: Vec<usize>,
    /// Ids within the place.
    ids: Vec<u32>,
    probabilities: Vec<f64>,
    features: Features,
    /// What they would say, place by place; empty without calibration.
    expectations: Vec<Expectation>,
    /// Their words, and the places that these vote for, where candidates are found so.
    words: Vec<u32>,
    voting: Option<Voting>,
}

impl Forecast {
    /// Where the features of a place are among those of all.
    fn rows(&self, node: usize) -> Range<usize> {
        let start = node.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[node]
    }

    /// Ids within the place of its predicted features, in order of choice.
    pub(super) fn ids(&self, node: NodeId) -> &[u32] {
        &self.ids[self.rows(node.0 as usize)]
    }

    /// p(t) of each.
    pub(super) fn probabilities(&self, node: NodeId) -> &[f64] {
        &self.probabilities[self.rows(node.0 as usize)]
    }

    /// The predicted features of a place.
    pub(super) fn features(&self, node: NodeId) -> FeaturesView<'_> {
        self.features.view().rows(self.rows(node.0 as usize))
    }

    /// The predicted features of all places one after the other, and where each place's end.
    pub(super) fn all_features(&self) -> (FeaturesView<'_>, &[usize]) {
        (self.features.view(), &self.ends)
    }

    /// What the features of a place say; `None` without calibration.
    pub(super) fn expectation(&self, node: NodeId) -> Option<&Expectation> {
        self.expectations.get(node.0 as usize)
    }

    /// Where candidates are found; `None` if every place is one.
    pub(super) fn shortlist<'a>(&'a self, finder: &'a Finder) -> Option<&'a dyn Shortlist> {
        match finder {
            Finder::Exact => None,
            Finder::Inverted(_) => self.voting.as_ref().map(|voting| voting as _),
            #[cfg(feature = "hnsw")]
            Finder::Words(signatures) => Some(signatures.as_ref() as _),
        }
    }

    /// Gathers the predicted features of some places, and where each place's end.
    pub(super) fn gather_into(
        &self,
        places: &[u32],
        features: &mut Features,
        ends: &mut Vec<usize>,
    ) {
        features.truncate(0);
        ends.clear();
        for &place in places {
            features.append_view(self.features(NodeId(place)));
            ends.push(features.len());
        }
    }

    /// Predicts the given places, in place of what was there.
    fn make(
        &mut self,
        source: ForecastSource<'_>,
        predicted: &mut PredictedMap,
        time: Time,
        nodes: Range<usize>,
    ) {
        self.time = time;
        self.ends.clear();
        self.ids.clear();
        self.probabilities.clear();
        self.features.truncate(0);
        let ForecastSource {
            map,
            calibration,
            finder,
        } = source;
        let num_expected = calibration.map_or(0, |_| nodes.len());
        (self.expectations).resize_with(num_expected, Expectation::default);
        for (index, node) in nodes.enumerate() {
            if let Plan::Predicted { model, references } = map.plans[node].as_ref() {
                let selection = map.cfg.selection();
                map.choose(predicted, model.as_ref(), references, time, selection);
                let id = NodeId(node as u32);
                (self.ids).extend_from_slice(predicted.features());
                (self.probabilities).extend_from_slice(predicted.probabilities());
                (self.features).append(map.snapshot.node(id).features(), predicted.features());
                if let Some(calibration) = calibration {
                    let expectation = &mut self.expectations[index];
                    expectation.expect_predicted(calibration, id, predicted, references);
                    expectation.finalize(predicted.len());
                }
            }
            self.ends.push(self.ids.len());
        }
        self.words.clear();
        self.voting = None;
        if let Finder::Inverted(words) = finder {
            let scratch = &mut SearchScratch::default();
            words.words_into(scratch, self.features.descriptors(), &mut self.words);
        }
    }

    /// Lets features vote, once all places are there.
    fn let_vote(&mut self, source: ForecastSource<'_>) {
        if let Finder::Inverted(words) = source.finder
            && !words.is_empty()
        {
            let places = PredictedPlaces {
                features: self.features.view(),
                ends: &self.ends,
                expectations: &self.expectations,
            };
            let (cfg, calibration) = (&source.map.cfg, source.calibration);
            let voting = Voting::of(cfg, calibration, places, words, &self.words);
            self.voting = Some(voting);
        }
    }

    /// The same for a newer map: places that changed are predicted again, all others copied.
    ///
    /// O(places that changed), but for copying.
    fn with_snapshot(&self, source: ForecastSource<'_>, is_same: &[bool]) -> Self {
        let time = self.time;
        let changed: Vec<usize> = (0..is_same.len()).filter(|&node| !is_same[node]).collect();
        let parts: Vec<Self> = (changed.par_iter())
            .map_init(PredictedMap::new, |predicted, &node| {
                let mut part = Self::default();
                part.make(source, predicted, time, node..node + 1);
                part
            })
            .collect();
        let mut newer = Self {
            time,
            ..Self::default()
        };
        let mut first = 0;
        for (&node, part) in changed.iter().zip(parts) {
            newer.append_places(self, first..node);
            newer.append(part);
            first = node + 1;
        }
        newer.append_places(self, first..is_same.len());
        newer.let_vote(source);
        newer
    }

    /// Puts some places of `other` behind its own.
    fn append_places(&mut self, other: &Self, nodes: Range<usize>) {
        if nodes.is_empty() {
            return;
        }
        let rows = other.rows(nodes.start).start..other.rows(nodes.end - 1).end;
        let (start, moved) = (self.ids.len(), rows.start);
        (self.ends).extend(
            other.ends[nodes.clone()]
                .iter()
                .map(|end| end + start - moved),
        );
        self.ids.extend_from_slice(&other.ids[rows.clone()]);
        (self.probabilities).extend_from_slice(&other.probabilities[rows.clone()]);
        (self.features).append_view(other.features.view().rows(rows.clone()));
        if !other.expectations.is_empty() {
            (self.expectations).extend_from_slice(&other.expectations[nodes]);
        }
        if !other.words.is_empty() {
            self.words.extend_from_slice(&other.words[rows]);
        }
    }

    /// Puts the places of `next` behind its own.
    fn append(&mut self, next: Self) {
        let start = self.ids.len();
        self.ends.extend(next.ends.iter().map(|end| start + end));
        self.ids.extend_from_slice(&next.ids);
        self.probabilities.extend_from_slice(&next.probabilities);
        self.features.append_view(next.features.view());
        self.expectations.extend(next.expectations);
        self.words.extend_from_slice(&next.words);
    }
}

/// The last forecasts of one localizer, latest used last, and for which time one was last ordered
/// in advance.
#[derive(Debug, Default)]
pub(super) struct Forecasts {
    kept: Mutex<Vec<Arc<Forecast>>>,
    ordered: Mutex<Option<Time>>,
}

impl Forecasts {
    /// Whether nobody has ordered `time` as the last; then it is ordered now.
    pub(super) fn order(&self, time: Time) -> bool {
        let mut ordered = self.ordered.lock().unwrap_or_else(PoisonError::into_inner);
        ordered.replace(time) != Some(time)
    }

    fn get(&self, time: Time) -> Option<Arc<Forecast>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let at = kept.iter().position(|forecast| forecast.time == time)?;
        kept[at..].rotate_left(1);
        kept.last().cloned()
    }

    /// One to write to: the longest unused if nobody holds it, else a new one.
    fn take(&self) -> Arc<Forecast> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() >= NUM_KEPT {
            let mut oldest = kept.remove(0);
            if Arc::get_mut(&mut oldest).is_some() {
                return oldest;
            }
        }
        Arc::default()
    }

    /// All of them, latest used last.
    fn kept(&self) -> Vec<Arc<Forecast>> {
        (self.kept.lock())
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    #[cfg(test)]
    pub(super) fn times(&self) -> Vec<Time> {
        self.kept().iter().map(|forecast| forecast.time).collect()
    }

    fn keep(&self, forecast: &Arc<Forecast>) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have made the same meanwhile.
        kept.retain(|other| other.time != forecast.time);
        if kept.len() >= NUM_KEPT {
            kept.remove(0);
        }
        kept.push(Arc::clone(forecast));
    }
}

impl Forecasts {
    /// The predicted maps at `time`, made on the threads of the caller's pool if they are not
    /// there.
    pub(super) fn at_by_all(&self, source: ForecastSource<'_>, time: Time) -> Arc<Forecast> {
        if let Some(known) = self.get(time) {
            return known;
        }
        let num_nodes = source.map.plans.len();
        let parts: Vec<Forecast> = (0..num_nodes.div_ceil(PLACES_PER_TASK))
            .into_par_iter()
            .map_init(PredictedMap::new, |predicted, task| {
                let start = task * PLACES_PER_TASK;
                let end = (start + PLACES_PER_TASK).min(num_nodes);
                let mut part = Forecast::default();
                part.make(source, predicted, time, start..end);
                part
            })
            .collect();
        let mut whole = Forecast {
            time,
            ..Forecast::default()
        };
        for part in parts {
            whole.append(part);
        }
        whole.let_vote(source);
        let whole = Arc::new(whole);
        self.keep(&whole);
        whole
    }

    /// The predicted maps at `time`, which is the middle of a bucket; of a large map made on all
    /// threads.
    pub(super) fn at(
        &self,
        source: ForecastSource<'_>,
        predicted: &mut PredictedMap,
        time: Time,
    ) -> Arc<Forecast> {
        if source.map.plans.len() >= MIN_SHARED {
            return self.at_by_all(source, time);
        }
        if let Some(known) = self.get(time) {
            return known;
        }
        let mut forecast = self.take();
        // Nobody else holds what was taken.
        if let Some(forecast) = Arc::get_mut(&mut forecast) {
            forecast.make(source, predicted, time, 0..source.map.plans.len());
            forecast.let_vote(source);
        }
        self.keep(&forecast);
        forecast
    }

    /// Takes over the forecasts of an `older` map with `num_places`, where they still hold;
    /// `is_same` says which places have not changed since.
    pub(super) fn take_over(
        &self,
        source: ForecastSource<'_>,
        older: &Self,
        num_places: usize,
        is_same: &[bool],
    ) {
        let kept = older.kept();
        for forecast in kept.iter().filter(|it| it.ends.len() == num_places) {
            let newer = forecast.with_snapshot(source, is_same);
            self.keep(&Arc::new(newer));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: i64) -> Arc<Forecast> {
        Arc::new(Forecast {
            time: Time::from_s(s),
            ..Forecast::default()
        })
    }

    #[test]
    fn the_last_two_used_are_kept_and_memory_is_used_again() {
        let forecasts = Forecasts::default();
        let [first, second, third] = [1, 2, 3].map(at);
        forecasts.keep(&first);
        forecasts.keep(&second);
        let again = forecasts.get(Time::from_s(1)).expect("kept");
        assert!(Arc::ptr_eq(&again, &first));
        forecasts.keep(&third);
        assert!(forecasts.get(Time::from_s(2)).is_none(), "unused longest");
        assert!(forecasts.get(Time::from_s(1)).is_some());
        // The third is the oldest now; it is held here, so it must not be written to.
        assert!(!Arc::ptr_eq(&forecasts.take(), &third));
        drop((first, again));
        forecasts.keep(&third);
        let mut free = forecasts.take();
        assert_eq!(free.time, Time::from_s(1), "its memory");
        assert!(Arc::get_mut(&mut free).is_some());
    }

    #[test]
    fn a_time_is_ordered_once_until_another_is() {
        let forecasts = Forecasts::default();
        let [first, second] = [1, 2].map(Time::from_s);
        let ordered = [first, first, second, second, first].map(|time| forecasts.order(time));
        assert_eq!(ordered, [true, false, true, false, true]);
    }

    #[test]
    fn parts_put_together_are_the_whole() {
        let part = |range: Range<u32>| Forecast {
            ends: range
                .clone()
                .map(|end| end as usize + 1 - range.start as usize)
                .collect(),
            ids: range.clone().collect(),
            probabilities: range.clone().map(f64::from).collect(),
            ..Forecast::default()
        };
        let mut whole = part(0..3);
        whole.append(part(3..5));
        assert_eq!(whole.ends, [1, 2, 3, 4, 5]);
        assert_eq!(whole.ids(NodeId(3)), [3]);
        assert_eq!(whole.probabilities(NodeId(4)), [4.0]);
    }
}

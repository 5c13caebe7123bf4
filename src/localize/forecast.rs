//! What should be visible at every place now?
//!
//! Visibility changes over hours, images come ten a second. So time is cut into buckets, and everything that
//! depends on the time but not on the image is worked out once a bucket: which features are predicted at
//! each place, where they are, what they look like, and what each says if it is matched or missing. All of
//! it is laid out place after place, as matching reads it.
//!
//! A [`Forecast`] is always made for the *middle* of its bucket, so an answer depends on the bucket of its
//! time and never on what was asked before. [`Forecasts`] keeps the last two: now, and the bucket to come
//! ([`Localizer::anticipate`]) or just gone. They belong to the localizer and not to each thread's
//! [`Scratch`](super::Scratch), because in a large map a forecast takes a second to make and over 100 bytes
//! a predicted feature to hold; threads share it behind an `Arc`. The lock is held to look it up, never
//! while one is made: two threads that need the same new forecast at the same moment both make it, and
//! make the same. A localizer that goes on with a newer map ([`Localizer::on_newer`]) copies what has not
//! changed and predicts the rest.
//!
//! Cost: what predicting costs, once a bucket; a lock and a reference count a query. Memory of a forecast
//! that nobody holds any more is used for the next one, so a thread alone allocates nothing once warm,
//! but for the lists that candidates of a large map are found in.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::candidates::{Finder, Shortlist, Voting};
use super::evidence::Expectation;
use super::{Localizer, Plan};
use crate::feature::{Features, FeaturesView};
use crate::map::NodeId;
use crate::matching::SearchScratch;
use crate::predict::PredictedMap;
use fremen::time::Time;

/// Forecasts that are kept: now and next.
const NUM_KEPT: usize = 2;
/// Places that one thread predicts at a time.
const PLACES_PER_TASK: usize = 64;

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

    /// Predicts the given places of `localizer`, in place of what was there.
    fn make(
        &mut self,
        localizer: &Localizer,
        predicted: &mut PredictedMap,
        time: Time,
        nodes: Range<usize>,
    ) {
        self.time = time;
        self.ends.clear();
        self.ids.clear();
        self.probabilities.clear();
        self.features.truncate(0);
        let num_expected = localizer.calibration.as_ref().map_or(0, |_| nodes.len());
        (self.expectations).resize_with(num_expected, Expectation::default);
        for (index, node) in nodes.enumerate() {
            if let Plan::Predicted { model, witnesses } = localizer.plans[node].as_ref() {
                let selection = localizer.cfg.selection();
                localizer.choose(predicted, model.as_ref(), witnesses, time, selection);
                let id = NodeId(node as u32);
                (self.ids).extend_from_slice(predicted.features());
                (self.probabilities).extend_from_slice(predicted.probabilities());
                (self.features).append(&localizer.snapshot.node(id).features, predicted.features());
                if let Some(calibration) = &localizer.calibration {
                    let expectation = &mut self.expectations[index];
                    calibration.expect_predicted(expectation, id, predicted, witnesses);
                    expectation.settle(predicted.len());
                }
            }
            self.ends.push(self.ids.len());
        }
        self.words.clear();
        self.voting = None;
        if let Finder::Inverted(words) = &localizer.finder {
            let scratch = &mut SearchScratch::default();
            words.words_into(scratch, self.features.descriptors(), &mut self.words);
        }
    }

    /// Lets features vote, once all places are there.
    fn let_vote(&mut self, localizer: &Localizer) {
        if let Finder::Inverted(words) = &localizer.finder
            && !words.is_empty()
        {
            self.voting = Some(Voting::of(localizer, self, words, &self.words));
        }
    }

    /// The same for a newer map: places that changed are predicted again, all others copied.
    ///
    /// O(places that changed), but for copying.
    fn on_newer(&self, localizer: &Localizer, is_same: &[bool]) -> Self {
        let time = self.time;
        let changed: Vec<usize> = (0..is_same.len()).filter(|&node| !is_same[node]).collect();
        let parts: Vec<Self> = (changed.par_iter())
            .map_init(PredictedMap::new, |predicted, &node| {
                let mut part = Self::default();
                part.make(localizer, predicted, time, node..node + 1);
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
        newer.let_vote(localizer);
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

/// The last forecasts of one localizer, latest used last, and for which time one was last ordered in advance.
#[derive(Debug, Default)]
pub(super) struct Forecasts {
    kept: Mutex<Vec<Arc<Forecast>>>,
    ordered: Mutex<Option<Time>>,
}

impl Forecasts {
    /// Whether nobody has ordered `time` as the last; then it is ordered now.
    fn order(&self, time: Time) -> bool {
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

impl Localizer {
    /// Predicts all places for the time bucket of `time` beforehand, on the threads of the caller's rayon
    /// pool, so that the first image in that bucket need not wait for it.
    ///
    /// Answers are the same without; the last two buckets are kept. A robot that must not miss a frame calls
    /// [`anticipate_next`](Self::anticipate_next) instead.
    pub fn anticipate(&self, time: Time) {
        if self.predicts() {
            self.forecast_by_all(self.middle_of_bucket(time));
        }
    }

    /// Has `pool` predict all places for the bucket after that of `time`, and returns at once.
    ///
    /// To be called with every image: only the first call in a bucket orders anything. A pool of one thread
    /// leaves the other processors to the robot. Answers are the same without; with it, the first image of a
    /// bucket finds its prediction made, if the pool had a bucket's time to make it.
    pub fn anticipate_next(self: &Arc<Self>, pool: &rayon::ThreadPool, time: Time) {
        if !(self.predicts() && self.cfg.method().needs_time()) {
            return;
        }
        let next = self.cfg.middle_of_next_bucket(time);
        if let Some(next) = next
            && self.forecasts.order(next)
        {
            let localizer = Arc::clone(self);
            pool.spawn(move || {
                localizer.forecast_by_all(next);
            });
        }
    }

    /// The predicted maps at `time`, made on the threads of the caller's pool if they are not there.
    pub(super) fn forecast_by_all(&self, time: Time) -> Arc<Forecast> {
        if let Some(known) = self.forecasts.get(time) {
            return known;
        }
        let num_nodes = self.plans.len();
        let parts: Vec<Forecast> = (0..num_nodes.div_ceil(PLACES_PER_TASK))
            .into_par_iter()
            .map_init(PredictedMap::new, |predicted, task| {
                let start = task * PLACES_PER_TASK;
                let end = (start + PLACES_PER_TASK).min(num_nodes);
                let mut part = Forecast::default();
                part.make(self, predicted, time, start..end);
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
        whole.let_vote(self);
        let whole = Arc::new(whole);
        self.forecasts.keep(&whole);
        whole
    }

    /// The predicted maps at `time`, which is the middle of a bucket.
    pub(super) fn forecast(&self, predicted: &mut PredictedMap, time: Time) -> Arc<Forecast> {
        if let Some(known) = self.forecasts.get(time) {
            return known;
        }
        let mut forecast = self.forecasts.take();
        // Nobody else holds what was taken.
        if let Some(forecast) = Arc::get_mut(&mut forecast) {
            forecast.make(self, predicted, time, 0..self.plans.len());
            forecast.let_vote(self);
        }
        self.forecasts.keep(&forecast);
        forecast
    }

    /// Makes the forecasts of `older` its own, where they still hold; `is_same` says which places have not
    /// changed since.
    pub(super) fn take_over_forecasts(&self, older: &Self, is_same: &[bool]) {
        if !self.finder.reads_same_words(&older.finder) {
            return;
        }
        let kept = older.forecasts.kept();
        for forecast in kept.iter().filter(|it| it.ends.len() == older.plans.len()) {
            let newer = forecast.on_newer(self, is_same);
            self.forecasts.keep(&Arc::new(newer));
        }
    }

    /// The time that is predicted for at `time`.
    pub(super) fn middle_of_bucket(&self, time: Time) -> Time {
        if self.cfg.method().needs_time() {
            self.cfg.middle_of_bucket(time)
        } else {
            Time::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Keypoint};
    use crate::localize::LocalizerConfig;
    use crate::map::{MapMeta, Node, PlaceKey, Snapshot};
    use fremen::visibility::BitRow;

    #[test]
    fn the_next_bucket_is_predicted_once_and_only_where_there_are_buckets() {
        let mut node = Node::new(PlaceKey::new("here").expect("a key"));
        let keypoint = Keypoint {
            x: 1.0,
            y: 2.0,
            size: 3.0,
            response: 4.0,
        };
        node.features.push(keypoint, Descriptor::default());
        let mut seen = BitRow::zeros(1);
        seen.set(0);
        node.log
            .push_visit(Time::default(), seen, None)
            .expect("fits");
        let mut snapshot = Snapshot::empty(MapMeta::new(1, "none", "default"));
        snapshot.nodes.push(Arc::new(node));
        let snapshot = Arc::new(snapshot);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.expect("a thread");
        for length_s in [600, 0] {
            let cfg = LocalizerConfig::default()
                .with_calibrated(false)
                .with_time_bucket_s(length_s);
            let localizer = Localizer::new(Arc::clone(&snapshot), cfg).expect("fits");
            let localizer = Arc::new(localizer);
            for s in [10, 11, 599] {
                localizer.anticipate_next(&pool, Time::from_s(s));
            }
            // The one thread does what was ordered before.
            pool.install(|| ());
            let kept = localizer.forecasts.kept.lock().expect("whole");
            let times: Vec<Time> = kept.iter().map(|forecast| forecast.time).collect();
            let expected = [Time::from_s(900)];
            assert_eq!(times, expected[..usize::from(length_s > 0)]);
        }
    }

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

//! Which features of a place are expected at one time, in which order?

use std::collections::BinaryHeap;

use super::reference_visits::ReferenceVisits;
use super::selection::Selection;
use fremen::time::Time;
use fremen::visibility::VisibilityModel;

/// Of a place's features, so many of the most likely take part in a covering choice.
const COVERING_POOL: usize = 1200;
/// So many chosen features halve what another one of the same visit adds.
const COVERING_SATURATION: f64 = 2.0;
/// Which share of the largest possible gain is enough to be chosen.
pub const GOOD_ENOUGH: f64 = 0.9;

/// The features of one place that are expected at one time, in order of choice.
#[derive(Clone, Debug, Default)]
pub struct PredictedMap {
    features: Vec<u32>,
    probabilities: Vec<f64>,
    /// Unclamped scores of all features, kept for the next prediction.
    scores: Vec<f64>,
    /// Sort keys, kept for the next prediction.
    keys: Vec<Key>,
    /// Features that a covering choice has not taken yet, with what each would add.
    gains: Vec<u64>,
    /// How much each reference visit counts; nothing where all count alike.
    similarity: Vec<f64>,
}

impl PartialEq for PredictedMap {
    fn eq(&self, other: &Self) -> bool {
        self.features == other.features && self.probabilities == other.probabilities
    }
}

/// How well each visit is covered by the features chosen so far.
struct Cover {
    counts: [u32; ReferenceVisits::MAX_VISITS],
    /// While nothing is chosen.
    initial: [f64; ReferenceVisits::MAX_VISITS],
    weights: [f64; ReferenceVisits::MAX_VISITS],
    num_visits: usize,
}

impl Cover {
    /// Of so many visits, which count as much as `similarity` says, or alike where it says nothing.
    fn new(num_visits: usize, similarity: &[f64]) -> Self {
        let mut initial = [1.0; ReferenceVisits::MAX_VISITS];
        initial[..similarity.len()].copy_from_slice(similarity);
        Self {
            counts: [0; ReferenceVisits::MAX_VISITS],
            initial,
            weights: initial,
            num_visits,
        }
    }

    /// What a feature of these visits is discounted by.
    fn weight(&self, seen: u64) -> f64 {
        let (sum, count) = match seen.count_ones() {
            0 => (
                self.weights[..self.num_visits].iter().sum(),
                self.num_visits.max(1) as u32,
            ),
            count => (
                bits(seen).map(|visit| self.weights[visit]).sum::<f64>(),
                count,
            ),
        };
        sum / f64::from(count)
    }

    fn add(&mut self, seen: u64) {
        for visit in bits(seen) {
            self.counts[visit] += 1;
            self.weights[visit] =
                self.initial[visit] / (1.0 + f64::from(self.counts[visit]) / COVERING_SATURATION);
        }
    }
}

/// A gain in [0, 4) in steps of 2^-30, then the lowest id first, in one number.
fn gain(value: f64, id: u32) -> u64 {
    // The cast saturates: what is below 0 counts as 0, what is above 4 as just below it.
    let steps = (value * f64::from(1 << 30) + 0.5) as u32;
    u64::from(steps) << 32 | u64::from(!id)
}

/// Orders by quantised score (descending), then id.
type Key = (std::cmp::Reverse<i64>, u32);

impl PredictedMap {
    /// A map in which nothing is predicted yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Predicts the place that `model` was fitted to, for `time`: O(F) and a sort of what is kept.
    ///
    /// Buffers are reused: no allocation once they have grown to the place's size.
    pub fn predict(&mut self, model: &dyn VisibilityModel, time: Time, selection: Selection) {
        self.shortlist(model, time, selection, |_| true);
        self.order_by_likelihood();
    }

    fn order_by_likelihood(&mut self) {
        self.keys.sort_unstable();
        self.features.clear();
        self.features.extend(self.keys.iter().map(|&(_, id)| id));
        self.note_probabilities();
    }

    /// Leaves the keys of the selected features in `keys`, in any order.
    fn shortlist(
        &mut self,
        model: &dyn VisibilityModel,
        time: Time,
        selection: Selection,
        may_be_chosen: impl Fn(usize) -> bool,
    ) {
        self.similarity.clear();
        self.scores.clear();
        self.scores.resize(model.num_features(), 0.0);
        model.score_into(time, &mut self.scores);
        self.keys.clear();
        let keys = keys(&self.scores).filter(|&(_, id)| may_be_chosen(id as usize));
        match selection {
            Selection::Top(n) => {
                let n = n.get();
                self.keys.extend(keys);
                if n < self.keys.len() {
                    self.keys.select_nth_unstable(n);
                    self.keys.truncate(n);
                }
            }
            Selection::Threshold(p) => {
                let scores = &self.scores;
                self.keys
                    .extend(keys.filter(|&(_, id)| scores[id as usize] >= p));
            }
        }
    }

    /// The same number of features, chosen one after another by what each adds to those before.
    ///
    /// With `c_v` the number of features chosen so far that visit `v` saw, a feature `f` adds
    ///
    /// ```text
    /// p_f(t) * mean over the visits v that saw f of 1 / (1 + c_v / 2)
    /// ```
    ///
    /// so the first ones are the most likely, and a visit that is well covered counts less and
    /// less. (Where `p_f` is the long-term mean, this is the greedy rule for the concave `sum over
    /// v of ln(1 + c_v / 2)`, whose result is within 1 - 1/e of the best; Nemhauser, Wolsey &
    /// Fisher 1978.) A feature that no reference visit saw is discounted like the mean over all
    /// visits.
    ///
    /// The 1200 most likely features take part, but for those that `references` leave out; under [`Selection::Threshold`], which keeps all
    /// that reach it, nothing is chosen and the order is by likelihood. The choice for a smaller n
    /// is the beginning of that for a larger one.
    ///
    /// Gains never grow as others are chosen, so a gain is computed again only when it comes to the
    /// top (Minoux 1978), and a feature is taken if it adds at least [`GOOD_ENOUGH`] of the most
    /// that any other could. Cost: O(pool) and a few gains a feature.
    ///
    /// # Panics
    /// If `reference visits` are of a place with another number of features.
    pub fn predict_covering(
        &mut self,
        model: &dyn VisibilityModel,
        time: Time,
        selection: Selection,
        references: &ReferenceVisits,
    ) {
        self.shortlist_to_cover(model, time, selection, references);
        self.cover(selection, references);
    }

    /// Predicted features of predicted experiences: like
    /// [`predict_covering`](Self::predict_covering), but each visit counts as much as it is likely
    /// to be seen again now ([`ReferenceVisits::similarity_into`]), in the choice and in
    /// [`similarity`](Self::similarity).
    ///
    /// # Panics
    /// If `reference visits` are of a place with another number of features.
    pub fn predict_fused(
        &mut self,
        model: &dyn VisibilityModel,
        time: Time,
        selection: Selection,
        references: &ReferenceVisits,
    ) {
        self.shortlist_to_cover(model, time, selection, references);
        references.similarity_into(&self.scores, &mut self.similarity);
        self.cover(selection, references);
    }

    /// Leaves what may be chosen in `keys`, and all visits alike.
    fn shortlist_to_cover(
        &mut self,
        model: &dyn VisibilityModel,
        time: Time,
        selection: Selection,
        references: &ReferenceVisits,
    ) {
        assert_eq!(references.seen().len(), model.num_features());
        let selection = match selection {
            Selection::Top(n) => Selection::at_least_one(COVERING_POOL.max(n.get())),
            all @ Selection::Threshold(_) => all,
        };
        let may_be_chosen = |feature| references.may_be_chosen(feature);
        self.shortlist(model, time, selection, may_be_chosen);
    }

    /// Chooses from `keys`.
    fn cover(&mut self, selection: Selection, references: &ReferenceVisits) {
        let Selection::Top(n) = selection else {
            self.order_by_likelihood();
            return;
        };
        let mut cover = Cover::new(references.num_visits(), &self.similarity);
        let mut gains = std::mem::take(&mut self.gains);
        gains.clear();
        gains.extend((self.keys.iter()).map(|&(_, id)| {
            let weight = cover.weight(references.seen()[id as usize]);
            gain(self.scores[id as usize] * weight, id)
        }));
        let mut gains = BinaryHeap::from(gains);
        self.features.clear();
        while self.features.len() < n.get()
            && let Some(stale) = gains.pop()
        {
            let id = !(stale as u32);
            let seen = references.seen()[id as usize];
            let now = gain(self.scores[id as usize] * cover.weight(seen), id);
            let next = gains.peek().map_or(0, |next| next >> 32);
            if (now >> 32) as f64 >= GOOD_ENOUGH * next as f64 {
                self.features.push(id);
                cover.add(seen);
            } else {
                gains.push(now);
            }
        }
        self.gains = gains.into_vec();
        self.note_probabilities();
    }

    fn note_probabilities(&mut self) {
        let Self {
            features,
            probabilities,
            scores,
            ..
        } = self;
        probabilities.clear();
        probabilities.extend((features.iter()).map(|&id| scores[id as usize].clamp(0.0, 1.0)));
    }

    /// Ids of the predicted features within their place, in order of choice.
    pub fn features(&self) -> &[u32] {
        &self.features
    }

    /// What the model says of each feature of the place, before it is clamped to [0, 1]; by id.
    pub fn scores(&self) -> &[f64] {
        &self.scores
    }

    /// p(t) of each of [`features`](Self::features), in [0, 1].
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities
    }

    /// How much each reference visit counted, at most 1; nothing where all counted alike.
    pub fn similarity(&self) -> &[f64] {
        &self.similarity
    }

    /// How many features are predicted.
    pub fn len(&self) -> usize {
        self.features.len()
    }

    /// Whether nothing is predicted.
    pub fn is_empty(&self) -> bool {
        self.features.is_empty()
    }
}

/// The indices of the one bits, ascending.
fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (word != 0).then(|| {
            let bit = word.trailing_zeros() as usize;
            word &= word - 1;
            bit
        })
    })
}

fn keys(scores: &[f64]) -> impl Iterator<Item = Key> + '_ {
    scores.iter().enumerate().map(|(id, score)| {
        // Scores are sums of a few numbers in [-2, 2]: far from the ends of i64.
        (
            std::cmp::Reverse((score * 1e9 + 0.5_f64.copysign(*score)) as i64),
            id as u32,
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    struct Table(Vec<f64>);

    impl VisibilityModel for Table {
        fn num_features(&self) -> usize {
            self.0.len()
        }

        fn predict_into(&self, _: Time, out: &mut [f64]) {
            out.copy_from_slice(&self.0);
        }

        fn predict_one(&self, feature: usize, _: Time) -> f64 {
            self.0[feature]
        }
    }

    fn predicted(scores: &[f64], selection: Selection) -> PredictedMap {
        let mut map = PredictedMap::new();
        map.predict(&Table(scores.to_vec()), Time::default(), selection);
        map
    }

    #[test]
    fn the_most_likely_come_first_and_ties_rank_by_id() {
        let map = predicted(
            &[0.5, 1.2, 0.5 + 1e-13, 1.1, 0.0],
            Selection::at_least_one(4),
        );
        assert_eq!(map.features(), [1, 3, 0, 2]);
        assert_eq!(map.probabilities()[..2], [1.0, 1.0]);
    }

    #[test]
    fn n_above_the_place_keeps_everything() {
        assert_eq!(
            predicted(&[0.1, 0.2], Selection::at_least_one(9)).features(),
            [1, 0]
        );
        assert!(predicted(&[], Selection::at_least_one(9)).is_empty());
    }

    #[test]
    fn a_threshold_keeps_what_reaches_it() {
        let map = predicted(&[0.2, 0.7, 0.69], Selection::Threshold(0.7));
        assert_eq!(map.features(), [1]);
    }

    #[test]
    fn the_first_n_are_the_same_for_every_larger_n() {
        let scores: Vec<f64> = (0..97).map(|i| f64::from(i * 37 % 19) / 19.0).collect();
        let all = predicted(&scores, Selection::at_least_one(97));
        for n in [1, 5, 50] {
            assert_eq!(
                predicted(&scores, Selection::at_least_one(n)).features(),
                &all.features()[..n]
            );
        }
    }

    /// Features 0..6 belong to visits 0..3 (summer), 6..8 to visit 3 (winter).
    fn summer_and_winter() -> ReferenceVisits {
        let mut log = fremen::visibility::HistoryLog::new();
        for visit in 0..4 {
            let mut seen = fremen::visibility::BitRow::zeros(8);
            (if visit < 3 { 0..6 } else { 6..8 }).for_each(|f| seen.set(f));
            let time = Time::from_s(visit);
            log.push_visit(time, seen, None).expect("fits");
        }
        ReferenceVisits::of(&log, fremen::visibility::Visits::All).expect("fits")
    }

    #[test]
    fn a_covering_choice_keeps_features_of_every_appearance() {
        let model = Table(vec![0.75, 0.75, 0.75, 0.75, 0.75, 0.75, 0.25, 0.25]);
        let mut map = PredictedMap::new();
        map.predict(&model, Time::default(), Selection::at_least_one(6));
        assert_eq!(map.features(), [0, 1, 2, 3, 4, 5]);
        let references = summer_and_winter();
        map.predict_covering(
            &model,
            Time::default(),
            Selection::at_least_one(6),
            &references,
        );
        // Worth of a summer feature after k others: 0.75 / (1 + k / 2), which is down to 0.25 for k
        // = 4.
        assert_eq!(map.features()[0], 0);
        let winter: Vec<usize> = (0..6).filter(|&at| map.features()[at] >= 6).collect();
        assert!(winter == [4] || winter == [5], "{:?}", map.features());
        assert_eq!(map.probabilities()[winter[0]], 0.25);
    }

    #[test]
    fn the_first_n_of_a_covering_choice_are_the_same_for_every_larger_n() {
        let model = Table(vec![0.75, 0.5, 0.6, 0.75, 0.3, 0.7, 0.25, 0.2]);
        let references = summer_and_winter();
        let mut all = PredictedMap::new();
        all.predict_covering(
            &model,
            Time::default(),
            Selection::at_least_one(8),
            &references,
        );
        assert_eq!(all.len(), 8);
        let mut map = PredictedMap::new();
        for n in 1..8 {
            map.predict_covering(
                &model,
                Time::default(),
                Selection::at_least_one(n),
                &references,
            );
            assert_eq!(map.features(), &all.features()[..n]);
        }
    }
}

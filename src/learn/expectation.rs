//! What is expected of a place, without fitting its models at every visit?
//!
//! A [`PlaceModel`] is a model of visibility that was fitted some visits ago. It is fitted again
//! when an eighth more visits were learnt than it knew, or when half of its features are gone. In
//! between it goes on being used: features that a budget forgot are left out, and those that stayed
//! keep their p(t) under their new number, because p(t) of a feature depends on its own history
//! alone. So what a budget forgets costs no fit.
//!
//! Which visits it knows follows from how many the place has ([`num_fitted`]), not from when the
//! process that learns was started: one that goes on with a map expects what the other would have.
//! Only what a budget forgets is not made up for, so with one this holds about.
//!
//! Features that were born since have no p(t) here: `guard` does not look for them, and `budget`
//! takes their plain rate.
//!
//! A fit is O(visits * features), and there is one in an eighth as many visits: O(features) a visit
//! on average.

use super::config::LearnConfig;
use crate::map::Node;
use fremen::error::Result;
use fremen::time::Time;
use fremen::visibility::{self, HistoryLog, VisibilityModel, Visits};

/// A model is fitted again when it knows all but this share of the visits.
const STALE_SHARE: usize = 8;

/// A model of the features that a place had some visits ago.
#[derive(Debug)]
pub(super) struct PlaceModel {
    model: Box<dyn VisibilityModel>,
    /// (feature of the place, feature of the model), ascending: those that both know.
    pairs: Vec<(u32, u32)>,
    /// Visits it was fitted from.
    num_fitted: usize,
    /// Visits that were learnt since.
    num_since: usize,
}

/// How many visits the model of a place knows that has so many: the first ones. It is fitted at 1,
/// 2, 3, ... visits, and then where it [is stale](PlaceModel::is_stale).
fn num_fitted(num_visits: usize) -> usize {
    let next = |num: usize| num + num / STALE_SHARE + 1;
    let fits = std::iter::successors(Some(0), |&num| Some(next(num)));
    fits.take_while(|&num| num <= num_visits)
        .last()
        .unwrap_or_default()
}

impl PlaceModel {
    /// Fits a model of the first visits.
    fn of(cfg: &LearnConfig, log: &HistoryLog) -> Result<Self> {
        let num_fitted = num_fitted(log.num_visits());
        let first = log.first(num_fitted);
        let model = visibility::fit(&first, cfg.experience().visibility(), Visits::All)?;
        Ok(Self {
            pairs: identity(model.num_features()),
            model,
            num_fitted,
            num_since: log.num_visits() - num_fitted,
        })
    }

    /// The model that a place had when it had only the first so many visits of the log; `known` is
    /// that of fewer, where there is one.
    pub(super) fn at(
        cfg: &LearnConfig,
        log: &HistoryLog,
        num_visits: usize,
        known: Option<Self>,
    ) -> Result<Self> {
        match known.filter(|it| it.num_fitted == num_fitted(num_visits)) {
            Some(known) => Ok(known),
            None => Self::of(cfg, &log.first(num_visits)),
        }
    }

    /// The model itself; [`pairs`](Self::pairs) translates its features.
    pub(super) fn model(&self) -> &dyn VisibilityModel {
        &*self.model
    }

    /// (feature of the place, feature of the model), ascending.
    pub(super) fn pairs(&self) -> &[(u32, u32)] {
        &self.pairs
    }

    /// Writes p(`time`) of the features of the place that the model knows, and leaves the others as
    /// they are. `known` is memory to work in.
    pub(super) fn predict_into(&self, time: Time, known: &mut Vec<f64>, p: &mut [f64]) {
        known.clear();
        known.resize(self.model.num_features(), 0.0);
        self.model.predict_into(time, known);
        for &(id, known_id) in &self.pairs {
            p[id as usize] = known[known_id as usize];
        }
    }

    fn is_stale(&self) -> bool {
        self.num_since > self.num_fitted / STALE_SHARE
            || self.pairs.len() * 2 < self.model.num_features()
    }
}

/// The features of a place that are numbered as those of a model are.
pub(super) fn identity(num_features: usize) -> Vec<(u32, u32)> {
    (0..num_features as u32).map(|id| (id, id)).collect()
}

/// The models of all places that were needed.
#[derive(Debug, Default)]
pub(super) struct Expectations {
    /// By position of the place.
    places: Vec<Option<PlaceModel>>,
}

impl Expectations {
    /// What is expected of the place at `index`.
    pub(super) fn of(
        &mut self,
        cfg: &LearnConfig,
        index: usize,
        node: &Node,
    ) -> Result<&PlaceModel> {
        if self.places.len() <= index {
            self.places.resize_with(index + 1, || None);
        }
        let place = &mut self.places[index];
        let known = place.take().filter(|it| !it.is_stale());
        Ok(place.insert(match known {
            Some(known) => known,
            None => PlaceModel::of(cfg, node.log())?,
        }))
    }

    /// The place at `index` has learnt one more visit.
    pub(super) fn count_visit(&mut self, index: usize) {
        if let Some(Some(place)) = self.places.get_mut(index) {
            place.num_since += 1;
        }
    }

    /// The features of the place at `index` were numbered anew: `was` says what each of them was
    /// before.
    pub(super) fn renumber(&mut self, index: usize, was: &[u32]) {
        let Some(Some(place)) = self.places.get_mut(index) else {
            return;
        };
        let known = &place.pairs;
        let pairs = (0..).zip(was).filter_map(|(id, was)| {
            let at = known.binary_search_by_key(was, |pair| pair.0).ok()?;
            Some((id, known[at].1))
        });
        place.pairs = pairs.collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Features, Keypoint};
    use crate::map::{AppearanceUse, PlaceKey, SessionId, Visit, VisitId};
    use fremen::visibility::BitRow;

    const KEYPOINT: Keypoint = Keypoint {
        x: 1.0,
        y: 2.0,
        size: 3.0,
        response: 4.0,
    };

    /// A place whose feature `i` is seen at one in `i + 1` visits.
    fn place(num_visits: usize) -> Node {
        let mut node = Node::new(PlaceKey::new("here").expect("valid"));
        for number in 0..num_visits {
            let mut seen = BitRow::zeros(6);
            (0..6)
                .filter(|i| number.is_multiple_of(i + 1))
                .for_each(|i| seen.set(i));
            let visit = Visit {
                id: VisitId(number as u128),
                session: SessionId::default(),
                time: Time::from_s(3_600 * number as i64),
                source: String::new(),
                appearance: None,
                appearance_use: AppearanceUse::Recognised,
            };
            let mut born = Features::new();
            for _ in node.features().len()..6 {
                born.push(KEYPOINT, Descriptor::default());
            }
            (node.push_visit(visit, &born, seen, None, BitRow::zeros(0))).expect("fits");
        }
        node
    }

    #[test]
    fn features_that_stay_keep_their_p_under_their_new_number() {
        let (cfg, node) = (LearnConfig::default(), place(60));
        let mut expectations = Expectations::default();
        let time = Time::from_s(7_000_000);
        let mut p = [f64::NAN; 6];
        let model = expectations.of(&cfg, 0, &node).expect("fits");
        model.predict_into(time, &mut Vec::new(), &mut p);
        assert!(p.iter().all(|p| (0.0..=1.0).contains(p)) && p[0] > p[5]);
        // 1 and 4 go, then a new one comes and 0 goes.
        expectations.renumber(0, &[0, 2, 3, 5]);
        expectations.renumber(0, &[1, 2, 3, 4]);
        let mut after = [f64::NAN; 4];
        let model = expectations.of(&cfg, 0, &node).expect("known");
        model.predict_into(time, &mut Vec::new(), &mut after);
        assert_eq!(&after[..3], &[p[2], p[3], p[5]]);
        assert!(after[3].is_nan(), "nobody knows it");
    }

    #[test]
    fn what_a_model_knows_does_not_depend_on_when_it_was_first_needed() {
        let cfg = LearnConfig::default();
        let mut early = Expectations::default();
        for num_visits in 5..40 {
            let node = place(num_visits);
            let model = early.of(&cfg, 0, &node).expect("fits");
            let num_early = model.num_fitted;
            let late = PlaceModel::of(&cfg, node.log()).expect("fits");
            assert_eq!(num_early, late.num_fitted, "{num_visits} visits");
            assert!(num_early + num_early / STALE_SHARE + 1 > num_visits);
            early.count_visit(0);
        }
    }

    #[test]
    fn a_model_is_fitted_again_when_it_is_stale() {
        let (cfg, node) = (LearnConfig::default(), place(60));
        let mut expectations = Expectations::default();
        let num_pairs = |expectations: &mut Expectations| {
            let model = expectations.of(&cfg, 0, &node).expect("fits");
            model.pairs().len()
        };
        assert_eq!(num_pairs(&mut expectations), 6);
        expectations.renumber(0, &[1, 3, 4]);
        assert_eq!(num_pairs(&mut expectations), 3);
        expectations.renumber(0, &[1]);
        assert_eq!(num_pairs(&mut expectations), 6, "too little was left");
    }
}

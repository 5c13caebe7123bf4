//! What will the place look like then?
//!
//! A [`PredictedMap`] is the part of a place's features that a [`Selection`] keeps for one time: the n
//! most likely visible (T-RO 2017 VII, "the n most likely visible features at each location were
//! selected"), or all above a probability.
//!
//! Features are ranked by the model's score *before* it is clamped to [0, 1]: with few visits many
//! features reach 1, and the unclamped score still says which of them overshoots. Scores closer than
//! 1e-9 count as equal (sums in another order differ by less), and equal ones rank by lowest id, so
//! that a ranking is the same for every kernel and number of threads.
//!
//! Not for choosing by information (what tells this place from others): that needs the other places.

use serde::{Deserialize, Serialize};

use crate::error::{Error, ErrorKind, Result};
use crate::time::Time;
use crate::visibility::VisibilityModel;

/// How many features of a place are predicted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "SelectionText")]
pub enum Selection {
    /// The `n` most likely; all, if the place has fewer.
    Top(usize),
    /// Every feature with p(t) at or above this.
    Threshold(f64),
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SelectionText {
    Top(usize),
    Threshold(f64),
}

impl TryFrom<SelectionText> for Selection {
    type Error = Error;

    fn try_from(text: SelectionText) -> Result<Self> {
        match text {
            SelectionText::Top(n) => Self::top(n),
            SelectionText::Threshold(p) => Self::threshold(p),
        }
    }
}

impl Selection {
    /// The `n` most likely; `n` must be positive.
    pub fn top(n: usize) -> Result<Self> {
        if n == 0 {
            return Err(
                Error::new(ErrorKind::Config, "cannot predict 0 features a place")
                    .with_help("choose n from 1; 50 is a good start"),
            );
        }
        Ok(Self::Top(n))
    }

    /// Every feature with p(t) >= `p`; `p` must be in [0, 1].
    pub fn threshold(p: f64) -> Result<Self> {
        if !(0.0..=1.0).contains(&p) {
            return Err(Error::new(
                ErrorKind::Config,
                format!("a threshold of probability lies in [0, 1], not at {p}"),
            ));
        }
        Ok(Self::Threshold(p))
    }
}

/// The features of one place that are expected at one time, most likely first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PredictedMap {
    features: Vec<u32>,
    probabilities: Vec<f64>,
    /// Unclamped scores of all features, kept for the next prediction.
    scores: Vec<f64>,
    /// Sort keys, kept for the next prediction.
    keys: Vec<Key>,
}

/// Orders by quantised score (descending), then id.
type Key = (std::cmp::Reverse<i64>, u32);

impl PredictedMap {
    /// Nothing predicted yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Predicts the place that `model` was fitted to, for `time`: O(F) and a sort of what is kept.
    ///
    /// Buffers are reused: no allocation once they have grown to the place's size.
    pub fn predict(&mut self, model: &dyn VisibilityModel, time: Time, selection: Selection) {
        self.scores.clear();
        self.scores.resize(model.num_features(), 0.0);
        model.score_into(time, &mut self.scores);
        self.keys.clear();
        match selection {
            Selection::Top(n) => {
                self.keys.extend(keys(&self.scores));
                if n < self.keys.len() {
                    self.keys.select_nth_unstable(n);
                    self.keys.truncate(n);
                }
            }
            Selection::Threshold(p) => {
                let scores = &self.scores;
                self.keys
                    .extend(keys(scores).filter(|&(_, id)| scores[id as usize] >= p));
            }
        }
        self.keys.sort_unstable();
        self.features.clear();
        self.features.extend(self.keys.iter().map(|&(_, id)| id));
        self.probabilities.clear();
        self.probabilities.extend(
            self.keys
                .iter()
                .map(|&(_, id)| self.scores[id as usize].clamp(0.0, 1.0)),
        );
    }

    /// Ids of the predicted features within their place, most likely first.
    pub fn features(&self) -> &[u32] {
        &self.features
    }

    /// p(t) of each of [`features`](Self::features), in [0, 1].
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities
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

fn keys(scores: &[f64]) -> impl Iterator<Item = Key> + '_ {
    scores.iter().enumerate().map(|(id, score)| {
        // Scores are sums of a few numbers in [-2, 2]: far from the ends of i64.
        (std::cmp::Reverse((score * 1e9).round() as i64), id as u32)
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
        let map = predicted(&[0.5, 1.2, 0.5 + 1e-13, 1.1, 0.0], Selection::Top(4));
        assert_eq!(map.features(), [1, 3, 0, 2]);
        assert_eq!(map.probabilities()[..2], [1.0, 1.0]);
    }

    #[test]
    fn n_above_the_place_keeps_everything() {
        assert_eq!(predicted(&[0.1, 0.2], Selection::Top(9)).features(), [1, 0]);
        assert!(predicted(&[], Selection::Top(9)).is_empty());
    }

    #[test]
    fn a_threshold_keeps_what_reaches_it() {
        let map = predicted(&[0.2, 0.7, 0.69], Selection::Threshold(0.7));
        assert_eq!(map.features(), [1]);
    }

    #[test]
    fn the_first_n_are_the_same_for_every_larger_n() {
        let scores: Vec<f64> = (0..97).map(|i| f64::from(i * 37 % 19) / 19.0).collect();
        let all = predicted(&scores, Selection::Top(97));
        for n in [1, 5, 50] {
            assert_eq!(
                predicted(&scores, Selection::Top(n)).features(),
                &all.features()[..n]
            );
        }
    }

    #[test]
    fn selections_that_make_no_sense_are_refused() {
        assert!(Selection::top(0).is_err());
        assert!(Selection::threshold(f64::NAN).is_err());
        assert!(Selection::threshold(1.5).is_err());
    }
}

//! What did a row answer to a query, and how wrong is that?

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// What a decision rule said about one image.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decision {
    /// Located at the place with this key. In JSON `{"at": "place"}`.
    At(String),
    /// At one of these neighbouring places, most probable first. In JSON `{"near": ["a", "b"]}`.
    Near(Vec<String>),
    /// One of several places of the map. In JSON `"ambiguous"`.
    Ambiguous,
    /// No place of the map, or nothing to decide by. In JSON `"unknown"`.
    Unknown,
}

impl Decision {
    /// The place that the image is located at; none where the decision names none.
    pub fn located(&self) -> Option<&str> {
        match self {
            Self::At(place) => Some(place),
            Self::Near(region) => region.first().map(String::as_str),
            Self::Ambiguous | Self::Unknown => None,
        }
    }

    /// Whether it names several neighbouring places, this one among them.
    fn leaves_open(&self, place: &str) -> bool {
        matches!(self, Self::Near(region) if region.iter().any(|one| one == place))
    }
}

/// The answer of one row to one query.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The forced first choice; none where no place scored at all.
    pub first: Option<String>,
    /// What the row's decision rule said; rows without one say `At(first)`.
    pub decision: Decision,
    /// Probability of the most probable places; empty where the score is no probability.
    /// The hypothesis "off-map" has the key [`OFF_MAP`].
    #[serde(default)]
    pub posterior: BTreeMap<String, f64>,
    /// All places that share the first rank, `first` among them; empty without a tie.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ties: Vec<String>,
}

/// Key of the hypothesis "at no place of the map" in [`Answer::posterior`].
pub const OFF_MAP: &str = "(elsewhere)";

impl Answer {
    /// How wrong the forced first choice is, 0 to 1, with a tie split.
    ///
    /// `truth` is `None` for an image of a place that the map lacks: every forced choice is wrong.
    pub fn wrong(&self, truth: Option<&str>) -> f64 {
        let Some(truth) = truth else { return 1.0 };
        if self.ties.is_empty() {
            return f64::from(self.first.as_deref() != Some(truth));
        }
        if self.ties.iter().any(|place| place == truth) {
            1.0 - 1.0 / self.ties.len() as f64
        } else {
            1.0
        }
    }

    /// How wrong the forced first choice is where the places `near` the true one are right too; of
    /// k tied places, each right one counts 1/k.
    pub fn wrong_within(&self, truth: Option<&str>, near: &[String]) -> f64 {
        let Some(truth) = truth else { return 1.0 };
        let is_right = |place: &str| place == truth || near.iter().any(|near| near == place);
        if self.ties.is_empty() {
            return f64::from(!self.first.as_deref().is_some_and(is_right));
        }
        let num_right = self.ties.iter().filter(|place| is_right(place)).count();
        1.0 - num_right as f64 / self.ties.len() as f64
    }

    /// Whether several places share the first rank.
    pub fn is_tied(&self) -> bool {
        self.ties.len() > 1
    }
}

/// One image that was to be located.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Query {
    /// Unique within the suite and the same in every run; usually the image's path in the dataset.
    pub id: String,
    /// Key of the true place; none for an image of a place that the map lacks.
    pub truth: Option<String>,
    /// The other places of the map that the run's tolerance counts as right.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub near: Vec<String>,
    /// Queries of one group (a visit, an hour) are alike; where given, intervals resample groups.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// One answer per row, keyed by [`RowKey`](super::RowKey).
    pub answers: BTreeMap<String, Answer>,
}

impl Query {
    /// How wrong an answer to this query is within the run's tolerance.
    pub fn wrong_within(&self, answer: &Answer) -> f64 {
        answer.wrong_within(self.truth.as_deref(), &self.near)
    }

    /// What a decision about this query is worth: the one place where that is decided.
    pub fn outcome(&self, decision: &Decision) -> DecisionOutcome {
        let Some(place) = decision.located() else {
            return DecisionOutcome::NotLocated;
        };
        if self.truth.as_deref() == Some(place) {
            DecisionOutcome::Right
        } else if self.truth.is_some() && self.near.iter().any(|near| near == place)
            || self
                .truth
                .as_deref()
                .is_some_and(|truth| decision.leaves_open(truth))
        {
            DecisionOutcome::Near
        } else {
            DecisionOutcome::Wrong
        }
    }
}

/// What a decision is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecisionOutcome {
    /// Located at the true place.
    Right,
    /// Located at another place within the run's tolerance, or among neighbouring places of which
    /// the true one is not the first.
    Near,
    /// Located anywhere else.
    Wrong,
    /// Ambiguous or unknown.
    NotLocated,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tie_is_split_over_the_tied_places() {
        let wrong = |first: &str, ties: &[&str], truth: Option<&str>| {
            let answer = Answer {
                first: Some(first.into()),
                decision: Decision::At(first.into()),
                posterior: BTreeMap::new(),
                ties: ties.iter().map(ToString::to_string).collect(),
            };
            answer.wrong(truth)
        };
        assert_eq!(wrong("a", &[], Some("a")), 0.0);
        assert_eq!(wrong("a", &[], Some("b")), 1.0);
        assert_eq!(wrong("b", &["a", "b"], Some("a")), 0.5);
        assert_eq!(wrong("a", &["a", "b", "c", "d"], Some("a")), 0.75);
        assert_eq!(wrong("b", &["b", "c"], Some("a")), 1.0);
        assert_eq!(wrong("a", &[], None), 1.0);
    }

    #[test]
    fn a_place_near_the_true_one_is_right_within_the_tolerance() {
        let mut query = Query {
            id: String::new(),
            truth: Some("b".into()),
            near: vec!["a".into(), "c".into()],
            group: None,
            answers: BTreeMap::new(),
        };
        let answer = |first: &str, ties: &[&str]| Answer {
            first: Some(first.into()),
            decision: Decision::At(first.into()),
            posterior: BTreeMap::new(),
            ties: ties.iter().map(ToString::to_string).collect(),
        };
        assert_eq!(query.wrong_within(&answer("c", &[])), 0.0);
        assert_eq!(query.wrong_within(&answer("d", &[])), 1.0);
        assert_eq!(query.wrong_within(&answer("a", &["a", "b"])), 0.0);
        assert_eq!(query.wrong_within(&answer("a", &["a", "b", "d", "e"])), 0.5);
        let outcome = |query: &Query, place: &str| query.outcome(&Decision::At(place.into()));
        assert_eq!(outcome(&query, "b"), DecisionOutcome::Right);
        assert_eq!(outcome(&query, "a"), DecisionOutcome::Near);
        assert_eq!(outcome(&query, "d"), DecisionOutcome::Wrong);
        let unknown = query.outcome(&Decision::Unknown);
        assert_eq!(unknown, DecisionOutcome::NotLocated);
        query.truth = None;
        assert_eq!(outcome(&query, "a"), DecisionOutcome::Wrong);
        assert_eq!(query.wrong_within(&answer("a", &[])), 1.0);
    }
}

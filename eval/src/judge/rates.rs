//! How often is a row wrong, and how much does it differ from another on the same queries?

use std::collections::BTreeMap;

use super::statistics::{Estimate, Sample};
use crate::results::{DecisionOutcome, Query, Row, RowKey, Within};

/// What the answers of one row add up to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tally {
    /// Queries that have an answer.
    pub queries: u32,
    /// Wrong forced first choices, ties split.
    pub wrong: f64,
    /// Queries decided unknown or ambiguous.
    pub unknown: u32,
    /// Queries with several places on the first rank.
    pub tied: u32,
    /// Share of wrong answers in %, with interval.
    pub wrong_percent: Estimate,
}

impl Tally {
    /// Sums up the answers that `queries` hold for `key`; queries of places that the map lacks are
    /// left out, because no first choice would be right.
    ///
    /// `has_decision_rule` says whether the row's rule may say unknown; if not, `unknown` is 0.
    pub fn of(queries: &[Query], key: &RowKey, has_decision_rule: bool) -> Self {
        let key = key.to_string();
        let (mut unknown, mut tied) = (0, 0);
        let answered = (queries.iter())
            .filter(|query| query.truth.is_some())
            .filter_map(|query| query.answers.get(&key).map(|answer| (query, answer)));
        let sample = Sample::grouped(answered.map(|(query, answer)| {
            tied += u32::from(answer.is_tied());
            unknown += u32::from(answer.decision.located().is_none());
            (query.group.as_deref(), answer.wrong(query.truth.as_deref()))
        }));
        Self {
            queries: sample.len() as u32,
            wrong: sample.sum(),
            unknown: if has_decision_rule { unknown } else { 0 },
            tied,
            wrong_percent: sample.rate().scaled(100.0),
        }
    }

    /// The row with these numbers; what the answers do not show is left at none and zero.
    pub fn into_row(self, key: &RowKey, is_default: bool) -> Row {
        Row {
            is_default,
            variant: key.variant.clone(),
            n: key.n,
            queries: self.queries,
            correct: f64::from(self.queries) - self.wrong,
            wrong: self.wrong,
            unknown: self.unknown,
            tied: self.tied,
            ci_low: self.wrong_percent.interval.low,
            ci_high: self.wrong_percent.interval.high,
            reobserved: None,
            pairs_compared: 0.0,
            ms_p50: 0.0,
            ms_p99: 0.0,
            within: None,
        }
    }
}

/// What the answers for `key` are worth within the run's tolerance; queries of places that the map
/// lacks are left out, as in [`Tally::of`].
pub fn within(queries: &[Query], key: &RowKey) -> Within {
    let key = key.to_string();
    let (mut located, mut wrong_exact, mut wrong) = (0, 0, 0);
    let answered = (queries.iter())
        .filter(|query| query.truth.is_some())
        .filter_map(|query| query.answers.get(&key).map(|answer| (query, answer)));
    let sample = Sample::grouped(answered.map(|(query, answer)| {
        let outcome = query.outcome(&answer.decision);
        located += u32::from(outcome != DecisionOutcome::NotLocated);
        let is_off = matches!(outcome, DecisionOutcome::Near | DecisionOutcome::Wrong);
        wrong_exact += u32::from(is_off);
        wrong += u32::from(outcome == DecisionOutcome::Wrong);
        (query.group.as_deref(), 1.0 - query.wrong_within(answer))
    }));
    let percent = sample.rate().scaled(100.0);
    Within {
        correct: sample.sum(),
        ci_low: percent.interval.low,
        ci_high: percent.interval.high,
        located,
        located_wrong_exact: wrong_exact,
        located_wrong: wrong,
    }
}

/// How one row differs from another on the queries that both answered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairedDifference {
    /// Queries that both answered.
    pub num_paired: usize,
    /// Queries on which the second is less wrong than the first.
    pub num_better: usize,
    /// Queries on which the second is more wrong.
    pub num_worse: usize,
    /// Wrong answers of the first on these queries, %.
    pub first_percent: f64,
    /// Wrong answers of the second on these queries, %.
    pub second_percent: f64,
    /// Second minus first, in points of %: negative is better. Exactly zero, with an interval of
    /// one point, where both agree on every query.
    pub points: Estimate,
}

impl PairedDifference {
    /// Pairs of errors `(group, first, second)` per query; `None` without pairs.
    pub fn of<'a>(pairs: impl IntoIterator<Item = (Option<&'a str>, f64, f64)>) -> Option<Self> {
        let (mut first_sum, mut second_sum) = (0.0, 0.0);
        let (mut num_better, mut num_worse) = (0, 0);
        let sample = Sample::grouped(pairs.into_iter().map(|(group, first, second)| {
            first_sum += first;
            second_sum += second;
            num_better += usize::from(second < first);
            num_worse += usize::from(second > first);
            (group, second - first)
        }));
        let percent = 100.0 / sample.len() as f64;
        (!sample.is_empty()).then(|| Self {
            num_paired: sample.len(),
            num_better,
            num_worse,
            first_percent: first_sum * percent,
            second_percent: second_sum * percent,
            points: sample.estimate().scaled(100.0),
        })
    }

    /// Row `second` against row `first` of one run.
    pub fn between(queries: &[Query], first: &RowKey, second: &RowKey) -> Option<Self> {
        let (first, second) = (first.to_string(), second.to_string());
        Self::of(queries.iter().filter_map(|query| {
            let truth = Some(query.truth.as_deref()?);
            let first = query.answers.get(&first)?.wrong(truth);
            let second = query.answers.get(&second)?.wrong(truth);
            Some((query.group.as_deref(), first, second))
        }))
    }
}

/// Who is mistaken for whom: forced first choices, ties split.
#[derive(Clone, Debug, PartialEq)]
pub struct Confusion {
    /// Keys of places, sorted; the rows and columns of `counts`.
    pub places: Vec<String>,
    /// `counts[truth][answer]`: number of queries.
    pub counts: Vec<Vec<f64>>,
    /// Per true place: queries without any first choice.
    pub no_answer: Vec<f64>,
}

impl Confusion {
    /// Of the answers for `key`; queries of unknown places are left out.
    pub fn of(queries: &[Query], key: &RowKey) -> Self {
        let key = key.to_string();
        let mut places: BTreeMap<&str, usize> = BTreeMap::new();
        let answered: Vec<_> = queries
            .iter()
            .filter_map(|query| Some((query.truth.as_deref()?, query.answers.get(&key)?)))
            .collect();
        for (truth, answer) in &answered {
            places.insert(truth, 0);
            for place in answer.first.iter().chain(&answer.ties) {
                places.insert(place, 0);
            }
        }
        for (index, place) in places.values_mut().enumerate() {
            *place = index;
        }
        let mut counts = vec![vec![0.0; places.len()]; places.len()];
        let mut no_answer = vec![0.0; places.len()];
        for (truth, answer) in answered {
            let truth = places[truth];
            if answer.is_tied() {
                let share = 1.0 / answer.ties.len() as f64;
                for tied in &answer.ties {
                    counts[truth][places[tied.as_str()]] += share;
                }
            } else if let Some(first) = &answer.first {
                counts[truth][places[first.as_str()]] += 1.0;
            } else {
                no_answer[truth] += 1.0;
            }
        }
        Self {
            places: places.into_keys().map(str::to_owned).collect(),
            counts,
            no_answer,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Answer, Decision};
    use proptest::prelude::*;

    fn query(id: usize, truth: &str, answers: &[(&str, &[&str])]) -> Query {
        let answer = |places: &[&str]| Answer {
            first: places.first().map(ToString::to_string),
            decision: places
                .first()
                .map_or(Decision::Unknown, |place| Decision::At((*place).to_owned())),
            posterior: BTreeMap::new(),
            ties: if places.len() > 1 {
                places.iter().map(ToString::to_string).collect()
            } else {
                Vec::new()
            },
        };
        Query {
            id: id.to_string(),
            truth: Some(truth.to_owned()),
            near: Vec::new(),
            group: None,
            answers: answers
                .iter()
                .map(|(key, places)| ((*key).to_owned(), answer(places)))
                .collect(),
        }
    }

    const FIRST: &str = "lttl/static/mean/count/0/5";

    const SECOND: &str = "lttl/fremen/annual/count/1/5";

    fn queries() -> Vec<Query> {
        vec![
            query(0, "a", &[(FIRST, &["b"]), (SECOND, &["a"])]),
            query(1, "a", &[(FIRST, &["a", "b"]), (SECOND, &["a"])]),
            query(2, "b", &[(FIRST, &["b"]), (SECOND, &["a"])]),
            query(3, "b", &[(FIRST, &[]), (SECOND, &["b"])]),
        ]
    }

    #[test]
    fn a_tally_splits_ties() {
        let key: RowKey = FIRST.parse().unwrap();
        let tally = Tally::of(&queries(), &key, false);
        assert_eq!((tally.queries, tally.tied, tally.unknown), (4, 1, 0));
        assert_eq!((tally.wrong, tally.wrong_percent.mean), (2.5, 62.5));
        assert_eq!(Tally::of(&queries(), &key, true).unknown, 1);
        let row = tally.into_row(&key, true);
        assert_eq!(
            (row.correct, row.wrong_percent(), row.key()),
            (1.5, 62.5, key)
        );
    }

    #[test]
    fn pairs_count_who_is_better() {
        let (first, second) = (FIRST.parse().unwrap(), SECOND.parse().unwrap());
        let pair = PairedDifference::between(&queries(), &first, &second).unwrap();
        assert_eq!(
            (pair.num_paired, pair.num_better, pair.num_worse),
            (4, 3, 1)
        );
        assert_eq!((pair.first_percent, pair.second_percent), (62.5, 25.0));
        assert_eq!(pair.points.mean, -37.5);
    }

    #[test]
    fn confusion_splits_ties_and_counts_silence() {
        let confusion = Confusion::of(&queries(), &FIRST.parse().unwrap());
        assert_eq!(confusion.places, ["a", "b"]);
        assert_eq!(confusion.counts, [vec![0.5, 1.5], vec![0.0, 1.0]]);
        assert_eq!(confusion.no_answer, [0.0, 1.0]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn swapping_the_two_sides_mirrors_the_difference(
            pairs in prop::collection::vec((0_u8..=1, 0_u8..=1), 1..60)
        ) {
            let pair = |(a, b): &(u8, u8)| (None, f64::from(*a), f64::from(*b));
            let swap = |(a, b): &(u8, u8)| (None, f64::from(*b), f64::from(*a));
            let forth = PairedDifference::of(pairs.iter().map(pair)).unwrap();
            let back = PairedDifference::of(pairs.iter().map(swap)).unwrap();
            prop_assert!((forth.points.mean + back.points.mean).abs() <= 1e-9);
            prop_assert!((forth.points.interval.low + back.points.interval.high).abs() <= 1e-9);
            prop_assert_eq!(forth.num_better, back.num_worse);
            prop_assert!(forth.points.interval.contains(forth.points.mean));
        }
    }
}

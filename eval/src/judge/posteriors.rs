//! Can posteriors and decisions be trusted?
//!
//! A row with a posterior is judged on three sets of queries:
//!
//! - *in-map*: their place is in the map. Recall, precision-recall, decisions, calibration.
//! - *out-of-map* (suite `foreign`): their place was kept out of the map, so that every place is
//!   wrong. How often is one accepted?
//! - *mixed*: both, weighted so that out-of-map queries are as frequent as the off-map prior says.
//!   A posterior is a statement about this mixture, and is calibrated on it or not at all: on
//!   in-map queries alone the right posterior is less sure than it is right, on out-of-map ones it
//!   is too sure.
//!
//! Everything here lies in 0..=1 (Brier score 0..=2, log loss in nats), with 95 % intervals from
//! the bootstrap of [`statistics`](super::statistics), whole groups drawn.

use chronotope::localize::LocalizerConfig;

use super::decisions::{at_risks, decisions};
use super::judged::{Claim, Judged, claims, rate, weighted};
use super::reliability::{bins, expected_error};
use super::retrieval::retrieval;
use super::scoring::recall_at;
use super::statistics::Sample;
use crate::results::{
    Against, Calibration, InMap, Judgement, Measured, Mixed, OutOfMap, Query, Row, RowKey,
    SuiteResults, Variant,
};

/// The n that are judged, where a run has them.
const JUDGED_N: [u32; 3] = [30, 50, 100];

/// What the default score is compared with.
const PLAIN_SCORES: [&str; 2] = ["inliers", "count"];

/// Whether decisions by this score are taken by risk while localising.
pub fn decides(score: &str) -> bool {
    matches!(score, "likelihood" | "tracked" | "kidnapped")
}

fn calibration(judged: &[Judged<'_>]) -> Calibration {
    let claims = claims(judged);
    Calibration {
        expected_error: expected_error(&claims),
        brier: weighted(judged, Judged::brier),
        log_loss: weighted(judged, Judged::log_loss),
        bins: bins(&claims),
    }
}

/// Both sets, with weights that make `off_map` the share of the out-of-map ones and keep the mean
/// weight 1.
fn mix<'r>(in_map: &[Judged<'r>], out_of_map: &[Judged<'r>], off_map: f64) -> Vec<Judged<'r>> {
    let total = (in_map.len() + out_of_map.len()) as f64;
    let weigh = |set: &[Judged<'r>], share: f64| -> Vec<Judged<'r>> {
        let weight = share * total / set.len().max(1) as f64;
        (set.iter())
            .map(|it| Judged {
                claim: Claim { weight, ..it.claim },
                ..*it
            })
            .collect()
    };
    let mut all = weigh(in_map, 1.0 - off_map);
    all.extend(weigh(out_of_map, off_map));
    all
}

/// Judges one row on `queries`; none where it has no posterior for any query of the map.
fn judge(
    queries: &[&Query],
    key: &RowKey,
    is_default: bool,
    part: Option<&str>,
    has_tolerance: bool,
) -> Option<Judgement> {
    let cfg = LocalizerConfig::default();
    let name = key.to_string();
    let (in_map, out_of_map): (Vec<_>, Vec<_>) = (queries.iter())
        .filter_map(|query| Judged::of(query, &name))
        .partition(|it| it.truth().is_some());
    if in_map.is_empty() {
        return None;
    }
    let mixed = (!out_of_map.is_empty()).then(|| mix(&in_map, &out_of_map, cfg.off_map()));
    let decides = decides(&key.variant.score);
    Some(Judgement {
        is_default,
        against: if decides {
            against(queries, key, cfg.off_map())
        } else {
            Vec::new()
        },
        variant: key.variant.clone(),
        n: key.n,
        part: part.map(str::to_owned),
        risks: at_risks(&claims(&in_map), &claims(&out_of_map)),
        in_map: InMap {
            queries: in_map.len() as u32,
            recall_at_1: rate(&in_map, |it| it.claim.right),
            recall_at_5: rate(&in_map, |it| recall_at(&it.answer.posterior, it.truth(), 5)),
            retrieval: retrieval(&claims(&in_map), in_map.len() as f64),
            decisions: decisions(&in_map, cfg.risk(), decides, has_tolerance),
            calibration: calibration(&in_map),
        },
        out_of_map: (!out_of_map.is_empty()).then(|| OutOfMap {
            queries: out_of_map.len() as u32,
            decisions: decisions(&out_of_map, cfg.risk(), decides, false),
            calibration: calibration(&out_of_map),
        }),
        mixed: mixed.map(|mixed| {
            let claims = claims(&mixed);
            let in_map = claims.len() as f64 * (1.0 - cfg.off_map());
            Mixed {
                off_map: cfg.off_map(),
                calibration: calibration(&mixed),
                retrieval: retrieval(&claims, in_map),
            }
        }),
    })
}

/// The row against the same one with the plain scores, per query that both have.
fn against(queries: &[&Query], key: &RowKey, off_map: f64) -> Vec<Against> {
    let name = key.to_string();
    let compared = PLAIN_SCORES.into_iter().filter_map(|score| {
        let other = Variant {
            score: score.into(),
            ..key.variant.clone()
        };
        let other = other.at(key.n).to_string();
        let pairs: Vec<_> = (queries.iter())
            .filter_map(|query| Some((Judged::of(query, &name)?, Judged::of(query, &other)?)))
            .collect();
        let num_in_map = pairs.iter().filter(|(it, _)| it.truth().is_some()).count();
        let num_out_of_map = pairs.len() - num_in_map;
        if num_in_map == 0 {
            return None;
        }
        let weight = |it: &Judged<'_>| match (it.truth(), num_out_of_map) {
            (_, 0) => 1.0,
            (Some(_), _) => (1.0 - off_map) / num_in_map as f64,
            (None, _) => off_map / num_out_of_map as f64,
        };
        let difference = |of: fn(&Judged<'_>, &Judged<'_>) -> f64| -> Measured {
            let pairs = pairs.iter();
            let values = pairs.map(|(it, other)| (it.claim.group, of(it, other), weight(it)));
            Sample::weighted(values).estimate().into()
        };
        Some(Against {
            score: score.into(),
            brier: difference(|it, other| it.brier() - other.brier()),
            log_loss: difference(|it, other| it.log_loss() - other.log_loss()),
        })
    });
    compared.collect()
}

/// Judges every row of a run that has a posterior; with `parts` (datasets, of which the ids of
/// queries begin with `PART/`) the rows of the default's method for each of them as well.
pub fn judge_all(results: &SuiteResults, parts: &[String]) -> Vec<Judgement> {
    let all: Vec<&Query> = results.queries.iter().collect();
    let of_part = |part: &str| -> Vec<&Query> {
        let is_of = |query: &&Query| {
            let rest = query.id.strip_prefix(part);
            rest.is_some_and(|rest| rest.starts_with('/'))
        };
        results.queries.iter().filter(is_of).collect()
    };
    let mut sets = vec![(None, all)];
    sets.extend(
        parts
            .iter()
            .map(|part| (Some(part.as_str()), of_part(part))),
    );
    let default = results.default_variant().map(|variant| variant.method);
    let judged_n = |n: u32| JUDGED_N.contains(&n) || Some(n) == results.detail_n();
    let is_judged = |row: &&Row| judged_n(row.n);
    let mut judgements = Vec::new();
    for (part, queries) in sets {
        for (_, _, variants) in results.grouped() {
            for variant in variants {
                if part.is_some() && Some(&variant.method) != default.as_ref() {
                    continue;
                }
                let rows = results.rows.iter().filter(|row| row.variant == variant);
                judgements.extend(rows.filter(is_judged).filter_map(|row| {
                    let has_tolerance = results.tolerance.is_some();
                    judge(&queries, &row.key(), row.is_default, part, has_tolerance)
                }));
            }
        }
    }
    judgements
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Answer, Decision, OFF_MAP};
    use std::collections::BTreeMap;

    fn key(score: &str) -> RowKey {
        format!("default/static/mean/{score}/0/50").parse().unwrap()
    }

    fn answer(a: f64, b: f64) -> Answer {
        let first = if a >= b { "a" } else { "b" };
        Answer {
            first: Some(first.into()),
            decision: Decision::At(first.into()),
            posterior: BTreeMap::from([
                ("a".into(), a),
                ("b".into(), b),
                (OFF_MAP.into(), 1.0 - a - b),
            ]),
            ties: Vec::new(),
        }
    }

    fn query(id: &str, truth: Option<&str>, likelihood: Answer, count: Answer) -> Query {
        Query {
            id: id.into(),
            truth: truth.map(str::to_owned),
            near: Vec::new(),
            group: None,
            answers: BTreeMap::from([
                (key("likelihood").to_string(), likelihood),
                (key("count").to_string(), count),
            ]),
        }
    }

    fn results() -> SuiteResults {
        let mut results = SuiteResults::new("foreign", "made up");
        let queries = [
            query("x/1", Some("a"), answer(0.9, 0.0), answer(0.6, 0.3)),
            query("x/2", Some("b"), answer(0.0, 0.9), answer(0.5, 0.4)),
            query("y/3", Some("a"), answer(0.8, 0.1), answer(0.7, 0.1)),
            query("y/4", None, answer(0.1, 0.1), answer(0.5, 0.3)),
        ];
        results.queries.extend(queries);
        for score in ["likelihood", "count"] {
            let tally = crate::judge::rates::Tally::of(&results.queries, &key(score), false);
            results
                .rows
                .push(tally.into_row(&key(score), score == "likelihood"));
        }
        results
    }

    #[test]
    fn native_and_out_of_map_queries_are_judged_apart_and_together() {
        let results = results();
        let judgements = judge_all(&results, &["x".into(), "y".into()]);
        // Two scores for all queries and for each part.
        assert_eq!(judgements.len(), 6);
        let all = &judgements[0];
        assert_eq!((all.in_map.queries, all.part.as_deref()), (3, None));
        assert_eq!(all.in_map.recall_at_1.value, 1.0);
        let out_of_map = all.out_of_map.as_ref().unwrap();
        assert_eq!(out_of_map.queries, 1);
        // Brier by hand: 0.01 + 0.01, twice; 0.04 + 0.01 + 0.01.
        let brier = all.in_map.calibration.brier.value;
        assert!(
            (brier - (0.02 + 0.02 + 0.06) / 3.0).abs() < 1e-12,
            "{brier}"
        );
        // Out-of-map: 0.1^2 + 0.1^2 + (0.8 - 1)^2.
        assert!((out_of_map.calibration.brier.value - 0.06).abs() < 1e-12);
        let mixed = all.mixed.as_ref().unwrap();
        let by_hand = (1.0 - mixed.off_map) * brier + mixed.off_map * 0.06;
        assert!((mixed.calibration.brier.value - by_hand).abs() < 1e-12);
        // Part x knows no out-of-map query.
        let x = judgements
            .iter()
            .find(|it| it.part.as_deref() == Some("x"))
            .unwrap();
        assert!(x.out_of_map.is_none() && x.in_map.queries == 2);
    }

    #[test]
    fn the_better_score_has_the_negative_difference() {
        let results = results();
        let judgements = judge_all(&results, &[]);
        let against = &judgements[0].against;
        assert_eq!(against.len(), 1, "inliers are not in this run");
        assert_eq!(against[0].score, "count");
        assert!(against[0].brier.value < 0.0 && against[0].log_loss.value < 0.0);
        assert!(judgements[1].against.is_empty());
    }

    #[test]
    fn judgements_survive_their_file_and_need_a_posterior() {
        let mut results = results();
        results.judgement = judge_all(&results, &["x".into()]);
        let read = SuiteResults::from_json(&results.to_json().unwrap()).unwrap();
        assert_eq!(read, results);
        for query in &mut results.queries {
            for answer in query.answers.values_mut() {
                answer.posterior.clear();
            }
        }
        assert!(judge_all(&results, &[]).is_empty());
    }
}

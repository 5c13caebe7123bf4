//! What would a robot decide, and how often would that be wrong?
//!
//! Decisions are taken by risk ([`chronotope::localize::Decision::by_risk`]): at the most probable
//! place if the probability of being wrong is at most the risk; ambiguous if only being off the map
//! is that improbable; unknown otherwise. The score `likelihood` brings its decisions along; those
//! of the other scores are taken here by the same rule, from their calibrated posteriors.

use chronotope::localize::Decision as Rule;
use chronotope::map::NodeId;

use super::judged::{Claim, Judged, rate};
use crate::results::{AtRisk, Decision, Decisions, Outcome};

/// The risks of the curve.
const RISKS: [f64; 14] = [
    0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5,
];

/// Probabilities are written to about four digits, those near one half to half of this.
const ROUNDING: f64 = 5e-5;

/// What is decided about `judged`; with `has_own` their stored decisions count, else they are taken
/// here. With `has_tolerance`, what is wrong beyond the run's tolerance is counted as well.
pub(super) fn decisions(
    judged: &[Judged<'_>],
    risk: f64,
    has_own: bool,
    has_tolerance: bool,
) -> Decisions {
    let decide = |it: &Judged<'_>| -> Rule {
        // Which place it is does not matter here.
        let place = NodeId(0);
        match it.answer.decision {
            _ if !has_own => Rule::by_risk(place, it.claim.confidence, it.off_map(), risk),
            ref own if own.located().is_some() => Rule::At(place),
            Decision::Ambiguous => Rule::Ambiguous,
            _ => Rule::Unknown,
        }
    };
    let outcome = |wanted: Rule| {
        let is_so = |it: &Judged<'_>| f64::from(decide(it) == wanted);
        Outcome {
            share: rate(judged, is_so),
            wrong: rate(judged, |it| is_so(it) * (1.0 - it.claim.right)).value,
            wrong_within: has_tolerance.then(|| {
                let is_wrong = |it: &Judged<'_>| it.query.wrong_within(it.answer);
                rate(judged, |it| is_so(it) * is_wrong(it)).value
            }),
        }
    };
    Decisions {
        risk,
        located: outcome(Rule::At(NodeId(0))),
        ambiguous: outcome(Rule::Ambiguous),
        unknown: outcome(Rule::Unknown),
    }
}

/// The curve of false accepts against located queries over risks, ascending.
pub(super) fn at_risks(in_map: &[Claim<'_>], out_of_map: &[Claim<'_>]) -> Vec<AtRisk> {
    let share = |claims: &[Claim<'_>], risk: f64, value: fn(&Claim<'_>) -> f64| {
        let located = (claims.iter()).filter(|claim| 1.0 - claim.confidence <= risk + ROUNDING);
        located.map(value).fold(0.0, |sum, value| sum + value) / claims.len().max(1) as f64
    };
    (RISKS.into_iter())
        .map(|risk| AtRisk {
            risk,
            located: share(in_map, risk, |_| 1.0),
            located_wrong: share(in_map, risk, |claim| 1.0 - claim.right),
            accepted: (!out_of_map.is_empty()).then(|| share(out_of_map, risk, |_| 1.0)),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Answer, OFF_MAP, Query};
    use std::collections::BTreeMap;

    #[test]
    fn a_larger_risk_accepts_more_of_both_kinds() {
        let in_map = [
            Claim::alone(0.99, 1.0),
            Claim::alone(0.9, 0.0),
            Claim::alone(0.4, 1.0),
            Claim::alone(0.2, 1.0),
        ];
        let curve = at_risks(&in_map, &[Claim::alone(0.85, 0.0), Claim::alone(0.1, 0.0)]);
        let at = |risk: f64| *curve.iter().find(|point| point.risk == risk).unwrap();
        assert_eq!((at(0.01).located, at(0.01).located_wrong), (0.25, 0.0));
        assert_eq!((at(0.1).located, at(0.1).located_wrong), (0.5, 0.25));
        assert_eq!(
            (at(0.1).accepted, at(0.15).accepted),
            (Some(0.0), Some(0.5))
        );
        assert!(curve.is_sorted_by(|a, b| a.located <= b.located && a.accepted <= b.accepted));
        assert_eq!(at_risks(&in_map, &[])[0].accepted, None);
        assert!(
            at(0.001).located.is_sign_positive(),
            "nobody is not minus nobody"
        );
    }

    #[test]
    fn own_decisions_count_where_there_are_some() {
        let query = |p: f64, off_map: f64, decision| Query {
            id: String::new(),
            truth: Some("a".into()),
            near: Vec::new(),
            group: None,
            answers: BTreeMap::from([(
                "default/static/mean/count/0/50".to_owned(),
                Answer {
                    first: Some("b".into()),
                    decision,
                    posterior: BTreeMap::from([("b".into(), p), (OFF_MAP.into(), off_map)]),
                    ties: Vec::new(),
                },
            )]),
        };
        let queries = [
            query(0.95, 0.05, Decision::Unknown),
            query(0.5, 0.05, Decision::Unknown),
            query(0.5, 0.5, Decision::Unknown),
            query(0.2, 0.8, Decision::At("b".into())),
        ];
        let judged: Vec<Judged<'_>> = (queries.iter())
            .filter_map(|query| Judged::of(query, "default/static/mean/count/0/50"))
            .collect();
        let shares = |has_own| {
            let all = decisions(&judged, 0.1, has_own, false);
            [all.located, all.ambiguous, all.unknown].map(|it| (it.share.value, it.wrong))
        };
        assert_eq!(shares(false), [(0.25, 0.25), (0.25, 0.25), (0.5, 0.5)]);
        assert_eq!(shares(true), [(0.25, 0.25), (0.0, 0.0), (0.75, 0.75)]);
    }
}

//! What does a run show first: which method, at which n, and what is it worth?
//!
//! The method is the shipped default, never the best one. It is shown at the n where it differs
//! most from the static map, in whatever direction: of all n at which the 95 % interval of the
//! paired difference excludes zero, the one with the largest difference, and of equals the
//! smallest; where there is none, at the n that every run is shown at. This n is chosen by the
//! queries themselves, so that the difference at it is larger than it would be on others of the
//! kind; the plot and the tables have all n. A run of somebody's own images is shown at the n that is
//! shipped, because that is what he would get ([`SuiteResults::shown_n`]).

use std::fmt::Write as _;

use crate::judge::rates::PairedDifference;
use crate::results::{Row, SuiteResults, Variant};

/// The baseline that every method is compared with.
pub(super) const BASELINE: &str = "static";

/// What a run is about.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Headline {
    /// The method that the run is about.
    pub(super) variant: Variant,
    /// The number of features that it is shown at.
    pub(super) n: u32,
    /// The method against the static map at this n, where the run has one.
    pub(super) against_static: Option<PairedDifference>,
    /// How many features the static map needs to be wrong as seldom, where it is wrong more often
    /// at this n.
    pub(super) static_needs: Option<Needs>,
}

/// How many features a method needs for an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Needs {
    /// So many, between two n of the suite by a straight line.
    About(f64),
    /// More than the largest n of the suite.
    MoreThan(u32),
}

impl std::fmt::Display for Needs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::About(n) => write!(f, "about {n:.0}"),
            Self::MoreThan(n) => write!(f, "more than {n}"),
        }
    }
}

impl Headline {
    /// Of a run; none without rows.
    pub(super) fn of(results: &SuiteResults) -> Option<Self> {
        let variant = headline_variant(results)?;
        let fixed = results.shown_n.filter(|n| results.all_n().contains(n));
        let Some(other) = baseline(results, &variant) else {
            return Some(Self {
                variant,
                n: results.detail_n()?,
                against_static: None,
                static_needs: None,
            });
        };
        let against =
            |n: u32| PairedDifference::between(&results.queries, &other.at(n), &variant.at(n));
        let mut most: Option<(u32, f64)> = None;
        for n in results.all_n().into_iter().filter(|_| fixed.is_none()) {
            let clear = against(n).filter(|pair| pair.points.excludes_zero());
            let points = clear.map_or(0.0, |pair| pair.points.mean.abs());
            if points > most.map_or(0.0, |(_, most)| most) {
                most = Some((n, points));
            }
        }
        let n = fixed
            .or(most.map(|(n, _)| n))
            .or_else(|| results.detail_n())?;
        let against_static = against(n);
        let is_better =
            |pair: &PairedDifference| pair.points.excludes_zero() && pair.points.mean < 0.0;
        let error = results.row(&variant.at(n)).map(Row::wrong_percent);
        let static_needs = (against_static.filter(is_better))
            .and(error)
            .and_then(|error| needs(results, &other, error));
        Some(Self {
            variant,
            n,
            against_static,
            static_needs,
        })
    }

    /// In words, for a terminal; nothing where there is no row.
    pub(super) fn in_words(&self, results: &SuiteResults) -> String {
        let Some(row) = results.row(&self.variant.at(self.n)) else {
            return String::new();
        };
        let right = 100.0 - row.wrong_percent();
        let mut text = format!(
            "With {} features a place, {right:.1} % of {} images are located right",
            self.n, row.queries
        );
        if let Some(pair) = &self.against_static {
            let _ = write!(
                text,
                ", with a static map {:.1} %",
                100.0 - pair.first_percent
            );
        }
        text += ".\n";
        if let (Some(tolerance), Some(percent)) = (results.tolerance, row.within_percent()) {
            let _ = writeln!(
                text,
                "Within {} of the true place: {percent:.1} %.",
                tolerance.in_words()
            );
        }
        if let Some(needs) = self.static_needs {
            let _ = writeln!(
                text,
                "For as few mistakes the static map needs {needs} features a place."
            );
        }
        text
    }
}

/// The smallest number of features with which `variant` is wrong in at most `percent` of the
/// queries.
fn needs(results: &SuiteResults, variant: &Variant, percent: f64) -> Option<Needs> {
    let mut before: Option<(f64, f64)> = None;
    for n in results.all_n() {
        let Some(row) = results.row(&variant.at(n)) else {
            continue;
        };
        let (n, error) = (f64::from(n), row.wrong_percent());
        if error <= percent {
            return Some(Needs::About(match before {
                Some((n0, error0)) => n0 + (error0 - percent) / (error0 - error) * (n - n0),
                None => n,
            }));
        }
        before = Some((n, error));
    }
    results.all_n().last().map(|&n| Needs::MoreThan(n))
}

/// The variant that the headline is about: the shipped default, else the first FreMEn, else the
/// first of all. Never the best one: choosing it by the queries would flatter it.
pub(super) fn headline_variant(results: &SuiteResults) -> Option<Variant> {
    let variants = results.variants();
    results
        .default_variant()
        .or_else(|| variants.iter().find(|v| v.method == "fremen").cloned())
        .or_else(|| variants.first().cloned())
}

/// The baseline of the same preset and score, where the run has one other than `variant`.
pub(super) fn baseline(results: &SuiteResults, variant: &Variant) -> Option<Variant> {
    results.variants().into_iter().find(|other| {
        other.method == BASELINE
            && other.preset == variant.preset
            && other.score == variant.score
            && other != variant
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::rates::Tally;
    use crate::results::{Answer, Decision, Query};
    use std::collections::BTreeMap;

    const DEFAULT: &str = "default/fremen/rhythms/likelihood/2";
    const STATIC: &str = "default/static/mean/likelihood/0";

    /// A hundred queries, of which so many are wrong: `(n, default, static)`.
    fn run(wrong: &[(u32, usize, usize)]) -> SuiteResults {
        let mut results = SuiteResults::new("tiny", "made up");
        let keys: Vec<(String, usize)> = (wrong.iter())
            .flat_map(|&(n, default, fixed)| {
                [
                    (format!("{DEFAULT}/{n}"), default),
                    (format!("{STATIC}/{n}"), fixed),
                ]
            })
            .collect();
        for query in 0..100 {
            let answers = keys.iter().map(|(key, num_wrong)| {
                let first = if query < *num_wrong { "b" } else { "a" }.to_owned();
                let answer = Answer {
                    first: Some(first.clone()),
                    decision: Decision::At(first),
                    posterior: BTreeMap::new(),
                    ties: Vec::new(),
                };
                (key.clone(), answer)
            });
            results.queries.push(Query {
                id: query.to_string(),
                truth: Some("a".into()),
                near: Vec::new(),
                group: None,
                answers: answers.collect(),
            });
        }
        for (key, _) in &keys {
            let parsed = key.parse().unwrap();
            let tally = Tally::of(&results.queries, &parsed, false);
            results
                .rows
                .push(tally.into_row(&parsed, key.starts_with(DEFAULT)));
        }
        results
    }

    #[test]
    fn a_run_is_shown_where_the_methods_differ_most() {
        let results = run(&[(10, 30, 50), (20, 10, 40), (50, 0, 12), (100, 0, 0)]);
        let headline = Headline::of(&results).unwrap();
        assert_eq!(headline.n, 20);
        assert_eq!(headline.against_static.unwrap().points.mean, -30.0);
        // 12 % at 50 features, none at 100: 10 % are a sixth of the way on.
        let Some(Needs::About(needs)) = headline.static_needs else {
            panic!("{headline:?}");
        };
        assert!((needs - (50.0 + 50.0 / 6.0)).abs() < 1e-9, "{needs}");
        let text = headline.in_words(&results);
        assert!(
            text.starts_with("With 20 features a place, 90.0 % of 100 images"),
            "{text}"
        );
        assert!(
            text.contains("60.0 %") && text.contains("about 58 features"),
            "{text}"
        );
    }

    #[test]
    fn where_they_never_differ_clearly_the_usual_n_is_shown() {
        let headline = Headline::of(&run(&[(10, 1, 2), (50, 0, 1), (100, 0, 0)])).unwrap();
        assert_eq!((headline.n, headline.static_needs), (50, None));
        assert!(Headline::of(&SuiteResults::new("empty", "none")).is_none());
        let mut own = run(&[(10, 30, 50), (20, 10, 40), (50, 0, 12)]);
        own.shown_n = Some(50);
        let headline = Headline::of(&own).unwrap();
        assert_eq!(headline.n, 50);
        assert_eq!(headline.against_static.unwrap().points.mean, -12.0);
    }

    #[test]
    fn a_loss_is_shown_as_well_and_more_than_the_suite_has_is_said() {
        let lost = Headline::of(&run(&[(10, 50, 10), (50, 0, 9)])).unwrap();
        assert_eq!((lost.n, lost.static_needs), (10, None));
        let won = Headline::of(&run(&[(10, 10, 50), (50, 0, 12)])).unwrap();
        assert_eq!(won.static_needs, Some(Needs::MoreThan(50)));
    }
}

//! Is one run, or one method, better than another on the same queries?
//!
//! Rows are paired by key, queries by id. What only one side has is listed and left out, never
//! averaged in. The difference is B minus A in points of wrong answers, with the paired bootstrap
//! interval of [`statistics`](super::statistics); negative means that B is better.

use std::collections::BTreeMap;
use std::fmt;

use chronotope::{Error, ErrorKind, Result};

use super::rates::PairedDifference;
use crate::results::{Query, RowKey, SuiteResults};

/// One key that both runs have.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedRow {
    /// The row in both runs.
    pub key: RowKey,
    /// B against A.
    pub difference: PairedDifference,
}

/// Two runs, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// What A is: suite and commit.
    pub a: String,
    /// What B is.
    pub b: String,
    /// Rows that both have, in A's order.
    pub rows: Vec<ComparedRow>,
    /// Keys that only A answered.
    pub only_in_a: Vec<String>,
    /// Keys that only B answered.
    pub only_in_b: Vec<String>,
    /// Differences between the runs that the reader must know.
    pub warnings: Vec<String>,
}

/// Pairs two runs per key and query. Runs without a common row and query are an error.
pub fn compare(a: &SuiteResults, b: &SuiteResults) -> Result<Comparison> {
    let mut warnings = Vec::new();
    let mut differs = |what: &str, a: &str, b: &str| {
        if a != b {
            warnings.push(format!("{what} differ: A has `{a}`, B has `{b}`"));
        }
    };
    differs("suites", &a.suite, &b.suite);
    differs("datasets", &a.dataset_sha256, &b.dataset_sha256);
    differs("machines", &a.machine, &b.machine);
    let b_queries: BTreeMap<&str, &Query> = b
        .queries
        .iter()
        .map(|query| (query.id.as_str(), query))
        .collect();
    let pairs: Vec<(&Query, &Query)> = a
        .queries
        .iter()
        .filter_map(|query| Some((query, *b_queries.get(query.id.as_str())?)))
        .filter(|(a, b)| a.truth == b.truth)
        .collect();
    let only = |queries: usize| queries - pairs.len();
    if only(a.queries.len()) + only(b.queries.len()) > 0 {
        warnings.push(format!(
            "only {} queries are paired (same id and truth): {} of A and {} of B are left out",
            pairs.len(),
            only(a.queries.len()),
            only(b.queries.len())
        ));
    }
    let mut rows = Vec::new();
    let mut only_in_a = Vec::new();
    for row in &a.rows {
        let key = row.key();
        let name = key.to_string();
        let errors = pairs.iter().filter_map(|(a, b)| {
            let truth = Some(a.truth.as_deref()?);
            let a_wrong = a.answers.get(&name)?.wrong(truth);
            let b_wrong = b.answers.get(&name)?.wrong(truth);
            Some((a.group.as_deref(), a_wrong, b_wrong))
        });
        match PairedDifference::of(errors) {
            Some(difference) => rows.push(ComparedRow { key, difference }),
            None => only_in_a.push(name),
        }
    }
    if rows.is_empty() {
        return Err(Error::new(
            ErrorKind::Format,
            "the two runs have no row with answers to the same queries",
        )
        .with_help("compare two runs of one suite"));
    }
    let only_in_b = b
        .rows
        .iter()
        .map(|row| row.key().to_string())
        .filter(|name| rows.iter().all(|row| row.key.to_string() != *name))
        .filter(|name| !only_in_a.contains(name))
        .collect();
    Ok(Comparison {
        a: format!("{} at {}", a.suite, a.commit),
        b: format!("{} at {}", b.suite, b.commit),
        rows,
        only_in_a,
        only_in_b,
        warnings,
    })
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "A: {}\nB: {}", self.a, self.b)?;
        for warning in &self.warnings {
            writeln!(f, "note: {warning}")?;
        }
        writeln!(
            f,
            "Wrong answers in %, ties split; B - A in points with its paired 95 % bootstrap interval.\n"
        )?;
        writeln!(
            f,
            "{:>5} {:>7} {:>6} {:>6} {:>7} {:>18} {:>7} {:>6}",
            "n", "queries", "A", "B", "B - A", "interval", "better", "worse"
        )?;
        let mut heading = None;
        for row in &self.rows {
            if heading != Some(&row.key.variant) {
                heading = Some(&row.key.variant);
                writeln!(f, "{}", row.key.variant)?;
            }
            let d = &row.difference;
            let interval = format!(
                "[{:+.1}, {:+.1}]",
                d.points.interval.low, d.points.interval.high
            );
            writeln!(
                f,
                "{:>5} {:>7} {:>6.1} {:>6.1} {:>+7.1} {interval:>18} {:>7} {:>6}  {}",
                row.key.n,
                d.num_paired,
                d.first_percent,
                d.second_percent,
                d.points.mean,
                d.num_better,
                d.num_worse,
                verdict(d)
            )?;
        }
        for (side, keys) in [("A", &self.only_in_a), ("B", &self.only_in_b)] {
            if !keys.is_empty() {
                writeln!(f, "\nOnly in {side}: {}", keys.join(", "))?;
            }
        }
        Ok(())
    }
}

/// In words: what the interval allows to say about B.
fn verdict(difference: &PairedDifference) -> &'static str {
    match difference {
        d if d.num_better + d.num_worse == 0 => "the same on every query",
        d if !d.points.excludes_zero() => "",
        d if d.points.mean < 0.0 => "B is better",
        _ => "B is worse",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::rates::Tally;
    use crate::results::{Answer, Decision};

    /// Queries 0.. answered right where `right` says so.
    fn run(commit: &str, right: &[bool]) -> SuiteResults {
        let key: RowKey = "default/fremen/annual/count/1/30".parse().unwrap();
        let mut results = SuiteResults::new("tiny", "made up");
        results.commit = commit.into();
        for (i, &right) in right.iter().enumerate() {
            let first = if right { "a" } else { "b" }.to_owned();
            let answer = Answer {
                first: Some(first.clone()),
                decision: Decision::At(first),
                posterior: BTreeMap::new(),
                ties: Vec::new(),
            };
            results.queries.push(Query {
                id: i.to_string(),
                truth: Some("a".into()),
                near: Vec::new(),
                group: None,
                answers: BTreeMap::from([(key.to_string(), answer)]),
            });
        }
        let row = Tally::of(&results.queries, &key, false).into_row(&key, true);
        results.rows.push(row);
        results
    }

    #[test]
    fn a_run_is_the_same_as_itself() {
        let run = run("c1", &[true, false, true]);
        let comparison = compare(&run, &run).unwrap();
        assert_eq!(comparison.rows[0].difference.points.mean, 0.0);
        assert!(comparison.warnings.is_empty());
        let text = comparison.to_string();
        assert!(text.contains("the same on every query"), "{text}");
        assert!(
            text.lines().all(|line| line.chars().count() <= 100),
            "{text}"
        );
    }

    #[test]
    fn pairing_is_by_id_and_says_what_is_left_out() {
        let a = run("c1", &[false; 40]);
        let mut b = run("c2", &[true; 50]);
        b.queries.reverse();
        let comparison = compare(&a, &b).unwrap();
        let difference = &comparison.rows[0].difference;
        assert_eq!((difference.num_paired, difference.num_better), (40, 40));
        assert_eq!(difference.points.mean, -100.0);
        let text = comparison.to_string();
        assert!(
            text.contains("B is better") && text.contains("10 of B are left out"),
            "{text}"
        );
    }

    #[test]
    fn nothing_in_common_is_an_error() {
        let a = run("c1", &[true]);
        let mut b = a.clone();
        b.queries[0].id = "another query".into();
        assert!(compare(&a, &b).is_err());
    }
}

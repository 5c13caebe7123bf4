//! Do the numbers of a run agree with each other?

use std::collections::BTreeSet;

use chronotope::{Error, ErrorKind, Result};

use super::key::RowKey;
use super::rows::Row;
use super::suite_results::{SCHEMA_VERSION, SuiteResults};

impl SuiteResults {
    /// Checks the invariants that the module names.
    pub fn validate(&self) -> Result<()> {
        let fail = |place: String, message: String| {
            Err(Error::new(ErrorKind::Format, message).with_place(place))
        };
        if self.schema_version != SCHEMA_VERSION {
            return Err(unknown_version(self.schema_version));
        }
        let mut ids = BTreeSet::new();
        for query in &self.queries {
            let place = || format!("query `{}`", query.id);
            if !ids.insert(query.id.as_str()) {
                return fail(place(), "the id is there twice".into());
            }
            for (key, answer) in &query.answers {
                key.parse::<RowKey>()
                    .map_err(|error| error.with_place(place()))?;
                if let Some((name, p)) = answer
                    .posterior
                    .iter()
                    .find(|(_, p)| !(0.0..=1.0).contains(*p))
                {
                    let message = format!("`{key}`: {p} is no probability of `{name}`");
                    return fail(place(), message);
                }
                let tied_but_first = !answer.ties.is_empty()
                    && !answer
                        .ties
                        .iter()
                        .any(|tied| Some(tied) == answer.first.as_ref());
                if tied_but_first {
                    let message = format!("`{key}`: `first` is not among its `ties`");
                    return fail(place(), message);
                }
            }
        }
        if let Some(judgement) = self.judgement.iter().find(|it| !it.is_finite()) {
            let place = format!("judgement of `{}`", judgement.variant.at(judgement.n));
            return fail(place, "a number is not finite".into());
        }
        let mut keys = BTreeSet::new();
        for row in &self.rows {
            let key = row.key().to_string();
            let place = || format!("row `{key}`");
            key.parse::<RowKey>()
                .map_err(|error| error.with_place(place()))?;
            if !keys.insert(key.clone()) {
                return fail(place(), "the row is there twice".into());
            }
            self.validate_row(row, &key)
                .or_else(|message| fail(place(), message))?;
        }
        Ok(())
    }

    fn validate_row(&self, row: &Row, key: &str) -> Result<(), String> {
        let numbers = [
            ("correct", row.correct),
            ("wrong", row.wrong),
            ("ci_low", row.ci_low),
            ("ci_high", row.ci_high),
            ("reobserved", row.reobserved.unwrap_or(0.0)),
            ("pairs_compared", row.pairs_compared),
            ("ms_p50", row.ms_p50),
            ("ms_p99", row.ms_p99),
        ];
        for (name, number) in numbers {
            if !(number.is_finite() && number >= 0.0) {
                return Err(format!("`{name}` is {number}"));
            }
        }
        let queries = f64::from(row.queries);
        if !close(row.correct + row.wrong, queries) {
            return Err(format!(
                "correct {} + wrong {} is not the number of queries, {queries}",
                row.correct, row.wrong
            ));
        }
        if let Some(within) = &row.within {
            let shares = [within.correct, within.ci_low, within.ci_high];
            let is_sound = shares.iter().all(|it| it.is_finite() && *it >= 0.0)
                && within.correct <= queries + 1e-6
                && within.located <= row.queries
                && within.located_wrong <= within.located_wrong_exact
                && within.located_wrong_exact <= within.located;
            if !is_sound {
                return Err(format!(
                    "`within` does not fit {} queries: {within:?}",
                    row.queries
                ));
            }
        }
        let (mut count, mut wrong, mut tied) = (0_u32, 0.0, 0_u32);
        for query in self.queries.iter().filter(|query| query.truth.is_some()) {
            if let Some(answer) = query.answers.get(key) {
                count += 1;
                wrong += answer.wrong(query.truth.as_deref());
                tied += u32::from(answer.is_tied());
            }
        }
        if count == 0 || (count == row.queries && tied == row.tied && close(wrong, row.wrong)) {
            Ok(())
        } else {
            Err(format!(
                "says {} wrong and {} tied of {}, but its answers give {wrong}, {tied} and {count}",
                row.wrong, row.tied, row.queries
            ))
        }
    }
}

pub(super) fn unknown_version(version: u32) -> Error {
    Error::new(
        ErrorKind::Format,
        format!("schema version {version}, this program reads {SCHEMA_VERSION}"),
    )
    .with_help("run the suite again with this program, or read the file with the one that wrote it")
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * a.abs().max(b.abs()).max(1.0)
}

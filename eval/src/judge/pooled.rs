//! Is the default better than each known method, on the queries of all suites together?
//!
//! For each n the default row is paired, query by query, with every baseline: once with the *same
//! score*, and once with the score and model that the baseline does best with on these very
//! queries. Choosing the best by the answers flatters the baseline, never the default. All queries
//! weigh the same; whole groups are drawn, and queries of different suites are never of one group.
//! A suite that lacks a baseline is named and left out of its pool. Where a suite does not run the
//! published preset of a method, the method with the published score, `count`, stands in for it.

use std::fmt;

use chronotope::localize::{LocalizerConfig, Method, Preset, Score};
use chronotope::{Error, ErrorKind, Result};

use super::rates::PairedDifference;
use crate::results::{Row, SuiteResults, Variant};

/// The suites that are pooled.
pub const POOLED_SUITES: [&str; 4] = ["stromovka-loo", "michigan-loo", "lasvegas", "synthetic"];

/// Points of wrong answers that count as no worse.
pub const MARGIN: f64 = 3.0;

/// What the default is compared with: method, and its preset where only one is meant.
const BASELINES: [(&str, Option<&str>); 6] = [
    ("static", None),
    ("fremen", Some("lttl")),
    ("experience", None),
    ("experience-all", None),
    ("freex", None),
    ("fused", None),
];

/// Which of a baseline's rows is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// Preset and score of the default.
    SameScore,
    /// The one with the fewest wrong answers here, of any preset, model and score.
    Best,
}

/// The default against one baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct PooledRow {
    /// Features per place.
    pub n: u32,
    /// Method, with its preset where only one is meant.
    pub baseline: String,
    /// Which of its rows.
    pub rows: Rows,
    /// The suite; none for all together.
    pub suite: Option<String>,
    /// The row of the baseline, or how many suites are pooled.
    pub what: String,
    /// Default minus baseline: negative is better.
    pub difference: PairedDifference,
}

/// The comparisons with all baselines.
#[derive(Clone, Debug, PartialEq)]
pub struct Pooled {
    /// Suites and their default rows.
    pub defaults: Vec<(String, Variant)>,
    /// By n, baseline and rows: each suite, then all.
    pub rows: Vec<PooledRow>,
    /// What is missing, for the reader.
    pub notes: Vec<String>,
}

/// The default of a run: the row that says so, or, in a run without a clock, what stands in for it.
fn default_of(results: &SuiteResults) -> Option<Variant> {
    let cfg = LocalizerConfig::default();
    let is_ours = |variant: &Variant, method: Method| {
        variant.preset == Preset::Default.name() && variant.method == method.name()
    };
    let variants = results.variants();
    let has_clock = (variants.iter()).any(|variant| is_ours(variant, cfg.method()));
    results.default_variant().or_else(|| {
        let mut stand_ins = variants.into_iter().filter(|_| !has_clock);
        stand_ins.find(|it| is_ours(it, Method::Static) && it.score == cfg.score().name())
    })
}

/// The baseline's row that is meant, if this run has one.
fn baseline_of<'r>(
    results: &'r SuiteResults,
    default: &Variant,
    (method, preset): (&str, Option<&str>),
    rows: Rows,
    n: u32,
) -> Option<&'r Row> {
    let of_method = || {
        let rows = results.rows.iter().filter(|row| row.n == n);
        rows.filter(|row| row.variant.method == method && row.variant != *default)
    };
    if let Some(preset) = preset {
        // A published recipe has no score of ours.
        let published =
            of_method().filter(|row| rows == Rows::Best && row.variant.preset == preset);
        let stand_ins = of_method()
            .filter(|row| rows == Rows::Best && row.variant.score == Score::Count.name());
        let fewest = |a: &&Row, b: &&Row| a.wrong.total_cmp(&b.wrong);
        return published
            .min_by(fewest)
            .or_else(|| stand_ins.min_by(fewest));
    }
    let meant = of_method().filter(|row| {
        rows == Rows::Best
            || row.variant.score == default.score && row.variant.preset == default.preset
    });
    meant.min_by(|a, b| a.wrong.total_cmp(&b.wrong))
}

/// Compares the default with every baseline at each of `all_n`.
pub fn compare_pooled(runs: &[SuiteResults], all_n: &[u32]) -> Result<Pooled> {
    let mut notes = Vec::new();
    let mut defaults = Vec::new();
    for run in runs {
        match default_of(run) {
            Some(default) => defaults.push((run, default)),
            None => notes.push(format!("`{}` has no row of the default", run.suite)),
        }
    }
    let mut compared = Vec::new();
    for &n in all_n {
        for baseline in BASELINES {
            for rows in [Rows::SameScore, Rows::Best] {
                one_baseline(&defaults, n, baseline, rows, &mut compared, &mut notes);
            }
        }
    }
    if compared.is_empty() {
        return Err(Error::new(
            ErrorKind::Format,
            "no run has the default and a method to compare it with",
        )
        .with_help(format!("run the suites {}", POOLED_SUITES.join(", "))));
    }
    Ok(Pooled {
        defaults: (defaults.into_iter())
            .map(|(run, default)| (run.suite.clone(), default))
            .collect(),
        rows: compared,
        notes,
    })
}

fn one_baseline(
    defaults: &[(&SuiteResults, Variant)],
    n: u32,
    baseline: (&str, Option<&str>),
    rows: Rows,
    compared: &mut Vec<PooledRow>,
    notes: &mut Vec<String>,
) {
    let name = match baseline {
        (method, Some(preset)) => format!("{method} ({preset})"),
        (method, None) => method.to_owned(),
    };
    let mut errors: Vec<(String, f64, f64)> = Vec::new();
    let (mut num_suites, mut missing) = (0, Vec::new());
    for (run, default) in defaults {
        // Where the default is the baseline itself, they are equal by definition.
        let stands_in =
            baseline.0 == default.method && rows == Rows::SameScore && baseline.1.is_none();
        let key = if stands_in {
            default.at(n)
        } else {
            let Some(row) = baseline_of(run, default, baseline, rows, n) else {
                missing.push(run.suite.as_str());
                continue;
            };
            row.key()
        };
        let Some(difference) = PairedDifference::between(&run.queries, &key, &default.at(n)) else {
            missing.push(run.suite.as_str());
            continue;
        };
        num_suites += 1;
        errors.extend(paired_errors(
            run,
            &key.to_string(),
            &default.at(n).to_string(),
        ));
        compared.push(PooledRow {
            n,
            baseline: name.clone(),
            rows,
            suite: Some(run.suite.clone()),
            what: key.variant.to_string(),
            difference,
        });
    }
    let pairs = errors
        .iter()
        .map(|(group, a, b)| (Some(group.as_str()), *a, *b));
    if let Some(difference) = PairedDifference::of(pairs) {
        if !missing.is_empty() {
            let same = if rows == Rows::SameScore {
                ", same score"
            } else {
                ""
            };
            notes.push(format!(
                "{name}{same}, n = {n}: not in {}",
                missing.join(", ")
            ));
        }
        compared.push(PooledRow {
            n,
            baseline: name,
            rows,
            suite: None,
            what: format!("{num_suites} suites"),
            difference,
        });
    }
}

/// `(group, wrong of first, wrong of second)` for each query that both answered.
fn paired_errors<'r>(
    run: &'r SuiteResults,
    first: &'r str,
    second: &'r str,
) -> impl Iterator<Item = (String, f64, f64)> + 'r {
    run.queries.iter().filter_map(move |query| {
        let truth = Some(query.truth.as_deref()?);
        let group = query.group.as_deref().unwrap_or(&query.id);
        Some((
            format!("{}/{group}", run.suite),
            query.answers.get(first)?.wrong(truth),
            query.answers.get(second)?.wrong(truth),
        ))
    })
}

/// In words: what the interval allows to say about the default.
fn verdict(difference: &PairedDifference) -> String {
    let interval = difference.points.interval;
    match difference {
        d if d.num_better + d.num_worse == 0 => "the same on every query".into(),
        _ if interval.high < 0.0 => "better".into(),
        _ if interval.low > MARGIN => format!("worse by more than {MARGIN}"),
        _ if interval.low > 0.0 && interval.high <= MARGIN => {
            format!("worse by less than {MARGIN}")
        }
        _ if interval.low > 0.0 => "worse".into(),
        _ if interval.high <= MARGIN => format!("not worse by more than {MARGIN}"),
        _ => "not decided".into(),
    }
}

impl fmt::Display for Pooled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "Wrong answers in %, ties split: the default against each baseline on the same queries;\n\
             the difference (negative: the default is better) in points with its paired 95 % interval.\n"
        )?;
        for (suite, default) in &self.defaults {
            writeln!(f, "default of {suite}: {default}")?;
        }
        let mut heading = None;
        for row in &self.rows {
            if heading != Some((row.n, &row.baseline, row.rows)) {
                heading = Some((row.n, &row.baseline, row.rows));
                let rows = match row.rows {
                    Rows::SameScore => "with the score of the default",
                    Rows::Best => "with its best score and model on these queries",
                };
                writeln!(f, "\nn = {}, against {} {rows}", row.n, row.baseline)?;
            }
            let d = &row.difference;
            let interval = d.points.interval;
            writeln!(
                f,
                "{:<14} {:>5} queries {:>5.1} against {:>5.1}  {:>+5.1} [{:+.1}, {:+.1}]  {}{}",
                row.suite.as_deref().unwrap_or("ALL"),
                d.num_paired,
                d.second_percent,
                d.first_percent,
                d.points.mean,
                interval.low,
                interval.high,
                verdict(d),
                if row.suite.is_some() && row.rows == Rows::Best {
                    format!("  ({})", row.what)
                } else {
                    String::new()
                }
            )?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::rates::Tally;
    use crate::results::{Answer, Decision, Query};
    use std::collections::BTreeMap;

    const DEFAULT: &str = "default/fremen/rhythms/likelihood/1/30";
    const STATIC: &str = "default/static/mean/likelihood/0/30";
    const COUNT: &str = "default/static/mean/count/0/30";

    /// Queries answered by rows, right where the list says so.
    fn run(suite: &str, rows: &[(&str, &[bool])]) -> SuiteResults {
        let mut results = SuiteResults::new(suite, "made up");
        for i in 0..rows[0].1.len() {
            let answers = rows.iter().map(|(key, right)| {
                let first = if right[i] { "a" } else { "b" }.to_owned();
                let answer = Answer {
                    first: Some(first.clone()),
                    decision: Decision::At(first),
                    posterior: BTreeMap::new(),
                    ties: Vec::new(),
                };
                ((*key).to_owned(), answer)
            });
            results.queries.push(Query {
                id: i.to_string(),
                truth: Some("a".into()),
                near: Vec::new(),
                group: None,
                answers: answers.collect(),
            });
        }
        for (key, _) in rows {
            let key = key.parse().unwrap();
            let row =
                Tally::of(&results.queries, &key, false).into_row(&key, key.to_string() == DEFAULT);
            results.rows.push(row);
        }
        results
    }

    fn of<'p>(pooled: &'p Pooled, suite: Option<&str>, rows: Rows) -> &'p PooledRow {
        let mut all = pooled.rows.iter();
        all.find(|row| {
            row.baseline == "static" && row.suite.as_deref() == suite && row.rows == rows
        })
        .unwrap()
    }

    #[test]
    fn all_queries_weigh_the_same_and_the_best_row_is_chosen_per_suite() {
        let runs = [
            run(
                "one",
                &[
                    (DEFAULT, &[true; 30]),
                    (STATIC, &[false; 30]),
                    (COUNT, &[true; 30]),
                ],
            ),
            run("two", &[(DEFAULT, &[true; 10]), (STATIC, &[true; 10])]),
        ];
        let pooled = compare_pooled(&runs, &[30]).unwrap();
        let all = of(&pooled, None, Rows::SameScore);
        // 30 of 40 queries are 100 points better.
        assert_eq!(
            (all.difference.num_paired, all.difference.points.mean),
            (40, -75.0)
        );
        assert_eq!(
            of(&pooled, Some("one"), Rows::SameScore)
                .difference
                .points
                .mean,
            -100.0
        );
        let best = of(&pooled, Some("one"), Rows::Best);
        assert!(best.what.contains("count") && best.difference.points.mean == 0.0);
        let text = pooled.to_string();
        assert!(
            text.contains("better") && text.contains("the same on every query"),
            "{text}"
        );
    }

    #[test]
    fn without_a_clock_static_stands_in_and_is_equal_to_itself() {
        let without_clock = run("park", &[(STATIC, &[true, false]), (COUNT, &[true, true])]);
        let pooled = compare_pooled(&[without_clock], &[30]).unwrap();
        assert_eq!(
            of(&pooled, None, Rows::SameScore).difference.points.mean,
            0.0
        );
        assert_eq!(of(&pooled, None, Rows::Best).difference.points.mean, 50.0);
    }

    #[test]
    fn where_time_is_known_nothing_stands_in_for_a_missing_default() {
        let other = "default/fremen/day/likelihood/1/30";
        let without_default = run("town", &[(STATIC, &[true, true]), (other, &[true, false])]);
        assert!(default_of(&without_default).is_none());
        assert!(compare_pooled(&[without_default], &[30]).is_err());
    }

    #[test]
    fn the_published_score_stands_in_for_the_published_preset() {
        let counted = "default/fremen/rhythms/count/1/30";
        let published = "lttl/fremen/annual/count/1/30";
        let all = [
            (DEFAULT, &[true; 4][..]),
            (counted, &[true, true, false, false]),
        ];
        let with_preset = [all[0], all[1], (published, &[false; 4])];
        let pooled = compare_pooled(&[run("one", &all), run("two", &with_preset)], &[30]).unwrap();
        let what = |suite: &str| {
            let mut rows = pooled.rows.iter();
            let row = rows
                .find(|row| row.suite.as_deref() == Some(suite))
                .unwrap();
            (
                row.baseline.as_str(),
                row.what.as_str(),
                row.difference.points.mean,
            )
        };
        let name = "fremen (lttl)";
        assert_eq!(what("one"), (name, "default/fremen/rhythms/count/1", -50.0));
        assert_eq!(what("two"), (name, "lttl/fremen/annual/count/1", -100.0));
    }

    #[test]
    fn nothing_to_compare_with_is_an_error() {
        let alone = run("one", &[(DEFAULT, &[true; 3])]);
        assert!(compare_pooled(std::slice::from_ref(&alone), &[30]).is_err());
        assert!(compare_pooled(&[alone], &[75]).is_err());
        assert!(compare_pooled(&[], &[30]).is_err());
    }

    #[test]
    fn verdicts_follow_the_interval() {
        let words = |first: f64, second: f64, share: usize| {
            let pairs = (0..100).map(|i| (None, first * f64::from(i < share as i32), second));
            verdict(&PairedDifference::of(pairs).unwrap())
        };
        assert_eq!(words(1.0, 0.0, 50), "better");
        assert_eq!(words(0.0, 0.0, 50), "the same on every query");
        assert_eq!(words(0.0, 1.0, 50), "worse by more than 3");
    }
}

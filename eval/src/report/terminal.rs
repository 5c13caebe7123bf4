//! What does a run say at a glance, in a terminal of 100 columns?
//!
//! Two blocks: wrong answers in % over n for every method, and for a chosen n the same with
//! intervals, re-observation, cost in compared pairs and time. Rows are grouped by preset and
//! score, so that lines next to each other may be compared.

use super::facts::{header_lines, short_count, short_ms, short_name};
use super::headline::Headline;
use crate::results::{Judgement, Row, SuiteResults, Variant};
use std::fmt::Write as _;

/// Columns of the methods' names.
const NAME_WIDTH: usize = 33;

/// Largest number of n that fit beside the names.
const MAX_N_COLUMNS: usize = 13;

/// The run as text, at most 100 columns wide (the header's own values aside).
///
/// `n` chooses the row that is shown in detail; `None` takes that of the headline.
pub fn render(results: &SuiteResults, n: Option<u32>) -> String {
    let headline = Headline::of(results);
    let words = headline.as_ref().map(|headline| headline.in_words(results));
    let mut text = words.map_or_else(String::new, |words| words + "\n");
    let _ = writeln!(text, "Suite {}", results.suite);
    for (name, value) in header_lines(results) {
        let _ = writeln!(text, "  {name:<11}{value}");
    }
    for note in &results.notes {
        let _ = writeln!(text, "  {:<11}{note}", "Note");
    }
    let Some(n) = n.or(headline.as_ref().map(|headline| headline.n)) else {
        text.push_str("\nNo rows.\n");
        return text;
    };
    over_n(&mut text, results);
    at_n(&mut text, results, n);
    within_tolerance(&mut text, results, n);
    // Not every n is judged.
    let is_judged = results.judgement.iter().any(|it| it.n == n);
    let judged_n = results.detail_n().filter(|_| !is_judged).unwrap_or(n);
    judgement(&mut text, results, judged_n);
    visibility_errors(&mut text, results);
    if results.rows.iter().any(|row| row.is_default) {
        text.push_str("\n* the shipped default configuration\n");
    }
    text
}

fn over_n(text: &mut String, results: &SuiteResults) {
    for (block, all_n) in results.all_n().chunks(MAX_N_COLUMNS).enumerate() {
        let more = if block == 0 { "" } else { ", continued" };
        let _ = write!(
            text,
            "\nWrong answers in %, ties split, over n features per place{more}\n{:<NAME_WIDTH$}",
            "method model order        n ="
        );
        for n in all_n {
            let _ = write!(text, "{n:>5}");
        }
        text.push('\n');
        for_each_variant(text, results, |text, variant| {
            for &n in all_n {
                let cell = results
                    .row(&variant.at(n))
                    .map_or_else(|| "-".to_owned(), short_percent);
                let _ = write!(text, "{cell:>5}");
            }
        });
    }
}

fn short_percent(row: &Row) -> String {
    let percent = row.wrong_percent();
    if percent >= 99.95 {
        "100".to_owned()
    } else {
        format!("{percent:.1}")
    }
}

fn at_n(text: &mut String, results: &SuiteResults, n: u32) {
    let _ = writeln!(text, "\nAt n = {n}, with 95 % bootstrap intervals");
    let _ = writeln!(
        text,
        "{:<NAME_WIDTH$}{:>7} {:>15}{:>5}{:>8}{:>9}{:>8}{:>8}",
        "method model order", "wrong %", "interval", "tied", "re-obs%", "pairs", "ms p50", "p99"
    );
    for_each_variant(text, results, |text, variant| {
        let Some(row) = results.row(&variant.at(n)) else {
            text.push_str("      -");
            return;
        };
        let interval = format!("[{:.1}, {:.1}]", row.ci_low, row.ci_high);
        let reobserved = row
            .reobserved
            .map_or_else(|| "-".to_owned(), |percent| format!("{percent:.1}"));
        let _ = write!(
            text,
            "{:>7.1} {interval:>15}{:>5}{reobserved:>8}{:>9}{:>8}{:>8}",
            row.wrong_percent(),
            row.tied,
            short_count(row.pairs_compared),
            short_ms(row.ms_p50),
            short_ms(row.ms_p99)
        );
    });
}

/// What rows are worth within the run's tolerance; nothing where it has none.
fn within_tolerance(text: &mut String, results: &SuiteResults, n: u32) {
    let Some(tolerance) = results.tolerance else {
        return;
    };
    let tolerance = tolerance.in_words();
    let _ = writeln!(
        text,
        "\nWithin {tolerance}, n = {n}; of what was located, wrong exactly and beyond {tolerance}\n\
         {:<NAME_WIDTH$}{:>9}{:>9} {:>16}{:>10}{:>9}{:>9}",
        "method model order", "exact %", "within %", "interval", "located %", "exact %", "beyond %"
    );
    for_each_variant(text, results, |text, variant| {
        let row = results.row(&variant.at(n));
        let Some((row, within)) = row.and_then(|row| Some((row, row.within?))) else {
            text.push_str("      -");
            return;
        };
        let share = |count: f64, of: u32| 100.0 * count / f64::from(of.max(1));
        let interval = format!("[{:.1}, {:.1}]", within.ci_low, within.ci_high);
        let _ = write!(
            text,
            "{:>9.1}{:>9.1} {interval:>16}{:>10.1}{:>9.1}{:>9.1}",
            share(row.correct, row.queries),
            share(within.correct, row.queries),
            share(f64::from(within.located), row.queries),
            share(f64::from(within.located_wrong_exact), within.located),
            share(f64::from(within.located_wrong), within.located)
        );
    });
}

/// How far each model of visibility is from the truth; nothing where that is not known.
fn visibility_errors(text: &mut String, results: &SuiteResults) {
    if results.visibility_errors.is_empty() {
        return;
    }
    let _ = writeln!(
        text,
        "\nPredicted visibility against the truth, mean |p - truth| (95 % interval)"
    );
    for error in &results.visibility_errors {
        let mark = if error.is_default { '*' } else { ' ' };
        let _ = writeln!(
            text,
            "{mark} {:<NAME_WIDTH$}{:>7.3}   [{:.3}, {:.3}]",
            error.model, error.mean, error.ci_low, error.ci_high
        );
    }
}

/// What posteriors and decisions are worth at `n`; nothing where no row was judged.
fn judgement(text: &mut String, results: &SuiteResults, n: u32) {
    let judged = || results.judgement.iter().filter(|it| it.n == n);
    if judged().next().is_none() {
        return;
    }
    let has_out_of_map = judged().any(|it| it.out_of_map.is_some());
    let _ = writeln!(
        text,
        "\nPosterior at n = {n}{} (ECE: calibration error of the first choice)",
        if has_out_of_map {
            ", out-of-map queries mixed in by the prior"
        } else {
            ""
        }
    );
    let _ = writeln!(
        text,
        "{:<NAME_WIDTH$}{:>7}{:>7}{:>7}{:>8}{:>7} {:>15}{:>7}{:>7}",
        "method model order", "R@1", "R@5", "AP", "R@100P", "ECE", "interval", "Brier", "ln p"
    );
    for_each_judged(text, results, n, |text, it| {
        let calibration = it.calibration();
        let ece = calibration.expected_error;
        let interval = format!("[{:.3}, {:.3}]", ece.ci_low, ece.ci_high);
        let _ = write!(
            text,
            "{:>7.3}{:>7.3}{:>7.3}{:>8.3}{:>7.3} {interval:>15}{:>7.3}{:>7.3}",
            it.in_map.recall_at_1.value,
            it.in_map.recall_at_5.value,
            it.retrieval().average_precision,
            it.retrieval().recall_at_full_precision,
            ece.value,
            calibration.brier.value,
            calibration.log_loss.value
        );
    });
    decisions(text, results, n);
    for it in judged().filter(|it| it.is_default && it.part.is_none()) {
        for against in &it.against {
            let _ = writeln!(
                text,
                "default against calibrated {}: Brier {:+.3} [{:+.3}, {:+.3}], ln p {:+.3} [{:+.3}, {:+.3}]",
                against.score,
                against.brier.value,
                against.brier.ci_low,
                against.brier.ci_high,
                against.log_loss.value,
                against.log_loss.ci_low,
                against.log_loss.ci_high
            );
        }
    }
}

/// What is decided at `n` by the default risk.
fn decisions(text: &mut String, results: &SuiteResults, n: u32) {
    let judged = || results.judgement.iter().filter(|it| it.n == n);
    let has_out_of_map = judged().any(|it| it.out_of_map.is_some());
    let risk = judged().next().map_or(0.0, |it| it.in_map.decisions.risk);
    let _ = writeln!(
        text,
        "\nDecisions at n = {n} and risk {risk}, % of queries (in brackets: with a wrong first choice)"
    );
    let _ = writeln!(
        text,
        "{:<NAME_WIDTH$}{:>15}{:>15}{:>15}{:>21}",
        "method model order",
        "located",
        "ambiguous",
        "unknown",
        if has_out_of_map {
            "out-of-map accepted"
        } else {
            ""
        }
    );
    for_each_judged(text, results, n, |text, it| {
        let decisions = &it.in_map.decisions;
        for outcome in [decisions.located, decisions.ambiguous, decisions.unknown] {
            let cell = format!(
                "{:.1} ({:.1})",
                100.0 * outcome.share.value,
                100.0 * outcome.wrong
            );
            let _ = write!(text, "{cell:>15}");
        }
        if let Some(out_of_map) = &it.out_of_map {
            let accepted = out_of_map.decisions.located.share;
            let cell = format!(
                "{:.1} [{:.1}, {:.1}]",
                100.0 * accepted.value,
                100.0 * accepted.ci_low,
                100.0 * accepted.ci_high
            );
            let _ = write!(text, "{cell:>21}");
        }
    });
}

/// Writes one line per judged row at `n` under headings of part, preset and score.
fn for_each_judged(
    text: &mut String,
    results: &SuiteResults,
    n: u32,
    mut cells: impl FnMut(&mut String, &Judgement),
) {
    let mut heading = None;
    for it in results.judgement.iter().filter(|it| it.n == n) {
        let at = (
            it.part.as_deref(),
            it.variant.preset.as_str(),
            it.variant.score.as_str(),
        );
        if heading != Some(at) {
            heading = Some(at);
            let part = it
                .part
                .as_ref()
                .map_or_else(String::new, |part| format!("{part}: "));
            let _ = writeln!(
                text,
                "{part}preset {}, score {}",
                it.variant.preset, it.variant.score
            );
        }
        let mark = if it.is_default { '*' } else { ' ' };
        let name = format!("{mark} {}", short_name(&it.variant));
        let _ = write!(text, "{:<NAME_WIDTH$}", clip(&name, NAME_WIDTH - 1));
        cells(text, it);
        text.push('\n');
    }
}

/// Writes one line per variant under headings of preset and score.
fn for_each_variant(
    text: &mut String,
    results: &SuiteResults,
    mut cells: impl FnMut(&mut String, &Variant),
) {
    let default = results.default_variant();
    for (preset, score, variants) in results.grouped() {
        let _ = writeln!(text, "preset {preset}, score {score}");
        for variant in variants {
            let mark = if Some(&variant) == default.as_ref() {
                '*'
            } else {
                ' '
            };
            let name = format!("{mark} {}", short_name(&variant));
            let _ = write!(text, "{:<NAME_WIDTH$}", clip(&name, NAME_WIDTH - 1));
            cells(text, &variant);
            text.push('\n');
        }
    }
}

fn clip(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    let mut clipped: String = text.chars().take(width - 1).collect();
    clipped.push('…');
    clipped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::sample_results;

    #[test]
    fn fits_into_100_columns_and_names_every_row() {
        let results = sample_results();
        let text = render(&results, None);
        let (first, text) = text.split_once("\n\n").unwrap();
        assert!(first.starts_with("With ") && first.lines().all(|line| line.len() <= 100));
        let (header, body) = text.split_once("\n\n").unwrap();
        assert!(header.contains(&results.command) && header.contains("queries"));
        for line in body.lines() {
            assert!(line.chars().count() <= 100, "{line}");
        }
        for variant in results.variants() {
            assert!(body.contains(&variant.method), "{variant}");
        }
        assert!(
            body.contains(&format!("At n = {}", Headline::of(&results).unwrap().n))
                && body.contains("\n* "),
            "{body}"
        );
        assert!(render(&results, Some(30)).contains("At n = 30"));
    }

    #[test]
    fn an_empty_run_says_so() {
        let text = render(&SuiteResults::new("tiny", "made up"), None);
        assert!(text.contains("No rows"), "{text}");
    }
}

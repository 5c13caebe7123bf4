//! What does a run over series say at a glance, in a terminal of 100 columns?

use std::fmt::Write as _;

use super::results::{Measured, Row, SeriesResults, facts, is_in_table};
use super::sampling::Sampling;

/// The results as a table of 100 columns.
pub fn table(results: &SeriesResults) -> String {
    let mut text = format!("Suite {}: {}\n", results.suite, results.title);
    for (name, value) in facts(results) {
        let _ = writeln!(text, "  {name:<11}{value}");
    }
    for sampling in Sampling::ALL {
        let rows: Vec<&Row> = (results.rows.iter())
            .filter(|row| row.sampling == sampling && is_in_table(row))
            .collect();
        let Some(first) = rows.first() else { continue };
        let _ = writeln!(
            text,
            "\nLearnt from {} samples ({:.0} of them)\n{:<24}{:>6}{:>8}{:>6} {:>15} {:>17} {:>6}  parts, wrong %",
            sampling.name(),
            first.num_learnt,
            "model",
            "order",
            "wrong %",
            "Brier",
            "interval",
            "against the mean",
            "log l."
        );
        for row in rows {
            let interval = |m: Measured| format!("[{:.3}, {:.3}]", m.low, m.high);
            let signed = |m: Measured| format!("[{:+.3}, {:+.3}]", m.low, m.high);
            let parts = row
                .parts
                .iter()
                .map(|(_, error)| format!("{:.1}", 100.0 * error));
            let _ = writeln!(
                text,
                "{} {:<22}{:>6}{:>8.1}{:>6.3} {:>15} {:>17} {:>6.3}  {}",
                if row.is_default { '*' } else { ' ' },
                row.model,
                row.order.to_string(),
                100.0 * row.state_error.value,
                row.brier.value,
                interval(row.brier),
                signed(row.brier_against_mean),
                row.log_loss.value,
                parts.collect::<Vec<_>>().join(" ")
            );
        }
    }
    text.push_str("\n* the model that the documentation recommends\n");
    text
}

//! What does the table of a speed report look like in a terminal?

use std::fmt::Write as _;

use super::{Measurement, SpeedReport};

/// One block for each section, one line for each measurement.
pub(super) fn render(report: &SpeedReport) -> String {
    let mut text = String::new();
    let SpeedReport {
        machine,
        commit,
        command,
        material,
        ..
    } = report;
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "Machine   {machine}\nCommit    {commit}\nCommand   {command}"
    );
    let _ = writeln!(text, "Material  {material}");
    for missing in &report.missing {
        let _ = writeln!(text, "Missing   {missing}");
    }
    let mut section = "";
    for row in &report.measurements {
        if row.section != section {
            section = &row.section;
            let _ = writeln!(
                text,
                "\n{section}\n  {:<22}{:<30}{:>11}{:>11}{:>10}{:>9}{:>9}  note",
                "case", "subject", "p50 ms", "p99 ms", "ns/pair", "ratio", "nearest"
            );
        }
        let _ = writeln!(text, "{}", line(report, row).trim_end());
    }
    text
}

fn line(report: &SpeedReport, row: &Measurement) -> String {
    let or_blank = |text: Option<String>| text.unwrap_or_default();
    let ns = row.pairs.map(|pairs| row.ms_p50 * 1e6 / pairs as f64);
    format!(
        "  {:<22}{:<30}{:>11.3}{:>11}{:>10}{:>9}{:>9}  {}",
        row.case,
        row.subject,
        row.ms_p50,
        or_blank(row.ms_p99.map(|ms| format!("{ms:.3}"))),
        or_blank(ns.map(|ns| format!("{ns:.3}"))),
        or_blank(report.ratio(row).map(|ratio| format!("{ratio:.2}x"))),
        or_blank(row.recall.map(|recall| format!("{:.1} %", 100.0 * recall))),
        row.note
    )
}

//! What does the table of a speed report look like in a terminal?

use std::fmt::Write as _;

use super::measurement::{Measurement, SpeedReport};
use super::targets::{ENOUGH, break_even};

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
    let (mut case_width, mut subject_width) = (0, 0);
    for row in &report.measurements {
        if row.section != section {
            section = &row.section;
            case_width = width_of(report, section, "case", |row| &row.case);
            subject_width = width_of(report, section, "subject", |row| &row.subject);
            let _ = writeln!(
                text,
                "\n{section}\n  {:<case_width$}{:<subject_width$}{:>11}{:>11}{:>11}{:>10}{:>7}{:>9}{:>9}  note",
                "case",
                "subject",
                "best ms",
                "p50 ms",
                "p99 ms",
                "ns/pair",
                "bytes",
                "ratio",
                "nearest"
            );
        }
        let line = line(report, row, case_width, subject_width);
        let _ = writeln!(text, "{}", line.trim_end());
    }
    compare(report, &mut text);
    if let Some(places) = break_even(report) {
        let _ = writeln!(
            text,
            "\nShort lists overtake the exact answer at about {places:.0} places"
        );
    }
    if report.targets.iter().any(|target| target.found.is_some()) {
        text.push_str("\nTargets\n");
    }
    for target in report
        .targets
        .iter()
        .filter(|target| target.found.is_some())
    {
        let _ = writeln!(
            text,
            "  {:<82}{:>8}{:>9}  {}",
            target.name,
            target.wanted_text(),
            target.found_text(),
            target.verdict()
        );
    }
    text
}

/// For each set that was searched: our fastest kernel against the exact rivals and its limit, our
/// inverted file against the approximate ones that find as many.
fn compare(report: &SpeedReport, text: &mut String) {
    let of = |case: &str, accept: &dyn Fn(&Measurement) -> bool| {
        report
            .measurements
            .iter()
            .filter(|row| row.case == case && row.section == super::search::SECTION && accept(row))
            .min_by(|a, b| a.ms_best.total_cmp(&b.ms_best))
    };
    let mut cases: Vec<&str> = report
        .measurements
        .iter()
        .filter(|row| row.section == super::search::SECTION)
        .map(|row| row.case.as_str())
        .collect();
    cases.dedup();
    if !cases.is_empty() {
        text.push_str("\nHow we compare\n");
    }
    for case in cases {
        let kernels = || chronotope::simd::Kernel::available().map(chronotope::simd::Kernel::name);
        let Some(ours) = of(case, &|row| kernels().any(|name| row.subject == name)) else {
            continue;
        };
        // Writing to a string cannot fail.
        let _ = write!(text, "  {case}: {}", ours.subject);
        let exact = ["OpenCV BFMatcher", "FAISS flat"];
        for rival in exact
            .iter()
            .filter_map(|name| of(case, &|row| row.subject == *name))
        {
            let ratio = rival.ms_best / ours.ms_best;
            let _ = write!(text, ", {ratio:.1}x {}", rival.subject);
        }
        let limit = format!("{}: popcounts alone", ours.subject);
        if let Some(limit) = of(case, &|row| row.subject == limit) {
            let percent = 100.0 * limit.ms_best / ours.ms_best;
            let _ = write!(text, ", {percent:.0} % of its popcount limit");
        }
        text.push('\n');
        let finds = |row: &Measurement| row.recall.is_some_and(|recall| recall >= ENOUGH);
        let family =
            |name: &'static str| of(case, &|row| row.subject.starts_with(name) && finds(row));
        if let Some(ours) = family("ours, IVF") {
            let _ = write!(text, "  {case}, nearest >= 99 %: {}", ours.subject);
            for rival in ["FAISS IVF", "FAISS HNSW", "hnsw_rs"]
                .into_iter()
                .filter_map(family)
            {
                let ratio = rival.ms_best / ours.ms_best;
                let _ = write!(text, ", {ratio:.1}x {}", rival.subject);
            }
            text.push('\n');
        }
    }
}

fn line(
    report: &SpeedReport,
    row: &Measurement,
    case_width: usize,
    subject_width: usize,
) -> String {
    let or_blank = |text: Option<String>| text.unwrap_or_default();
    let ns = row.pairs.map(|pairs| row.ms_best * 1e6 / pairs as f64);
    format!(
        "  {:<case_width$}{:<subject_width$}{:>11.3}{:>11.3}{:>11}{:>10}{:>7}{:>9}{:>9}  {}",
        row.case,
        row.subject,
        row.ms_best,
        row.ms_p50,
        or_blank(row.ms_p99.map(|ms| format!("{ms:.3}"))),
        or_blank(ns.map(|ns| format!("{ns:.3}"))),
        or_blank(row.bytes_per_feature.map(|bytes| format!("{bytes:.0}"))),
        or_blank(report.ratio(row).map(|ratio| format!("{ratio:.2}x"))),
        or_blank(row.recall.map(|recall| format!("{:.1} %", 100.0 * recall))),
        row.note
    )
}

/// Columns that the longest text of a section needs, with the space after it.
fn width_of(
    report: &SpeedReport,
    section: &str,
    head: &str,
    text: impl Fn(&Measurement) -> &str,
) -> usize {
    let rows = report
        .measurements
        .iter()
        .filter(|row| row.section == section);
    let longest = rows.map(|row| text(row).chars().count()).max();
    longest.unwrap_or(0).max(head.len()) + 2
}

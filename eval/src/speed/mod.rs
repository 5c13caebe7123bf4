//! How fast is each part, next to what would be used instead, in one run on one machine?
//!
//! One table of [`Measurement`]s: exact and approximate search against other matchers on the same
//! descriptors, extraction against OpenCV on the same grey bytes, and the whole answer for growing
//! maps. Times are those of one thread. Ratios are `reference / subject` within one case, so above
//! 1 is faster than the reference; they hold for this machine and this run. They compare the
//! fastest repetition of each, because that is what other programs on the machine disturb least.
//!
//! Temporal models are compared with the papers' sums written plainly, in processor time of one
//! thread; grids with dense arrays.
//!
//! A section is a module that returns rows; [`run`] puts them one after the other.
//!
//! Whoever claims to be exact has its answer compared with ours before it is timed; where two
//! answers differ the command fails. Approximate rivals show the share of queries whose nearest
//! they found.
//!
//! Not for: times on another machine, or of images that this one cannot decode fast; decoding is
//! not part of extraction here.

mod end_to_end;
mod extraction;
mod grid;
mod measurement;
mod opening;
mod plot;
mod record;
mod rivals;
mod search;
mod table;
mod targets;
#[path = "../../../crates/fremen/benches/temporal/mod.rs"]
mod temporal;
mod workload;

use std::path::Path;

use anyhow::{Context, Result};

use crate::provenance::{commit, machine};
use crate::results::write_atomically;

pub use measurement::{Measurement, SpeedOptions, SpeedReport, Target, read};
pub use rivals::Python;
pub use workload::Workload;

/// Measures what the options name, prints nothing, writes the files.
pub fn run(options: &SpeedOptions) -> Result<SpeedReport> {
    let mut report = SpeedReport {
        schema_version: 1,
        commit: commit(),
        machine: machine(),
        host: record::host(),
        command: options.command.clone(),
        material: "made up: visits at random times, states at random".into(),
        missing: Vec::new(),
        measurements: Vec::new(),
        targets: Vec::new(),
    };
    eprintln!("learning and querying temporal models");
    report.measurements.extend(temporal_models()?);
    eprintln!("observing and predicting grids");
    report.measurements.extend(grid::measure()?);
    report
        .missing
        .push("OctoMap's insert rate: not timed by this program".into());
    if !options.only_temporal {
        of_images(options, &mut report)?;
    }
    report.targets = targets::judge(&report);
    let json = serde_json::to_vec_pretty(&report)?;
    let write = |folder: &Path, page: &str, text: &str| -> Result<()> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
        write_atomically(&folder.join("speed.json"), &json)?;
        write_atomically(&folder.join(page), text.as_bytes())?;
        write_atomically(&folder.join("growth.svg"), plot::growth(&report).as_bytes())?;
        Ok(())
    };
    write(&options.out, "speed.txt", &table::render(&report))?;
    if let Some(folder) = &options.record {
        write(folder, "speed.md", &record::markdown(&report))?;
    }
    Ok(report)
}

/// Extraction, search and whole answers.
fn of_images(options: &SpeedOptions, report: &mut SpeedReport) -> Result<()> {
    let workload = Workload::new(options.data.as_deref())?;
    report.material = workload.describe();
    let python = options.python.as_deref().map(Python::new).transpose()?;
    if python.is_none() {
        report.missing.push(
            "OpenCV's extraction and FAISS: no Python with both; `make speed` installs one".into(),
        );
    }
    let rows = extraction::measure(&workload, python.as_ref())?;
    report.measurements.extend(rows);
    if let Some(extractor) = &options.extractor {
        let extractor = extractor.build_with(&options.models)?;
        let rows = extraction::measure_other(&workload, &*extractor)?;
        report.measurements.extend(rows);
    }
    for &num_rows in &options.rows {
        eprintln!("searching {num_rows} rows");
        search::measure(&workload, num_rows, options, python.as_ref(), report)?;
    }
    for &num_nodes in &options.nodes {
        eprintln!("localising in {num_nodes} places");
        let rows = end_to_end::measure(&workload, num_nodes)?;
        report.measurements.extend(rows);
    }
    Ok(())
}

/// Learning and prediction against their plain duplicates.
fn temporal_models() -> Result<Vec<Measurement>> {
    const SECTION: &str = "Temporal models, one thread";
    let comparisons = temporal::temporal(&temporal::Sizes::default())?;
    let rows = comparisons.iter().flat_map(|both| {
        let row = |subject, ms| Measurement::new(SECTION, &both.case, subject, ms);
        let agree = format!("{}; {} results agree", both.ours_note, both.num_checked);
        [
            row(both.twin, &both.twin_ms)
                .reference()
                .note(&both.twin_note),
            row("ours", &both.ours_ms).note(agree),
        ]
    });
    Ok(rows.collect())
}

/// The report as a table for a terminal.
pub fn render(report: &SpeedReport) -> String {
    table::render(report)
}

#[cfg(test)]
mod tests {
    use super::measurement::time;
    use super::*;

    fn report() -> SpeedReport {
        SpeedReport {
            schema_version: 1,
            commit: "abc".into(),
            machine: "a machine".into(),
            host: vec!["caches: many".into()],
            command: "chronotope-eval speed".into(),
            material: "made up".into(),
            missing: vec!["nothing".into()],
            measurements: vec![
                Measurement::new("search", "500 x 400", "scalar", &[4.0, 2.0, 3.0])
                    .pairs(200_000)
                    .reference(),
                Measurement::new("search", "500 x 400", "avx2", &[1.0]).recall(0.5),
                Measurement::new(end_to_end::SECTION, "10 places", "match", &[5.0]),
                Measurement::new(end_to_end::SECTION, "100 places", "match", &[50.0]),
            ],
            targets: Vec::new(),
        }
    }

    #[test]
    fn ratios_are_taken_within_a_case_and_files_read_back() {
        let report = report();
        assert_eq!(report.ratio(&report.measurements[1]), Some(2.0));
        assert_eq!(report.ratio(&report.measurements[2]), None);
        let text = render(&report);
        assert!(text.contains("2.00x") && text.contains("10.0"), "{text}");
        assert!(!text.contains("How we compare"), "{text}");
        let svg = plot::growth(&report);
        assert!(svg.contains("<svg") && svg.contains("100"), "{svg}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("speed.json");
        std::fs::write(&path, serde_json::to_vec(&report).unwrap()).unwrap();
        assert_eq!(read(&path).unwrap(), report);
        let page = record::markdown(&report);
        assert!(
            page.contains("caches: many") && page.contains(&text),
            "{page}"
        );
    }

    #[test]
    fn the_comparison_takes_the_fastest_kernel_and_approximate_searches_that_find_enough() {
        let row =
            |subject: &str, ms: f64| Measurement::new(search::SECTION, "500 x 9", subject, &[ms]);
        let mut report = report();
        report.measurements = vec![
            row("scalar", 8.0),
            row("scalar: popcounts alone", 6.0),
            row("OpenCV BFMatcher", 16.0).reference(),
            row("ours, IVF 4, 1 probes", 0.5).recall(0.9),
            row("ours, IVF 4, 2 probes", 1.0).recall(0.99),
            row("FAISS IVF 4, nprobe 2", 3.0).recall(0.992),
        ];
        let text = render(&report);
        assert!(
            text.contains("scalar, 2.0x OpenCV BFMatcher, 75 % of its popcount limit"),
            "{text}"
        );
        assert!(
            text.contains("ours, IVF 4, 2 probes, 3.0x FAISS IVF 4, nprobe 2\n"),
            "{text}"
        );
    }

    #[test]
    fn timing_calls_at_least_as_often_as_wanted() {
        let mut calls = 0;
        let ms = time(3, || calls += 1);
        assert!(ms.len() >= 3 && calls == ms.len() + 1);
    }
}

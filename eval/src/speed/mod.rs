//! How fast is each part, next to what would be used instead, in one run on one machine?
//!
//! One table of [`Measurement`]s: exact and approximate search against other matchers on the same
//! descriptors, extraction against OpenCV on the same grey bytes, and the whole answer for growing maps.
//! Times are those of one thread. Ratios are `reference / subject` within one case, so above 1 is faster
//! than the reference; they hold for this machine and this run. They compare the fastest repetition of
//! each, because that is what other programs on the machine disturb least.
//!
//! Temporal models are compared with the papers' sums written plainly, in processor time of one thread.
//!
//! A section is a module that returns rows; [`run`] puts them one after the other.
//!
//! Whoever claims to be exact has its answer compared with ours before it is timed; where two answers
//! differ the command fails. Approximate rivals show the share of queries whose nearest they found.
//!
//! Not for: times on another machine, or of images that this one cannot decode fast; decoding is not
//! part of extraction here.

mod end_to_end;
mod extraction;
mod material;
mod opening;
mod plot;
mod record;
mod rivals;
mod search;
mod table;
mod targets;
#[path = "../../../benches/temporal/mod.rs"]
mod temporal;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use crate::judge::statistics::quantile;
use crate::provenance::{commit, machine};
use crate::results::write_atomically;

pub use material::Material;
pub use rivals::Python;
pub use targets::Target;

/// What is measured and where results go.
#[derive(Clone, Debug)]
pub struct SpeedOptions {
    /// A folder of images or a manifest; the rendered street where there is none.
    pub data: Option<PathBuf>,
    /// Sizes of the maps that are localised in, places.
    pub nodes: Vec<usize>,
    /// Sizes of the sets that are searched, rows.
    pub rows: Vec<usize>,
    /// The largest set that `hnsw_rs` builds its graph of; building takes minutes per 100,000 rows.
    pub max_hnsw_rows: usize,
    /// A Python with OpenCV and FAISS, as `scripts/speed.sh` makes one.
    pub python: Option<PathBuf>,
    /// Nothing but temporal models, which takes a minute.
    pub only_temporal: bool,
    /// Where `speed.json`, `speed.txt` and `growth.svg` are written.
    pub out: PathBuf,
    /// Where the run is kept with the sources: `speed.json`, `speed.md` and `growth.svg`.
    pub record: Option<PathBuf>,
    /// The command as typed.
    pub command: String,
}

/// One thing that was timed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// The part of the table.
    pub section: String,
    /// What was to be done.
    pub case: String,
    /// Who did it.
    pub subject: String,
    /// The fastest repetition, ms; over several inputs the mean of the fastest of each.
    pub ms_best: f64,
    /// Median duration, ms.
    pub ms_p50: f64,
    /// The 99th percentile, ms, where there were enough repetitions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms_p99: Option<f64>,
    /// Descriptor comparisons that an exact search makes for the case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pairs: Option<u64>,
    /// Whether the other ratios of its case are taken against this one.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_reference: bool,
    /// Bytes a feature of what the row is about, for memory and files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes_per_feature: Option<f64>,
    /// Share of queries whose nearest was found, for approximate searches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recall: Option<f64>,
    /// Anything else, for people.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}

impl Measurement {
    fn new(section: &str, case: &str, subject: impl Into<String>, ms: &[f64]) -> Self {
        Self {
            section: section.to_owned(),
            case: case.to_owned(),
            subject: subject.into(),
            ms_best: ms.iter().copied().fold(f64::INFINITY, f64::min),
            ms_p50: quantile(ms, 0.5).unwrap_or(f64::NAN),
            ms_p99: (ms.len() >= 50).then(|| quantile(ms, 0.99)).flatten(),
            pairs: None,
            bytes_per_feature: None,
            is_reference: false,
            recall: None,
            note: String::new(),
        }
    }

    fn pairs(mut self, pairs: usize) -> Self {
        self.pairs = Some(pairs as u64);
        self
    }

    fn bytes_per_feature(mut self, bytes: f64) -> Self {
        self.bytes_per_feature = Some(bytes);
        self
    }

    /// Of several inputs: the mean of the fastest repetition of each.
    fn best(mut self, ms: f64) -> Self {
        self.ms_best = ms;
        self
    }

    fn reference(mut self) -> Self {
        self.is_reference = true;
        self
    }

    fn recall(mut self, recall: f64) -> Self {
        self.recall = Some(recall);
        self
    }

    fn note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }
}

/// Everything that one run measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedReport {
    /// 1.
    pub schema_version: u32,
    /// Revision of the sources.
    pub commit: String,
    /// Processor, kernel, threads.
    pub machine: String,
    /// System, caches, memory and load, where the system tells.
    #[serde(default)]
    pub host: Vec<String>,
    /// The command as typed.
    pub command: String,
    /// Where the descriptors come from.
    pub material: String,
    /// What could not be measured and why.
    pub missing: Vec<String>,
    /// The rows of the table, in order.
    pub measurements: Vec<Measurement>,
    /// What was promised, judged by them.
    #[serde(default)]
    pub targets: Vec<Target>,
}

impl SpeedReport {
    /// How many times faster `row` is than the reference of its case.
    pub fn ratio(&self, row: &Measurement) -> Option<f64> {
        self.measurements
            .iter()
            .find(|other| {
                other.is_reference && (&other.section, &other.case) == (&row.section, &row.case)
            })
            .map(|reference| reference.ms_best / row.ms_best)
    }
}

/// Measures what is asked for, prints nothing, writes the files.
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
    eprintln!("learning and asking temporal models");
    report.measurements.extend(temporal_models()?);
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
    let material = Material::new(options.data.as_deref())?;
    report.material = material.describe();
    let python = options.python.as_deref().map(Python::new).transpose()?;
    if python.is_none() {
        report.missing.push(
            "OpenCV's extraction and FAISS: no Python with both; `make speed` installs one".into(),
        );
    }
    let rows = extraction::measure(&material, python.as_ref())?;
    report.measurements.extend(rows);
    for &num_rows in &options.rows {
        eprintln!("searching {num_rows} rows");
        search::measure(&material, num_rows, options, python.as_ref(), report)?;
    }
    for &num_nodes in &options.nodes {
        eprintln!("localising in {num_nodes} places");
        let rows = end_to_end::measure(&material, num_nodes)?;
        report.measurements.extend(rows);
    }
    Ok(())
}

/// Learning and prediction against their plain twins.
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

/// Reads a report again.
pub fn read(path: &Path) -> Result<SpeedReport> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&bytes).with_context(|| format!("{} is no speed report", path.display()))
}

/// Milliseconds of at least `min_times` calls, and of more until half a second is over.
fn time(min_times: usize, mut call: impl FnMut()) -> Vec<f64> {
    const ENOUGH_MS: f64 = 500.0;
    const MAX_TIMES: usize = 200;
    call();
    let mut ms = Vec::new();
    let start = Instant::now();
    while ms.len() < min_times
        || (ms.len() < MAX_TIMES && start.elapsed().as_secs_f64() * 1e3 < ENOUGH_MS)
    {
        let start = Instant::now();
        call();
        ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    ms
}

#[cfg(test)]
mod tests {
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
    fn timing_calls_at_least_as_often_as_asked() {
        let mut calls = 0;
        let ms = time(3, || calls += 1);
        assert!(ms.len() >= 3 && calls == ms.len() + 1);
    }
}

//! What is measured, what was, and what was promised of it?

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use chronotope::feature::{ExtractorConfig, Models};
use serde::{Deserialize, Serialize};

use crate::judge::statistics::quantile;

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
    /// Another extractor that is timed as well.
    pub extractor: Option<ExtractorConfig>,
    /// Where its network is, if it has one.
    pub models: Models,
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
    pub(super) fn new(section: &str, case: &str, subject: impl Into<String>, ms: &[f64]) -> Self {
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

    pub(super) fn pairs(mut self, pairs: usize) -> Self {
        self.pairs = Some(pairs as u64);
        self
    }

    pub(super) fn bytes_per_feature(mut self, bytes: f64) -> Self {
        self.bytes_per_feature = Some(bytes);
        self
    }

    /// Of several inputs: the mean of the fastest repetition of each.
    pub(super) fn best(mut self, ms: f64) -> Self {
        self.ms_best = ms;
        self
    }

    pub(super) fn reference(mut self) -> Self {
        self.is_reference = true;
        self
    }

    pub(super) fn recall(mut self, recall: f64) -> Self {
        self.recall = Some(recall);
        self
    }

    pub(super) fn note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }
}

/// Everything that one run measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedReport {
    /// The version of the file format, 1.
    pub schema_version: u32,
    /// Revision of the sources.
    pub commit: String,
    /// Processor, kernel, threads.
    pub machine: String,
    /// System, caches, memory and load, where the system reports it.
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

/// Reads a report again.
pub fn read(path: &Path) -> Result<SpeedReport> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&bytes).with_context(|| format!("{} is no speed report", path.display()))
}

/// Milliseconds of at least `min_times` calls, and of more until half a second is over.
pub(super) fn time(min_times: usize, mut call: impl FnMut()) -> Vec<f64> {
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

/// One number that was promised, and what became of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// What it is about.
    pub name: String,
    /// What was promised: at least this for ratios, at most this for all else.
    pub wanted: f64,
    /// What was measured; `None` where the run has not got its rows.
    pub found: Option<f64>,
    /// Whether more is better.
    pub at_least: bool,
}

impl Target {
    pub(super) fn at_least(name: impl Into<String>, wanted: f64, found: Option<f64>) -> Self {
        Self {
            name: name.into(),
            wanted,
            found,
            at_least: true,
        }
    }

    pub(super) fn at_most(name: impl Into<String>, wanted: f64, found: Option<f64>) -> Self {
        Self {
            at_least: false,
            ..Self::at_least(name, wanted, found)
        }
    }

    /// Whether it was met; `None` where it was not measured.
    pub fn is_met(&self) -> Option<bool> {
        self.found.map(|found| {
            if self.at_least {
                found >= self.wanted
            } else {
                found <= self.wanted
            }
        })
    }

    /// `>= 20` or `<= 1.1`.
    pub(super) fn wanted_text(&self) -> String {
        let sign = if self.at_least { ">=" } else { "<=" };
        format!("{sign} {}", self.wanted)
    }

    /// What was found, with three figures or more.
    pub(super) fn found_text(&self) -> String {
        match self.found {
            None => "-".into(),
            Some(value) if value < 10.0 => format!("{value:.2}"),
            Some(value) => format!("{value:.1}"),
        }
    }

    /// Whether it was met, in a word.
    pub(super) fn verdict(&self) -> &'static str {
        match self.is_met() {
            Some(true) => "met",
            Some(false) => "missed",
            None => "not measured",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_verdicts_are_written_as_people_read_them() {
        let target = |found, at_least| Target {
            name: "x".into(),
            wanted: 1.1,
            found,
            at_least,
        };
        assert_eq!(target(None, true).wanted_text(), ">= 1.1");
        assert_eq!(target(Some(21.44), true).found_text(), "21.4");
        assert_eq!(target(Some(1.014), false).found_text(), "1.01");
        assert_eq!(target(Some(1.2), true).verdict(), "met");
        assert_eq!(target(Some(1.2), false).verdict(), "missed");
        assert_eq!(target(None, false).verdict(), "not measured");
    }
}

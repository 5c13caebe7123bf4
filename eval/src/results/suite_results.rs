//! What does one run of one suite hold?

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::answer::Query;
use super::judgement::Judgement;
use super::key::{RowKey, Variant};
use super::rows::{LeakCheck, Reobservation, Row, StageLatency, VisibilityError};
use super::tolerance::Tolerance;

/// The n that is shown in detail where a run has it.
const DETAIL_N: u32 = 50;

/// The schema version that this crate writes and reads.
pub const SCHEMA_VERSION: u32 = 1;

/// One run of one suite: the content of `SUITE.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SuiteResults {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Name of the suite.
    pub suite: String,
    /// Name of the dataset.
    pub dataset: String,
    /// Digest of the dataset, as the suite's runner defines it.
    pub dataset_sha256: String,
    /// Revision of the source that produced this.
    pub commit: String,
    /// Processor, its instruction sets, threads used.
    pub machine: String,
    /// The one line that produces this file again.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub command: String,
    /// Whether the dataset's times are a clock, in words.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub clock: String,
    /// What was learnt and what was queried, in words.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub split: String,
    /// How far an answer may be off and still be right "within".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<Tolerance>,
    /// The n that is shown first, where that is fixed beforehand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shown_n: Option<u32>,
    /// Places in the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub num_places: Option<u32>,
    /// Images learnt from (the mean over folds, where there are several).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub num_learnt_images: Option<u32>,
    /// Images that could not be used, and are in no number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub num_broken_images: Option<u32>,
    /// How queries were kept apart from what was learnt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leak_check: Option<LeakCheck>,
    /// Anything else the reader must know.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Re-observation per variant.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reobservation: Vec<Reobservation>,
    /// How far models of visibility are from the truth, where that is known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub visibility_errors: Vec<VisibilityError>,
    /// Latency by stage.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub latency: Vec<StageLatency>,
    /// How good posteriors and decisions are, for the rows that have a posterior.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub judgement: Vec<Judgement>,
    /// One per preset, method, model, score, order and n; over the queries that have a true place.
    pub rows: Vec<Row>,
    /// One per image.
    pub queries: Vec<Query>,
}

impl SuiteResults {
    /// A run without rows and queries yet.
    pub fn new(suite: impl Into<String>, dataset: impl Into<String>) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            suite: suite.into(),
            dataset: dataset.into(),
            dataset_sha256: String::new(),
            commit: String::new(),
            machine: String::new(),
            command: String::new(),
            clock: String::new(),
            split: String::new(),
            tolerance: None,
            shown_n: None,
            num_places: None,
            num_learnt_images: None,
            num_broken_images: None,
            leak_check: None,
            notes: Vec::new(),
            reobservation: Vec::new(),
            visibility_errors: Vec::new(),
            latency: Vec::new(),
            judgement: Vec::new(),
            rows: Vec::new(),
            queries: Vec::new(),
        }
    }

    /// The row with this key.
    pub fn row(&self, key: &RowKey) -> Option<&Row> {
        self.rows
            .iter()
            .find(|row| row.n == key.n && row.variant == key.variant)
    }

    /// All variants, in the order of their first rows.
    pub fn variants(&self) -> Vec<Variant> {
        let mut known = BTreeSet::new();
        self.rows
            .iter()
            .map(|row| row.variant.clone())
            .filter(|variant| known.insert(variant.clone()))
            .collect()
    }

    /// All n, ascending.
    pub fn all_n(&self) -> Vec<u32> {
        let all: BTreeSet<u32> = self.rows.iter().map(|row| row.n).collect();
        all.into_iter().collect()
    }

    /// The variant that the shipped default configuration gives.
    pub fn default_variant(&self) -> Option<Variant> {
        self.rows
            .iter()
            .find(|row| row.is_default)
            .map(|row| row.variant.clone())
    }

    /// The n to show in detail: 50 where the run has it, else the middle one; `None` without rows.
    pub fn detail_n(&self) -> Option<u32> {
        let all = self.all_n();
        all.contains(&DETAIL_N)
            .then_some(DETAIL_N)
            .or_else(|| all.get(all.len() / 2).copied())
    }

    /// Variants by preset and score, each in the order of the first row.
    pub fn grouped(&self) -> Vec<(String, String, Vec<Variant>)> {
        let mut groups: Vec<(String, String, Vec<Variant>)> = Vec::new();
        for variant in self.variants() {
            let same = groups
                .iter_mut()
                .find(|(preset, score, _)| *preset == variant.preset && *score == variant.score);
            match same {
                Some((_, _, variants)) => variants.push(variant),
                None => groups.push((variant.preset.clone(), variant.score.clone(), vec![variant])),
            }
        }
        groups
    }
}

//! What numbers does a run give for each row, variant and stage?

use serde::{Deserialize, Serialize};

use super::key::{RowKey, Variant};

/// The numbers of one row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Whether the shipped default configuration gives this row.
    pub is_default: bool,
    /// All names but n.
    #[serde(flatten)]
    pub variant: Variant,
    /// Features per node (per experience for the experience methods).
    pub n: u32,
    /// Number of queries that have a true place.
    pub queries: u32,
    /// Forced first choices that were right, ties split.
    pub correct: f64,
    /// Forced first choices that were wrong, ties split; `queries - correct`.
    pub wrong: f64,
    /// Queries that the row's decision rule called unknown or ambiguous; 0 for rows without a rule.
    pub unknown: u32,
    /// Queries in which several places shared the first rank.
    pub tied: u32,
    /// Lower end of the 95 % interval of the share of wrong answers, %.
    pub ci_low: f64,
    /// Upper end, %.
    pub ci_high: f64,
    /// Share of the selected features that were seen again in the image of the true place, %.
    pub reobserved: Option<f64>,
    /// Descriptor comparisons per query, mean.
    pub pairs_compared: f64,
    /// Time to locate one image (features given), median, ms.
    pub ms_p50: f64,
    /// The same, 99th percentile, ms.
    pub ms_p99: f64,
    /// What the row is worth within the run's tolerance, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within: Option<Within>,
}

/// What a row is worth where an answer may be off by the run's [`Tolerance`](super::Tolerance).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Within {
    /// Forced first choices within the tolerance, in queries, ties split.
    pub correct: f64,
    /// Lower end of the 95 % interval of their share, %.
    pub ci_low: f64,
    /// Upper end, %.
    pub ci_high: f64,
    /// Queries that the row's decision located; all that were answered for rows without a rule.
    pub located: u32,
    /// Of these, at any other than the true place.
    pub located_wrong_exact: u32,
    /// Of these, beyond the tolerance.
    pub located_wrong: u32,
}

impl Row {
    /// The key under which this row's answers are stored.
    pub fn key(&self) -> RowKey {
        self.variant.at(self.n)
    }

    /// Wrong answers in per cent; 0 without queries.
    pub fn wrong_percent(&self) -> f64 {
        if self.queries == 0 {
            0.0
        } else {
            100.0 * self.wrong / f64::from(self.queries)
        }
    }

    /// Answers within the run's tolerance in per cent, where it has one.
    pub fn within_percent(&self) -> Option<f64> {
        let within = self.within?;
        Some(100.0 * within.correct / f64::from(self.queries.max(1)))
    }
}

/// How queries were kept apart from what was learnt.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LeakCheck {
    /// Images whose decoded pixels were digested.
    pub num_checked: u32,
    /// Images that were taken off the training side because a query has the same pixels.
    pub num_removed: u32,
    /// In words, for the reader of a report.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}

/// Share of a variant's most probable features that the image of the true place shows again
/// (T-RO, Table I).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reobservation {
    /// Its names; the score is empty, because all scores share the features.
    #[serde(flatten)]
    pub variant: Variant,
    /// How many features of a place were selected.
    pub top: u32,
    /// Seen again, %, mean over queries.
    pub percent: f64,
    /// Lower end of the 95 % interval, %.
    pub ci_low: f64,
    /// Upper end, %.
    pub ci_high: f64,
}

/// Time that one stage of localisation takes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageLatency {
    /// Whose stage: a row's key, or words such as `all methods`.
    pub of: String,
    /// `decode`, `extract`, `predict`, `match`, `verify`, `score`, `decide`, ...
    pub stage: String,
    /// Median, ms.
    pub ms_p50: f64,
    /// 99th percentile, ms.
    pub ms_p99: f64,
}

/// How far one model's p(t) is from the truth, on average.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VisibilityError {
    /// Name of the model.
    pub model: String,
    /// Whether the shipped default configuration uses it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_default: bool,
    /// Mean of |p - truth|.
    pub mean: f64,
    /// Lower end of its 95 % interval.
    pub ci_low: f64,
    /// Upper end of its 95 % interval.
    pub ci_high: f64,
}

//! What does `SUITE.json` of a suite of series hold?

use serde::Serialize;

use super::models::LITERAL;
use super::sampling::Sampling;
use super::spectrum::Spectrum;
use crate::judge::statistics::Estimate;
use crate::results::RowOrder;

/// The version of the file.
pub(super) const SCHEMA_VERSION: u32 = 1;

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// The measured value.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl From<Estimate> for Measured {
    fn from(estimate: Estimate) -> Self {
        Self {
            value: estimate.mean,
            low: estimate.interval.low,
            high: estimate.interval.high,
        }
    }
}

/// One model, at one order, learnt from one sampling of all series of the suite.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The model that the documentation recommends.
    pub is_default: bool,
    /// What it was learnt from.
    pub sampling: Sampling,
    /// Its name.
    pub model: String,
    /// How many rhythms it has, or that it chooses.
    pub order: RowOrder,
    /// Samples learnt, mean over draws.
    pub num_learnt: f64,
    /// Share of wrong states at p >= 1/2 among the samples it was learnt from.
    pub estimation_error: f64,
    /// The same among the unseen ones.
    pub state_error: Measured,
    /// Mean squared difference of p and state.
    pub brier: Measured,
    /// Mean of -ln of the probability given to what came.
    pub log_loss: Measured,
    /// Brier score minus that of the mean, block by block: negative is better.
    pub brier_against_mean: Measured,
    /// State error of each unseen part.
    pub parts: Vec<(String, f64)>,
}

impl Row {
    /// Worse than the mean beyond the interval.
    pub fn is_worse_than_mean(&self) -> bool {
        self.brier_against_mean.low > 0.0
    }
}

/// One series over time, for the report.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// Which series, learnt from what.
    pub title: String,
    /// Stretches of time, in seconds, in which the state was 1.
    pub is_one: Vec<(f64, f64)>,
    /// Times in seconds.
    pub times_s: Vec<f64>,
    /// Names of models with p at these times.
    pub curves: Vec<(String, Vec<f64>)>,
}

/// The file `SUITE.json` of a series' suite, and what its report draws.
#[derive(Clone, Debug, Serialize)]
pub struct SeriesResults {
    /// The version of the file format, 1.
    pub schema_version: u32,
    /// The suite's name.
    pub suite: String,
    /// The question of the suite.
    pub title: String,
    /// Of all files.
    pub dataset_sha256: String,
    /// The revision that was measured.
    pub commit: String,
    /// What it ran on.
    pub machine: String,
    /// The line that produces the file again.
    pub command: String,
    /// What was learnt and what was queried, in words.
    pub split: String,
    /// What the intervals resample.
    pub blocks: String,
    /// The share of samples that thinning keeps.
    pub share: f64,
    /// Anything else that the reader should know.
    pub notes: Vec<String>,
    /// How many series.
    pub num_series: usize,
    /// Number of unseen samples that are queried.
    #[serde(rename = "num_asked")]
    pub num_queried: usize,
    /// Every sampling, model and order.
    pub rows: Vec<Row>,
    /// p(t) over the data.
    #[serde(skip)]
    pub drawings: Vec<Drawing>,
    /// What was learnt, as a spectrum over that of its sampling.
    #[serde(skip)]
    pub spectra: Vec<Spectrum>,
}

impl SeriesResults {
    /// The row of a sampling, model and order.
    pub fn row(&self, sampling: Sampling, model: &str, order: RowOrder) -> Option<&Row> {
        let mut rows = self.rows.iter();
        rows.find(|row| row.sampling == sampling && row.model == model && row.order == order)
    }

    /// The recommended model.
    pub fn default_row(&self, sampling: Sampling) -> Option<&Row> {
        let mut rows = self.rows.iter();
        rows.find(|row| row.sampling == sampling && row.is_default)
    }

    /// FreMEn as the papers print it, its order chosen on held-out samples as they do; of the two
    /// papers the one that comes out better.
    pub fn literal(&self, sampling: Sampling) -> Option<&Row> {
        let rows = (LITERAL.iter()).filter_map(|model| self.row(sampling, model, RowOrder::Auto));
        rows.min_by(|a, b| a.brier.value.total_cmp(&b.brier.value))
    }
}

/// Tables show the orders of the papers' tables; the file and the plots all.
pub(crate) fn is_in_table(row: &Row) -> bool {
    matches!(row.order, RowOrder::Auto | RowOrder::Fixed(0..=3 | 5))
}

/// What was measured on what, and how to measure it again.
pub(crate) fn facts(results: &SeriesResults) -> Vec<(&'static str, String)> {
    let mut facts = vec![
        ("Split", results.split.clone()),
        (
            "Size",
            format!(
                "{} series, {} unseen samples; thinned to {} %",
                results.num_series,
                results.num_queried,
                100.0 * results.share
            ),
        ),
        ("Intervals", format!("bootstrap over {}", results.blocks)),
        ("Digest", results.dataset_sha256.clone()),
        ("Commit", results.commit.clone()),
        ("Machine", results.machine.clone()),
        ("Command", results.command.clone()),
    ];
    facts.extend(results.notes.iter().map(|note| ("Note", note.clone())));
    facts
}

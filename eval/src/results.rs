//! What does `SUITE.json` hold, and how is it written and read?
//!
//! One file holds one run of one suite: a header that says what was measured and how to measure it
//! again, one [`Row`] per combination of preset, method, model, score, order and n, and one
//! [`Query`] per image with the [`Answer`] of every row, so that two runs can be compared query by
//! query. All rates are percentages; `wrong` and `correct` are numbers of queries in which a tie
//! for the first rank is split (k tied places, the true one among them: 1/k correct).
//!
//! Invariants, checked when writing and reading ([`SuiteResults::validate`]): the schema version is
//! known; keys of rows and ids of queries are unique; every number is finite; `correct + wrong =
//! queries`; where a row's answers are stored, their count, `wrong` and `tied` agree with the row.
//!
//! The same results give the same bytes: fields keep their order, answers are sorted by key. Unknown
//! fields are ignored when reading, so that a later version may add some.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use chronotope::{Error, ErrorKind, Result};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::judgement::Judgement;

/// The schema version that this crate writes and reads.
pub const SCHEMA_VERSION: u32 = 1;

/// How many periodic components a model may use: a number, or chosen by held-out visits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Order {
    /// Exactly this many; 0 is the mean alone. In JSON a number.
    Fixed(u32),
    /// Chosen by the model itself. In JSON `"auto"`.
    Auto,
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(order) => f.pad(&order.to_string()),
            Self::Auto => f.pad("auto"),
        }
    }
}

impl FromStr for Order {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        text.parse().map(Self::Fixed).map_err(|_| {
            Error::new(
                ErrorKind::Format,
                format!("`{text}` is no order: a number or `auto`"),
            )
        })
    }
}

impl Serialize for Order {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Fixed(order) => serializer.serialize_u32(*order),
            Self::Auto => serializer.serialize_str("auto"),
        }
    }
}

impl<'de> Deserialize<'de> for Order {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "an order is a number or \"auto\"")]
        enum Raw {
            Number(u32),
            Word(String),
        }
        match Raw::deserialize(deserializer)? {
            Raw::Number(order) => Ok(Self::Fixed(order)),
            Raw::Word(word) => word.parse().map_err(serde::de::Error::custom),
        }
    }
}

/// Everything that names a row except n: one line of a plot.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Variant {
    /// Configuration, `lttl` or `default`.
    pub preset: String,
    /// `static`, `fremen`, `experience`, `experience-all`, `freex` or `fused`.
    pub method: String,
    /// Visibility model.
    pub model: String,
    /// `count`, `inliers` or `likelihood`.
    pub score: String,
    /// Components of the model.
    pub order: Order,
}

impl Variant {
    /// The row of this variant at `n` features per node.
    pub fn at(&self, n: u32) -> RowKey {
        RowKey {
            variant: self.clone(),
            n,
        }
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            preset,
            method,
            model,
            score,
            order,
        } = self;
        f.pad(&format!("{preset}/{method}/{model}/{score}/{order}"))
    }
}

/// Names a row, and the answers that it sums up: `preset/method/model/score/order/n`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RowKey {
    /// All but n.
    pub variant: Variant,
    /// Features per node (per experience for the experience methods).
    pub n: u32,
}

impl fmt::Display for RowKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format!("{}/{}", self.variant, self.n))
    }
}

impl FromStr for RowKey {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::new(
                ErrorKind::Format,
                format!("`{text}` is no key `preset/method/model/score/order/n`"),
            )
        };
        let parts: Vec<&str> = text.split('/').collect();
        let &[preset, method, model, score, order, n] = parts.as_slice() else {
            return Err(wrong());
        };
        if [preset, method, model, score].contains(&"") {
            return Err(wrong());
        }
        Ok(Self {
            variant: Variant {
                preset: preset.to_owned(),
                method: method.to_owned(),
                model: model.to_owned(),
                score: score.to_owned(),
                order: order.parse().map_err(|_| wrong())?,
            },
            n: n.parse().map_err(|_| wrong())?,
        })
    }
}

/// What a decision rule said about one image.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decision {
    /// Located at the place with this key. In JSON `{"at": "place"}`.
    At(String),
    /// One of several places of the map. In JSON `"ambiguous"`.
    Ambiguous,
    /// No place of the map, or nothing to decide by. In JSON `"unknown"`.
    Unknown,
}

/// The answer of one row to one query.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The forced first choice; none where no place scored at all.
    pub first: Option<String>,
    /// What the row's decision rule said; rows without one say `At(first)`.
    pub decision: Decision,
    /// Probability of the most probable places; empty where the score is no probability.
    /// The hypothesis "elsewhere" has the key [`ELSEWHERE`].
    #[serde(default)]
    pub posterior: BTreeMap<String, f64>,
    /// All places that share the first rank, `first` among them; empty without a tie.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ties: Vec<String>,
}

/// Key of the hypothesis "at no place of the map" in [`Answer::posterior`].
pub const ELSEWHERE: &str = "(elsewhere)";

impl Answer {
    /// How wrong the forced first choice is, 0 to 1, with a tie split.
    ///
    /// `truth` is `None` for an image of a place that the map lacks: every forced choice is wrong.
    pub fn wrong(&self, truth: Option<&str>) -> f64 {
        let Some(truth) = truth else { return 1.0 };
        if self.ties.is_empty() {
            return f64::from(self.first.as_deref() != Some(truth));
        }
        if self.ties.iter().any(|place| place == truth) {
            1.0 - 1.0 / self.ties.len() as f64
        } else {
            1.0
        }
    }

    /// Whether several places share the first rank.
    pub fn is_tied(&self) -> bool {
        self.ties.len() > 1
    }
}

/// One image that was to be located.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Query {
    /// Unique within the suite and the same in every run; usually the image's path in the dataset.
    pub id: String,
    /// Key of the true place; none for an image of a place that the map lacks.
    pub truth: Option<String>,
    /// Queries of one group (a visit, an hour) are alike; where given, intervals resample groups.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// One answer per row, keyed by [`RowKey`].
    pub answers: BTreeMap<String, Answer>,
}

/// The numbers of one row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Whether the shipped default configuration gives this row.
    pub is_default: bool,
    /// Configuration.
    pub preset: String,
    /// Method.
    pub method: String,
    /// Visibility model.
    pub model: String,
    /// Score.
    pub score: String,
    /// Components of the model.
    pub order: Order,
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
}

impl Row {
    /// All names but n.
    pub fn variant(&self) -> Variant {
        Variant {
            preset: self.preset.clone(),
            method: self.method.clone(),
            model: self.model.clone(),
            score: self.score.clone(),
            order: self.order,
        }
    }

    /// Whether this is a row of `variant`.
    pub fn is_of(&self, variant: &Variant) -> bool {
        self.order == variant.order
            && self.method == variant.method
            && self.model == variant.model
            && self.score == variant.score
            && self.preset == variant.preset
    }

    /// The key under which this row's answers are stored.
    pub fn key(&self) -> RowKey {
        self.variant().at(self.n)
    }

    /// Wrong answers in per cent; 0 without queries.
    pub fn wrong_percent(&self) -> f64 {
        if self.queries == 0 {
            0.0
        } else {
            100.0 * self.wrong / f64::from(self.queries)
        }
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
    /// Configuration.
    pub preset: String,
    /// Method.
    pub method: String,
    /// Visibility model.
    pub model: String,
    /// Components of the model.
    pub order: Order,
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
    /// Its name.
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
    /// What was learnt and what was asked, in words.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub split: String,
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
            .find(|row| row.n == key.n && row.is_of(&key.variant))
    }

    /// All variants, in the order of their first rows.
    pub fn variants(&self) -> Vec<Variant> {
        let mut known = BTreeSet::new();
        self.rows
            .iter()
            .map(Row::variant)
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
            .map(Row::variant)
    }

    /// Checks the invariants that the module names.
    pub fn validate(&self) -> Result<()> {
        let fail = |place: String, message: String| {
            Err(Error::new(ErrorKind::Format, message).with_place(place))
        };
        if self.schema_version != SCHEMA_VERSION {
            return Err(unknown_version(self.schema_version));
        }
        let mut ids = BTreeSet::new();
        for query in &self.queries {
            let place = || format!("query `{}`", query.id);
            if !ids.insert(query.id.as_str()) {
                return fail(place(), "the id is there twice".into());
            }
            for (key, answer) in &query.answers {
                key.parse::<RowKey>()
                    .map_err(|error| error.with_place(place()))?;
                if let Some((name, p)) = answer
                    .posterior
                    .iter()
                    .find(|(_, p)| !(0.0..=1.0).contains(*p))
                {
                    let message = format!("`{key}`: {p} is no probability of `{name}`");
                    return fail(place(), message);
                }
                let tied_but_first = !answer.ties.is_empty()
                    && !answer
                        .ties
                        .iter()
                        .any(|tied| Some(tied) == answer.first.as_ref());
                if tied_but_first {
                    let message = format!("`{key}`: `first` is not among its `ties`");
                    return fail(place(), message);
                }
            }
        }
        if let Some(judgement) = self.judgement.iter().find(|it| !it.is_finite()) {
            let place = format!("judgement of `{}`", judgement.variant().at(judgement.n));
            return fail(place, "a number is not finite".into());
        }
        let mut keys = BTreeSet::new();
        for row in &self.rows {
            let key = row.key().to_string();
            let place = || format!("row `{key}`");
            if !keys.insert(key.clone()) {
                return fail(place(), "the row is there twice".into());
            }
            self.validate_row(row, &key)
                .or_else(|message| fail(place(), message))?;
        }
        Ok(())
    }

    fn validate_row(&self, row: &Row, key: &str) -> Result<(), String> {
        let numbers = [
            ("correct", row.correct),
            ("wrong", row.wrong),
            ("ci_low", row.ci_low),
            ("ci_high", row.ci_high),
            ("reobserved", row.reobserved.unwrap_or(0.0)),
            ("pairs_compared", row.pairs_compared),
            ("ms_p50", row.ms_p50),
            ("ms_p99", row.ms_p99),
        ];
        for (name, number) in numbers {
            if !(number.is_finite() && number >= 0.0) {
                return Err(format!("`{name}` is {number}"));
            }
        }
        let queries = f64::from(row.queries);
        if !close(row.correct + row.wrong, queries) {
            return Err(format!(
                "correct {} + wrong {} is not the number of queries, {queries}",
                row.correct, row.wrong
            ));
        }
        let (mut count, mut wrong, mut tied) = (0_u32, 0.0, 0_u32);
        for query in self.queries.iter().filter(|query| query.truth.is_some()) {
            if let Some(answer) = query.answers.get(key) {
                count += 1;
                wrong += answer.wrong(query.truth.as_deref());
                tied += u32::from(answer.is_tied());
            }
        }
        if count == 0 || (count == row.queries && tied == row.tied && close(wrong, row.wrong)) {
            Ok(())
        } else {
            Err(format!(
                "says {} wrong and {} tied of {}, but its answers give {wrong}, {tied} and {count}",
                row.wrong, row.tied, row.queries
            ))
        }
    }

    /// The bytes of `SUITE.json`: one row and one query per line.
    pub fn to_json(&self) -> Result<Vec<u8>> {
        self.validate()?;
        let mut bytes = Vec::new();
        let mut serializer =
            serde_json::Serializer::with_formatter(&mut bytes, LinePerEntry::default());
        self.serialize(&mut serializer)
            .map_err(|error| Error::new(ErrorKind::Format, error.to_string()))?;
        bytes.push(b'\n');
        Ok(bytes)
    }

    /// Reads the bytes of `SUITE.json`.
    pub fn from_json(bytes: &[u8]) -> Result<Self> {
        #[derive(Deserialize)]
        struct Version {
            schema_version: u32,
        }
        let as_error = |error: serde_json::Error| {
            Error::new(ErrorKind::Format, error.to_string())
                .with_help("expected a SUITE.json written by `chronotope-eval run`")
        };
        let version: Version = serde_json::from_slice(bytes).map_err(as_error)?;
        if version.schema_version != SCHEMA_VERSION {
            return Err(unknown_version(version.schema_version));
        }
        let results: Self = serde_json::from_slice(bytes).map_err(as_error)?;
        results.validate()?;
        Ok(results)
    }

    /// Writes `path` so that a reader finds the old file or the new one, never a part.
    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes = self.to_json().map_err(|error| error.with_path(path))?;
        write_atomically(path, &bytes)
    }

    /// Reads a file that [`write`](Self::write) wrote.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|error| Error::io(path, error))?;
        Self::from_json(&bytes).map_err(|error| error.with_path(path))
    }
}

fn unknown_version(version: u32) -> Error {
    Error::new(
        ErrorKind::Format,
        format!("schema version {version}, this program reads {SCHEMA_VERSION}"),
    )
    .with_help("run the suite again with this program, or read the file with the one that wrote it")
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * a.abs().max(b.abs()).max(1.0)
}

/// Writes `bytes` to a neighbour of `path`, flushes it to the disk and renames it.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    let part = PathBuf::from(name);
    let written = (|| {
        let mut file = BufWriter::new(File::create(&part)?);
        file.write_all(bytes)?;
        file.into_inner()?.sync_all()?;
        std::fs::rename(&part, path)
    })();
    written.map_err(|error| {
        // The first error is the one to report; a part that stays behind harms nobody.
        let _ = std::fs::remove_file(&part);
        Error::io(path, error)
    })
}

/// JSON with one line per field of the root and per entry of its arrays.
#[derive(Default)]
struct LinePerEntry {
    depth: usize,
    has_entry: bool,
}

/// Depth down to which every entry has its own line.
const LINE_DEPTH: usize = 2;

impl LinePerEntry {
    fn begin<W: ?Sized + Write>(&mut self, writer: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth += 1;
        self.has_entry = false;
        writer.write_all(bracket)
    }

    fn end<W: ?Sized + Write>(&mut self, writer: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth -= 1;
        if self.has_entry && self.depth < LINE_DEPTH {
            self.new_line(writer)?;
        }
        writer.write_all(bracket)
    }

    fn entry<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        if !first {
            writer.write_all(b",")?;
        }
        if self.depth <= LINE_DEPTH {
            self.new_line(writer)?;
        } else if !first {
            writer.write_all(b" ")?;
        }
        Ok(())
    }

    fn new_line<W: ?Sized + Write>(&self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b"\n")?;
        for _ in 0..self.depth {
            writer.write_all(b" ")?;
        }
        Ok(())
    }
}

impl serde_json::ser::Formatter for LinePerEntry {
    fn begin_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.begin(writer, b"[")
    }

    fn end_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.end(writer, b"]")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, w: &mut W, first: bool) -> io::Result<()> {
        self.entry(w, first)
    }

    fn end_array_value<W: ?Sized + Write>(&mut self, _: &mut W) -> io::Result<()> {
        self.has_entry = true;
        Ok(())
    }

    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.begin(writer, b"{")
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.end(writer, b"}")
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, w: &mut W, first: bool) -> io::Result<()> {
        self.entry(w, first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b": ")
    }

    fn end_object_value<W: ?Sized + Write>(&mut self, _: &mut W) -> io::Result<()> {
        self.has_entry = true;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> RowKey {
        "lttl/fremen/annual/count/1/30".parse().unwrap()
    }

    fn answer(first: &str, ties: &[&str]) -> Answer {
        Answer {
            first: Some(first.into()),
            decision: Decision::At(first.into()),
            posterior: BTreeMap::from([(first.to_owned(), 0.75)]),
            ties: ties.iter().map(ToString::to_string).collect(),
        }
    }

    fn results() -> SuiteResults {
        let mut results = SuiteResults::new("tiny", "made up");
        let answers = [answer("a", &[]), answer("b", &["b", "a"]), answer("b", &[])];
        for (i, answer) in answers.into_iter().enumerate() {
            results.queries.push(Query {
                id: format!("{i}.png"),
                truth: Some("a".into()),
                group: None,
                answers: BTreeMap::from([(key().to_string(), answer)]),
            });
        }
        results.rows.push(Row {
            is_default: true,
            preset: "lttl".into(),
            method: "fremen".into(),
            model: "annual".into(),
            score: "count".into(),
            order: Order::Fixed(1),
            n: 30,
            queries: 3,
            correct: 1.5,
            wrong: 1.5,
            unknown: 0,
            tied: 1,
            ci_low: 0.0,
            ci_high: 100.0,
            reobserved: None,
            pairs_compared: 240.0,
            ms_p50: 0.5,
            ms_p99: 0.75,
        });
        results
    }

    #[test]
    fn reads_back_what_it_wrote_and_writes_the_same_bytes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tiny.json");
        let results = results();
        results.write(&path).unwrap();
        assert_eq!(SuiteResults::read(&path).unwrap(), results);
        assert_eq!(std::fs::read(&path).unwrap(), results.to_json().unwrap());
        let files = std::fs::read_dir(dir.path()).unwrap().count();
        assert_eq!(files, 1, "no part stays behind");
    }

    #[test]
    fn has_the_documented_fields_and_one_line_per_row_and_query() {
        let text = String::from_utf8(results().to_json().unwrap()).unwrap();
        let row = text
            .lines()
            .find(|line| line.contains("is_default"))
            .unwrap();
        assert_eq!(
            row.trim(),
            r#"{"is_default": true, "preset": "lttl", "method": "fremen", "model": "annual", "#
                .to_owned()
                + r#""score": "count", "order": 1, "n": 30, "queries": 3, "correct": 1.5, "#
                + r#""wrong": 1.5, "unknown": 0, "tied": 1, "ci_low": 0.0, "ci_high": 100.0, "#
                + r#""reobserved": null, "pairs_compared": 240.0, "ms_p50": 0.5, "ms_p99": 0.75}"#
        );
        let query = text.lines().find(|line| line.contains("1.png")).unwrap();
        assert_eq!(
            query.trim().trim_end_matches(','),
            r#"{"id": "1.png", "truth": "a", "answers": {"lttl/fremen/annual/count/1/30": "#
                .to_owned()
                + r#"{"first": "b", "decision": {"at": "b"}, "posterior": {"b": 0.75}, "#
                + r#""ties": ["b", "a"]}}}"#
        );
    }

    #[test]
    fn a_tie_is_split_over_the_tied_places() {
        assert_eq!(answer("a", &[]).wrong(Some("a")), 0.0);
        assert_eq!(answer("a", &[]).wrong(Some("b")), 1.0);
        assert_eq!(answer("b", &["a", "b"]).wrong(Some("a")), 0.5);
        assert_eq!(answer("a", &["a", "b", "c", "d"]).wrong(Some("a")), 0.75);
        assert_eq!(answer("b", &["b", "c"]).wrong(Some("a")), 1.0);
        assert_eq!(answer("a", &[]).wrong(None), 1.0);
    }

    #[test]
    fn bad_files_are_named_with_their_fault() {
        let says = |bytes: &[u8]| SuiteResults::from_json(bytes).unwrap_err().to_string();
        assert!(says(b"").contains("EOF"));
        assert!(says(b"{}").contains("schema_version"));
        assert!(says(br#"{"schema_version": 2}"#).contains("schema version 2"));
        let mut torn = results().to_json().unwrap();
        torn.truncate(torn.len() - 20);
        assert!(says(&torn).contains("line"));

        let says = |change: fn(&mut SuiteResults)| {
            let mut results = results();
            change(&mut results);
            results.to_json().unwrap_err().to_string()
        };
        assert!(says(|r| r.rows[0].ms_p50 = f64::NAN).contains("`ms_p50` is NaN"));
        assert!(says(|r| r.rows.push(r.rows[0].clone())).contains("twice"));
        assert!(says(|r| r.rows[0].correct = 2.0).contains("not the number of queries"));
        assert!(says(|r| r.rows[0].tied = 0).contains("answers give 1.5, 1 and 3"));
        assert!(says(|r| r.queries[1].id = "0.png".into()).contains("twice"));
        let missing = SuiteResults::read(Path::new("/nowhere/x.json")).unwrap_err();
        assert!(missing.to_string().contains("/nowhere/x.json"));
    }

    #[test]
    fn keys_read_back_what_they_print() {
        for text in [
            "lttl/static/mean/count/0/5",
            "default/fused/auto/likelihood/auto/300",
        ] {
            assert_eq!(text.parse::<RowKey>().unwrap().to_string(), text);
        }
        for text in ["", "a/b/c/d/0", "a/b/c/d/x/5", "a/b/c/d/0/-1", "a//c/d/0/5"] {
            assert!(text.parse::<RowKey>().is_err(), "{text}");
        }
    }
}

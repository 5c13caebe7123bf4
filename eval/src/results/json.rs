//! How is `SUITE.json` written and read?
//!
//! One line for each field of the root and for each entry of its lists, so that two files can be
//! compared with `diff`. The same results give the same bytes.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use chronotope::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::suite_results::{SCHEMA_VERSION, SuiteResults};
use super::validate::unknown_version;

impl SuiteResults {
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

/// Writes what a suite without images found, field by field on lines of their own.
pub fn write_json(results: &impl Serialize, path: &Path) -> Result<()> {
    let mut bytes = serde_json::to_vec_pretty(results)
        .map_err(|error| Error::new(ErrorKind::Format, error.to_string()).with_path(path))?;
    bytes.push(b'\n');
    write_atomically(path, &bytes)
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
    use std::collections::BTreeMap;

    use crate::results::{Answer, Decision, Query, Reobservation, Row, RowKey, Variant};

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
                near: Vec::new(),
                group: None,
                answers: BTreeMap::from([(key().to_string(), answer)]),
            });
        }
        results.rows.push(Row {
            is_default: true,
            variant: key().variant,
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
            within: None,
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
    fn what_all_scores_share_is_written_without_a_score() {
        let mut results = results();
        results.reobservation.push(Reobservation {
            variant: Variant {
                score: String::new(),
                ..key().variant
            },
            top: 10,
            percent: 50.0,
            ci_low: 25.0,
            ci_high: 75.0,
        });
        let bytes = results.to_json().unwrap();
        assert!(String::from_utf8_lossy(&bytes).contains(
            r#"{"preset": "lttl", "method": "fremen", "model": "annual", "order": 1, "top": 10, "#
        ));
        assert_eq!(SuiteResults::from_json(&bytes).unwrap(), results);
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
        assert!(says(|r| r.rows[0].variant.score.clear()).contains("is no key"));
        assert!(says(|r| r.rows[0].correct = 2.0).contains("not the number of queries"));
        assert!(says(|r| r.rows[0].tied = 0).contains("answers give 1.5, 1 and 3"));
        assert!(says(|r| r.queries[1].id = "0.png".into()).contains("twice"));
        let missing = SuiteResults::read(Path::new("/nowhere/x.json")).unwrap_err();
        assert!(missing.to_string().contains("/nowhere/x.json"));
    }
}

//! Which place does a table of times name?
//!
//! CSV with the columns `begin`, `end` and `place`: from `begin` on and before `end` the robot was
//! at `place`. Times as everywhere: RFC 3339 with an offset, or a number since 1970 with its unit
//! (`1717000000.25s`). Times that no row has belong to no place.

use std::collections::BTreeMap;
use std::path::Path;

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::map::PlaceKey;
use chronotope::time::Time;

/// Bytes of a table, at most.
const MAX_BYTES: u64 = 64 << 20;

/// Places by the time they begin.
#[derive(Debug, Default)]
pub(crate) struct Table(BTreeMap<Time, (Time, PlaceKey)>);

impl Table {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = fremen::file::read_text(path, MAX_BYTES)?;
        Self::parse(text.trim_start_matches('\u{feff}')).map_err(|error| error.with_path(path))
    }

    fn parse(text: &str) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let wrong = |line: u64, message: String| {
            Error::new(ErrorKind::Format, message).with_place(format!("line {line}"))
        };
        let failed = |cause: csv::Error| {
            let line = cause.position().map_or(1, csv::Position::line);
            wrong(line, cause.to_string())
        };
        let columns: Vec<String> = (reader.headers().map_err(failed)?.iter())
            .map(str::to_owned)
            .collect();
        if columns != ["begin", "end", "place"] {
            return Err(wrong(1, format!("the columns are `{}`", columns.join(",")))
                .with_help("write `begin,end,place` in the first line"));
        }
        let mut table = Self::default();
        for record in reader.records() {
            let record = record.map_err(failed)?;
            let line = record.position().map_or(0, csv::Position::line);
            let at = |error: Error| error.with_place(format!("line {line}"));
            let begin = Time::parse(&record[0]).map_err(at)?;
            let end = Time::parse(&record[1]).map_err(at)?;
            let place = PlaceKey::written(&record[2]).map_err(at)?;
            if end <= begin {
                return Err(wrong(
                    line,
                    format!("it ends at {end}, but begins at {begin}"),
                ));
            }
            let next = table.0.range(begin..end).next().is_some();
            if next || table.at(begin).is_some() {
                return Err(wrong(line, "its time is in another row, too".into())
                    .with_help("the robot is at one place at a time"));
            }
            table.0.insert(begin, (end, place));
        }
        Ok(table)
    }

    /// The place then.
    pub(crate) fn at(&self, time: Time) -> Option<&PlaceKey> {
        let (_, (end, place)) = self.0.range(..=time).next_back()?;
        (time < *end).then_some(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_belong_to_their_row_and_no_other() -> Result<()> {
        let table =
            Table::parse("begin,end,place\n10s,20s,door\n1970-01-01T00:00:30Z, 40s, gate\n")?;
        let at = |s| table.at(Time::from_s(s)).map(PlaceKey::as_str);
        assert_eq!(
            [at(9), at(10), at(19), at(20), at(35)],
            [None, Some("door"), Some("door"), None, Some("gate")]
        );
        Ok(())
    }

    #[test]
    fn wrong_rows_are_named() {
        for (text, line) in [
            ("begin,place\n", "line 1"),
            ("begin,end,place\n1s,2s,a\n3,4,b\n", "line 3"),
            ("begin,end,place\n2s,1s,a\n", "line 2"),
            ("begin,end,place\n1s,9s,a\n3s,4s,b\n", "line 3"),
            ("begin,end,place\n3s,4s,a\n1s,9s,b\n", "line 3"),
            ("begin,end,place\n1s,2s\n", "line 2"),
            ("begin,end,place\n1s,2s,\n", "line 2"),
        ] {
            let error = Table::parse(text).expect_err(text).to_string();
            assert!(error.contains(line), "{text}: {error}");
        }
    }
}

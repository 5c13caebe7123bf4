//! Which times and states are in this CSV file?
//!
//! A header is a first row whose time cell is none. Times are RFC 3339 with an offset or seconds since
//! 1970 (a fraction is allowed), states `0`, `1`, `false`, `true`; a row with an empty state is missing. Rows
//! may come in any order of time.

use std::path::Path;

use chronotope::error::{Error, ErrorKind, Result, line_of_record};
use chronotope::time::{Period, Time};
use chronotope::visibility::{BitRow, HistoryLog};

/// One state over time, ascending.
#[derive(Debug)]
pub(super) struct Series {
    pub(super) states: Vec<(Time, bool)>,
    /// Rows without a state.
    pub(super) num_missing: usize,
}

/// Where a series' columns are: by name, or the first two.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Columns<'a> {
    pub(super) time: Option<&'a str>,
    pub(super) state: Option<&'a str>,
}

impl Series {
    pub(super) fn read(path: &Path, columns: Columns<'_>) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|cause| Error::io(path, &cause))?;
        Self::parse(&bytes, columns).map_err(|error| error.with_path(path))
    }

    fn parse(bytes: &[u8], columns: Columns<'_>) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(bytes);
        let mut at = (0, 1);
        let mut series = Self {
            states: Vec::new(),
            num_missing: 0,
        };
        for (number, record) in reader.records().enumerate() {
            let record = record.map_err(|cause| {
                let line = cause.position().map_or(1, csv::Position::line);
                format(cause.to_string()).with_place(format!("line {line}"))
            })?;
            let line = line_of_record(bytes, &record, Some(b'#'));
            let place = |error: Error| error.with_place(format!("line {line}"));
            if number == 0 && record.get(at.0).is_none_or(|cell| time_of(cell).is_err()) {
                at = named(&record, columns).map_err(place)?;
                continue;
            }
            if number == 0 && (columns.time.is_some() || columns.state.is_some()) {
                return Err(place(format("there is no header to find columns by")));
            }
            let cell = |i: usize| {
                let missing = || place(format(format!("there is no column {}", i + 1)));
                record.get(i).ok_or_else(missing)
            };
            let time = time_of(cell(at.0)?).map_err(place)?;
            match cell(at.1)? {
                "" => series.num_missing += 1,
                "0" | "0.0" | "false" => series.states.push((time, false)),
                "1" | "1.0" | "true" => series.states.push((time, true)),
                other => {
                    return Err(place(
                        format(format!("`{other}` is no state"))
                            .with_help("write 0 or 1, or nothing where it is not known"),
                    ));
                }
            }
        }
        if series.states.is_empty() {
            return Err(format("the file has no rows with a time and a state")
                .with_help("rows look like `2024-05-01T08:30:00Z,1`"));
        }
        // Stable: rows of equal times stay in the file's order.
        series.states.sort_by_key(|state| state.0);
        Ok(series)
    }

    /// As the log of one feature; `states` are some of the series.
    pub(super) fn log(states: &[(Time, bool)]) -> Result<HistoryLog> {
        let mut log = HistoryLog::new();
        for &(time, state) in states {
            let mut seen = BitRow::zeros(1);
            if state {
                seen.set(0);
            }
            log.push_visit(time, seen, None)?;
        }
        Ok(log)
    }

    /// The time from the first to the last row.
    pub(super) fn span_s(&self) -> f64 {
        match (self.states.first(), self.states.last()) {
            (Some(first), Some(last)) => last.0.since_s(first.0),
            _ => 0.0,
        }
    }
}

/// The places of time and state in a header.
fn named(header: &csv::StringRecord, columns: Columns<'_>) -> Result<(usize, usize)> {
    let find = |name: Option<&str>, or: usize| match name {
        None if or < header.len() => Ok(or),
        None => Err(
            format(format!("a row has {} columns, not two", header.len()))
                .with_help("write a time and a state on every line, with a comma between"),
        ),
        Some(name) => (header.iter().position(|cell| cell == name)).ok_or_else(|| {
            let known: Vec<&str> = header.iter().collect();
            format(format!("there is no column `{name}`"))
                .with_help(format!("the columns are {}", known.join(", ")))
        }),
    };
    Ok((find(columns.time, 0)?, find(columns.state, 1)?))
}

/// RFC 3339 with an offset, or seconds since 1970.
pub(super) fn time_of(cell: &str) -> Result<Time> {
    match cell.parse::<f64>() {
        Err(_) => Time::parse(cell),
        Ok(seconds) => {
            let us = (seconds * Period::from_s(1.0)?.as_us() as f64).round();
            if us.is_finite() && us.abs() < i64::MAX as f64 {
                Ok(Time::from_us(us as i64))
            } else {
                Err(Error::new(ErrorKind::Time, format!("`{cell}` is no time"))
                    .with_help("write RFC 3339 with an offset, or seconds since 1970"))
            }
        }
    }
}

fn format(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Series> {
        Series::parse(text.as_bytes(), Columns::default())
    }

    #[test]
    fn times_in_both_forms_with_and_without_header() {
        let expected = [
            (Time::from_s(60), true),
            (Time::from_us(120_500_000), false),
        ];
        for text in [
            "60,1\n120.5,0\n",
            "time,open\n120.5,false\n60,true\n",
            "# a door\n1970-01-01T00:01:00Z, 1\n1970-01-01T02:02:00.5+02:00, 0\n",
            "when,state,who\n60,1,me\n120.5,0,\n",
        ] {
            assert_eq!(parse(text).expect(text).states, expected, "{text}");
        }
    }

    #[test]
    fn columns_are_found_by_name_and_empty_states_are_missing() {
        let columns = Columns {
            time: Some("t"),
            state: Some("ok"),
        };
        let series = Series::parse(b"ok,x,t\n1,7,10\n,7,20\n0,7,5\n", columns).expect("valid");
        assert_eq!(
            series.states,
            [(Time::from_s(5), false), (Time::from_s(10), true)]
        );
        assert_eq!(series.num_missing, 1);
        let unknown = Columns {
            state: Some("door"),
            ..columns
        };
        let error = Series::parse(b"ok,x,t\n1,7,10\n", unknown).expect_err("no such column");
        assert!(error.to_string().contains("ok, x, t"), "{error}");
    }

    #[test]
    fn what_is_no_series_is_refused_with_its_line() {
        for (text, says) in [
            ("", "no rows"),
            ("time,open\n", "no rows"),
            ("time,open\n60,1\nNaN,1\n", "line 3"),
            ("time,open\n60,1\n1e300,1\n", "line 3"),
            ("60,1\n\n70,maybe\n", "line 3"),
            ("60,1\n2009-10-15 12:00,1\n", "line 2"),
            ("60,1\n70\n", "line 2"),
            ("time\n60\n", "line 1"),
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }
}

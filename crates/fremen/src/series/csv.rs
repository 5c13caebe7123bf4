//! Which times and states are in this CSV file?

use std::path::Path;

use super::Series;
use crate::error::{Error, ErrorKind, Result};
use crate::file;
use crate::time::{Period, Time};

/// Bytes of a file, at most: some ten million rows.
const MAX_BYTES: u64 = 1 << 28;

/// Where a series' columns are: by name, or the first two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Columns<'a> {
    /// The name of the column of times; the first column otherwise.
    pub time: Option<&'a str>,
    /// The name of the column of states; the second column otherwise.
    pub state: Option<&'a str>,
}

impl Series {
    /// Reads a CSV file: a time and a state on every line.
    ///
    /// Times are RFC 3339 with an offset or seconds since 1970 (a fraction is allowed), states `0`,
    /// `1`, `false`, `true`; a row with an empty state is missing. Rows may come in any order,
    /// lines that begin with `#` are comments, and a first row whose time is none is a header.
    /// Fails with the line of what is no series.
    pub fn read_csv(path: impl AsRef<Path>, columns: Columns<'_>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = file::read(path, MAX_BYTES)?;
        Self::parse_csv(&bytes, columns).map_err(|error| error.with_path(path))
    }

    /// [`read_csv`](Self::read_csv) of the content of a file.
    pub fn parse_csv(bytes: &[u8], columns: Columns<'_>) -> Result<Self> {
        parse(bytes, columns)
    }
}

fn parse(bytes: &[u8], columns: Columns<'_>) -> Result<Series> {
    let mut reader = ::csv::ReaderBuilder::new()
        .has_headers(false)
        .trim(::csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(bytes);
    let mut at = (0, 1);
    let mut samples = Vec::new();
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(|cause| {
            let line = cause.position().map_or(1, ::csv::Position::line);
            format(cause.to_string()).with_place(format!("line {line}"))
        })?;
        let line = line_of_record(bytes, &record, Some(b'#'));
        let place = |error: Error| error.with_place(format!("line {line}"));
        if number == 0
            && record
                .get(at.0)
                .is_none_or(|cell| time_of_cell(cell).is_err())
        {
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
        let time = time_of_cell(cell(at.0)?).map_err(place)?;
        match cell(at.1)? {
            "" => samples.push((time, None)),
            "0" | "0.0" | "false" => samples.push((time, Some(false))),
            "1" | "1.0" | "true" => samples.push((time, Some(true))),
            other => {
                return Err(place(
                    format(format!("`{other}` is no state"))
                        .with_help("write 0 or 1, or nothing where it is not known"),
                ));
            }
        }
    }
    let series: Series = samples.into_iter().collect();
    if series.is_empty() {
        return Err(format("the file has no rows with a time and a state")
            .with_help("rows look like `2024-05-01T08:30:00Z,1`"));
    }
    Ok(series)
}

/// The places of time and state in a header.
fn named(header: &::csv::StringRecord, columns: Columns<'_>) -> Result<(usize, usize)> {
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

/// The time in a cell of a table: RFC 3339 with an offset, or seconds since 1970.
pub fn time_of_cell(cell: &str) -> Result<Time> {
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

/// The line that a CSV record begins on, counted from 1.
///
/// The reader notes where it began to look, which is before the empty lines and comments that it
/// passed over.
pub fn line_of_record(text: &[u8], record: &::csv::StringRecord, comment: Option<u8>) -> u64 {
    let Some(position) = record.position() else {
        return 1;
    };
    let rest = text.get(position.byte() as usize..).unwrap_or_default();
    let passed = rest
        .split_inclusive(|&byte| byte == b'\n')
        .take_while(|line| {
            (comment.is_some() && line.first().copied() == comment)
                || line.iter().all(|byte| b"\r\n".contains(byte))
        });
    position.line() + passed.count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Series> {
        super::parse(text.as_bytes(), Columns::default())
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
            assert_eq!(parse(text).expect(text).states(), expected, "{text}");
        }
    }

    #[test]
    fn columns_are_found_by_name_and_empty_states_are_missing() {
        let columns = Columns {
            time: Some("t"),
            state: Some("ok"),
        };
        let series = super::parse(b"ok,x,t\n1,7,10\n,7,20\n0,7,5\n", columns).expect("valid");
        assert_eq!(
            series.states(),
            [(Time::from_s(5), false), (Time::from_s(10), true)]
        );
        assert_eq!(series.missing(), [Time::from_s(20)]);
        let unknown = Columns {
            state: Some("door"),
            ..columns
        };
        let error = super::parse(b"ok,x,t\n1,7,10\n", unknown).expect_err("no such column");
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

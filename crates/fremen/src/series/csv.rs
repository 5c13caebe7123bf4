//! Which times and states are in this CSV file?
//!
//! Files come as people have them: with a header or without, with commas, semicolons, tabs or
//! spaces, `True` and `NaN`, a byte order mark. Times are RFC 3339 or numbers; numbers are seconds
//! since 1970 unless another unit is given, and one that looks like another unit is an error that
//! names it, because a series read in the wrong unit has rhythms, too: wrong ones.

use std::borrow::Cow;
use std::path::Path;

use super::Series;
use crate::error::{Error, ErrorKind, Result};
use crate::file;
use crate::time::{Time, TimeUnit, Zone};

/// Bytes of a file, at most.
const MAX_BYTES: u64 = 1 << 28;
/// Rows of a file, at most: one every ten seconds of a year. With what is made of them they take
/// some 300 MB.
const MAX_ROWS: usize = 4_000_000;

/// A time before this, in a series of which most times are later than [`RECORDED_FROM`], is that of
/// a clock that was never set.
const NEVER_SET_BEFORE: Time = Time::from_s(2 * 365 * 86_400);
const RECORDED_FROM: Time = Time::from_s(631_152_000);
/// And one after this is that of a clock that was set wrong, where most times are before.
const RECORDED_UNTIL: Time = Time::from_s(4_102_444_800);

/// Where a series' columns are, and what its times mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Columns<'a> {
    /// The name of the column of times; the first column otherwise.
    pub time: Option<&'a str>,
    /// The name of the column of states; the second column otherwise.
    pub state: Option<&'a str>,
    /// What times that are numbers count; seconds since 1970, and no other unit by mistake, if not
    /// given.
    pub unit: Option<TimeUnit>,
    /// The zone of dates without an offset.
    pub zone: Option<&'a Zone>,
}

impl Columns<'_> {
    /// The time in a cell, or in an argument about the same series: RFC 3339, or a number that counts
    /// what [`unit`](Self::unit) says.
    ///
    /// Without a unit, a number that is no moment in seconds from 1990 to 2060, but would be one in
    /// another unit with more digits, is refused.
    pub fn time_of(&self, cell: &str) -> Result<Time> {
        match (cell.parse::<f64>(), self.unit) {
            (Err(_), _) => Time::parse_in(cell, self.zone),
            (Ok(_), Some(unit)) => unit.time(cell),
            (Ok(_), None) => match finer_unit(cell) {
                // One row is enough: as seconds it would be millennia away from any record.
                Some(unit) => Err(looks_like(cell, unit)),
                None => TimeUnit::Seconds.time(cell),
            },
        }
    }
}

impl Series {
    /// Reads a CSV file: a time and a state on every line.
    ///
    /// Times are RFC 3339 with an offset or numbers ([`Columns::unit`]), states `0`, `1`, `false`,
    /// `true` (in any case); a row with an empty state, `NaN`, `NA` or `null` is missing. Rows may
    /// come in any order, lines that begin with `#` are comments, and a first row whose time and
    /// state are none is a header. Fails with the line of what is no series.
    pub fn read_csv(path: impl AsRef<Path>, columns: Columns<'_>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = file::read(path, MAX_BYTES)?;
        Self::parse_csv(&bytes, columns).map_err(|error| error.with_path(path))
    }

    /// [`read_csv`](Self::read_csv) of the content of a file.
    pub fn parse_csv(bytes: &[u8], columns: Columns<'_>) -> Result<Self> {
        let series: Self = (rows(bytes, columns, 2)?.into_iter())
            .map(|row| (row.time, row.state))
            .collect();
        if series.is_empty() {
            return Err(format("the file has no rows with a time and a state")
                .with_help("rows look like `2024-05-01T08:30:00Z,1`"));
        }
        Ok(series)
    }

    /// Reads a column of times at which something happened, as the series of whether it did in each
    /// `step_s` seconds from the first to the last of them.
    ///
    /// Fails as [`parse_csv`](Self::parse_csv) does, with [`ErrorKind::Config`] unless the step is
    /// positive, and with [`ErrorKind::Shape`] if there would be more than 2^24 steps.
    pub fn parse_events(bytes: &[u8], columns: Columns<'_>, step_s: f64) -> Result<Self> {
        const MAX_STEPS: i64 = 1 << 24;
        let step_us = crate::time::Period::from_s(step_s)?.as_us();
        let steps: std::collections::BTreeSet<i64> = (rows(bytes, columns, 1)?.into_iter())
            .map(|row| row.time.as_us().div_euclid(step_us))
            .collect();
        let (Some(&first), Some(&last)) = (steps.first(), steps.last()) else {
            return Err(format("the file has no times").with_help("write one on every line"));
        };
        if last - first >= MAX_STEPS {
            return Err(Error::new(
                ErrorKind::Shape,
                format!("{} steps of {step_s} s are too many", last - first),
            )
            .with_help("choose a longer step"));
        }
        Ok((first..=last)
            .map(|step| (Time::from_us(step * step_us), steps.contains(&step)))
            .collect())
    }
}

struct Row {
    time: Time,
    state: Option<bool>,
    line: u64,
    /// As it is written, if it is a number.
    number: Option<f64>,
}

/// The rows of a table with `num_columns` columns that matter: of times, and of states.
fn rows(bytes: &[u8], columns: Columns<'_>, num_columns: usize) -> Result<Vec<Row>> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let delimiter = delimiter(bytes);
    let text = match delimiter {
        b' ' => Cow::Owned(squeezed(bytes)),
        _ => Cow::Borrowed(bytes),
    };
    let bytes = &*text;
    let mut reader = ::csv::ReaderBuilder::new()
        .has_headers(false)
        .trim(::csv::Trim::All)
        .comment(Some(b'#'))
        .flexible(true)
        .delimiter(delimiter)
        .from_reader(bytes);
    let mut at = (0, 1);
    let mut rows = Vec::new();
    let mut num_cells = None;
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(|cause| {
            let line = cause.position().map_or(1, ::csv::Position::line);
            let error = match cause.kind() {
                ::csv::ErrorKind::Utf8 { .. } => format("this is no text in UTF-8").with_help(
                    "save the file as UTF-8; what is packed by anything but gzip must be unpacked",
                ),
                _ => format(cause.to_string()),
            };
            error.with_place(format!("line {line}"))
        })?;
        let line = line_of_record(bytes, &record, Some(b'#'));
        let place = |error: Error| error.with_place(format!("line {line}"));
        let expected = *num_cells.get_or_insert(record.len());
        if record.len() != expected {
            let message = format!("{} columns, but {expected} before", record.len());
            return Err(place(format(message).with_help(
                "write every cell, even if empty, and quote one with a comma",
            )));
        }
        if number == 0 && is_header(&record, columns) {
            at = named(&record, columns, num_columns).map_err(place)?;
            continue;
        }
        if number == 0 && (columns.time.is_some() || columns.state.is_some()) {
            return Err(place(format("there is no header to find columns by")));
        }
        let cell = |i: usize| record.get(i).ok_or_else(|| place(one_column(record.len())));
        let written = cell(at.0)?;
        if rows.len() == MAX_ROWS {
            let message = format!("there are more than {MAX_ROWS} rows");
            return Err(place(format(message).with_help("give a part of them")));
        }
        rows.push(Row {
            time: columns.time_of(written).map_err(place)?,
            state: if num_columns == 1 {
                Some(true)
            } else {
                state(cell(at.1)?).map_err(place)?
            },
            line,
            number: written.parse().ok(),
        });
    }
    check_times(&rows, columns.unit)?;
    Ok(rows)
}

/// The character that stands between the cells of most lines at the beginning.
fn delimiter(bytes: &[u8]) -> u8 {
    let lines = bytes
        .split(|&byte| byte == b'\n')
        .filter(|line| !line.is_empty() && !line.starts_with(b"#"))
        .take(8);
    let count = |delimiter: u8| lines.clone().filter(|it| it.contains(&delimiter)).count();
    let half = lines.clone().count() / 2;
    if let Some(found) = [b',', b';', b'\t', b'|']
        .into_iter()
        .find(|&it| count(it) > half)
    {
        return found;
    }
    // A date may have a space in it.
    let is_spaced = |line: &&[u8]| {
        let line = line.trim_ascii();
        let before = line.split(|&byte| byte == b' ').next().unwrap_or_default();
        line.contains(&b' ')
            && std::str::from_utf8(before)
                .is_ok_and(|text| text.parse::<f64>().is_ok() || text.contains('T'))
    };
    if lines.clone().filter(is_spaced).count() > half {
        b' '
    } else {
        b','
    }
}

/// The text with one space in place of several, and none at the ends of lines: columns may be
/// aligned.
fn squeezed(bytes: &[u8]) -> Vec<u8> {
    let lines = bytes.split(|&byte| byte == b'\n').map(|line| {
        let cells = line.split(u8::is_ascii_whitespace);
        let cells: Vec<&[u8]> = cells.filter(|cell| !cell.is_empty()).collect();
        cells.join(&b' ')
    });
    let lines: Vec<Vec<u8>> = lines.collect();
    lines.join(&b'\n')
}

/// Whether this first row names columns: its time is none and has no digit, or a column has the
/// name that was asked for.
fn is_header(row: &::csv::StringRecord, columns: Columns<'_>) -> bool {
    let names = [columns.time, columns.state];
    if names
        .into_iter()
        .flatten()
        .any(|name| row.iter().any(|cell| cell == name))
    {
        return true;
    }
    let is_number = |cell: &str| cell.starts_with(|c: char| c.is_ascii_digit() || c == '-');
    // A row whose time is broken is no header: it has a state.
    let has_state = row
        .get(1)
        .is_some_and(|cell| !cell.is_empty() && state(cell).is_ok());
    row.get(0)
        .is_none_or(|cell| columns.time_of(cell).is_err() && !has_state && !is_number(cell))
}

/// The error where a state is looked for in vain.
fn one_column(num_columns: usize) -> Error {
    format(format!("a row has {num_columns} columns, not two")).with_help(
        "write a time and a state on every line, with a comma between; for a column of times at \
         which something happened say how long a step is",
    )
}

/// The places of time and state in a header.
fn named(
    header: &::csv::StringRecord,
    columns: Columns<'_>,
    num_columns: usize,
) -> Result<(usize, usize)> {
    let find = |name: Option<&str>, or: usize| match name {
        None if or < header.len() => Ok(or),
        None => Err(one_column(header.len())),
        Some(name) => (header.iter().position(|cell| cell == name)).ok_or_else(|| {
            let known: Vec<&str> = header.iter().collect();
            format(format!("there is no column `{name}`"))
                .with_help(format!("the columns are {}", known.join(", ")))
        }),
    };
    let time = find(columns.time, 0)?;
    if num_columns == 1 {
        return Ok((time, time));
    }
    Ok((time, find(columns.state, 1)?))
}

/// The state in a cell; `None` where it is missing.
fn state(cell: &str) -> Result<Option<bool>> {
    match cell.to_ascii_lowercase().as_str() {
        "" | "nan" | "na" | "n/a" | "null" | "none" => Ok(None),
        "false" => Ok(Some(false)),
        "true" => Ok(Some(true)),
        // Other programs write 0.000000 and 1.000e+00.
        number if number.parse::<f64>() == Ok(0.0) => Ok(Some(false)),
        number if number.parse::<f64>() == Ok(1.0) => Ok(Some(true)),
        _ => Err(format(format!("`{cell}` is no state"))
            .with_help("write 0 or 1, or nothing where it is not known")),
    }
}

/// The unit that a number of too many digits is in.
fn finer_unit(cell: &str) -> Option<TimeUnit> {
    let unit = cell.parse().ok().and_then(TimeUnit::guess)?;
    let is_finer = matches!(
        unit,
        TimeUnit::Milliseconds | TimeUnit::Microseconds | TimeUnit::Nanoseconds
    );
    is_finer.then_some(unit)
}

/// Refuses times that are in another unit than the others, or than `unit`.
///
/// Minutes, hours and days are as small as seconds of a clock that began at 0: they are told by the
/// whole series, if it begins late for such a clock, or by the others.
fn check_times(rows: &[Row], unit: Option<TimeUnit>) -> Result<()> {
    if unit.is_some() {
        return Ok(());
    }
    let fail = |row: &Row, error: Error| Err(error.with_place(format!("line {}", row.line)));
    let mut times: Vec<Time> = rows.iter().map(|row| row.time).collect();
    times.sort_unstable();
    let (Some(&first), Some(&middle)) = (times.first(), times.get(times.len() / 2)) else {
        return Ok(());
    };
    let guess = |row: &Row| row.number.and_then(TimeUnit::guess);
    let cell = |row: &Row| {
        row.number
            .map_or_else(|| row.time.to_string(), |it| it.to_string())
    };
    if middle >= RECORDED_FROM {
        // One row among good ones.
        let is_out = |row: &&Row| {
            row.time < NEVER_SET_BEFORE || (row.time > RECORDED_UNTIL && middle < RECORDED_UNTIL)
        };
        return match rows.iter().find(is_out) {
            None => Ok(()),
            Some(row) => fail(
                row,
                match guess(row) {
                    Some(unit) => looks_like(&cell(row), unit),
                    None if row.time > middle => Error::new(
                        ErrorKind::Time,
                        format!("{} is decades after the other times", row.time),
                    )
                    .with_help("that clock was set wrong: correct the time or remove the row"),
                    None => Error::new(
                        ErrorKind::Time,
                        format!("{} is decades before the other times", row.time),
                    )
                    .with_help("that clock was never set: correct the time or remove the row"),
                },
            ),
        };
    }
    let units: Vec<Option<TimeUnit>> = rows.iter().map(guess).collect();
    match (rows.first(), units.first()) {
        (Some(row), Some(&Some(unit)))
            if unit != TimeUnit::Seconds
                && units.iter().all(|&other| other == Some(unit))
                && begins_late(first, &times, unit) =>
        {
            fail(row, looks_like(&cell(row), unit))
        }
        _ => Ok(()),
    }
}

/// Whether times that are all moments in `unit` are no seconds of a clock that began at 0: they
/// span less than they begin after it, in a step that suits the unit.
fn begins_late(first: Time, times: &[Time], unit: TimeUnit) -> bool {
    let last = times.last().copied().unwrap_or(first);
    let steps = times.len().saturating_sub(1).max(1) as f64;
    let step_s = last.since_s(first) / steps;
    let is_days = matches!(
        unit,
        TimeUnit::Days | TimeUnit::ExcelDays | TimeUnit::JulianDays
    );
    // Samples of a day or more apart are rare, and so are several in a second.
    last.since_s(first) < first.as_s() && (!is_days || step_s < 1.0)
}

fn looks_like(cell: &str, unit: TimeUnit) -> Error {
    Error::new(
        ErrorKind::Time,
        format!(
            "`{cell}` is read as seconds since 1970, and looks like {}",
            unit.words()
        ),
    )
    .with_help(format!(
        "say what the numbers are (--time-unit {unit}, or --time-unit s if they are seconds), or \
         write RFC 3339"
    ))
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
        Series::parse_csv(text.as_bytes(), Columns::default())
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
            ..Columns::default()
        };
        let series = Series::parse_csv(b"ok,x,t\n1,7,10\n,7,20\n0,7,5\n", columns).expect("valid");
        assert_eq!(
            series.states(),
            [(Time::from_s(5), false), (Time::from_s(10), true)]
        );
        assert_eq!(series.missing(), [Time::from_s(20)]);
        let unknown = Columns {
            state: Some("door"),
            ..columns
        };
        let error = Series::parse_csv(b"ok,x,t\n1,7,10\n", unknown).expect_err("no such column");
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

    /// A sample every ten minutes for a fortnight, its time written in `unit`.
    fn in_unit(unit_s: f64, zero: f64) -> String {
        let rows: Vec<String> = (0..2_016_i32)
            .map(|i| {
                let s = 1_714_521_600.0 + 600.0 * f64::from(i);
                format!("{},{}", s / unit_s + zero, i / 72 % 2)
            })
            .collect();
        rows.join("\n")
    }

    #[test]
    fn pandas_17860_times_in_another_unit_are_refused_and_named() {
        assert!(parse(&in_unit(1.0, 0.0)).is_ok());
        for (text, unit) in [
            (in_unit(1e-3, 0.0), TimeUnit::Milliseconds),
            (in_unit(1e-6, 0.0), TimeUnit::Microseconds),
            (in_unit(1e-9, 0.0), TimeUnit::Nanoseconds),
            (in_unit(60.0, 0.0), TimeUnit::Minutes),
            (in_unit(3_600.0, 0.0), TimeUnit::Hours),
            (in_unit(86_400.0, 25_569.0), TimeUnit::ExcelDays),
            (in_unit(86_400.0, 2_440_587.5), TimeUnit::JulianDays),
        ] {
            let error = parse(&text).expect_err(unit.words()).to_string();
            assert!(
                error.contains(unit.words()) && error.contains("line 1"),
                "{error}"
            );
            let columns = Columns {
                unit: Some(unit),
                ..Columns::default()
            };
            let series = Series::parse_csv(text.as_bytes(), columns).expect("in this unit");
            assert_eq!(series.len(), 2_016);
            let start = series.states()[0].0;
            assert_eq!(start.to_string(), "2024-05-01T00:00:00Z", "{unit}");
        }
    }

    #[test]
    fn pandas_17860_one_wrong_row_among_good_ones_is_named() {
        let good = "1714521600,1\n1714522200,0\n1714522800,1\n";
        for (row, words) in [
            ("1714523400000,1", "milliseconds"),
            ("28575390,1", "minutes"),
            ("45413.02,1", "spreadsheet"),
            ("0,1", "never set"),
            ("9999999999,1", "decades after"),
            ("2286-11-20T17:46:39Z,1", "decades after"),
        ] {
            let error = parse(&format!("{good}{row}\n")).expect_err(row).to_string();
            assert!(error.contains(words) && error.contains("line 4"), "{error}");
        }
        let error = parse("2024-05-01T00:00:00Z,1\n1714522200000,0\n").expect_err("ms");
        assert!(error.to_string().contains("line 2"), "{error}");
    }

    #[test]
    fn series_come_as_people_have_them() {
        let expected = [(Time::from_s(60), true), (Time::from_s(120), false)];
        for text in [
            "\u{feff}time;open\n60;True\n120;FALSE\n180;NaN\n",
            "60\t1\n120\t0\n180\tNA\n",
            "60 1\n120 0\n",
            "   60   1\n\n  120   0  \r\n",
            "6.0e+01 1.000000000000000000e+00\n1.2e+02 0.000000000000000000e+00\n",
            "60.000000,1.000000\n120.000000,0.000000\n",
            "60|1.0\n120|0.0\n180|null\n",
        ] {
            assert_eq!(parse(text).expect(text).states(), expected, "{text:?}");
        }
        let prague = Zone::new("Europe/Prague").expect("known");
        let columns = Columns {
            zone: Some(&prague),
            ..Columns::default()
        };
        let text = b"2024-05-02 11:00:00,1\n2024-05-02 12:00:00,0\n";
        let series = Series::parse_csv(text, columns).expect("valid");
        assert_eq!(series.states()[0].0.to_string(), "2024-05-02T09:00:00Z");
    }

    #[test]
    fn a_first_row_with_a_broken_time_is_no_header() {
        for text in [
            "2024-13-01T00:00:00Z,1\n",
            "yesterday,1\n60,0\n",
            "12x,\n60,1\n",
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(error.contains("line 1"), "{text:?}: {error}");
        }
    }

    #[test]
    fn times_at_which_something_happened_are_steps() {
        let text = b"when\n1714521600\n1714521630\n1714521900\n";
        let series = Series::parse_events(text, Columns::default(), 60.0).expect("valid");
        let states: Vec<bool> = series.states().iter().map(|it| it.1).collect();
        assert_eq!(states, [true, false, false, false, false, true]);
        assert!(Series::parse_events(b"0\n4e9\n", Columns::default(), 1.0).is_err());
        assert!(Series::parse_events(text, Columns::default(), 0.0).is_err());
    }
}

//! Which columns and rows does this CSV file have?
//!
//! A [`Table`] has a header whose columns are all known, so that a misspelt optional column is not
//! ignored, and remembers the line of every row for messages. Cells are separated by commas, or all
//! by semicolons or tabs, as the header's are.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use fremen::error::{Error, ErrorKind, Result};
use fremen::series::line_of_record;

/// Bytes of a table, at most.
pub(super) const MAX_TABLE_BYTES: u64 = 1 << 28;
/// Rows of a table, at most: with what is made of them they take some 300 MB.
const MAX_ROWS: usize = 500_000;

pub(super) struct Table {
    path: PathBuf,
    columns: Vec<String>,
    pub(super) rows: Vec<Row>,
}

pub(super) struct Row {
    pub(super) line: u64,
    /// As they are written, with what is around them.
    cells: Vec<String>,
}

impl Table {
    /// Reads the whole file; `required` and `optional` are the only columns it may have.
    pub(super) fn read(path: &Path, required: &[&str], optional: &[&str]) -> Result<Self> {
        Self::read_where(path, required, optional, "", &|_| true)
    }

    /// [`read`](Self::read) of the rows whose cell in `column` is wanted.
    pub(super) fn read_where(
        path: &Path,
        required: &[&str],
        optional: &[&str],
        column: &str,
        is_wanted: &dyn Fn(&str) -> bool,
    ) -> Result<Self> {
        let text = read_text(path, MAX_TABLE_BYTES)?;
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::Headers)
            .delimiter(delimiter(&text))
            .from_reader(text.as_bytes());
        let columns: Vec<String> = reader
            .headers()
            .map_err(|cause| csv_error(path, &cause))?
            .iter()
            .map(str::to_owned)
            .collect();
        check_header(path, &columns, required, optional)?;
        let mut rows = Vec::new();
        let wanted = columns.iter().position(|name| name == column);
        let mut record = csv::StringRecord::new();
        while (reader.read_record(&mut record)).map_err(|cause| csv_error(path, &cause))? {
            let cell = wanted.and_then(|wanted| record.get(wanted));
            if !cell.is_none_or(is_wanted) {
                continue;
            }
            if rows.len() == MAX_ROWS {
                let message = format!("there are more than {MAX_ROWS} rows");
                return Err(Error::new(ErrorKind::Format, message)
                    .with_path(path)
                    .with_place(format!(
                        "line {}",
                        line_of_record(text.as_bytes(), &record, None)
                    ))
                    .with_help("split the file, and learn one part after the other"));
            }
            rows.push(Row {
                line: line_of_record(text.as_bytes(), &record, None),
                cells: record.iter().map(str::to_owned).collect(),
            });
        }
        Ok(Self {
            path: path.to_owned(),
            columns,
            rows,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn has(&self, column: &str) -> bool {
        self.columns.iter().any(|name| name == column)
    }

    /// The cell, or nothing where it is empty or the column is missing.
    pub(super) fn get<'a>(&self, row: &'a Row, column: &str) -> Option<&'a str> {
        self.written(row, column)
            .map(str::trim)
            .filter(|cell| !cell.is_empty())
    }

    /// The cell with the blanks at its ends.
    pub(super) fn written<'a>(&self, row: &'a Row, column: &str) -> Option<&'a str> {
        let position = self.columns.iter().position(|name| name == column)?;
        row.cells.get(position).map(String::as_str)
    }

    /// The cell, which must not be empty.
    pub(super) fn text<'a>(&self, row: &'a Row, column: &str) -> Result<&'a str> {
        self.get(row, column).ok_or_else(|| {
            self.error(row, column, "the cell is empty")
                .with_help(format!("write the {column} or remove the row"))
        })
    }

    /// The cell as a number, or nothing where it is empty.
    pub(super) fn number<T: FromStr>(
        &self,
        row: &Row,
        column: &str,
        what: &str,
    ) -> Result<Option<T>> {
        let Some(cell) = self.get(row, column) else {
            return Ok(None);
        };
        cell.parse()
            .map(Some)
            .map_err(|_| self.error(row, column, format!("`{cell}` is not {what}")))
    }

    /// The cell as a finite number, or nothing where it is empty.
    pub(super) fn finite(&self, row: &Row, column: &str) -> Result<Option<f64>> {
        let value: Option<f64> = self.number(row, column, "a number")?;
        match value {
            Some(value) if !value.is_finite() => {
                Err(self.error(row, column, format!("`{value}` is not a finite number")))
            }
            value => Ok(value),
        }
    }

    /// A format error at this cell.
    pub(super) fn error(&self, row: &Row, column: &str, message: impl Into<String>) -> Error {
        self.locate(Error::new(ErrorKind::Format, message), row, column)
    }

    /// Adds file, line and column.
    pub(super) fn locate(&self, error: Error, row: &Row, column: &str) -> Error {
        error
            .with_path(&self.path)
            .with_place(format!("line {}, column `{column}`", row.line))
    }
}

/// The file's UTF-8 text without a byte order mark; an error if it has more than `max_bytes`.
pub(super) fn read_text(path: &Path, max_bytes: u64) -> Result<String> {
    let bytes = fremen::file::read(path, max_bytes)?;
    let text = String::from_utf8(bytes).map_err(|cause| {
        let line = line_at(cause.as_bytes(), cause.utf8_error().valid_up_to());
        Error::new(ErrorKind::Format, "the text is not UTF-8")
            .with_path(path)
            .with_place(format!("line {line}"))
            .with_help("save the file as UTF-8")
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

/// The first line that is not empty.
pub(super) fn header_of(text: &str) -> &str {
    let mut lines = text.split(['\n', '\r']);
    lines.find(|line| !line.is_empty()).unwrap_or_default()
}

/// What stands between the cells: a comma, or what spreadsheets write where commas are decimal
/// points.
fn delimiter(text: &str) -> u8 {
    let header = header_of(text);
    let is_there = |&it: &u8| header.as_bytes().contains(&it);
    [b',', b';', b'\t']
        .into_iter()
        .find(is_there)
        .unwrap_or(b',')
}

/// The line, from 1, of the byte at `offset`.
pub(super) fn line_at(text: &[u8], offset: usize) -> usize {
    let before = &text[..offset.min(text.len())];
    before.split(|&byte| byte == b'\n').count()
}

fn check_header(
    path: &Path,
    columns: &[String],
    required: &[&str],
    optional: &[&str],
) -> Result<()> {
    let known = || {
        let mut names = required.join(", ");
        if !optional.is_empty() {
            names = format!("{names} and, if wanted, {}", optional.join(", "));
        }
        names
    };
    let error = |message: String, help: String| {
        Error::new(ErrorKind::Format, message)
            .with_path(path)
            .with_place("line 1")
            .with_help(help)
    };
    if columns.iter().all(String::is_empty) {
        return Err(error(
            "the file has no header".into(),
            format!("name the columns in the first line: {}", known()),
        ));
    }
    for (position, column) in columns.iter().enumerate() {
        if !required.contains(&column.as_str()) && !optional.contains(&column.as_str()) {
            return Err(error(
                format!("unknown column `{column}`"),
                format!("rename or remove it; the columns are {}", known()),
            ));
        }
        if columns[..position].contains(column) {
            return Err(error(
                format!("the column `{column}` appears twice"),
                "remove one of them".into(),
            ));
        }
    }
    for &column in required {
        if !columns.iter().any(|name| name == column) {
            return Err(error(
                format!("the column `{column}` is missing"),
                format!("the columns are {}", known()),
            ));
        }
    }
    Ok(())
}

fn csv_error(path: &Path, cause: &csv::Error) -> Error {
    let line = cause.position().map_or(1, csv::Position::line);
    let error = match cause.kind() {
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => Error::new(
            ErrorKind::Format,
            format!("{len} cells in this row, but the header has {expected_len} columns"),
        )
        .with_help("write every cell, even if empty, and quote a value that contains a comma"),
        _ => Error::new(ErrorKind::Format, cause.to_string()),
    };
    error.with_path(path).with_place(format!("line {line}"))
}

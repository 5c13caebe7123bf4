//! How are the tables of an exported folder read, cell by cell?

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::layout::{csv_error, format_error};
use crate::map::types::PlaceKey;
use fremen::error::{Error, Result};

/// A CSV file with known columns.
pub(super) struct Table {
    pub(super) path: PathBuf,
    pub(super) columns: &'static [&'static str],
    pub(super) rows: Vec<csv::StringRecord>,
}

impl Table {
    /// The table that `bytes`, those of the file at `path`, are.
    pub(super) fn parse(
        path: &Path,
        bytes: &[u8],
        columns: &'static [&'static str],
    ) -> Result<Self> {
        let mut reader = csv::Reader::from_reader(bytes);
        let error = |cause: csv::Error| csv_error(path, &cause);
        if reader.headers().map_err(error)? != columns {
            return Err(
                format_error(format!("the columns {} are expected", columns.join(",")))
                    .with_place("line 1")
                    .with_path(path),
            );
        }
        let rows: csv::Result<_> = reader
            .records()
            .map(|record| record.map(unguarded))
            .collect();
        Ok(Self {
            path: path.to_owned(),
            columns,
            rows: rows.map_err(error)?,
        })
    }

    /// The bytes of a table of these rows.
    pub(super) fn to_csv(columns: &[&str], rows: &[Vec<String>]) -> Result<Vec<u8>> {
        let failed = |cause: csv::Error| format_error(cause.to_string());
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(columns).map_err(failed)?;
        for row in rows {
            let cells = row.iter().map(|cell| guarded(cell));
            writer
                .write_record(cells.map(Cow::into_owned))
                .map_err(failed)?;
        }
        (writer.into_inner()).map_err(|cause| format_error(cause.to_string()))
    }

    pub(super) fn error(
        &self,
        row: Option<&csv::StringRecord>,
        message: impl Into<String>,
    ) -> Error {
        let line = row
            .and_then(csv::StringRecord::position)
            .map(csv::Position::line);
        let error = format_error(message).with_path(&self.path);
        match line {
            Some(line) => error.with_place(format!("line {line}")),
            None => error.with_place("end of the file"),
        }
    }

    pub(super) fn cell_error(
        &self,
        row: &csv::StringRecord,
        column: usize,
        message: &str,
    ) -> Error {
        let place = row.position().map_or(0, csv::Position::line);
        format_error(message)
            .with_place(format!("line {place}, column {}", self.columns[column]))
            .with_path(&self.path)
    }

    pub(super) fn number<T: FromStr>(&self, row: &csv::StringRecord, column: usize) -> Result<T> {
        (row[column].parse()).map_err(|_| {
            let message = format!("`{}` is no such number", row[column].escape_debug());
            self.cell_error(row, column, &message)
        })
    }

    pub(super) fn bits_128(&self, row: &csv::StringRecord, column: usize) -> Result<u128> {
        u128::from_str_radix(&row[column], 16)
            .map_err(|_| self.cell_error(row, column, "32 hexadecimal digits are expected"))
    }

    pub(super) fn flag(&self, row: &csv::StringRecord, column: usize) -> Result<bool> {
        (row[column].parse())
            .map_err(|_| self.cell_error(row, column, "`true` or `false` is expected"))
    }

    pub(super) fn key(&self, row: &csv::StringRecord, column: usize) -> Result<PlaceKey> {
        PlaceKey::new(&row[column])
            .map_err(|error| self.cell_error(row, column, &error.to_string()))
    }

    pub(super) fn pose(&self, row: &csv::StringRecord) -> Result<Option<[f64; 3]>> {
        if (3..6).all(|column| row[column].is_empty()) {
            return Ok(None);
        }
        Ok(Some([
            self.number(row, 3)?,
            self.number(row, 4)?,
            self.number(row, 5)?,
        ]))
    }
}

/// Whether a spreadsheet takes a cell for a formula, or for one that was guarded.
fn is_formula(cell: &str) -> bool {
    match cell.chars().next() {
        Some('=' | '@' | '\t' | '\r' | '\'') => true,
        Some('+' | '-') => cell.parse::<f64>().is_err(),
        _ => false,
    }
}

/// The cell as it is written: an apostrophe keeps a spreadsheet from computing names from outside.
fn guarded(cell: &str) -> Cow<'_, str> {
    if is_formula(cell) {
        Cow::Owned(format!("'{cell}"))
    } else {
        Cow::Borrowed(cell)
    }
}

/// The record without what [`guarded`] has added.
fn unguarded(record: csv::StringRecord) -> csv::StringRecord {
    let plain = |cell: &str| match cell.strip_prefix('\'') {
        Some(rest) if is_formula(rest) => rest.to_owned(),
        _ => cell.to_owned(),
    };
    if !record.iter().any(|cell| cell.starts_with('\'')) {
        return record;
    }
    let mut read: csv::StringRecord = record.iter().map(plain).collect();
    read.set_position(record.position().cloned());
    read
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_cell_is_a_formula_and_every_text_comes_back() {
        let cells = [
            "=HYPERLINK(\"http://example.org\")",
            "+1 place",
            "-1.5",
            "-cmd",
            "@SUM(A1)",
            "'quoted'",
            "''=1",
            "\tindented",
            "door",
            "",
        ];
        let rows = [cells.map(str::to_owned).to_vec()];
        let columns: &'static [&'static str] = &["a", "b", "c", "d", "e", "f", "g", "h", "i", "j"];
        let bytes = Table::to_csv(columns, &rows).expect("memory");
        let raw: Vec<csv::StringRecord> = (csv::Reader::from_reader(&bytes[..]).into_records())
            .map(|record| record.expect("ours"))
            .collect();
        for cell in &raw[0] {
            let is_safe = !cell.starts_with(['=', '+', '@', '\t'])
                && (cell == "-1.5" || !cell.starts_with('-'));
            assert!(is_safe, "{cell}");
        }
        let read = Table::parse(Path::new("a.csv"), &bytes, columns).expect("ours");
        assert_eq!(read.rows[0].iter().collect::<Vec<_>>(), cells);
    }
}

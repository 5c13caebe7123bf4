//! How are the tables of an exported folder read, cell by cell?

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use super::arrays::Arrays;
use super::layout::{csv_error, format_error};
use crate::map::types::{AppearanceUse, PlaceKey, SessionId, Visit, VisitId};
use fremen::error::{Error, Result};
use fremen::time::Time;

/// A CSV file with known columns.
pub(super) struct Table {
    pub(super) path: PathBuf,
    pub(super) columns: &'static [&'static str],
    pub(super) rows: Vec<csv::StringRecord>,
}

impl Table {
    pub(super) fn read(path: &Path, columns: &'static [&'static str]) -> Result<Self> {
        let file = fs::File::open(path).map_err(|cause| Error::io(path, cause))?;
        let mut reader = csv::ReaderBuilder::new()
            .buffer_capacity(1 << 16)
            .from_reader(file);
        let error = |cause: csv::Error| csv_error(path, &cause);
        if reader.headers().map_err(error)? != columns {
            return Err(
                format_error(format!("the columns {} are expected", columns.join(",")))
                    .with_place("line 1")
                    .with_path(path),
            );
        }
        let rows: csv::Result<_> = reader.records().collect();
        Ok(Self {
            path: path.to_owned(),
            columns,
            rows: rows.map_err(error)?,
        })
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

    pub(super) fn visit(&self, row: &csv::StringRecord, appearances: &mut Arrays) -> Result<Visit> {
        let appearance = if row[9].is_empty() {
            None
        } else {
            let appearance = appearances.take(self.number(row, 9)?)?.all()?;
            Some(Arc::new(appearance))
        };
        Ok(Visit {
            id: VisitId(self.bits_128(row, 1)?),
            session: SessionId(self.bits_128(row, 2)?),
            time: Time::from_us(self.number(row, 3)?),
            source: row[4].to_owned(),
            appearance,
            appearance_use: AppearanceUse::named(&row[5]).ok_or_else(|| {
                self.cell_error(row, 5, "`experience` or `recognised` is expected")
            })?,
        })
    }
}

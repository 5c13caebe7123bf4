//! Which columns have the tables, of which types?
//!
//! `docs/fleet.md` describes them for people. A file may have further columns, in any order; those of the
//! table must be there with their types, and without a null.

use std::sync::Arc;

use arrow_schema::{DataType, Field, FieldRef, Schema, TimeUnit};
use fremen::{Error, ErrorKind, Result};

/// The key of a Parquet file's metadata that says which table it is: `observations/1`.
pub(super) const TABLE_KEY: &str = "chronotope.table";
/// The key that says whose features a table of features holds.
pub(super) const EXTRACTOR_KEY: &str = "chronotope.extractor";
/// The version of all tables.
pub(super) const VERSION: &str = "1";

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Text,
    Bytes,
    Moment,
    Whole,
    Flag,
    Single,
    Double,
    Doubles,
}

/// A column by its name.
pub(super) type Column = (&'static str, Kind);

/// A table by its name.
#[derive(Debug)]
pub(super) struct TableKind {
    pub(super) name: &'static str,
    pub(super) columns: &'static [Column],
}

pub(super) const OBSERVATIONS: TableKind = TableKind {
    name: "observations",
    columns: &[
        ("place", Kind::Text),
        ("visit", Kind::Bytes),
        ("time", Kind::Moment),
        ("feature", Kind::Whole),
        ("state", Kind::Flag),
    ],
};

pub(super) const FEATURES: TableKind = TableKind {
    name: "features",
    columns: &[
        ("place", Kind::Text),
        ("feature", Kind::Whole),
        ("x", Kind::Single),
        ("y", Kind::Single),
        ("size", Kind::Single),
        ("response", Kind::Single),
        ("descriptor", Kind::Bytes),
        ("born", Kind::Bytes),
    ],
};

pub(super) const MODELS: TableKind = TableKind {
    name: "models",
    columns: &[
        ("place", Kind::Text),
        ("feature", Kind::Whole),
        ("num_observed", Kind::Whole),
        ("num_seen", Kind::Whole),
        ("mean", Kind::Double),
        ("period_s", Kind::Doubles),
        ("amplitude", Kind::Doubles),
        ("phase_rad", Kind::Doubles),
        ("sums", Kind::Bytes),
        ("model", Kind::Bytes),
    ],
};

impl TableKind {
    /// What is written.
    pub(super) fn schema(&self) -> Arc<Schema> {
        let fields = self.columns.iter().map(|&(name, kind)| {
            let data_type = match kind {
                Kind::Text => DataType::Utf8,
                Kind::Bytes => DataType::Binary,
                Kind::Moment => moment(),
                Kind::Whole => DataType::Int32,
                Kind::Flag => DataType::Boolean,
                Kind::Single => DataType::Float32,
                Kind::Double => DataType::Float64,
                Kind::Doubles => DataType::List(element()),
            };
            Field::new(name, data_type, false)
        });
        Arc::new(Schema::new(fields.collect::<Vec<_>>()))
    }

    /// The version and name in a file's metadata.
    pub(super) fn mark(&self) -> String {
        format!("{}/{VERSION}", self.name)
    }

    /// Fails if a file's metadata names another table or version.
    pub(super) fn check_mark(&self, mark: &str) -> Result<()> {
        if mark == self.mark() {
            return Ok(());
        }
        let message = format!(
            "this is a table `{}`, where `{}` is expected",
            mark.escape_debug(),
            self.mark()
        );
        let help = match mark.split_once('/') {
            Some((name, _)) if name == self.name => "use a newer chronotope",
            _ => "give a file of that table",
        };
        Err(Error::new(ErrorKind::Format, message).with_help(help))
    }
}

/// What the elements of lists are.
pub(super) fn element() -> FieldRef {
    Arc::new(Field::new("element", DataType::Float64, false))
}

fn moment() -> DataType {
    DataType::Timestamp(TimeUnit::Microsecond, Some("UTC".into()))
}

impl Kind {
    /// How a column of a file is read; `None` if it is of another kind.
    pub(super) fn read_as(self, found: &DataType) -> Option<DataType> {
        let dictionary =
            |of: DataType| DataType::Dictionary(Box::new(DataType::Int32), Box::new(of));
        let as_found = match (self, found) {
            (Self::Text, DataType::Utf8) => return Some(dictionary(DataType::Utf8)),
            (Self::Bytes, DataType::Binary) => return Some(dictionary(DataType::Binary)),
            (Self::Bytes, DataType::FixedSizeBinary(_))
            | (Self::Whole, DataType::Int32)
            | (Self::Flag, DataType::Boolean)
            | (Self::Single, DataType::Float32)
            | (Self::Double, DataType::Float64) => true,
            (Self::Moment, DataType::Timestamp(TimeUnit::Microsecond, Some(zone))) => {
                &**zone == "UTC" || &**zone == "+00:00"
            }
            (Self::Doubles, DataType::List(of)) => *of.data_type() == DataType::Float64,
            _ => false,
        };
        as_found.then(|| found.clone())
    }

    /// Of which type it must be, in Parquet's words.
    fn in_words(self) -> &'static str {
        match self {
            Self::Text => "BYTE_ARRAY (STRING)",
            Self::Bytes => "BYTE_ARRAY",
            Self::Moment => "INT64 (TIMESTAMP, microseconds, adjusted to UTC)",
            Self::Whole => "INT32",
            Self::Flag => "BOOLEAN",
            Self::Single => "FLOAT",
            Self::Double => "DOUBLE",
            Self::Doubles => "a list of DOUBLE",
        }
    }

    /// How a column of another type becomes one of this.
    fn remedy(self, found: &DataType) -> &'static str {
        match (self, found) {
            (Self::Moment, DataType::Timestamp(TimeUnit::Nanosecond, None)) => {
                "write microseconds: in Spark set spark.sql.parquet.outputTimestampType to TIMESTAMP_MICROS"
            }
            (Self::Moment, DataType::Timestamp(_, None)) => {
                "a local time says no moment: convert it to UTC by the zone of the clock that showed it"
            }
            (Self::Moment, DataType::Timestamp(..)) => {
                "write microseconds: pyarrow's write_table has coerce_timestamps=\"us\""
            }
            (Self::Moment, _) => {
                "a bare number has no unit and no zone: make it a timestamp of UTC"
            }
            (Self::Flag, _) => {
                "say true for seen, false for not seen, and leave out what could not be seen"
            }
            _ => "cast the column and write the file again",
        }
    }

    /// The error for a column that is of another type.
    pub(super) fn refused(self, name: &str, found: &DataType) -> Error {
        let found_as = match found {
            DataType::Timestamp(TimeUnit::Nanosecond, None) => {
                "a timestamp in nanoseconds (or INT96) without a zone".to_owned()
            }
            DataType::Timestamp(unit, None) => format!("a timestamp in {unit:?}s without a zone"),
            DataType::Timestamp(unit, Some(zone)) => {
                format!("a timestamp in {unit:?}s of zone {zone}")
            }
            other => other.to_string(),
        };
        let message = format!("it must be {}, and is {found_as}", self.in_words());
        Error::new(ErrorKind::Format, message)
            .with_place(format!("all row groups, column `{name}`"))
            .with_help(self.remedy(found))
    }
}

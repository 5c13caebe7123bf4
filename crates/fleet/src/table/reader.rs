//! How are the row groups of a Parquet file read, so that whatever does not fit is named?
//!
//! A file is checked before its first row is read: that it is the table, has the columns, and has them of
//! the right types. Each row group is read by itself, by whoever has time; text and identities stay as
//! numbers into a dictionary, so that rows that say the same are found without looking at it.
//!
//! The crate `parquet` panics on some files that are damaged: where it is called, that is an error, too.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{ArrowPrimitiveType, Int32Type};
use arrow_array::{Array, ArrayRef, BinaryArray, FixedSizeBinaryArray, RecordBatch, StringArray};
use arrow_schema::{DataType, Field, Schema};
use fremen::error::catching;
use fremen::{Error, ErrorKind, Result};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader,
    ParquetRecordBatchReaderBuilder,
};
use parquet::errors::ParquetError;

use super::columns::{Column, TABLE_KEY, TableKind};

/// Rows that are decoded at once: what fits into the cache.
const BATCH: usize = 16_384;

/// A Parquet file that holds a table.
pub(super) struct TableFile {
    path: PathBuf,
    columns: Vec<Column>,
    /// Where each column is in the file.
    roots: Vec<usize>,
    metadata: ArrowReaderMetadata,
}

impl TableFile {
    /// Opens a file to read some columns of `kind`, by their names.
    pub(super) fn open(path: &Path, kind: &TableKind, names: &[&str]) -> Result<Self> {
        let panicked = |text: &str| damaged(text).with_place("footer");
        catching(|| Self::check(path, kind, names), panicked).map_err(|error| error.with_path(path))
    }

    fn check(path: &Path, kind: &TableKind, names: &[&str]) -> Result<Self> {
        let failed = |cause| parquet_error(cause).with_place("footer");
        let file = fremen::file::open(path)?;
        // What Parquet says counts, not what a writer's Arrow had in memory.
        let plain = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
        let found = ArrowReaderMetadata::load(&file, plain).map_err(failed)?;
        if let Some(mark) = value_of(&found, TABLE_KEY) {
            kind.check_mark(mark)
                .map_err(|error| error.with_place(format!("footer, key `{TABLE_KEY}`")))?;
        }
        let mut fields: Vec<Arc<Field>> = found.schema().fields().iter().cloned().collect();
        let columns = kind.columns.iter().filter(|(name, _)| names.contains(name));
        let columns: Vec<Column> = columns.copied().collect();
        let mut roots = Vec::new();
        for &(name, of) in &columns {
            let mut at = (0..fields.len()).filter(|&at| fields[at].name() == name);
            let (Some(root), None) = (at.next(), at.next()) else {
                return Err(missing(kind, name, found.schema()));
            };
            let field = &fields[root];
            let read_as = (of.read_as(field.data_type()))
                .ok_or_else(|| of.refused(name, field.data_type()))?;
            fields[root] = Arc::new(Field::clone(field).with_data_type(read_as));
            roots.push(root);
        }
        let options = ArrowReaderOptions::new().with_schema(Arc::new(Schema::new(fields)));
        let metadata = ArrowReaderMetadata::try_new(found.metadata().clone(), options);
        Ok(Self {
            path: path.to_owned(),
            columns,
            roots,
            metadata: metadata.map_err(failed)?,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// What the file's metadata says under a key.
    pub(super) fn metadata_of(&self, key: &str) -> Option<&str> {
        value_of(&self.metadata, key)
    }

    pub(super) fn num_row_groups(&self) -> usize {
        self.metadata.metadata().num_row_groups()
    }

    /// The rows of one row group, some at a time.
    pub(super) fn rows(&self, row_group: usize) -> Result<Rows<'_>> {
        // A file of its own: a shared one has one position for all threads.
        let file = fremen::file::open(&self.path)?;
        let build = || {
            let builder =
                ParquetRecordBatchReaderBuilder::new_with_metadata(file, self.metadata.clone());
            let mask = ProjectionMask::roots(builder.parquet_schema(), self.roots.iter().copied());
            builder
                .with_row_groups(vec![row_group])
                .with_projection(mask)
                .with_batch_size(BATCH)
                .build()
                .map_err(parquet_error)
        };
        // A projection keeps the order of the file.
        let order = self.roots.iter().map(|root| {
            let before = self.roots.iter().filter(|other| *other < root);
            before.count()
        });
        Ok(Rows {
            table: self,
            row_group,
            order: order.collect(),
            first_row: 0,
            reader: self.decoded(row_group, build)?,
        })
    }

    /// What the crate `parquet` makes of a row group.
    fn decoded<T>(&self, row_group: usize, work: impl FnOnce() -> Result<T>) -> Result<T> {
        catching(work, damaged).map_err(|error| {
            error
                .with_path(&self.path)
                .with_place(format!("row group {row_group}"))
        })
    }
}

/// What metadata says under a key; a key without a value says nothing.
fn value_of<'a>(metadata: &'a ArrowReaderMetadata, key: &str) -> Option<&'a str> {
    let all = metadata.metadata().file_metadata().key_value_metadata();
    let found = all.into_iter().flatten().find(|it| it.key == key)?;
    Some(found.value.as_deref().unwrap_or_default())
}

fn missing(kind: &TableKind, name: &str, found: &Schema) -> Error {
    let names: Vec<&str> = found.fields().iter().map(|it| it.name().as_str()).collect();
    let expected: Vec<&str> = kind.columns.iter().map(|(name, _)| *name).collect();
    let message = format!(
        "the file has not one column of this name, but {}",
        names.join(", ").escape_debug()
    );
    Error::new(ErrorKind::Format, message)
        .with_place(format!("all row groups, column `{name}`"))
        .with_help(format!(
            "a table of {} has the columns {}",
            kind.name,
            expected.join(", ")
        ))
}

/// The error for a file that makes `parquet` panic.
fn damaged(text: &str) -> Error {
    Error::new(ErrorKind::Format, format!("it cannot be read: {text}"))
        .with_help("the file is damaged: write it again")
}

fn parquet_error(cause: ParquetError) -> Error {
    let text = cause.to_string();
    let help = if text.contains("feature") && text.contains("disabled") || text.contains("codec") {
        "write the file with the codec snappy, or uncompressed"
    } else {
        "the file is damaged or no Parquet: write it again"
    };
    Error::new(ErrorKind::Format, text)
        .with_help(help)
        .with_source(cause)
}

/// The rows of one row group.
pub(super) struct Rows<'a> {
    table: &'a TableFile,
    row_group: usize,
    /// For each column of the table, which column of a batch it is.
    order: Vec<usize>,
    first_row: usize,
    reader: ParquetRecordBatchReader,
}

impl<'a> Rows<'a> {
    /// The next rows, none of which has a null in any column; `None` at the end.
    pub(super) fn next(&mut self) -> Result<Option<Batch<'a>>> {
        let next = || {
            let batch = self.reader.next().transpose();
            batch.map_err(|cause| parquet_error(cause.into()))
        };
        let Some(batch) = self
            .table
            .decoded::<Option<RecordBatch>>(self.row_group, next)?
        else {
            return Ok(None);
        };
        let columns = self.order.iter().map(|&at| Arc::clone(batch.column(at)));
        let batch = Batch {
            table: self.table,
            row_group: self.row_group,
            first_row: self.first_row,
            columns: columns.collect(),
        };
        self.first_row += batch.num_rows();
        batch.check_nulls()?;
        Ok(Some(batch))
    }
}

/// Some rows of a row group, with the columns in the order of the table.
pub(super) struct Batch<'a> {
    table: &'a TableFile,
    row_group: usize,
    first_row: usize,
    columns: Vec<ArrayRef>,
}

impl Batch<'_> {
    pub(super) fn num_rows(&self) -> usize {
        self.columns.first().map_or(0, Array::len)
    }

    fn check_nulls(&self) -> Result<()> {
        for (column, array) in self.columns.iter().enumerate() {
            if array.null_count() > 0 {
                let row = (0..array.len()).find(|&row| array.is_null(row));
                return Err(self
                    .error(column, row.unwrap_or_default(), "it is null")
                    .with_help("leave out rows of which something is not known"));
            }
        }
        Ok(())
    }

    /// The error for what is in a row of a column.
    pub(super) fn error(&self, column: usize, row: usize, message: impl Into<String>) -> Error {
        self.located(column, row, Error::new(ErrorKind::Format, message))
    }

    /// The error, with the row of the column that it is about.
    pub(super) fn located(&self, column: usize, row: usize, error: Error) -> Error {
        let place = format!(
            "row group {}, column `{}`, row {}",
            self.row_group,
            self.table.columns[column].0,
            self.first_row + row
        );
        error.with_path(&self.table.path).with_place(place)
    }

    /// The numbers of a column.
    pub(super) fn numbers<T: ArrowPrimitiveType>(&self, column: usize) -> &[T::Native] {
        self.columns[column].as_primitive::<T>().values()
    }

    /// The numbers of a column, which are 0 or more.
    pub(super) fn naturals(&self, column: usize) -> Result<&[i32]> {
        let numbers = self.numbers::<Int32Type>(column);
        // One pass without a branch, because nearly always none is.
        if numbers.iter().fold(0, |all, number| all | number) >= 0 {
            return Ok(numbers);
        }
        let row = numbers
            .iter()
            .position(|number| *number < 0)
            .unwrap_or_default();
        let message = format!("{} is negative", numbers[row]);
        Err(self.error(column, row, message).with_help("count from 0"))
    }

    /// The flags of a column.
    pub(super) fn flags(&self, column: usize) -> Vec<bool> {
        self.columns[column].as_boolean().values().iter().collect()
    }

    /// The texts of a column: for each row its number in the texts.
    pub(super) fn texts(&self, column: usize) -> Result<(&[i32], &StringArray)> {
        let found = self.columns[column].as_dictionary_opt::<Int32Type>();
        let texts = found.and_then(|it| Some((it.keys().values(), it.values().as_string_opt()?)));
        let (keys, texts) = texts.ok_or_else(|| self.error(column, 0, "it is no text"))?;
        let empty = (0..texts.len()).find(|&key| texts.value(key).is_empty());
        let empty = empty.and_then(|empty| keys.iter().position(|&key| key as usize == empty));
        if let Some(row) = empty {
            return Err(self
                .error(column, row, "it is empty")
                .with_help("every place has a name"));
        }
        Ok((&keys[..], texts))
    }

    /// The bytes of a column, by row.
    pub(super) fn bytes(&self, column: usize) -> Result<ByteColumn<'_>> {
        let array = &self.columns[column];
        let found = match array.data_type() {
            DataType::FixedSizeBinary(_) => array.as_fixed_size_binary_opt().map(ByteColumn::Fixed),
            _ => array.as_dictionary_opt::<Int32Type>().and_then(|it| {
                Some(ByteColumn::Keyed(
                    it.keys().values(),
                    it.values().as_binary_opt()?,
                ))
            }),
        };
        found.ok_or_else(|| self.error(column, 0, "it is no bytes"))
    }

    /// The identities of a column, of 16 bytes each: for each row its number in the identities.
    pub(super) fn identities(&self, column: usize) -> Result<(Vec<i32>, Vec<u128>)> {
        let parse = |row: usize, bytes: &[u8]| {
            let bytes: [u8; 16] = bytes.try_into().map_err(|_| {
                let message = format!("an identity has 16 bytes, not {}", bytes.len());
                (self.error(column, row, message)).with_help("write the 128 bits, not their digits")
            })?;
            Ok(u128::from_be_bytes(bytes))
        };
        match self.bytes(column)? {
            ByteColumn::Keyed(keys, values) => {
                let first_row = |key: usize| keys.iter().position(|&it| it as usize == key);
                let ids = (0..values.len()).map(|key| {
                    // What no row has may be anything; so it is looked for only then.
                    parse(0, values.value(key)).or_else(|_| match first_row(key) {
                        Some(row) => parse(row, values.value(key)),
                        None => Ok(0),
                    })
                });
                Ok((keys.to_vec(), ids.collect::<Result<_>>()?))
            }
            fixed @ ByteColumn::Fixed(..) => {
                let (mut keys, mut ids) = (Vec::new(), Vec::<u128>::new());
                for row in 0..self.num_rows() {
                    let id = parse(row, fixed.get(row))?;
                    if ids.last() != Some(&id) {
                        ids.push(id);
                    }
                    keys.push(ids.len() as i32 - 1);
                }
                Ok((keys, ids))
            }
        }
    }

    /// An error unless all numbers of a column are finite.
    pub(super) fn check_finite(
        &self,
        column: usize,
        numbers: impl Iterator<Item = f64>,
    ) -> Result<()> {
        for (row, number) in numbers.enumerate() {
            if !number.is_finite() {
                return Err(self
                    .error(column, row, format!("{number} is no finite number"))
                    .with_help("leave out rows of which something is not known"));
            }
        }
        Ok(())
    }
}

/// A column of bytes.
pub(super) enum ByteColumn<'a> {
    Keyed(&'a [i32], &'a BinaryArray),
    Fixed(&'a FixedSizeBinaryArray),
}

impl ByteColumn<'_> {
    pub(super) fn get(&self, row: usize) -> &[u8] {
        match self {
            Self::Keyed(keys, values) => values.value(keys[row] as usize),
            Self::Fixed(values) => values.value(row),
        }
    }
}

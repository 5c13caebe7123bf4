//! How is a table written as one Parquet file?
//!
//! Snappy, which every reader has; dictionaries for what repeats, differences for what counts up. Row
//! groups of at most a million rows, and of less where a place ends.

use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, RecordBatch};
use fremen::file::OutputFile;
use fremen::{Error, ErrorKind, Result};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;

use super::columns::{Kind, TABLE_KEY, TableKind};

/// Rows of a row group, at most.
const MAX_ROWS: usize = 1 << 20;
/// A row group of so many rows ends where a place ends.
const MIN_ROWS: usize = 1 << 17;
/// Bytes of the dictionary of a column, at most; beyond it, values are written as they are.
const DICTIONARY_BYTES: usize = 1 << 22;

/// A Parquet file that is being written. Dropped before it is finished, it leaves nothing behind.
pub(super) struct TableWriter {
    path: std::path::PathBuf,
    kind: &'static TableKind,
    writer: ArrowWriter<OutputFile>,
}

impl TableWriter {
    /// Begins a file at a path where nothing is yet.
    pub(super) fn begin(path: &Path, kind: &'static TableKind) -> Result<Self> {
        Self::begin_with(path, kind, Vec::new())
    }

    /// [`begin`](Self::begin), with more metadata than which table it is.
    pub(super) fn begin_with(
        path: &Path,
        kind: &'static TableKind,
        mut metadata: Vec<KeyValue>,
    ) -> Result<Self> {
        let file = OutputFile::begin_new(path)?;
        metadata.push(KeyValue::new(TABLE_KEY.to_owned(), kind.mark()));
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_max_row_group_row_count(Some(MAX_ROWS))
            .set_dictionary_page_size_limit(DICTIONARY_BYTES)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_created_by(concat!("chronotope ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_key_value_metadata(Some(metadata));
        for &(name, of) in kind.columns {
            let path = ColumnPath::new(vec![name.to_owned()]);
            let repeats = matches!(
                (name, of),
                ("place" | "visit" | "born", _) | (_, Kind::Moment)
            );
            properties = properties.set_column_dictionary_enabled(path.clone(), repeats);
            if of == Kind::Whole {
                properties = properties.set_column_encoding(path, Encoding::DELTA_BINARY_PACKED);
            }
        }
        let writer = ArrowWriter::try_new(file, kind.schema(), Some(properties.build()));
        Ok(Self {
            path: path.to_owned(),
            kind,
            writer: writer.map_err(|cause| failed(path, cause))?,
        })
    }

    /// Writes some rows; `ends_place` if the next ones are of another place.
    pub(super) fn write(&mut self, columns: Vec<ArrayRef>, ends_place: bool) -> Result<()> {
        let batch = RecordBatch::try_new(self.kind.schema(), columns)
            .map_err(|cause| failed(&self.path, cause.into()))?;
        let mut written = self.writer.write(&batch);
        if written.is_ok() && ends_place && self.writer.in_progress_rows() >= MIN_ROWS {
            written = self.writer.flush();
        }
        written.map_err(|cause| failed(&self.path, cause))
    }

    /// Everything is on the disk and has its name once this returns.
    pub(super) fn finish(self) -> Result<()> {
        let file = self.writer.into_inner();
        file.map_err(|cause| failed(&self.path, cause))?.finish()
    }
}

fn failed(path: &Path, cause: ParquetError) -> Error {
    match cause {
        ParquetError::External(cause) => match cause.downcast::<std::io::Error>() {
            Ok(cause) => Error::io(path, *cause),
            Err(cause) => Error::new(ErrorKind::Format, cause.to_string()).with_path(path),
        },
        other => Error::new(ErrorKind::Format, other.to_string()).with_path(path),
    }
}

/// A column for [`TableWriter::write`].
pub(super) fn column(array: impl arrow_array::Array + 'static) -> ArrayRef {
    Arc::new(array)
}

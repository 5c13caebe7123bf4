//! How are the features of places kept: where in the image, and how do they look?

use std::path::{Path, PathBuf};

use arrow_array::types::Float32Type;
use arrow_array::{BinaryArray, Float32Array, Int32Array, StringArray};
use fremen::{Error, ErrorKind, Result};
use parquet::file::metadata::KeyValue;

use super::columns::{EXTRACTOR_KEY, FEATURES};
use super::reader::TableFile;
use super::writer::{TableWriter, column};

/// One feature of a place.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureRow {
    /// The place's key.
    pub place: String,
    /// Its number in the place.
    pub feature: u32,
    /// Where it is in the image of the visit that it was born at, px.
    pub x: f32,
    /// The same, downwards.
    pub y: f32,
    /// Diameter of its neighbourhood, px.
    pub size: f32,
    /// Strength, in the detector's unit.
    pub response: f32,
    /// 256 bits, bit 0 the highest of the first byte.
    pub descriptor: [u8; 32],
    /// The visit that it was first seen at.
    pub born: u128,
}

/// A table of features that is being written; dropped before it is finished, it leaves nothing behind.
pub struct FeatureWriter(TableWriter);

impl FeatureWriter {
    /// Begins a file at a path where nothing is yet, for features of the extractor of this identity.
    pub fn begin(path: impl AsRef<Path>, extractor: &str) -> Result<Self> {
        let extractor = KeyValue::new(EXTRACTOR_KEY.to_owned(), extractor.to_owned());
        let writer = TableWriter::begin_with(path.as_ref(), &FEATURES, vec![extractor])?;
        Ok(Self(writer))
    }

    /// Writes the features of one place.
    pub fn write(&mut self, rows: &[FeatureRow]) -> Result<()> {
        let single = |number: fn(&FeatureRow) -> f32| {
            column(Float32Array::from_iter_values(rows.iter().map(number)))
        };
        let features = rows.iter().map(|row| row.feature.cast_signed());
        let columns = vec![
            column(
                rows.iter()
                    .map(|row| Some(&row.place))
                    .collect::<StringArray>(),
            ),
            column(Int32Array::from_iter_values(features)),
            single(|row| row.x),
            single(|row| row.y),
            single(|row| row.size),
            single(|row| row.response),
            column(
                rows.iter()
                    .map(|row| Some(row.descriptor))
                    .collect::<BinaryArray>(),
            ),
            column(
                rows.iter()
                    .map(|row| Some(row.born.to_be_bytes()))
                    .collect::<BinaryArray>(),
            ),
        ];
        self.0.write(columns, true)
    }

    /// Everything is on the disk and has its name once this returns.
    pub fn finish(self) -> Result<()> {
        self.0.finish()
    }
}

/// Whose features the files hold: the identity of their extractor, if they say it.
///
/// Fails with [`ErrorKind::Format`] if a file is no table of features, or two files name different extractors.
pub fn read_extractor(files: &[PathBuf]) -> Result<Option<String>> {
    let mut known: Option<String> = None;
    for path in files {
        let table = TableFile::open(path, &FEATURES, &["place"])?;
        let found = table.metadata_of(EXTRACTOR_KEY);
        match (&known, found) {
            (Some(known), Some(found)) if known != found => {
                let message = format!("its features are of `{found}`, those before of `{known}`");
                return Err(Error::new(ErrorKind::Format, message)
                    .with_path(path)
                    .with_place(format!("footer, key `{EXTRACTOR_KEY}`"))
                    .with_help("features of one extractor alone can be compared"));
            }
            (None, Some(found)) => known = Some(found.to_owned()),
            _ => {}
        }
    }
    Ok(known)
}

/// Reads the features of files, in the order in which they lie there.
///
/// Fails with [`ErrorKind::Format`], naming file, row group and column.
pub fn read_features(files: &[PathBuf]) -> Result<Vec<FeatureRow>> {
    let names = FEATURES.columns.iter().map(|(name, _)| *name);
    let names: Vec<&str> = names.collect();
    let mut all = Vec::new();
    for path in files {
        let table = TableFile::open(path, &FEATURES, &names)?;
        for group in 0..table.num_row_groups() {
            let mut rows = table.rows(group)?;
            while let Some(batch) = rows.next()? {
                let (keys, places) = batch.texts(0)?;
                let features = batch.naturals(1)?;
                let singles = [2, 3, 4, 5].map(|column| batch.numbers::<Float32Type>(column));
                for (at, numbers) in singles.iter().enumerate() {
                    batch.check_finite(2 + at, numbers.iter().map(|&it| it.into()))?;
                }
                let descriptors = batch.bytes(6)?;
                let (born_keys, born) = batch.identities(7)?;
                for row in 0..batch.num_rows() {
                    let descriptor = descriptors.get(row);
                    let descriptor = descriptor.try_into().map_err(|_| {
                        let message =
                            format!("a descriptor has 32 bytes, not {}", descriptor.len());
                        batch.error(6, row, message).with_help("write its 256 bits")
                    })?;
                    all.push(FeatureRow {
                        place: places.value(keys[row] as usize).to_owned(),
                        feature: features[row].cast_unsigned(),
                        x: singles[0][row],
                        y: singles[1][row],
                        size: singles[2][row],
                        response: singles[3][row],
                        descriptor,
                        born: born[born_keys[row] as usize],
                    });
                }
            }
        }
    }
    Ok(all)
}

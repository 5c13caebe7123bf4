//! How are models kept, so that a robot starts with them and a cluster merges more into them?
//!
//! One row for each feature of each place: for people and queries the mean and the rhythms, for programs
//! the sums and the model as bytes, each with its checksum.

use std::path::{Path, PathBuf};

use arrow_array::builder::{Float64Builder, ListBuilder};
use arrow_array::types::Float64Type;
use arrow_array::{BinaryArray, Float64Array, Int32Array, StringArray};
use fremen::spectrum::SpectralSums;
use fremen::{Error, Result, SeriesModel};

use super::columns::{MODELS, element};
use super::reader::TableFile;
use super::writer::{TableWriter, column};
use crate::model::FeatureModel;

/// Rows that are written at once.
const BATCH: usize = 1 << 14;

/// A table of models that is being written; dropped before it is finished, it leaves nothing behind.
pub struct ModelWriter(TableWriter);

impl ModelWriter {
    /// Begins a file at a path where nothing is yet.
    pub fn begin(path: impl AsRef<Path>) -> Result<Self> {
        Ok(Self(TableWriter::begin(path.as_ref(), &MODELS)?))
    }

    /// Writes models in this order.
    pub fn write(&mut self, models: &[FeatureModel]) -> Result<()> {
        for rows in models.chunk_by(|a, b| a.place == b.place) {
            for part in rows.chunks(BATCH) {
                self.write_part(part)?;
            }
        }
        Ok(())
    }

    fn write_part(&mut self, models: &[FeatureModel]) -> Result<()> {
        let list = || ListBuilder::new(Float64Builder::new()).with_field(element());
        let [mut periods, mut amplitudes, mut phases] = [list(), list(), list()];
        for it in models {
            for component in it.decode()?.components() {
                periods.values().append_value(component.period_s);
                amplitudes.values().append_value(component.amplitude);
                phases.values().append_value(component.phase_rad);
            }
            periods.append(true);
            amplitudes.append(true);
            phases.append(true);
        }
        let whole = |number: fn(&FeatureModel) -> usize| {
            // No sum has more than 2^23 - 1 observations.
            let numbers = models.iter().map(|it| number(it) as i32);
            column(Int32Array::from_iter_values(numbers))
        };
        let sums = models.iter().map(|it| Some(it.sums.to_bytes()));
        let columns = vec![
            column(
                models
                    .iter()
                    .map(|it| Some(&it.place))
                    .collect::<StringArray>(),
            ),
            whole(|it| it.feature as usize),
            whole(|it| it.sums.num_observed()),
            whole(|it| it.sums.num_seen()),
            column(Float64Array::from_iter_values(
                models.iter().map(|it| it.sums.mean()),
            )),
            column(periods.finish()),
            column(amplitudes.finish()),
            column(phases.finish()),
            column(sums.collect::<BinaryArray>()),
            column(
                models
                    .iter()
                    .map(|it| Some(&it.model))
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

/// Reads the models of files, in the order in which they lie there.
///
/// Fails with [`ErrorKind::Format`](fremen::ErrorKind::Format),
/// [`ErrorKind::Checksum`](fremen::ErrorKind::Checksum) or, for a model of several states,
/// [`ErrorKind::Shape`](fremen::ErrorKind::Shape), naming file, row group and column.
pub fn read_models(files: &[PathBuf]) -> Result<Vec<FeatureModel>> {
    let names = ["place", "feature", "mean", "sums", "model"];
    let mut models = Vec::new();
    for path in files {
        let table = TableFile::open(path, &MODELS, &names)?;
        for group in 0..table.num_row_groups() {
            let mut rows = table.rows(group)?;
            while let Some(batch) = rows.next()? {
                let (keys, places) = batch.texts(0)?;
                let features = batch.naturals(1)?;
                batch.check_finite(2, batch.numbers::<Float64Type>(2).iter().copied())?;
                let (sums, model) = (batch.bytes(3)?, batch.bytes(4)?);
                for row in 0..batch.num_rows() {
                    let refused = |column, cause: Error| {
                        // A place that it names is one in these bytes.
                        let error = Error::new(cause.kind(), cause.message()).with_source(cause);
                        let error = batch.located(column, row, error);
                        error.with_help("learn the models again")
                    };
                    let sums = SpectralSums::from_bytes(sums.get(row));
                    let model = model.get(row).to_vec();
                    SeriesModel::decode(&model).map_err(|error| refused(4, error))?;
                    models.push(FeatureModel {
                        place: places.value(keys[row] as usize).to_owned(),
                        feature: features[row].cast_unsigned(),
                        sums: sums.map_err(|error| refused(3, error))?,
                        model,
                    });
                }
            }
        }
    }
    Ok(models)
}

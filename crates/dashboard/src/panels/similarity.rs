//! How much of what was predicted was found, at each place and each of the latest queries?

use std::collections::VecDeque;

use anyhow::Result;
use chronotope::trace::Trace;
use rerun::{RecordingStream, Tensor, TensorBuffer, TensorData};

use crate::entities;

/// Columns of the similarity matrix.
pub const SIMILARITY_QUERIES: usize = 120;
/// Rows of the similarity matrix; more places share a row, which shows the highest.
pub const SIMILARITY_ROWS: usize = 64;

/// The similarity of the latest [`SIMILARITY_QUERIES`] queries.
#[derive(Default)]
pub(crate) struct Similarity {
    /// Percent of predicted features found, by node; the latest query last.
    columns: VecDeque<Vec<u8>>,
}

impl Similarity {
    /// Keeps that of one more query.
    pub(crate) fn remember(&mut self, trace: &Trace<'_>) {
        let mut column = vec![0; trace.places.len()];
        for (rank, candidate) in trace.localization.ranking.iter().enumerate() {
            let predicted = trace.predicted.get(rank).map_or(0, Vec::len);
            let num = predicted.max(candidate.predicted.len()).max(1) as f64;
            if let Some(cell) = column.get_mut(candidate.node.0 as usize) {
                *cell = (100.0 * f64::from(candidate.num_inliers) / num).min(100.0) as u8;
            }
        }
        if self.columns.len() == SIMILARITY_QUERIES {
            self.columns.pop_front();
        }
        self.columns.push_back(column);
    }

    /// The matrix, place x query.
    pub(crate) fn log(&self, stream: &RecordingStream) -> Result<()> {
        let num_places = self.columns.back().map_or(0, Vec::len);
        if num_places == 0 {
            return Ok(());
        }
        let share = num_places.div_ceil(SIMILARITY_ROWS);
        let num_rows = num_places.div_ceil(share);
        let cells: Vec<u8> = (0..num_rows)
            .flat_map(|row| {
                self.columns.iter().map(move |column| {
                    let places = (row * share)..((row + 1) * share);
                    (places.filter_map(|place| column.get(place)).max()).map_or(0, |&cell| cell)
                })
            })
            .collect();
        let data = TensorData::new(
            vec![num_rows as u64, self.columns.len() as u64],
            TensorBuffer::U8(cells.into()),
        );
        let tensor = Tensor::new(data).with_dim_names(["place", "query"]);
        stream.log(entities::SIMILARITY, &tensor.with_value_range([0.0, 100.0]))?;
        Ok(())
    }

    /// How many queries are remembered.
    #[cfg(test)]
    pub(crate) fn num_queries(&self) -> usize {
        self.columns.len()
    }
}

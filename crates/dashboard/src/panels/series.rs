//! How do values become lines over the timeline?

use anyhow::Result;
use rerun::{RecordingStream, Scalars, SeriesLines};

use crate::colours;

/// Several lines of one plot.
pub(crate) struct Series {
    entity: &'static str,
    /// The names that were logged last.
    names: Vec<String>,
}

impl Series {
    /// Lines without names and points.
    pub(crate) fn new(entity: &'static str) -> Self {
        Self {
            entity,
            names: Vec::new(),
        }
    }

    /// One more point of each line; names and colours are logged where they change.
    pub(crate) fn log(
        &mut self,
        stream: &RecordingStream,
        names: &[&str],
        values: &[f64],
    ) -> Result<()> {
        if self.names != names {
            self.names = names.iter().map(|&name| name.to_owned()).collect();
            stream.log_static(
                self.entity,
                &SeriesLines::new()
                    .with_names(names.iter().copied())
                    .with_colors((0..names.len()).map(colours::series))
                    .with_widths(vec![1.5; names.len()]),
            )?;
        }
        Ok(stream.log(self.entity, &Scalars::new(values.iter().copied()))?)
    }
}

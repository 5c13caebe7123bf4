//! How long did each stage of a localisation take?

use anyhow::Result;
use chronotope::trace::Trace;
use rerun::RecordingStream;

use super::series::Series;

/// The stages of a localisation, and their sum.
pub(crate) fn stage_names<'t>(trace: &'t Trace<'_>) -> Vec<&'t str> {
    (trace.stages.iter().map(|stage| stage.name.as_ref()))
        .chain(["total"])
        .collect()
}

/// One more point of each stage.
pub(crate) fn log(stream: &RecordingStream, series: &mut Series, trace: &Trace<'_>) -> Result<()> {
    let stages = trace.stages.iter().map(|stage| stage.ms);
    let values: Vec<f64> = stages.chain([trace.duration_ms]).collect();
    series.log(stream, &stage_names(trace), &values)
}

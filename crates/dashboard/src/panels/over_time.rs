//! How did the posterior go over the latest queries?

use anyhow::Result;
use chronotope::trace::Trace;
use rerun::RecordingStream;

use super::lookup::{OFF_MAP, names};
use super::series::Series;

/// Of maps of more places only the best place and being off the map are followed.
pub(crate) const MAX_FOLLOWED: usize = 8;

/// One more point of each line, in percent.
pub(crate) fn log(
    stream: &RecordingStream,
    series: &mut Series,
    trace: &Trace<'_>,
    posterior: &[f64],
) -> Result<()> {
    let answer = &trace.localization;
    if trace.places.len() <= MAX_FOLLOWED {
        let mut names = names(trace);
        names.push(OFF_MAP);
        let shares = posterior.iter().chain([&answer.off_map]);
        let percent: Vec<f64> = shares.map(|share| 100.0 * share).collect();
        return series.log(stream, &names, &percent);
    }
    let best = answer.first().map_or(0.0, |best| best.posterior);
    let percent = [100.0 * best, 100.0 * answer.off_map];
    series.log(stream, &["the best place", OFF_MAP], &percent)
}

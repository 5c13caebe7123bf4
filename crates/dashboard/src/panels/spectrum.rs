//! Which rhythms does the history of a feature have?

use anyhow::Result;
use chronotope::trace::CurveSummary;
use rerun::{BarChart, Color, RecordingStream};

use crate::{colours, entities};

/// Amplitudes and sampling window of a history.
pub(crate) fn log(stream: &RecordingStream, curve: &CurveSummary) -> Result<()> {
    let spectrum = &curve.spectrum;
    // Side by side: each takes nearly half of the step between two frequencies.
    let step = match spectrum.frequencies.as_slice() {
        [first, second, ..] => second - first,
        _ => 1.0,
    };
    let bars = |values: &[f64], colour: Color, side: f64| {
        let at = (spectrum.frequencies.iter()).map(|frequency| frequency + 0.22 * side * step);
        BarChart::new(values.to_vec())
            .with_abscissa(at.collect::<Vec<f64>>())
            .with_widths(vec![0.4 * step as f32; values.len()])
            .with_color(colour)
    };
    let window = bars(&spectrum.window, colours::rgb(colours::QUIET), 1.0);
    stream.log(entities::SPECTRUM_WINDOW, &window)?;
    let amplitudes = bars(&spectrum.amplitudes, colours::series(0), -1.0);
    stream.log(entities::SPECTRUM_AMPLITUDE, &amplitudes)?;
    Ok(())
}

//! What should the best places look like now?

use anyhow::Result;
use chronotope::localize::Candidate;
use chronotope::trace::{Trace, TracePoint};
use rerun::{Boxes2D, Points2D, Radius, RecordingStream};

use super::lookup::{displacement, found, moved, place};
use crate::{colours, entities};

/// Best places whose predicted maps are drawn.
pub(crate) const NUM_PREDICTED: usize = 3;

/// The predicted maps of the best places, each in its frame.
pub(crate) fn log(stream: &RecordingStream, trace: &Trace<'_>) -> Result<()> {
    let (width, height) = (trace.image_size.0 as f32, trace.image_size.1 as f32);
    let best = trace.localization.ranking.iter().zip(&trace.predicted);
    for (rank, (candidate, points)) in best.take(NUM_PREDICTED).enumerate() {
        stream.log(
            entities::predicted_features(rank),
            &features(candidate, points),
        )?;
        let title = format!(
            "{}: {} of {} found",
            place(trace, candidate.node.0 as usize),
            candidate.num_inliers,
            points.len()
        );
        let frame = Boxes2D::from_mins_and_sizes([(0.0, 0.0)], [(width, height)])
            .with_colors([colours::rgb(colours::QUIET)])
            .with_labels([title])
            .with_show_labels(true);
        stream.log(entities::predicted_frame(rank), &frame)?;
    }
    Ok(())
}

/// Brighter: more probable; large: found.
fn features(candidate: &Candidate, points: &[TracePoint]) -> Points2D {
    let shift = displacement(candidate);
    let is_found = found(candidate, points.len());
    let likely = |i: usize| candidate.probabilities.get(i).copied();
    let label = |i: usize| {
        let found = if is_found[i] { "found" } else { "missing" };
        match likely(i) {
            Some(p) => format!("p = {p:.2}, {found}"),
            None => found.into(),
        }
    };
    let radius = |i: usize| Radius::new_ui_points(if is_found[i] { 5.0 } else { 2.5 });
    let all = || 0..points.len();
    Points2D::new(points.iter().map(|point| moved(point, shift)))
        .with_colors(all().map(|i| colours::probability(likely(i).unwrap_or(0.5))))
        .with_radii(all().map(radius))
        .with_labels(all().map(label))
        .with_show_labels(false)
}

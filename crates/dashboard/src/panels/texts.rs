//! How is text put on a plane?

use anyhow::Result;
use rerun::{Points2D, Radius, RecordingStream};

use crate::colours;

/// Texts that hang from points which are not drawn.
pub(crate) fn log(
    stream: &RecordingStream,
    entity: &str,
    texts: impl IntoIterator<Item = ((f32, f32), String)>,
) -> Result<()> {
    let (at, labels): (Vec<(f32, f32)>, Vec<String>) = texts.into_iter().unzip();
    let points = Points2D::new(at)
        .with_radii([Radius::new_ui_points(0.0)])
        .with_colors([colours::rgb(colours::TEXT)])
        .with_labels(labels)
        .with_show_labels(true);
    Ok(stream.log(entity, &points)?)
}

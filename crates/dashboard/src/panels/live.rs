//! What was seen, and what does the best place say of it?

use anyhow::Result;
use chronotope::localize::Candidate;
use chronotope::trace::{Trace, TracePoint};
use rerun::{Clear, EncodedImage, MediaType, Points2D, Radius, RecordingStream};

use super::lookup::{displacement, found, moved};
use crate::{colours, entities};

/// The picture and the three classes of its features.
pub(crate) fn log(stream: &RecordingStream, trace: &Trace<'_>) -> Result<()> {
    match &trace.jpeg {
        Some(jpeg) => stream.log(
            entities::LIVE_IMAGE,
            &EncodedImage::new(jpeg.0.clone())
                .with_media_type(MediaType::JPEG)
                .with_draw_order(-10.0),
        )?,
        None => stream.log(entities::LIVE_IMAGE, &Clear::flat())?,
    }
    let Classes {
        matched,
        missing,
        unexpected,
    } = Classes::of(trace);
    let classes = [
        (
            entities::LIVE_UNEXPECTED,
            unexpected,
            colours::UNEXPECTED,
            1.5,
        ),
        (entities::LIVE_MISSING, missing, colours::MISSING, 3.0),
        (entities::LIVE_MATCHED, matched, colours::MATCHED, 3.5),
    ];
    for (entity, features, colour, radius) in classes {
        let points = Points2D::new(features.iter().map(|feature| feature.at))
            .with_colors([colours::rgb(colour)])
            .with_radii([Radius::new_ui_points(radius)])
            .with_labels(features.into_iter().map(|feature| feature.label))
            .with_show_labels(false);
        stream.log(entity, &points)?;
    }
    Ok(())
}

/// One feature of the live picture, or one that is missing there.
struct Drawn {
    at: (f32, f32),
    label: String,
}

/// The features of a picture by what the first place says of them.
#[derive(Default)]
struct Classes {
    matched: Vec<Drawn>,
    missing: Vec<Drawn>,
    unexpected: Vec<Drawn>,
}

impl Classes {
    fn of(trace: &Trace<'_>) -> Self {
        let mut classes = Self::default();
        let mut is_used = vec![false; trace.live.len()];
        if let Some((first, points)) = trace.localization.first().zip(trace.predicted.first()) {
            classes.matched = matched(trace, first, &mut is_used);
            classes.missing = missing(first, points);
        }
        let unexpected = (trace.live.iter().zip(is_used)).filter(|(_, is_used)| !is_used);
        classes.unexpected = unexpected
            .map(|(point, _)| Drawn {
                at: (point[0], point[1]),
                label: "unexpected".into(),
            })
            .collect();
        classes
    }
}

/// Live features that are predicted ones; notes which these are.
fn matched(trace: &Trace<'_>, first: &Candidate, is_used: &mut [bool]) -> Vec<Drawn> {
    let inliers = first.matches.iter().filter(|found| found.inlier);
    inliers
        .filter_map(|found| {
            let live = found.live as usize;
            let point = trace.live.get(live)?;
            *is_used.get_mut(live)? = true;
            let likely = likely(first, found.rank as usize);
            Some(Drawn {
                at: (point[0], point[1]),
                label: format!("{likely}, found at {} bits", found.distance_bits),
            })
        })
        .collect()
}

/// Predicted features that were not found.
fn missing(first: &Candidate, points: &[TracePoint]) -> Vec<Drawn> {
    let shift = displacement(first);
    let is_found = found(first, points.len());
    (points.iter().enumerate())
        .filter(|(rank, _)| !is_found[*rank])
        .map(|(rank, point)| Drawn {
            at: moved(point, shift),
            label: format!("{}, missing", likely(first, rank)),
        })
        .collect()
}

/// How probable a predicted feature was.
fn likely(candidate: &Candidate, rank: usize) -> String {
    match candidate.probabilities.get(rank) {
        Some(p) => format!("p = {p:.2}"),
        None => "remembered".into(),
    }
}

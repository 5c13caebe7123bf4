//! Which features were seen again, which are new? (one visit at a time)
//!
//! 1. Each feature of the place takes its nearest live feature within the distance threshold; a
//!    live feature goes to the nearest of those that want it.
//! 2. The displacement that most pairs agree on is the camera's; the pairs that agree were *seen*.
//! 3. Live features that no agreeing pair uses are *born*, moved back by the displacement, so that
//!    all features of a place share the frame of its first visit; at a place of many visits the
//!    strongest only.
//! 4. Features that the displacement moves out of the image, or under the mask, were *not
//!    observable*; neither was anything in an image without any features (a black one).

use super::config::LearnConfig;
use super::visit::{Found, Observation, Scratch};
use crate::feature::{Features, FeaturesView, Keypoint};
use crate::matching::{Displacement, Matcher, displacements_into, vote_displacement};
use fremen::visibility::BitRow;

pub(super) fn find(
    cfg: &LearnConfig,
    matcher: &Matcher,
    scratch: &mut Scratch,
    known: FeaturesView<'_>,
    observation: &Observation<'_>,
    live: &Features,
    num_visits: usize,
) -> Found {
    let Scratch {
        matching,
        matches,
        displacements,
        vote,
        ..
    } = scratch;
    matcher.matches_into(matching, known, live.view(), matches);
    displacements_into(matches, known.keypoints, live.keypoints(), displacements);
    let agreed = vote_displacement(cfg.vote(), vote, displacements);
    let is_located = agreed.num_inliers >= cfg.min_inliers();
    let shift = if is_located {
        agreed.median
    } else {
        Displacement::default()
    };

    let mut is_known = BitRow::zeros(live.len());
    let mut seen_ids = Vec::new();
    let mut distances = Vec::new();
    for (found, &is_inlier) in matches.iter().zip(vote.inliers()) {
        if is_inlier && is_located {
            is_known.set(found.live as usize);
            seen_ids.push(found.map as usize);
            distances.push(found.distance_bits);
        }
    }
    let mut born = Features::new();
    let may_be_born = if num_visits < cfg.settled_visits() {
        live.len()
    } else {
        live.len().min(cfg.births_of_settled())
    };
    for id in (0..may_be_born).filter(|&id| !is_known.get(id)) {
        let mut keypoint = live.keypoints()[id];
        keypoint.x -= shift.dx_px as f32;
        keypoint.y -= shift.dy_px as f32;
        born.push(keypoint, live.descriptors()[id]);
    }
    let mut seen = BitRow::zeros(known.len() + born.len());
    for id in seen_ids.into_iter().chain(known.len()..seen.len()) {
        seen.set(id);
    }
    let mut hidden = BitRow::zeros(seen.len());
    for (id, keypoint) in known.keypoints.iter().enumerate() {
        if !seen.get(id) && (live.is_empty() || !is_in_view(keypoint, shift, observation)) {
            hidden.set(id);
        }
    }
    Found {
        born,
        seen,
        hidden: (hidden.count_ones() > 0).then_some(hidden),
        displacement: is_located.then_some(shift),
        distances,
    }
}

/// Whether a feature of the place, moved by the camera's displacement, lies on an observable pixel.
fn is_in_view(keypoint: &Keypoint, shift: Displacement, observation: &Observation<'_>) -> bool {
    let x = (f64::from(keypoint.x) + shift.dx_px).round();
    let y = (f64::from(keypoint.y) + shift.dy_px).round();
    let (width, height) = observation.image_size;
    if !(x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height)) {
        return false;
    }
    observation
        .mask
        .is_none_or(|mask| mask.row(y as usize)[x as usize] != 0)
}

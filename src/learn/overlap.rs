//! Have two maps anything in common?
//!
//! Places are known by name, and `lamp` may stand in two parks. Maps that share a visit are of one
//! world; so are maps in which a place of one name looks alike: as many features agree on a
//! displacement as are needed to recognise an image of it ([`LearnConfig::min_inliers`]).
//!
//! O(places * features of a place) where nothing is shared. Not for telling where a map lies in
//! another.

use std::collections::HashSet;

use super::config::LearnConfig;
use super::visit::Scratch;
use crate::map::{Snapshot, VisitId};
use crate::matching::{Matcher, displacements_into, vote_displacement};

/// Whether the maps share a visit, or a place of one name looks alike in both.
pub fn have_in_common(cfg: &LearnConfig, a: &Snapshot, b: &Snapshot) -> bool {
    let visits: HashSet<VisitId> = visits_in(a).collect();
    if visits_in(b).any(|id| visits.contains(&id)) {
        return true;
    }
    let matcher = Matcher::new(cfg.reobserve().clone());
    let mut scratch = Scratch::default();
    a.nodes().iter().any(|node| {
        b.find(node.key()).is_some_and(|other| {
            let (known, live) = (node.features(), b.node(other).features());
            let Scratch {
                matching,
                matches,
                displacements,
                vote,
                ..
            } = &mut scratch;
            matcher.matches_into(matching, known.view(), live.view(), matches);
            displacements_into(matches, known.keypoints(), live.keypoints(), displacements);
            let agreed = vote_displacement(cfg.vote(), vote, displacements);
            agreed.num_inliers >= cfg.min_inliers()
        })
    })
}

/// The position of a map that has nothing in common with the first one, also not by way of others:
/// of other places, or a mistake.
///
/// O(maps²) comparisons.
pub fn stranger_among(cfg: &LearnConfig, maps: &[&Snapshot]) -> Option<usize> {
    let (mut related, mut strangers) = (vec![0], (1..maps.len()).collect::<Vec<_>>());
    let mut next = 0;
    while let Some(&known) = related.get(next) {
        let (found, left): (Vec<usize>, Vec<usize>) =
            (strangers.iter()).partition(|&&at| have_in_common(cfg, maps[known], maps[at]));
        related.extend(found);
        strangers = left;
        next += 1;
    }
    strangers.first().copied()
}

fn visits_in(map: &Snapshot) -> impl Iterator<Item = VisitId> + '_ {
    (map.nodes().iter()).flat_map(|node| node.visits().iter().map(|visit| visit.id))
}

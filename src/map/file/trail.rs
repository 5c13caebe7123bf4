//! Was every generation of a line, not only its last, what its row says?

use std::sync::Arc;

use chronotope_store::Fault;

use super::generation::Generation;
use super::state::State;
use crate::map::digest::{self, ContentDigest};
use crate::map::node::Node;
use crate::map::snapshot::Snapshot;
use crate::map::types::{Edge, MapMeta};
use fremen::error::ErrorKind;

/// What one generation added, for a later check of every generation's digest.
#[derive(Debug, Default)]
pub(super) struct Trail {
    pub(super) metas: Vec<(u64, MapMeta)>,
    pub(super) edges: Vec<(u64, Edge)>,
    pub(super) places: Vec<u64>,
    /// Generation and place that it writes anew.
    pub(super) renewals: Vec<(u64, usize)>,
    pub(super) poses: Vec<(u64, usize, Option<[f64; 3]>)>,
    /// Generation, place, chain after the visit, features born at it.
    pub(super) links: Vec<(u64, usize, ContentDigest, usize)>,
    /// Generation, name, digest of the value; `None` where it went.
    pub(super) attachments: Vec<(u64, String, Option<ContentDigest>)>,
    pub(super) generations: Vec<Generation>,
}

/// Whether every generation of a line, not only the last, was what its row says: the commits are
/// made again, with the chains in place of the visits. O(generations * places + visits).
pub(super) fn check_trail(trail: &Trail, whole: &Snapshot) -> Result<(), Fault> {
    let Some((_, meta)) = trail.metas.first() else {
        return Ok(());
    };
    let mut replay = State::empty(meta.clone());
    // Visits and features of each place.
    let mut totals: Vec<(usize, usize)> = Vec::new();
    let mut renewals = trail.renewals.iter().peekable();
    let mut poses = trail.poses.iter().peekable();
    let mut links = trail.links.iter().peekable();
    let mut attachments = trail.attachments.iter().peekable();
    for written in &trail.generations {
        let number = written.number;
        replay.snapshot.generation = number;
        replay.meta_generation = written.meta;
        if let Ok(at) = trail
            .metas
            .binary_search_by_key(&written.meta, |meta| meta.0)
        {
            replay.snapshot.meta = trail.metas[at].1.clone();
        }
        if replay.edge_generation != written.edges {
            replay.edge_generation = written.edges;
            let edges = trail.edges.iter().filter(|edge| edge.0 == written.edges);
            replay.snapshot.edges = edges.map(|edge| edge.1.clone()).collect();
        }
        let known = replay.chains.len();
        let new = trail.places[known..].iter().take_while(|&&it| it <= number);
        for node in &whole.nodes[known..known + new.count()] {
            let node = Node::new(node.key().clone());
            replay.chains.push(digest::first_link(&node));
            replay.snapshot.nodes.push(Arc::new(node));
            totals.push((0, 0));
        }
        while let Some((_, place, pose)) = poses.next_if(|pose| pose.0 <= number) {
            if let Some(node) = replay.snapshot.nodes.get_mut(*place) {
                (Arc::make_mut(node).set_pose(*pose))
                    .map_err(|error| Fault::new("pose", ErrorKind::Format, error.to_string()))?;
            }
        }
        while let Some((_, name, digest)) = attachments.next_if(|it| it.0 <= number) {
            match digest {
                Some(digest) => drop(replay.attachments.insert(name.clone(), *digest)),
                None => drop(replay.attachments.remove(name)),
            }
        }
        while let Some(&(_, place)) = renewals.next_if(|renewal| renewal.0 <= number) {
            if let Some(total) = totals.get_mut(place) {
                *total = (0, 0);
                replay.renew(place);
            }
        }
        while let Some((_, place, link, born)) = links.next_if(|link| link.0 <= number) {
            if let Some(total) = totals.get_mut(*place) {
                *total = (total.0 + 1, total.1 + born);
                replay.chains[*place] = *link;
            }
        }
        written.compare(&Generation {
            num_visits: totals.iter().map(|total| total.0).sum(),
            num_features: totals.iter().map(|total| total.1).sum(),
            ..replay.totals(written.time)
        })?;
    }
    Ok(())
}

//! Which places are next to each other, and how far do they look alike?
//!
//! Places of a dense route overlap: the image of one shows half of the next. To a robot they are
//! not impostors but the same whereabouts, so they are added up in a
//! [region](super::Localization::region), and what one place's image finds at the next is no false
//! match.
//!
//! Places are linked by the map's edges, and where a robot once went from one straight to the
//! other: two visits after one another in one *run*, the visits up to the first place that was seen
//! before. Where several places have the very same time, the order is not known and nothing is
//! linked. How many links apart places still look alike, the *reach*, is learnt with the
//! [`Calibration`](super::Calibration) from matches between the map's own images.
//!
//! Cost: O(visits log visits) to link; a search over a few links to go round a place.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::map::{NodeId, Snapshot};
use fremen::time::Time;

/// Images of one place that are so near in time, with no other place between, belong to one stay.
const STAY_US: i64 = 60_000_000;
/// Two visits are one after the other if they are at most so many usual steps apart in time.
const MAX_GAP: i64 = 10;

/// Places that are next to each other.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Neighbours {
    /// Of each place, ascending.
    links: Vec<Vec<u32>>,
    /// So many links apart, places look alike.
    reach: usize,
    /// Of each place: those within reach or at the other end of one of the map's edges, ascending.
    beside: Vec<Vec<u32>>,
}

/// A visit: when, and where in the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Stop {
    pub(super) time: Time,
    pub(super) node: u32,
    pub(super) visit: u32,
}

/// All visits of a map in order of time, cut into runs: within a run, no place is left and seen
/// again.
pub(super) fn runs(snapshot: &Snapshot) -> Vec<Vec<Stop>> {
    let mut stops: Vec<Stop> = (0..)
        .zip(snapshot.nodes())
        .flat_map(|(node, place)| {
            let visits = (0..).zip(place.visits());
            visits.map(move |(visit, it)| Stop {
                time: it.time,
                node,
                visit,
            })
        })
        .collect();
    stops.sort_unstable();
    let mut runs: Vec<Vec<Stop>> = Vec::new();
    // The run that each place was last seen in, and where.
    let mut last_run = vec![usize::MAX; snapshot.nodes().len()];
    for stop in stops {
        let is_new = match runs.last().and_then(|run| run.last()) {
            None => true,
            Some(before) => {
                let stays = before.node == stop.node
                    && (stop.time.as_us()).saturating_sub(before.time.as_us()) <= STAY_US;
                !stays && last_run[stop.node as usize] == runs.len() - 1
            }
        };
        if is_new {
            runs.push(Vec::new());
        }
        let at = runs.len() - 1;
        runs[at].push(stop);
        last_run[stop.node as usize] = at;
    }
    runs
}

impl Neighbours {
    /// Of a map; nothing is known of the reach yet.
    pub(super) fn of(snapshot: &Snapshot) -> Self {
        let mut links = vec![BTreeSet::new(); snapshot.nodes().len()];
        let mut link = |a: u32, b: u32| {
            if a != b {
                links[a as usize].insert(b);
                links[b as usize].insert(a);
            }
        };
        let edges = (snapshot.edges().iter())
            .filter_map(|edge| Some((snapshot.find(&edge.from)?.0, snapshot.find(&edge.to)?.0)));
        edges.for_each(|(from, to)| link(from, to));
        let beside = links.clone();
        let mut link = |a: u32, b: u32| {
            if a != b {
                links[a as usize].insert(b);
                links[b as usize].insert(a);
            }
        };
        let steps: Vec<(Stop, Stop)> = (runs(snapshot).iter()).flat_map(|run| steps(run)).collect();
        let gap = |(from, to): &(Stop, Stop)| to.time.as_us().saturating_sub(from.time.as_us());
        let mut gaps: Vec<i64> = steps.iter().map(gap).collect();
        gaps.sort_unstable();
        let longest = gaps
            .get(gaps.len() / 2)
            .map_or(0, |usual| usual.saturating_mul(MAX_GAP));
        for step in steps.iter().filter(|step| gap(step) <= longest) {
            link(step.0.node, step.1.node);
        }
        let lists = |sets: Vec<BTreeSet<u32>>| -> Vec<Vec<u32>> {
            sets.into_iter()
                .map(|of| of.into_iter().collect())
                .collect()
        };
        Self {
            links: lists(links),
            reach: 0,
            beside: lists(beside),
        }
    }

    /// The same, once it is known how far places look alike.
    pub(super) fn with_reach(mut self, reach: usize) -> Self {
        self.reach = reach;
        let found: Vec<Vec<u32>> = (0..self.links.len() as u32)
            .map(|node| {
                let around = self.around(NodeId(node), reach);
                around.into_iter().map(|(node, _)| node.0).collect()
            })
            .collect();
        for (beside, found) in self.beside.iter_mut().zip(found) {
            beside.extend(found);
            beside.sort_unstable();
            beside.dedup();
        }
        self
    }

    /// So many links apart, places look alike.
    pub(super) fn reach(&self) -> usize {
        self.reach
    }

    /// The places next to one.
    pub(super) fn links(&self, node: NodeId) -> &[u32] {
        self.links.get(node.0 as usize).map_or(&[], Vec::as_slice)
    }

    /// The places at most `most` links away, with how many, nearest first; not the place itself.
    pub(super) fn around(&self, node: NodeId, most: usize) -> Vec<(NodeId, usize)> {
        let mut found: Vec<(NodeId, usize)> = vec![(node, 0)];
        let mut next = 0;
        while let Some(&(from, steps)) = found.get(next) {
            next += 1;
            if steps == most {
                break;
            }
            for &to in self.links(from) {
                if found.iter().all(|(known, _)| known.0 != to) {
                    found.push((NodeId(to), steps + 1));
                }
            }
        }
        found.remove(0);
        found
    }

    /// The places that share an answer with one, ascending: those that look alike because they are
    /// next to it, and those at the other end of an edge.
    pub(super) fn beside(&self, node: NodeId) -> &[u32] {
        self.beside.get(node.0 as usize).map_or(&[], Vec::as_slice)
    }

    /// Whether a copy from outside fits a map of so many places.
    pub(super) fn holds_together(&self, num_places: usize) -> bool {
        [0, num_places].contains(&self.links.len())
            && self.beside.len() == self.links.len()
            && (self.links.iter().chain(&self.beside).flatten())
                .all(|&to| (to as usize) < num_places)
            && self.reach <= MAX_REACH
    }
}

/// Places more links apart are never taken for neighbours.
pub(super) const MAX_REACH: usize = 8;

/// Where the robot went straight from one place to another: stops whose times are their own.
fn steps(run: &[Stop]) -> impl Iterator<Item = (Stop, Stop)> + '_ {
    let is_alone = |at: usize| {
        let same = |other: Option<&Stop>| {
            other.is_some_and(|it| it.time == run[at].time && it.node != run[at].node)
        };
        !same(at.checked_sub(1).and_then(|before| run.get(before))) && !same(run.get(at + 1))
    };
    (1..run.len())
        .filter(move |&at| run[at - 1].node != run[at].node && is_alone(at - 1) && is_alone(at))
        .map(|at| (run[at - 1], run[at]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::Features;
    use crate::map::{AppearanceUse, MapMeta, Node, PlaceKey, SessionId, Visit, VisitId};
    use fremen::visibility::BitRow;

    /// A map whose places were seen at these seconds.
    fn snapshot(visits: &[&[i64]]) -> Snapshot {
        let mut snapshot = Snapshot::empty(MapMeta::new(1, "none", "default"));
        for (index, times) in visits.iter().enumerate() {
            let key = PlaceKey::new(&format!("p{index}")).expect("a key");
            let mut node = Node::new(key);
            for &s in *times {
                let row = BitRow::zeros(0);
                let visit = Visit {
                    id: VisitId(0),
                    session: SessionId::derive("walk"),
                    time: Time::from_s(s),
                    source: String::new(),
                    appearance: None,
                    appearance_use: AppearanceUse::Experience,
                };
                let located_by = node.unlocated(visit.appearance_use);
                (node.push_visit(visit, &Features::new(), row, None, located_by)).expect("fits");
            }
            snapshot.push_node(node).expect("another key");
        }
        snapshot
    }

    #[test]
    fn a_run_ends_where_a_place_is_seen_again_and_a_stay_is_no_return() {
        let map = snapshot(&[&[0, 5, 100], &[10, 110], &[20, 120]]);
        let lengths: Vec<usize> = runs(&map).iter().map(Vec::len).collect();
        assert_eq!(lengths, [4, 3]);
        let alone = snapshot(&[&[0, 30, 3_600, 7_200]]);
        assert_eq!(
            runs(&alone).len(),
            3,
            "half a minute is a stay, an hour is not"
        );
    }

    #[test]
    fn the_way_links_places_and_equal_times_and_long_pauses_do_not() {
        let map = snapshot(&[&[0], &[10], &[20], &[30], &[100_000]]);
        let known = Neighbours::of(&map).with_reach(2);
        assert_eq!(known.links(NodeId(1)), [0, 2]);
        assert_eq!(known.links(NodeId(4)), [0; 0]);
        assert_eq!(known.beside(NodeId(0)), [1, 2]);
        assert_eq!(known.around(NodeId(0), 3).len(), 3);
        assert!(known.holds_together(5) && !known.holds_together(4));
        let together = snapshot(&[&[0, 60], &[0, 60], &[0, 60]]);
        assert_eq!(Neighbours::of(&together).links(NodeId(0)), [0; 0]);
    }
}

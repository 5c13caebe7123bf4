//! What is known of a map file that was read?

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use chronotope_store::{Fault, Row, Tip};

use super::generation::Generation;
use crate::map::digest::{self, ContentDigest};
use crate::map::snapshot::Snapshot;
use crate::map::types::{MapMeta, VisitId};
use fremen::error::ErrorKind;
use fremen::time::Time;

/// What is known of a map file: its last generation and where its rows end.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub(super) snapshot: Snapshot,
    pub(super) parent: Option<u64>,
    pub(super) prunes: u64,
    pub(super) chains: Vec<ContentDigest>,
    /// The row of each place, ascending.
    pub(super) place_rows: Vec<i64>,
    pub(super) visit_ids: HashSet<VisitId>,
    /// The digest of each attachment.
    pub(super) attachments: BTreeMap<String, ContentDigest>,
    pub(super) last_place: i64,
    pub(super) last_visit: i64,
    pub(super) last_pose: i64,
    pub(super) last_edge: i64,
    pub(super) last_attachment: i64,
    pub(super) last_renewal: i64,
    pub(super) meta_generation: u64,
    pub(super) edge_generation: u64,
}

impl State {
    /// A file of which only the meta row is known.
    pub(super) fn empty(meta: MapMeta) -> Self {
        Self {
            snapshot: Snapshot::empty(meta),
            parent: None,
            prunes: 0,
            chains: Vec::new(),
            place_rows: Vec::new(),
            visit_ids: HashSet::new(),
            attachments: BTreeMap::new(),
            last_place: 0,
            last_visit: 0,
            last_pose: 0,
            last_edge: 0,
            last_attachment: 0,
            last_renewal: 0,
            meta_generation: 0,
            edge_generation: 0,
        }
    }

    /// Where the file stands.
    pub(super) fn tip(&self) -> Tip {
        Tip {
            number: self.snapshot.generation,
            prunes: self.prunes,
        }
    }

    /// What a generation's row says of a map in this state; `time` is the caller's.
    pub(super) fn totals(&self, time: Time) -> Generation {
        let nodes = &self.snapshot.nodes;
        Generation {
            number: self.snapshot.generation,
            parent: self.parent,
            prunes: self.prunes,
            time,
            num_places: nodes.len(),
            num_visits: nodes.iter().map(|node| node.visits().len()).sum(),
            num_features: nodes.iter().map(|node| node.features().len()).sum(),
            digest: digest::of_chains(&self.snapshot, &self.chains, &self.attachments),
            meta: self.meta_generation,
            edges: self.edge_generation,
        }
    }

    /// Takes all visits from a place: what is written anew follows.
    pub(super) fn renew(&mut self, at: usize) {
        let node = &mut self.snapshot.nodes[at];
        for visit in node.visits() {
            self.visit_ids.remove(&visit.id);
        }
        let empty = node.unvisited();
        self.chains[at] = digest::first_link(&empty);
        *node = Arc::new(empty);
    }

    /// The position of the place whose row stands in `column`.
    pub(super) fn place_at(&self, row: &Row<'_>, column: usize) -> Result<usize, Fault> {
        let place = row.integer(column)?;
        (self.place_rows.binary_search(&place))
            .map_err(|_| row.misfit(column, format!("there is no place {place}")))
    }

    pub(super) fn check_against(&self, last: &Generation) -> Result<(), Fault> {
        last.compare(&self.totals(last.time))?;
        self.snapshot
            .check_frame()
            .map_err(|error| Fault::new("edge", ErrorKind::Format, error.to_string()))
    }
}

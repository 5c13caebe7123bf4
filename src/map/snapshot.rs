//! What is one state of a map, and may a store hold it?
//!
//! [`Snapshot::check`] says of any snapshot whether it is sound.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;

use super::limits::{MAX_ATTACHMENT_BYTES, MAX_ATTACHMENT_NAME_BYTES, MAX_TEXT_BYTES};
use super::node::Node;
use super::types::{AppearanceUse, Edge, MapMeta, NodeId, PlaceKey, Visit};
use crate::feature::Features;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::BitRow;

/// One immutable state of a map.
///
/// Places have different keys and edges join places of the map: whatever changes a snapshot keeps
/// to that or is an error. That no visit is in two places is what [`check`](Self::check) looks at.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    // The room reads and writes files of them; the others go through the functions below.
    pub(super) generation: u64,
    pub(super) meta: MapMeta,
    pub(super) nodes: Vec<Arc<Node>>,
    pub(super) edges: Vec<Edge>,
    pub(super) attachments: BTreeMap<String, Arc<[u8]>>,
}

/// What a [`Snapshot`] is made of, sound or not: [`Snapshot::from_parts`] says which.
#[derive(Clone, Debug, PartialEq)]
pub struct SnapshotParts {
    /// [`Snapshot::generation`].
    pub generation: u64,
    /// [`Snapshot::meta`].
    pub meta: MapMeta,
    /// [`Snapshot::nodes`], each with a key of its own.
    pub nodes: Vec<Arc<Node>>,
    /// [`Snapshot::edges`], between these places.
    pub edges: Vec<Edge>,
    /// [`Snapshot::attachments`].
    pub attachments: BTreeMap<String, Arc<[u8]>>,
}

impl Snapshot {
    /// A map of no places.
    pub fn empty(meta: MapMeta) -> Self {
        Self {
            generation: 0,
            meta,
            nodes: Vec::new(),
            edges: Vec::new(),
            attachments: BTreeMap::new(),
        }
    }

    /// The snapshot that these parts make, if a store may hold it ([`check`](Self::check)).
    pub fn from_parts(parts: SnapshotParts) -> Result<Self> {
        let snapshot = Self::of_parts(parts);
        snapshot.check().map(|()| snapshot)
    }

    /// [`from_parts`](Self::from_parts) of places that are known to be sound and to share no visit.
    pub(crate) fn from_sound_places(parts: SnapshotParts) -> Result<Self> {
        let snapshot = Self::of_parts(parts);
        snapshot.check_frame().map(|()| snapshot)
    }

    fn of_parts(parts: SnapshotParts) -> Self {
        let SnapshotParts {
            generation,
            meta,
            nodes,
            edges,
            attachments,
        } = parts;
        Self {
            generation,
            meta,
            nodes,
            edges,
            attachments,
        }
    }

    /// The inverse of [`from_parts`](Self::from_parts).
    pub fn into_parts(self) -> SnapshotParts {
        SnapshotParts {
            generation: self.generation,
            meta: self.meta,
            nodes: self.nodes,
            edges: self.edges,
            attachments: self.attachments,
        }
    }

    /// Which commit it is, counted from 0 (empty).
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// What holds for the whole map.
    pub fn meta(&self) -> &MapMeta {
        &self.meta
    }

    /// The places, in order of creation; [`NodeId`] is a position among them.
    pub fn nodes(&self) -> &[Arc<Node>] {
        &self.nodes
    }

    /// The ways between places.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// What other rooms keep with the map, by a name in kebab case of at most 64 bytes: values of
    /// at most 16 MiB that this room does not look into. An empty value is the same as none.
    pub fn attachments(&self) -> &BTreeMap<String, Arc<[u8]>> {
        &self.attachments
    }

    /// The node with this key.
    pub fn find(&self, key: &PlaceKey) -> Option<NodeId> {
        self.nodes
            .iter()
            .position(|node| node.key() == key)
            .map(|id| NodeId(id as u32))
    }

    /// The node with this id.
    ///
    /// # Panics
    /// If the id is of another snapshot.
    pub fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id.0 as usize]
    }
}

impl Snapshot {
    /// Sets [`meta`](Self::meta); an error if it cannot be stored, which changes nothing.
    pub fn set_meta(&mut self, meta: MapMeta) -> Result<()> {
        meta.check()?;
        self.meta = meta;
        Ok(())
    }

    /// Appends a place; a key that the map has already is an error.
    pub fn push_node(&mut self, node: impl Into<Arc<Node>>) -> Result<NodeId> {
        let node = node.into();
        if self.find(node.key()).is_some() {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("the map has a place `{}` already", node.key()),
            ));
        }
        self.nodes.push(node);
        Ok(NodeId(self.nodes.len() as u32 - 1))
    }

    /// The place with this key, appended without visits if there is none.
    pub fn find_or_add(&mut self, key: &PlaceKey) -> NodeId {
        self.find(key).unwrap_or_else(|| {
            self.nodes.push(Arc::new(Node::new(key.clone())));
            NodeId(self.nodes.len() as u32 - 1)
        })
    }

    /// Puts another state of a place where that place stands; another key is an error.
    ///
    /// # Panics
    /// If the id is of another snapshot.
    pub fn replace_node(&mut self, id: NodeId, node: impl Into<Arc<Node>>) -> Result<()> {
        let (known, node) = (&mut self.nodes[id.0 as usize], node.into());
        if known.key() != node.key() {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "`{}` is no state of the place `{}`",
                    node.key(),
                    known.key()
                ),
            ));
        }
        *known = node;
        Ok(())
    }

    /// [`Node::push_visit`] of the place with this id, which is copied first if another snapshot
    /// shares it.
    ///
    /// # Panics
    /// If the id is of another snapshot.
    pub fn push_visit(
        &mut self,
        id: NodeId,
        visit: Visit,
        born: &Features,
        seen: BitRow,
        hidden: Option<BitRow>,
        located_by: BitRow,
    ) -> Result<()> {
        (self.node_mut(id)).push_visit(visit, born, seen, hidden, located_by)
    }

    /// [`Node::set_pose`] of the place with this id.
    ///
    /// # Panics
    /// If the id is of another snapshot.
    pub fn set_pose(&mut self, id: NodeId, pose: Option<[f64; 3]>) -> Result<()> {
        self.node_mut(id).set_pose(pose)
    }

    /// Appends a way between two places of the map; false if it was there.
    pub fn add_edge(&mut self, edge: Edge) -> Result<bool> {
        for key in [&edge.from, &edge.to] {
            if self.find(key).is_none() {
                return Err(unknown_place(key));
            }
        }
        let is_new = !self.edges.contains(&edge);
        if is_new {
            self.edges.push(edge);
        }
        Ok(is_new)
    }

    /// Keeps the ways of which `keep` is true, in their order.
    pub fn retain_edges(&mut self, keep: impl FnMut(&Edge) -> bool) {
        self.edges.retain(keep);
    }

    /// Keeps `value` with the map under `name`, in place of what was kept under it; an error if it
    /// is no name or the value is too large ([`attachments`](Self::attachments)).
    pub fn attach(&mut self, name: &str, value: impl Into<Arc<[u8]>>) -> Result<()> {
        let value = value.into();
        check_attachment(name, &value)?;
        self.attachments.insert(name.to_owned(), value);
        Ok(())
    }

    /// Takes away what is kept under `name`.
    pub fn detach(&mut self, name: &str) -> Option<Arc<[u8]>> {
        self.attachments.remove(name)
    }
}

/// For the rooms that learn and correct: whoever changes something by these keeps it sound.
impl Snapshot {
    /// The node with this id, to be changed; it is copied first if another snapshot shares it.
    ///
    /// # Panics
    /// If the id is of another snapshot.
    pub(crate) fn node_mut(&mut self, id: NodeId) -> &mut Node {
        Arc::make_mut(&mut self.nodes[id.0 as usize])
    }

    pub(crate) fn meta_mut(&mut self) -> &mut MapMeta {
        &mut self.meta
    }

    pub(crate) fn nodes_mut(&mut self) -> &mut Vec<Arc<Node>> {
        &mut self.nodes
    }

    pub(crate) fn edges_mut(&mut self) -> &mut Vec<Edge> {
        &mut self.edges
    }
}

impl Snapshot {
    /// Whether a store may hold it: every place is sound, keys and visits are unique, edges join
    /// places of the map.
    pub fn check(&self) -> Result<()> {
        self.check_frame()?;
        let mut visits = HashSet::new();
        for node in &self.nodes {
            node.check()?;
            if let Some(twice) = node.visits().iter().find(|visit| !visits.insert(visit.id)) {
                return Err(Error::new(
                    ErrorKind::AlreadyExists,
                    format!("visit {} is in the map twice", twice.id),
                )
                .with_place(format!("place `{}`", node.key())));
            }
        }
        Ok(())
    }

    /// [`check`](Self::check) without looking into the places.
    pub(super) fn check_frame(&self) -> Result<()> {
        self.meta.check()?;
        if u32::try_from(self.nodes.len()).is_err() {
            return Err(Error::new(
                ErrorKind::Shape,
                "a map holds at most 2^32 - 1 places",
            ));
        }
        let mut keys = BTreeSet::new();
        if let Some(twice) = self.nodes.iter().find(|node| !keys.insert(node.key())) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("place `{}` is in the map twice", twice.key()),
            ));
        }
        for edge in &self.edges {
            if let Some(key) = [&edge.from, &edge.to]
                .into_iter()
                .find(|k| !keys.contains(k))
            {
                return Err(unknown_place(key));
            }
            if edge.name.len() > MAX_TEXT_BYTES {
                return Err(Error::new(
                    ErrorKind::Config,
                    format!("the name of an edge is longer than {MAX_TEXT_BYTES} bytes"),
                ));
            }
        }
        self.attachments
            .iter()
            .try_for_each(|(name, value)| check_attachment(name, value))
    }

    /// What it holds, in numbers. O(places + visits).
    pub fn summary(&self) -> Summary {
        let mut sessions = BTreeSet::new();
        let mut summary = Summary {
            generation: self.generation,
            num_places: self.nodes.len(),
            num_edges: self.edges.len(),
            num_attachments: self.attachments.len(),
            num_bytes: self.attachments.values().map(|value| value.len()).sum(),
            ..Summary::default()
        };
        for node in &self.nodes {
            summary.num_visits += node.visits().len();
            summary.num_features += node.features().len();
            summary.num_bytes += node.num_bytes();
            if let Some((first, last)) = node.time_span() {
                summary.first = Some(summary.first.map_or(first, |time| time.min(first)));
                summary.last = Some(summary.last.map_or(last, |time| time.max(last)));
            }
            for visit in node.visits() {
                sessions.insert(visit.session);
                if visit.appearance.is_some() {
                    summary.num_appearances += 1;
                    let is_experience = visit.appearance_use == AppearanceUse::Experience;
                    summary.num_experiences += usize::from(is_experience);
                }
            }
        }
        summary.num_sessions = sessions.len();
        summary
    }
}

/// Whether a map may hold this attachment.
pub(super) fn check_attachment(name: &str, value: &[u8]) -> Result<()> {
    let is_word = |word: &str| {
        !word.is_empty()
            && (word.bytes()).all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit())
    };
    if name.len() > MAX_ATTACHMENT_NAME_BYTES || !name.split('-').all(is_word) {
        return Err(Error::new(
            ErrorKind::Config,
            format!("`{}` is no name for an attachment", name.escape_debug()),
        )
        .with_help(format!(
            "use kebab case of at most {MAX_ATTACHMENT_NAME_BYTES} bytes"
        )));
    }
    if value.len() > MAX_ATTACHMENT_BYTES {
        return Err(Error::new(
            ErrorKind::Shape,
            format!(
                "the attachment `{name}` has {} bytes, where one holds at most \
                 {MAX_ATTACHMENT_BYTES}",
                value.len()
            ),
        ));
    }
    Ok(())
}

fn unknown_place(key: &PlaceKey) -> Error {
    Error::new(
        ErrorKind::NotFound,
        format!("an edge names the place `{key}`, which the map does not have"),
    )
    .with_help("add the place first")
}

/// What a [`Snapshot`] holds, in numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Which commit it is.
    pub generation: u64,
    /// How many places there are.
    pub num_places: usize,
    /// How many ways lead from one to another.
    pub num_edges: usize,
    /// How many runs the visits belong to.
    pub num_sessions: usize,
    /// How many visits there are in all places.
    pub num_visits: usize,
    /// How many visits have kept their own features.
    pub num_appearances: usize,
    /// How many of these are experiences of their place.
    pub num_experiences: usize,
    /// How many features all places have, without those of appearances.
    pub num_features: usize,
    /// How many named values other rooms keep with the map.
    pub num_attachments: usize,
    /// How many bytes features, logs, appearances and attachments take.
    pub num_bytes: usize,
    /// When the earliest visit was.
    pub first: Option<Time>,
    /// When the latest visit was.
    pub last: Option<Time>,
}

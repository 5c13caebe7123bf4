//! What is one state of a map, and may a store hold it?
//!
//! [`Snapshot::check`] says of any snapshot whether it is sound.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;

use super::limits::{MAX_ATTACHMENT_BYTES, MAX_ATTACHMENT_NAME_BYTES, MAX_TEXT_BYTES};
use super::node::Node;
use super::types::{AppearanceUse, Edge, MapMeta, NodeId, PlaceKey};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// One immutable state of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// Which commit it is, counted from 0 (empty).
    pub generation: u64,
    /// What holds for the whole map.
    pub meta: MapMeta,
    /// The places, in order of creation.
    pub nodes: Vec<Arc<Node>>,
    /// The ways between them.
    pub edges: Vec<Edge>,
    /// What other rooms keep with the map, by a name in kebab case of at most 64 bytes: values of
    /// at most 16 MiB that this room does not look into. An empty value is the same as none.
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

    /// The node with this key.
    pub fn find(&self, key: &PlaceKey) -> Option<NodeId> {
        self.nodes
            .iter()
            .position(|node| node.key == *key)
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
    /// Appends a place; a key that the map has already is an error.
    pub fn push_node(&mut self, node: Node) -> Result<NodeId> {
        if self.find(&node.key).is_some() {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("the map has a place `{}` already", node.key),
            ));
        }
        self.nodes.push(Arc::new(node));
        Ok(NodeId(self.nodes.len() as u32 - 1))
    }

    /// The place with this key, appended without visits if there is none.
    pub fn find_or_add(&mut self, key: &PlaceKey) -> NodeId {
        self.find(key).unwrap_or_else(|| {
            self.nodes.push(Arc::new(Node::new(key.clone())));
            NodeId(self.nodes.len() as u32 - 1)
        })
    }

    /// The node with this id, to be changed; it is copied first if another snapshot shares it.
    ///
    /// # Panics
    /// If the id is of another snapshot.
    pub fn node_mut(&mut self, id: NodeId) -> &mut Node {
        Arc::make_mut(&mut self.nodes[id.0 as usize])
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

    /// Whether a store may hold it: every place is sound, keys and visits are unique, edges join
    /// places of the map.
    pub fn check(&self) -> Result<()> {
        self.check_frame()?;
        let mut visits = HashSet::new();
        for node in &self.nodes {
            node.check()?;
            if let Some(twice) = node.visits.iter().find(|visit| !visits.insert(visit.id)) {
                return Err(Error::new(
                    ErrorKind::AlreadyExists,
                    format!("visit {} is in the map twice", twice.id),
                )
                .with_place(format!("place `{}`", node.key)));
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
        if let Some(twice) = self.nodes.iter().find(|node| !keys.insert(&node.key)) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("place `{}` is in the map twice", twice.key),
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
            summary.num_visits += node.visits.len();
            summary.num_features += node.features.len();
            summary.num_bytes += node.num_bytes();
            if let Some((first, last)) = node.time_span() {
                summary.first = Some(summary.first.map_or(first, |time| time.min(first)));
                summary.last = Some(summary.last.map_or(last, |time| time.max(last)));
            }
            for visit in &node.visits {
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

//! Places, visits and edges as plain data.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::feature::{Features, Rect};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::HistoryLog;

/// Position of a node in [`Snapshot::nodes`]: a local number, never stored.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct NodeId(pub u32);

/// The name of a place, unique within a map.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct PlaceKey(Arc<str>);

impl PlaceKey {
    /// A key of 1 to 256 bytes without control characters.
    pub fn new(key: &str) -> Result<Self> {
        if key.is_empty() || key.len() > 256 || key.chars().any(char::is_control) {
            return Err(Error::new(
                ErrorKind::Config,
                format!("`{}` is no name for a place", key.escape_debug()),
            )
            .with_help("use 1 to 256 bytes without control characters"));
        }
        Ok(Self(key.into()))
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for PlaceKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for PlaceKey {
    type Error = Error;

    fn try_from(key: String) -> Result<Self> {
        Self::new(&key)
    }
}

impl From<PlaceKey> for String {
    fn from(key: PlaceKey) -> Self {
        key.0.as_ref().into()
    }
}

/// One run of the robot: 128 random or derived bits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct SessionId(pub u128);

/// What makes a visit the same visit in two maps: the first 128 bits of a SHA-256 over session, place
/// key, capture time and the digest of its features.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct VisitId(pub u128);

macro_rules! hex_debug {
    ($($id:ident),*) => {$(
        impl fmt::Debug for $id {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{:032x}", self.0)
            }
        }
        impl fmt::Display for $id {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{:032x}", self.0)
            }
        }
    )*};
}
hex_debug!(SessionId, VisitId);

/// Why a visit's own features are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AppearanceUse {
    /// Localisation with the experiences so far failed here: it is an experience of the place.
    Experience,
    /// Kept, though the experiences so far located it.
    Recognised,
}

/// One observation time of a place.
#[derive(Clone, Debug, PartialEq)]
pub struct Visit {
    /// Its identity across maps.
    pub id: VisitId,
    /// The run it belongs to.
    pub session: SessionId,
    /// When the image was taken.
    pub time: Time,
    /// Where the image came from, for people.
    pub source: String,
    /// The visit's own features, strongest first, where they were kept.
    pub appearance: Option<Arc<Features>>,
    /// What the appearance is for.
    pub appearance_use: AppearanceUse,
}

/// One place.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its name.
    pub key: PlaceKey,
    /// The features of the place, in order of birth; positions are those of the birth visit moved
    /// by the displacement found there, so that all share the first visit's frame.
    pub features: Features,
    /// What was seen when; `log.num_features() == features.len()`.
    pub log: HistoryLog,
    /// The visits, in order of arrival; `log.num_visits() == visits.len()` and times agree.
    pub visits: Vec<Visit>,
    /// Which experience of the place would by itself have located which visit. Its "features" are the
    /// visits with [`AppearanceUse::Experience`], in their order, each born at itself, whether or not
    /// its appearance was kept; it has a row for every visit, and none of them has hidden bits.
    pub experience_log: HistoryLog,
    /// Position in metres in a frame of the user's, where known.
    pub pose: Option<[f64; 3]>,
}

impl Node {
    /// A place that was never visited.
    pub fn new(key: PlaceKey) -> Self {
        Self {
            key,
            features: Features::new(),
            log: HistoryLog::new(),
            experience_log: HistoryLog::new(),
            visits: Vec::new(),
            pose: None,
        }
    }
}

/// A way from one place to another.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Edge {
    /// Where it starts.
    pub from: PlaceKey,
    /// Where it ends.
    pub to: PlaceKey,
    /// What the user calls it; may be empty.
    pub name: String,
}

/// What holds for the whole map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MapMeta {
    /// The map's UUID.
    pub uuid: u128,
    /// [`Extractor::id`](crate::feature::Extractor::id) of all its features.
    pub extractor: String,
    /// Size in pixels of the images it was learnt from; `None` while it is empty.
    pub image_size: Option<(u32, u32)>,
    /// The rectangle cut from each camera image before extraction.
    pub crop: Option<Rect>,
    /// The name of the preset it was built with.
    pub preset: String,
    /// The IANA zone whose civil time rules human rhythms here.
    pub zone: Option<String>,
}

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
    /// What other rooms keep with the map, by a name in kebab case of at most 64 bytes: values of at
    /// most 16 MiB that this room does not look into. An empty value is the same as none.
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

//! Which names, visits and edges make up a map?

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use unicode_normalization::UnicodeNormalization;

use super::limits::MAX_TEXT_BYTES;
use crate::feature::{Features, Rect};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Time, Zone};

/// Position of a node in [`Snapshot::nodes`](super::Snapshot::nodes): a local number, never stored.
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

    /// [`new`](Self::new) of what somebody wrote: letters with marks are composed (Unicode NFC) and
    /// spaces at the ends left out, so that names that look alike are one.
    ///
    /// Keys of a file of maps are taken as they are.
    pub fn written(key: &str) -> Result<Self> {
        let composed: String = key.trim().nfc().collect();
        Self::new(&composed)
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

/// What makes a visit the same visit in two maps: the first 128 bits of a SHA-256 over place key,
/// capture time and the digest of its features (and of visits of earlier versions the session).
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

impl AppearanceUse {
    /// The word for it in map files and exported tables.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Experience => "experience",
            Self::Recognised => "recognised",
        }
    }

    /// The inverse of [`name`](Self::name).
    pub(super) fn named(name: &str) -> Option<Self> {
        [Self::Experience, Self::Recognised]
            .into_iter()
            .find(|it| it.name() == name)
    }
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

/// The preset that is as published, to the letter.
const LITERAL_PRESET: &str = "lttl";

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

impl MapMeta {
    /// What a new map says of itself: no image yet, no crop, no zone.
    pub fn new(uuid: u128, extractor: impl Into<String>, preset: impl Into<String>) -> Self {
        Self {
            uuid,
            extractor: extractor.into(),
            image_size: None,
            crop: None,
            preset: preset.into(),
            zone: None,
        }
    }

    /// The zone by whose clocks the rhythms of places are learnt and predicted; none with the preset
    /// `lttl`, which is as published and counts UTC.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Config`] if this machine knows no zone of that name.
    pub fn civil_zone(&self) -> Result<Option<Zone>> {
        match &self.zone {
            Some(name) if self.preset != LITERAL_PRESET => match Zone::new(name) {
                Ok(zone) => Ok(Some(zone)),
                Err(cause) => Err(Error::new(
                    ErrorKind::Config,
                    format!("this machine does not know the map's time zone, `{name}`"),
                )
                .with_help("install the system's time zone data (Debian, Ubuntu: tzdata)")
                .with_source(cause)),
            },
            _ => Ok(None),
        }
    }

    /// Whether it can be stored.
    pub fn check(&self) -> Result<()> {
        let zone = self.zone.as_deref().unwrap_or_default();
        for (what, text) in [
            ("extractor", self.extractor.as_str()),
            ("preset", self.preset.as_str()),
            ("zone", zone),
        ] {
            if text.len() > MAX_TEXT_BYTES {
                return Err(Error::new(
                    ErrorKind::Config,
                    format!("the map's {what} is longer than {MAX_TEXT_BYTES} bytes"),
                ));
            }
        }
        Ok(())
    }
}

//! What is a dataset: images of places with their times?

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::paths::hex;
use crate::feature::{DecodeLimits, GrayImage};
use crate::map::{Edge, PlaceKey};
use fremen::error::{Error, Result};
use fremen::time::{Time, Zone};

/// Something that yields the grey image of one entry: a file cut and scaled by us, or a rendering.
pub trait ImageSource: Send + Sync {
    /// Decodes or renders it; the same bytes every time.
    fn load(&self) -> Result<GrayImage>;

    /// The file, where there is one.
    fn path(&self) -> Option<PathBuf> {
        None
    }

    /// All of the file at [`path`](Self::path), where there is one.
    fn decode(&self) -> Result<GrayImage> {
        self.load()
    }

    /// What [`load`](Self::load) gives, from what [`decode`](Self::decode) gave: so a file that
    /// many entries are cut out of is decoded once.
    fn load_from(&self, file: &GrayImage) -> Result<GrayImage> {
        let _ = file;
        self.load()
    }

    /// Columns and rows of what [`load`](Self::load) gives, where the head of the file says so.
    fn size(&self) -> Result<Option<(u32, u32)>> {
        Ok(None)
    }

    /// The image with its mask.
    fn load_masked(&self) -> Result<(GrayImage, Option<GrayImage>)> {
        let image = self.load()?;
        let mask = self.mask(image.width(), image.height())?;
        Ok((image, mask))
    }

    /// The mask for an image of `width` x `height` pixels that [`load`](Self::load) gave, where
    /// parts of it must not be used: 0 there, 255 in the rest.
    fn mask(&self, width: usize, height: usize) -> Result<Option<GrayImage>> {
        let _ = (width, height);
        Ok(None)
    }

    /// What is done to the file, in words that change when the result does; part of
    /// [`Dataset::sha256`].
    fn recipe(&self) -> String {
        String::new()
    }
}

/// One image of one place at one time.
#[derive(Clone)]
pub struct Entry {
    /// Where it was taken: the truth of an evaluation, the label of a build.
    pub place: PlaceKey,
    /// When it was taken.
    pub time: Time,
    /// Unique within the dataset, stable, short: `images/0101.webp` or `images/a.jpg@v1`.
    pub id: String,
    /// The image.
    pub source: Arc<dyn ImageSource>,
}

impl fmt::Debug for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Entry({} at {}, {})", self.place, self.time, self.id)
    }
}

/// Whether the times of a dataset can be used to learn rhythms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// Times are real moments (perhaps coarse).
    Real,
    /// Times only number the visits: temporal models are not run on them.
    None,
}

/// Something wrong with an entry that was left out, for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// The file and the place in it.
    pub subject: String,
    /// What is wrong and what helps.
    pub message: String,
    /// The image file concerned, where there is one.
    #[serde(skip)]
    pub file: Option<PathBuf>,
}

impl Problem {
    /// `subject` is left out because of `message`.
    pub fn new(subject: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            subject: subject.into(),
            message: message.into(),
            file: None,
        }
    }

    /// `subject` is left out because of `error`, whose file is not named a second time.
    pub fn of(subject: impl Into<String>, error: Error) -> Self {
        let subject = subject.into();
        let is_named = error.path().is_some_and(|path| path.ends_with(&subject));
        let message = if is_named {
            error.without_path().to_string()
        } else {
            error.to_string()
        };
        Self::new(subject, message)
    }

    /// It concerns this image file.
    #[must_use]
    pub fn with_file(mut self, file: impl Into<PathBuf>) -> Self {
        self.file = Some(file.into());
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.subject, self.message)
    }
}

/// Images of places with their times.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Short name for tables.
    pub name: String,
    /// What its times mean.
    pub clock: Clock,
    /// The IANA zone by whose clocks its places live, where that is known.
    pub zone: Option<String>,
    /// Columns and rows that its images have, where a manifest says so.
    pub image_size: Option<(u32, u32)>,
    /// The images, sorted by time, then place, then id.
    pub entries: Vec<Entry>,
    /// Ways between places, where known.
    pub edges: Vec<Edge>,
    /// Positions of places in metres, where known.
    pub poses: BTreeMap<PlaceKey, [f64; 3]>,
    /// What was left out and why.
    pub problems: Vec<Problem>,
}

/// How a dataset is read, whatever its manifest says.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// The zone of dates without an offset; that of the manifest, if not given, is not used for
    /// them.
    pub zone: Option<Zone>,
    /// What is too big to decode.
    pub limits: DecodeLimits,
    /// Of an index only rows of files with these names matter, in whichever folder; the others are
    /// passed over, right or wrong. So a few images under a large index are found in the time that
    /// reading its bytes takes.
    pub only: Option<Arc<BTreeSet<String>>>,
}

impl Dataset {
    /// The names of all places, sorted.
    pub fn places(&self) -> Vec<PlaceKey> {
        let mut places: Vec<_> = self
            .entries
            .iter()
            .map(|entry| entry.place.clone())
            .collect();
        places.sort_unstable();
        places.dedup();
        places
    }

    /// SHA-256, in hexadecimal, of what the index says: name of the place, time, id and
    /// [`recipe`](ImageSource::recipe) of every entry. The same for a copy of the dataset in
    /// another folder; the bytes of the images are not part of it
    /// ([`Manifest::verify`](super::Manifest::verify) checks those).
    pub fn sha256(&self) -> String {
        let mut hasher = Sha256::new();
        for entry in &self.entries {
            let line = format!(
                "{}\t{}\t{}\t{}\n",
                entry.place,
                entry.time.as_us(),
                entry.id,
                entry.source.recipe()
            );
            hasher.update(line.as_bytes());
        }
        hex(&hasher.finalize())
    }
}

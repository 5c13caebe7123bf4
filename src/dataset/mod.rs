//! Where do images, times, places, edges and truth come from?
//!
//! A [`Dataset`] is a sorted list of [`Entry`]s: one image of one place at one time. It comes from a
//! folder with an `index.csv`, from one of the published layouts (GRIEF, FreLoc / Witham Wharf, NCLT),
//! read as a [`Manifest`] says, or from the synthetic world.
//!
//! What cannot be trusted as a whole is an error: no index, a bad header, a bad number, a time that is
//! none. What concerns one image is left out, counted and listed in [`Dataset::problems`]: a missing
//! or empty file, a crop that is not inside its image, a second row for the same place and time, a
//! place that the manifest does not list. Nothing is left out in silence, and nothing is ever written.

mod check;
mod file_image;
mod file_name;
mod layouts;
mod manifest;
mod table;

pub mod synthetic;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::feature::GrayImage;
use crate::map::{Edge, PlaceKey};
use fremen::error::Result;
use fremen::time::Time;

pub use check::{CheckReport, PlaceSummary, SizeCount};
pub use file_image::FileImage;
pub use manifest::{Checksums, Layout, Manifest, Mask, NcltPlace, Quantum, Side, Split, TimeRule};

/// Something that yields the grey image of one entry: a file cut and scaled by us, or a rendering.
pub trait ImageSource: Send + Sync {
    /// Decodes or renders it; the same bytes every time.
    fn load(&self) -> Result<GrayImage>;

    /// The file, where there is one.
    fn path(&self) -> Option<PathBuf> {
        None
    }

    /// The mask for an image of `width` x `height` pixels that [`load`](Self::load) gave, where parts
    /// of it must not be used: 0 there, 255 elsewhere.
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
    /// The images, sorted by time, then place, then id.
    pub entries: Vec<Entry>,
    /// Ways between places, where known.
    pub edges: Vec<Edge>,
    /// Positions of places in metres, where known.
    pub poses: BTreeMap<PlaceKey, [f64; 3]>,
    /// What was left out and why.
    pub problems: Vec<Problem>,
}

impl Dataset {
    /// Opens a folder of images or a manifest (`*.toml`); [`Manifest::locate`] says how the manifest
    /// of a folder is found.
    pub fn open(path: &Path) -> Result<Self> {
        let (manifest, data_dir) = Manifest::locate(path)?;
        Self::open_with(&manifest, &data_dir)
    }

    /// Opens the images of `manifest` in `data_dir`, which is the set's own folder or one that
    /// contains it under the manifest's name.
    pub fn open_with(manifest: &Manifest, data_dir: &Path) -> Result<Self> {
        layouts::open(manifest, data_dir)
    }

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
    /// [`recipe`](ImageSource::recipe) of every entry. The same for a copy of the dataset in another
    /// folder; the bytes of the images are not part of it ([`Manifest::verify`] checks those).
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

    /// Decodes every image and counts; see [`CheckReport`].
    ///
    /// `progress(done, total)` is called after every image, from several threads.
    pub fn check(&self, progress: impl Fn(usize, usize) + Sync) -> CheckReport {
        check::check(self, &progress)
    }
}

fn hex(bytes: &[u8]) -> String {
    use fmt::Write;
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

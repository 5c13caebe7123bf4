//! Where do images, times, places, edges and truth come from?

pub mod synthetic;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use crate::error::Result;
use crate::feature::GrayImage;
use crate::map::{Edge, PlaceKey};
use crate::time::Time;

/// Something that yields the grey image of one entry: a file cut and scaled by us, or a rendering.
pub trait ImageSource: Send + Sync {
    /// Decodes or renders it; the same bytes every time.
    fn load(&self) -> Result<GrayImage>;

    /// The file, where there is one.
    fn path(&self) -> Option<PathBuf> {
        None
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

/// Whether the times of a dataset can be used to learn rhythms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// Times are real moments (perhaps coarse).
    Real,
    /// Times only number the visits: temporal models are not run on them.
    None,
}

/// Something wrong with an entry that was left out, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The file and the place in it.
    pub subject: String,
    /// What is wrong and what helps.
    pub message: String,
}

/// Images of places with their times.
#[derive(Clone)]
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

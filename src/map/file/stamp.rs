//! Which state is a map file in, as far as its first pages say?
//!
//! Whatever is derived from a map (an index, a layout for queries) is kept beside it under the
//! [`Stamp`] that it was made of, and made again once the map has another.
//!
//! Not for trusting a file: that its rows are as they were written only
//! [`Map::open`](super::Map::open) finds out.

use std::path::Path;

use chronotope_store::{Faults, Reader, Store};

use super::load;
use super::tables::MAP;
use crate::map::digest::ContentDigest;
use crate::map::snapshot::Snapshot;
use crate::map::types::MapMeta;
use fremen::error::Result;

/// The newest generation of a map file: its number, and the digest of all that it remembers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Stamp {
    /// Counted from 0, the empty map.
    pub generation: u64,
    /// [`Snapshot::digest`].
    pub digest: ContentDigest,
}

impl Stamp {
    /// Of the file at `path`, from its first page and the table of generations.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        glance(path.as_ref(), |reader| {
            let generations = reader.generations(None, &mut Faults::strict(&MAP))?;
            Ok(generations.last().map(|it| Self {
                generation: it.number,
                digest: it.digest,
            }))
        })
    }

    /// Of what was read of a file: O(bytes) to digest.
    pub fn of(snapshot: &Snapshot) -> Self {
        Self {
            generation: snapshot.generation,
            digest: snapshot.digest(),
        }
    }
}

impl MapMeta {
    /// Of the file at `path`, from its first page and two small tables.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        glance(path.as_ref(), load::read_newest_meta)
    }
}

/// Reads a little of the file at `path`.
fn glance<T>(path: &Path, read: impl FnOnce(&Reader<'_>) -> Result<Option<T>>) -> Result<T> {
    let found = Store::glance(&MAP, path, load::check, read)?;
    found.ok_or_else(|| MAP.no_generations().with_path(path))
}

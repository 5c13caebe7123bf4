//! Which state is a map file in, told without reading all of it?
//!
//! Whatever is derived from a map (an index, a layout for queries) is kept beside it under the
//! [`Stamp`] that it was made of, and made again once the map has another.
//!
//! Not for trusting a file: that its rows are as they were written only [`Map::open`](super::Map::open)
//! finds out.

use std::path::Path;

use rusqlite::{Connection, OpenFlags};

use super::digest::ContentDigest;
use super::load::{self, Faults};
use super::store::{check_schema, connect, peek, reading};
use crate::map::types::{MapMeta, Snapshot};
use fremen::error::{Error, ErrorKind, Result};

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
        let path = path.as_ref();
        glance(path, |connection| {
            let version = load::format_version(connection)?;
            let generations =
                load::read_generations(connection, version, None, &mut Faults::strict())?;
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
fn glance<T>(path: &Path, read: impl FnOnce(&Connection) -> Result<Option<T>>) -> Result<T> {
    let glance = || {
        peek(path)?;
        let mut connection = connect(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let found = reading(&mut connection, |connection| {
            check_schema(connection, &mut Faults::strict())?;
            read(connection)
        })?;
        found.ok_or_else(|| Error::new(ErrorKind::Format, "this map has no generation"))
    };
    glance().map_err(|error| error.with_path(path))
}

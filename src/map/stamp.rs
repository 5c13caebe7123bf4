//! Which state is a map file in, told without reading all of it?
//!
//! Whatever is derived from a map (an index, a layout for queries) is kept beside it under the
//! [`Stamp`] that it was made of, and made again once the map has another.
//!
//! Not for trusting a file: that its rows are as they were written only [`Map::open`](super::Map::open)
//! finds out.

use std::path::Path;

use rusqlite::OpenFlags;

use super::digest::ContentDigest;
use super::load::{self, Faults};
use super::store::{connect, peek, reading, sqlite_error};
use super::types::Snapshot;
use crate::error::{Error, ErrorKind, Result};

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
        let read = || {
            peek(path)?;
            let mut connection = connect(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
            let generations = reading(&mut connection, |connection| {
                let version = connection
                    .query_row("PRAGMA user_version", [], |row| row.get(0))
                    .map_err(|error| sqlite_error(&error))?;
                load::read_generations(connection, version, None, &mut Faults::strict())
            })?;
            let newest = generations.last();
            newest
                .map(|it| Self {
                    generation: it.number,
                    digest: it.digest,
                })
                .ok_or_else(|| Error::new(ErrorKind::Format, "this map has no generation"))
        };
        read().map_err(|error| error.with_path(path))
    }

    /// Of what was read of a file: O(bytes) to digest.
    pub fn of(snapshot: &Snapshot) -> Self {
        Self {
            generation: snapshot.generation,
            digest: snapshot.digest(),
        }
    }
}

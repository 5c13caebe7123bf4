//! Which messages are in this `.db3` file?
//!
//! The storage `sqlite3` of rosbag2: a table of topics and one of messages, which are read in the
//! order of their rows, as they were written. Where messages are packed one by one (compression
//! mode `message` of `metadata.yaml`), each is unpacked.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use chronotope::dataset::Problem;
use chronotope::error::{Error, ErrorKind, Result};
use rusqlite::{Connection, OpenFlags, OptionalExtension};

use super::types::{
    MAX_MESSAGE_BYTES, Message, Position, Topic, Visit, Wanted, changed, file_name,
};
use crate::message::Stamp;

/// A database that is open.
#[derive(Debug)]
pub(super) struct Database {
    /// As it was named.
    path: PathBuf,
    connection: Mutex<Connection>,
    number: u32,
    packs_messages: bool,
}

impl Database {
    /// `path` is where it is, `named` what people call it.
    pub(super) fn open(
        path: &Path,
        named: &Path,
        number: u32,
        packs_messages: bool,
    ) -> Result<Self> {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection =
            Connection::open_with_flags(path, flags).map_err(|cause| failed(named, &cause))?;
        let database = Self {
            path: named.to_owned(),
            connection: Mutex::new(connection),
            number,
            packs_messages,
        };
        database.topics()?;
        Ok(database)
    }

    fn topics(&self) -> Result<HashMap<i64, Topic>> {
        let connection = self
            .connection
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let read = || -> rusqlite::Result<HashMap<i64, Topic>> {
            let mut query =
                connection.prepare("SELECT id, name, type, serialization_format FROM topics")?;
            let rows = query.query_map([], |row| {
                let topic = Topic {
                    name: row.get(1)?,
                    type_name: row.get(2)?,
                    encoding: row.get(3)?,
                };
                Ok((row.get(0)?, topic))
            })?;
            rows.collect()
        };
        read().map_err(|cause| {
            let error = failed(&self.path, &cause);
            if cause.to_string().contains("no such table") {
                return error.with_help("this database is no bag of rosbag2");
            }
            error
        })
    }

    pub(super) fn scan(
        &self,
        is_wanted: &Wanted<'_>,
        visit: &mut Visit<'_>,
        problems: &mut Vec<Problem>,
    ) -> Result<()> {
        let topics = self.topics()?;
        let connection = self
            .connection
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let mut num_read = 0_usize;
        let mut walk = || -> rusqlite::Result<Result<()>> {
            let mut query = connection
                .prepare("SELECT id, topic_id, timestamp, data FROM messages ORDER BY id")?;
            let mut rows = query.query([])?;
            while let Some(row) = rows.next()? {
                num_read += 1;
                let id: i64 = row.get(0)?;
                let Some(topic) = topics.get(&row.get(1)?).filter(|topic| is_wanted(topic)) else {
                    continue;
                };
                let data = row.get_ref(3)?.as_blob_or_null()?.unwrap_or_default();
                let position = Position {
                    file: self.number,
                    record: id.cast_unsigned(),
                    in_chunk: 0,
                };
                let logged = Stamp::from_ns(row.get(2)?);
                let unpacked = match self.unpack(data) {
                    Ok(unpacked) => unpacked,
                    Err(error) => {
                        let subject = format!("{}: message {id}", file_name(&self.path));
                        problems.push(Problem::of(subject, error));
                        continue;
                    }
                };
                let message = Message {
                    topic,
                    logged,
                    data: unpacked.as_deref().unwrap_or(data),
                    position,
                };
                if let Err(error) = visit(&message) {
                    return Ok(Err(error));
                }
            }
            Ok(Ok(()))
        };
        match walk() {
            Ok(done) => done,
            // What came before it is good: SQLite checks what it reads.
            Err(cause) => {
                problems.push(Problem::new(
                    file_name(&self.path),
                    format!(
                        "the database is damaged behind message {num_read}: {cause}; it is read up to \
                         there (help: sqlite3 FILE .recover)"
                    ),
                ));
                Ok(())
            }
        }
    }

    pub(super) fn read<T>(
        &self,
        position: Position,
        use_data: impl FnOnce(&[u8]) -> Result<T>,
    ) -> Result<T> {
        let data: Option<Vec<u8>> = {
            let connection = self
                .connection
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            connection
                .query_row(
                    "SELECT data FROM messages WHERE id = ?1",
                    [position.record.cast_signed()],
                    |row| row.get(0),
                )
                .optional()
                .map_err(|cause| failed(&self.path, &cause))?
        };
        let data = data.ok_or_else(|| changed(&self.path))?;
        match self.unpack(&data)? {
            Some(unpacked) => use_data(&unpacked),
            None => use_data(&data),
        }
    }

    /// What was packed; `None` where nothing is.
    fn unpack(&self, data: &[u8]) -> Result<Option<Vec<u8>>> {
        if !self.packs_messages {
            return Ok(None);
        }
        let error = |message: String| Error::new(ErrorKind::Format, message);
        let mut unpacked = Vec::new();
        zstd::Decoder::with_buffer(data)
            .and_then(|decoder| {
                decoder
                    .take(MAX_MESSAGE_BYTES + 1)
                    .read_to_end(&mut unpacked)
            })
            .map_err(|cause| error(format!("what is packed with zstd is damaged: {cause}")))?;
        if unpacked.len() as u64 > MAX_MESSAGE_BYTES {
            return Err(error(format!(
                "the message has more than the {MAX_MESSAGE_BYTES} bytes that are read"
            )));
        }
        Ok(Some(unpacked))
    }
}

fn failed(path: &Path, cause: &rusqlite::Error) -> Error {
    Error::new(
        ErrorKind::Format,
        format!("the database cannot be read: {cause}"),
    )
    .with_path(path)
    .with_help("sqlite3 FILE .recover saves what is left of one that is damaged")
}

//! Which messages are in this MCAP file?
//!
//! The file is a row of records (<https://mcap.dev/spec>): a byte that says what it is, eight that
//! say how long, and that. Schemas and channels come before the messages that name them, most of
//! them inside of chunks, which may be packed. Only the records that matter are read. The summary at the
//! end is not needed, so a file that was cut off is read like a whole one.
//!
//! In memory are one chunk that is scanned and, for messages that are fetched again, the chunks that
//! were unpacked last ([`CACHE_BYTES`]).

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use chronotope::dataset::Problem;
use chronotope::error::{Error, Result};
use mcap::records::op;

use super::chunk::{too_large, unpacked};
use super::record::{self, Chunk, Record, Records};
use super::types::{
    MAX_MESSAGE_BYTES, Message, Position, Topic, Visit, Wanted, changed, file_name,
};
use crate::message::{MessageType, Stamp};

/// The byte and the length at the beginning of a record.
const HEAD_BYTES: u64 = record::HEAD_BYTES as u64;
/// Bytes of unpacked messages that are kept, unless one chunk alone has more.
const CACHE_BYTES: usize = 128 << 20;

/// An MCAP file that is open.
#[derive(Debug)]
pub(super) struct LogFile {
    /// As it was named.
    path: PathBuf,
    file: File,
    num_bytes: u64,
    number: u32,
    cache: Mutex<Cache>,
}

/// The images of a chunk by the number of their messages in it: nothing else is fetched again.
type Unpacked = Arc<HashMap<u32, Vec<u8>>>;

#[derive(Debug, Default)]
struct Cache {
    /// The channels of images.
    channels: Vec<u16>,
    /// The one used last is the last; with the bytes of its messages.
    chunks: VecDeque<(u64, Unpacked, usize)>,
}

impl Cache {
    fn get(&mut self, at: u64) -> Option<Unpacked> {
        let position = self.chunks.iter().position(|(chunk, ..)| *chunk == at)?;
        let chunk = self.chunks.remove(position)?;
        let messages = Arc::clone(&chunk.1);
        self.chunks.push_back(chunk);
        Some(messages)
    }

    fn put(&mut self, at: u64, messages: &Unpacked) {
        let num_bytes = messages.values().map(Vec::len).sum();
        self.chunks.push_back((at, Arc::clone(messages), num_bytes));
        let sum = |chunks: &VecDeque<(u64, Unpacked, usize)>| -> usize {
            chunks.iter().map(|(.., bytes)| bytes).sum()
        };
        while self.chunks.len() > 1 && sum(&self.chunks) > CACHE_BYTES {
            self.chunks.pop_front();
        }
    }
}

/// What is known of channels so far.
#[derive(Debug, Default)]
struct Channels {
    schemas: HashMap<u16, String>,
    /// With whether it is wanted.
    topics: HashMap<u16, (Topic, bool)>,
}

impl Channels {
    fn learn(&mut self, record: Record<'_>, is_wanted: &Wanted<'_>) {
        match record {
            Record::Schema { id, name } => {
                self.schemas.insert(id, name.to_owned());
            }
            Record::Channel {
                id,
                schema,
                topic,
                encoding,
            } => {
                let topic = Topic {
                    name: topic.to_owned(),
                    type_name: (self.schemas.get(&schema).cloned()).unwrap_or_default(),
                    encoding: encoding.to_owned(),
                };
                let is_wanted = is_wanted(&topic);
                self.topics.insert(id, (topic, is_wanted));
            }
            _ => {}
        }
    }
}

/// Why the way through a file ends before its end.
enum Stop {
    /// What the visitor failed with.
    Failed(Error),
    /// What is wrong with a record.
    Damaged(String),
}

impl From<String> for Stop {
    fn from(why: String) -> Self {
        Self::Damaged(why)
    }
}

impl LogFile {
    /// `path` is where it is, `named` what people call it.
    pub(super) fn open(path: &Path, named: &Path, number: u32) -> Result<Self> {
        let file = fremen::file::open(path)?;
        let found = file.metadata().map_err(|cause| Error::io(named, cause))?;
        Ok(Self {
            path: named.to_owned(),
            num_bytes: found.len(),
            file,
            number,
            cache: Mutex::default(),
        })
    }

    pub(super) fn scan(
        &self,
        is_wanted: &Wanted<'_>,
        visit: &mut Visit<'_>,
        problems: &mut Vec<Problem>,
    ) -> Result<()> {
        let mut channels = Channels::default();
        let mut at = mcap::MAGIC.len() as u64;
        let mut body = Vec::new();
        loop {
            let (opcode, len) = match self.head(at)? {
                Head::Record { opcode, len } => (opcode, len),
                Head::CutOff(why) => {
                    problems.push(self.cut_off(at, &why));
                    break;
                }
            };
            match opcode {
                // Behind it stands the summary, which says nothing new.
                op::DATA_END | op::FOOTER => break,
                op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK => {
                    let done = if len > MAX_MESSAGE_BYTES {
                        Err(too_large(len).into())
                    } else {
                        self.read_exact(&mut body, at + HEAD_BYTES, len)?;
                        self.take(opcode, &body, at, &mut channels, is_wanted, visit)
                    };
                    match done {
                        Ok(()) => {}
                        Err(Stop::Failed(error)) => return Err(error),
                        Err(Stop::Damaged(why)) => problems.push(self.damaged(at, len, &why)),
                    }
                }
                _ => {}
            }
            at += HEAD_BYTES + len;
        }
        let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        let of_images = channels
            .topics
            .iter()
            .filter(|(_, (topic, _))| topic.message_type().is_some_and(MessageType::is_image));
        cache.channels = of_images.map(|(&id, _)| id).collect();
        cache.chunks.clear();
        Ok(())
    }

    fn take(
        &self,
        opcode: u8,
        body: &[u8],
        at: u64,
        channels: &mut Channels,
        is_wanted: &Wanted<'_>,
        visit: &mut Visit<'_>,
    ) -> std::result::Result<(), Stop> {
        match Record::parse(opcode, body)? {
            Record::Chunk(chunk) => {
                let bytes = unpacked(&chunk)?;
                let mut in_chunk = 0;
                for record in Records::of(&bytes) {
                    let record = record?;
                    channels.learn(record, is_wanted);
                    if let Record::Message { .. } = record {
                        self.show(record, (at, in_chunk), channels, visit)?;
                        in_chunk += 1;
                    }
                }
            }
            record => {
                channels.learn(record, is_wanted);
                self.show(record, (at, 0), channels, visit)?;
            }
        }
        Ok(())
    }

    /// Shows a message; other records say nothing.
    fn show(
        &self,
        message: Record<'_>,
        (record, in_chunk): (u64, u32),
        channels: &Channels,
        visit: &mut Visit<'_>,
    ) -> std::result::Result<(), Stop> {
        let Record::Message {
            channel,
            logged,
            data,
        } = message
        else {
            return Ok(());
        };
        let Some((topic, is_wanted)) = channels.topics.get(&channel) else {
            return Err(Stop::Damaged(format!(
                "a message names channel {channel}, which is not described"
            )));
        };
        if !is_wanted {
            return Ok(());
        }
        let message = Message {
            topic,
            logged: Stamp::from_ns(i64::try_from(logged).unwrap_or(i64::MAX)),
            data,
            position: Position {
                file: self.number,
                record,
                in_chunk,
            },
        };
        visit(&message).map_err(Stop::Failed)
    }

    pub(super) fn read<T>(
        &self,
        position: Position,
        use_data: impl FnOnce(&[u8]) -> Result<T>,
    ) -> Result<T> {
        let known = {
            let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
            cache.get(position.record)
        };
        if let Some(messages) = known {
            let data = (messages.get(&position.in_chunk)).ok_or_else(|| changed(&self.path))?;
            return use_data(data);
        }
        let Head::Record { opcode, len } = self.head(position.record)? else {
            return Err(changed(&self.path));
        };
        if len > MAX_MESSAGE_BYTES {
            return Err(changed(&self.path));
        }
        let mut body = Vec::new();
        self.read_exact(&mut body, position.record + HEAD_BYTES, len)?;
        match Record::parse(opcode, &body) {
            Ok(Record::Message { data, .. }) => use_data(data),
            Ok(Record::Chunk(chunk)) => {
                let messages = Arc::new(self.images_of(&chunk)?);
                let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
                cache.put(position.record, &messages);
                drop(cache);
                let data = (messages.get(&position.in_chunk)).ok_or_else(|| changed(&self.path))?;
                use_data(data)
            }
            _ => Err(changed(&self.path)),
        }
    }

    fn images_of(&self, chunk: &Chunk<'_>) -> Result<HashMap<u32, Vec<u8>>> {
        let channels = {
            let cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
            cache.channels.clone()
        };
        let bytes = unpacked(chunk).map_err(|_| changed(&self.path))?;
        let messages = Records::of(&bytes).filter_map(|record| match record {
            Ok(Record::Message { channel, data, .. }) => Some((channel, data)),
            _ => None,
        });
        Ok((0..)
            .zip(messages)
            .filter(|(_, (channel, _))| channels.contains(channel))
            .map(|(number, (_, data))| (number, data.to_owned()))
            .collect())
    }

    /// What the next record is and how long, if all of it is there.
    fn head(&self, at: u64) -> Result<Head> {
        let left = self.num_bytes.saturating_sub(at);
        if left == 0 {
            return Ok(Head::CutOff("nothing says that this is the end".into()));
        }
        if left < HEAD_BYTES {
            return Ok(Head::CutOff("it ends inside a record".into()));
        }
        let mut head = Vec::new();
        self.read_exact(&mut head, at, HEAD_BYTES)?;
        let mut len = [0; 8];
        len.copy_from_slice(&head[1..]);
        let len = u64::from_le_bytes(len);
        if head[0] == 0 {
            return Ok(Head::CutOff("no record follows, but a zero".into()));
        }
        if len > left - HEAD_BYTES {
            return Ok(Head::CutOff(format!(
                "a record of {len} bytes follows, of which {} are there",
                left - HEAD_BYTES
            )));
        }
        Ok(Head::Record {
            opcode: head[0],
            len,
        })
    }

    fn read_exact(&self, bytes: &mut Vec<u8>, at: u64, len: u64) -> Result<()> {
        bytes.clear();
        bytes.resize(len as usize, 0);
        read_at(&self.file, bytes, at).map_err(|cause| Error::io(&self.path, cause))
    }

    fn cut_off(&self, at: u64, why: &str) -> Problem {
        Problem::new(
            file_name(&self.path),
            format!(
                "the bag was cut off at byte {at} of {}: {why}; it is read up to there (help: `mcap \
                 recover` makes a whole file of it)",
                self.num_bytes
            ),
        )
    }

    fn damaged(&self, at: u64, len: u64, why: &str) -> Problem {
        Problem::new(
            file_name(&self.path),
            format!(
                "bytes {at} to {} are damaged and left out: {why} (help: copy the bag again)",
                at + HEAD_BYTES + len
            ),
        )
    }
}

enum Head {
    Record { opcode: u8, len: u64 },
    CutOff(String),
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, at)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            num_read => {
                bytes = &mut bytes[num_read..];
                at += num_read as u64;
            }
        }
    }
    Ok(())
}

//! What is a message of a bag, and where is it?

use std::path::Path;

use chronotope::error::{Error, ErrorKind, Result};

use crate::message::{MessageType, Stamp};

/// Bytes of one message, of one chunk of messages, and of what they were packed from, at most.
pub(crate) const MAX_MESSAGE_BYTES: u64 = 1 << 28;

/// One topic of a bag.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Topic {
    /// Its name, with the slash in front.
    pub name: String,
    /// The name of its type, such as `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// How its messages are written: `cdr`.
    pub encoding: String,
}

impl Topic {
    /// Which of the known messages it carries, if they can be read.
    pub fn message_type(&self) -> Option<MessageType> {
        MessageType::named(&self.type_name).filter(|_| self.encoding == "cdr")
    }
}

/// Where a message is in a bag.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Position {
    /// The number of the file.
    pub(super) file: u32,
    /// Of an MCAP file the byte of the record, of a database the number of the row.
    pub(super) record: u64,
    /// Of a chunk the number of the message in it.
    pub(super) in_chunk: u32,
}

/// A message on the way through a bag.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Message<'a> {
    pub(crate) topic: &'a Topic,
    /// When it was written to the bag.
    pub(crate) logged: Stamp,
    pub(crate) data: &'a [u8],
    pub(crate) position: Position,
}

/// What is done with each message; what it fails with ends the way.
pub(super) type Visit<'a> = dyn FnMut(&Message<'_>) -> Result<()> + 'a;
/// Which topics matter.
pub(super) type Wanted<'a> = dyn Fn(&Topic) -> bool + 'a;

/// The name of a file, for people.
pub(super) fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// That something is not where it was when the bag was opened.
pub(super) fn changed(path: &Path) -> Error {
    Error::new(ErrorKind::Conflict, "the bag changed while it was read")
        .with_path(path)
        .with_help("wait until nobody writes to it")
}

//! How does a value become bytes, for checksums and digests?

use rusqlite::types::ValueRef;
use sha2::{Digest, Sha256};

/// What takes bytes one after another.
pub trait Sink {
    /// Takes these bytes.
    fn put(&mut self, bytes: &[u8]);
}

impl Sink for Sha256 {
    fn put(&mut self, bytes: &[u8]) {
        self.update(bytes);
    }
}

impl Sink for crc32fast::Hasher {
    fn put(&mut self, bytes: &[u8]) {
        self.update(bytes);
    }
}

impl Sink for Vec<u8> {
    fn put(&mut self, bytes: &[u8]) {
        self.extend_from_slice(bytes);
    }
}

/// One value: a tag, then 8 bytes of an integer or real, or 8 bytes of length and the content; all
/// little-endian.
pub fn put_value(sink: &mut impl Sink, value: ValueRef<'_>) {
    let (tag, number, content): (u8, Option<[u8; 8]>, &[u8]) = match value {
        ValueRef::Null => (0, None, &[]),
        ValueRef::Integer(integer) => (1, Some(integer.to_le_bytes()), &[]),
        ValueRef::Real(real) => (2, Some(real.to_bits().to_le_bytes()), &[]),
        ValueRef::Text(text) => (3, Some((text.len() as u64).to_le_bytes()), text),
        ValueRef::Blob(blob) => (4, Some((blob.len() as u64).to_le_bytes()), blob),
    };
    sink.put(&[tag]);
    if let Some(number) = number {
        sink.put(&number);
    }
    sink.put(content);
}

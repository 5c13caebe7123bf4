//! Which tables has each format, and how does a row become bytes?
//!
//! `maps/README.md` states the same for people, down to the byte. Not for reading or writing files:
//! that is `load` and `store`.

use rusqlite::types::ValueRef;
use sha2::{Digest, Sha256};

use crate::feature::{Descriptor, Features, Keypoint};
use fremen::visibility::BitRow;

/// `Chro` in ASCII, big-endian as SQLite stores it.
pub(in crate::map) const APPLICATION_ID: u32 = 0x4368_726f;
/// The format this code writes (SQLite's `user_version`); it reads all before it, too.
pub(in crate::map) const VERSION: u32 = 2;
/// Features of one place, at most; experiences, too.
pub(in crate::map) const MAX_FEATURES: usize = 1 << 20;
/// Bytes of one text, at most.
pub(crate) const MAX_TEXT_BYTES: usize = 4096;
/// Bytes of the name of an attachment, at most.
pub(in crate::map) const MAX_ATTACHMENT_NAME_BYTES: usize = 64;
/// Bytes of an attachment, at most.
pub(in crate::map) const MAX_ATTACHMENT_BYTES: usize = 1 << 24;

const KEYPOINT_BYTES: usize = 16;
const DESCRIPTOR_BYTES: usize = 32;
const MAX_KEYPOINTS_BYTES: usize = MAX_FEATURES * KEYPOINT_BYTES;
const MAX_DESCRIPTORS_BYTES: usize = MAX_FEATURES * DESCRIPTOR_BYTES;
const MAX_BITS_BYTES: usize = MAX_FEATURES / 8;

/// One table: its first column is the row id, its last the checksum.
#[derive(Debug)]
pub(in crate::map) struct Table {
    pub(in crate::map) name: &'static str,
    pub(in crate::map) create: &'static str,
    /// Columns without the checksum.
    pub(in crate::map) columns: &'static [&'static str],
    /// Columns of varying length with the most bytes each may have.
    pub(in crate::map) limits: &'static [(&'static str, usize)],
}

pub(in crate::map) const GENERATION: Table = Table {
    name: "generation",
    create: "CREATE TABLE generation (number INTEGER PRIMARY KEY, parent INTEGER, \
             prunes INTEGER NOT NULL, time_us INTEGER NOT NULL, meta INTEGER NOT NULL, \
             edges INTEGER NOT NULL, num_places INTEGER NOT NULL, num_visits INTEGER NOT NULL, \
             num_features INTEGER NOT NULL, digest BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &GENERATION_COLUMNS,
    limits: &[("digest", 32)],
};

const GENERATION_COLUMNS: [&str; 10] = [
    "number",
    "parent",
    "prunes",
    "time_us",
    "meta",
    "edges",
    "num_places",
    "num_visits",
    "num_features",
    "digest",
];

/// The same table in format 1, where a generation's parent is the one before it.
pub(in crate::map) const GENERATION_1: Table = Table {
    name: "generation",
    create: "CREATE TABLE generation (number INTEGER PRIMARY KEY, time_us INTEGER NOT NULL, \
             meta INTEGER NOT NULL, edges INTEGER NOT NULL, num_places INTEGER NOT NULL, \
             num_visits INTEGER NOT NULL, num_features INTEGER NOT NULL, digest BLOB NOT NULL, \
             crc INTEGER NOT NULL) STRICT",
    columns: &{
        let [number, _parent, _prunes, a, b, c, d, e, f, g] = GENERATION_COLUMNS;
        [number, a, b, c, d, e, f, g]
    },
    limits: &[("digest", 32)],
};

pub(in crate::map) const META: Table = Table {
    name: "meta",
    create: "CREATE TABLE meta (generation INTEGER PRIMARY KEY, uuid BLOB NOT NULL, \
             extractor TEXT NOT NULL, image_width INTEGER, image_height INTEGER, crop_x INTEGER, \
             crop_y INTEGER, crop_width INTEGER, crop_height INTEGER, preset TEXT NOT NULL, \
             zone TEXT, crc INTEGER NOT NULL) STRICT",
    columns: &[
        "generation",
        "uuid",
        "extractor",
        "image_width",
        "image_height",
        "crop_x",
        "crop_y",
        "crop_width",
        "crop_height",
        "preset",
        "zone",
    ],
    limits: &[
        ("uuid", 16),
        ("extractor", MAX_TEXT_BYTES),
        ("preset", MAX_TEXT_BYTES),
        ("zone", MAX_TEXT_BYTES),
    ],
};

pub(in crate::map) const EDGE: Table = Table {
    name: "edge",
    create: "CREATE TABLE edge (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             origin TEXT NOT NULL, destination TEXT NOT NULL, name TEXT NOT NULL, \
             crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "origin", "destination", "name"],
    limits: &[
        ("origin", MAX_TEXT_BYTES),
        ("destination", MAX_TEXT_BYTES),
        ("name", MAX_TEXT_BYTES),
    ],
};

pub(in crate::map) const PLACE: Table = Table {
    name: "place",
    create: "CREATE TABLE place (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             key TEXT NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "key"],
    limits: &[("key", MAX_TEXT_BYTES)],
};

pub(in crate::map) const POSE: Table = Table {
    name: "pose",
    create: "CREATE TABLE pose (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             place INTEGER NOT NULL, x REAL, y REAL, z REAL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "place", "x", "y", "z"],
    limits: &[],
};

pub(in crate::map) const VISIT: Table = Table {
    name: "visit",
    create: "CREATE TABLE visit (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             place INTEGER NOT NULL, number INTEGER NOT NULL, visit BLOB NOT NULL, \
             session BLOB NOT NULL, time_us INTEGER NOT NULL, source TEXT NOT NULL, \
             appearance_use TEXT NOT NULL, num_features INTEGER NOT NULL, seen BLOB NOT NULL, \
             hidden BLOB, located_by BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &[
        "id",
        "generation",
        "place",
        "number",
        "visit",
        "session",
        "time_us",
        "source",
        "appearance_use",
        "num_features",
        "seen",
        "hidden",
        "located_by",
    ],
    limits: &[
        ("visit", 16),
        ("session", 16),
        ("source", MAX_TEXT_BYTES),
        ("appearance_use", MAX_TEXT_BYTES),
        ("seen", MAX_BITS_BYTES),
        ("hidden", MAX_BITS_BYTES),
        ("located_by", MAX_BITS_BYTES),
    ],
};

pub(in crate::map) const FEATURE: Table = Table {
    name: "feature",
    create: "CREATE TABLE feature (visit INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             keypoints BLOB NOT NULL, descriptors BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["visit", "generation", "keypoints", "descriptors"],
    limits: &[
        ("keypoints", MAX_KEYPOINTS_BYTES),
        ("descriptors", MAX_DESCRIPTORS_BYTES),
    ],
};

pub(in crate::map) const APPEARANCE: Table = Table {
    name: "appearance",
    create: "CREATE TABLE appearance (visit INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             keypoints BLOB NOT NULL, descriptors BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["visit", "generation", "keypoints", "descriptors"],
    limits: &[
        ("keypoints", MAX_KEYPOINTS_BYTES),
        ("descriptors", MAX_DESCRIPTORS_BYTES),
    ],
};

pub(in crate::map) const ATTACHMENT: Table = Table {
    name: "attachment",
    create: "CREATE TABLE attachment (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             name TEXT NOT NULL, value BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "name", "value"],
    limits: &[
        ("name", MAX_ATTACHMENT_NAME_BYTES),
        ("value", MAX_ATTACHMENT_BYTES),
    ],
};

/// Every table of format 1, in order of creation.
pub(in crate::map) const TABLES_1: [&Table; 8] = [
    &GENERATION_1,
    &META,
    &EDGE,
    &PLACE,
    &POSE,
    &VISIT,
    &FEATURE,
    &APPEARANCE,
];

/// Every table of today's format, in order of creation.
pub(in crate::map) const TABLES: [&Table; 9] = [
    &GENERATION,
    &META,
    &EDGE,
    &PLACE,
    &POSE,
    &VISIT,
    &FEATURE,
    &APPEARANCE,
    &ATTACHMENT,
];

/// Every table of a format that this code reads.
pub(in crate::map) fn tables_of(version: u32) -> &'static [&'static Table] {
    match version {
        1 => &TABLES_1,
        _ => &TABLES,
    }
}

/// What takes bytes one after another.
pub(in crate::map) trait Sink {
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
pub(in crate::map) fn put_value(sink: &mut impl Sink, value: ValueRef<'_>) {
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

/// The checksum of a row: CRC-32 over the table's name and every column before `crc`.
pub(in crate::map) fn row_crc(table: &Table, values: &[ValueRef<'_>]) -> u32 {
    let mut crc = crc32fast::Hasher::new();
    crc.put(table.name.as_bytes());
    for &value in values {
        put_value(&mut crc, value);
    }
    crc.finalize()
}

/// Where in a row its single flipped bit is: the column (`None`: the checksum itself) and the byte
/// in it; `None` if more than one bit of the row differs from what was written.
///
/// CRC-32 is linear and its polynomial primitive, so each single flip within 2^32 bits has a
/// syndrome of its own: step it backwards from the end until it meets the observed one. O(bytes).
pub(in crate::map) fn locate_flip(
    table: &Table,
    values: &[ValueRef<'_>],
    stored: u32,
) -> Option<(Option<&'static str>, usize)> {
    let mut record = table.name.as_bytes().to_vec();
    let mut ends = Vec::with_capacity(values.len());
    for &value in values {
        put_value(&mut record, value);
        ends.push(record.len());
    }
    let syndrome = crc32fast::hash(&record) ^ stored;
    if syndrome.is_power_of_two() {
        return Some((None, syndrome.trailing_zeros() as usize / 8));
    }
    let step = |state: u32| {
        (0..8).fold(state, |s, _| {
            if s & 1 == 1 {
                s >> 1 ^ 0xedb8_8320
            } else {
                s >> 1
            }
        })
    };
    let mut flips: [u32; 8] = std::array::from_fn(|bit| step(1 << bit));
    let from_end = (0..record.len()).find(|_| {
        let found = flips.contains(&syndrome);
        if !found {
            flips = flips.map(step);
        }
        found
    })?;
    let at = record.len() - 1 - from_end;
    let column = ends.iter().position(|&end| at < end)?;
    let content = match values[column] {
        ValueRef::Text(content) | ValueRef::Blob(content) => content.len(),
        ValueRef::Integer(_) | ValueRef::Real(_) => 8,
        ValueRef::Null => 0,
    };
    let start = ends[column] - content;
    (at >= start).then(|| (Some(table.columns[column]), at - start))
}

/// A blob or text that cannot be what was written: at which byte and why.
#[derive(Debug, PartialEq)]
pub(in crate::map) struct Malformed {
    pub(in crate::map) byte: usize,
    pub(in crate::map) message: String,
}

/// Bit `i` at bit `i % 8` of byte `i / 8`.
pub(in crate::map) fn encode_bits(row: &BitRow) -> Vec<u8> {
    let mut bytes: Vec<u8> = row.words().iter().flat_map(|w| w.to_le_bytes()).collect();
    bytes.truncate(row.len().div_ceil(8));
    bytes
}

pub(in crate::map) fn decode_bits(bytes: &[u8], len: usize) -> Result<BitRow, Malformed> {
    if bytes.len() != len.div_ceil(8) {
        return Err(Malformed {
            byte: bytes.len().min(len.div_ceil(8)),
            message: format!(
                "{} bytes, where {len} bits need {}",
                bytes.len(),
                len.div_ceil(8)
            ),
        });
    }
    let words = bytes
        .chunks(8)
        .map(|chunk| {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            u64::from_le_bytes(word)
        })
        .collect();
    BitRow::from_words(words, len).map_err(|_| Malformed {
        byte: bytes.len() - 1,
        message: format!("a bit past the end of {len} is one"),
    })
}

/// 16 bytes each: x, y, size, response as 32-bit floats.
pub(in crate::map) fn encode_keypoints(keypoints: &[Keypoint]) -> Vec<u8> {
    keypoints
        .iter()
        .flat_map(|k| [k.x, k.y, k.size, k.response])
        .flat_map(f32::to_le_bytes)
        .collect()
}

/// 32 bytes each, in OpenCV's order.
pub(in crate::map) fn encode_descriptors(descriptors: &[Descriptor]) -> Vec<u8> {
    descriptors.iter().flat_map(|d| d.to_bytes()).collect()
}

pub(in crate::map) fn decode_keypoints(bytes: &[u8]) -> Result<Vec<Keypoint>, Malformed> {
    whole(bytes, KEYPOINT_BYTES, "keypoints")?;
    let (floats, _) = bytes.as_chunks::<4>();
    if let Some(at) = floats
        .iter()
        .position(|&float| !f32::from_le_bytes(float).is_finite())
    {
        return Err(Malformed {
            byte: at * 4,
            message: "a keypoint's number is not finite".into(),
        });
    }
    let (keypoints, _) = floats.as_chunks::<4>();
    Ok(keypoints
        .iter()
        .map(|&[x, y, size, response]| Keypoint {
            x: f32::from_le_bytes(x),
            y: f32::from_le_bytes(y),
            size: f32::from_le_bytes(size),
            response: f32::from_le_bytes(response),
        })
        .collect())
}

pub(in crate::map) fn decode_descriptors(bytes: &[u8]) -> Result<Vec<Descriptor>, Malformed> {
    whole(bytes, DESCRIPTOR_BYTES, "descriptors")?;
    let (descriptors, _) = bytes.as_chunks::<DESCRIPTOR_BYTES>();
    Ok(descriptors
        .iter()
        .map(|&bytes| Descriptor::from_bytes(bytes))
        .collect())
}

fn whole(bytes: &[u8], unit: usize, what: &str) -> Result<(), Malformed> {
    if bytes.len().is_multiple_of(unit) {
        Ok(())
    } else {
        Err(Malformed {
            byte: bytes.len() / unit * unit,
            message: format!("{} bytes are no whole number of {what}", bytes.len()),
        })
    }
}

pub(in crate::map) fn pair(
    keypoints: Vec<Keypoint>,
    descriptors: Vec<Descriptor>,
) -> Result<Features, Malformed> {
    let byte = descriptors.len().min(keypoints.len()) * DESCRIPTOR_BYTES;
    Features::from_parts(keypoints, descriptors).map_err(|error| Malformed {
        byte,
        message: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_survive(bits in proptest::collection::vec(any::<bool>(), 0..200)) {
            let mut row = BitRow::zeros(bits.len());
            for (i, _) in bits.iter().enumerate().filter(|(_, bit)| **bit) {
                row.set(i);
            }
            prop_assert_eq!(decode_bits(&encode_bits(&row), bits.len()), Ok(row));
        }

        #[test]
        fn a_single_flip_is_located(
            blob in proptest::collection::vec(any::<u8>(), 1..300),
            at in any::<prop::sample::Index>(),
            bit in 0..8_u8,
        ) {
            let values = |blob: &[u8]| row_crc(&PLACE, &[
                ValueRef::Integer(7), ValueRef::Integer(1), ValueRef::Blob(blob)]);
            let stored = values(&blob);
            let at = at.index(blob.len());
            let mut damaged = blob.clone();
            damaged[at] ^= 1_u8 << bit;
            let row = [ValueRef::Integer(7), ValueRef::Integer(1), ValueRef::Blob(&damaged)];
            prop_assert_eq!(locate_flip(&PLACE, &row, stored), Some((Some("key"), at)));
            let row = [ValueRef::Integer(7), ValueRef::Integer(1), ValueRef::Blob(&blob)];
            prop_assert_eq!(locate_flip(&PLACE, &row, stored ^ 0x100), Some((None, 1)));
        }
    }

    #[test]
    fn what_does_not_fit_is_named_by_byte() {
        assert_eq!(decode_bits(&[0xff, 0x08], 11).expect_err("surplus").byte, 1);
        assert_eq!(decode_bits(&[0xff], 11).expect_err("short").byte, 1);
        assert_eq!(decode_keypoints(&[0; 17]).expect_err("odd").byte, 16);
        let mut infinite = [0; 32];
        infinite[20..24].copy_from_slice(&f32::INFINITY.to_le_bytes());
        assert_eq!(decode_keypoints(&infinite).expect_err("infinite").byte, 20);
    }

    #[test]
    fn every_table_names_its_columns_and_limits_in_order() {
        for &table in TABLES_1.iter().chain(&TABLES) {
            let mut rest = table.create;
            for column in table.columns.iter().chain(&["crc"]) {
                let at = rest.find(&format!("{column} ")).expect("in order");
                rest = &rest[at + column.len()..];
            }
            for (column, _) in table.limits {
                assert!(table.columns.contains(column), "{}.{column}", table.name);
            }
        }
    }
}

//! What does this record of an MCAP file say?
//!
//! Only what a bag is read for (<https://mcap.dev/spec#records>): numbers are little endian, texts begin
//! with their length. The readers of the crate `mcap` believe every length, so that a made-up one is more
//! memory than there is, or more than a number holds; here none is believed.

use mcap::records::op;

/// The byte and the length at the beginning of a record.
pub(super) const HEAD_BYTES: usize = 9;

/// One record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Record<'a> {
    Schema {
        id: u16,
        name: &'a str,
    },
    Channel {
        id: u16,
        schema: u16,
        topic: &'a str,
        encoding: &'a str,
    },
    Message {
        channel: u16,
        /// Nanoseconds since 1970.
        logged: u64,
        data: &'a [u8],
    },
    Chunk(Chunk<'a>),
    /// One of those that a bag is not read for.
    Other,
}

/// Records that were packed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Chunk<'a> {
    pub(super) unpacked_bytes: u64,
    /// CRC-32 of the unpacked bytes; 0 for none.
    pub(super) checksum: u32,
    /// Empty where nothing is packed.
    pub(super) compression: &'a str,
    pub(super) packed: &'a [u8],
}

impl<'a> Record<'a> {
    /// Fails with what is wrong with it.
    pub(super) fn parse(opcode: u8, body: &'a [u8]) -> Result<Self, String> {
        let mut left = Left(body);
        Ok(match opcode {
            op::SCHEMA => Self::Schema {
                id: left.u16()?,
                name: left.text()?,
            },
            op::CHANNEL => Self::Channel {
                id: left.u16()?,
                schema: left.u16()?,
                topic: left.text()?,
                encoding: left.text()?,
            },
            op::MESSAGE => {
                let channel = left.u16()?;
                let _number = left.u32()?;
                let logged = left.u64()?;
                let _published = left.u64()?;
                Self::Message {
                    channel,
                    logged,
                    data: left.0,
                }
            }
            op::CHUNK => {
                let (_first, _last) = (left.u64()?, left.u64()?);
                let (unpacked_bytes, checksum) = (left.u64()?, left.u32()?);
                let compression = left.text()?;
                let num_packed = left.u64()?;
                Self::Chunk(Chunk {
                    unpacked_bytes,
                    checksum,
                    compression,
                    packed: left.bytes(num_packed)?,
                })
            }
            _ => Self::Other,
        })
    }
}

/// One record after another, up to the end or to the first that is none.
pub(super) struct Records<'a>(&'a [u8]);

impl<'a> Records<'a> {
    pub(super) fn of(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    fn read(&mut self) -> Result<Record<'a>, String> {
        let mut left = Left(self.0);
        let opcode = left.array::<1>()?[0];
        let len = left.u64()?;
        let body = left.bytes(len)?;
        self.0 = left.0;
        Record::parse(opcode, body)
    }
}

impl<'a> Iterator for Records<'a> {
    type Item = Result<Record<'a>, String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let record = self.read();
        if record.is_err() {
            self.0 = &[];
        }
        Some(record)
    }
}

/// What is left of a record.
struct Left<'a>(&'a [u8]);

impl<'a> Left<'a> {
    fn bytes(&mut self, len: u64) -> Result<&'a [u8], String> {
        let found = usize::try_from(len).ok();
        let Some((bytes, left)) = found.and_then(|len| self.0.split_at_checked(len)) else {
            return Err(format!(
                "{len} bytes should follow, of which {} are there",
                self.0.len()
            ));
        };
        self.0 = left;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut array = [0; N];
        array.copy_from_slice(self.bytes(N as u64)?);
        Ok(array)
    }

    fn u16(&mut self) -> Result<u16, String> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, String> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Result<&'a str, String> {
        let len = self.u32()?;
        let bytes = self.bytes(len.into())?;
        std::str::from_utf8(bytes).map_err(|_| "a name is not UTF-8".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::io::Cursor;

    use mcap::records::{ChunkHeader, MessageHeader, SchemaHeader};
    use mcap::{Compression, WriteOptions, Writer};

    use super::*;

    /// A bag as the crate `mcap` writes it, without its first bytes.
    fn written() -> Vec<u8> {
        let options = WriteOptions::new().compression(Some(Compression::Zstd));
        let mut bytes = Vec::new();
        let mut writer = Writer::with_options(Cursor::new(&mut bytes), options).expect("in memory");
        let schema = (writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data"))
            .expect("in memory");
        let channel =
            (writer.add_channel(schema, "/place", "cdr", &[("a".into(), "b".into())].into()))
                .expect("in memory");
        let header = MessageHeader {
            channel_id: channel,
            sequence: 3,
            log_time: 5,
            publish_time: 8,
        };
        (writer.write_to_known_channel(&header, b"kitchen")).expect("in memory");
        writer.finish().expect("in memory");
        drop(writer);
        bytes.split_off(mcap::MAGIC.len())
    }

    /// What the crate `mcap` reads, in our words.
    fn theirs<'a>(record: &'a mcap::records::Record<'_>) -> Record<'a> {
        use mcap::records::Record as Theirs;
        match record {
            Theirs::Schema {
                header: SchemaHeader { id, name, .. },
                ..
            } => Record::Schema { id: *id, name },
            Theirs::Channel(it) => Record::Channel {
                id: it.id,
                schema: it.schema_id,
                topic: &it.topic,
                encoding: &it.message_encoding,
            },
            Theirs::Message { header, data } => Record::Message {
                channel: header.channel_id,
                logged: header.log_time,
                data,
            },
            Theirs::Chunk {
                header:
                    ChunkHeader {
                        uncompressed_size,
                        uncompressed_crc,
                        compression,
                        ..
                    },
                data,
            } => Record::Chunk(Chunk {
                unpacked_bytes: *uncompressed_size,
                checksum: *uncompressed_crc,
                compression,
                packed: data,
            }),
            _ => Record::Other,
        }
    }

    #[test]
    fn records_are_those_that_another_reader_finds() {
        let bytes = written();
        let ends = bytes.len() - mcap::MAGIC.len();
        let mut num_compared = [0; 2];
        let mut compare = |bytes: &[u8], kind: usize| -> Vec<Vec<u8>> {
            let mut chunks = Vec::new();
            let mut left = Left(bytes);
            for record in Records::of(bytes) {
                let opcode = left.array::<1>().expect("as ours")[0];
                let len = left.u64().expect("as ours");
                let body = left.bytes(len).expect("as ours");
                let other = mcap::read::parse_record(opcode, body).expect("a record");
                let record = record.expect("a record");
                assert_eq!(record, theirs(&other));
                num_compared[kind] += 1;
                if let Record::Chunk(chunk) = record {
                    chunks.push(
                        super::super::chunk::unpacked(&chunk)
                            .map(Cow::into_owned)
                            .expect("whole"),
                    );
                }
            }
            chunks
        };
        let chunks = compare(&bytes[..ends], 0);
        for chunk in &chunks {
            compare(chunk, 1);
        }
        assert!(
            num_compared[0] > 3 && num_compared[1] == 3,
            "{num_compared:?}"
        );
    }

    #[test]
    fn no_length_is_believed() {
        let bytes = written();
        for end in 0..bytes.len() {
            for record in Records::of(&bytes[..end]) {
                drop(record);
            }
        }
        for opcode in [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::CHUNK] {
            // Every number that is read, among them every length, is the largest.
            for len in 0..64 {
                assert_eq!(
                    Record::parse(opcode, &vec![0xff; len]).is_ok(),
                    opcode == op::MESSAGE && len >= 22
                );
            }
        }
        let name = [&[0; 2][..], &2_u32.to_le_bytes(), &[0xc3, 0x28]].concat();
        let error = Record::parse(op::SCHEMA, &name).expect_err("no text");
        assert!(error.contains("UTF-8"), "{error}");
    }
}

//! Which bytes were packed into this chunk of an MCAP file?

use std::borrow::Cow;
use std::io::Read;

use super::record::{Chunk, Records};
use super::types::MAX_MESSAGE_BYTES;

/// Room is made for so many times the packed bytes at once; for more, once they are there.
const USUAL_RATIO: usize = 64;

/// The bytes of a chunk, which are as many and have the checksum that it says, and are records all of them; or what
/// is wrong with it.
pub(super) fn unpacked<'a>(chunk: &Chunk<'a>) -> Result<Cow<'a, [u8]>, String> {
    let num_bytes = chunk.unpacked_bytes;
    if num_bytes > MAX_MESSAGE_BYTES {
        return Err(too_large(num_bytes));
    }
    let bytes = match chunk.compression {
        "" => Cow::Borrowed(chunk.packed),
        "zstd" => read(zstd::Decoder::with_buffer(chunk.packed), chunk)?,
        "lz4" => read(lz4::Decoder::new(chunk.packed), chunk)?,
        other => {
            return Err(format!(
                "it is packed with `{}`; zstd and lz4 are read",
                other.escape_debug()
            ));
        }
    };
    if bytes.len() as u64 != num_bytes {
        return Err(format!(
            "it does not hold the {num_bytes} bytes that it says"
        ));
    }
    if chunk.checksum != 0 && chunk.checksum != crc32fast::hash(&bytes) {
        return Err("its checksum does not fit".into());
    }
    Records::of(&bytes).try_for_each(|record| record.map(drop))?;
    Ok(bytes)
}

/// At most one byte more than there should be.
fn read<'a>(
    decoder: std::io::Result<impl Read>,
    chunk: &Chunk<'_>,
) -> Result<Cow<'a, [u8]>, String> {
    let usual = USUAL_RATIO.saturating_mul(chunk.packed.len());
    let mut bytes = Vec::with_capacity(usual.min(chunk.unpacked_bytes as usize));
    decoder
        .and_then(|decoder| {
            decoder
                .take(chunk.unpacked_bytes + 1)
                .read_to_end(&mut bytes)
        })
        .map_err(|cause| format!("it cannot be unpacked: {cause}"))?;
    Ok(Cow::Owned(bytes))
}

/// What is said of more bytes than are read.
pub(super) fn too_large(num_bytes: u64) -> String {
    format!("{num_bytes} bytes in one piece, where at most {MAX_MESSAGE_BYTES} are read")
}

#[cfg(test)]
mod tests {
    use mcap::records::op;

    use super::*;

    /// A record of any kind, with any length.
    fn record(opcode: u8, len: u64, body: &[u8]) -> Vec<u8> {
        [&[opcode][..], &len.to_le_bytes(), body].concat()
    }

    fn message() -> Vec<u8> {
        record(op::MESSAGE, 30, b"22 bytes before content.......")
    }

    const ALL: [&str; 3] = ["", "zstd", "lz4"];

    fn packed(compression: &str, bytes: &[u8]) -> Vec<u8> {
        match compression {
            "zstd" => zstd::encode_all(bytes, 1).expect("packed"),
            "lz4" => {
                let mut encoder = (lz4::EncoderBuilder::new().build(Vec::new())).expect("memory");
                std::io::copy(&mut &bytes[..], &mut encoder).expect("packed");
                encoder.finish().0
            }
            _ => bytes.to_vec(),
        }
    }

    fn chunk<'a>(compression: &'a str, bytes: &[u8], packed: &'a [u8]) -> Chunk<'a> {
        Chunk {
            unpacked_bytes: bytes.len() as u64,
            checksum: crc32fast::hash(bytes),
            compression,
            packed,
        }
    }

    #[test]
    fn bytes_come_back_however_they_were_packed() {
        let attachment = record(op::ATTACHMENT, 2, b"no");
        let bytes = [message(), attachment, message()].concat();
        for bytes in [&bytes[..], &[]] {
            for compression in ALL {
                let packed = packed(compression, bytes);
                let found = unpacked(&chunk(compression, bytes, &packed)).expect("whole");
                assert_eq!(found, bytes, "{compression}");
            }
        }
    }

    #[test]
    fn a_length_that_cannot_be_is_an_error() {
        let mut wrong = vec![[message(), b"8 bytes.".to_vec()].concat()];
        for len in [4, 1 << 20, 1 << 45, u64::MAX - 9, u64::MAX - 8, u64::MAX] {
            for opcode in [op::MESSAGE, op::CHUNK, 0x99] {
                wrong.push([message(), record(opcode, len, b"...")].concat());
            }
        }
        for bytes in wrong {
            for compression in ALL {
                let packed = packed(compression, &bytes);
                let error = unpacked(&chunk(compression, &bytes, &packed)).expect_err("no record");
                assert!(error.contains("are there"), "{error}");
            }
        }
    }

    #[test]
    fn what_a_chunk_says_of_itself_has_to_be_true() {
        let bytes = [message(), record(0x99, 4096, &[0; 4096])].concat();
        for compression in ALL {
            let packed = packed(compression, &bytes);
            let good = chunk(compression, &bytes, &packed);
            let none = Chunk {
                checksum: 0,
                ..good
            };
            assert!(unpacked(&good).is_ok() && unpacked(&none).is_ok());
            let size = |unpacked_bytes: u64| Chunk {
                unpacked_bytes,
                ..good
            };
            let wrong = [
                Chunk {
                    checksum: good.checksum ^ 1,
                    ..good
                },
                Chunk {
                    compression: "brotli",
                    ..good
                },
                Chunk {
                    packed: &packed[..packed.len() / 2],
                    ..good
                },
                size(good.unpacked_bytes - 1),
                size(good.unpacked_bytes + 1),
                size(MAX_MESSAGE_BYTES + 1),
                size(u64::MAX),
            ];
            for chunk in wrong {
                let found = unpacked(&chunk);
                assert!(found.is_err(), "{chunk:?}");
            }
        }
    }
}

//! Are the strips and tiles of this TIFF inside the file?
//!
//! Only the first directory counts, because only its picture is decoded. Strips that are packed
//! (LZW, `PackBits`, Deflate) do not end in a run of zeros. A `BigTIFF` has offsets of eight bytes,
//! which this walk leaves to the decoder.

use super::fault::{be16, be32, le16, le32, refuse_zero_tail, truncated};
use fremen::error::Result;

const COMPRESSION: usize = 259;
/// Tags of offsets and of lengths: strips, tiles.
const PARTS: [(usize, usize); 2] = [(273, 279), (324, 325)];
/// Compressions without a packing: as they are (1).
const AS_THEY_ARE: usize = 1;
/// No picture within the decoding limits has as many strips.
const MAX_PARTS: usize = 1 << 22;

pub(super) fn check(bytes: &[u8]) -> Result<()> {
    let reader = Reader {
        bytes,
        is_big: bytes.starts_with(b"MM"),
    };
    if reader.short(2) != Some(42) {
        return Ok(());
    }
    let directory = reader.long(4).ok_or_else(truncated)?;
    let count = reader.short(directory).ok_or_else(truncated)?;
    let entry = |tag: usize| {
        (0..count)
            .map(|number| directory + 2 + 12 * number)
            .find(|&at| reader.short(at) == Some(tag))
    };
    if reader.bytes.len() < directory + 2 + 12 * count {
        return Err(truncated());
    }
    let compression = entry(COMPRESSION)
        .and_then(|at| reader.number(at, 0))
        .unwrap_or(AS_THEY_ARE);
    for (offsets, lengths) in PARTS {
        let (Some(offsets), Some(lengths)) = (entry(offsets), entry(lengths)) else {
            continue;
        };
        let num_parts = reader.long(offsets + 4).ok_or_else(truncated)?;
        for part in 0..num_parts.min(MAX_PARTS) {
            let (Some(offset), Some(len)) =
                (reader.number(offsets, part), reader.number(lengths, part))
            else {
                return Err(truncated());
            };
            let data = offset
                .checked_add(len)
                .and_then(|end| bytes.get(offset..end))
                .ok_or_else(truncated)?;
            if compression != AS_THEY_ARE {
                refuse_zero_tail(data, "a strip of pixels")?;
            }
        }
    }
    Ok(())
}

struct Reader<'a> {
    bytes: &'a [u8],
    is_big: bool,
}

impl Reader<'_> {
    fn short(&self, at: usize) -> Option<usize> {
        if self.is_big {
            be16(self.bytes, at)
        } else {
            le16(self.bytes, at)
        }
    }

    fn long(&self, at: usize) -> Option<usize> {
        if self.is_big {
            be32(self.bytes, at)
        } else {
            le32(self.bytes, at)
        }
    }

    /// Number `position` of the values of the directory entry at `entry`.
    fn number(&self, entry: usize, position: usize) -> Option<usize> {
        let (kind, count) = (self.short(entry + 2)?, self.long(entry + 4)?);
        let size = match kind {
            3 => 2,
            4 => 4,
            _ => return None,
        };
        if position >= count {
            return None;
        }
        let start = if count.checked_mul(size)? <= 4 {
            entry + 8
        } else {
            self.long(entry + 8)?
        };
        let at = start.checked_add(position * size)?;
        if size == 2 {
            self.short(at)
        } else {
            self.long(at)
        }
    }
}

//! Are the chunks and partitions of this WebP inside the file?
//!
//! A RIFF file of chunks. The lossy picture (`VP8 `, RFC 6386) has a first partition and up to
//! eight of coefficients, whose sizes its header says; the lossless one (`VP8L`) is one stream that
//! its decoder follows to the end. Neither has a checksum, and the arithmetic code of the lossy one
//! decodes whatever bytes there are, so a part that was never written is told by its zeros.

use super::fault::{damaged, le16, le32, refuse_zero_tail, truncated};
use fremen::error::Result;

/// `RIFF`, the size, `WEBP`.
const HEADER_LEN: usize = 12;

pub(super) fn check(bytes: &[u8]) -> Result<()> {
    let size = le32(bytes, 4).ok_or_else(truncated)?;
    // Some leave out the byte that fills up the last chunk.
    let end = size.saturating_add(8);
    let file = (bytes.get(..end))
        .or_else(|| bytes.get(..end - 1))
        .ok_or_else(truncated)?;
    let mut at = HEADER_LEN;
    let mut has_picture = false;
    while at + 8 <= file.len() {
        let len = le32(file, at + 4).ok_or_else(truncated)?;
        let chunk = file.get(at + 8..at + 8 + len).ok_or_else(truncated)?;
        has_picture |= picture(&file[at..at + 4], chunk)?;
        at += 8 + len + len % 2;
    }
    if has_picture {
        Ok(())
    } else {
        Err(damaged("it has no picture"))
    }
}

/// Whether this is a picture's chunk; an error if it is not whole.
fn picture(kind: &[u8], chunk: &[u8]) -> Result<bool> {
    match kind {
        b"VP8 " => {
            check_partitions(chunk)?;
            refuse_zero_tail(chunk, "its coded data")?;
        }
        b"VP8L" => refuse_zero_tail(chunk, "its coded data")?,
        // A frame of an animation: 16 bytes, then chunks.
        b"ANMF" => {
            let mut at = 16;
            while at + 8 <= chunk.len() {
                let len = le32(chunk, at + 4).ok_or_else(truncated)?;
                let inner = chunk.get(at + 8..at + 8 + len).ok_or_else(truncated)?;
                if matches!(&chunk[at..at + 4], b"VP8 " | b"VP8L") {
                    picture(&chunk[at..at + 4], inner)?;
                }
                at += 8 + len + len % 2;
            }
        }
        _ => return Ok(false),
    }
    Ok(true)
}

/// Whether the first partition lies inside the chunk.
///
/// How many others there are is said inside its arithmetic code; the decoder reads that.
fn check_partitions(chunk: &[u8]) -> Result<()> {
    // Three bytes: a bit for the kind of frame, four more, 19 of the size; ten in all of header.
    let tag = le16(chunk, 0).zip(chunk.get(2));
    let (low, &high) = tag.ok_or_else(truncated)?;
    let len = (low | usize::from(high) << 16) >> 5;
    if len + 10 > chunk.len() {
        return Err(damaged("its first partition is longer than its chunk"));
    }
    Ok(())
}

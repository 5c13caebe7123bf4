//! Are the chunks of this PNG whole that make its picture?
//!
//! Each chunk ends in a CRC-32. Only those that a decoder must understand (an upper-case first
//! letter) are checked: a broken comment costs no pixel. What follows the chunk IEND is not the
//! picture's; where IEND itself is missing, the pixels decide, which the decoder counts.
//!
//! Chunks that change no pixel (texts, profiles, frames of an animation) are left out of what the
//! decoder gets: they may be packed a thousandfold, and it would unpack them.

use std::borrow::Cow;

use super::fault::{be32, damaged, truncated};
use fremen::error::Result;

const SIGNATURE_LEN: usize = 8;
/// Chunks that need not be understood and say something of the pixels: which are transparent, and
/// (the EXIF data) how the picture is turned.
const KEPT: [&[u8]; 2] = [b"tRNS", b"eXIf"];

/// The chunks that make the picture. `check_size` judges width and height, which stand in the first
/// one.
pub(super) fn picture<'a>(
    bytes: &'a [u8],
    check_size: &dyn Fn(u64, u64) -> Result<()>,
) -> Result<Cow<'a, [u8]>> {
    let size = be32(bytes, SIGNATURE_LEN + 8).zip(be32(bytes, SIGNATURE_LEN + 12));
    let (width, height) = size.ok_or_else(truncated)?;
    check_size(width as u64, height as u64)?;
    let mut at = SIGNATURE_LEN;
    let mut has_pixels = false;
    // Where the chunk began from which on nothing was left out.
    let mut begin = 0;
    let mut kept: Option<Vec<u8>> = None;
    while at < bytes.len() {
        let len = be32(bytes, at)
            .filter(|&len| len < 1 << 31)
            .ok_or_else(truncated)?;
        let end = at + 8 + len;
        let (Some(chunk), Some(sum)) = (bytes.get(at + 4..end), be32(bytes, end)) else {
            return Err(truncated());
        };
        let kind = &chunk[..4];
        if kind[0].is_ascii_uppercase() && crc32fast::hash(chunk) as usize != sum {
            return Err(damaged(format_args!(
                "the checksum of its chunk {} at byte {at} is wrong",
                kind.escape_ascii()
            )));
        }
        if kind == b"IEND" {
            break;
        }
        has_pixels |= kind == b"IDAT";
        if !kind[0].is_ascii_uppercase() && !KEPT.contains(&kind) {
            let before = &bytes[begin..at];
            kept.get_or_insert_default().extend_from_slice(before);
            begin = end + 4;
        }
        at = end + 4;
    }
    if !has_pixels {
        return Err(truncated());
    }
    Ok(match kept {
        Some(mut kept) => {
            kept.extend_from_slice(&bytes[begin..]);
            kept.into()
        }
        None => bytes.into(),
    })
}

//! Are the chunks of this PNG whole that make its picture?
//!
//! Each chunk ends in a CRC-32. Only those that a decoder must understand (an upper-case first
//! letter) are checked: a broken comment costs no pixel. What follows the chunk IEND is not the
//! picture's; where IEND itself is missing, the pixels decide, which the decoder counts.

use super::fault::{be32, damaged, truncated};
use fremen::error::Result;

const SIGNATURE_LEN: usize = 8;

/// `check_size` judges width and height, which stand in the first chunk.
pub(super) fn check(bytes: &[u8], check_size: &dyn Fn(u64, u64) -> Result<()>) -> Result<()> {
    let size = be32(bytes, SIGNATURE_LEN + 8).zip(be32(bytes, SIGNATURE_LEN + 12));
    let (width, height) = size.ok_or_else(truncated)?;
    check_size(width as u64, height as u64)?;
    let mut at = SIGNATURE_LEN;
    let mut has_pixels = false;
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
        at = end + 4;
    }
    if has_pixels { Ok(()) } else { Err(truncated()) }
}

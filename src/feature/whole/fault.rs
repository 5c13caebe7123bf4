//! What is wrong with these bytes, and which numbers are in them?

use fremen::error::{Error, ErrorKind, Result};

/// So many zero bytes at the end of compressed pixels are a part of the file that was never
/// written: no coder of the formats here puts out 64 of them.
const ZERO_TAIL_BYTES: usize = 64;

/// The file ends before the picture does.
pub(in crate::feature) fn truncated() -> Error {
    Error::new(ErrorKind::Format, "the image ends early (truncated)")
        .with_help("copy or record it again")
}

/// The file goes on, but not with this picture.
pub(in crate::feature) fn damaged(what: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Format, format!("the image is damaged: {what}"))
        .with_help("copy or record it again")
}

/// An error if compressed pixels end in a part that was never written.
pub(super) fn refuse_zero_tail(data: &[u8], what: &str) -> Result<()> {
    let tail = data.len().saturating_sub(ZERO_TAIL_BYTES);
    let is_zero = data[tail..].iter().all(|&byte| byte == 0);
    if data.len() >= ZERO_TAIL_BYTES && is_zero {
        let zeros = data.iter().rev().take_while(|&&byte| byte == 0).count();
        return Err(damaged(format_args!(
            "{what} ends in {zeros} zero bytes, which were never written"
        )));
    }
    Ok(())
}

/// The big-endian number of two bytes at `at`.
pub(super) fn be16(bytes: &[u8], at: usize) -> Option<usize> {
    let pair = bytes.get(at..at.checked_add(2)?)?;
    Some(usize::from(pair[0]) << 8 | usize::from(pair[1]))
}

/// The big-endian number of four bytes at `at`.
pub(super) fn be32(bytes: &[u8], at: usize) -> Option<usize> {
    Some(be16(bytes, at)? << 16 | be16(bytes, at.checked_add(2)?)?)
}

/// The little-endian number of two bytes at `at`.
pub(super) fn le16(bytes: &[u8], at: usize) -> Option<usize> {
    be16(bytes, at).map(|number| (number & 0xFF) << 8 | number >> 8)
}

/// The little-endian number of four bytes at `at`.
pub(super) fn le32(bytes: &[u8], at: usize) -> Option<usize> {
    Some(le16(bytes, at)? | le16(bytes, at.checked_add(2)?)? << 16)
}

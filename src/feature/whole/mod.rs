//! Is this picture whole?
//!
//! Decoders show what they can: what is missing becomes grey, what is damaged becomes noise, and
//! nobody hears of it. A map would learn that. So every format is walked through once, from its
//! first byte to the end of its (first) picture, without making pixels:
//!
//! - JPEG: every block of every scan is there, and the next marker follows the last one
//!   ([`jpeg`]);
//! - PNG: the checksums of all chunks that make the picture;
//! - WebP and TIFF: every chunk, partition, strip and tile lies inside the file and does not end
//!   in a run of zeros, which compressed pixels never do;
//! - BMP and PNM: the pixels are read one by one by their decoder, which says where they end.
//!
//! What follows the end of the picture (a film, a second picture, padding) is nobody's business
//! here. What cannot be told is not told: a wrong bit in pixels that are stored as they are, or in
//! the arithmetic code of a lossy WebP.
//!
//! Not for: making pixels, or reading metadata ([`exif`](super::exif)).

mod fault;
mod huffman;
mod jpeg;
mod jpeg_scan;
mod png;
mod tiff;
mod webp;

use std::borrow::Cow;

use image::ImageFormat;

pub(super) use fault::{damaged, truncated};
use fremen::error::Result;

/// The bytes of the picture that `bytes` begin with, as its decoder takes them; an error if it is
/// not whole, or of a kind that no decoder here reads.
///
/// `check_size` judges width and height before anything is done that takes time or memory by them.
pub(super) fn picture<'a>(
    bytes: &'a [u8],
    format: ImageFormat,
    check_size: &dyn Fn(u64, u64) -> Result<()>,
) -> Result<Cow<'a, [u8]>> {
    match format {
        ImageFormat::Jpeg => jpeg::picture(bytes, check_size),
        ImageFormat::Png => png::picture(bytes, check_size),
        ImageFormat::WebP => webp::check(bytes).map(|()| bytes.into()),
        ImageFormat::Tiff => tiff::check(bytes).map(|()| bytes.into()),
        _ => Ok(bytes.into()),
    }
}

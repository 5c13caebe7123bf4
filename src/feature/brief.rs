//! What does the neighbourhood of a point look like, as 256 bits (BRIEF-32, upright)?
//!
//! Bit `i` says whether the patch is darker at `a_i` than at `b_i`, two fixed points within 24 px
//! of the keypoint, each smoothed by the mean of a 9x9 box:
//!
//! ```text
//! bit_i = box(x + xa_i, y + ya_i) < box(x + xb_i, y + yb_i)
//! ```
//!
//! The bits are those of OpenCV's `BriefDescriptorExtractor` (32 bytes, no orientation) on the same
//! grey bytes. Source: Calonder, Lepetit, Strecha, Fua: *BRIEF: Binary Robust Independent
//! Elementary Features*, ECCV 2010.
//!
//! A patch with its smoothing reaches [`BORDER_PX`] from the keypoint; keypoints nearer to the
//! image's edge cannot be described. Complexity: 9 additions a pixel and 512 look-ups a keypoint. A
//! box sum is at most 81 * 255, so 16 bits hold it.
//!
//! Not for: images that turn by more than some 15 degrees in the image plane, or change scale by
//! more than some 20 %.

use super::brief_pairs::PAIRS;
use super::{Descriptor, GrayView, Keypoint};
use crate::simd::Kernel;

/// Pixels between a keypoint and the image's edge that its patch needs.
pub const BORDER_PX: usize = REACH_PX + BOX_PX / 2;

/// How far the points of the pairs may lie from the keypoint, px.
const REACH_PX: usize = 24;
/// Side of the smoothing box, px.
const BOX_PX: usize = 9;

/// Buffers that grow to the largest image seen and are then reused.
#[derive(Default)]
pub(super) struct BriefScratch {
    black: Vec<u8>,
    columns: Vec<u16>,
    boxes: Vec<u16>,
    offsets: Vec<(u32, u32)>,
}

/// The pixel that a keypoint lies on.
fn pixel_of(keypoint: &Keypoint) -> (usize, usize) {
    // Negative coordinates and NaN become 0, which is never describable.
    ((keypoint.x + 0.5) as usize, (keypoint.y + 0.5) as usize)
}

/// Whether the patch around `keypoint` lies in an image of this size.
pub(super) fn is_describable(keypoint: &Keypoint, width: usize, height: usize) -> bool {
    let (x, y) = pixel_of(keypoint);
    (BORDER_PX..width.saturating_sub(BORDER_PX)).contains(&x)
        && (BORDER_PX..height.saturating_sub(BORDER_PX)).contains(&y)
}

/// Describes keypoints that are all [describable](is_describable), in their order.
pub(super) fn describe(
    image: GrayView<'_>,
    keypoints: &[Keypoint],
    kernel: Kernel,
    scratch: &mut BriefScratch,
    descriptors: &mut Vec<Descriptor>,
) {
    descriptors.clear();
    if keypoints.is_empty() {
        return;
    }
    let stride = smooth(image, kernel, scratch);
    scratch.offsets.clear();
    scratch
        .offsets
        .extend(PAIRS.iter().map(|&(xa, ya, xb, yb)| {
            let offset = |x: i8, y: i8| {
                let (x, y) = (
                    i32::from(x) + REACH_PX as i32,
                    i32::from(y) + REACH_PX as i32,
                );
                y as u32 * stride as u32 + x as u32
            };
            (offset(xa, ya), offset(xb, yb))
        }));
    descriptors.extend(keypoints.iter().map(|keypoint| {
        // `boxes` begins at the first pixel whose box lies in the image.
        let (x, y) = pixel_of(keypoint);
        let (x, y) = (x - BORDER_PX, y - BORDER_PX);
        let patch = &scratch.boxes[y * stride + x..][..=2 * REACH_PX * (stride + 1)];
        let mut bytes = [0_u8; 32];
        for (byte, offsets) in bytes.iter_mut().zip(scratch.offsets.as_chunks::<8>().0) {
            for &(a, b) in offsets {
                *byte = *byte << 1 | u8::from(patch[a as usize] < patch[b as usize]);
            }
        }
        Descriptor::from_bytes(bytes)
    }));
}

/// Fills `boxes` with the sums of all 9x9 boxes and returns its columns: `width - 8`.
fn smooth(image: GrayView<'_>, kernel: Kernel, scratch: &mut BriefScratch) -> usize {
    let (width, height) = (image.width(), image.height());
    let (across, down) = (width - (BOX_PX - 1), height - (BOX_PX - 1));
    let BriefScratch {
        black,
        columns,
        boxes,
        ..
    } = scratch;
    boxes.resize(across * down, 0);
    black.resize(width, 0);
    columns.clear();
    columns.resize(width, 0);
    for y in 0..BOX_PX - 1 {
        kernel.slide(image.row(y), &black[..width], columns);
    }
    for (y, out) in boxes.chunks_exact_mut(across).enumerate() {
        let above = if y == 0 {
            &black[..width]
        } else {
            image.row(y - 1)
        };
        kernel.slide(image.row(y + BOX_PX - 1), above, columns);
        kernel.add_nine(columns, out);
    }
    across
}

//! Which keypoints stay, and in which order?
//!
//! The rules that all extractors share: masks, and the order by (response descending, y, x).

use super::{GrayImage, GrayView, Keypoint};
use fremen::error::{Error, ErrorKind, Result};

/// A mask of another size than its image is a [`ErrorKind::Shape`] error.
pub(super) fn check_mask(image: GrayView<'_>, mask: Option<&GrayImage>) -> Result<()> {
    match mask {
        Some(mask) if mask.size() != image.size() => Err(Error::new(
            ErrorKind::Shape,
            format!(
                "a mask of {} x {} px does not fit an image of {} x {} px",
                mask.width(),
                mask.height(),
                image.width(),
                image.height()
            ),
        )
        .with_help("make the mask for the image after crop, rotation and scale")),
        _ => Ok(()),
    }
}

/// Drops keypoints whose nearest pixel is zero in `mask`.
pub(super) fn drop_masked(keypoints: &mut Vec<Keypoint>, mask: Option<&GrayImage>) {
    if mask.is_some() {
        keypoints.retain(|keypoint| is_shown(keypoint, mask));
    }
}

/// Whether the pixel that a keypoint is nearest to is not zero in `mask`.
pub(super) fn is_shown(keypoint: &Keypoint, mask: Option<&GrayImage>) -> bool {
    mask.is_none_or(|mask| {
        let (x, y) = ((keypoint.x + 0.5) as usize, (keypoint.y + 0.5) as usize);
        x < mask.width() && y < mask.height() && mask.row(y)[x] != 0
    })
}

/// Sorts by response (descending), then `y`, then `x`.
pub(super) fn sort_keypoints(keypoints: &mut [Keypoint]) {
    keypoints.sort_unstable_by(|a, b| {
        b.response
            .total_cmp(&a.response)
            .then(a.y.total_cmp(&b.y))
            .then(a.x.total_cmp(&b.x))
    });
}

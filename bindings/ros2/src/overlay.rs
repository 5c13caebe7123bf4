//! How are predicted features drawn over an image?
//!
//! Green crosses where they were found, orange ones where they were matched elsewhere, red ones
//! where they are missing: the colours of the answers that go into bags.

use chronotope::feature::GrayImage;
use chronotope_bags::{Answer, State};

use crate::messages::{Header, Image};

/// Pixels from the middle of a cross to its ends.
const ARM_PX: i64 = 4;
/// A picture has at most so many bytes: what is larger than a socket's usual buffer (208 KiB on
/// Linux) does not come whole to those who listen with best effort.
const MAX_BYTES: usize = 200_000;

/// The image in colour with the features of an answer, with every k-th pixel of every k-th row where
/// it would be too large.
pub(crate) fn draw(image: &GrayImage, answer: &Answer<'_>, header: Header) -> Image {
    let bytes_of = |step: usize| 3 * image.width().div_ceil(step) * image.height().div_ceil(step);
    let mut step_px = 1;
    while bytes_of(step_px) > MAX_BYTES {
        step_px += 1;
    }
    let (width, height) = (
        image.width().div_ceil(step_px),
        image.height().div_ceil(step_px),
    );
    let mut data: Vec<u8> = (0..image.height())
        .step_by(step_px)
        .flat_map(|y| image.row(y).iter().step_by(step_px))
        .flat_map(|&it| [it; 3])
        .collect();
    for ([x, y], state) in answer.predicted() {
        let colour = match state {
            State::Inlier => [26, 204, 51],
            State::Outlier => [255, 153, 0],
            State::Missing => [230, 26, 26],
        };
        let [x, y] = [x, y].map(|it| (it / step_px as f64).round() as i64);
        for step in -ARM_PX..=ARM_PX {
            for (x, y) in [(x + step, y), (x, y + step)] {
                let is_inside = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
                if is_inside {
                    let at = 3 * (y as usize * width + x as usize);
                    data[at..at + 3].copy_from_slice(&colour);
                }
            }
        }
    }
    Image {
        header,
        height: height as u32,
        width: width as u32,
        encoding: "rgb8".to_owned(),
        is_bigendian: 0,
        step: 3 * width as u32,
        data,
    }
}

//! How bright is a colour?
//!
//! grey = `(9798 R + 19235 G + 3735 B + 2^14) >> 15`, the weights of ITU-R BT.601 in 15 bits, as
//! OpenCV 4 and 5 take them.

use super::gray::GrayImage;
use fremen::error::{Error, ErrorKind, Result};

impl GrayImage {
    /// The grey of `width * height` pixels of red, green and blue, row by row without padding; any
    /// other number of samples is a [`ErrorKind::Shape`] error.
    pub fn from_rgb(width: usize, height: usize, samples: &[u8]) -> Result<Self> {
        let pixels = pixels_of(width, height, samples)?.iter();
        Self::new(
            width,
            height,
            pixels.map(|p| luma(p[0], p[1], p[2])).collect(),
        )
    }

    /// [`from_rgb`](Self::from_rgb) of samples in the order blue, green, red, as OpenCV keeps them.
    pub fn from_bgr(width: usize, height: usize, samples: &[u8]) -> Result<Self> {
        let pixels = pixels_of(width, height, samples)?.iter();
        Self::new(
            width,
            height,
            pixels.map(|p| luma(p[2], p[1], p[0])).collect(),
        )
    }
}

fn pixels_of(width: usize, height: usize, samples: &[u8]) -> Result<&[[u8; 3]]> {
    let (pixels, rest) = samples.as_chunks::<3>();
    if rest.is_empty() && width.checked_mul(height) == Some(pixels.len()) {
        return Ok(pixels);
    }
    Err(Error::new(
        ErrorKind::Shape,
        format!(
            "{} samples are no colour image of {width} x {height} pixels",
            samples.len()
        ),
    ))
}

/// The grey of every pixel of 8-bit BGR samples.
#[cfg(feature = "opencv")]
pub(super) fn gray_from_bgr(samples: &[u8]) -> Vec<u8> {
    let pixels = samples.as_chunks::<3>().0.iter();
    pixels.map(|p| luma(p[2], p[1], p[0])).collect()
}

/// The grey level of a colour.
pub(super) fn luma(red: u8, green: u8, blue: u8) -> u8 {
    let sum = 9_798 * u32::from(red) + 19_235 * u32::from(green) + 3_735 * u32::from(blue);
    ((sum + (1 << 14)) >> 15) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_become_grey_in_either_order_and_other_numbers_of_samples_are_refused() {
        let rgb = [255, 0, 0, 0, 255, 0, 0, 0, 255, 10, 20, 30];
        let mut bgr = rgb;
        for pixel in bgr.as_chunks_mut::<3>().0 {
            pixel.reverse();
        }
        let gray = GrayImage::from_rgb(2, 2, &rgb).expect("four pixels");
        assert_eq!(gray.data(), [76, 150, 29, 18]);
        assert_eq!(GrayImage::from_bgr(2, 2, &bgr).expect("four pixels"), gray);
        for (width, height) in [(2, 3), (usize::MAX, 2), (0, 0)] {
            let error = GrayImage::from_rgb(width, height, &rgb).expect_err("too few or too many");
            assert_eq!(error.kind(), ErrorKind::Shape);
        }
    }
}

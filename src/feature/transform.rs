//! How is an image cut, turned and scaled, and what of it is masked?
//!
//! Every step is integer arithmetic, so that the same pixels give the same result on every machine.
//! Scaling is bilinear with half-pixel centres: output pixel `i` samples `(i + 0.5) / scale - 0.5`,
//! clamped to the image, with weights in 1/2048 ([`GrayImage::scaled`]).

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{GrayImage, Rect};
use fremen::error::{Error, ErrorKind, Result};

/// A turn by quarters, clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Rotation {
    /// As the file has it.
    #[default]
    #[serde(rename = "0")]
    None,
    /// 90 degrees clockwise: the left column becomes the top row.
    #[serde(rename = "90")]
    Clockwise90,
    /// Upside down.
    #[serde(rename = "180")]
    Half,
    /// 270 degrees clockwise: the right column becomes the top row.
    #[serde(rename = "270")]
    Clockwise270,
}

/// A mask of `width` x `height` px that ignores the pixels of `ignored` (burnt-in text, the robot's
/// own body), in pixels of the image that is extracted. A rectangle that leaves the image is an
/// error.
pub fn mask_from_rects(width: usize, height: usize, ignored: &[Rect]) -> Result<GrayImage> {
    let pixels = width.checked_mul(height).ok_or_else(|| {
        Error::new(
            ErrorKind::Shape,
            format!("a mask of {width} x {height} px is too big"),
        )
    })?;
    let mut mask = GrayImage::new(width, height, vec![255; pixels])?;
    for &rect in ignored {
        let (columns, rows) =
            inside(rect, width, height).map_err(|error| error.with_place("rectangle of a mask"))?;
        for row in mask
            .data_mut()
            .chunks_exact_mut(width)
            .take(rows.end)
            .skip(rows.start)
        {
            row[columns.clone()].fill(0);
        }
    }
    Ok(mask)
}

/// Columns and rows of `rect`, which must have pixels and lie in an image of this size.
fn inside(
    rect: Rect,
    width: usize,
    height: usize,
) -> Result<(std::ops::Range<usize>, std::ops::Range<usize>)> {
    let span = |start: u32, len: u32, end: usize| {
        let (start, len) = (start as usize, len as usize);
        (len > 0 && start.checked_add(len)? <= end).then(|| start..start + len)
    };
    span(rect.x, rect.width, width)
        .zip(span(rect.y, rect.height, height))
        .ok_or_else(|| {
            Error::new(
                ErrorKind::Shape,
                format!(
                    "{} x {} px at ({}, {}) do not lie in an image of {width} x {height} px",
                    rect.width, rect.height, rect.x, rect.y
                ),
            )
            .with_help("a rectangle has pixels and lies inside the turned, unscaled picture")
        })
}

/// Two neighbours along an axis and the weight of the second, in 1/2048.
struct Tap {
    first: usize,
    second: usize,
    first_weight: i32,
    second_weight: i32,
}

/// For every output pixel of an axis of `len` input pixels, what it samples.
fn taps(len: usize, scaled_len: usize, scale: f64) -> Vec<Tap> {
    let step = 1.0 / scale;
    (0..scaled_len)
        .map(|i| {
            let at = ((i as f64 + 0.5) * step - 0.5) as f32;
            let (first, fraction) = if at < 0.0 {
                (0, 0.0)
            } else if at.floor() as usize >= len - 1 {
                (len - 1, 0.0)
            } else {
                (at.floor() as usize, at - at.floor())
            };
            Tap {
                first,
                second: (first + 1).min(len - 1),
                first_weight: ((1.0 - fraction) * 2048.0).round_ties_even() as i32,
                second_weight: (fraction * 2048.0).round_ties_even() as i32,
            }
        })
        .collect()
}

impl GrayImage {
    /// The pixels of `rect`; an error if it is empty or leaves the image.
    pub fn cropped(&self, rect: Rect) -> Result<Self> {
        let (columns, rows) =
            inside(rect, self.width(), self.height()).map_err(|error| error.with_place("crop"))?;
        let mut data = Vec::with_capacity(columns.len() * rows.len());
        for y in rows.clone() {
            data.extend_from_slice(&self.row(y)[columns.clone()]);
        }
        Self::new(columns.len(), rows.len(), data)
    }

    /// Turned by quarters.
    #[must_use]
    pub fn rotated(self, rotation: Rotation) -> Self {
        let (width, height) = (self.width(), self.height());
        let mut image = self;
        match rotation {
            Rotation::None => image,
            Rotation::Half => {
                image.data_mut().reverse();
                image
            }
            Rotation::Clockwise90 | Rotation::Clockwise270 => {
                let mut data = Vec::with_capacity(width * height);
                for i in 0..width {
                    let pixel = |y: usize, x: usize| image.data()[y * width + x];
                    if rotation == Rotation::Clockwise90 {
                        data.extend((0..height).rev().map(|y| pixel(y, i)));
                    } else {
                        data.extend((0..height).map(|y| pixel(y, width - 1 - i)));
                    }
                }
                image.reshape(height, width, data);
                image
            }
        }
    }

    /// Scaled by `scale`, bilinearly with half-pixel centres, to `round(side * scale)` px a side.
    ///
    /// Weights are rounded to 1/2048; the sum along a row keeps 15 bits, each of the two rows of a
    /// column 10, so that results are within one grey level of exact arithmetic. This is the
    /// arithmetic of OpenCV's 8-bit `INTER_LINEAR`. Shrinking below one half skips pixels.
    ///
    /// A factor that is not positive or leaves no pixels is an error.
    pub fn scaled(&self, scale: f64) -> Result<Self> {
        let side = |px: usize| (px as f64 * scale).round_ties_even();
        let (width, height) = (side(self.width()), side(self.height()));
        // `!(a >= b)` also refuses NaN; 2^32 pixels a side is beyond any image.
        let fits = |px: f64| (1.0..=f64::from(u32::MAX)).contains(&px);
        if !(scale > 0.0 && fits(width) && fits(height)) {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "an image of {} x {} px cannot be scaled by {scale}",
                    self.width(),
                    self.height()
                ),
            )
            .with_help("the factor is positive and leaves at least one pixel"));
        }
        let (width, height) = (width as usize, height as usize);
        let columns = taps(self.width(), width, scale);
        let rows = taps(self.height(), height, scale);
        let spread = |y: usize, out: &mut [i32]| {
            let row = self.row(y);
            for (out, tap) in out.iter_mut().zip(&columns) {
                *out = i32::from(row[tap.first]) * tap.first_weight
                    + i32::from(row[tap.second]) * tap.second_weight;
            }
        };
        // The two scaled input rows in use, with the number of the row that each holds.
        let mut upper = (usize::MAX, vec![0_i32; width]);
        let mut lower = (usize::MAX, vec![0_i32; width]);
        let mut data = Vec::with_capacity(width * height);
        for tap in &rows {
            if lower.0 == tap.first {
                std::mem::swap(&mut upper, &mut lower);
            }
            for (held, wanted) in [(&mut upper, tap.first), (&mut lower, tap.second)] {
                if held.0 != wanted {
                    spread(wanted, &mut held.1);
                    held.0 = wanted;
                }
            }
            data.extend(upper.1.iter().zip(&lower.1).map(|(&a, &b)| {
                let a = ((a >> 4) * tap.first_weight) >> 16;
                let b = ((b >> 4) * tap.second_weight) >> 16;
                ((a + b + 2) >> 2) as u8
            }));
        }
        Self::new(width, height, data)
    }

    /// A digest of size and pixels: equal for equal pictures, however they were encoded.
    pub fn digest(&self) -> PixelDigest {
        let mut hash = Sha256::new();
        hash.update((self.width() as u64).to_le_bytes());
        hash.update((self.height() as u64).to_le_bytes());
        hash.update(self.data());
        PixelDigest(hash.finalize().into())
    }
}

/// SHA-256 of an image's width and height (u64, little-endian) and its pixels; shown in
/// hexadecimal.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PixelDigest(pub [u8; 32]);

impl std::fmt::Display for PixelDigest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl std::fmt::Debug for PixelDigest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PixelDigest({self})")
    }
}

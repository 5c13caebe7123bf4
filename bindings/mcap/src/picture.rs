//! Which grey pixels does an image message have?
//!
//! Colours become grey as those of files do, so a message gives the same pixels as the file that it
//! was made of. Of 16 bits the high ones count; of YUV the brightness.
//!
//! Not for Bayer patterns, which a driver or `image_proc` has to interpolate, nor for depth.

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::{DecodeLimits, GrayImage, decode_gray, encoded_size};

use crate::message::{EncodedImage, RawImage};

/// How the pixels of an encoding lie in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pixels {
    /// One byte.
    Gray,
    /// Two bytes.
    Gray16,
    /// So many bytes a pixel, red first.
    Rgb(usize),
    /// So many bytes a pixel, blue first.
    Bgr(usize),
    /// Two bytes a pixel, of which one is the brightness.
    Yuv { offset: usize },
    /// Rows of brightness, then half as many of colour.
    Planes,
}

impl Pixels {
    fn of(encoding: &str) -> Option<Self> {
        Some(match encoding {
            "mono8" | "8UC1" => Self::Gray,
            "mono16" | "16UC1" => Self::Gray16,
            "rgb8" => Self::Rgb(3),
            "rgba8" => Self::Rgb(4),
            "bgr8" | "8UC3" => Self::Bgr(3),
            "bgra8" | "8UC4" => Self::Bgr(4),
            "yuv422" | "uyvy" => Self::Yuv { offset: 1 },
            "yuv422_yuy2" | "yuyv" => Self::Yuv { offset: 0 },
            "nv12" | "nv21" | "nv24" => Self::Planes,
            _ => return None,
        })
    }

    fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Gray | Self::Planes => 1,
            Self::Gray16 | Self::Yuv { .. } => 2,
            Self::Rgb(bytes) | Self::Bgr(bytes) => bytes,
        }
    }
}

/// Columns and rows, without looking at pixels.
pub(crate) fn raw_size(image: &RawImage<'_>, limits: &DecodeLimits) -> Result<(u32, u32)> {
    limits.check(u64::from(image.width), u64::from(image.height))?;
    Ok((image.width, image.height))
}

impl RawImage<'_> {
    /// Its grey pixels, as those of the file that it was made of.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Format`] for an encoding that is not read, [`ErrorKind::Shape`] if there are too
    /// few bytes.
    pub fn to_gray(&self, limits: &DecodeLimits) -> Result<GrayImage> {
        raw(self, limits)
    }
}

impl EncodedImage<'_> {
    /// Its grey pixels.
    ///
    /// # Errors
    ///
    /// As [`decode_gray`] fails.
    pub fn to_gray(&self, limits: &DecodeLimits) -> Result<GrayImage> {
        encoded(self, limits)
    }
}

/// The grey pixels of `sensor_msgs/msg/Image`.
pub(crate) fn raw(image: &RawImage<'_>, limits: &DecodeLimits) -> Result<GrayImage> {
    let (width, height) = raw_size(image, limits)?;
    let (width, height) = (width as usize, height as usize);
    let pixels = Pixels::of(&image.encoding).ok_or_else(|| unknown(&image.encoding))?;
    let row_bytes = width * pixels.bytes_per_pixel();
    // Some drivers leave the step at zero.
    let step = match image.step as usize {
        0 => row_bytes,
        step => step,
    };
    // The last row may lack its padding.
    let needed = step.saturating_mul(height - 1).saturating_add(row_bytes);
    if step < row_bytes || image.data.len() < needed {
        let message = format!(
            "{} bytes with a row every {step} are no image of {width} x {height} px in {}",
            image.data.len(),
            image.encoding
        );
        return Err(
            Error::new(ErrorKind::Shape, message).with_help("the driver that wrote it is wrong")
        );
    }
    let rows = (0..height).map(|y| &image.data[y * step..][..row_bytes]);
    let high = usize::from(!image.is_big_endian);
    let gray = |offset: usize, stride: usize| -> Vec<u8> {
        (rows.clone())
            .flat_map(|row| row.iter().skip(offset).step_by(stride))
            .copied()
            .collect()
    };
    let colours = |bytes: usize| -> Vec<u8> {
        (rows.clone())
            .flat_map(|row| row.chunks_exact(bytes).flat_map(|pixel| &pixel[..3]))
            .copied()
            .collect()
    };
    match pixels {
        Pixels::Gray | Pixels::Planes => GrayImage::new(width, height, gray(0, 1)),
        Pixels::Gray16 => GrayImage::new(width, height, gray(high, 2)),
        Pixels::Yuv { offset } => GrayImage::new(width, height, gray(offset, 2)),
        Pixels::Rgb(bytes) => GrayImage::from_rgb(width, height, &colours(bytes)),
        Pixels::Bgr(bytes) => GrayImage::from_bgr(width, height, &colours(bytes)),
    }
}

/// Columns and rows of `sensor_msgs/msg/CompressedImage`, from the head of the picture.
pub(crate) fn encoded_image_size(
    image: &EncodedImage<'_>,
    limits: &DecodeLimits,
) -> Result<(u32, u32)> {
    encoded_size(picture_of(image)?, limits)
}

/// The grey pixels of `sensor_msgs/msg/CompressedImage`.
pub(crate) fn encoded(image: &EncodedImage<'_>, limits: &DecodeLimits) -> Result<GrayImage> {
    decode_gray(picture_of(image)?, limits)
}

fn picture_of<'a>(image: &EncodedImage<'a>) -> Result<&'a [u8]> {
    if image.format.contains("compressedDepth") {
        return Err(Error::new(ErrorKind::Format, "this is an image of depth")
            .with_help("name the topic of a camera's image"));
    }
    Ok(image.data)
}

fn unknown(encoding: &str) -> Error {
    let error = Error::new(
        ErrorKind::Format,
        format!("images in `{encoding}` cannot be read"),
    );
    if encoding.starts_with("bayer") {
        return error.with_help("record what image_proc makes of it: image_mono or image_color");
    }
    if encoding.contains("32FC") || encoding.contains("64FC") {
        return error.with_help("that is an image of depth or of numbers: name a camera's topic");
    }
    error.with_help(
        "mono8, mono16, rgb8, bgr8, rgba8, bgra8, yuv422, yuv422_yuy2, nv12 and nv21 are read",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image<'a>(encoding: &'a str, step: u32, data: &'a [u8]) -> RawImage<'a> {
        RawImage {
            height: 2,
            width: 2,
            encoding: encoding.into(),
            is_big_endian: false,
            step,
            data,
        }
    }

    #[test]
    fn every_encoding_gives_its_brightness_and_leaves_padding_out() -> Result<()> {
        let limits = DecodeLimits::default();
        let gray =
            |image: &RawImage<'_>| -> Result<Vec<u8>> { Ok(raw(image, &limits)?.data().to_vec()) };
        assert_eq!(gray(&image("mono8", 3, &[1, 2, 0, 3, 4]))?, [1, 2, 3, 4]);
        assert_eq!(gray(&image("mono8", 0, &[1, 2, 3, 4]))?, [1, 2, 3, 4]);
        let wide = image("mono16", 4, &[9, 1, 9, 2, 9, 3, 9, 4]);
        assert_eq!(gray(&wide)?, [1, 2, 3, 4]);
        let other = RawImage {
            is_big_endian: true,
            ..wide
        };
        assert_eq!(gray(&other)?, [9, 9, 9, 9]);
        assert_eq!(
            gray(&image("yuv422", 4, &[9, 1, 9, 2, 9, 3, 9, 4]))?,
            [1, 2, 3, 4]
        );
        assert_eq!(gray(&image("nv12", 2, &[1, 2, 3, 4, 9, 9]))?, [1, 2, 3, 4]);
        let red = [255, 0, 0, 255, 0, 0, 255, 0, 0, 255, 0, 0];
        assert_eq!(gray(&image("rgb8", 6, &red))?, [76; 4]);
        assert_eq!(gray(&image("bgr8", 6, &red))?, [29; 4]);
        let with_alpha = [0, 0, 255, 7, 0, 0, 255, 7, 0, 0, 255, 7, 0, 0, 255, 7];
        assert_eq!(gray(&image("bgra8", 8, &with_alpha))?, [76; 4]);
        Ok(())
    }

    #[test]
    fn what_is_no_image_is_refused_with_what_helps() {
        let limits = DecodeLimits::default();
        let error = |image: RawImage<'_>| raw(&image, &limits).expect_err("no image").to_string();
        assert!(error(image("mono8", 2, &[1, 2, 3])).contains("3 bytes"));
        assert!(error(image("mono8", 1, &[1, 2, 3, 4])).contains("every 1"));
        assert!(error(image("bayer_rggb8", 2, &[1, 2, 3, 4])).contains("image_proc"));
        assert!(error(image("32FC1", 8, &[0; 16])).contains("depth"));
        let huge = RawImage {
            width: u32::MAX,
            height: u32::MAX,
            ..image("mono8", 0, &[])
        };
        assert!(error(huge).contains("limit"));
    }
}

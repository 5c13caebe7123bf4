//! Which grey bytes are in this image file?
//!
//! [`load_gray`] decodes a file, makes it grey, turns, crops and scales it, in this order, so that
//! a crop is given in pixels of the upright picture. Every step is integer arithmetic of this
//! module, so that the same decoded colours give the same grey bytes on every machine:
//!
//! - grey = `(9798 R + 19235 G + 3735 B + 2^14) >> 15`, the weights of ITU-R BT.601 in 15 bits, as
//!   OpenCV 4 and 5 take them;
//! - 16-bit channels keep their high byte (`v >> 8`);
//! - alpha is ignored: the colours count as they are stored, transparent or not;
//! - the orientation that a camera wrote into the EXIF data is applied, as viewers and OpenCV do;
//! - scaling is bilinear with half-pixel centres: output pixel `i` samples `(i + 0.5) / scale -
//!   0.5`, clamped to the image, with weights in 1/2048 ([`GrayImage::scaled`]).
//!
//! Limits ([`DecodeLimits`]) are checked against the header before any pixel is decoded, so that a
//! small file cannot claim gigabytes. Files that end early, are damaged inside, claim no pixels, are
//! empty or are no images are [`ErrorKind::Format`] errors that name the file; files that cannot be
//! read are [`ErrorKind::Io`] errors. What is appended to a picture that is whole does not count
//! (`whole`).
//!
//! Not for: colour, more than 8 bits, floating-point images, raw camera formats.

use std::fmt;
use std::io::{self, Cursor};
use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};
use serde::{Deserialize, Serialize};

use super::luma::luma;
use super::whole::{self, damaged, truncated};
use super::{GrayImage, Rect, Rotation};
use fremen::error::{Error, ErrorKind, Result};

/// How large a file and its pixels may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DecodeLimits {
    max_pixels: u64,
    max_file_bytes: u64,
}

impl Default for DecodeLimits {
    /// 25 million pixels, 512 MiB of file.
    ///
    /// Decoding takes at most 12 bytes a pixel beside the file, and looking for features 21
    /// ([`StarBrief`](super::StarBrief)), so that an image of a file of up to 64 MB costs at most
    /// 600 MB.
    fn default() -> Self {
        Self {
            max_pixels: 25_000_000,
            max_file_bytes: 512 << 20,
        }
    }
}

impl DecodeLimits {
    /// Columns times rows, of the file and of the scaled result.
    #[must_use]
    pub fn with_max_pixels(mut self, pixels: u64) -> Self {
        self.max_pixels = pixels;
        self
    }

    /// Bytes of the file.
    #[must_use]
    pub fn with_max_file_bytes(mut self, bytes: u64) -> Self {
        self.max_file_bytes = bytes;
        self
    }

    /// Whether an image of so many pixels may be decoded; without any it is broken.
    pub fn check(&self, width: u64, height: u64) -> Result<()> {
        if width == 0 || height == 0 {
            return Err(Error::new(
                ErrorKind::Format,
                format!("the image has no pixels ({width} x {height})"),
            )
            .with_help("copy or record it again"));
        }
        if width.saturating_mul(height) > self.max_pixels {
            return Err(Error::new(
                ErrorKind::Format,
                format!(
                    "{width} x {height} px are more than the limit of {} pixels",
                    self.max_pixels
                ),
            )
            .with_help(
                "shrink the image, or raise the limit (--max-pixels) if you trust the file",
            ));
        }
        Ok(())
    }

    /// Bytes that a decoder may allocate: 16-bit RGBA pixels and some working memory.
    fn max_decoder_bytes(&self) -> u64 {
        self.max_pixels.saturating_mul(8).saturating_add(64 << 20)
    }
}

/// What [`load_gray`] makes of a file; the default is the whole file as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoadOptions {
    rotation: Rotation,
    crop: Option<Rect>,
    scale: f64,
    limits: DecodeLimits,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            rotation: Rotation::None,
            crop: None,
            scale: 1.0,
            limits: DecodeLimits::default(),
        }
    }
}

impl LoadOptions {
    /// Turns the picture first.
    #[must_use]
    pub fn with_rotation(mut self, rotation: Rotation) -> Self {
        self.rotation = rotation;
        self
    }

    /// Then cuts this rectangle out of the turned picture.
    #[must_use]
    pub fn with_crop(mut self, crop: Option<Rect>) -> Self {
        self.crop = crop;
        self
    }

    /// Then scales by this factor: 2 doubles the sides.
    #[must_use]
    pub fn with_scale(mut self, scale: f64) -> Self {
        self.scale = scale;
        self
    }

    /// What is too big to decode.
    #[must_use]
    pub fn with_limits(mut self, limits: DecodeLimits) -> Self {
        self.limits = limits;
        self
    }

    /// What is too big to decode.
    pub fn limits(&self) -> DecodeLimits {
        self.limits
    }

    /// Whether an image stays as it is.
    #[must_use]
    pub fn changes_nothing(&self) -> bool {
        self.rotation == Rotation::None && self.crop.is_none() && self.scale == 1.0
    }

    /// Whether an image is scaled.
    pub(crate) fn changes_scale(&self) -> bool {
        self.scale != 1.0
    }

    /// [`apply`](Self::apply) for a mask: a scaled pixel that touches a hidden one is hidden. The
    /// result is 0 or 255.
    pub fn apply_to_mask(&self, mut mask: GrayImage) -> Result<GrayImage> {
        for pixel in mask.data_mut() {
            *pixel = if *pixel == 0 { 0 } else { 255 };
        }
        let mut mask = self.apply(mask)?;
        for pixel in mask.data_mut() {
            *pixel = if *pixel == 255 { 255 } else { 0 };
        }
        Ok(mask)
    }

    /// The size that [`apply`](Self::apply) makes of an image of `width` x `height` pixels, if its
    /// crop lies inside.
    #[must_use]
    pub fn size_of(&self, (width, height): (u32, u32)) -> (u32, u32) {
        let (width, height) = match (self.crop, self.rotation) {
            (Some(crop), _) => (crop.width, crop.height),
            (None, Rotation::Clockwise90 | Rotation::Clockwise270) => (height, width),
            (None, _) => (width, height),
        };
        if self.scale == 1.0 {
            return (width, height);
        }
        let side = |px: u32| (f64::from(px) * self.scale).round_ties_even() as u32;
        (side(width), side(height))
    }

    /// Where a point of the changed image was in the image of `found` columns and rows that was
    /// loaded, px from the centre of its first pixel.
    pub fn point_before(&self, [x, y]: [f64; 2], found: (u32, u32)) -> [f64; 2] {
        let (left, top) = self.crop.map_or((0, 0), |crop| (crop.x, crop.y));
        let x = x / self.scale + f64::from(left);
        let y = y / self.scale + f64::from(top);
        let (last_x, last_y) = (f64::from(found.0) - 1.0, f64::from(found.1) - 1.0);
        match self.rotation {
            Rotation::None => [x, y],
            Rotation::Clockwise90 => [y, last_y - x],
            Rotation::Half => [last_x - x, last_y - y],
            Rotation::Clockwise270 => [last_x - y, x],
        }
    }

    /// Turns, crops and scales an image that is already decoded.
    pub fn apply(&self, image: GrayImage) -> Result<GrayImage> {
        let mut image = image.rotated(self.rotation);
        if let Some(crop) = self.crop {
            image = image.cropped(crop)?;
        }
        if self.scale != 1.0 {
            let side = |px: usize| (px as f64 * self.scale).round_ties_even();
            let (width, height) = (side(image.width()), side(image.height()));
            // NaN, negative and infinite factors fail here or in `scaled`; casts saturate.
            if self.scale.is_finite() && self.scale > 0.0 {
                self.limits.check(width as u64, height as u64)?;
            }
            image = image.scaled(self.scale)?;
        }
        Ok(image)
    }
}

impl fmt::Display for LoadOptions {
    /// The steps that change an image, in their order: `turn 90 crop 0,0,640,480 scale 0.5`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut steps: Vec<String> = Vec::new();
        match self.rotation {
            Rotation::None => {}
            Rotation::Clockwise90 => steps.push("turn 90".into()),
            Rotation::Half => steps.push("turn 180".into()),
            Rotation::Clockwise270 => steps.push("turn 270".into()),
        }
        steps.extend(
            self.crop
                .map(|crop| format!("crop {},{},{},{}", crop.x, crop.y, crop.width, crop.height)),
        );
        if self.scale != 1.0 {
            steps.push(format!("scale {}", self.scale));
        }
        f.write_str(&steps.join(" "))
    }
}

/// The grey bytes of the image at `path`, turned, cropped and scaled.
///
/// Errors name the file and, where there is one, the remedy.
pub fn load_gray(path: impl AsRef<Path>, options: &LoadOptions) -> Result<GrayImage> {
    let path = path.as_ref();
    read_file(path, &options.limits)
        .and_then(|bytes| decode_gray(&bytes, &options.limits))
        .and_then(|image| options.apply(image))
        .map_err(|error| error.with_path(path))
}

/// A mask from an image file of the same layout as the images it belongs to: zero pixels are
/// ignored.
///
/// The mask is turned, cropped and scaled like the images. A scaled mask pixel that touches an
/// ignored pixel is ignored. The result is 0 or 255.
pub fn load_mask(path: impl AsRef<Path>, options: &LoadOptions) -> Result<GrayImage> {
    let path = path.as_ref();
    read_file(path, &options.limits)
        .and_then(|bytes| decode_gray(&bytes, &options.limits))
        .and_then(|mask| options.apply_to_mask(mask))
        .map_err(|error| error.with_path(path))
}

/// Columns and rows of the upright picture in the image file at `path`, without its pixels.
///
/// Errors name the file and, where there is one, the remedy.
pub fn picture_size(path: impl AsRef<Path>, limits: &DecodeLimits) -> Result<(u32, u32)> {
    let path = path.as_ref();
    read_file(path, limits)
        .and_then(|bytes| encoded_size(&bytes, limits))
        .map_err(|error| error.with_path(path))
}

/// Columns and rows of the upright picture that [`decode_gray`] makes of the bytes of an encoded
/// image, without its pixels.
pub fn encoded_size(bytes: &[u8], limits: &DecodeLimits) -> Result<(u32, u32)> {
    let format = format_of(bytes)?;
    // Whether a JPEG is whole takes as long as decoding it.
    let picture = match format {
        ImageFormat::Png => {
            whole::picture(bytes, format, &|width, height| limits.check(width, height))?
        }
        _ => bytes.into(),
    };
    let mut decoder = decoder(&picture, format, limits)?;
    let (width, height) = decoder.dimensions();
    limits.check(u64::from(width), u64::from(height))?;
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let is_on_its_side = matches!(
        orientation,
        Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH
    );
    Ok(if is_on_its_side {
        (height, width)
    } else {
        (width, height)
    })
}

/// The bytes of a file that is not above the limit.
pub(super) fn read_file(path: &Path, limits: &DecodeLimits) -> Result<Vec<u8>> {
    fremen::file::read(path, limits.max_file_bytes).map_err(|error| match error.kind() {
        ErrorKind::NotFound => {
            error.with_help("check the path; an index's paths are relative to its folder")
        }
        ErrorKind::Format if path.is_file() => {
            error.with_help("is it an image? raise the decoding limit if you trust it")
        }
        _ => error,
    })
}

/// The grey bytes of an encoded image (BMP, JPEG, PNG, PNM, TIFF or WebP).
pub fn decode_gray(bytes: &[u8], limits: &DecodeLimits) -> Result<GrayImage> {
    let format = format_of(bytes)?;
    let picture = whole::picture(bytes, format, &|width, height| limits.check(width, height))?;
    let mut decoder = decoder(&picture, format, limits)?;
    let (width, height) = decoder.dimensions();
    limits.check(u64::from(width), u64::from(height))?;
    // Metadata that cannot be read turns nothing; the pixels count.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|cause| image_error(&cause))?;
    image.apply_orientation(orientation);
    let (width, height) = (image.width() as usize, image.height() as usize);
    GrayImage::new(width, height, to_gray(image)?)
}

/// Which of the formats the bytes are of.
fn format_of(bytes: &[u8]) -> Result<ImageFormat> {
    if bytes.is_empty() {
        return Err(
            Error::new(ErrorKind::Format, "the file is empty").with_help("copy or record it again")
        );
    }
    // The decoder reads a BigTIFF, too, whose offsets have eight bytes.
    if bytes.starts_with(b"II+\0") || bytes.starts_with(b"MM\0+") {
        return Ok(ImageFormat::Tiff);
    }
    if bytes.starts_with(b"version https://git-lfs") {
        let message = "this is a pointer of Git LFS, not the image that it stands for";
        return Err(
            Error::new(ErrorKind::Format, message).with_help("fetch it with `git lfs pull`")
        );
    }
    image::guess_format(bytes).map_err(|_| {
        Error::new(ErrorKind::Format, "not an image of a known format")
            .with_help("supported are BMP, JPEG, PNG, PNM, TIFF and WebP")
    })
}

/// What decodes a picture, within the limits.
fn decoder<'a>(
    picture: &'a [u8],
    format: ImageFormat,
    limits: &DecodeLimits,
) -> Result<impl ImageDecoder + use<'a>> {
    let mut reader = ImageReader::with_format(Cursor::new(picture), format);
    let mut image_limits = image::Limits::default();
    image_limits.max_alloc = Some(limits.max_decoder_bytes());
    reader.limits(image_limits);
    reader.into_decoder().map_err(|cause| image_error(&cause))
}

fn image_error(cause: &ImageError) -> Error {
    match cause {
        ImageError::IoError(io) if io.kind() == io::ErrorKind::UnexpectedEof => truncated(),
        ImageError::Limits(_) => Error::new(
            ErrorKind::Format,
            format!("the image needs more memory than the limit allows: {cause}"),
        )
        .with_help("shrink the image, or raise the limit (--max-pixels) if you trust the file"),
        ImageError::Unsupported(_) => Error::new(ErrorKind::Format, cause.to_string())
            .with_help("convert it to 8- or 16-bit grey or RGB PNG"),
        _ => damaged(cause),
    }
}

/// The grey of every pixel, row by row.
fn to_gray(image: DynamicImage) -> Result<Vec<u8>> {
    /// From 8-bit pixels of `N` channels, colours first.
    fn narrow<const N: usize>(samples: &[u8]) -> Vec<u8> {
        let pixels = samples.as_chunks::<N>().0.iter();
        if N >= 3 {
            pixels.map(|p| luma(p[0], p[1], p[2])).collect()
        } else {
            pixels.map(|p| p[0]).collect()
        }
    }
    /// [`narrow`] of the high bytes of 16-bit samples.
    fn high<const N: usize>(samples: &[u16]) -> Vec<u8> {
        let pixels = samples.as_chunks::<N>().0.iter();
        let high_byte = |sample: u16| (sample >> 8) as u8;
        if N >= 3 {
            pixels
                .map(|p| luma(high_byte(p[0]), high_byte(p[1]), high_byte(p[2])))
                .collect()
        } else {
            pixels.map(|p| high_byte(p[0])).collect()
        }
    }
    Ok(match image {
        DynamicImage::ImageLuma8(image) => image.into_raw(),
        DynamicImage::ImageLumaA8(image) => narrow::<2>(&image),
        DynamicImage::ImageRgb8(image) => narrow::<3>(&image),
        DynamicImage::ImageRgba8(image) => narrow::<4>(&image),
        DynamicImage::ImageLuma16(image) => high::<1>(&image),
        DynamicImage::ImageLumaA16(image) => high::<2>(&image),
        DynamicImage::ImageRgb16(image) => high::<3>(&image),
        DynamicImage::ImageRgba16(image) => high::<4>(&image),
        _ => {
            return Err(
                Error::new(ErrorKind::Format, "floating-point pixels are not supported")
                    .with_help("convert it to 8- or 16-bit grey or RGB"),
            );
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_found_again_where_it_was() -> Result<()> {
        let crop = Some(Rect {
            x: 1,
            y: 0,
            width: 2,
            height: 3,
        });
        for rotation in [
            Rotation::None,
            Rotation::Clockwise90,
            Rotation::Half,
            Rotation::Clockwise270,
        ] {
            for crop in [None, crop] {
                let options = LoadOptions::default()
                    .with_rotation(rotation)
                    .with_crop(crop);
                let image = GrayImage::new(4, 4, (0..16).collect())?;
                let changed = options.apply(image)?;
                for (at, &level) in changed.data().iter().enumerate() {
                    let (x, y) = (at % changed.width(), at / changed.width());
                    let before = options.point_before([x as f64, y as f64], (4, 4));
                    assert_eq!(before, [f64::from(level % 4), f64::from(level / 4)]);
                }
            }
        }
        Ok(())
    }
}

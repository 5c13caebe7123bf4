//! How does a file become the grey image of an entry?

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::ImageSource;
use crate::error::{Error, ErrorKind, Result};
use crate::feature::{GrayImage, Rect};

/// By how much an image is turned, clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u32")]
pub enum Turn {
    /// Not at all.
    #[default]
    None,
    /// 90 degrees.
    Quarter,
    /// 180 degrees.
    Half,
    /// 270 degrees.
    ThreeQuarters,
}

impl Turn {
    /// Clockwise degrees.
    pub const fn degrees(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Quarter => 90,
            Self::Half => 180,
            Self::ThreeQuarters => 270,
        }
    }
}

impl TryFrom<u32> for Turn {
    type Error = Error;

    fn try_from(degrees: u32) -> Result<Self> {
        match degrees {
            0 => Ok(Self::None),
            90 => Ok(Self::Quarter),
            180 => Ok(Self::Half),
            270 => Ok(Self::ThreeQuarters),
            _ => Err(Error::new(
                ErrorKind::Config,
                format!("an image cannot be turned by {degrees} degrees"),
            )
            .with_help("turn by 0, 90, 180 or 270 degrees, clockwise")),
        }
    }
}

/// An image file, of which a rectangle is cut out, turned and then resized.
///
/// The crop and the masks are in pixels of the file, before turning and resizing.
#[derive(Clone, Debug, PartialEq)]
pub struct FileImage {
    path: PathBuf,
    crop: Option<Rect>,
    turn: Turn,
    scale: f64,
    masks: Vec<Rect>,
}

impl FileImage {
    /// The whole file, as it is.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            crop: None,
            turn: Turn::None,
            scale: 1.0,
            masks: Vec::new(),
        }
    }

    /// Cuts out this rectangle.
    #[must_use]
    pub fn with_crop(mut self, crop: Option<Rect>) -> Self {
        self.crop = crop;
        self
    }

    /// Turns it.
    #[must_use]
    pub fn with_turn(mut self, turn: Turn) -> Self {
        self.turn = turn;
        self
    }

    /// Resizes it by a positive factor (bilinear).
    #[must_use]
    pub fn with_scale(mut self, scale: f64) -> Self {
        self.scale = scale;
        self
    }

    /// Masks these rectangles.
    #[must_use]
    pub fn with_masks(mut self, masks: Vec<Rect>) -> Self {
        self.masks = masks;
        self
    }

    /// The rectangle that is cut out.
    pub fn crop(&self) -> Option<Rect> {
        self.crop
    }

    /// The file.
    pub fn file(&self) -> &Path {
        &self.path
    }

    /// Width and height of the whole file in pixels, from its header alone.
    pub(super) fn file_size(path: &Path) -> Result<(u32, u32)> {
        let image_error = |message: String| {
            Error::new(ErrorKind::Image, message)
                .with_path(path)
                .with_help("replace the file by a readable image or remove its row")
        };
        image::ImageReader::open(path)
            .and_then(image::ImageReader::with_guessed_format)
            .map_err(|cause| Error::io(path, &cause))?
            .into_dimensions()
            .map_err(|cause| image_error(format!("this is no readable image: {cause}")))
    }
}

impl ImageSource for FileImage {
    fn load(&self) -> Result<GrayImage> {
        decode(self)
    }

    fn path(&self) -> Option<PathBuf> {
        Some(self.path.clone())
    }

    fn mask(&self, width: usize, height: usize) -> Result<Option<GrayImage>> {
        if self.masks.is_empty() || width == 0 || height == 0 {
            return Ok(None);
        }
        let (offset_x, offset_y) = self.crop.map_or((0, 0), |crop| (crop.x, crop.y));
        // The size of the cut-out before resizing, in the turned image.
        let cut = |length: usize| length as f64 / self.scale;
        let (turned_width, turned_height) = (cut(width), cut(height));
        let mut mask = GrayImage::new(width, height, vec![255; width * height])?;
        for y in 0..height {
            for x in 0..width {
                let u = (x as f64 + 0.5) / self.scale;
                let v = (y as f64 + 0.5) / self.scale;
                let (u, v) = match self.turn {
                    Turn::None => (u, v),
                    Turn::Quarter => (v, turned_width - u),
                    Turn::Half => (turned_width - u, turned_height - v),
                    Turn::ThreeQuarters => (turned_height - v, u),
                };
                let (u, v) = (u + f64::from(offset_x), v + f64::from(offset_y));
                if self.masks.iter().any(|mask| contains(mask, u, v)) {
                    mask.data_mut()[y * width + x] = 0;
                }
            }
        }
        Ok(Some(mask))
    }

    fn recipe(&self) -> String {
        let rect = |word: &str, rect: &Rect| {
            format!(
                "{word} {},{},{},{}",
                rect.x, rect.y, rect.width, rect.height
            )
        };
        let mut steps: Vec<String> = Vec::new();
        steps.extend(self.crop.map(|crop| rect("crop", &crop)));
        if self.turn != Turn::None {
            steps.push(format!("turn {}", self.turn.degrees()));
        }
        if self.scale != 1.0 {
            steps.push(format!("scale {}", self.scale));
        }
        steps.extend(self.masks.iter().map(|mask| rect("mask", mask)));
        steps.join(" ")
    }
}

fn contains(rect: &Rect, x: f64, y: f64) -> bool {
    let inside = |value: f64, start: u32, length: u32| {
        value >= f64::from(start) && value < f64::from(start) + f64::from(length)
    };
    inside(x, rect.x, rect.width) && inside(y, rect.y, rect.height)
}

/// Decodes, cuts, turns and resizes.
fn decode(image: &FileImage) -> Result<GrayImage> {
    let fail = |message: String| {
        Error::new(ErrorKind::Image, message)
            .with_path(&image.path)
            .with_help("replace the file by a readable image or remove its row")
    };
    let mut gray = image::ImageReader::open(&image.path)
        .and_then(image::ImageReader::with_guessed_format)
        .map_err(|cause| Error::io(&image.path, &cause))?
        .decode()
        .map_err(|cause| fail(format!("this is no readable image: {cause}")))?
        .into_luma8();
    if let Some(crop) = image.crop {
        let fits = |start: u32, length: u32, size: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= size)
        };
        if !fits(crop.x, crop.width, gray.width()) || !fits(crop.y, crop.height, gray.height()) {
            return Err(fail(format!(
                "the crop {},{} of {} x {} px is not inside the image of {} x {} px",
                crop.x,
                crop.y,
                crop.width,
                crop.height,
                gray.width(),
                gray.height()
            )));
        }
        gray = image::imageops::crop_imm(&gray, crop.x, crop.y, crop.width, crop.height).to_image();
    }
    gray = match image.turn {
        Turn::None => gray,
        Turn::Quarter => image::imageops::rotate90(&gray),
        Turn::Half => image::imageops::rotate180(&gray),
        Turn::ThreeQuarters => image::imageops::rotate270(&gray),
    };
    if image.scale != 1.0 {
        let scaled = |length: u32| (f64::from(length) * image.scale).round() as u32;
        gray = image::imageops::resize(
            &gray,
            scaled(gray.width()),
            scaled(gray.height()),
            image::imageops::FilterType::Triangle,
        );
    }
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    GrayImage::new(width, height, gray.into_raw())
}

//! How does a file become the grey image of an entry?

use std::path::{Path, PathBuf};

use super::types::ImageSource;
use crate::feature::{
    DecodeLimits, GrayImage, LoadOptions, Rect, Rotation, load_gray, picture_size,
};
use fremen::error::Result;

/// An image file that is turned, of which a rectangle is then cut out and resized.
///
/// The crop and the masks are in pixels of the turned picture, before resizing.
#[derive(Clone, Debug, PartialEq)]
pub struct FileImage {
    path: PathBuf,
    crop: Option<Rect>,
    rotation: Rotation,
    scale: f64,
    masks: Vec<Rect>,
    limits: DecodeLimits,
}

impl FileImage {
    /// The whole file, as it is.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            crop: None,
            rotation: Rotation::None,
            scale: 1.0,
            masks: Vec::new(),
            limits: DecodeLimits::default(),
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
    pub fn with_rotation(mut self, rotation: Rotation) -> Self {
        self.rotation = rotation;
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

    /// What is too big to decode.
    #[must_use]
    pub fn with_limits(mut self, limits: DecodeLimits) -> Self {
        self.limits = limits;
        self
    }

    fn options(&self) -> LoadOptions {
        LoadOptions::default()
            .with_rotation(self.rotation)
            .with_crop(self.crop)
            .with_scale(self.scale)
            .with_limits(self.limits)
    }

    /// The rectangle that is cut out.
    pub fn crop(&self) -> Option<Rect> {
        self.crop
    }

    /// The file.
    pub fn file(&self) -> &Path {
        &self.path
    }
}

impl ImageSource for FileImage {
    fn load(&self) -> Result<GrayImage> {
        load_gray(&self.path, &self.options())
    }

    fn decode(&self) -> Result<GrayImage> {
        load_gray(&self.path, &LoadOptions::default().with_limits(self.limits))
    }

    fn load_from(&self, file: &GrayImage) -> Result<GrayImage> {
        (self.options().apply(file.clone())).map_err(|error| error.with_path(&self.path))
    }

    fn size(&self) -> Result<Option<(u32, u32)>> {
        let whole = match self.crop {
            Some(_) => (0, 0),
            None => picture_size(&self.path, &self.limits)?,
        };
        Ok(Some(self.options().size_of(whole)))
    }

    fn path(&self) -> Option<PathBuf> {
        Some(self.path.clone())
    }

    fn mask(&self, width: usize, height: usize) -> Result<Option<GrayImage>> {
        if self.masks.is_empty() || width == 0 || height == 0 {
            return Ok(None);
        }
        let (offset_x, offset_y) = self.crop.map_or((0, 0), |crop| (crop.x, crop.y));
        let in_picture =
            |px: usize, offset: u32| (px as f64 + 0.5) / self.scale + f64::from(offset);
        let mut mask = GrayImage::new(width, height, vec![255; width * height])?;
        for y in 0..height {
            for x in 0..width {
                let (u, v) = (in_picture(x, offset_x), in_picture(y, offset_y));
                if self.masks.iter().any(|mask| contains(mask, u, v)) {
                    mask.data_mut()[y * width + x] = 0;
                }
            }
        }
        Ok(Some(mask))
    }

    fn recipe(&self) -> String {
        let mut steps: Vec<String> = Vec::new();
        if !self.options().changes_nothing() {
            steps.push(self.options().to_string());
        }
        steps.extend(
            (self.masks.iter())
                .map(|mask| format!("mask {},{},{},{}", mask.x, mask.y, mask.width, mask.height)),
        );
        steps.join(" ")
    }
}

fn contains(rect: &Rect, x: f64, y: f64) -> bool {
    let inside = |value: f64, start: u32, length: u32| {
        value >= f64::from(start) && value < f64::from(start) + f64::from(length)
    };
    inside(x, rect.x, rect.width) && inside(y, rect.y, rect.height)
}

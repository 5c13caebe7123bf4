//! How are all images of a dataset turned, cut and scaled once more?
//!
//! What the dataset says of its images comes first. So a map can be built from pictures of one
//! camera and take those of another.

use std::path::PathBuf;
use std::sync::Arc;

use super::types::{Dataset, ImageSource};
use crate::feature::{GrayImage, LoadOptions};
use fremen::error::Result;

impl Dataset {
    /// The same entries, with their images and masks changed by `options`.
    #[must_use]
    pub fn adjusted(mut self, options: &LoadOptions) -> Self {
        if options.changes_nothing() {
            return self;
        }
        for entry in &mut self.entries {
            entry.source = adjusted(Arc::clone(&entry.source), *options);
        }
        self
    }
}

/// The factor by which an image of one size becomes one of another, if both have the same shape.
///
/// This is the rule for another camera's images: they are scaled if nothing is cut off or squeezed
/// by it, to the pixel.
pub fn scale_between(from: (u32, u32), to: (u32, u32)) -> Option<f64> {
    let fits = |scale: &f64| {
        let side = |px: u32| (f64::from(px) * scale).round_ties_even() as u32;
        (side(from.0), side(from.1)) == to
    };
    let factors =
        [(to.0, from.0), (to.1, from.1)].map(|(to, from)| f64::from(to) / f64::from(from));
    factors.into_iter().find(fits)
}

/// An image that is changed once more.
pub(super) fn adjusted(inner: Arc<dyn ImageSource>, options: LoadOptions) -> Arc<dyn ImageSource> {
    Arc::new(Adjusted { inner, options })
}

struct Adjusted {
    inner: Arc<dyn ImageSource>,
    options: LoadOptions,
}

impl Adjusted {
    fn mask_of(&self, mask: Option<GrayImage>) -> Result<Option<GrayImage>> {
        mask.map(|mask| self.options.apply_to_mask(mask))
            .transpose()
    }
}

impl ImageSource for Adjusted {
    fn load(&self) -> Result<GrayImage> {
        self.options.apply(self.inner.load()?)
    }

    fn decode(&self) -> Result<GrayImage> {
        self.inner.decode()
    }

    fn load_from(&self, file: &GrayImage) -> Result<GrayImage> {
        self.options.apply(self.inner.load_from(file)?)
    }

    fn size(&self) -> Result<Option<(u32, u32)>> {
        Ok(self.inner.size()?.map(|size| self.options.size_of(size)))
    }

    fn path(&self) -> Option<PathBuf> {
        self.inner.path()
    }

    fn mask(&self, _: usize, _: usize) -> Result<Option<GrayImage>> {
        let (width, height) = match self.inner.size()? {
            Some(size) => size,
            None => self.inner.load()?.size(),
        };
        self.mask_of(self.inner.mask(width as usize, height as usize)?)
    }

    fn load_masked(&self) -> Result<(GrayImage, Option<GrayImage>)> {
        let (image, mask) = self.inner.load_masked()?;
        Ok((self.options.apply(image)?, self.mask_of(mask)?))
    }

    fn recipe(&self) -> String {
        let inner = self.inner.recipe();
        let between = if inner.is_empty() { "" } else { ", then " };
        format!("{inner}{between}{}", self.options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_of_one_shape_are_scaled_and_others_are_not() {
        assert_eq!(scale_between((1280, 960), (640, 480)), Some(0.5));
        assert_eq!(scale_between((320, 240), (640, 480)), Some(2.0));
        assert_eq!(
            scale_between((1365, 768), (1024, 576)),
            Some(1024.0 / 1365.0)
        );
        assert_eq!(scale_between((480, 640), (640, 480)), None);
        assert_eq!(scale_between((640, 480), (640, 360)), None);
    }
}

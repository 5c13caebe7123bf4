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
            entry.source = Arc::new(Adjusted {
                inner: Arc::clone(&entry.source),
                options: *options,
            });
        }
        self
    }
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

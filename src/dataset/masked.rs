//! How is a part of every image of a dataset not used?

use std::path::PathBuf;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::types::{Dataset, ImageSource};
use crate::feature::{GrayImage, shown_by_both};
use fremen::error::Result;

impl Dataset {
    /// The same entries; nothing is used of their images where `mask` is 0: the robot's own arm, a
    /// dirty lens. Images have to be of its size.
    #[must_use]
    pub fn masked(mut self, mask: GrayImage) -> Self {
        let mask = Arc::new(mask);
        for entry in &mut self.entries {
            entry.source = Arc::new(Masked {
                inner: Arc::clone(&entry.source),
                mask: Arc::clone(&mask),
            });
        }
        self
    }
}

struct Masked {
    inner: Arc<dyn ImageSource>,
    mask: Arc<GrayImage>,
}

impl ImageSource for Masked {
    fn load(&self) -> Result<GrayImage> {
        self.inner.load()
    }

    fn decode(&self) -> Result<GrayImage> {
        self.inner.decode()
    }

    fn load_from(&self, file: &GrayImage) -> Result<GrayImage> {
        self.inner.load_from(file)
    }

    fn path(&self) -> Option<PathBuf> {
        self.inner.path()
    }

    fn size(&self) -> Result<Option<(u32, u32)>> {
        self.inner.size()
    }

    fn load_masked(&self) -> Result<(GrayImage, Option<GrayImage>)> {
        let (image, mask) = self.inner.load_masked()?;
        let mask = shown_by_both(mask.as_ref(), Some(&self.mask))?;
        Ok((image, mask))
    }

    fn mask(&self, width: usize, height: usize) -> Result<Option<GrayImage>> {
        let mask = self.inner.mask(width, height)?;
        shown_by_both(mask.as_ref(), Some(&self.mask))
    }

    fn recipe(&self) -> String {
        let digest = Sha256::digest(self.mask.data());
        let first = digest.iter().take(8);
        let number = first.fold(0_u64, |number, &byte| number << 8 | u64::from(byte));
        let inner = self.inner.recipe();
        let between = if inner.is_empty() { "" } else { ", then " };
        format!("{inner}{between}mask {number:016x}")
    }
}

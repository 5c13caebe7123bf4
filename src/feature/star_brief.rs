//! Which features does the reference recipe see (STAR keypoints, BRIEF-32 bits)?
//!
//! [`StarBrief`] detects ([`star`](super::star)), drops keypoints on masked pixels and those that
//! BRIEF cannot describe, sorts by (response descending, y, x), keeps the strongest `num_features`
//! and describes them ([`brief`](super::brief)).
//!
//! The cut comes after the border filter, so that `num_features` counts features and not
//! candidates. With `max_size` of 30 or more the order makes no difference: STAR's own border is
//! then wider than BRIEF's. OpenCV leaves the order of equal responses, which over a third of
//! keypoints share, to its sorting; ours is defined, so that the same image gives the same features
//! everywhere.

use std::sync::{Mutex, PoisonError};

use super::brief::{self, BriefScratch};
use super::selection::{check_mask, drop_masked, sort_keypoints};
use super::star::{self, Field, StarScratch};
use super::{Extractor, ExtractorConfig, Features, GrayImage, GrayView, Keypoint, StarBriefConfig};
use crate::simd::Kernel;
use fremen::error::Result;

/// STAR keypoints with BRIEF-32 descriptors, bit-exact with OpenCV's.
#[derive(Default)]
pub struct StarBrief {
    config: StarBriefConfig,
    kernel: Kernel,
    /// One per thread that extracts at the same time.
    pool: Mutex<Vec<Scratch>>,
}

#[derive(Default)]
struct Scratch {
    star: StarScratch,
    brief: BriefScratch,
    candidates: Vec<Keypoint>,
}

impl StarBrief {
    /// An extractor; values it cannot work with are a
    /// [`ErrorKind::Config`](fremen::ErrorKind::Config) error.
    pub fn new(config: StarBriefConfig) -> Result<Self> {
        Self::with_kernel(config, Kernel::best())
    }

    /// With a given kernel; the features are the same for all.
    pub fn with_kernel(config: StarBriefConfig, kernel: Kernel) -> Result<Self> {
        config.star().check()?;
        Ok(Self {
            config,
            kernel,
            pool: Mutex::default(),
        })
    }

    /// All keypoints of `image` before the cut and without regard to BRIEF's border, in the order
    /// of [`Extractor`].
    pub fn detect<'a>(
        &self,
        image: impl Into<GrayView<'a>>,
        mask: Option<&GrayImage>,
    ) -> Result<Vec<Keypoint>> {
        let image = image.into();
        check_mask(image, mask)?;
        self.with_scratch(|Scratch { star, .. }| {
            let mut keypoints = Vec::new();
            let field = self.candidates(star, image, &mut keypoints);
            keypoints.retain(|keypoint| !field.is_on_line(keypoint));
            drop_masked(&mut keypoints, mask);
            sort_keypoints(&mut keypoints);
            Ok(keypoints)
        })
    }

    fn candidates<'a>(
        &self,
        star: &'a mut StarScratch,
        image: GrayView<'_>,
        keypoints: &mut Vec<Keypoint>,
    ) -> Field<'a> {
        star::candidates(image, self.config.star(), self.kernel, star, keypoints)
    }

    fn with_scratch<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        let lock = || self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        let mut scratch = lock().pop().unwrap_or_default();
        let result = work(&mut scratch);
        lock().push(scratch);
        result
    }
}

impl Extractor for StarBrief {
    fn id(&self) -> String {
        ExtractorConfig::StarBrief(self.config.clone()).id()
    }

    fn extract_into(
        &self,
        image: GrayView<'_>,
        mask: Option<&GrayImage>,
        features: &mut Features,
    ) -> Result<()> {
        check_mask(image, mask)?;
        self.with_scratch(
            |Scratch {
                 star,
                 brief,
                 candidates,
             }| {
                let field = self.candidates(star, image, candidates);
                let (width, height) = (image.width(), image.height());
                candidates.retain(|keypoint| brief::is_describable(keypoint, width, height));
                drop_masked(candidates, mask);
                // The line test costs most and comes last: of the strongest, until there are
                // enough.
                sort_keypoints(candidates);
                let (keypoints, descriptors) = features.parts_mut();
                keypoints.clear();
                keypoints.extend(
                    candidates
                        .iter()
                        .filter(|keypoint| !field.is_on_line(keypoint))
                        .take(self.config.num_features()),
                );
                brief::describe(image, keypoints, self.kernel, brief, descriptors);
                Ok(())
            },
        )
    }
}

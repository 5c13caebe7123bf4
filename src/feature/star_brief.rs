//! Which features does the reference recipe see (STAR keypoints, BRIEF-32 bits)?
//!
//! [`StarBrief`] detects ([`star`](super::star)), drops keypoints on masked pixels and those that BRIEF
//! cannot describe, sorts by (response descending, y, x), keeps the strongest `num_features` and
//! describes them ([`brief`](super::brief)).
//!
//! The cut comes after the border filter, so that `num_features` counts features and not candidates.
//! With `max_size` of 30 or more the order makes no difference: STAR's own border is then wider than
//! BRIEF's. `OpenCV` leaves the order of equal responses, which over a third of keypoints share, to its
//! sorting; ours is defined, so that the same image gives the same features everywhere.

use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::brief::{self, BriefScratch};
use super::star::{self, StarParams, StarScratch};
use super::{Extractor, Features, GrayImage, Keypoint};
use crate::error::{Error, ErrorKind, Result};

/// The configuration of [`StarBrief`]; the default is the reference recipe.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StarBriefConfig {
    num_features: usize,
    star: StarParams,
}

impl Default for StarBriefConfig {
    fn default() -> Self {
        Self {
            num_features: 500,
            star: StarParams::default(),
        }
    }
}

impl StarBriefConfig {
    /// At most this many features of an image, the strongest.
    #[must_use]
    pub fn with_num_features(mut self, num_features: usize) -> Self {
        self.num_features = num_features;
        self
    }

    /// The detector's parameters.
    #[must_use]
    pub fn with_star(mut self, star: StarParams) -> Self {
        self.star = star;
        self
    }
}

/// STAR keypoints with BRIEF-32 descriptors, bit-exact with `OpenCV`'s.
pub struct StarBrief {
    config: StarBriefConfig,
    /// One per thread that extracts at the same time.
    pool: Mutex<Vec<Scratch>>,
}

#[derive(Default)]
struct Scratch {
    star: StarScratch,
    brief: BriefScratch,
}

impl Default for StarBrief {
    fn default() -> Self {
        Self {
            config: StarBriefConfig::default(),
            pool: Mutex::default(),
        }
    }
}

impl StarBrief {
    /// An extractor; values it cannot work with are a [`ErrorKind::Config`] error.
    pub fn new(config: StarBriefConfig) -> Result<Self> {
        config.star.check()?;
        Ok(Self {
            config,
            pool: Mutex::default(),
        })
    }

    /// All keypoints of `image` before the cut and without regard to BRIEF's border, in the order of
    /// [`Extractor`].
    pub fn detect(&self, image: &GrayImage, mask: Option<&GrayImage>) -> Result<Vec<Keypoint>> {
        self.with_scratch(|scratch| self.detect_with(scratch, image, mask))
    }

    fn detect_with(
        &self,
        scratch: &mut Scratch,
        image: &GrayImage,
        mask: Option<&GrayImage>,
    ) -> Result<Vec<Keypoint>> {
        check_mask(image, mask)?;
        let mut keypoints = Vec::new();
        star::detect(image, &self.config.star, &mut scratch.star, &mut keypoints);
        drop_masked(&mut keypoints, mask);
        sort_keypoints(&mut keypoints);
        Ok(keypoints)
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
        format!(
            "{}+brief32;n={}",
            self.config.star.id(),
            self.config.num_features
        )
    }

    fn extract(&self, image: &GrayImage, mask: Option<&GrayImage>) -> Result<Features> {
        self.with_scratch(|scratch| {
            let mut keypoints = self.detect_with(scratch, image, mask)?;
            let (width, height) = (image.width(), image.height());
            keypoints.retain(|keypoint| brief::is_describable(keypoint, width, height));
            keypoints.truncate(self.config.num_features);
            let mut descriptors = Vec::with_capacity(keypoints.len());
            brief::describe(image, &keypoints, &mut scratch.brief, &mut descriptors);
            Features::from_parts(keypoints, descriptors)
        })
    }
}

/// A mask of another size than its image is a [`ErrorKind::Shape`] error.
pub(super) fn check_mask(image: &GrayImage, mask: Option<&GrayImage>) -> Result<()> {
    match mask {
        Some(mask) if (mask.width(), mask.height()) != (image.width(), image.height()) => {
            Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "a mask of {} x {} px does not fit an image of {} x {} px",
                    mask.width(),
                    mask.height(),
                    image.width(),
                    image.height()
                ),
            )
            .with_help("make the mask for the image after crop, rotation and scale"))
        }
        _ => Ok(()),
    }
}

/// Drops keypoints whose nearest pixel is zero in `mask`.
pub(super) fn drop_masked(keypoints: &mut Vec<Keypoint>, mask: Option<&GrayImage>) {
    if let Some(mask) = mask {
        keypoints.retain(|keypoint| {
            let (x, y) = ((keypoint.x + 0.5) as usize, (keypoint.y + 0.5) as usize);
            x < mask.width() && y < mask.height() && mask.row(y)[x] != 0
        });
    }
}

/// Sorts by response (descending), then `y`, then `x`.
pub(super) fn sort_keypoints(keypoints: &mut [Keypoint]) {
    keypoints.sort_unstable_by(|a, b| {
        b.response
            .total_cmp(&a.response)
            .then(a.y.total_cmp(&b.y))
            .then(a.x.total_cmp(&b.x))
    });
}

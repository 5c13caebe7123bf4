//! Which corners would ORB, FAST or AGAST find, described by our BRIEF?
//!
//! The detectors are OpenCV's; masks, order, cut and descriptors are ours, so that their features
//! go wherever those of [`StarBrief`](super::StarBrief) go. ORB's corners come from a pyramid of 8
//! levels that shrink by 1.2 and are described in the full image, upright: BRIEF looks at the same
//! patch size on every level.
//!
//! Sources: Rublee et al., *ORB*, ICCV 2011; Rosten, Drummond, *Machine learning for high-speed
//! corner detection*, ECCV 2006; Mair et al., *Adaptive and generic corner detection* (AGAST), ECCV
//! 2010. Not for: bit-exactness between OpenCV versions, which these detectors do not promise.

use opencv::core::{KeyPoint, Mat, Vector};
use opencv::features2d::{
    AgastFeatureDetector, AgastFeatureDetector_DetectorType, FastFeatureDetector,
    FastFeatureDetector_DetectorType, ORB, ORB_ScoreType,
};
use opencv::prelude::*;

use super::brief::{self, BORDER_PX};
use super::selection::{check_mask, drop_masked, sort_keypoints};
use super::{Extractor, ExtractorConfig, Features, GrayImage, GrayView, Keypoint};
use crate::simd::Kernel;
use fremen::error::{Error, ErrorKind, Result};

/// Corners of an OpenCV detector with BRIEF-32 descriptors.
pub struct CornerBrief {
    config: ExtractorConfig,
}

impl CornerBrief {
    /// An extractor of [`ExtractorConfig::OrbBrief`], [`FastBrief`](ExtractorConfig::FastBrief) or
    /// [`AgastBrief`](ExtractorConfig::AgastBrief); another kind is a [`ErrorKind::Config`] error.
    pub fn new(config: ExtractorConfig) -> Result<Self> {
        match config {
            ExtractorConfig::OrbBrief(_)
            | ExtractorConfig::FastBrief(_)
            | ExtractorConfig::AgastBrief(_) => Ok(Self { config }),
            other => Err(Error::new(
                ErrorKind::Config,
                format!("`{other}` is no corner detector"),
            )),
        }
    }

    /// Every corner of a picture (not empty) and how many features to keep of them.
    fn corners(&self, image: GrayView<'_>, mask: Option<&GrayImage>) -> opencv::Result<Corners> {
        let mut found = Vector::<KeyPoint>::new();
        let pixels = image.pixels();
        let pixels = matrix(image, &pixels)?;
        let mask = match mask {
            Some(mask) => matrix(mask.view(), mask.data())?.try_clone()?,
            None => Mat::default(),
        };
        let num_features = match &self.config {
            ExtractorConfig::StarBrief(_) | ExtractorConfig::Onnx(_) => 0,
            ExtractorConfig::FastBrief(config) => {
                FastFeatureDetector::create(
                    i32::from(config.threshold()),
                    true,
                    FastFeatureDetector_DetectorType::TYPE_9_16,
                )?
                .detect(&pixels, &mut found, &mask)?;
                config.num_features()
            }
            ExtractorConfig::AgastBrief(config) => {
                AgastFeatureDetector::create(
                    i32::from(config.threshold()),
                    true,
                    AgastFeatureDetector_DetectorType::OAST_9_16,
                )?
                .detect(&pixels, &mut found, &mask)?;
                config.num_features()
            }
            ExtractorConfig::OrbBrief(config) => {
                // Its share of corners per level and its own border follow from these numbers.
                let wanted = config.num_features().min(MAX_ORB_CORNERS) as i32;
                let (scale, levels, border) = (1.2, 8, 31);
                ORB::create(
                    wanted,
                    scale,
                    levels,
                    border,
                    0,
                    2,
                    ORB_ScoreType::HARRIS_SCORE,
                    border,
                    i32::from(config.threshold()),
                )?
                .detect(&pixels, &mut found, &mask)?;
                config.num_features()
            }
        };
        let keypoints = found
            .iter()
            .map(|point| Keypoint {
                x: point.pt().x,
                y: point.pt().y,
                size: point.size(),
                response: point.response(),
            })
            .collect();
        Ok((keypoints, num_features))
    }
}

/// More corners than any picture needs; ORB allocates for as many as are requested.
const MAX_ORB_CORNERS: usize = 1_000_000;

/// Keypoints in no particular order, and how many to keep.
type Corners = (Vec<Keypoint>, usize);

fn matrix<'a>(
    image: GrayView<'_>,
    pixels: &'a [u8],
) -> opencv::Result<opencv::boxed_ref::BoxedRef<'a, Mat>> {
    Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, pixels)
}

impl Extractor for CornerBrief {
    fn id(&self) -> String {
        self.config.id()
    }

    fn extract_into(
        &self,
        image: GrayView<'_>,
        mask: Option<&GrayImage>,
        features: &mut Features,
    ) -> Result<()> {
        check_mask(image, mask)?;
        let (width, height) = (image.width(), image.height());
        if width.min(height) <= 2 * BORDER_PX {
            features.truncate(0);
            return Ok(());
        }
        if i32::try_from(width.max(height)).is_err() {
            return Err(Error::new(
                ErrorKind::Format,
                "the image is too big for OpenCV",
            ));
        }
        let (mut found, num_features) = self
            .corners(image, mask)
            .map_err(|cause| Error::new(ErrorKind::Format, format!("OpenCV: {}", cause.message)))?;
        drop_masked(&mut found, mask);
        found.retain(|keypoint| brief::is_describable(keypoint, width, height));
        sort_keypoints(&mut found);
        found.truncate(num_features);
        let (keypoints, descriptors) = features.parts_mut();
        keypoints.clear();
        keypoints.append(&mut found);
        brief::describe(
            image,
            keypoints,
            Kernel::best(),
            &mut brief::BriefScratch::default(),
            descriptors,
        );
        Ok(())
    }
}

//! What stands out in this image?
//!
//! Conventions: `x` to the right and `y` down, in pixels, with the centre of the upper-left pixel
//! at (0, 0) as in OpenCV. Images are 8-bit grey, row by row without padding. A descriptor is 256
//! bits; bit `i` of BRIEF is stored at bit `7 - i % 8` of byte `i / 8`, byte `b` at bits `8 * (b %
//! 8)..` of word `b / 8`, so that the 32 bytes are OpenCV's.

pub mod brief;
mod brief_pairs;
mod extractor_config;
pub mod image_file;
#[cfg(feature = "opencv")]
pub mod opencv_input;
#[cfg(feature = "opencv")]
pub mod opencv_keypoints;
mod selection;
pub mod star;
mod star_brief;
mod types;

pub use extractor_config::{CornerBriefConfig, ExtractorConfig};
pub use image_file::{DecodeLimits, LoadOptions, PixelDigest, Rotation, load_gray, load_mask};
pub use star_brief::{StarBrief, StarBriefConfig};
pub use types::{Descriptor, Features, FeaturesView, GrayImage, Keypoint, Rect};

use fremen::error::Result;

/// Finds keypoints in a grey image and describes them.
///
/// The result is sorted by response (descending), then `y`, then `x`, so that it is the same for
/// every run and any number of threads. An image too small or too dark for any keypoint gives empty
/// [`Features`], not an error.
pub trait Extractor: Send + Sync {
    /// Names the algorithm and every parameter that changes its output; stored in maps, so that a
    /// query extracted in another way is refused.
    fn id(&self) -> String;

    /// At most the configured number of features of `image`, strongest first.
    ///
    /// `mask`, where given, has the image's size; keypoints on its zero pixels are dropped.
    fn extract(&self, image: &GrayImage, mask: Option<&GrayImage>) -> Result<Features>;

    /// [`extract`](Self::extract) in place of what `features` held, whose memory is used again.
    ///
    /// After an error `features` hold nothing of use.
    fn extract_into(
        &self,
        image: &GrayImage,
        mask: Option<&GrayImage>,
        features: &mut Features,
    ) -> Result<()> {
        *features = self.extract(image, mask)?;
        Ok(())
    }
}

//! What stands out in this image?
//!
//! Conventions: `x` to the right and `y` down, in pixels, with the centre of the upper-left pixel
//! at (0, 0) as in OpenCV. Images are 8-bit grey, row by row; only a
//! borrowed [`GrayView`] may have padding between rows. A descriptor is 256
//! bits; bit `i` of BRIEF is stored at bit `7 - i % 8` of byte `i / 8`, byte `b` at bits `8 * (b %
//! 8)..` of word `b / 8`, so that the 32 bytes are OpenCV's.

pub mod brief;
mod brief_pairs;
mod build;
#[cfg(feature = "dataset")]
mod exif;
mod extractor;
mod extractor_config;
mod gray;
#[cfg(feature = "dataset")]
pub mod image_file;
mod luma;
mod onnx;
#[cfg(feature = "opencv")]
pub mod opencv_input;
#[cfg(feature = "opencv")]
pub mod opencv_keypoints;
mod selection;
pub mod star;
mod star_brief;
mod star_brief_config;
mod transform;
mod types;
#[cfg(feature = "dataset")]
mod whole;

#[cfg(feature = "dataset")]
pub use exif::{ExifStamp, ExifStamps, exif_stamps};
pub use extractor::Extractor;
pub use extractor_config::{CornerBriefConfig, ExtractorConfig};
pub(crate) use gray::shown_by_both;
pub use gray::{GrayImage, GrayView, Rect};
#[cfg(feature = "dataset")]
pub use image_file::{
    DecodeLimits, LoadOptions, decode_gray, encoded_size, load_gray, load_mask, picture_size,
};
#[cfg(feature = "onnx")]
pub use onnx::OnnxExtractor;
pub use onnx::{Model, ModelDigest, Models, OnnxConfig};
pub use star_brief::StarBrief;
pub use star_brief_config::StarBriefConfig;
pub use transform::{PixelDigest, Rotation, mask_from_rects};
pub use types::{Descriptor, Features, FeaturesView, Keypoint};

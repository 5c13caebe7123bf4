//! What does every extractor of features do?

use super::types::{Features, GrayImage};
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

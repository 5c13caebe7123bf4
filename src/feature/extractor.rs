//! What does every extractor promise?

use super::{Features, GrayImage, GrayView};
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

    /// Replaces what `features` held, whose memory is used again, by at most the configured number
    /// of features of `image`, strongest first.
    ///
    /// `mask`, where given, has the image's size; keypoints on its zero pixels are dropped. After
    /// an error `features` hold nothing of use.
    fn extract_into(
        &self,
        image: GrayView<'_>,
        mask: Option<&GrayImage>,
        features: &mut Features,
    ) -> Result<()>;

    /// [`extract_into`](Self::extract_into) new features, of an image that is owned.
    fn extract(&self, image: &GrayImage, mask: Option<&GrayImage>) -> Result<Features> {
        let mut features = Features::new();
        self.extract_into(image.view(), mask, &mut features)?;
        Ok(features)
    }
}

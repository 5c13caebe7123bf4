//! How does a configuration become an extractor?

#[cfg(feature = "onnx")]
use super::OnnxExtractor;
#[cfg(feature = "opencv")]
use super::opencv_keypoints::CornerBrief;
use super::{Extractor, ExtractorConfig, Models, StarBrief};
use fremen::error::Result;
#[cfg(not(all(feature = "opencv", feature = "onnx")))]
use fremen::error::{Error, ErrorKind};

impl ExtractorConfig {
    /// [`build_with`](Self::build_with) the models that [`Models::from_env`] finds.
    pub fn build(&self) -> Result<Box<dyn Extractor>> {
        self.build_with(&Models::from_env())
    }

    /// The extractor; a network is looked for among `models`.
    ///
    /// Parameters it cannot work with, or an extractor that this build lacks, are a
    /// [`ErrorKind::Config`](fremen::ErrorKind::Config) error; a network that is not there or cannot
    /// be used fails as [`OnnxConfig`](super::OnnxConfig)'s extractor says.
    #[cfg_attr(
        not(feature = "onnx"),
        expect(unused_variables, reason = "only networks are looked for")
    )]
    pub fn build_with(&self, models: &Models) -> Result<Box<dyn Extractor>> {
        match self {
            Self::StarBrief(config) => Ok(Box::new(StarBrief::new(config.clone())?)),
            #[cfg(feature = "opencv")]
            Self::OrbBrief(_) | Self::FastBrief(_) | Self::AgastBrief(_) => {
                Ok(Box::new(CornerBrief::new(self.clone())?))
            }
            #[cfg(not(feature = "opencv"))]
            Self::OrbBrief(_) | Self::FastBrief(_) | Self::AgastBrief(_) => Err(Error::new(
                ErrorKind::Config,
                format!("this build has no OpenCV, which `{}` needs", self.id()),
            )
            .with_help("build with `--features opencv`, or use the kind `star-brief`")),
            #[cfg(feature = "onnx")]
            Self::Onnx(config) => Ok(Box::new(OnnxExtractor::new(config.clone(), models)?)),
            #[cfg(not(feature = "onnx"))]
            Self::Onnx(_) => Err(Error::new(
                ErrorKind::Config,
                format!(
                    "this build cannot run networks, which `{}` needs",
                    self.id()
                ),
            )
            .with_help("build with `--features onnx`, or use the kind `star-brief`")),
        }
    }
}

//! How does a configuration become an extractor?

#[cfg(feature = "opencv")]
use super::opencv_keypoints::CornerBrief;
use super::{Extractor, ExtractorConfig, StarBrief};
use fremen::error::Result;
#[cfg(not(feature = "opencv"))]
use fremen::error::{Error, ErrorKind};

impl ExtractorConfig {
    /// The extractor; parameters it cannot work with, or one that this build lacks, are a
    /// [`ErrorKind::Config`](fremen::ErrorKind::Config) error.
    pub fn build(&self) -> Result<Box<dyn Extractor>> {
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
        }
    }
}

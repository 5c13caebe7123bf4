//! What does the camera see?

use crate::feature::Features;
use crate::map::NodeId;
use fremen::time::Time;

/// A live image, as far as localisation needs it.
///
/// ```
/// # use chronotope::{Time, feature::Features, localize::Query};
/// # let (features, time) = (Features::new(), Time::default());
/// let query = Query::new(&features).at(time).with_image_size((640, 480));
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Query<'a> {
    /// The features of the live image, by the extractor the map was learnt with.
    pub features: &'a Features,
    /// When it was taken; `static`, `experience` and `experience-all` do without.
    pub time: Option<Time>,
    /// Width and height of the image in px, to be compared with the map's.
    pub image_size: Option<(u32, u32)>,
    /// The places where the robot may be, as far as is known; empty if it may be anywhere.
    pub prior: &'a [NodeId],
}

impl<'a> Query<'a> {
    /// An image of which the features are known, and nothing else.
    pub fn new(features: &'a Features) -> Self {
        Self {
            features,
            time: None,
            image_size: None,
            prior: &[],
        }
    }

    /// The image was taken at `time`; `None` if that is not known.
    #[must_use]
    pub fn at(mut self, time: impl Into<Option<Time>>) -> Self {
        self.time = time.into();
        self
    }

    /// The image has this width and height in px; `None` leaves them unchecked.
    #[must_use]
    pub fn with_image_size(mut self, image_size: impl Into<Option<(u32, u32)>>) -> Self {
        self.image_size = image_size.into();
        self
    }

    /// The robot is probably at one of these places, in any order: by a position, by the way it took
    /// ([`Tracker::plausible_into`](super::Tracker::plausible_into)). Empty: it may be anywhere.
    ///
    /// This saves work: these places are matched, and where they are few some others from all over
    /// the map, which say what an image scores where it was not taken. If the image decides for none
    /// of them, all places are searched in the same call, so that a robot that was carried away is
    /// noticed at the first image that looks like nothing near by.
    #[must_use]
    pub fn with_prior(mut self, prior: &'a [NodeId]) -> Self {
        self.prior = prior;
        self
    }
}

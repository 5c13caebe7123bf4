//! How does a robot use its map?

use std::time::Duration;

use crate::feature::{GrayImage, Models};
use crate::learn::LearnConfig;
use crate::localize::{IndexCache, LocalizerConfig, MotionConfig};

/// Commits are at least this far apart, unless said otherwise.
const COMMIT_INTERVAL: Duration = Duration::from_secs(1);

/// Where the learner of a robot runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// Between two images.
    Inline,
    /// On a thread of its own, which never keeps an image waiting.
    Thread,
}

/// What a [`Robot`](super::Robot) does with each image.
///
/// By default it localises with the shipped configuration and learns nothing.
#[derive(Clone, Debug)]
pub struct RobotConfig {
    pub(super) localize: LocalizerConfig,
    pub(super) index_cache: IndexCache,
    pub(super) models: Models,
    pub(super) motion: Option<MotionConfig>,
    pub(super) mask: Option<GrayImage>,
    pub(super) learn: Option<LearnConfig>,
    pub(super) learns: Place,
    pub(super) is_live: bool,
    pub(super) commit_interval: Duration,
}

impl Default for RobotConfig {
    fn default() -> Self {
        Self {
            localize: LocalizerConfig::default(),
            index_cache: IndexCache::default(),
            models: Models::from_env(),
            motion: None,
            mask: None,
            learn: None,
            learns: Place::Thread,
            is_live: true,
            commit_interval: COMMIT_INTERVAL,
        }
    }
}

impl RobotConfig {
    /// Localises so.
    #[must_use]
    pub fn with_localize(mut self, localize: LocalizerConfig) -> Self {
        self.localize = localize;
        self
    }

    /// Whether what is worked out of a map is kept in a file beside it. A robot that learns has
    /// none.
    #[must_use]
    pub fn with_index_cache(mut self, index_cache: IndexCache) -> Self {
        self.index_cache = index_cache;
        self
    }

    /// Where the network of a map of learned features is looked for; by default in the folder that
    /// the environment names ([`Models::from_env`]).
    #[must_use]
    pub fn with_models(mut self, models: Models) -> Self {
        self.models = models;
        self
    }

    /// Takes the images as one way: what was believed before moves along the map's edges and counts
    /// too. In a map so large that a short list of places is matched, those that the robot may have
    /// reached are matched first, and the others only if it is at none of them. Needs the score
    /// `likelihood`.
    #[must_use]
    pub fn with_tracking(mut self, motion: MotionConfig) -> Self {
        self.motion = Some(motion);
        self
    }

    /// Uses nothing of an image where `mask` is 0: the robot's own arm, a dirty lens. Of the
    /// image's size.
    #[must_use]
    pub fn with_mask(mut self, mask: GrayImage) -> Self {
        self.mask = Some(mask);
        self
    }

    /// Learns each located image as a visit of its place, and commits what was learnt to the map's
    /// file.
    ///
    /// That happens on a second thread: an image that finds it busy is answered but not learnt, and
    /// answers go on with what was learnt as soon as that is ready.
    #[must_use]
    pub fn with_learning(mut self, learn: LearnConfig) -> Self {
        self.learn = Some(learn);
        self
    }

    /// Learns between images instead of on a second thread: slower, every located image is learnt,
    /// and the same images give the same map.
    #[must_use]
    pub fn with_learning_inline(mut self, learn: LearnConfig) -> Self {
        self.learn = Some(learn);
        self.learns = Place::Inline;
        self
    }

    /// The images were taken at some time before, not just now: they may come in any order of time,
    /// and one that is given twice is one visit.
    #[must_use]
    pub fn with_recorded_images(mut self) -> Self {
        self.is_live = false;
        self
    }

    /// Commits at most this often; one second by default, and never more than a tenth of the time.
    #[must_use]
    pub fn with_commit_interval(mut self, interval: Duration) -> Self {
        self.commit_interval = interval;
        self
    }
}

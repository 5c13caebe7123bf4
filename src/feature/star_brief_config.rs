//! With which parameters does the reference recipe look?

use serde::{Deserialize, Serialize};

use super::star::StarParams;

/// The configuration of [`StarBrief`](super::StarBrief); the default is the reference recipe.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StarBriefConfig {
    num_features: usize,
    max_size: u8,
    response_threshold: u16,
    line_threshold_projected: u16,
    line_threshold_binarized: u16,
    suppress_nonmax_size: u8,
}

impl Default for StarBriefConfig {
    fn default() -> Self {
        Self {
            num_features: 500,
            max_size: 45,
            response_threshold: 0,
            line_threshold_projected: 10,
            line_threshold_binarized: 8,
            suppress_nonmax_size: 5,
        }
    }
}

impl StarBriefConfig {
    /// At most this many features of an image, the strongest (500).
    #[must_use]
    pub fn with_num_features(mut self, num_features: usize) -> Self {
        self.num_features = num_features;
        self
    }

    /// The first filter size that is not below this is the largest used, px; 5 to 128 (45).
    #[must_use]
    pub fn with_max_size(mut self, px: u8) -> Self {
        self.max_size = px;
        self
    }

    /// Keypoints have a response of a larger magnitude than this, grey levels (0).
    #[must_use]
    pub fn with_response_threshold(mut self, levels: u16) -> Self {
        self.response_threshold = levels;
        self
    }

    /// `k` of the line test on responses; 4 rejects everything, larger permits more (10).
    #[must_use]
    pub fn with_line_threshold_projected(mut self, ratio: u16) -> Self {
        self.line_threshold_projected = ratio;
        self
    }

    /// `k` of the line test on sizes; 4 rejects everything, larger permits more (8).
    #[must_use]
    pub fn with_line_threshold_binarized(mut self, ratio: u16) -> Self {
        self.line_threshold_binarized = ratio;
        self
    }

    /// Side of the window in which a keypoint is the only extremum, px (5).
    #[must_use]
    pub fn with_suppress_nonmax_size(mut self, px: u8) -> Self {
        self.suppress_nonmax_size = px;
        self
    }

    pub(super) fn num_features(&self) -> usize {
        self.num_features
    }

    pub(super) fn star(&self) -> StarParams {
        StarParams {
            max_size: self.max_size,
            response_threshold: self.response_threshold,
            line_threshold_projected: self.line_threshold_projected,
            line_threshold_binarized: self.line_threshold_binarized,
            suppress_nonmax_size: self.suppress_nonmax_size,
        }
    }
}

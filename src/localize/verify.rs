//! Which matches agree on one displacement of the camera?

use crate::feature::FeaturesView;
use crate::matching::{
    Displacement, Match, Vote, VoteConfig, VoteScratch, displacements_into, vote_displacement,
};

/// The matches of one predicted map or appearance with the live image, verified.
#[derive(Clone, Copy, Debug)]
pub(super) struct Verified<'a> {
    pub(super) matches: &'a [Match],
    /// Whether each match agrees on the displacement of `vote`.
    pub(super) inliers: &'a [bool],
    /// The displacement that most matches agree on.
    pub(super) vote: Vote,
    /// Features whose match does not agree; not all of them need to be among `matches`.
    pub(super) num_outliers: usize,
}

/// Verifies matches; holds the memory that this takes, which is used again.
#[derive(Clone, Debug, Default)]
pub(super) struct Verifier {
    displacements: Vec<Displacement>,
    vote: VoteScratch,
}

impl Verifier {
    /// Finds the displacement that most `matches` agree on.
    pub(super) fn verify<'a>(
        &'a mut self,
        cfg: &VoteConfig,
        matches: &'a [Match],
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
    ) -> Verified<'a> {
        let (map, live) = (map.keypoints, live.keypoints);
        displacements_into(matches, map, live, &mut self.displacements);
        let vote = vote_displacement(cfg, &mut self.vote, &self.displacements);
        Verified {
            matches,
            inliers: self.vote.inliers(),
            vote,
            num_outliers: matches.len() - vote.num_inliers as usize,
        }
    }
}

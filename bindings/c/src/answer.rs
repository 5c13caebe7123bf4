//! What does C learn of an answer?

use engine::localize::{Decision, Localization};

/// What to believe of an image.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChronotopeDecision {
    /// No place fits well enough.
    Unknown = 0,
    /// The robot is at the place.
    At = 1,
    /// It is at the place or at one beside it.
    Near = 2,
    /// It is in the map, but several places fit.
    Ambiguous = 3,
}

/// Where an image was taken. `node` is the first place of the ranking, whatever was decided; its
/// name is `chronotope_..._place_name` of whatever answered.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ChronotopeAnswer {
    /// What to believe.
    pub decision: ChronotopeDecision,
    /// The first place; -1 in a map without places.
    pub node: i64,
    /// The probability of being there.
    pub posterior: f64,
    /// The probability of being at no place of the map.
    pub off_map: f64,
    /// What it was ranked by.
    pub score: f64,
    /// How many places are ranked.
    pub num_ranked: usize,
    /// How many of them share the best score.
    pub num_tied: usize,
    /// Features of the image.
    pub num_features: usize,
    /// How many features of the first place were found in it.
    pub num_matches: u32,
    /// How many of those agree on a displacement.
    pub num_inliers: u32,
    /// That displacement: by how much the image is moved to the right and down, px.
    pub dx_px: f64,
    /// Down.
    pub dy_px: f64,
}

/// One place of a ranking.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ChronotopeCandidate {
    /// The place.
    pub node: u32,
    /// Features of it that were found.
    pub num_matches: u32,
    /// How many of those agree on a displacement.
    pub num_inliers: u32,
    /// What it is ranked by.
    pub score: f64,
    /// The probability of being there.
    pub posterior: f64,
}

impl ChronotopeAnswer {
    pub(crate) fn of(answer: &Localization, num_features: usize) -> Self {
        let first = answer.first();
        let vote = first
            .map(|it| it.displacement)
            .filter(|vote| vote.num_inliers > 0);
        Self {
            decision: match answer.decision {
                Decision::At(_) => ChronotopeDecision::At,
                Decision::Near(_) => ChronotopeDecision::Near,
                Decision::Ambiguous => ChronotopeDecision::Ambiguous,
                _ => ChronotopeDecision::Unknown,
            },
            node: first.map_or(-1, |it| i64::from(it.node.0)),
            posterior: first.map_or(0.0, |it| it.posterior),
            off_map: answer.off_map,
            score: first.map_or(0.0, |it| it.score),
            num_ranked: answer.ranking.len(),
            num_tied: answer.tied,
            num_features,
            num_matches: first.map_or(0, |it| it.num_matches),
            num_inliers: first.map_or(0, |it| it.num_inliers),
            dx_px: vote.map_or(0.0, |vote| vote.median.dx_px),
            dy_px: vote.map_or(0.0, |vote| vote.median.dy_px),
        }
    }
}

impl ChronotopeCandidate {
    pub(crate) fn of(answer: &Localization, rank: usize) -> Option<Self> {
        answer.ranking.get(rank).map(|it| Self {
            node: it.node.0,
            num_matches: it.num_matches,
            num_inliers: it.num_inliers,
            score: it.score,
            posterior: it.posterior,
        })
    }
}

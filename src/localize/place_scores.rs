//! What speaks for one place, counted in each of the ways that places are ranked by?

use super::config::Score;

/// What speaks for one place at one n.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaceScores {
    /// The number of matches.
    pub count: u32,
    /// Matches that agree on one displacement.
    pub inliers: u32,
    /// Log odds of being at the place against another one; 0 without calibration.
    pub log_odds: f64,
    /// What they are in an image in which nothing of the place is found; 0 without calibration.
    pub log_odds_of_nothing: f64,
}

impl PlaceScores {
    /// The number that `score` ranks by.
    pub fn by(self, score: Score) -> f64 {
        match score {
            Score::Count => f64::from(self.count),
            Score::Inliers => f64::from(self.inliers),
            Score::Likelihood => self.log_odds,
        }
    }
}

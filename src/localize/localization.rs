//! What was answered, and why?

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{LocalizerConfig, Score};
use crate::map::NodeId;
use crate::matching::{Match, Vote, VoteScratch};
use crate::predict::PredictedMap;
use crate::time::Time;

/// The answer to one query with all its evidence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Localization {
    /// Every place, best score first, ties by lowest node.
    pub ranking: Vec<Candidate>,
    /// How many places share the best score; 1 where one place stands alone.
    pub tied: usize,
    /// The posterior share of "none of these places"; uncalibrated like [`Candidate::posterior`].
    pub elsewhere: f64,
    /// What to believe.
    pub decision: Decision,
    /// The numbers behind the decision.
    pub reason: Reason,
    /// Hamming distances computed.
    pub pairs_compared: u64,
    /// The time that was predicted for.
    pub time: Option<Time>,
}

/// What to believe of a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Decision {
    /// The robot is here.
    At(NodeId),
    /// Several places fit equally well.
    Ambiguous,
    /// No place fits well enough.
    #[default]
    Unknown,
}

/// The numbers behind a [`Decision`]; shown as a sentence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Reason {
    /// Score of the first place.
    pub best: u32,
    /// Score of the second place; `None` in a map of one place.
    pub second: Option<u32>,
    /// The least score that counts as an answer.
    pub min_score: u32,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            best,
            second,
            min_score,
        } = self;
        if best < min_score {
            return write!(
                f,
                "the best place scores {best}, below the least score {min_score}"
            );
        }
        match second {
            Some(second) if second == best => {
                write!(f, "several places share the best score {best}")
            }
            Some(second) => write!(f, "the best place scores {best}, the second {second}"),
            None => write!(f, "the only place scores {best}"),
        }
    }
}

/// What speaks for one place.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Candidate {
    /// The place.
    pub node: NodeId,
    /// What it is ranked by.
    pub score: u32,
    /// Its share `(score + 1) / sum of (score + 1)` over all places and "elsewhere", which scores 0.
    /// Not calibrated: it orders places as the score does, and is no probability of being right.
    pub posterior: f64,
    /// The visit whose appearance fits best; `None` for methods that predict one map.
    pub appearance: Option<u32>,
    /// Ids within the node of the features that were predicted, most likely first; empty for the
    /// experience methods, whose appearance says it.
    pub predicted: Vec<u32>,
    /// p(t) of each predicted feature.
    pub probabilities: Vec<f64>,
    /// Predicted features found in the live image, by rank (lttl: by live feature).
    pub matches: Vec<EvidenceMatch>,
    /// Matches.
    pub num_matches: u32,
    /// Matches that agree on one displacement.
    pub num_inliers: u32,
    /// The displacement of the inliers, px.
    pub displacement: Vote,
}

/// One feature of a place that is one feature of the live image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct EvidenceMatch {
    /// Index into [`Candidate::predicted`], or into the appearance's features.
    pub rank: u32,
    /// Index into the live image's features.
    pub live: u32,
    /// Hamming distance, bits.
    pub distance_bits: u16,
    /// Whether it agrees on the displacement.
    pub inlier: bool,
}

impl Localization {
    /// The first place, whatever the decision; `None` in a map without places.
    pub fn first(&self) -> Option<&Candidate> {
        self.ranking.first()
    }

    pub(super) fn restart(&mut self, num_nodes: usize, time: Option<Time>) {
        self.ranking.resize_with(num_nodes, Candidate::default);
        self.pairs_compared = 0;
        self.time = time;
    }

    /// Sorts the places, shares out the posterior and decides.
    pub(super) fn rank(&mut self, min_score: u32) {
        self.ranking
            .sort_unstable_by_key(|candidate| (std::cmp::Reverse(candidate.score), candidate.node));
        let total: f64 = 1.0
            + (self.ranking.iter())
                .map(|candidate| f64::from(candidate.score) + 1.0)
                .sum::<f64>();
        self.elsewhere = 1.0 / total;
        for candidate in &mut self.ranking {
            candidate.posterior = (f64::from(candidate.score) + 1.0) / total;
        }
        let best = self.first().map_or(0, |first| first.score);
        self.tied = (self.ranking.iter())
            .take_while(|candidate| candidate.score == best)
            .count();
        self.reason = Reason {
            best,
            second: self.ranking.get(1).map(|second| second.score),
            min_score,
        };
        self.decision = match self.first() {
            Some(first) if best >= min_score && self.tied == 1 => Decision::At(first.node),
            Some(_) if best >= min_score => Decision::Ambiguous,
            _ => Decision::Unknown,
        };
    }
}

impl Candidate {
    pub(super) fn restart(&mut self, node: NodeId) {
        self.node = node;
        self.score = 0;
        self.posterior = 0.0;
        self.appearance = None;
        self.predicted.clear();
        self.probabilities.clear();
        self.matches.clear();
        self.num_matches = 0;
        self.num_inliers = 0;
        self.displacement = Vote::default();
    }

    pub(super) fn predict(&mut self, map: &PredictedMap) {
        self.predicted.extend_from_slice(map.features());
        self.probabilities.extend_from_slice(map.probabilities());
    }

    /// Takes over the evidence of one predicted map or appearance.
    pub(super) fn explain(
        &mut self,
        cfg: &LocalizerConfig,
        matches: &[Match],
        inliers: &VoteScratch,
        vote: &Vote,
    ) {
        self.num_matches = matches.len() as u32;
        self.num_inliers = vote.num_inliers;
        self.displacement = *vote;
        self.score = score(cfg, matches, vote);
        self.matches.clear();
        let inliers = inliers.inliers().iter();
        self.matches.extend(
            matches
                .iter()
                .zip(inliers)
                .map(|(found, &inlier)| EvidenceMatch {
                    rank: found.map,
                    live: found.live,
                    distance_bits: found.distance_bits,
                    inlier,
                }),
        );
    }

    /// Takes over the evidence of an appearance if it is the first or scores higher than those before.
    pub(super) fn improve(
        &mut self,
        cfg: &LocalizerConfig,
        visit: u32,
        matches: &[Match],
        inliers: &VoteScratch,
        vote: &Vote,
    ) {
        if self.appearance.is_none() || score(cfg, matches, vote) > self.score {
            self.appearance = Some(visit);
            self.explain(cfg, matches, inliers, vote);
        }
    }
}

fn score(cfg: &LocalizerConfig, matches: &[Match], vote: &Vote) -> u32 {
    match cfg.score() {
        Score::Count => matches.len() as u32,
        Score::Inliers => vote.num_inliers,
    }
}

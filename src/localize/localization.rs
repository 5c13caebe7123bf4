//! What was answered, and why?

use std::fmt;

use serde::{Deserialize, Serialize};

use super::config::{LocalizerConfig, Score};
use super::verify::Verified;
use crate::map::NodeId;
use crate::matching::Vote;
use fremen::time::Time;

/// The answer to one query with all its evidence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Localization {
    /// Every place that was matched, best score first, ties by lowest node: all of them, or in a
    /// large map those on a short list ([`PlaceSearch`](super::PlaceSearch)); the others count as
    /// the last of these.
    pub ranking: Vec<Candidate>,
    /// How many places share the best score; 1 where one place stands alone.
    pub tied: usize,
    /// The posterior probability of being at none of the places; see [`Candidate::posterior`].
    #[serde(rename = "elsewhere")]
    pub off_map: f64,
    /// What to believe, given the posteriors and the risk that is allowed.
    pub decision: Decision,
    /// The places that hold the probability which the risk asks for: the one that was located, or
    /// the first and some of those beside it, most probable first; empty where no such places are.
    #[serde(default)]
    pub region: Vec<NodeId>,
    /// The numbers behind the decision.
    pub reason: Reason,
    /// How many Hamming distances were computed.
    pub pairs_compared: u64,
    /// The query's time; predicted for was the middle of its bucket
    /// ([`LocalizerConfig::with_time_bucket_s`]).
    pub time: Option<Time>,
}

/// What to believe of a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Decision {
    /// The robot is here.
    At(NodeId),
    /// The robot is here or at a place beside it: together they are as sure as the risk asks for,
    /// and no one of them is. See [`Localization::region`].
    Near(NodeId),
    /// Surely in the map, but several places fit.
    Ambiguous,
    /// No place fits well enough.
    #[default]
    Unknown,
}

impl Decision {
    /// At `node`, the most probable place, if the probability of being wrong is at most `risk`; in
    /// the map but ambiguous, if that is all that is as sure; unknown otherwise.
    pub fn by_risk(node: NodeId, posterior: f64, off_map: f64, risk: f64) -> Self {
        Self::by_region(&[], node, |_| posterior, off_map, risk, &mut Vec::new())
    }

    /// At `node`, the best place, if the probability of being wrong is at most `risk`; near it, if
    /// that is so together with places `beside` it; in the map but ambiguous, if that is all that
    /// is as sure; unknown otherwise.
    ///
    /// `posterior` says how probable a place is; `region` gets the places that were needed, most
    /// probable first.
    pub(super) fn by_region(
        beside: &[u32],
        node: NodeId,
        posterior: impl Fn(NodeId) -> f64,
        off_map: f64,
        risk: f64,
        region: &mut Vec<NodeId>,
    ) -> Self {
        region.clear();
        region.push(node);
        let mut total = posterior(node);
        if 1.0 - total <= risk {
            return Self::At(node);
        }
        while let Some(next) = (beside.iter().map(|&node| NodeId(node)))
            .filter(|node| !region.contains(node))
            .max_by(|a, b| posterior(*a).total_cmp(&posterior(*b)).then(b.cmp(a)))
        {
            region.push(next);
            total += posterior(next);
            if 1.0 - total <= risk {
                return Self::Near(node);
            }
        }
        region.clear();
        if off_map <= risk {
            Self::Ambiguous
        } else {
            Self::Unknown
        }
    }

    /// The place that was located, or the first of those that were; `None` otherwise.
    pub fn place(self) -> Option<NodeId> {
        match self {
            Self::At(node) | Self::Near(node) => Some(node),
            Self::Ambiguous | Self::Unknown => None,
        }
    }
}

/// The numbers behind a [`Decision`]; shown as a sentence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Reason {
    /// Score of the first place.
    pub best: f64,
    /// Score of the second place; `None` in a map of one place.
    pub second: Option<f64>,
    /// What the decision was taken by.
    pub rule: Rule,
}

/// What a decision is taken by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// The least score that counts as an answer.
    MinScore(u32),
    /// The posterior against the probability of being wrong that an answer may have.
    #[serde(rename_all = "kebab-case")]
    Risk {
        /// What an answer may risk.
        allowed: f64,
        /// The posterior of the first place.
        first: f64,
        /// The posterior of being at none of the places.
        #[serde(rename = "elsewhere")]
        off_map: f64,
    },
}

impl Default for Rule {
    fn default() -> Self {
        Self::MinScore(1)
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { best, second, rule } = *self;
        match (rule, second) {
            (Rule::MinScore(least), _) if best < f64::from(least) => {
                write!(
                    f,
                    "the best place scores {best}, below the least score {least}"
                )
            }
            (Rule::MinScore(_), Some(second)) if second == best => {
                write!(f, "several places share the best score {best}")
            }
            (Rule::MinScore(_), Some(second)) => {
                write!(f, "the best place scores {best}, the second {second}")
            }
            (Rule::MinScore(_), None) => write!(f, "the only place scores {best}"),
            (
                Rule::Risk {
                    allowed,
                    first,
                    off_map,
                },
                _,
            ) => {
                let percent = |p: f64| 100.0 * p;
                let (first, off_map) = (percent(first), percent(off_map));
                let needed = percent(1.0 - allowed);
                write!(
                    f,
                    "the best place has {first:.1} % (an answer needs {needed:.1} %), off the map \
                     {off_map:.1} %"
                )
            }
        }
    }
}

/// What speaks for one place.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Candidate {
    /// The place that this is said of.
    pub node: NodeId,
    /// What it is ranked by.
    pub score: f64,
    /// The probability of being here, by a calibration on past visits
    /// ([`Calibration`](super::Calibration)). Where the configuration wants none, its share
    /// `(score + 1) / sum of (score + 1)` over all places and being off the map, which scores 0:
    /// that orders places as the score does, and is no probability of being right.
    pub posterior: f64,
    /// The visit whose appearance fits best; `None` for methods that predict one map.
    pub appearance: Option<u32>,
    /// Ids within the node of the features that were predicted, in order of choice; empty for the
    /// experience methods, whose appearance says it.
    pub predicted: Vec<u32>,
    /// p(t) of each predicted feature.
    pub probabilities: Vec<f64>,
    /// Predicted features found in the live image, by rank (lttl: by live feature).
    pub matches: Vec<EvidenceMatch>,
    /// How many features of the place were matched.
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

    pub(super) fn restart(&mut self, num_places: usize) {
        // Every place gets its own buffers back, which have grown to what it needs.
        self.ranking
            .sort_unstable_by_key(|candidate| candidate.node);
        self.ranking.resize_with(num_places, Candidate::default);
        self.pairs_compared = 0;
    }

    /// Gives every place a share of the posterior by its score: an order, no probability.
    pub(super) fn share_scores(&mut self) {
        let total: f64 = 1.0 + (self.ranking.iter()).map(|it| it.score + 1.0).sum::<f64>();
        self.off_map = 1.0 / total;
        for candidate in &mut self.ranking {
            candidate.posterior = (candidate.score + 1.0) / total;
        }
    }

    /// Sorts the places and decides: by the posterior where it is calibrated, by the least score
    /// otherwise.
    pub(super) fn decide<'a>(
        &mut self,
        cfg: &LocalizerConfig,
        beside: impl Fn(NodeId) -> &'a [u32],
    ) {
        let by_score = |a: &Candidate, b: &Candidate| b.score.total_cmp(&a.score);
        (self.ranking).sort_unstable_by(|a, b| by_score(a, b).then(a.node.cmp(&b.node)));
        let best = self.first().map_or(0.0, |first| first.score);
        self.tied = (self.ranking.iter())
            .take_while(|candidate| candidate.score == best)
            .count();
        let first = self.first().map_or(0.0, |first| first.posterior);
        let rule = match cfg.score() {
            Score::Likelihood => Rule::Risk {
                allowed: cfg.risk(),
                first,
                off_map: self.off_map,
            },
            Score::Count | Score::Inliers => Rule::MinScore(cfg.min_score()),
        };
        self.reason = Reason {
            best,
            second: self.ranking.get(1).map(|second| second.score),
            rule,
        };
        self.region.clear();
        self.decision = match (self.ranking.first(), rule) {
            (None, _) => Decision::Unknown,
            (Some(first), Rule::Risk { allowed, .. }) => {
                let node = first.node;
                self.decide_by_risk(beside(node), node, allowed)
            }
            (Some(_), Rule::MinScore(least)) if best < f64::from(least) => Decision::Unknown,
            (Some(first), _) if self.tied == 1 => {
                self.region.push(first.node);
                Decision::At(first.node)
            }
            (Some(_), _) => Decision::Ambiguous,
        };
    }

    fn decide_by_risk(&mut self, beside: &[u32], node: NodeId, allowed: f64) -> Decision {
        let mut region = std::mem::take(&mut self.region);
        let posterior = |node: NodeId| {
            let of_node = self.ranking.iter().find(|it| it.node == node);
            of_node.map_or(0.0, |candidate| candidate.posterior)
        };
        let decision =
            Decision::by_region(beside, node, posterior, self.off_map, allowed, &mut region);
        self.region = region;
        decision
    }
}

impl Localization {
    /// Takes over what is believed of each place, by node, and of being off the map, and decides by
    /// that.
    pub(super) fn follow<'a>(
        &mut self,
        cfg: &LocalizerConfig,
        beside: impl Fn(NodeId) -> &'a [u32],
        belief: &[f64],
        off_map: f64,
    ) {
        for candidate in &mut self.ranking {
            candidate.posterior = belief[candidate.node.0 as usize];
        }
        let by_belief = |a: &Candidate, b: &Candidate| b.posterior.total_cmp(&a.posterior);
        (self.ranking).sort_unstable_by(|a, b| by_belief(a, b).then(a.node.cmp(&b.node)));
        self.off_map = off_map;
        let first = self.first().map_or(0.0, |first| first.posterior);
        self.tied = (self.ranking.iter())
            .take_while(|candidate| candidate.posterior == first)
            .count();
        self.reason = Reason {
            best: self.first().map_or(0.0, |first| first.score),
            second: self.ranking.get(1).map(|second| second.score),
            rule: Rule::Risk {
                allowed: cfg.risk(),
                first,
                off_map,
            },
        };
        self.region.clear();
        self.decision = match self.first().map(|place| place.node) {
            Some(node) => self.decide_by_risk(beside(node), node, cfg.risk()),
            None => Decision::Unknown,
        };
    }
}

impl Candidate {
    pub(super) fn restart(&mut self, node: NodeId) {
        self.node = node;
        self.score = 0.0;
        self.posterior = 0.0;
        self.appearance = None;
        self.predicted.clear();
        self.probabilities.clear();
        self.matches.clear();
        self.num_matches = 0;
        self.num_inliers = 0;
        self.displacement = Vote::default();
    }

    pub(super) fn predict(&mut self, features: &[u32], probabilities: &[f64]) {
        self.predicted.extend_from_slice(features);
        self.probabilities.extend_from_slice(probabilities);
        // So that a place new to a short list does not allocate when it is found.
        self.matches.reserve(features.len());
    }

    /// Takes over the evidence of the predicted map, or of one appearance if it is the first or
    /// says more than those before.
    pub(super) fn record(
        &mut self,
        cfg: &LocalizerConfig,
        visit: Option<u32>,
        verified: &Verified<'_>,
        log_odds: f64,
    ) {
        let Verified {
            matches,
            inliers,
            vote,
            ..
        } = *verified;
        let score = match cfg.score() {
            Score::Count => matches.len() as f64,
            Score::Inliers => f64::from(vote.num_inliers),
            Score::Likelihood => log_odds,
        };
        if self.appearance.is_some() && score <= self.score {
            return;
        }
        self.appearance = visit;
        self.score = score;
        self.num_matches = matches.len() as u32;
        self.num_inliers = vote.num_inliers;
        self.displacement = vote;
        self.matches.clear();
        (self.matches).extend((matches.iter().zip(inliers)).map(|(found, &inlier)| {
            EvidenceMatch {
                rank: found.map,
                live: found.live,
                distance_bits: found.distance_bits,
                inlier,
            }
        }));
    }

    /// The place speaks by the mean likelihood of its appearances, not by the best of them.
    pub(super) fn finalize(&mut self, score: Score, log_odds: f64) {
        if score == Score::Likelihood {
            self.score = log_odds;
        }
    }
}

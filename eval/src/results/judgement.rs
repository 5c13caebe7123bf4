//! What are the posteriors and decisions of a row worth, in numbers?
//!
//! Only the numbers as they stand in the file; [`judge`](crate::judge) works them out.

use serde::{Deserialize, Serialize};

use super::key::Variant;

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The measured number.
    pub value: f64,
    /// Lower end of its interval.
    pub ci_low: f64,
    /// Upper end of its interval.
    pub ci_high: f64,
}

impl Measured {
    fn is_finite(&self) -> bool {
        [self.value, self.ci_low, self.ci_high]
            .iter()
            .all(|number| number.is_finite())
    }
}

/// Answers of about the same confidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bin {
    /// Share of all answers.
    pub mass: f64,
    /// Their mean confidence.
    pub confidence: f64,
    /// The share of them that is right.
    pub right: f64,
}

/// Whether probabilities are what they say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Expected calibration error of the first choice's probability.
    pub expected_error: Measured,
    /// Brier score over the places and off-map.
    pub brier: Measured,
    /// Log loss, nats.
    pub log_loss: Measured,
    /// The reliability diagram.
    pub bins: Vec<Bin>,
}

/// One point of precision over recall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PrecisionRecall {
    /// What a first choice must have to be accepted.
    pub least_confidence: f64,
    /// Right ones among the accepted.
    pub precision: f64,
    /// Accepted and right ones among those that have a true place.
    pub recall: f64,
}

/// How far the posterior can be trusted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Retrieval {
    /// Area under precision over recall.
    pub average_precision: f64,
    /// The largest recall without a mistake.
    pub recall_at_full_precision: f64,
    /// Falling confidence, thinned.
    pub curve: Vec<PrecisionRecall>,
}

/// One kind of decision.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// How many of all queries.
    pub share: Measured,
    /// How many of all queries are decided so and have a wrong first choice.
    pub wrong: f64,
    /// The same beyond the run's tolerance, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wrong_within: Option<f64>,
}

/// What is decided at one risk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decisions {
    /// The allowed probability of being wrong.
    pub risk: f64,
    /// At a place.
    pub located: Outcome,
    /// In the map, but at one of several places.
    pub ambiguous: Outcome,
    /// Nothing is said.
    pub unknown: Outcome,
}

/// What one risk gives.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AtRisk {
    /// The allowed probability of being wrong.
    pub risk: f64,
    /// In-map queries that are located.
    pub located: f64,
    /// In-map queries that are located at the wrong place.
    pub located_wrong: f64,
    /// Out-of-map queries that are located; none without out-of-map queries.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accepted: Option<f64>,
}

/// What became of queries whose place is in the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InMap {
    /// Number of queries.
    pub queries: u32,
    /// The true place is the most probable one.
    pub recall_at_1: Measured,
    /// It is among the five most probable ones.
    pub recall_at_5: Measured,
    /// Precision and recall over the posterior of the first choice.
    pub retrieval: Retrieval,
    /// Located, ambiguous, unknown.
    pub decisions: Decisions,
    /// How well the posterior is calibrated.
    pub calibration: Calibration,
}

/// What became of queries whose place is not in the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutOfMap {
    /// Number of queries.
    pub queries: u32,
    /// Located all the same (false-accept rate), ambiguous, unknown.
    pub decisions: Decisions,
    /// How well the posterior is calibrated.
    pub calibration: Calibration,
}

/// In-map and out-of-map queries together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mixed {
    /// The share that out-of-map queries are weighted to.
    #[serde(rename = "elsewhere")]
    pub off_map: f64,
    /// How well the posterior is calibrated.
    pub calibration: Calibration,
    /// Accepting a out-of-map query is a mistake.
    pub retrieval: Retrieval,
}

/// The paired difference to another score on the same queries: negative is better than the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Against {
    /// The other score, calibrated in the same way.
    pub score: String,
    /// Difference of Brier scores.
    pub brier: Measured,
    /// Difference of log losses, nats.
    pub log_loss: Measured,
}

/// What a row's posteriors and decisions are worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Whether the shipped default configuration gives this row.
    pub is_default: bool,
    /// All names but n.
    #[serde(flatten)]
    pub variant: Variant,
    /// Features per node.
    pub n: u32,
    /// The dataset that the queries are of, in a suite of several; none for all of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Queries with a true place.
    #[serde(rename = "native")]
    pub in_map: InMap,
    /// Queries without one.
    #[serde(rename = "foreign", default, skip_serializing_if = "Option::is_none")]
    pub out_of_map: Option<OutOfMap>,
    /// In-map and out-of-map queries together, weighted by the off-map prior.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mixed: Option<Mixed>,
    /// What other risks would give.
    pub risks: Vec<AtRisk>,
    /// Only for the score `likelihood`: on mixed queries where there are out-of-map ones, else on
    /// in-map ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub against: Vec<Against>,
}

impl Judgement {
    /// The calibration on what a posterior is about: the mixture where it is known, else in-map
    /// queries.
    pub fn calibration(&self) -> &Calibration {
        (self.mixed.as_ref()).map_or(&self.in_map.calibration, |mixed| &mixed.calibration)
    }

    /// Precision and recall, with out-of-map queries where there are some.
    pub fn retrieval(&self) -> &Retrieval {
        (self.mixed.as_ref()).map_or(&self.in_map.retrieval, |mixed| &mixed.retrieval)
    }

    /// Whether JSON can hold every number.
    pub(crate) fn is_finite(&self) -> bool {
        let calibrations = [Some(&self.in_map.calibration)]
            .into_iter()
            .chain([self.out_of_map.as_ref().map(|it| &it.calibration)])
            .chain([self.mixed.as_ref().map(|it| &it.calibration)])
            .flatten();
        let losses = self.against.iter().flat_map(|it| [it.brier, it.log_loss]);
        calibrations
            .flat_map(|it| [it.expected_error, it.brier, it.log_loss])
            .chain(losses)
            .chain([self.in_map.recall_at_1, self.in_map.recall_at_5])
            .all(|measured| measured.is_finite())
            && self.retrieval().average_precision.is_finite()
    }
}

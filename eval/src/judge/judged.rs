//! How sure was the answer to a query, and was it right?

use super::scoring::{brier, first_choice, log_loss};
use super::statistics::Sample;
use crate::results::{Answer, Measured, OFF_MAP, Query};

/// An answer with a confidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Claim<'a> {
    /// Queries of one group are alike.
    pub(super) group: Option<&'a str>,
    /// The probability that the answer claims for itself.
    pub(super) confidence: f64,
    /// 1 if it is right, 0 if not, a share where a tie was split.
    pub(super) right: f64,
    /// How often such a query comes.
    pub(super) weight: f64,
}

#[cfg(test)]
impl Claim<'static> {
    /// One of no group.
    pub(super) fn alone(confidence: f64, right: f64) -> Self {
        Self {
            group: None,
            confidence,
            right,
            weight: 1.0,
        }
    }
}

/// One query with the posterior of one row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judged<'r> {
    pub(super) query: &'r Query,
    pub(super) answer: &'r Answer,
    pub(super) claim: Claim<'r>,
}

impl<'r> Judged<'r> {
    pub(super) fn of(query: &'r Query, key: &str) -> Option<Self> {
        let answer = query.answers.get(key)?;
        if answer.posterior.is_empty() {
            return None;
        }
        let (confidence, right) = first_choice(&answer.posterior, query.truth.as_deref());
        let claim = Claim {
            group: query.group.as_deref(),
            confidence,
            right,
            weight: 1.0,
        };
        Some(Self {
            query,
            answer,
            claim,
        })
    }

    pub(super) fn truth(&self) -> Option<&'r str> {
        self.query.truth.as_deref()
    }

    pub(super) fn brier(&self) -> f64 {
        brier(&self.answer.posterior, self.truth())
    }

    pub(super) fn log_loss(&self) -> f64 {
        log_loss(&self.answer.posterior, self.truth())
    }

    pub(super) fn off_map(&self) -> f64 {
        let p = self.answer.posterior.get(OFF_MAP);
        p.copied().unwrap_or(0.0)
    }
}

pub(super) fn weighted<'r>(judged: &[Judged<'r>], value: impl Fn(&Judged<'r>) -> f64) -> Measured {
    let values = judged.iter();
    Sample::weighted(values.map(|it| (it.claim.group, value(it), it.claim.weight)))
        .estimate()
        .into()
}

pub(super) fn rate<'r>(judged: &[Judged<'r>], value: impl Fn(&Judged<'r>) -> f64) -> Measured {
    Sample::grouped(judged.iter().map(|it| (it.claim.group, value(it))))
        .rate()
        .into()
}

pub(super) fn claims<'r>(judged: &[Judged<'r>]) -> Vec<Claim<'r>> {
    judged.iter().map(|it| it.claim).collect()
}

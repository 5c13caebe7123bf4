//! How often was it seen?
//!
//! `p(t) = seen / observed`, the long-term memory of RAS 4.3.1 and FreMEn of order 0.

use super::VisibilityModel;
use super::codec;
use super::evidence::Evidence;
use crate::error::Result;
use crate::spectrum::{Reader, Writer};
use crate::time::Time;

/// The long-term mean; 8 bytes a feature, O(1) a prediction.
///
/// Not for places whose look follows the clock: it predicts the same map at noon and at midnight.
#[derive(Clone, Debug, PartialEq)]
pub struct Mean {
    p: Vec<f64>,
}

impl Mean {
    /// From what [`probabilities`](Self::probabilities) gave; `None` if one is none.
    pub fn from_probabilities(p: Vec<f64>) -> Option<Self> {
        let fits = p.iter().all(|p| (0.0..=1.0).contains(p));
        fits.then_some(Self { p })
    }

    fn write(&self, writer: &mut Writer) {
        writer.varint(self.p.len() as u64);
        writer.floats(self.p.iter().copied());
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let count = reader.count(8)?;
        Self::from_probabilities(reader.floats(count)?)
            .ok_or_else(|| reader.impossible("a probability is outside of [0, 1]"))
    }

    /// p of each feature.
    pub fn probabilities(&self) -> &[f64] {
        &self.p
    }
}

/// O(features + one bits).
pub(super) fn fit(evidence: &Evidence<'_>) -> Mean {
    Mean {
        p: evidence.counts().means(),
    }
}

impl VisibilityModel for Mean {
    fn num_features(&self) -> usize {
        self.p.len()
    }

    fn predict_into(&self, _: Time, out: &mut [f64]) {
        out.copy_from_slice(&self.p);
    }

    fn predict_one(&self, feature: usize, _: Time) -> f64 {
        self.p[feature]
    }

    fn encode(&self) -> Option<Vec<u8>> {
        Some(codec::encode(codec::Kind::Mean, |writer| {
            self.write(writer);
        }))
    }
}

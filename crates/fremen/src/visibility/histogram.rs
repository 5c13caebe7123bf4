//! How often was it seen at this time of day (or week)?
//!
//! `p(t) = (seen in b + prior mu) / (observed in b + prior)`, b the part of the cycle that t falls
//! into and mu the feature's own mean. Cycles count from the Unix epoch in UTC (a week starts on
//! Thursday).

use super::VisibilityModel;
use super::codec;
use super::evidence::Evidence;
use crate::error::Result;
use crate::spectrum::{P_UNKNOWN, Reader, Writer};
use crate::time::{Period, Time};

/// A share for every part of one cycle; `8 B` bytes a feature for B parts, O(F) a prediction.
///
/// Not for periods that are not known, nor for more parts than visits: a part without visits
/// predicts the mean (1/2 if the prior is 0).
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    period: Period,
    num_features: usize,
    num_bins: usize,
    /// Part b of feature f is at `b * num_features + f`.
    p: Vec<f64>,
}

/// The part of the cycle that `time` falls into.
pub(super) fn bin(time: Time, period: Period, num_bins: usize) -> usize {
    let bin = (time.phase(period) * num_bins as f64) as usize;
    bin.min(num_bins - 1) // A phase just below 1 may round up.
}

/// O(features x parts + visits x features).
pub(super) fn fit(
    evidence: &Evidence<'_>,
    period: Period,
    num_bins: usize,
    prior: f64,
) -> Histogram {
    let num_features = evidence.num_features();
    let means = evidence.counts().means();
    let mut seen = vec![0_u32; num_bins * num_features];
    let mut observed = vec![0_u32; num_bins * num_features];
    for &visit in &evidence.visits {
        let first = bin(evidence.log.times()[visit], period, num_bins) * num_features;
        evidence.for_each_state(visit, |feature, state| {
            seen[first + feature] += u32::from(state);
            observed[first + feature] += 1;
        });
    }
    let p = (seen.iter().zip(&observed).enumerate())
        .map(|(i, (&seen, &observed))| {
            let weight = f64::from(observed) + prior;
            if weight > 0.0 {
                ((f64::from(seen) + prior * means[i % num_features]) / weight).clamp(0.0, 1.0)
            } else {
                P_UNKNOWN
            }
        })
        .collect();
    Histogram {
        period,
        num_features,
        num_bins,
        p,
    }
}

impl Histogram {
    fn write(&self, writer: &mut Writer) {
        writer.varint(self.period.as_us() as u64);
        writer.varint(self.num_features as u64);
        writer.varint(self.num_bins as u64);
        writer.floats(self.p.iter().copied());
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let period = Period::from_us(reader.varint()? as i64)?;
        // A place without features still has parts.
        let num_features = reader.count(0)?;
        let num_bins = reader.count(0)?;
        let p = reader.floats(num_bins.saturating_mul(num_features))?;
        if num_bins == 0 || !p.iter().all(|p| (0.0..=1.0).contains(p)) {
            return Err(reader.impossible("this is no histogram"));
        }
        Ok(Self {
            period,
            num_features,
            num_bins,
            p,
        })
    }
}

impl VisibilityModel for Histogram {
    fn num_features(&self) -> usize {
        self.num_features
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        let first = bin(time, self.period, self.num_bins) * self.num_features;
        out.copy_from_slice(&self.p[first..first + self.num_features]);
    }

    fn encode(&self) -> Option<Vec<u8>> {
        Some(codec::encode(codec::Kind::Histogram, |writer| {
            self.write(writer);
        }))
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        assert!(feature < self.num_features, "no feature {feature}");
        self.p[bin(time, self.period, self.num_bins) * self.num_features + feature]
    }
}

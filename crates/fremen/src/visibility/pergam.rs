//! At which times of day does it appear?
//!
//! The periodic Gaussian mixture (`PerGaM`) of RAS 2016 4.3.2: the share of times seen in each part
//! of the cycle (eq. 8) is taken as a density and described by a few Gaussians, found by
//! expectation maximisation; `p(t) = A sum over j of w_j N(t mod T; mu_j, sigma_j)` (eq. 9), A the
//! mean share, in units of cycles.
//!
//! `Deviation:` Gaussians are wrapped round the cycle (the images one cycle before and after
//! count), so that midnight is no edge; eq. 8 printed as a sum times k/tau is read as a mean; a
//! part of the cycle without observations has the feature's mean.

use super::VisibilityModel;
use super::codec;
use super::evidence::Evidence;
use super::histogram::bin;
use crate::error::Result;
use crate::spectrum::{Reader, Writer};
use crate::time::{Period, Time};

/// Steps of expectation maximisation at most.
const MAX_STEPS: usize = 100;

/// A few Gaussians round one cycle; `24 l` bytes a feature and 3 exponentials a Gaussian and
/// prediction.
///
/// Learning costs up to 300 exponentials a feature, part and Gaussian: not for large maps, nor for
/// states that are mostly 1 (it describes events, not their absence), nor for more than one period.
#[derive(Clone, Debug, PartialEq)]
pub struct Pergam {
    period: Period,
    order: usize,
    /// `order` of them a feature.
    gaussians: Vec<Gaussian>,
}

/// In units of the cycle; `height` is `A w_j`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Gaussian {
    height: f64,
    mean: f64,
    sigma: f64,
}

impl Gaussian {
    /// The wrapped density at `phase`, times the height.
    fn at(&self, phase: f64) -> f64 {
        let from_mean = signed_distance(phase, self.mean);
        let density: f64 = [-1.0, 0.0, 1.0]
            .into_iter()
            .map(|cycle| (-0.5 * ((from_mean + cycle) / self.sigma).powi(2)).exp())
            .sum();
        self.height * density / (self.sigma * std::f64::consts::TAU.sqrt())
    }
}

/// The shortest way from `mean` to `phase`, in (-1/2, 1/2].
fn signed_distance(phase: f64, mean: f64) -> f64 {
    let distance = phase - mean;
    distance - distance.round()
}

pub(super) fn fit(
    evidence: &Evidence<'_>,
    period: Period,
    num_bins: usize,
    order: usize,
) -> Pergam {
    let num_features = evidence.num_features();
    let means = evidence.counts().means();
    let mut seen = vec![0_u32; num_bins * num_features];
    let mut observed = vec![0_u32; num_bins * num_features];
    for &visit in &evidence.visits {
        let part = bin(evidence.log.times()[visit], period, num_bins);
        evidence.for_each_state(visit, |feature, state| {
            seen[feature * num_bins + part] += u32::from(state);
            observed[feature * num_bins + part] += 1;
        });
    }
    Pergam::of_profiles(period, order, &seen, &observed, &means)
}

/// Expectation maximisation on a profile taken as a density.
fn mixture(profile: &[f64], order: usize) -> Vec<Gaussian> {
    let num_bins = profile.len() as f64;
    let phase = |part: usize| (part as f64 + 0.5) / num_bins;
    // Half a part's width is the sharpest that the profile can resolve.
    let min_sigma = 0.5 / num_bins;
    let total: f64 = profile.iter().sum();
    let mean_share = total / num_bins;
    let mut gaussians: Vec<_> = (0..order)
        .map(|j| Gaussian {
            height: mean_share / order as f64,
            mean: (j as f64 + 0.5) / order as f64,
            sigma: (0.5 / order as f64).max(min_sigma),
        })
        .collect();
    if total <= 0.0 {
        return gaussians;
    }
    let mut shares = vec![0.0; order];
    for _ in 0..MAX_STEPS {
        // Weight, first and second moment about the old mean.
        let mut moments = vec![[0.0; 3]; order];
        for (part, &density) in profile.iter().enumerate() {
            let phase = phase(part);
            for (share, gaussian) in shares.iter_mut().zip(&gaussians) {
                *share = gaussian.at(phase);
            }
            let sum: f64 = shares.iter().sum();
            if sum <= 0.0 {
                continue;
            }
            for ((moment, share), gaussian) in moments.iter_mut().zip(&shares).zip(&gaussians) {
                let weight = density * share / sum;
                let distance = signed_distance(phase, gaussian.mean);
                moment[0] += weight;
                moment[1] += weight * distance;
                moment[2] += weight * distance * distance;
            }
        }
        let mut moved = 0.0_f64;
        for (gaussian, [weight, first, second]) in gaussians.iter_mut().zip(moments) {
            gaussian.height = weight / num_bins;
            if weight > 0.0 {
                let shift = first / weight;
                let variance = (second / weight - shift * shift).max(0.0);
                // A wider one is flat round the cycle anyway.
                let sigma = variance.sqrt().clamp(min_sigma, 0.5);
                moved = moved.max(shift.abs()).max((sigma - gaussian.sigma).abs());
                gaussian.mean = (gaussian.mean + shift).rem_euclid(1.0);
                gaussian.sigma = sigma;
            }
        }
        if moved < 1e-6 {
            break;
        }
    }
    gaussians
}

impl Pergam {
    /// Of features that are observed together: looks in each part of the cycle, and how often each
    /// feature was seen there, one feature after the other.
    pub(crate) fn of_counts(period: Period, order: usize, seen: &[u32], observed: &[u32]) -> Self {
        let num_bins = observed.len();
        let total = |counts: &[u32]| counts.iter().map(|&count| f64::from(count)).sum::<f64>();
        let looks = total(observed).max(1.0);
        let rows = seen.chunks_exact(num_bins);
        let means: Vec<f64> = rows.map(|row| total(row) / looks).collect();
        Self::of_profiles(period, order, seen, &observed.repeat(means.len()), &means)
    }

    /// `seen` and `observed` of one feature's parts after the other; a part without observations
    /// has the feature's mean.
    fn of_profiles(
        period: Period,
        order: usize,
        seen: &[u32],
        observed: &[u32],
        means: &[f64],
    ) -> Self {
        let num_bins = seen.len() / means.len().max(1);
        let mut gaussians = Vec::with_capacity(means.len() * order);
        let mut profile = vec![0.0; num_bins];
        for (feature, &mean) in means.iter().enumerate() {
            let row = feature * num_bins..(feature + 1) * num_bins;
            let parts = seen[row.clone()].iter().zip(&observed[row]);
            for (share, (&seen, &observed)) in profile.iter_mut().zip(parts) {
                *share = match observed {
                    0 => mean,
                    _ => f64::from(seen) / f64::from(observed),
                };
            }
            gaussians.extend(mixture(&profile, order));
        }
        Self {
            period,
            order,
            gaussians,
        }
    }

    fn write(&self, writer: &mut Writer) {
        writer.varint(self.period.as_us() as u64);
        writer.varint(self.order as u64);
        writer.varint(self.gaussians.len() as u64);
        for gaussian in &self.gaussians {
            writer.floats([gaussian.height, gaussian.mean, gaussian.sigma]);
        }
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let period = Period::from_us(reader.varint()? as i64)?;
        let order = usize::try_from(reader.varint()?).unwrap_or(0);
        let count = reader.count(24)?;
        let numbers = reader.floats(3 * count)?;
        let gaussians: Vec<Gaussian> = (numbers.chunks_exact(3))
            .map(|it| Gaussian {
                height: it[0],
                mean: it[1],
                sigma: it[2],
            })
            .collect();
        let is_sound = |it: &Gaussian| it.height >= 0.0 && it.sigma > 0.0;
        if order == 0 || count % order != 0 || !gaussians.iter().all(is_sound) {
            return Err(reader.impossible("these are no Gaussians"));
        }
        Ok(Self {
            period,
            order,
            gaussians,
        })
    }

    fn p(gaussians: &[Gaussian], phase: f64) -> f64 {
        let p: f64 = gaussians.iter().map(|gaussian| gaussian.at(phase)).sum();
        p.clamp(0.0, 1.0)
    }
}

impl VisibilityModel for Pergam {
    fn num_features(&self) -> usize {
        self.gaussians.len() / self.order
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        assert_eq!(out.len(), self.num_features(), "one p a feature");
        let phase = time.phase(self.period);
        for (p, gaussians) in out.iter_mut().zip(self.gaussians.chunks_exact(self.order)) {
            *p = Self::p(gaussians, phase);
        }
    }

    fn encode(&self) -> Option<Vec<u8>> {
        Some(codec::encode(codec::Kind::Pergam, |writer| {
            self.write(writer);
        }))
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        let row = feature * self.order..(feature + 1) * self.order;
        Self::p(&self.gaussians[row], time.phase(self.period))
    }
}

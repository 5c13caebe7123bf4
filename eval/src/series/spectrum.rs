//! Which rhythms does a series have, and which does its sampling pretend?

use anyhow::Result;
use chronotope::Period;
use chronotope::spectrum::{CandidatePeriods, SpectralSums};

use super::data::{SeriesDataset, State};
use super::models::candidates;
use super::sampling::Sampling;

/// One rhythm of a series.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Length of its period, s.
    pub period_s: f64,
    /// How far p(t) swings to either side, `2 abs(g_k)`.
    pub amplitude: f64,
    /// `abs(W_k) / m`: 0 where samples are spread over all phases, 1 where all have one phase.
    pub window: f64,
}

/// The spectrum of one series over that of its sampling.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// Which series, sampled how.
    pub title: String,
    /// Longest period first.
    pub lines: Vec<Line>,
}

/// Of the liveliest series, with each sampling.
pub(super) fn spectra(dataset: &SeriesDataset, share: f64) -> Result<Vec<Spectrum>> {
    let ones = |states: &[State]| states.iter().filter(|state| state.1).count() as f64;
    let liveliest = dataset.series.iter().max_by(|a, b| {
        let distance = |states: &[State]| -(ones(states) / states.len() as f64 - 0.5).abs();
        distance(&a.learn).total_cmp(&distance(&b.learn))
    });
    let Some(series) = liveliest else {
        return Ok(Vec::new());
    };
    (Sampling::ALL.into_iter())
        .map(|sampling| {
            let states = sampling.draw(&series.learn, share, 0);
            Ok(Spectrum {
                title: format!("{}, {} samples", series.name, sampling.name()),
                lines: lines(&states)?,
            })
        })
        .collect()
}

fn lines(states: &[State]) -> Result<Vec<Line>> {
    let candidates = candidates()?;
    let mut sums = SpectralSums::new(candidates.clone());
    for &(time, state) in states {
        sums.add(time, state)?;
    }
    let windows = windows(&candidates, states);
    let mut lines: Vec<Line> = (windows.into_iter().enumerate())
        .map(|(k, window)| Line {
            period_s: candidates.period_s(k),
            amplitude: 0.0,
            window,
        })
        .collect();
    for component in sums.rhythms(candidates.len()).components() {
        let k = (Period::WEEK.as_s() / component.period_s).round() as usize;
        if let Some(line) = lines.get_mut(k.wrapping_sub(1)) {
            line.amplitude = component.amplitude;
        }
    }
    Ok(lines)
}

/// `abs(W_k) / m` of every candidate.
fn windows(candidates: &CandidatePeriods, states: &[State]) -> Vec<f64> {
    let width = 2 * candidates.len();
    let (mut sums, mut phasors) = (vec![0.0; width], vec![0.0; width]);
    for &(time, _) in states {
        candidates.phasors_into(time, &mut phasors);
        for (sum, phasor) in sums.iter_mut().zip(&phasors) {
            *sum += phasor;
        }
    }
    let (cos, sin) = sums.split_at(candidates.len());
    let count = states.len().max(1) as f64;
    cos.iter()
        .zip(sin)
        .map(|(c, s)| c.hypot(*s) / count)
        .collect()
}

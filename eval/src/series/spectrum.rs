//! Which rhythms does a series have, and which does its sampling pretend?

use anyhow::Result;
use chronotope::spectrum::{Periodogram, PeriodogramLine};

use super::data::{SeriesDataset, State};
use super::models::candidates;
use super::sampling::Sampling;

/// The spectrum of one series over that of its sampling.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// Which series, sampled how.
    pub title: String,
    /// Longest period first.
    pub lines: Vec<PeriodogramLine>,
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
                lines: Periodogram::new(&states, &candidates()?)?.lines().to_vec(),
            })
        })
        .collect()
}

//! What is one forecast worth, in sums that draws and series add up to?

use anyhow::Result;
use chronotope::Period;

use super::data::{Series, State};
use super::models::{Forecast, Instant};
use super::results::Measured;
use crate::judge::statistics::Sample;
use crate::results::RowOrder;

/// Log loss takes p no closer to 0 or 1 than this, since one certain mistake would be infinite.
const LEAST_P: f64 = 1e-3;

/// Sums over one block of time: wrong states, squared differences, log losses, samples.
#[derive(Clone, Copy, Default)]
struct Block([f64; 4]);

impl Block {
    fn add(&mut self, p: f64, state: bool) {
        let truth = f64::from(u8::from(state));
        let p_of_truth = if state { p } else { 1.0 - p };
        let [wrong, squares, losses, count] = &mut self.0;
        *wrong += f64::from(u8::from((p >= 0.5) != state));
        *squares += (p - truth).powi(2);
        *losses -= p_of_truth.clamp(LEAST_P, 1.0 - LEAST_P).ln();
        *count += 1.0;
    }
}

/// What one forecast is worth, in sums that draws and series add up to.
pub(super) struct Score {
    pub(super) model: &'static str,
    pub(super) order: RowOrder,
    pub(super) num_learnt: f64,
    /// Wrong states and samples among what was learnt.
    pub(super) learnt: [f64; 2],
    blocks: Vec<Block>,
    /// Wrong states and samples of each part.
    pub(super) parts: Vec<[f64; 2]>,
}

impl Score {
    /// What is known of a forecast before it predicts anything.
    fn new(forecast: &Forecast, num_learnt: usize) -> Self {
        Self {
            model: forecast.model,
            order: forecast.order,
            num_learnt: num_learnt as f64,
            learnt: [0.0; 2],
            blocks: Vec::new(),
            parts: Vec::new(),
        }
    }

    /// Evaluates all forecasts at each time together, since what depends on the time alone is half
    /// of the cost.
    pub(super) fn of_all(
        forecasts: &[Forecast],
        learnt: &[State],
        series: &Series,
        block: Period,
    ) -> Result<Vec<Self>> {
        let mut scores: Vec<Self> = (forecasts.iter())
            .map(|forecast| Self::new(forecast, learnt.len()))
            .collect();
        let mut at = Instant::new()?;
        for &(time, state) in learnt {
            at.set(time);
            for (score, forecast) in scores.iter_mut().zip(forecasts) {
                let is_wrong = (forecast.p(&at) >= 0.5) != state;
                add(&mut score.learnt, &[f64::from(u8::from(is_wrong)), 1.0]);
            }
        }
        for part in &series.parts {
            for score in &mut scores {
                score.parts.push([0.0; 2]);
            }
            let mut last = None;
            for &(time, state) in &part.states {
                at.set(time);
                let number = time.as_us().div_euclid(block.as_us());
                let is_new = last.replace(number) != Some(number);
                for (score, forecast) in scores.iter_mut().zip(forecasts) {
                    if is_new {
                        score.blocks.push(Block::default());
                    }
                    score.add_answer(forecast.p(&at), state);
                }
            }
        }
        Ok(scores)
    }

    /// Adds an answer to the last block and the last part.
    fn add_answer(&mut self, p: f64, state: bool) {
        if let Some(block) = self.blocks.last_mut() {
            block.add(p, state);
        }
        if let Some(part) = self.parts.last_mut() {
            add(part, &[f64::from(u8::from((p >= 0.5) != state)), 1.0]);
        }
    }

    /// Adds another draw of the same series.
    pub(super) fn add_draw(&mut self, other: &Self) {
        self.num_learnt += other.num_learnt;
        add(&mut self.learnt, &other.learnt);
        for (block, other) in self.blocks.iter_mut().zip(&other.blocks) {
            add(&mut block.0, &other.0);
        }
        for (part, other) in self.parts.iter_mut().zip(&other.parts) {
            add(part, other);
        }
    }

    /// Adds another series: its blocks are other blocks.
    pub(super) fn add_series(&mut self, other: &Self) {
        self.num_learnt += other.num_learnt;
        add(&mut self.learnt, &other.learnt);
        self.blocks.extend(&other.blocks);
        for (part, other) in self.parts.iter_mut().zip(&other.parts) {
            add(part, other);
        }
    }

    pub(super) fn measure(&self, metric: usize) -> Measured {
        let blocks = self
            .blocks
            .iter()
            .map(|Block(sums)| (sums[metric], sums[3]));
        Sample::of_blocks(blocks).estimate().into()
    }

    /// The difference of Brier scores; blocks of draws that one of the two lacks do not exist.
    pub(super) fn against(&self, other: &Self) -> Measured {
        let blocks = self.blocks.iter().zip(&other.blocks);
        let blocks = blocks.map(|(a, b)| (a.0[1] - b.0[1], a.0[3]));
        Sample::of_blocks(blocks).estimate().into()
    }

    pub(super) fn copy(&self) -> Self {
        Self {
            blocks: self.blocks.clone(),
            parts: self.parts.clone(),
            ..*self
        }
    }
}

fn add<const N: usize>(sums: &mut [f64; N], others: &[f64; N]) {
    for (sum, other) in sums.iter_mut().zip(others) {
        *sum += other;
    }
}

pub(super) fn same<'a>(scores: &'a mut [Score], like: &Score) -> Option<&'a mut Score> {
    let mut scores = scores.iter_mut();
    scores.find(|score| score.model == like.model && score.order == like.order)
}

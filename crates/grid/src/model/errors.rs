//! How many of the observations does a model get wrong?

use rayon::prelude::*;

use fremen::{Period, Time};

use super::config::GridConfig;
use super::tile_model::{Moment, TileModel};
use crate::cells::CellState;
use crate::history::{History, Tile};

/// How well the periodic part of predictions gives the observations back, over the cells that
/// changed at least once (the *estimation error* of T-RO 2017, section VI).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Errors {
    /// Observations of cells that were compared.
    pub num_compared: u64,
    /// Of these, those that the model gets wrong: p(t) > 0.5 of a free cell, or the reverse.
    pub num_wrong: u64,
    /// Of these, those that the mean alone gets wrong.
    pub num_wrong_by_mean: u64,
    /// Cells that changed.
    pub num_cells: u64,
}

impl Errors {
    /// The share that the model gets wrong.
    pub fn rate(&self) -> f64 {
        self.num_wrong as f64 / self.num_compared.max(1) as f64
    }

    /// The share that the mean gets wrong: the error of a static map.
    pub fn static_rate(&self) -> f64 {
        self.num_wrong_by_mean as f64 / self.num_compared.max(1) as f64
    }

    fn plus(self, other: Self) -> Self {
        Self {
            num_compared: self.num_compared + other.num_compared,
            num_wrong: self.num_wrong + other.num_wrong,
            num_wrong_by_mean: self.num_wrong_by_mean + other.num_wrong_by_mean,
            num_cells: self.num_cells + other.num_cells,
        }
    }
}

/// Compares every `stride`-th visit of each tile.
pub(crate) fn errors(
    history: &History,
    config: &GridConfig,
    models: &[Option<Box<TileModel>>],
    stride: usize,
) -> Errors {
    let days = errors_by_day(history, config, models, stride);
    let num_cells = models.iter().flatten().map(|it| it.num_varying() as u64);
    Errors {
        num_cells: num_cells.sum(),
        ..days.into_iter().fold(Errors::default(), Errors::plus)
    }
}

/// The same of each day since the first observation; cells are not counted.
pub(crate) fn errors_by_day(
    history: &History,
    config: &GridConfig,
    models: &[Option<Box<TileModel>>],
    stride: usize,
) -> Vec<Errors> {
    let tiles = history.tiles().par_iter().zip(models);
    let per_tile = tiles.map(|(tile, model)| match model {
        Some(model) => errors_of(history, config, tile, model, stride),
        None => Vec::new(),
    });
    per_tile.reduce(Vec::new, |mut a, mut b| {
        if a.len() < b.len() {
            std::mem::swap(&mut a, &mut b);
        }
        for (a, b) in a.iter_mut().zip(b) {
            *a = a.plus(b);
        }
        a
    })
}

fn errors_of(
    history: &History,
    config: &GridConfig,
    tile: &Tile,
    model: &TileModel,
    stride: usize,
) -> Vec<Errors> {
    let times_us = history.observations().times_us();
    let cells: Vec<usize> = model.cells().collect();
    let mean: Vec<bool> = model.means().map(|mean| mean > 0.5).collect();
    let mut changes: Vec<_> = cells
        .iter()
        .filter_map(|&at| tile.log(at))
        .map(|log| (log.first(), log.changes().peekable()))
        .collect();
    let day_us = Period::DAY.as_us();
    let first_us = times_us.first().copied().unwrap_or_default();
    let mut days: Vec<Errors> = Vec::new();
    let mut periodic = Vec::new();
    let config = config.clone().with_persistence(false);
    for (visit, observation) in (0_u32..).zip(tile.visits().observations()).step_by(stride) {
        let time = Time::from_us(times_us[observation as usize]);
        let day = (time.as_us().saturating_sub(first_us) / day_us) as usize;
        if days.len() <= day {
            days.resize(day + 1, Errors::default());
        }
        let errors = &mut days[day];
        model.periodic(&Moment::new(&config, time), &mut periodic);
        for (i, (state, changes)) in changes.iter_mut().enumerate() {
            while let Some(change) = changes.next_if(|change| change.visit <= visit) {
                *state = change.state;
            }
            if state.is_known() {
                let is_occupied = *state == CellState::Occupied;
                errors.num_compared += 1;
                errors.num_wrong += u64::from((periodic[i] > 0.5) != is_occupied);
                errors.num_wrong_by_mean += u64::from(mean[i] != is_occupied);
            }
        }
    }
    days
}

//! How is the past forgotten, so that memory is free again?

use fremen::Time;

use super::log::Change;
use super::record::History;
use super::tile::{Tile, Visits};
use crate::cells::CellState;

/// What was forgotten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Forgotten {
    /// Observations that are gone.
    pub num_observations: usize,
    /// Tiles of which nothing is known any more.
    pub num_tiles: usize,
    /// Bytes of memory that were given back.
    pub num_bytes: usize,
}

impl History {
    /// Forgets all observations before a time.
    ///
    /// Afterwards the history is what it would be if they had never been made.
    pub fn forget_before(&mut self, time: Time) -> Forgotten {
        let before = self.memory();
        let times = self.observations.times_us();
        let num = times.partition_point(|&us| us < time.as_us());
        let mut forgotten = Forgotten {
            num_observations: num,
            num_tiles: 0,
            num_bytes: 0,
        };
        if num == 0 {
            return forgotten;
        }
        let observations = self.observations.without_first(num);
        let kept: Vec<Tile> = self
            .tiles
            .iter()
            .filter_map(|tile| without_first(tile, num as u32))
            .collect();
        forgotten.num_tiles = self.tiles.len() - kept.len();
        *self = Self::from_parts(self.tiling, observations, kept);
        forgotten.num_bytes = before
            .total_bytes()
            .saturating_sub(self.memory().total_bytes());
        forgotten
    }
}

/// A tile without its visits at observations below `num`; none if that were all.
fn without_first(tile: &Tile, num: u32) -> Option<Tile> {
    let mut visits = Visits::default();
    for (start, end) in tile.visits().ranges() {
        visits.extend(start.max(num) - num, end.max(num) - num);
    }
    if visits.len() == 0 {
        return None;
    }
    let skipped = tile.visits().len() - visits.len();
    let num_cells = 64 * tile.num_words();
    Some(Tile::build(tile.key(), num_cells, visits, |at| {
        let Some(log) = tile.log(at) else {
            return (tile.state(at), Vec::new().into_iter());
        };
        let mut first: CellState = log.first();
        let mut changes = Vec::new();
        for change in log.changes() {
            if change.visit <= skipped {
                first = change.state;
            } else {
                changes.push(Change {
                    visit: change.visit - skipped,
                    ..change
                });
            }
        }
        (first, changes.into_iter())
    }))
}

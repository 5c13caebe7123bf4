//! What did one observation see, and what was known before it?

use super::log::Change;
use super::observations::Observations;
use super::record::History;
use super::tile::{Tile, Visits};
use crate::cells::Patch;

impl History {
    /// The history as it was with its first `num` observations alone.
    #[must_use]
    pub fn first(&self, num: usize) -> Self {
        let num = num.min(self.num_observations());
        let observations = self.observations.only_first(num);
        let tiles = (self.tiles.iter())
            .filter_map(|tile| only_first(tile, num as u32))
            .collect();
        Self::from_parts(self.tiling, observations, tiles)
    }

    /// What the observation of this number saw; nothing where there is none.
    pub fn patch(&self, number: usize) -> Patch {
        let mut patch = Patch::new_whole(self.spec());
        for tile in self.tiles() {
            let mut seen = tile.visits().observations();
            let Some(visit) = seen.position(|it| it as usize == number) else {
                continue;
            };
            for (word, plane) in tile.planes_at(visit as u32).into_iter().enumerate() {
                for bit in super::tile::bits(plane.known) {
                    let cell = self.tiling.cell(tile.key(), word * 64 + bit as usize);
                    patch.set(cell, plane.state(bit));
                }
            }
        }
        patch
    }
}

impl Observations {
    fn only_first(&self, num: usize) -> Self {
        let mut kept = self.clone();
        kept.truncate(num);
        kept.without_first(0)
    }
}

/// A tile without its visits at observations from `num` on; none if that were all.
fn only_first(tile: &Tile, num: u32) -> Option<Tile> {
    let mut visits = Visits::default();
    for (start, end) in tile.visits().ranges() {
        visits.extend(start.min(num), end.min(num));
    }
    let num_kept = visits.len();
    if num_kept == 0 {
        return None;
    }
    Some(Tile::build(
        tile.key(),
        64 * tile.num_words(),
        visits,
        |at| {
            let Some(log) = tile.log(at) else {
                return (tile.state(at), Vec::new().into_iter());
            };
            let kept = log.changes().take_while(|it| it.visit < num_kept);
            let changes: Vec<Change> = kept.collect();
            (log.first(), changes.into_iter())
        },
    ))
}

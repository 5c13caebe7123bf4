//! Which made-up worlds does a synthetic suite consist of?

use chronotope::Time;
use chronotope::dataset::Dataset;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};

use anyhow::Result;

/// The worlds of a synthetic suite: seeds `1..=seeds`, rounds to learn and to query.
pub(crate) struct Worlds {
    pub(crate) seeds: u64,
    pub(crate) learn: usize,
    pub(crate) query: usize,
}

impl Worlds {
    /// The images of one world, and when the first query is taken.
    pub(crate) fn world(&self, seed: u64, rhythms: bool, name: &str) -> Result<(Dataset, Time)> {
        let world = World::new(&WorldConfig::new(seed).with_rhythms(rhythms))?;
        let schedule = Schedule::standard(seed, self.learn, self.query);
        let all: Vec<_> = [&schedule.learn[..], &schedule.query[..]].concat();
        let split = schedule.query.first().copied().unwrap_or_default();
        Ok((world.dataset(name, &all), split))
    }
}

/// What the ids of a world's queries begin with.
pub(crate) fn prefix(seed: u64) -> String {
    format!("seed {seed:02}")
}

//! Which visits that a map doubted are learnt after all?

use super::config::LearnConfig;
use super::learner::Learner;
use crate::map::{Map, Snapshot, VisitId};
use fremen::error::Result;

/// Learns quarantined visits of a map's file, each named once, in one generation, and gives its
/// number; to forget them instead there is [`Map::drop_held`].
///
/// Fails, and changes nothing, as [`Learner::accept`] does for one of them, and as [`Map::update`]
/// does.
pub fn accept_held(map: &Map, cfg: &LearnConfig, ids: &[VisitId]) -> Result<u64> {
    map.update(|snapshot| {
        let mut learner = Learner::resume(cfg.clone(), snapshot.clone())?;
        for &id in ids {
            learner.accept(id)?;
        }
        Ok(Snapshot::clone(&*learner.snapshot()?))
    })
}

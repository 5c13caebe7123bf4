//! What does a map learn while it is in use, and when is that written?

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::learn::{Circumstances, LearnConfig, Learner, Learnt, Observation};
use crate::map::{Map, Snapshot};
use fremen::error::Result;

/// After a commit, at least this many times as long as it took passes before the next: commits take
/// at most a tenth of the time.
const REST_PER_COMMIT: u32 = 9;

/// A map within a budget has at most this many generations; then all but the last few are pruned,
/// so that the file does not grow although the map does not.
const MOST_GENERATIONS: usize = 8;
const KEPT_GENERATIONS: usize = 4;

/// A map file and the learner that goes on with it: learns visits, commits when it is time.
///
/// [`Robot`](super::Robot) has one where it learns; a program that learns labelled images, whose
/// places it knows, uses it alone. Nothing is committed when it is dropped.
#[derive(Debug)]
pub struct OnlineLearner {
    map: Map,
    learner: Learner,
    interval: Duration,
    next_commit: Instant,
    /// Whether a budget made the learner forget since the last commit.
    has_forgotten: bool,
}

/// A commit that was made.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Committed {
    /// The map to go on with.
    pub snapshot: Arc<Snapshot>,
    /// How long it took.
    pub took: Duration,
}

impl OnlineLearner {
    /// Goes on with `map`; commits are due at most every `interval`, less often where they take
    /// long.
    ///
    /// Fails as [`Learner::resume`] does.
    pub fn new(map: Map, cfg: LearnConfig, interval: Duration) -> Result<Self> {
        let learner = Learner::resume(cfg, Snapshot::clone(&map.snapshot()))?;
        Ok(Self {
            map,
            learner,
            interval,
            next_commit: Instant::now() + interval,
            has_forgotten: false,
        })
    }

    /// The file.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// What has been learnt, committed or not.
    pub fn learner(&self) -> &Learner {
        &self.learner
    }

    /// [`Learner::snapshot`].
    pub fn snapshot(&mut self) -> Result<Arc<Snapshot>> {
        self.learner.snapshot()
    }

    /// [`Learner::observe_under`].
    pub fn observe(
        &mut self,
        observation: &Observation<'_>,
        circumstances: &Circumstances,
    ) -> Result<Learnt> {
        let learnt = self.learner.observe_under(observation, circumstances)?;
        self.has_forgotten |= learnt.num_forgotten > 0;
        Ok(learnt)
    }

    /// Whether the interval since the last commit has passed.
    pub fn is_commit_due(&self) -> bool {
        Instant::now() >= self.next_commit
    }

    /// Commits what was learnt as a generation of the file.
    ///
    /// Where a budget made the learner forget, and generations have become many, all but the last
    /// few are pruned. Fails as [`Map::replace`] and [`Map::prune`] do; what was learnt is still
    /// there then, and the call can be repeated.
    pub fn commit(&mut self) -> Result<Committed> {
        let begun = Instant::now();
        let snapshot = self.learner.snapshot()?;
        self.commit_snapshot(&snapshot)?;
        let took = begun.elapsed();
        self.next_commit = Instant::now() + self.interval.max(REST_PER_COMMIT * took);
        Ok(Committed {
            snapshot: self.map.snapshot(),
            took,
        })
    }

    /// Commits another snapshot than the learner's, such as one with poses and edges added to it.
    pub fn commit_snapshot(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.map.replace(snapshot)?;
        if !std::mem::take(&mut self.has_forgotten) {
            return Ok(());
        }
        let generations = self.map.generations()?;
        if generations.len() > MOST_GENERATIONS {
            let newest = generations.iter().rev().take(KEPT_GENERATIONS);
            let kept: BTreeSet<u64> = newest.map(|it| it.number).collect();
            self.map.prune(&kept)?;
        }
        Ok(())
    }
}

//! What does a map learn while it is in use, and when is that written?

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::learn::{Circumstances, LearnConfig, Learner, Learnt, Observation};
use crate::map::{Map, Snapshot};
use fremen::error::{Error, Result};

/// After a commit, at least this many times as long as it took passes before the next: commits take
/// at most a tenth of the time.
const REST_PER_COMMIT: u32 = 9;

/// A map within a budget is pruned to its last few generations where it has more than the first
/// number of them and its file is more than this many times as large as what it holds.
const MOST_GENERATIONS: usize = 8;
const MOST_TIMES_ITS_BYTES: usize = 2;
const KEPT_GENERATIONS: usize = 4;

/// Bytes of a visit's row in the file beside its features and bits, about.
const BYTES_PER_VISIT: usize = 200;
/// A smaller file is never pruned.
const SMALL_BYTES: usize = 1 << 18;

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
        })
    }

    /// The file.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The file, without what was learnt since the last commit.
    pub fn into_map(self) -> Map {
        self.map
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
        self.learner.observe_under(observation, circumstances)
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
    pub fn commit_snapshot(&self, snapshot: &Snapshot) -> Result<()> {
        self.map.replace(snapshot)?;
        if !self.learner.cfg().budget().is_bounded() || !is_bloated(&self.map, snapshot)? {
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

/// Whether a good part of the file is of the past. O(visits).
fn is_bloated(map: &Map, snapshot: &Snapshot) -> Result<bool> {
    let of_nodes = (snapshot.nodes.iter())
        .map(|node| node.num_bytes() + BYTES_PER_VISIT * node.visits.len())
        .sum::<usize>();
    let of_attachments: usize = snapshot.attachments.values().map(|it| it.len()).sum();
    let most = MOST_TIMES_ITS_BYTES * (of_nodes + of_attachments) + SMALL_BYTES;
    let found = std::fs::metadata(map.path()).map_err(|cause| Error::io(map.path(), cause))?;
    Ok(found.len() > most as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Features, Keypoint};
    use crate::learn::{BudgetConfig, GuardConfig, Judge};
    use crate::map::{MapMeta, PlaceKey, SessionId, derived_uuid};
    use fremen::Time;

    /// Some features that last, some of each visit alone.
    fn image(number: u64) -> Features {
        let mut live = Features::new();
        for i in (0..40).chain(100 + 30 * number..130 + 30 * number) {
            let word = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let keypoint = Keypoint {
                x: 20.0 + (i * 37 % 600) as f32,
                y: 20.0 + (i * 53 % 440) as f32,
                size: 9.0,
                response: 1.0,
            };
            live.push(
                keypoint,
                Descriptor([word, !word, word << 17 | i, word >> 9 ^ i]),
            );
        }
        live
    }

    #[test]
    fn the_file_of_a_map_within_a_budget_stays_bounded() -> Result<()> {
        let folder = tempfile::tempdir().map_err(|cause| Error::io("a folder", cause))?;
        let path = folder.path().join("a.map");
        let map = Map::create(&path, MapMeta::new(derived_uuid("a"), "none", "default"))?;
        let budget = BudgetConfig::default()
            .with_visits_per_place(20)
            .with_features_per_place(120);
        let guard = GuardConfig::default().with_judge(Judge::Never);
        let cfg = (LearnConfig::default().with_guard(guard)).with_budget(budget)?;
        let mut learner = OnlineLearner::new(map, cfg, Duration::ZERO)?;
        let (mut num_prunes, mut num_before) = (0, 0);
        for number in 0..240 {
            let observation = Observation {
                place: PlaceKey::new(["door", "gate"][number as usize % 2])?,
                session: SessionId::derive("run"),
                time: Time::from_s(number as i64 * 3_600),
                features: &image(number),
                image_size: (640, 480),
                mask: None,
                source: String::new(),
            };
            learner.observe(&observation, &Circumstances::default())?;
            learner.commit()?;
            let num_generations = learner.map().generations()?.len();
            num_prunes += usize::from(num_generations < num_before);
            num_before = num_generations;
            let learnt = learner.snapshot()?;
            assert_eq!(learner.map().snapshot().nodes, learnt.nodes);
            let found = std::fs::metadata(&path).map_or(0, |it| it.len());
            assert!(found < 3 * SMALL_BYTES as u64, "{found} bytes at {number}");
        }
        // Seldom, and often enough.
        assert!((1..60).contains(&num_prunes), "{num_prunes}");
        assert!(Map::verify(&path)?.is_clean());
        Ok(())
    }
}

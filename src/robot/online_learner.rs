//! What does a map learn while it is in use, and when is that written?

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::feature::{Features, GrayImage};
use crate::learn::{Circumstances, LearnConfig, Learner, Learnt, Observation};
use crate::map::{Map, PlaceKey, SessionId, Snapshot};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

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

/// How often what was learnt is learnt again, because other processes commit at the same time,
/// before the commit is put off until the next one is due: once would do, but for writers that do
/// not wait for their turn.
const MAX_ATTEMPTS: usize = 20;

/// A map file and the learner that goes on with it: learns visits, commits when it is time.
///
/// [`Robot`](super::Robot) has one where it learns; a program that learns labelled images, whose
/// places it knows, uses it alone. Nothing is committed when it is dropped. Other processes may
/// commit to the same file: what was learnt since the last commit is then learnt again on top of
/// theirs.
#[derive(Debug)]
pub struct OnlineLearner {
    map: Map,
    learner: Learner,
    /// What was learnt or quarantined since the last commit.
    pending: Vec<Pending>,
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

/// A visit that is not in the file yet.
#[derive(Debug)]
struct Pending {
    place: PlaceKey,
    session: SessionId,
    time: Time,
    features: Features,
    image_size: (u32, u32),
    mask: Option<GrayImage>,
    source: String,
    circumstances: Circumstances,
    /// Whether it was learnt and not quarantined.
    is_learnt: bool,
}

impl Pending {
    fn observe(&self, learner: &mut Learner) -> Result<()> {
        let observation = Observation {
            place: self.place.clone(),
            session: self.session,
            time: self.time,
            features: &self.features,
            image_size: self.image_size,
            mask: self.mask.as_ref(),
            source: self.source.clone(),
        };
        let learnt = learner.observe_under(&observation, &self.circumstances)?;
        // It was believed before, and somebody was told so.
        if learnt.doubt.is_some()
            && !learnt.is_same_visit
            && self.is_learnt
            && let Some(id) = learner.held().visits().last().map(|it| it.id)
        {
            learner.accept(id)?;
        }
        Ok(())
    }
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
            pending: Vec::new(),
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
        let learnt = self.learner.observe_under(observation, circumstances)?;
        if learnt.is_same_visit {
            return Ok(learnt);
        }
        self.pending.push(Pending {
            place: observation.place.clone(),
            session: observation.session,
            time: observation.time,
            features: observation.features.clone(),
            image_size: observation.image_size,
            mask: observation.mask.cloned(),
            source: observation.source.clone(),
            circumstances: *circumstances,
            is_learnt: learnt.doubt.is_none(),
        });
        Ok(learnt)
    }

    /// Whether the interval since the last commit has passed.
    pub fn is_commit_due(&self) -> bool {
        Instant::now() >= self.next_commit
    }

    /// Commits what was learnt as a generation of the file.
    ///
    /// Where another process has committed meanwhile, that is read, and what was learnt since the
    /// last commit is learnt again on top of it, for which other writers wait. Where a budget made
    /// the learner forget, and generations have become many, all but the last few are pruned. Fails
    /// as [`Map::replace`] and [`Map::prune`] do; what was learnt is still there then, and the call
    /// can be repeated.
    pub fn commit(&mut self) -> Result<Committed> {
        self.commit_with(|_| Ok(()))
    }

    /// [`commit`](Self::commit) of what was learnt with what `change` makes of it in addition, such
    /// as poses and edges; that may be called several times, and the learner goes on without it.
    pub fn commit_with(
        &mut self,
        change: impl Fn(&mut Snapshot) -> Result<()>,
    ) -> Result<Committed> {
        let begun = Instant::now();
        let mut stored = self.store(&change);
        if is_conflict(&stored) {
            self.map.take_turn();
            for _ in 1..MAX_ATTEMPTS {
                stored = self.refresh().and_then(|()| self.store(&change));
                if !is_conflict(&stored) {
                    break;
                }
            }
            self.map.end_turn();
        }
        let snapshot = stored?;
        self.pending.clear();
        match self.prune(&snapshot) {
            // Whoever has committed meanwhile will prune in turn.
            Err(error) if error.kind() != ErrorKind::Conflict => return Err(error),
            _ => {}
        }
        let took = begun.elapsed();
        self.next_commit = Instant::now() + self.interval.max(REST_PER_COMMIT * took);
        Ok(Committed {
            snapshot: self.map.snapshot(),
            took,
        })
    }

    /// Makes what was learnt, changed, the stored state, if nobody else has committed.
    fn store(&mut self, change: &impl Fn(&mut Snapshot) -> Result<()>) -> Result<Snapshot> {
        let mut snapshot = Snapshot::clone(&*self.learner.snapshot()?);
        change(&mut snapshot)?;
        self.map.replace(&snapshot)?;
        Ok(snapshot)
    }

    /// Goes on with what is in the file by now, and learns on top of it what is not in it yet.
    fn refresh(&mut self) -> Result<()> {
        let newest = self.map.refresh()?;
        let mut learner = Learner::resume(self.learner.cfg().clone(), Snapshot::clone(&newest))?;
        learner.follow_stays_of(&self.learner);
        for visit in &self.pending {
            match visit.observe(&mut learner) {
                // The other process has learnt the same image.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => {
                    tracing::warn!(
                        "{}: what another process has committed leaves no room for this visit: \
                         {error}",
                        visit.source
                    );
                }
                Ok(()) => {}
            }
        }
        self.learner = learner;
        Ok(())
    }

    fn prune(&self, snapshot: &Snapshot) -> Result<()> {
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

fn is_conflict<T>(stored: &Result<T>) -> bool {
    (stored.as_ref().err()).is_some_and(|error| error.kind() == ErrorKind::Conflict)
}

/// Whether a good part of the file is of the past. O(visits).
fn is_bloated(map: &Map, snapshot: &Snapshot) -> Result<bool> {
    let of_nodes = (snapshot.nodes().iter())
        .map(|node| node.num_bytes() + BYTES_PER_VISIT * node.visits().len())
        .sum::<usize>();
    let of_attachments: usize = snapshot.attachments().values().map(|it| it.len()).sum();
    let most = MOST_TIMES_ITS_BYTES * (of_nodes + of_attachments) + SMALL_BYTES;
    let found = std::fs::metadata(map.path()).map_err(|cause| Error::io(map.path(), cause))?;
    Ok(found.len() > most as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Keypoint};
    use crate::learn::{BudgetConfig, GuardConfig, Judge};
    use crate::map::{MapMeta, derived_uuid};

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
            assert_eq!(learner.map().snapshot().nodes(), learnt.nodes());
            let found = std::fs::metadata(&path).map_or(0, |it| it.len());
            assert!(found < 3 * SMALL_BYTES as u64, "{found} bytes at {number}");
        }
        // Seldom, and often enough.
        assert!((1..60).contains(&num_prunes), "{num_prunes}");
        assert!(Map::verify(&path)?.is_clean());
        Ok(())
    }
}

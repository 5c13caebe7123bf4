//! What does a map learn from the images that it has located?
//!
//! Each located image becomes a visit of its place: it was seen there, so it is learnt as if somebody
//! had said so. Every few seconds what was learnt is committed as a generation, and localising goes on
//! with it; less often where a commit takes long. An image that was learnt before is not learnt again, and one that does not agree with what was
//! predicted of its place is held until somebody accepts it (`map accept`).

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::{Features, GrayImage};
use chronotope::learn::{Circumstances, LearnConfig, Learner, Observation, Recipe};
use chronotope::map::{Map, PlaceKey, SessionId, Snapshot};
use chronotope::time::Time;

use super::held;
use super::pictures::Picture;

/// Commits are at least this far apart.
const COMMIT_INTERVAL: Duration = Duration::from_secs(1);

/// After a commit, so many times as long as it took passes before the next.
const REST_PER_COMMIT: u32 = 9;

/// A map within a budget is pruned to its last few generations where it has more than the first number of
/// them and its file is more than so many times as large as what it holds.
const MOST_GENERATIONS: usize = 8;
const MOST_TIMES_ITS_BYTES: usize = 2;
const KEPT_GENERATIONS: usize = 4;

/// Bytes of a visit's row in the file beside its features and bits, about.
const BYTES_PER_VISIT: usize = 200;
/// A file so small is never pruned.
const SMALL_BYTES: usize = 1 << 18;

pub(super) struct Student {
    map: Map,
    learner: Learner,
    session: SessionId,
    next_commit: Instant,
    is_live: bool,
    num_learnt: usize,
    num_held: usize,
}

impl Student {
    /// `is_live`: the images are of now, so this is a run like no other; else images that are given
    /// twice are the same visit.
    pub(super) fn new(map: Map, cfg: LearnConfig, is_live: bool) -> Result<Self> {
        let refused = |message: &str, help: &str| {
            let error = Error::new(ErrorKind::Config, message).with_path(map.path());
            Err(error.with_help(help))
        };
        if map.is_read_only() {
            return refused(
                "this map may not be written",
                "leave out --learn or copy the map",
            );
        }
        if cfg.recipe() == Recipe::Reference {
            return refused(
                "the reference recipe looks at all images of a place at once",
                "leave out --learn and use `chronotope map update`",
            );
        }
        Ok(Self {
            learner: Learner::resume(cfg, Snapshot::clone(&map.snapshot()))?,
            map,
            session: if is_live {
                SessionId::random()
            } else {
                SessionId::derive("localize")
            },
            next_commit: Instant::now() + COMMIT_INTERVAL,
            is_live,
            num_learnt: 0,
            num_held: 0,
        })
    }

    /// Learns an image of this place; gives the map to go on with, if there is a newer one.
    pub(super) fn observe(
        &mut self,
        place: &PlaceKey,
        picture: &Picture,
        mask: Option<&GrayImage>,
        live: &Features,
    ) -> Result<Option<Arc<Snapshot>>> {
        let Some((time, _)) = picture.time else {
            return Err(
                Error::new(ErrorKind::Time, "without a time it cannot be learnt")
                    .with_help("give --time"),
            );
        };
        let observation = Observation {
            place: place.clone(),
            session: self.session,
            time,
            features: live,
            image_size: (picture.image.width() as u32, picture.image.height() as u32),
            mask,
            source: picture.name.clone(),
        };
        let circumstances = Circumstances {
            now: now(),
            is_live: self.is_live,
            gray_range: picture.image.gray_range(mask),
        };
        let learnt = (self.learner).observe_under(&observation, &circumstances)?;
        if let Some(doubt) = &learnt.doubt {
            self.num_held += 1;
            held::tell(&picture.name, doubt, self.map.path());
            return Ok(None);
        }
        self.num_learnt += 1;
        tracing::info!(
            image = picture.name,
            place = place.as_str(),
            seen = learnt.num_seen,
            born = learnt.num_born,
            "learnt"
        );
        if Instant::now() < self.next_commit {
            return Ok(None);
        }
        self.commit().map(Some)
    }

    fn commit(&mut self) -> Result<Arc<Snapshot>> {
        let begun = Instant::now();
        store(&self.map, &mut self.learner)?;
        let rest = REST_PER_COMMIT * begun.elapsed();
        self.next_commit = Instant::now() + rest.max(COMMIT_INTERVAL);
        Ok(self.map.snapshot())
    }

    /// Commits the rest and says what was learnt.
    pub(super) fn finish(mut self) -> Result<()> {
        let snapshot = self.commit()?;
        eprintln!(
            "learnt: {} visits, {} held; {} is at generation {}",
            self.num_learnt,
            self.num_held,
            self.map.path().display(),
            snapshot.generation
        );
        Ok(())
    }
}

impl Drop for Student {
    /// An error that ends the run (a closed pipe, say) loses nothing of what was learnt before.
    fn drop(&mut self) {
        if let Err(error) = self.commit() {
            tracing::warn!("what was learnt last is not kept: {error}");
        }
    }
}

/// What the machine's clock says; `None` if it is before 1970.
pub(super) fn now() -> Option<Time> {
    let since_epoch = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let us = i64::try_from(since_epoch.ok()?.as_micros()).ok()?;
    Some(Time::from_us(us))
}

/// Commits what was learnt, and gives the generation.
///
/// Where a budget made the learner forget, the places that did are written anew, and what they were stays
/// in the file; so it is pruned from time to time, or it would grow though the map does not.
pub(super) fn store(map: &Map, learner: &mut Learner) -> Result<u64> {
    let snapshot = learner.snapshot()?;
    let generation = map.replace(&snapshot)?;
    if learner.cfg().budget().is_bounded() && is_bloated(map, &snapshot)? {
        let generations = map.generations()?;
        if generations.len() > MOST_GENERATIONS {
            let newest = generations.iter().rev().take(KEPT_GENERATIONS);
            map.prune(&newest.map(|it| it.number).collect())?;
        }
    }
    Ok(generation)
}

/// Whether a good part of the file is of the past. O(visits).
fn is_bloated(map: &Map, snapshot: &Snapshot) -> Result<bool> {
    let of_nodes = (snapshot.nodes.iter())
        .map(|node| node.num_bytes() + BYTES_PER_VISIT * node.visits.len())
        .sum::<usize>();
    let of_attachments: usize = snapshot.attachments.values().map(|it| it.len()).sum();
    let most = MOST_TIMES_ITS_BYTES * (of_nodes + of_attachments) + SMALL_BYTES;
    let found = std::fs::metadata(map.path()).map_err(|cause| Error::io(map.path(), &cause))?;
    Ok(found.len() > most as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use chronotope::feature::{Descriptor, Keypoint};
    use chronotope::learn::{BudgetConfig, GuardConfig, Judge};
    use chronotope::map::{MapMeta, derived_uuid};

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
        let folder = tempfile::tempdir().map_err(|cause| Error::io("a folder", &cause))?;
        let path = folder.path().join("a.map");
        let map = Map::create(&path, MapMeta::new(derived_uuid("a"), "none", "default"))?;
        let budget = BudgetConfig::default()
            .with_visits_per_place(20)
            .with_features_per_place(120);
        let guard = GuardConfig::default().with_judge(Judge::Never);
        let cfg = (LearnConfig::default().with_guard(guard)).with_budget(budget)?;
        let mut learner = Learner::resume(cfg, Snapshot::clone(&map.snapshot()))?;
        let (mut num_prunes, mut num_before) = (0, 0);
        for number in 0..240 {
            learner.observe(&Observation {
                place: PlaceKey::new(["door", "gate"][number as usize % 2])?,
                session: SessionId::derive("run"),
                time: Time::from_s(number as i64 * 3_600),
                features: &image(number),
                image_size: (640, 480),
                mask: None,
                source: String::new(),
            })?;
            store(&map, &mut learner)?;
            let num_generations = map.generations()?.len();
            num_prunes += usize::from(num_generations < num_before);
            num_before = num_generations;
            assert_eq!(map.snapshot().nodes, learner.snapshot()?.nodes);
            let found = std::fs::metadata(&path).map_or(0, |it| it.len());
            assert!(found < 3 * SMALL_BYTES as u64, "{found} bytes at {number}");
        }
        // Seldom, and often enough.
        assert!((1..60).contains(&num_prunes), "{num_prunes}");
        assert!(Map::verify(&path)?.is_clean());
        Ok(())
    }
}

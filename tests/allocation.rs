//! Does localising allocate once its memory is warm? Does extraction?
//!
//! A test target of its own, because the allocator that counts is that of the whole binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a test that cannot prepare itself has failed"
)]
#![allow(unsafe_code)] // reason: an allocator is unsafe to write; this one counts and passes on.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::{Arc, OnceLock};

use chronotope::Time;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Descriptor, Extractor, Features, Keypoint, StarBrief};
use chronotope::learn::{KeepAppearances, LearnConfig, Learner, Observation};
use chronotope::localize::{
    Localization, Localizer, LocalizerConfig, Method, PlaceSearch, Preset, Query, Score,
};
use chronotope::map::{
    AppearanceUse, MapMeta, Node, PlaceKey, SessionId, Snapshot, Visit, VisitId,
};
use chronotope::visibility::BitRow;

/// Passes on to the system's allocator and counts the calls of each thread.
struct Counting;

thread_local! {
    static NUM_ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

fn count_one() {
    // A thread that is being taken down allocates uncounted.
    let _ = NUM_ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
}

// SAFETY: every call goes to `System` unchanged; counting touches a constant-initialised `Cell` of
// this thread, which itself never allocates.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count_one();
        // SAFETY: the caller keeps the contract of `realloc`, and `pointer` came from `System`.
        unsafe { System.realloc(pointer, layout, new_size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract of `dealloc`, and `pointer` came from `System`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// How often `work` allocates on this thread.
fn allocations(work: impl FnOnce()) -> usize {
    let before = NUM_ALLOCATIONS.get();
    work();
    NUM_ALLOCATIONS.get() - before
}

/// Rounds of all queries until memory is warm.
const WARM_UP: usize = 8;

/// Three places learnt over eight rounds, and what is seen at two later ones.
struct Street {
    snapshots: Vec<(Preset, Arc<Snapshot>)>,
    queries: Vec<(Time, Features)>,
}

fn street() -> &'static Street {
    static STREET: OnceLock<Street> = OnceLock::new();
    STREET.get_or_init(|| {
        let world = World::new(&WorldConfig::new(11).with_num_places(3)).unwrap();
        let schedule = Schedule::standard(11, 8, 2);
        let extractor = StarBrief::default();
        let mut learners = Preset::ALL.map(|preset| {
            let cfg = LearnConfig::preset(preset).with_keep_appearances(KeepAppearances::All);
            let meta = MapMeta::new(1, extractor.id(), preset.name());
            (preset, Learner::new(cfg, meta))
        });
        for entry in world.dataset("learn", &schedule.learn).entries {
            let image = entry.source.load().unwrap();
            let features = extractor.extract(&image, None).unwrap();
            for (_, learner) in &mut learners {
                let observation = Observation::new(
                    entry.place.clone(),
                    SessionId::derive("learn"),
                    entry.time,
                    &features,
                    image.size(),
                )
                .with_source(entry.id.clone());
                learner.observe(&observation).unwrap();
            }
        }
        let queries = world.dataset("query", &schedule.query).entries;
        let see = |source: &dyn chronotope::dataset::ImageSource| {
            let image = source.load().unwrap();
            extractor.extract(&image, None).unwrap()
        };
        Street {
            snapshots: learners
                .map(|(preset, mut learner)| (preset, learner.snapshot().unwrap()))
                .into(),
            queries: (queries.iter())
                .map(|entry| (entry.time, see(entry.source.as_ref())))
                .collect(),
        }
    })
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 1);
}

#[test]
fn localising_allocates_nothing_once_warm() {
    let street = street();
    for (preset, snapshot) in &street.snapshots {
        for method in Method::ALL {
            for score in Score::ALL {
                let cfg = LocalizerConfig::preset(*preset)
                    .with_method(method)
                    .with_score(score);
                let localizer = Localizer::new(Arc::clone(snapshot), cfg).unwrap();
                let mut scratch = localizer.scratch();
                let mut out = Localization::default();
                let mut all = |out: &mut Localization| {
                    for (time, features) in &street.queries {
                        let query = Query::new(features).at(*time);
                        localizer.localize_into(&mut scratch, &query, out).unwrap();
                    }
                };
                // More than once: ranking moves the places' buffers around, and each must have
                // grown to the largest place's evidence.
                for _ in 0..WARM_UP {
                    all(&mut out);
                }
                let first = out.first().map(|first| first.node);
                let count = allocations(|| all(&mut out));
                assert_eq!(count, 0, "{} {method} {score:?}", preset.name());
                assert_eq!(out.first().map(|first| first.node), first);
            }
        }
    }
}

#[test]
fn a_new_time_bucket_allocates_nothing_once_warm() {
    let street = street();
    for (preset, snapshot) in &street.snapshots {
        let cfg = LocalizerConfig::preset(*preset);
        let localizer = Localizer::new(Arc::clone(snapshot), cfg).unwrap();
        let mut scratch = localizer.scratch();
        let mut out = Localization::default();
        let (start, features) = &street.queries[0];
        let mut day = |hours: std::ops::Range<i64>| {
            for hour in hours {
                let query = Query::new(features).at(start.plus_us(hour * 3_600_000_000));
                localizer
                    .localize_into(&mut scratch, &query, &mut out)
                    .unwrap();
            }
        };
        day(0..24);
        assert_eq!(allocations(|| day(24..30)), 0, "{}", preset.name());
    }
}

/// 400 places of 20 features each, seen at two visits.
fn town() -> Snapshot {
    let mut state = 88_172_645_463_325_252_u64;
    let mut random = || {
        // Xorshift (Marsaglia 2003).
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut snapshot = Snapshot::empty(MapMeta::new(1, "none", "default"));
    for place in 0..400_u32 {
        let mut node = Node::new(PlaceKey::new(&format!("p{place}")).unwrap());
        let mut born = Features::new();
        for _ in 0..20 {
            let keypoint = Keypoint {
                x: (random() % 400) as f32,
                y: (random() % 300) as f32,
                size: 10.0,
                response: 1.0,
            };
            let descriptor = Descriptor(std::array::from_fn(|_| random()));
            born.push(keypoint, descriptor);
        }
        for visit in 0..2_u32 {
            let time = Time::from_s(1_700_000_000 + i64::from(visit) * 7_000);
            let mut seen = BitRow::zeros(20);
            for feature in 0..20 {
                seen.set(feature);
            }
            let visit = Visit {
                id: VisitId(u128::from(place * 2 + visit)),
                session: SessionId::derive("town"),
                time,
                source: String::new(),
                appearance: None,
                appearance_use: AppearanceUse::Recognised,
            };
            let born = std::mem::take(&mut born);
            (node.push_visit(visit, &born, seen, None, BitRow::zeros(0))).unwrap();
        }
        snapshot.push_node(node).unwrap();
    }
    snapshot
}

#[test]
fn short_lists_of_places_allocate_nothing_once_warm() {
    let snapshot = Arc::new(town());
    let cfg = LocalizerConfig::default().with_place_search(PlaceSearch::Inverted);
    let localizer = Localizer::new(Arc::clone(&snapshot), cfg).unwrap();
    let mut scratch = localizer.scratch();
    let mut out = Localization::default();
    let mut ask_all = || {
        for node in snapshot.nodes().iter().step_by(13) {
            let query = Query::new(node.features()).at(Time::from_s(1_700_020_000));
            localizer
                .localize_into(&mut scratch, &query, &mut out)
                .unwrap();
            let first = &localizer.snapshot().node(out.ranking[0].node);
            assert_eq!(first.key(), node.key());
        }
    };
    ask_all();
    ask_all();
    assert_eq!(allocations(ask_all), 0);
    assert!(out.ranking.len() < snapshot.nodes().len());
}

#[test]
fn extracting_allocates_nothing_once_warm() {
    let world = World::new(&WorldConfig::new(12).with_num_places(1)).unwrap();
    let images: Vec<_> = (world.dataset("images", &Schedule::standard(12, 3, 1).learn))
        .entries
        .iter()
        .map(|entry| entry.source.load().unwrap())
        .collect();
    let extractor = StarBrief::default();
    let mut features = Features::new();
    let all = |features: &mut Features| {
        for image in &images {
            extractor
                .extract_into(image.view(), None, features)
                .unwrap();
            assert!(!features.is_empty());
        }
    };
    all(&mut features);
    assert_eq!(allocations(|| all(&mut features)), 0);
}

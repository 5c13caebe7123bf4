//! Following a robot through the rendered street, also when it is carried away.

use std::sync::Arc;

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, Features, StarBrief};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::{
    Localization, Localizer, LocalizerConfig, MotionConfig, Preset, Query, Tracker,
};
use chronotope::map::{Edge, MapMeta, SessionId, Snapshot};
use chronotope::predict::Selection;
use chronotope::{Period, Time};

const SIZE: (u32, u32) = (448, 384);
const NUM_PLACES: usize = 8;
/// So few features that one image alone is often not enough.
const N: usize = 6;
/// Along the street; carried from its fifth place to the last; and on.
const ROUTE: [usize; 9] = [0, 1, 2, 3, 4, 7, 6, 5, 4];
const KIDNAPPED_AT: usize = 5;

fn features(world: &World, place: usize, time: Time, seed: u64) -> Features {
    let image = world.render(place, time, seed);
    StarBrief::default()
        .extract(&image, None)
        .expect("a valid image")
}

/// A street of look-alike places, each with a way to the next.
fn learn(world: &World, rounds: &[Time]) -> Arc<Snapshot> {
    let mut learner = Learner::new(
        LearnConfig::preset(Preset::Default),
        MapMeta::new(5, "star-brief", Preset::Default.name()),
    );
    for (round, &time) in rounds.iter().enumerate() {
        for place in 0..NUM_PLACES {
            let observed = learner.observe(
                &Observation::new(
                    world.places()[place].clone(),
                    SessionId::derive("street"),
                    time.plus_us(place as i64 * 60_000_000),
                    &features(world, place, time, 0),
                    SIZE,
                )
                .with_source(format!("{round}/{place}")),
            );
            assert!(!observed.expect("learns").is_same_visit);
        }
    }
    let mut snapshot = (*learner.snapshot().expect("fits together")).clone();
    for ends in world.places().windows(2) {
        let edge = Edge {
            from: ends[0].clone(),
            to: ends[1].clone(),
            name: String::new(),
        };
        snapshot.add_edge(edge).expect("new");
    }
    Arc::new(snapshot)
}

#[test]
fn a_way_through_the_street_is_followed_and_a_kidnapping_is_noticed() {
    let world = World::new(&WorldConfig::new(4243).with_num_places(NUM_PLACES)).expect("valid");
    let schedule = Schedule::standard(4243, 8, 4);
    let snapshot = learn(&world, &schedule.learn);
    let cfg = LocalizerConfig::default().with_selection(Selection::top(N).expect("positive"));
    let localizer = Localizer::new(Arc::clone(&snapshot), cfg).expect("fits");
    let mut scratch = localizer.scratch();
    let mut answer = Localization::default();
    let (mut alone, mut followed, mut located) = (0, 0, [0, 0]);
    for (round, &start) in schedule.query.iter().enumerate() {
        let mut tracker = Tracker::new(&localizer, MotionConfig::default()).expect("valid");
        for (image, &place) in ROUTE.iter().enumerate() {
            let time = start.plus_us(image as i64 * Period::DAY.as_us() / 1440);
            let live = features(&world, place, time, round as u64);
            let query = Query::new(&live).at(time).with_image_size(SIZE);
            localizer
                .localize_into(&mut scratch, &query, &mut answer)
                .expect("a valid query");
            let is_right = |answer: &Localization| {
                let first = answer.first().expect("places");
                *snapshot.node(first.node).key() == world.places()[place]
            };
            let is_located =
                |answer: &Localization| is_right(answer) && answer.decision.place().is_some();
            // Just after the kidnapping the past is wrong, and outweighs one weak image.
            let is_kidnapped = (KIDNAPPED_AT..KIDNAPPED_AT + 2).contains(&image);
            alone += usize::from(!is_kidnapped && is_right(&answer));
            located[0] += usize::from(is_located(&answer));
            tracker
                .update(localizer.cfg(), &mut answer)
                .expect("the same map");
            followed += usize::from(!is_kidnapped && is_right(&answer));
            located[1] += usize::from(is_located(&answer));
            let total: f64 = tracker.belief().iter().sum::<f64>() + tracker.off_map();
            assert!((total - 1.0).abs() < 1e-9, "{tracker:?}");
            if image == KIDNAPPED_AT + 2 {
                assert!(
                    is_right(&answer),
                    "round {round}: lost after {image} images"
                );
            }
        }
    }
    let num_queries = schedule.query.len() * (ROUTE.len() - 2);
    assert!(followed >= alone, "{followed} < {alone} of {num_queries}");
    assert!(located[1] > located[0], "{located:?}");
}

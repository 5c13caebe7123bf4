//! Localisers that go on with a newer map: what is taken over is what would be made anew.

use std::sync::Arc;

use chronotope::localize::{Localizer, LocalizerConfig, PlaceSearch, Score};
use chronotope::map::{NodeId, Snapshot, SnapshotParts};

use crate::index_cache::{NUM_FEATURES, NUM_VISITS, answers, cfg, map};

/// A map, and one that came of it: a place that forgot features and visits, another that forgot
/// visits, and a new one.
fn two_maps(num_places: usize) -> (Arc<Snapshot>, Arc<Snapshot>) {
    let mut newer = map(num_places + 1);
    let mut older = newer.clone().into_parts();
    older.nodes.truncate(num_places);
    let older = Snapshot::from_parts(older).expect("without edges");
    let every = |step: usize, count: usize| -> Vec<bool> {
        (0..count).map(|at| !at.is_multiple_of(step)).collect()
    };
    for (place, visits, features) in [
        (1, every(5, NUM_VISITS), every(8, NUM_FEATURES)),
        (
            num_places / 2,
            every(4, NUM_VISITS),
            vec![true; NUM_FEATURES],
        ),
    ] {
        let place = NodeId(place as u32);
        let (left, _) = (newer.node(place).retained(&visits, &features)).expect("fits");
        assert_ne!(left.features().len(), 0);
        newer.replace_node(place, left).expect("the same place");
    }
    let mut newer = newer.into_parts();
    newer.generation += 1;
    let newer = Snapshot::from_parts(newer).expect("as sound as before");
    (Arc::new(older), Arc::new(newer))
}

fn both(candidates: PlaceSearch) -> [LocalizerConfig; 2] {
    let cfg = cfg().with_place_search(candidates);
    [
        cfg.clone(),
        cfg.with_score(Score::Inliers).with_calibrated(false),
    ]
}

#[test]
fn a_forecast_that_is_taken_over_is_the_one_that_would_be_made() {
    let (older, newer) = two_maps(300);
    for candidates in [PlaceSearch::Exact, PlaceSearch::Inverted] {
        for cfg in both(candidates) {
            let localizer = Localizer::new(Arc::clone(&older), cfg.clone()).expect("fits");
            // Nothing was queried yet, so there is nothing to take over but models.
            let fresh = (localizer.with_snapshot(Arc::clone(&newer))).expect("fits");
            let before = answers(&localizer);
            let queried = (localizer.with_snapshot(Arc::clone(&newer))).expect("fits");
            let expected = answers(&fresh);
            assert!(answers(&queried) == expected, "{cfg:?}");
            assert!(before != expected, "the maps differ");
            // The same without anything in common but contents, and without anything at all.
            let apart = Snapshot::from_parts(SnapshotParts {
                nodes: (newer.nodes().iter())
                    .map(|node| Arc::new((**node).clone()))
                    .collect(),
                ..(*newer).clone().into_parts()
            });
            let apart = apart.expect("the same map");
            let apart = localizer.with_snapshot(Arc::new(apart)).expect("fits");
            assert!(answers(&apart) == expected, "{cfg:?}");
            if !cfg.calibrated() && candidates == PlaceSearch::Exact {
                let anew = Localizer::new(Arc::clone(&newer), cfg).expect("fits");
                assert!(answers(&anew) == expected);
            }
        }
    }
}

#[test]
fn a_map_that_lost_places_is_one_to_go_on_with() {
    let (older, newer) = two_maps(6);
    let [_, cfg] = both(PlaceSearch::Exact);
    let localizer = Localizer::new(newer, cfg.clone()).expect("fits");
    answers(&localizer);
    let shorter = (localizer.with_snapshot(Arc::clone(&older))).expect("fits");
    let anew = Localizer::new(older, cfg).expect("fits");
    assert!(answers(&shorter) == answers(&anew));
    let nothing = Snapshot::empty(anew.snapshot().meta().clone());
    let error = localizer
        .with_snapshot(Arc::new(nothing))
        .expect_err("no places");
    assert!(error.to_string().contains("no places"), "{error}");
}

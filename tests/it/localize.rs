//! Learning and localising end to end on a small synthetic world.

use std::sync::{Arc, OnceLock};

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::dataset::{Dataset, Entry};
use chronotope::feature::{Extractor, Features, StarBrief};
use chronotope::learn::{KeepAppearances, LearnConfig, Learner, Observation};
use chronotope::localize::{
    ATTACHMENT, Calibration, Decision, Localization, Localizer, LocalizerConfig, Method, Preset,
    Query, Score, Scratch, Sweep,
};
use chronotope::map::{AppearanceUse, Map, MapMeta, PlaceKey, SessionId, Snapshot};
use chronotope::predict::Selection;
use chronotope::visibility::VisibilityConfig;
use chronotope::{ErrorKind, Time};

const SIZE: (u32, u32) = (448, 384);

struct Seen {
    entry: Entry,
    features: Features,
}

/// Four places, ten rounds to learn, three to query.
struct Street {
    learn: Vec<Seen>,
    query: Vec<Seen>,
}

fn street() -> &'static Street {
    static STREET: OnceLock<Street> = OnceLock::new();
    STREET.get_or_init(|| {
        let world = World::new(&WorldConfig::new(4711).with_num_places(4)).expect("valid");
        let schedule = Schedule::standard(4711, 10, 3);
        let extractor = StarBrief::default();
        let see = |dataset: Dataset| {
            (dataset.entries.into_iter())
                .map(|entry| {
                    let image = entry.source.load().expect("renders");
                    assert_eq!(image.size(), SIZE);
                    let features = extractor.extract(&image, None).expect("extracts");
                    Seen { entry, features }
                })
                .collect()
        };
        Street {
            learn: see(world.dataset("learn", &schedule.learn)),
            query: see(world.dataset("query", &schedule.query)),
        }
    })
}

fn observation(seen: &Seen) -> Observation<'_> {
    Observation::new(
        seen.entry.place.clone(),
        SessionId::derive("test"),
        seen.entry.time,
        &seen.features,
        SIZE,
    )
    .with_source(seen.entry.id.clone())
}

fn learner(preset: Preset, keep: KeepAppearances) -> Learner {
    let cfg = LearnConfig::preset(preset).with_keep_appearances(keep);
    let mut learner = Learner::new(cfg, MapMeta::new(7, "star-brief", preset.name()));
    for seen in &street().learn {
        let learnt = learner.observe(&observation(seen)).expect("learns");
        assert!(!learnt.is_same_visit);
    }
    learner
}

fn snapshot(preset: Preset) -> Arc<Snapshot> {
    static LTTL: OnceLock<Arc<Snapshot>> = OnceLock::new();
    static DEFAULT: OnceLock<Arc<Snapshot>> = OnceLock::new();
    let known = match preset {
        Preset::Lttl => &LTTL,
        Preset::Default => &DEFAULT,
    };
    Arc::clone(known.get_or_init(|| {
        learner(preset, KeepAppearances::All)
            .snapshot()
            .expect("fits together")
    }))
}

fn localizer(preset: Preset, method: Method) -> Localizer {
    let cfg = LocalizerConfig::preset(preset).with_method(method);
    Localizer::new(snapshot(preset), cfg).expect("map fits")
}

fn query(seen: &Seen) -> Query<'_> {
    Query::new(&seen.features)
        .at(seen.entry.time)
        .with_image_size(SIZE)
}

fn is_right(localizer: &Localizer, seen: &Seen, found: &Localization) -> bool {
    found
        .first()
        .is_some_and(|first| *localizer.snapshot().node(first.node).key() == seen.entry.place)
}

#[test]
fn every_method_finds_most_places() {
    for preset in Preset::ALL {
        for method in Method::ALL {
            let localizer =
                localizer(preset, method).with_selection(Selection::top(300).expect("positive"));
            let mut scratch = localizer.scratch();
            let right = (street().query.iter())
                .filter(|seen| {
                    let found = localizer
                        .localize(&mut scratch, &query(seen))
                        .expect("fits");
                    is_right(&localizer, seen, &found)
                })
                .count();
            let all = street().query.len();
            assert!(right * 3 >= all * 2, "{preset} {method}: {right} of {all}");
        }
    }
}

#[test]
fn a_sweep_says_what_single_localisations_say() {
    let sizes = [1, 5, 20, 50, 1000];
    for preset in Preset::ALL {
        let mut sweep = Sweep::new(&sizes).expect("ascending");
        for seen in street().query.iter().take(4) {
            sweep.restart();
            for method in Method::ALL {
                let mut localizer = localizer(preset, method);
                let mut scratch = Scratch::default();
                localizer
                    .sweep(&mut scratch, &query(seen), &mut sweep)
                    .expect("fits");
                for (size, &n) in sizes.iter().enumerate() {
                    localizer = localizer.with_selection(Selection::top(n).expect("positive"));
                    let found = localizer
                        .localize(&mut scratch, &query(seen))
                        .expect("fits");
                    assert_eq!(found.pairs_compared, sweep.pairs_compared()[size]);
                    for candidate in &found.ranking {
                        let scores = sweep.scores(candidate.node, size);
                        let score = localizer.cfg().score();
                        assert_eq!(candidate.score, scores.by(score), "{preset} {method} {n}");
                    }
                }
            }
        }
    }
}

#[test]
fn the_answer_does_not_depend_on_what_was_asked_before() {
    let localizer = localizer(Preset::Default, Method::Fremen);
    let mut scratch = localizer.scratch();
    let mut used = Localization::default();
    for seen in &street().query {
        localizer
            .localize_into(&mut scratch, &query(seen), &mut used)
            .expect("fits");
        let fresh = localizer
            .localize(&mut localizer.scratch(), &query(seen))
            .expect("fits");
        assert_eq!(used, fresh);
    }
}

#[test]
fn images_of_one_time_bucket_get_one_prediction_whatever_came_before() {
    let cfg = LocalizerConfig::default().with_time_bucket_s(3600);
    let [warm, cold] =
        [(); 2].map(|()| Localizer::new(snapshot(Preset::Default), cfg.clone()).expect("map fits"));
    let mut scratch = warm.scratch();
    let seen = &street().query[0];
    let middle = cfg.middle_of_bucket(seen.entry.time);
    let at = |s: i64| query(seen).at(middle.plus_us(s * 1_000_000));
    let expected = cold.localize(&mut cold.scratch(), &at(0)).expect("fits");
    // Other buckets in between, more than are kept; one prepared beforehand, on other threads.
    for s in [-1800, 5000, 1799, 20_000, -7, 90_000, 0] {
        warm.prefetch(middle.plus_us(s * 1_000_000));
        let mut found = warm.localize(&mut scratch, &at(s)).expect("fits");
        if (-1800..1800).contains(&s) {
            assert_eq!(found.time, at(s).time);
            found.time = expected.time;
            assert_eq!(found, expected, "{s} s");
        }
    }
    // Without buckets, every moment has its own.
    let exact = cfg.with_time_bucket_s(0);
    let exact = Localizer::new(snapshot(Preset::Default), exact).expect("map fits");
    let found = exact.localize(&mut scratch, &at(0)).expect("fits");
    assert_eq!(found, expected);
    let model = exact.model(found.ranking[0].node).expect("a model");
    let found = exact.localize(&mut scratch, &at(1799)).expect("fits");
    let first = &found.ranking[0];
    for (&feature, &p) in first.predicted.iter().zip(&first.probabilities) {
        let time = at(1799).time.expect("given");
        assert!((model.predict_one(feature as usize, time) - p).abs() < 1e-12);
    }
}

#[test]
fn evidence_adds_up() {
    for method in [Method::Fremen, Method::Experience] {
        let localizer = localizer(Preset::Default, method);
        for seen in &street().query {
            let found = localizer
                .localize(&mut localizer.scratch(), &query(seen))
                .expect("fits");
            let shares: f64 = found.ranking.iter().map(|c| c.posterior).sum();
            assert!((shares + found.off_map - 1.0).abs() < 1e-12);
            assert!(found.ranking.is_sorted_by(|a, b| a.score >= b.score));
            for candidate in &found.ranking {
                assert_eq!(candidate.num_matches as usize, candidate.matches.len());
                let inliers = candidate.matches.iter().filter(|pair| pair.inlier).count();
                assert_eq!(candidate.num_inliers as usize, inliers);
                assert!(candidate.score.is_finite());
                let mut live: Vec<u32> = candidate.matches.iter().map(|pair| pair.live).collect();
                live.sort_unstable();
                live.dedup();
                assert_eq!(
                    live.len(),
                    candidate.matches.len(),
                    "one live feature, one use"
                );
            }
        }
    }
}

#[test]
fn an_image_of_nothing_is_unknown() {
    for method in Method::ALL {
        let localizer = localizer(Preset::Default, method);
        let nothing = Features::new();
        let query = Query::new(&nothing)
            .at(Time::from_s(1_700_000_000))
            .with_image_size(SIZE);
        let found = localizer
            .localize(&mut localizer.scratch(), &query)
            .expect("an answer");
        assert_eq!(found.decision, Decision::Unknown, "{method}");
        let counting = (localizer.cfg().clone()).with_score(Score::Inliers);
        let counting = Localizer::new(snapshot(Preset::Default), counting).expect("map fits");
        let found = counting
            .localize(&mut counting.scratch(), &query)
            .expect("an answer");
        assert_eq!(found.decision, Decision::Unknown, "{method}");
        assert_eq!(found.tied, counting.snapshot().nodes().len());
    }
}

/// The street without its last place.
fn snapshot_without_last() -> (Arc<Snapshot>, PlaceKey) {
    let mut parts = Snapshot::clone(&snapshot(Preset::Default)).into_parts();
    let last = parts.nodes.pop().expect("four places");
    let part = Snapshot::from_parts(parts).expect("no edge leads there");
    (Arc::new(part), last.key().clone())
}

#[test]
fn places_of_the_map_are_located_and_others_are_not() {
    let cfg = LocalizerConfig::default().with_off_map(0.5).with_risk(0.2);
    let whole = Localizer::new(snapshot(Preset::Default), cfg.clone()).expect("map fits");
    let (part, unknown) = snapshot_without_last();
    let part = Localizer::new(part, cfg).expect("map fits");
    let (mut located, mut natives, mut accepted, mut foreign) = (0, 0, 0, 0);
    for seen in &street().query {
        let found = whole
            .localize(&mut whole.scratch(), &query(seen))
            .expect("fits");
        natives += 1;
        if let Decision::At(node) = found.decision {
            assert_eq!(*whole.snapshot().node(node).key(), seen.entry.place);
            located += 1;
        }
        if seen.entry.place == unknown {
            let found = part
                .localize(&mut part.scratch(), &query(seen))
                .expect("fits");
            foreign += 1;
            accepted += usize::from(matches!(found.decision, Decision::At(_)));
            assert!(found.off_map > 0.2, "{}", found.reason);
        }
    }
    // Ten visits a place are few: an even prior for being off the map leaves some undecided.
    assert!(located * 4 >= natives * 3, "{located} of {natives}");
    assert_eq!(accepted, 0, "of {foreign} foreign images");
}

#[test]
fn calibration_does_not_depend_on_the_number_of_threads() {
    let learnt: Vec<Localizer> = [1, 3]
        .into_iter()
        .map(|num_threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(num_threads)
                .build()
                .expect("threads");
            pool.install(|| localizer(Preset::Default, Method::Fremen))
        })
        .collect();
    let calibration = learnt[0].calibration().expect("the preset calibrates");
    assert_eq!(Some(calibration), learnt[1].calibration());
    assert!(calibration.num_images() >= 40, "every visit is queried");
    let knots = calibration.detection().knots();
    assert!(
        knots.is_sorted_by(|a, b| a.0 <= b.0 && a.1 <= b.1),
        "{knots:?}"
    );
    let [near, far] = [10, 40].map(|bits| calibration.distance_log_ratio(bits));
    assert!(near > far, "a close descriptor tells more: {near} {far}");
    assert!(calibration.mean_false_rate() < knots[knots.len() - 1].1);
}

#[test]
fn an_attached_calibration_is_taken_while_it_fits_and_never_otherwise() {
    let fresh = localizer(Preset::Default, Method::Fremen);
    let learnt = fresh.calibration().expect("the preset calibrates");
    let bytes = fresh.to_attachment().expect("writes").expect("calibrated");
    let with = |bytes: &[u8]| {
        let mut snapshot = Snapshot::clone(&snapshot(Preset::Default));
        (snapshot.attach(ATTACHMENT, bytes)).expect("a name");
        snapshot
    };
    let known = |snapshot: Snapshot, cfg: LocalizerConfig| {
        let localizer = Localizer::new(Arc::new(snapshot), cfg).expect("map fits");
        localizer.calibration().expect("calibrated").clone()
    };
    let cfg = LocalizerConfig::default();
    assert_eq!(known(with(&bytes), cfg.clone()), *learnt, "as it was");

    // A copy that says something else shows whether it is what was taken.
    let text = String::from_utf8(bytes.to_vec()).expect("JSON");
    let marked = text.replacen("\"num_images\":", "\"num_images\":9", 1);
    assert_ne!(marked, text);
    let is_taken = |calibration: &Calibration| calibration.num_images() != learnt.num_images();
    assert!(is_taken(&known(with(marked.as_bytes()), cfg.clone())));
    let other_n = cfg
        .clone()
        .with_selection(Selection::top(20).expect("positive"))
        .with_risk(0.3);
    assert!(
        is_taken(&known(with(marked.as_bytes()), other_n)),
        "it does not depend on n"
    );

    // Another model, another visit, another version, bytes that are none of ours.
    let other_model = cfg.clone().with_visibility(VisibilityConfig::mean());
    assert!(!is_taken(&known(with(marked.as_bytes()), other_model)));
    let mut grown = learner(Preset::Default, KeepAppearances::All);
    grown
        .observe(&observation(&street().query[0]))
        .expect("learns");
    let mut grown = Snapshot::clone(&grown.snapshot().expect("fits together"));
    (grown.attach(ATTACHMENT, marked.as_bytes())).expect("a name");
    let num_images = known(grown, cfg.clone()).num_images();
    assert!(num_images < 90, "{num_images} is of the copy");
    let version = marked.replacen("\"version\":", "\"version\":9", 1);
    let torn = &marked.as_bytes()[..marked.len() / 2];
    let wild = marked.replacen("\"false_rate\":", "\"false_rate\":7", 1);
    for bytes in [version.as_bytes(), torn, b"", wild.as_bytes()] {
        assert!(known(with(bytes), cfg.clone()) == *learnt);
    }
}

#[test]
fn a_source_that_no_map_can_keep_is_refused_before_it_is_learnt() {
    let mut learner = learner(Preset::Default, KeepAppearances::All);
    let before = learner.snapshot().expect("fits together");
    let seen = &street().query[0];
    let long = observation(seen).with_source("x".repeat(5000));
    let error = learner.observe(&long).expect_err("too long");
    assert_eq!(error.kind(), ErrorKind::Shape);
    assert!(error.to_string().contains("help:"), "{error}");
    assert_eq!(learner.snapshot().expect("fits together"), before);
}

#[test]
fn a_map_of_single_visits_is_calibrated_by_assumption() {
    let mut learner = Learner::new(
        LearnConfig::default(),
        MapMeta::new(7, "star-brief", "default"),
    );
    for seen in &street().learn[..4] {
        learner.observe(&observation(seen)).expect("learns");
    }
    let snapshot = learner.snapshot().expect("fits together");
    let localizer =
        Localizer::new(Arc::clone(&snapshot), LocalizerConfig::default()).expect("map fits");
    let calibration = localizer.calibration().expect("the preset calibrates");
    // Their images are matched with the places that they do not show.
    assert_eq!(calibration.num_images(), snapshot.nodes().len());
    let first = &street().learn[0];
    let found = (localizer.localize(&mut localizer.scratch(), &query(first))).expect("fits");
    assert!(is_right(&localizer, first, &found));
}

#[test]
fn queries_that_do_not_fit_are_refused_with_a_remedy() {
    let seen = &street().query[0];
    let fremen = localizer(Preset::Default, Method::Fremen);
    let without_time = query(seen).at(None);
    let error = fremen
        .localize(&mut fremen.scratch(), &without_time)
        .expect_err("needs a time");
    assert_eq!(error.kind(), ErrorKind::Time);
    assert!(error.to_string().contains("help:"), "{error}");
    let fixed = localizer(Preset::Default, Method::Static);
    fixed
        .localize(&mut fixed.scratch(), &without_time)
        .expect("needs no time");

    let small = query(seen).with_image_size((100, 100));
    let error = fremen
        .localize(&mut fremen.scratch(), &small)
        .expect_err("another size");
    assert_eq!(error.kind(), ErrorKind::Shape);

    let empty = Arc::new(Snapshot::empty(MapMeta::new(7, "star-brief", "default")));
    let error = Localizer::new(empty, LocalizerConfig::default()).expect_err("no places");
    assert!(error.to_string().contains("no places"), "{error}");

    let forgetful = learner(Preset::Default, KeepAppearances::None)
        .snapshot()
        .expect("fits together");
    let cfg = LocalizerConfig::default().with_method(Method::Experience);
    let error = Localizer::new(forgetful, cfg).expect_err("nothing kept");
    assert!(error.to_string().contains("keep-appearances"), "{error}");
}

#[test]
fn any_time_has_an_answer() {
    let localizer = localizer(Preset::Default, Method::Fremen);
    for us in [i64::MIN, -1, 0, i64::MAX] {
        let query = query(&street().query[0]).at(Time::from_us(us));
        let found = localizer
            .localize(&mut localizer.scratch(), &query)
            .expect("an answer");
        for p in found.ranking.iter().flat_map(|c| &c.probabilities) {
            assert!((0.0..=1.0).contains(p), "{p} at {us} us");
        }
    }
}

#[test]
fn learning_the_same_visit_twice_is_refused_and_changes_nothing() {
    let mut learner = learner(Preset::Default, KeepAppearances::Experiences);
    let before = learner.snapshot().expect("fits together");
    let again = observation(&street().learn[0]);
    let error = learner.observe(&again).expect_err("known visit");
    assert_eq!(error.kind(), ErrorKind::AlreadyExists);
    let mut bad = observation(&street().query[0]);
    bad.image_size = (1, 1);
    assert_eq!(
        learner.observe(&bad).expect_err("another size").kind(),
        ErrorKind::Shape
    );
    assert_eq!(learner.snapshot().expect("fits together"), before);
}

#[test]
fn an_experience_is_added_only_where_the_others_fail() {
    let snapshot = snapshot(Preset::Default);
    let count = |only: AppearanceUse| {
        (snapshot.nodes().iter())
            .flat_map(|node| node.visits())
            .filter(|visit| visit.appearance_use == only)
            .count()
    };
    let experiences = count(AppearanceUse::Experience);
    assert!(
        experiences >= snapshot.nodes().len(),
        "the first visit of each place is one"
    );
    assert!(
        count(AppearanceUse::Recognised) > 0,
        "some visits were recognised"
    );
    for node in snapshot.nodes() {
        node.check().expect("in step");
        assert_eq!(node.visits()[0].appearance_use, AppearanceUse::Experience);
    }
}

#[test]
fn a_map_on_disk_answers_like_the_map_in_memory() {
    let dir = tempfile::tempdir().expect("temporary folder");
    for preset in Preset::ALL {
        let path = dir.path().join(preset.name());
        let in_memory = snapshot(preset);
        let map = Map::create(&path, in_memory.meta().clone()).expect("creates");
        map.commit(&in_memory).expect("commits");
        drop(map);
        let stored = Map::open(&path).expect("opens").snapshot();
        assert_eq!(stored.nodes(), in_memory.nodes());
        let cfg = LocalizerConfig::preset(preset).with_score(Score::Inliers);
        let [a, b] = [in_memory, stored]
            .map(|snapshot| Localizer::new(snapshot, cfg.clone()).expect("map fits"));
        for seen in &street().query {
            assert_eq!(
                a.localize(&mut a.scratch(), &query(seen)).expect("fits"),
                b.localize(&mut b.scratch(), &query(seen)).expect("fits")
            );
        }
    }
}

#[test]
fn features_of_a_shifted_visit_share_the_first_frame() {
    let base = &street().learn[0];
    let mut keypoints = base.features.keypoints().to_vec();
    for keypoint in &mut keypoints {
        keypoint.x += 12.0;
        keypoint.y -= 5.0;
    }
    let shifted = Seen {
        features: Features::from_parts(keypoints, base.features.descriptors().to_vec())
            .expect("pairs"),
        entry: Entry {
            time: base.entry.time.plus_us(3_600_000_000),
            ..base.entry.clone()
        },
    };
    let cfg = LearnConfig::default();
    let mut learner = Learner::new(cfg, MapMeta::new(7, "star-brief", "default"));
    let first = learner.observe(&observation(base)).expect("learns");
    let second = learner.observe(&observation(&shifted)).expect("learns");
    // Duplicates within the image (equal descriptors) may be taken for one another, and are then
    // born again.
    assert!(second.num_seen * 10 >= first.num_born * 9, "{second:?}");
    let snapshot = learner.snapshot().expect("fits together");
    let keypoints = snapshot.nodes()[0].features().keypoints();
    for keypoint in &keypoints[first.num_born..] {
        let duplicate = keypoints[..first.num_born]
            .iter()
            .any(|k| (k.x - keypoint.x).abs() < 0.5 && (k.y - keypoint.y).abs() < 0.5);
        assert!(duplicate, "{keypoint:?} was not moved back");
    }
}

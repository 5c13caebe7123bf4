//! A map that lives long: bounded, the same by whatever steps it was learnt, read while it is
//! written.

use std::sync::Arc;

use chronotope::feature::{Descriptor, Features, Keypoint};
use chronotope::learn::{
    BudgetConfig, GuardConfig, Judge, KeepAppearances, LearnConfig, Learner, Observation, merge,
};
use chronotope::localize::{Decision, Localizer, LocalizerConfig, Preset, Query};
use chronotope::map::{
    Map, MapMeta, PlaceKey, QuarantineReason, SessionId, Snapshot, derived_uuid,
};
use chronotope::{Period, Time};
use proptest::prelude::*;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder")
}

fn meta() -> MapMeta {
    MapMeta::new(derived_uuid("life"), "star+brief", "default")
}

/// A feature that looks like no other number's.
fn push(live: &mut Features, number: u64) {
    let bits = |salt: u64| {
        let mut word = (number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ salt;
        word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb)
    };
    let keypoint = Keypoint {
        x: 20.0 + (number * 37 % 600) as f32,
        y: 20.0 + (number * 53 % 440) as f32,
        size: 9.0,
        response: 1.0,
    };
    live.push(keypoint, Descriptor([bits(1), bits(2), bits(3), bits(4)]));
}

/// What visit `number` sees of one of two places: 40 features that last, 20 by day or by night, and
/// 15 that are never seen again.
fn image(place: u64, number: u64) -> Features {
    let mut live = Features::new();
    let base = 1_000_000 * place;
    (0..40)
        .filter(|i| !(i + number).is_multiple_of(7))
        .for_each(|i| push(&mut live, base + i));
    let half = 100 * (1 + number % 2);
    (0..20).for_each(|i| push(&mut live, base + half + i));
    (0..15).for_each(|i| push(&mut live, base + 1_000 + number * 15 + i));
    live
}

fn place(number: u64) -> PlaceKey {
    PlaceKey::new(&format!("place {number}")).expect("valid")
}

fn time(number: u64) -> Time {
    let start = Time::parse("2023-01-01T00:00:00Z").expect("valid");
    start.plus_us(number as i64 * Period::DAY.as_us() / 2)
}

fn observe(learner: &mut Learner, number: u64) -> usize {
    let place_number = number % 2;
    let live = image(place_number, number / 2);
    let learnt = learner
        .observe(
            &Observation::new(
                place(place_number),
                SessionId::derive("life"),
                time(number / 2),
                &live,
                (640, 480),
            )
            .with_source(format!("{number}.png")),
        )
        .expect("fits");
    assert_eq!(learnt.doubt, None, "visit {number}");
    learnt.num_forgotten
}

fn unguarded() -> LearnConfig {
    LearnConfig::default().with_guard(GuardConfig::default().with_judge(Judge::Never))
}

/// Whether the place still has the feature.
fn knows(snapshot: &Snapshot, place_number: u64, number: u64) -> bool {
    let mut wanted = Features::new();
    push(&mut wanted, 1_000_000 * place_number + number);
    let id = snapshot.find(&place(place_number)).expect("visited");
    let known = snapshot.node(id).features().descriptors();
    known.contains(&wanted.descriptors()[0])
}

#[test]
fn a_map_within_a_budget_stays_within_it_and_keeps_what_is_useful() {
    const NUM_VISITS: u64 = 600;
    let budget = BudgetConfig::default()
        .with_features_per_place(200)
        .with_visits_per_place(60);
    let cfg = LearnConfig::default().with_budget(budget).expect("sound");
    let mut learner = Learner::new(cfg.clone(), meta());
    let mut num_forgotten = 0;
    for number in 0..NUM_VISITS {
        num_forgotten += observe(&mut learner, number);
        if number % 50 == 49 {
            // As a robot does that is switched off and on.
            let snapshot = learner.snapshot().expect("in step");
            assert!(snapshot.check().is_ok());
            learner = Learner::resume(cfg.clone(), Snapshot::clone(&snapshot)).expect("sound");
        }
        let snapshot = learner.snapshot().expect("in step");
        for node in snapshot.nodes() {
            assert!(node.features().len() <= 200 && node.visits().len() <= 60);
        }
    }
    assert!(num_forgotten > 5_000, "{num_forgotten}");
    let snapshot = learner.snapshot().expect("in step");
    // What was born at the first visits is there, by day and by night, though it is the oldest.
    for place_number in 0..2 {
        let lasting = (0..40).chain(100..120).chain(200..220);
        let num_known = lasting
            .filter(|&i| knows(&snapshot, place_number, i))
            .count();
        assert!(num_known >= 78, "{num_known} of 80");
        // Of what was seen once, that of the past is gone.
        let old = (1_000..1_000 + NUM_VISITS / 4 * 15).step_by(7);
        assert!(old.filter(|&i| knows(&snapshot, place_number, i)).count() <= 3);
    }
    let localizer = Localizer::new(snapshot, LocalizerConfig::preset(Preset::Default));
    let localizer = localizer.expect("a map");
    let mut scratch = localizer.scratch();
    for number in NUM_VISITS..NUM_VISITS + 20 {
        let live = image(number % 2, number / 2);
        let query = Query::new(&live)
            .at(time(number / 2))
            .with_image_size((640, 480));
        let answer = localizer.localize(&mut scratch, &query).expect("fits");
        let right = localizer.snapshot().find(&place(number % 2));
        assert_eq!(Some(answer.decision), right.map(Decision::At), "{number}");
    }
}

#[test]
fn a_place_that_is_often_not_recognised_still_refuses_what_is_another() {
    let observe = |learner: &mut Learner, number: u64, live: &Features| {
        let observation = Observation::new(
            place(0),
            SessionId::derive("often"),
            time(number),
            live,
            (640, 480),
        );
        learner.observe(&observation).expect("fits")
    };
    let unknown = |number: u64| {
        let mut live = Features::new();
        (0..60).for_each(|i| push(&mut live, 9_000_000 + 100 * number + i));
        live
    };
    let mut learner = Learner::new(unguarded(), meta());
    for number in 0..48 {
        let live = image(0, number);
        observe(
            &mut learner,
            number,
            &if number % 4 == 3 {
                unknown(number)
            } else {
                live
            },
        );
        self::observe(&mut learner, 2 * number + 1);
    }
    let learnt = Snapshot::clone(&learner.snapshot().expect("in step"));
    let mut learner = Learner::resume(LearnConfig::default(), learnt).expect("sound");
    let doubt = observe(&mut learner, 50, &image(1, 50)).doubt;
    let looks_like = match &doubt {
        Some(QuarantineReason::Disagreement { looks_like, .. }) => looks_like.clone(),
        _ => None,
    };
    assert_eq!(looks_like, Some(place(1)), "{doubt:?}");
    // What shows nothing of it, or all of it, is as usual here.
    assert_eq!(observe(&mut learner, 51, &unknown(51)).doubt, None);
    assert_eq!(observe(&mut learner, 52, &image(0, 52)).doubt, None);
}

#[test]
fn bytes_of_places_and_of_the_map_are_bounded_too() {
    for budget in [
        BudgetConfig::default().with_bytes_per_place(100_000),
        BudgetConfig::default().with_bytes(200_000),
    ] {
        let cfg = LearnConfig::default().with_budget(budget).expect("sound");
        let mut learner = Learner::new(cfg, meta());
        for number in 0..300 {
            observe(&mut learner, number);
            let snapshot = learner.snapshot().expect("in step");
            let num_bytes: Vec<usize> = (snapshot.nodes().iter())
                .map(|node| node.num_bytes())
                .collect();
            assert!(num_bytes.iter().sum::<usize>() <= 200_000, "{num_bytes:?}");
        }
    }
}

/// A robot that stands at a charger by night, at ten images a second.
#[test]
fn a_stay_of_three_thousand_images_leaves_the_other_hours_as_they_were() {
    let answers = |snapshot: &Arc<Snapshot>| -> Vec<_> {
        let cfg = LocalizerConfig::preset(Preset::Default);
        let localizer = Localizer::new(Arc::clone(snapshot), cfg).expect("a map");
        let mut scratch = localizer.scratch();
        let answer = |number: u64| {
            let live = image(number % 2, number / 2);
            let query = (Query::new(&live).at(time(number / 2))).with_image_size((640, 480));
            let answer = localizer.localize(&mut scratch, &query).expect("fits");
            let ranked: Vec<_> = answer.ranking.iter().map(|it| it.node).collect();
            (answer.decision, ranked)
        };
        (200..240).map(answer).collect()
    };
    let budget = BudgetConfig::default().with_visits_per_place(60);
    for cfg in [
        unguarded(),
        LearnConfig::default(),
        unguarded().with_budget(budget).expect("sound"),
    ] {
        let mut learner = Learner::new(cfg, meta());
        for number in 0..160 {
            observe(&mut learner, number);
        }
        let before = learner.snapshot().expect("in step");
        let num_bytes = |snapshot: &Snapshot| -> usize {
            snapshot.nodes().iter().map(|node| node.num_bytes()).sum()
        };
        let (answers_before, bytes_before) = (answers(&before), num_bytes(&before));
        let mut num_same = 0;
        for i in 0..3_000 {
            // Each has a feature of its own, as noise makes them.
            let mut live = image(0, 81);
            push(&mut live, 5_000_000 + i);
            let learnt = learner.observe(&Observation::new(
                place(0),
                SessionId::derive("charger"),
                time(81).plus_us(i as i64 * 100_000),
                &live,
                (640, 480),
            ));
            num_same += usize::from(learnt.expect("fits").is_same_visit);
        }
        assert!(num_same >= 2_999, "{num_same}");
        let after = learner.snapshot().expect("in step");
        assert!(num_bytes(&after) < bytes_before + 20_000);
        assert_eq!(answers(&after), answers_before);
    }
}

#[test]
fn a_file_within_a_budget_does_not_grow() {
    let folder = folder();
    let path = folder.path().join("a.map");
    let map = Map::create(&path, meta()).expect("new");
    let budget = BudgetConfig::default().with_visits_per_place(20);
    let budget = budget.with_features_per_place(160);
    let cfg = LearnConfig::default().with_budget(budget).expect("sound");
    let mut learner = Learner::new(cfg, meta());
    let mut largest = [0; 2];
    for number in 0..400 {
        let num_forgotten = observe(&mut learner, number);
        let snapshot = learner.snapshot().expect("in step");
        let generation = map.replace(&snapshot).expect("stored");
        if num_forgotten > 0 {
            map.prune(&[generation].into()).expect("sound");
        }
        let half = &mut largest[usize::from(number >= 200)];
        *half = std::fs::metadata(&path).expect("there").len().max(*half);
        assert_eq!(map.snapshot().nodes(), snapshot.nodes());
    }
    assert!(largest[1] <= largest[0] * 5 / 4, "{largest:?} bytes");
    assert!(Map::verify(&path).expect("a map").is_clean());
}

/// The bytes of `map export --canonical`, file by file.
fn exported(snapshot: &Snapshot) -> Vec<(String, Vec<u8>)> {
    let folder = folder();
    let canonical = merge(&[snapshot]).expect("one map");
    let path = folder.path().join("out");
    canonical.export(&path).expect("new");
    let mut folders = vec![path];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("readable") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).expect("readable");
                files.push((path.display().to_string(), bytes));
            }
        }
    }
    let name = |path: &str| path.rsplit_once("/out/").map(|it| it.1.to_owned());
    let mut files: Vec<_> = (files.into_iter())
        .map(|(path, bytes)| (name(&path).expect("below"), bytes))
        .collect();
    files.sort();
    files
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// With the default preset, no guard and no budget.
    #[test]
    fn learning_visit_by_visit_is_learning_in_batch(
        num_visits in 2..24_u64,
        stops in proptest::collection::btree_set(0..24_u64, 0..6),
        keeps_all in any::<bool>(),
    ) {
        let keep = if keeps_all { KeepAppearances::All } else { KeepAppearances::Experiences };
        let cfg = unguarded().with_keep_appearances(keep);
        let mut batch = Learner::new(cfg.clone(), meta());
        (0..num_visits).for_each(|number| { observe(&mut batch, number); });
        let batch = batch.snapshot().expect("in step");

        // Through a file, opened and closed at every stop.
        let folder = folder();
        let path = folder.path().join("a.map");
        drop(Map::create(&path, meta()).expect("new"));
        let mut number = 0;
        for stop in stops.into_iter().chain([num_visits]) {
            let map = Map::open(&path).expect("sound");
            let known = Snapshot::clone(&map.snapshot());
            let mut learner = Learner::resume(cfg.clone(), known).expect("sound");
            while number < stop.min(num_visits) {
                observe(&mut learner, number);
                number += 1;
                map.commit(&learner.snapshot().expect("in step")).expect("extends");
            }
        }
        let stepwise = Map::open(&path).expect("sound").snapshot();
        prop_assert_eq!(stepwise.digest(), batch.digest());
        prop_assert_eq!(exported(&stepwise), exported(&batch));
    }
}

/// One process learns and commits, this one localises. `CHRONOTOPE_TEST_COMMITS` makes it longer.
#[test]
fn one_process_learns_while_another_localises() {
    use std::io::Write;
    use std::sync::atomic::{AtomicU64, Ordering};

    const FILE: &str = "CHRONOTOPE_TEST_LEARNING_PROCESS";
    const NUM_KNOWN: u64 = 12;
    let num_commits: u64 = std::env::var("CHRONOTOPE_TEST_COMMITS")
        .ok()
        .and_then(|number| number.parse().ok())
        .unwrap_or(40);
    if let Some(path) = std::env::var_os(FILE) {
        // Started again below.
        let map = Map::open(path).expect("sound");
        let known = Snapshot::clone(&map.snapshot());
        let mut learner = Learner::resume(LearnConfig::default(), known).expect("sound");
        for number in NUM_KNOWN..NUM_KNOWN + num_commits {
            observe(&mut learner, number);
            let snapshot = learner.snapshot().expect("in step");
            let generation = map.commit(&snapshot).expect("nobody else writes");
            writeln!(std::io::stdout(), "committed {generation}").expect("heard");
        }
        return;
    }
    let folder = folder();
    let path = folder.path().join("a.map");
    let map = Map::create(&path, meta()).expect("new");
    let mut learner = Learner::new(unguarded(), meta());
    (0..NUM_KNOWN).for_each(|number| {
        observe(&mut learner, number);
    });
    map.commit(&learner.snapshot().expect("in step"))
        .expect("extends");
    drop(map);

    // Before the other process starts: how long a localizer takes to make is not the question.
    let reader = Map::open_read_only(&path).expect("sound");
    let cfg = LocalizerConfig::preset(Preset::Default);
    let mut localizer = Localizer::new(reader.snapshot(), cfg).expect("a map");
    let mut scratch = localizer.scratch();
    let (mut writer, lines) = crate::map::start_again(
        "life::one_process_learns_while_another_localises",
        FILE,
        &path,
    );
    let acknowledged = Arc::new(AtomicU64::new(1));
    let heard = Arc::clone(&acknowledged);
    let listener = std::thread::spawn(move || {
        for line in lines {
            if let Some(Ok(number)) = line.strip_prefix("committed ").map(str::parse) {
                heard.store(number, Ordering::SeqCst);
            }
        }
    });
    let first = localizer.snapshot().generation();
    let (mut num_answers, mut num_generations, mut newest) = (0_u64, 1, first);
    while newest <= num_commits {
        let known = acknowledged.load(Ordering::SeqCst);
        let snapshot = reader.refresh().expect("readable at any moment");
        assert!(
            snapshot.generation() >= known.max(newest),
            "older than {known}"
        );
        if snapshot.generation() > newest {
            newest = snapshot.generation();
            num_generations += 1;
            localizer = localizer.with_snapshot(snapshot).expect("sound");
        }
        for number in [2 * num_answers, 2 * num_answers + 1] {
            let live = image(number % 2, 3 + number % 8);
            let query = Query::new(&live)
                .at(time(NUM_KNOWN))
                .with_image_size((640, 480));
            let answer = localizer.localize(&mut scratch, &query).expect("fits");
            let right = localizer.snapshot().find(&place(number % 2));
            assert_eq!(answer.first().map(|first| first.node), right);
        }
        num_answers += 1;
        if let Some(status) = writer.try_wait().expect("ours") {
            assert!(status.success(), "{status}");
        }
    }
    assert!(writer.wait().expect("ours").success());
    listener.join().expect("no panic");
    println!("{num_answers} rounds of answers over {num_generations} generations");
    assert!(num_generations > 1 && newest == num_commits + 1);
    assert!(Map::verify(&path).expect("a map").is_clean());
}

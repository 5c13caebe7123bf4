//! The robot's loop: what it answers, learns, reports and keeps.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, GrayImage, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation, Recipe};
use chronotope::localize::{Decision, Localizer, LocalizerConfig, MotionConfig, Query, Score};
use chronotope::map::{Map, MapMeta, PlaceKey, SessionId, derived_uuid};
use chronotope::robot::{Event, Frame, Robot, RobotConfig};
use chronotope::{ErrorKind, Period, Time};

const NUM_PLACES: usize = 3;
/// Rounds of the first year: enough that what is seen is located.
const NUM_ROUNDS: usize = 40;
/// The rendered street's.
const WIDTH: usize = 448;
const HEIGHT: usize = 384;

fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        World::new(&WorldConfig::new(7).with_num_places(NUM_PLACES)).expect("valid")
    })
}

/// A year of rounds, written once and copied for every test.
fn map_file(folder: &Path) -> PathBuf {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    let path = folder.join("street.map");
    let bytes = BYTES.get_or_init(|| {
        let scratch = tempfile::tempdir().expect("temporary");
        let path = scratch.path().join("street.map");
        let extractor = StarBrief::new(StarBriefConfig::default()).expect("valid");
        let meta = MapMeta::new(derived_uuid("robot"), extractor.id(), "default");
        let map = Map::create(&path, meta.clone()).expect("new");
        let mut learner = Learner::new(LearnConfig::default(), meta);
        for (round, &time) in Schedule::standard(7, NUM_ROUNDS, 1)
            .learn
            .iter()
            .enumerate()
        {
            for place in 0..NUM_PLACES {
                let image = world().render(place, time, round as u64);
                let features = extractor.extract(&image, None).expect("fits");
                learner
                    .observe(&Observation::new(
                        world().places()[place].clone(),
                        SessionId::derive("first year"),
                        time,
                        &features,
                        (WIDTH as u32, HEIGHT as u32),
                    ))
                    .expect("new");
            }
        }
        map.commit(&learner.snapshot().expect("sound"))
            .expect("written");
        drop(map);
        std::fs::read(path).expect("one file")
    });
    std::fs::write(&path, bytes).expect("writable");
    path
}

/// Where the robot drives in the year after: place, time and image.
fn drive(num_images: usize) -> impl Iterator<Item = (usize, Time, GrayImage)> {
    let start = Time::parse("2024-02-01T12:00:00Z").expect("valid");
    (0..num_images).map(move |i| {
        let (place, time) = (
            i % NUM_PLACES,
            start.plus_us(i as i64 * Period::HOUR.as_us()),
        );
        (place, time, world().render(place, time, 1_000 + i as u64))
    })
}

/// The robot's own thread learns what it locates, or another one.
fn learning(cfg: RobotConfig, inline: bool) -> RobotConfig {
    if inline {
        cfg.with_learning_inline(LearnConfig::default())
    } else {
        cfg.with_learning(LearnConfig::default())
    }
}

fn num_visits(path: &Path) -> usize {
    let map = Map::open_read_only(path).expect("a map");
    map.snapshot().summary().num_visits
}

#[test]
fn it_answers_what_a_localizer_answers_and_leaves_the_map_alone() {
    let folder = tempfile::tempdir().expect("temporary");
    let path = map_file(folder.path());
    let before = std::fs::read(&path).expect("there");
    let mut robot = Robot::open(&path, RobotConfig::default()).expect("opens");
    let snapshot = Map::open_read_only(&path).expect("a map").snapshot();
    let localizer = Localizer::new(snapshot, LocalizerConfig::default()).expect("fits");
    let mut scratch = localizer.scratch();
    let extractor = StarBrief::new(StarBriefConfig::default()).expect("valid");
    let mut num_right = 0;
    for (place, time, image) in drive(9) {
        let features = extractor.extract(&image, None).expect("fits");
        let query = Query::new(&features)
            .at(time)
            .with_image_size((WIDTH as u32, HEIGHT as u32));
        let expected = localizer.localize(&mut scratch, &query).expect("fits");
        assert_eq!(robot.see(&image, time).expect("fits"), &expected);
        assert_eq!(robot.features(), &features);
        num_right += usize::from(robot.place() == Some(&world().places()[place]));
    }
    assert!(num_right >= 7, "{num_right} of 9");
    let totals = robot.finish().expect("nothing to write");
    assert_eq!((totals.num_images, totals.num_learnt), (9, 0));
    assert_eq!(std::fs::read(&path).expect("there"), before);
}

#[test]
fn what_is_located_is_learnt_and_the_next_answer_is_of_the_newer_map() {
    for inline in [true, false] {
        let folder = tempfile::tempdir().expect("temporary");
        let path = map_file(folder.path());
        let start = num_visits(&path);
        let cfg = RobotConfig::default().with_commit_interval(Duration::ZERO);
        let mut robot = Robot::open(&path, learning(cfg, inline)).expect("opens");
        let first_generation = robot.localizer().snapshot().generation();
        let mut num_committed = 0;
        for (_, time, image) in drive(6) {
            let frame = Frame::new(&image)
                .at(time)
                .with_now(time)
                .with_source("drive");
            robot.see_frame(&frame).expect("fits");
            // A thread that is given time learns every image.
            robot.commit().expect("written");
            for event in robot.events() {
                match event {
                    Event::Learnt { source, .. } => assert_eq!(source, "drive"),
                    Event::Committed { generation, .. } => {
                        assert!(generation > first_generation);
                        num_committed += 1;
                    }
                    other => panic!("{other:?}"),
                }
            }
        }
        assert!(num_committed >= 6, "{num_committed}");
        let (_, time, image) = drive(7).last().expect("seven");
        robot.see(&image, time).expect("fits");
        assert!(robot.localizer().snapshot().generation() > first_generation);
        let totals = robot.finish().expect("written");
        assert!(totals.num_located >= 5, "{totals:?}");
        assert_eq!(
            totals.num_located,
            totals.num_learnt + totals.num_quarantined + totals.num_missed,
            "{totals:?}"
        );
        assert_eq!(num_visits(&path), start + totals.num_learnt, "{totals:?}");
    }
}

/// With an hour between commits only the end of the robot commits.
#[test]
fn what_was_learnt_last_is_kept_however_the_robot_ends() {
    for (inline, finished) in [(true, true), (true, false), (false, true), (false, false)] {
        let case = format!("inline: {inline}, finished: {finished}");
        let folder = tempfile::tempdir().expect("temporary");
        let path = map_file(folder.path());
        let start = num_visits(&path);
        let cfg = RobotConfig::default().with_commit_interval(Duration::from_secs(3_600));
        let mut robot = Robot::open(&path, learning(cfg, inline)).expect("opens");
        let generation = robot.localizer().snapshot().generation();
        for (_, time, image) in drive(6) {
            let frame = Frame::new(&image).at(time).with_now(time);
            robot.see_frame(&frame).expect("fits");
        }
        let committed = (robot.events()).any(|event| matches!(event, Event::Committed { .. }));
        assert!(!committed, "{case}: an hour has not passed");
        assert_eq!(num_visits(&path), start, "{case}");
        if finished {
            let totals = robot.finish().expect("written");
            assert!(totals.num_learnt > 0, "{case}: {totals:?}");
            assert_eq!(num_visits(&path), start + totals.num_learnt, "{case}");
        } else {
            drop(robot);
            assert!(num_visits(&path) > start, "{case}");
        }
        let map = Map::open_read_only(&path).expect("a map");
        assert_eq!(map.snapshot().generation(), generation + 1, "{case}");
    }
}

#[test]
fn the_same_recorded_images_give_the_same_map_and_none_is_learnt_twice() {
    let digest = |times: usize| {
        let folder = tempfile::tempdir().expect("temporary");
        let path = map_file(folder.path());
        for _ in 0..times {
            let cfg = RobotConfig::default()
                .with_recorded_images()
                .with_learning_inline(LearnConfig::default());
            let mut robot = Robot::open(&path, cfg).expect("opens");
            for (_, time, image) in drive(5) {
                robot.see(&image, time).expect("fits");
            }
            // Not finished: what was learnt is kept all the same.
        }
        (num_visits(&path), folder)
    };
    let (once, _kept) = digest(1);
    let (twice, _kept) = digest(2);
    assert_eq!(once, twice);
    assert!(once > NUM_ROUNDS * NUM_PLACES);
}

#[test]
fn a_covered_camera_is_nowhere_and_teaches_nothing() {
    let folder = tempfile::tempdir().expect("temporary");
    let path = map_file(folder.path());
    let cfg = RobotConfig::default().with_learning_inline(LearnConfig::default());
    let mut robot = Robot::open(&path, cfg).expect("opens");
    let black = GrayImage::new(WIDTH, HEIGHT, vec![3; WIDTH * HEIGHT]).expect("fits");
    let time = Time::parse("2024-02-01T12:00:00Z").expect("valid");
    for _ in 0..5 {
        let answer = robot.see(&black, time).expect("an answer");
        assert_eq!(answer.decision, Decision::Unknown);
        assert_eq!(robot.place(), None);
    }
    let totals = robot.finish().expect("nothing to write");
    assert_eq!((totals.num_images, totals.num_located), (5, 0));
    assert_eq!(num_visits(&path), NUM_ROUNDS * NUM_PLACES);
}

#[test]
fn a_clock_that_jumped_quarantines_and_answers_go_on() {
    let folder = tempfile::tempdir().expect("temporary");
    let path = map_file(folder.path());
    let cfg = RobotConfig::default().with_learning_inline(LearnConfig::default());
    let mut robot = Robot::open(&path, cfg).expect("opens");
    for (_, time, image) in drive(6) {
        let ahead = time.plus_us(3 * Period::YEAR.as_us());
        let frame = Frame::new(&image).at(ahead).with_now(time);
        robot.see_frame(&frame).expect("an answer");
    }
    let totals = robot.finish().expect("written");
    assert!(totals.num_located > 0, "{totals:?}");
    assert_eq!(totals.num_quarantined, totals.num_located, "{totals:?}");
    assert_eq!(num_visits(&path), NUM_ROUNDS * NUM_PLACES);
}

#[test]
fn what_cannot_be_learnt_is_reported_and_counted() {
    let folder = tempfile::tempdir().expect("temporary");
    let path = map_file(folder.path());
    // A method that needs no time, so that an image without one has an answer.
    let localize = LocalizerConfig::default().with_method(chronotope::localize::Method::Static);
    let cfg = RobotConfig::default()
        .with_localize(localize)
        .with_learning_inline(LearnConfig::default());
    let mut robot = Robot::open(&path, cfg).expect("opens");
    for (_, _, image) in drive(6) {
        robot.see_frame(&Frame::new(&image)).expect("an answer");
    }
    let num_located = robot.totals().num_located;
    assert!(num_located > 0);
    let errors: Vec<_> = (robot.events())
        .filter_map(|event| match event {
            Event::NotLearnt { error, .. } => Some(error.kind()),
            _ => None,
        })
        .collect();
    assert_eq!(errors, vec![ErrorKind::Time; num_located]);
    assert_eq!(robot.totals().num_not_learnt, num_located);
}

#[test]
fn what_makes_no_sense_is_refused_at_the_start() {
    let folder = tempfile::tempdir().expect("temporary");
    let path = map_file(folder.path());
    let refused = |cfg: RobotConfig| Robot::open(&path, cfg).expect_err("refused").kind();
    let reference = LearnConfig::preset(chronotope::localize::Preset::Lttl);
    assert_eq!(reference.recipe(), Recipe::Reference);
    let cfg = RobotConfig::default();
    assert_eq!(
        refused(cfg.clone().with_learning(reference)),
        ErrorKind::Config
    );
    let count = LocalizerConfig::default().with_score(Score::Count);
    let tracking = cfg.clone().with_tracking(MotionConfig::default());
    assert_eq!(refused(tracking.with_localize(count)), ErrorKind::Config);
    let error = Robot::open(folder.path().join("none.map"), cfg).expect_err("not there");
    assert_eq!(error.kind(), ErrorKind::NotFound, "{error}");
}

#[test]
fn masks_of_robot_and_image_both_count() {
    let folder = tempfile::tempdir().expect("temporary");
    let path = map_file(folder.path());
    let half = |left: bool| {
        let data = (0..WIDTH * HEIGHT)
            .map(|at| u8::from((at % WIDTH < WIDTH / 2) == left) * 255)
            .collect();
        GrayImage::new(WIDTH, HEIGHT, data).expect("fits")
    };
    let (left, right) = (half(true), half(false));
    let cfg = RobotConfig::default().with_mask(left);
    let mut robot = Robot::open(&path, cfg).expect("opens");
    let (_, time, image) = drive(1).next().expect("one");
    robot.see(&image, time).expect("fits");
    let points = robot.features().keypoints();
    assert!(!points.is_empty() && points.iter().all(|it| it.x < (WIDTH / 2) as f32));
    let frame = Frame::new(&image).at(time).with_mask(&right);
    robot.see_frame(&frame).expect("fits");
    assert!(robot.features().is_empty());
    let small = GrayImage::new(2, 2, vec![255; 4]).expect("fits");
    let error = robot
        .see_frame(&Frame::new(&image).at(time).with_mask(&small))
        .expect_err("another size");
    assert_eq!(error.kind(), ErrorKind::Shape);
}

#[test]
fn a_place_that_somebody_names_is_learnt_and_can_be_new() {
    for inline in [true, false] {
        let folder = tempfile::tempdir().expect("temporary");
        let path = map_file(folder.path());
        let cfg = RobotConfig::default()
            .with_commit_interval(Duration::ZERO)
            .with_tracking(MotionConfig::default());
        let mut robot = Robot::open(&path, learning(cfg, inline)).expect("opens");
        // A street that the map does not know.
        let other = World::new(&WorldConfig::new(99).with_num_places(1)).expect("valid");
        let kitchen = PlaceKey::new("kitchen").expect("a name");
        let start = Time::parse("2024-02-01T12:00:00Z").expect("valid");
        for round in 0..6_i64 {
            let time = start.plus_us(round * Period::HOUR.as_us());
            let image = other.render(0, time, round as u64);
            let frame = Frame::new(&image)
                .at(time)
                .with_now(time)
                .with_place(&kitchen);
            robot.see_frame(&frame).expect("fits");
            robot.commit().expect("written");
        }
        let totals = robot.totals();
        assert_eq!(totals.num_learnt, 6, "{totals:?}");
        assert_eq!(num_visits(&path), NUM_ROUNDS * NUM_PLACES + 6);
        let time = start.plus_us(7 * Period::HOUR.as_us());
        robot
            .see(&other.render(0, time, 77), time)
            .expect("an answer");
        assert!(robot.localizer().snapshot().find(&kitchen).is_some());
        let first = robot.answer().first().expect("a ranking").node;
        assert_eq!(*robot.localizer().snapshot().node(first).key(), kitchen);
    }
}

#[test]
fn a_pause_in_learning_changes_no_map_and_ends() {
    let folder = tempfile::tempdir().expect("temporary");
    let path = map_file(folder.path());
    let cfg = RobotConfig::default().with_learning_inline(LearnConfig::default());
    let mut robot = Robot::open(&path, cfg).expect("opens");
    assert!(robot.is_learning());
    robot.pause_learning(true);
    let see = |robot: &mut Robot, from: usize, to: usize| {
        for (_, time, image) in drive(to).skip(from) {
            let frame = Frame::new(&image).at(time).with_now(time);
            robot.see_frame(&frame).expect("fits");
        }
        robot.commit().expect("written");
    };
    see(&mut robot, 0, 4);
    assert!(!robot.is_learning() && robot.totals().num_learnt == 0);
    assert_eq!(num_visits(&path), NUM_ROUNDS * NUM_PLACES);
    robot.pause_learning(false);
    see(&mut robot, 4, 8);
    assert!(robot.totals().num_learnt > 0);
    assert!(num_visits(&path) > NUM_ROUNDS * NUM_PLACES);
}

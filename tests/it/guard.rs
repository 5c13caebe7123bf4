//! A visit that is not what it seems does not change the map, until somebody says that it should.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, ExtractorConfig, Features, GrayImage};
use chronotope::learn::{
    Circumstances, ClockPolicy, GuardConfig, Judge, LearnConfig, Learner, Learnt, Observation,
    accept_held, forget_session,
};
use chronotope::localize::{Decision, Localizer, LocalizerConfig, Preset, Query};
use chronotope::map::{
    ClockFault, Map, MapMeta, Quarantine, QuarantineReason, SessionId, Snapshot, VisitId,
    derived_uuid,
};
use chronotope::{ErrorKind, Time};

const NUM_PLACES: usize = 4;

fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        World::new(&WorldConfig::new(1100).with_num_places(NUM_PLACES)).expect("a valid world")
    })
}

fn extractor() -> Box<dyn Extractor> {
    ExtractorConfig::default().build().expect("the default")
}

/// One image, and what is said of it.
struct Seen {
    place: usize,
    time: Time,
    image: GrayImage,
    features: Features,
}

fn seen(place: usize, time: Time, image: GrayImage) -> Seen {
    let features = extractor().extract(&image, None).expect("an image");
    Seen {
        place,
        time,
        image,
        features,
    }
}

fn visits(times: &[Time], number: u64) -> Vec<Seen> {
    let places = |&time| (0..NUM_PLACES).map(move |place| (place, time));
    (times.iter().flat_map(places))
        .map(|(place, time)| seen(place, time, world().render(place, time, number)))
        .collect()
}

fn observe(learner: &mut Learner, session: &str, it: &Seen) -> chronotope::Result<Learnt> {
    observe_as(learner, session, it, false)
}

fn observe_as(
    learner: &mut Learner,
    session: &str,
    it: &Seen,
    is_labelled: bool,
) -> chronotope::Result<Learnt> {
    let observation = Observation::new(
        world().places()[it.place].clone(),
        SessionId::derive(session),
        it.time,
        &it.features,
        it.image.size(),
    )
    .with_source(format!("{session} {} {}", it.place, it.time));
    let circumstances = Circumstances {
        gray_range: it.image.gray_range(None),
        is_labelled,
        ..Circumstances::default()
    };
    learner.observe_under(&observation, &circumstances)
}

fn schedule() -> Schedule {
    Schedule::standard(1100, 30, 10)
}

/// A year of honest visits.
fn clean() -> &'static Snapshot {
    static CLEAN: OnceLock<Snapshot> = OnceLock::new();
    CLEAN.get_or_init(|| {
        let extractor_id = extractor().id();
        let meta = MapMeta::new(derived_uuid("guard"), extractor_id, "default");
        let mut learner = Learner::new(LearnConfig::default(), meta);
        for it in &visits(&schedule().learn, 0) {
            observe(&mut learner, "honest", it).expect("fits");
        }
        Snapshot::clone(&learner.snapshot().expect("in step"))
    })
}

/// A session that says "place 0" whatever it sees: images of the next place, then of a covered
/// camera.
fn poison() -> Vec<Seen> {
    let mut images = Vec::new();
    for (number, &time) in (5..).zip(&schedule().learn) {
        let time = time.plus_us(366 * 86_400_000_000);
        images.push(seen(0, time, world().render(1, time, number)));
        // Black, with a little noise, as a sensor has it.
        let noise = (0..448 * 384_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 30) as u8);
        let black = GrayImage::new(448, 384, noise.collect()).expect("as many pixels");
        images.push(seen(0, time.plus_us(1_000_000), black));
    }
    images
}

/// What is said of each query, and how many answers are right.
fn answers(snapshot: &Snapshot) -> (Vec<Decision>, usize) {
    let localizer = Localizer::new(
        Arc::new(snapshot.clone()),
        LocalizerConfig::preset(Preset::Default),
    )
    .expect("a map");
    let mut scratch = localizer.scratch();
    let mut num_right = 0;
    let decisions = (visits(&schedule().query, 3).iter())
        .map(|it| {
            let query = Query::new(&it.features).at(it.time);
            let answer = localizer.localize(&mut scratch, &query).expect("fits");
            let right = snapshot.find(&world().places()[it.place]).expect("a place");
            num_right += usize::from(answer.decision == Decision::At(right));
            answer.decision
        })
        .collect();
    (decisions, num_right)
}

#[test]
fn a_poisoned_session_changes_nothing_with_the_guard_and_harms_without_it() {
    let (before, num_right) = answers(clean());
    let poison = poison();
    let mut learner = Learner::resume(LearnConfig::default(), clean().clone()).expect("sound");
    for it in &poison {
        let learnt = observe(&mut learner, "poison", it).expect("fits");
        match learnt.doubt {
            Some(QuarantineReason::Blind { gray_range, .. }) => {
                assert_eq!(gray_range, Some((0, 3)));
            }
            Some(QuarantineReason::Disagreement {
                agreement,
                threshold,
                expected,
                num_predicted,
                ..
            }) => {
                assert!(agreement < threshold && threshold < expected);
                assert!(num_predicted > 10);
            }
            other => panic!("{} at {}: {other:?}", it.place, it.time),
        }
    }
    let guarded = learner.snapshot().expect("in step");
    assert_eq!(guarded.nodes(), clean().nodes());
    assert_eq!(
        Quarantine::of(&guarded).expect("readable").visits().len(),
        poison.len()
    );
    assert_eq!(answers(&guarded).0, before);

    let blindly = GuardConfig::default().with_judge(Judge::Never);
    let cfg = LearnConfig::default().with_guard(blindly);
    let mut learner = Learner::resume(cfg, clean().clone()).expect("sound");
    for it in &poison {
        let learnt = observe(&mut learner, "poison", it).expect("fits");
        assert_eq!(learnt.doubt, None);
    }
    let poisoned = learner.snapshot().expect("in step");
    let (after, num_right_after) = answers(&poisoned);
    println!(
        "{num_right} of {} right, {num_right_after} after",
        after.len()
    );
    assert!(num_right_after < num_right && after != before);

    // What was learnt by mistake can be taken back, too.
    let (forgotten, num_forgotten) =
        forget_session(&poisoned, SessionId::derive("poison")).expect("it is there");
    assert_eq!(num_forgotten, poison.len());
    assert!(forgotten.check().is_ok());
    assert_eq!(forgotten.nodes(), clean().nodes());
    assert_eq!(answers(&forgotten).1, num_right);
    assert!(forget_session(&forgotten, SessionId::derive("poison")).is_err());
}

/// A first night is unlike all days, and like no other place.
#[test]
fn what_somebody_labelled_is_learnt_unless_it_looks_like_another_place() {
    let mut learner = Learner::resume(LearnConfig::default(), clean().clone()).expect("sound");
    let noon = schedule().query[0];
    let night: Vec<Seen> = (0..4)
        .map(|number| {
            let time = noon.plus_us(number * 3_600_000_000);
            // The picture of nowhere that the map knows.
            let other =
                World::new(&WorldConfig::new(77).with_num_places(1)).expect("a valid world");
            seen(0, time, other.render(0, noon, number as u64))
        })
        .collect();
    let strict = observe(&mut learner, "strict", &night[0]).expect("fits");
    assert!(strict.doubt.is_some());
    for it in &night {
        let learnt = observe_as(&mut learner, "night", it, true).expect("fits");
        assert_eq!(learnt.doubt, None, "at {}", it.time);
    }

    let before = answers(clean()).0;
    let mut learner = Learner::resume(LearnConfig::default(), clean().clone()).expect("sound");
    let poison = poison();
    let mut num_held = 0;
    for it in &poison {
        let learnt = observe_as(&mut learner, "poison", it, true).expect("fits");
        num_held += usize::from(learnt.doubt.is_some());
    }
    println!("{num_held} of {} held", poison.len());
    assert!(
        num_held * 10 >= poison.len() * 9,
        "{num_held} of {}",
        poison.len()
    );
    assert_eq!(answers(&learner.snapshot().expect("in step")).0, before);
}

#[test]
fn honest_visits_are_rarely_held_and_can_be_accepted_or_rejected() {
    let mut learner = Learner::resume(LearnConfig::default(), clean().clone()).expect("sound");
    let later = visits(&schedule().query, 8);
    let mut held = BTreeMap::new();
    for it in &later {
        let learnt = observe(&mut learner, "later", it).expect("fits");
        if let Some(doubt) = learnt.doubt {
            println!("place {} at {}: {doubt}", it.place, it.time);
            held.insert((it.place, it.time), doubt);
        }
    }
    assert!(held.len() * 10 <= later.len(), "{} held", held.len());

    // One image that shows another place: accepted by mistake, or rejected.
    let before = learner.snapshot().expect("in step");
    let wrong = &poison()[0];
    let learnt = observe(&mut learner, "wrong", wrong).expect("fits");
    assert!(learnt.doubt.is_some());
    let id = learner.held().visits().last().expect("held").id;
    // It is held once, however often it comes.
    assert_eq!(
        observe(&mut learner, "wrong", wrong).expect("fits").doubt,
        learnt.doubt
    );
    assert_eq!(learner.held().visits().len(), held.len() + 1);
    let [first, second] = [(); 2].map(|()| learner.snapshot().expect("in step"));
    let value = |of: &Snapshot| Arc::clone(&of.attachments()[&format!("held-{id}")]);
    assert!(Arc::ptr_eq(&value(&first), &value(&second)), "written once");
    assert_eq!(Quarantine::of(&second).expect("ours"), *learner.held());
    let mut other = Learner::resume(
        LearnConfig::default(),
        Snapshot::clone(&learner.snapshot().expect("in step")),
    )
    .expect("sound");
    other.reject(id).expect("held");
    assert_eq!(other.snapshot().expect("in step"), before);
    learner.accept(id).expect("held");
    let error = learner.accept(id).expect_err("learnt by now");
    assert_eq!(error.kind(), ErrorKind::NotFound);
    let after = learner.snapshot().expect("in step");
    assert_eq!(after.summary().num_visits, before.summary().num_visits + 1);
    assert!(after.nodes()[0].visits().iter().any(|visit| visit.id == id));
}

/// The file of a map is told what becomes of its doubtful visits, each by a few digits.
#[test]
fn doubtful_visits_of_a_file_are_learnt_or_dropped_and_others_are_refused() {
    let mut learner = Learner::resume(LearnConfig::default(), clean().clone()).expect("sound");
    for wrong in poison().iter().take(3) {
        let learnt = observe(&mut learner, "wrong", wrong).expect("fits");
        assert!(learnt.doubt.is_some());
    }
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("doubtful.map");
    let map = Map::create_from(&path, &learner.snapshot().expect("in step")).expect("written");
    let held = Quarantine::of(&map.snapshot()).expect("ours");
    let [accepted, dropped, left] = held.ids(true)[..] else {
        panic!("{} are held", held.visits().len());
    };
    let digits = |id: VisitId| id.to_string()[..12].to_owned();
    let names = [digits(dropped), dropped.to_string(), digits(left)];
    let chosen = held.choose(&names, true).expect("known");
    assert_eq!(chosen, [dropped, left], "each once");
    assert!(held.choose(&["no digits".into()], true).is_err());

    let before = map.snapshot();
    let generation = map.drop_held(&[dropped]).expect("held");
    assert_eq!(generation, before.generation() + 1);
    let other = Map::open(&path).expect("ours");
    let held = Quarantine::of(&other.snapshot()).expect("ours");
    assert_eq!(held.ids(true), [accepted, left]);
    let num_visits = |map: &Map| map.snapshot().summary().num_visits;
    assert_eq!(num_visits(&other), before.summary().num_visits);

    let cfg = LearnConfig::default();
    let generation = accept_held(&other, &cfg, &[accepted]).expect("held");
    assert_eq!(num_visits(&other), before.summary().num_visits + 1);
    // What is not held any more changes nothing, nor does what is named beside it.
    for error in [
        other.drop_held(&[left, dropped]).expect_err("dropped"),
        other.drop_held(&[left, left]).expect_err("named twice"),
        accept_held(&other, &cfg, &[left, accepted]).expect_err("learnt"),
    ] {
        assert_eq!(error.kind(), ErrorKind::NotFound, "{error}");
    }
    let other = Map::open(&path).expect("ours");
    assert_eq!(other.snapshot().generation(), generation);
    assert_eq!(
        Quarantine::of(&other.snapshot()).expect("ours").ids(true),
        [left]
    );
}

/// More visits are held than are kept whole: the others are known all the same.
#[test]
fn what_was_held_is_not_learnt_by_repeating_the_update() {
    let nothing = Features::new();
    let start = Time::parse("2024-03-01T00:00:00Z").expect("valid");
    let update = |learner: &mut Learner| {
        let (mut num_new, mut num_given_up) = (0, 0);
        for hour in 0..700 {
            let observation = Observation::new(
                world().places()[0].clone(),
                SessionId::derive("covered"),
                start.plus_us(hour * 3_600_000_000),
                &nothing,
                (448, 384),
            )
            .with_source(format!("{hour}.png"));
            let learnt = learner.observe(&observation).expect("fits");
            assert!(learnt.doubt.is_some());
            num_new += usize::from(!learnt.is_same_visit);
            num_given_up += learnt.num_given_up;
        }
        (num_new, num_given_up)
    };
    let mut learner = Learner::resume(LearnConfig::default(), clean().clone()).expect("sound");
    let (num_new, num_given_up) = update(&mut learner);
    assert_eq!(num_new, 700);
    assert!(num_given_up > 0 && num_given_up == learner.held().given_up().len());
    let first = Snapshot::clone(&learner.snapshot().expect("in step"));
    assert_eq!(update(&mut learner), (0, 0));
    let mut other = Learner::resume(LearnConfig::default(), first.clone()).expect("sound");
    assert_eq!(update(&mut other), (0, 0));
    assert_eq!(other.snapshot().expect("in step").digest(), first.digest());
    assert_eq!(first.summary().num_visits, clean().summary().num_visits);
    // Somebody says that one of them may be looked at again.
    let id = other.held().given_up()[0].id;
    assert!(other.accept(id).is_err(), "its features are gone");
    other.reject(id).expect("known");
    assert_eq!(update(&mut other).0, 1);
}

/// An update that is killed and repeated holds and learns what one does that nothing disturbed.
#[test]
fn what_is_believed_does_not_depend_on_when_a_process_was_started() {
    // Few visits before, so that thresholds move and models are fitted anew under way.
    let schedule = schedule();
    let early: Vec<Time> = schedule.learn.iter().copied().step_by(4).collect();
    let meta = MapMeta::new(derived_uuid("guard"), extractor().id(), "default");
    let mut learner = Learner::new(LearnConfig::default(), meta);
    for it in &visits(&early, 0) {
        observe(&mut learner, "honest", it).expect("fits");
    }
    let start = Snapshot::clone(&learner.snapshot().expect("in step"));
    let mut later = visits(&schedule.learn, 6);
    later.extend(poison());
    later.sort_by_key(|it| (it.time, it.place));
    let learn = |steps: usize| {
        let resume = |snapshot| Learner::resume(LearnConfig::default(), snapshot).expect("sound");
        let mut learner = resume(start.clone());
        let mut num_held = 0;
        for (number, it) in later.iter().enumerate() {
            if number % steps == steps - 1 {
                learner = resume(Snapshot::clone(&learner.snapshot().expect("in step")));
            }
            match observe_as(&mut learner, "later", it, number % 3 == 0) {
                Ok(learnt) => num_held += usize::from(learnt.doubt.is_some()),
                Err(error) => assert_eq!(error.kind(), ErrorKind::AlreadyExists),
            }
        }
        let learnt = Snapshot::clone(&learner.snapshot().expect("in step"));
        (learnt, num_held)
    };
    let (at_once, num_held) = learn(later.len() + 1);
    assert!(num_held > 10, "{num_held} held");
    // In steps of 1, too, which takes a minute.
    for steps in [9, 31] {
        let (resumed, _) = learn(steps);
        assert_eq!(resumed.digest(), at_once.digest(), "in steps of {steps}");
    }
}

/// Also of what a mask hid.
#[test]
fn a_visit_that_is_accepted_is_learnt_as_it_would_have_been() {
    let wrong = &poison()[0];
    let (width, height) = (wrong.image.width(), wrong.image.height());
    let pixels = (0..width * height).map(|i| u8::from(i % width > width / 3));
    let mask = GrayImage::new(width, height, pixels.collect()).expect("as many pixels");
    let observe = |judge| {
        let guard = GuardConfig::default().with_judge(judge);
        let cfg = LearnConfig::default().with_guard(guard);
        let mut learner = Learner::resume(cfg, clean().clone()).expect("sound");
        let observation = Observation::new(
            world().places()[0].clone(),
            SessionId::derive("masked"),
            wrong.time,
            &wrong.features,
            (width as u32, height as u32),
        )
        .with_mask(&mask)
        .with_source("masked.png");
        let learnt = learner.observe(&observation).expect("fits");
        (
            Snapshot::clone(&learner.snapshot().expect("in step")),
            learnt,
        )
    };
    let (waiting, learnt) = observe(Judge::Always);
    assert!(learnt.doubt.is_some());
    let mut learner = Learner::resume(LearnConfig::default(), waiting).expect("sound");
    let id = learner.held().visits()[0].id;
    learner.accept(id).expect("held");
    let (at_once, learnt) = observe(Judge::Never);
    assert_eq!(learnt.doubt, None);
    assert_eq!(
        learner.snapshot().expect("in step").nodes(),
        at_once.nodes()
    );
    let log = at_once.nodes()[0].log();
    let hidden = log.hidden_row(log.num_visits() - 1);
    assert!(hidden.is_some_and(|hidden| hidden.count_ones() > 0));
}

#[test]
fn a_time_that_cannot_be_right_is_held_refused_or_ignored_as_wished() {
    let first = &visits(&schedule().query[..1], 9)[0];
    let unset = Seen {
        place: first.place,
        time: Time::from_s(20),
        image: first.image.clone(),
        features: first.features.clone(),
    };
    let learner = |policy| {
        let guard = GuardConfig::default().with_clock(policy);
        let cfg = LearnConfig::default().with_guard(guard);
        Learner::resume(cfg, clean().clone()).expect("sound")
    };
    let held = observe(&mut learner(ClockPolicy::Hold), "unset", &unset).expect("held");
    let is_unset = |reason: &QuarantineReason| match reason {
        QuarantineReason::Clock { fault, .. } => *fault == ClockFault::Unset,
        _ => false,
    };
    assert!(held.doubt.as_ref().is_some_and(is_unset));
    let error = observe(&mut learner(ClockPolicy::Refuse), "unset", &unset).expect_err("refused");
    assert_eq!(error.kind(), ErrorKind::Time);
    assert!(error.to_string().contains("never set"), "{error}");
    let ignored = observe(&mut learner(ClockPolicy::Ignore), "unset", &unset).expect("fits");
    assert!(!ignored.doubt.as_ref().is_some_and(is_unset));
}

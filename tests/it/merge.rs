//! Merging maps is a union: the order and the grouping do not matter, nor does repeating it.

use std::sync::Arc;

use chronotope::feature::{Descriptor, Features, Keypoint};
use chronotope::learn::{KeepAppearances, LearnConfig, Learner, merge, relearn};
use chronotope::localize::Preset;
use chronotope::map::{
    AppearanceUse, Edge, MapMeta, Node, PlaceKey, Quarantine, QuarantineReason, QuarantinedVisit,
    Reobservation, SessionId, Snapshot, Visit, VisitId, derived_uuid,
};
use chronotope::visibility::{BitRow, FeatureState as Statement};
use chronotope::{ErrorKind, Time};
use proptest::prelude::*;

/// Of few different numbers, so that maps share some features.
fn feature(number: u8) -> (Keypoint, Descriptor) {
    let keypoint = Keypoint {
        x: f32::from(number % 5) - 2.0,
        y: f32::from(number),
        size: 7.0,
        response: f32::from(number % 3) - 1.0,
    };
    let word = u64::from(number).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (keypoint, Descriptor([word, !word, word << 3, 1]))
}

fn features(numbers: &[u8]) -> Features {
    let mut features = Features::new();
    for &number in numbers {
        let (keypoint, descriptor) = feature(number);
        features.push(keypoint, descriptor);
    }
    features
}

fn place(number: u8) -> PlaceKey {
    PlaceKey::new(&format!("place {number}")).expect("valid")
}

/// A visit to a place: which of few, what was born, what it says of features and experiences.
#[derive(Clone, Debug)]
struct Visited {
    place: u8,
    number: u8,
    born: Vec<u8>,
    bits: u64,
    hidden: u64,
    is_experience: bool,
    appearance: Option<Vec<u8>>,
}

fn visited() -> impl Strategy<Value = Visited> {
    let numbers = || proptest::collection::vec(0..24_u8, 0..4);
    (
        0..2_u8,
        0..8_u8,
        numbers(),
        any::<u64>(),
        any::<u64>(),
        any::<bool>(),
    )
        .prop_flat_map(move |(place, number, born, bits, hidden, is_experience)| {
            proptest::option::of(numbers()).prop_map(move |appearance| Visited {
                place,
                number,
                born: born.clone(),
                bits,
                hidden,
                is_experience,
                appearance,
            })
        })
}

/// A map with these visits, in this order of arrival; their times are in another.
fn build(uuid: u128, visits: &[Visited], edges: &[(u8, u8)], has_pose: bool) -> Snapshot {
    let meta = MapMeta {
        image_size: (uuid % 2 == 1).then_some((640, 480)),
        zone: (uuid % 3 == 1).then(|| "Europe/Prague".into()),
        ..MapMeta::new(uuid, "star+brief", "default")
    };
    let mut snapshot = Snapshot::empty(meta);
    for it in visits {
        let key = place(it.place);
        let id = VisitId(u128::from(it.place) * 1000 + u128::from(it.number));
        let at = snapshot.find_or_add(&key);
        let node = snapshot.node(at);
        if node.visits().iter().any(|visit| visit.id == id) {
            continue;
        }
        let len = node.features().len() + it.born.len();
        let (mut seen, mut hidden) = (BitRow::zeros(len), BitRow::zeros(len));
        for i in 0..len {
            if it.bits >> (i % 64) & 1 == 1 {
                seen.set(i);
            } else if it.hidden >> (i % 64) & 1 == 1 {
                hidden.set(i);
            }
        }
        let appearance_use = if it.is_experience {
            AppearanceUse::Experience
        } else {
            AppearanceUse::Recognised
        };
        let visit = Visit {
            id,
            session: SessionId(u128::from(it.number / 3)),
            time: Time::from_s(i64::from(it.number) * 37 % 8 / 2),
            source: format!("{uuid}/{}.png", it.number),
            appearance: it.appearance.as_deref().map(|it| Arc::new(features(it))),
            appearance_use,
        };
        let mut located_by = node.unlocated(appearance_use);
        for i in 0..located_by.len() {
            if it.bits >> (i % 7) & 1 == 1 {
                located_by.set(i);
            }
        }
        let born = features(&it.born);
        (snapshot.push_visit(at, visit, &born, seen, Some(hidden), located_by)).expect("in step");
    }
    for &(from, to) in edges {
        let edge = Edge {
            from: place(from),
            to: place(to),
            name: "way".into(),
        };
        for key in [&edge.from, &edge.to] {
            snapshot.find_or_add(key);
        }
        snapshot.add_edge(edge).expect("both are there");
    }
    if has_pose {
        let first = snapshot.find_or_add(&place(0));
        (snapshot.set_pose(first, Some([1.0, 2.0, 3.0]))).expect("finite");
    }
    (snapshot.attach("calibration", [uuid as u8])).expect("a name");
    assert!(snapshot.check().is_ok());
    snapshot
}

pub(crate) fn map() -> impl Strategy<Value = Snapshot> {
    let visits = proptest::collection::vec(visited(), 0..10);
    let edges = proptest::collection::vec((0..3_u8, 0..3_u8), 0..3);
    (1..9_u128, visits, edges, any::<bool>())
        .prop_map(|(uuid, visits, edges, has_pose)| build(uuid, &visits, &edges, has_pose))
}

/// What a map says of a feature at a visit.
fn statement(map: &Snapshot, key: &PlaceKey, visit: VisitId, feature: u8) -> Option<Statement> {
    let node = map.node(map.find(key)?);
    let at = node.visits().iter().position(|it| it.id == visit)?;
    let (keypoint, descriptor) = self::feature(feature);
    let columns = (0..node.features().len()).filter(|&i| {
        node.features().keypoints()[i] == keypoint && node.features().descriptors()[i] == descriptor
    });
    columns
        .filter_map(|i| node.log().state(at, i))
        .min_by_key(|it| *it as u8)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn merging_is_commutative_associative_and_idempotent(a in map(), b in map(), c in map()) {
        let two = |a: &Snapshot, b: &Snapshot| merge(&[a, b]).expect("no conflicts");
        let ab = two(&a, &b);
        prop_assert_eq!(&ab, &two(&b, &a));
        prop_assert_eq!(two(&ab, &c), two(&a, &two(&b, &c)));
        prop_assert_eq!(&merge(&[&c, &a, &b]).expect("no conflicts"), &two(&ab, &c));
        prop_assert_eq!(&two(&ab, &a), &ab);
        prop_assert_eq!(&two(&ab, &ab), &ab);
        prop_assert_eq!(merge(&[&a, &a]).expect("same"), merge(&[&a]).expect("one"));
        prop_assert!(ab.check().is_ok());
    }

    #[test]
    fn a_merged_map_says_the_stronger_of_what_its_parts_say(a in map(), b in map()) {
        let merged = merge(&[&a, &b]).expect("no conflicts");
        for key in [place(0), place(1)] {
            for number in 0..8 {
                let id = VisitId(u128::from(key == place(1)) * 1000 + number);
                for feature in 0..24 {
                    // Seen is the smallest, then not seen; not observable is no statement.
                    let stated = |map| statement(map, &key, id, feature)
                        .filter(|it| *it != Statement::NotObservable);
                    let both = stated(&a).into_iter().chain(stated(&b)).min_by_key(|it| *it as u8);
                    prop_assert_eq!(stated(&merged), both);
                }
            }
        }
        let num_visits = |map: &Snapshot| map.summary().num_visits;
        prop_assert!(num_visits(&merged) >= num_visits(&a).max(num_visits(&b)));
    }
}

#[test]
fn contradictions_are_named() {
    let node = |pose: Option<[f64; 3]>| {
        let mut node = Node::new(place(0));
        node.set_pose(pose).expect("finite");
        node
    };
    let with = |change: &dyn Fn(&mut MapMeta), z: f64| {
        let mut meta = MapMeta {
            image_size: Some((640, 480)),
            zone: Some("Europe/Prague".into()),
            ..MapMeta::new(derived_uuid("a"), "star+brief", "default")
        };
        change(&mut meta);
        let mut map = Snapshot::empty(meta);
        map.push_node(node(Some([1.0, 2.0, z]))).expect("one");
        map
    };
    let base = with(&|_| {}, 3.0);
    for (other, expected) in [
        (
            with(&|meta| meta.extractor = "orb".into(), 3.0),
            "extractor orb or star+brief",
        ),
        (
            with(&|meta| meta.preset = "lttl".into(), 3.0),
            "preset default or lttl",
        ),
        (
            with(&|meta| meta.image_size = Some((320, 240)), 3.0),
            "image size 320 x 240 px or 640 x 480 px",
        ),
        (
            with(&|meta| meta.zone = Some("UTC".into()), 3.0),
            "zone Europe/Prague or UTC",
        ),
        (
            with(&|_| {}, 4.0),
            "place `place 0` at [1.0, 2.0, 3.0] m or at [1.0, 2.0, 4.0] m",
        ),
    ] {
        let error = merge(&[&base, &other]).expect_err(expected);
        assert_eq!(error.kind(), ErrorKind::Config);
        assert!(error.to_string().contains(expected), "{error}");
        assert!(error.to_string().contains("help: "), "{error}");
    }
    assert!(merge(&[]).is_err());
}

/// What each visit of a learner's map sees: the features of its place, some of them hidden.
fn learn(visits: std::ops::Range<u64>, only: impl Fn(u64) -> bool) -> Snapshot {
    let meta = MapMeta::new(derived_uuid("learnt"), "star+brief", "default");
    let cfg = LearnConfig::preset(Preset::Default).with_keep_appearances(KeepAppearances::All);
    let mut learner = Learner::new(cfg, meta);
    for number in visits.filter(|&number| only(number)) {
        let mut live = Features::new();
        for i in (0..60).filter(|i| (i + number) % 5 != 0) {
            let word = (number % 2 * 1000 + i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let keypoint = Keypoint {
                x: 40.0 + (i * 9) as f32 + number as f32,
                y: 30.0 + (i * 7) as f32,
                size: 9.0,
                response: 100.0 - i as f32,
            };
            live.push(keypoint, Descriptor([word, !word, word << 7, word >> 5]));
        }
        let key = place((number % 2) as u8);
        let observation = crate::map::observation(key, number, &live, (640, 480));
        learner.observe(&observation).expect("fits");
    }
    Snapshot::clone(&learner.snapshot().expect("in step"))
}

#[test]
fn learning_a_union_again_is_learning_it_at_once() {
    let whole = learn(0..12, |_| true);
    let early = learn(0..12, |number| number < 8);
    let odd = learn(0..12, |number| number >= 8 || number % 3 != 1);
    let cfg = LearnConfig::preset(Preset::Default);
    let parts = merge(&[&odd, &early]).expect("no conflicts");
    // What was counted is kept, and counted once however often it is merged.
    let counted = |map: &Snapshot| {
        let counted = Reobservation::of(map).expect("readable");
        counted.num_displacements()
    };
    assert!(counted(&parts) >= counted(&odd).max(counted(&early)) && counted(&early) > 0);
    assert!(merge(&[&early, &parts]).expect("no conflicts") == parts);
    // Two robots' features of one thing are two until they are learnt again.
    assert!(parts.summary().num_features > whole.summary().num_features);
    let mut parts = parts;
    let mut held = Quarantine::default();
    held.push(QuarantinedVisit {
        place: place(0),
        id: VisitId(7),
        session: SessionId::derive("run"),
        time: Time::from_s(5),
        source: "covered.png".into(),
        image_size: (640, 480),
        mask: None,
        is_labelled: false,
        reason: QuarantineReason::Blind {
            num_features: 0,
            gray_range: None,
        },
        features: Arc::default(),
    });
    held.attach(&mut parts).expect("fits");
    let again = relearn(cfg.clone(), &parts).expect("all are kept");
    assert_eq!(Quarantine::of(&again).expect("readable"), held);
    assert!(again.nodes() == whole.nodes());
    assert!(relearn(cfg.clone(), &again).expect("all are kept") == again);
    let grouped = merge(&[&relearn(cfg.clone(), &early).expect("kept"), &again]).expect("same");
    assert!(relearn(cfg.clone(), &grouped).expect("kept").nodes() == whole.nodes());
    let mut forgetful = parts;
    let first = forgetful.find(&place(0)).expect("there");
    let mut place = forgetful.node(first).clone().into_parts();
    place.visits[1].appearance = None;
    let place = Node::from_parts(place).expect("in step");
    forgetful
        .replace_node(first, place)
        .expect("the same place");
    let error = relearn(cfg, &forgetful).expect_err("not kept").to_string();
    assert!(
        error.contains("place 0") && error.contains("--keep-appearances"),
        "{error}"
    );
}

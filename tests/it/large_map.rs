//! Localising in maps of many places: candidates against the exact answer, batches against single
//! answers.

use std::sync::{Arc, OnceLock};

use chronotope::feature::{Descriptor, Features, Keypoint};
use chronotope::localize::{
    Candidate, Decision, Localizer, LocalizerConfig, MotionConfig, PlaceSearch, Preset, Query,
    Score, Tracker,
};
use chronotope::map::{
    AppearanceUse, Edge, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, Visit, VisitId,
};
use chronotope::visibility::BitRow;
use chronotope::{ErrorKind, Time};

const NUM_PLACES: usize = 400;
const NUM_FEATURES: usize = 60;
const NUM_VISITS: usize = 3;

/// Xorshift (Marsaglia 2003).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

/// Places of features that have nothing to do with each other.
fn map() -> Arc<Snapshot> {
    static MAP: OnceLock<Arc<Snapshot>> = OnceLock::new();
    Arc::clone(MAP.get_or_init(|| {
        let mut random = Random(88_172_645_463_325_252);
        let mut snapshot = Snapshot::empty(MapMeta::new(1, "none", "default"));
        for place in 0..NUM_PLACES {
            let key = PlaceKey::new(&format!("p{place:03}")).expect("a key");
            let mut node = Node::new(key);
            let mut born = Features::new();
            for _ in 0..NUM_FEATURES {
                let keypoint = Keypoint {
                    x: (random.next() % 400) as f32,
                    y: (random.next() % 300) as f32,
                    size: 10.0,
                    response: 1.0,
                };
                let descriptor = Descriptor(std::array::from_fn(|_| random.next()));
                born.push(keypoint, descriptor);
            }
            for visit in 0..NUM_VISITS {
                let time = Time::from_s(1_700_000_000 + visit as i64 * 7_000);
                let mut seen = BitRow::zeros(NUM_FEATURES);
                for feature in 0..NUM_FEATURES {
                    if visit == 0 || !random.next().is_multiple_of(3) {
                        seen.set(feature);
                    }
                }
                let visit = Visit {
                    id: VisitId((place * NUM_VISITS + visit) as u128),
                    session: SessionId::derive("test"),
                    time,
                    source: String::new(),
                    appearance: None,
                    appearance_use: AppearanceUse::Recognised,
                };
                let born = std::mem::take(&mut born);
                (node.push_visit(visit, &born, seen, None, BitRow::zeros(0))).expect("fits");
            }
            snapshot.push_node(node).expect("another place");
        }
        Arc::new(snapshot)
    }))
}

/// Half of a place's features seen again, ten of 256 bits different, all moved by one displacement.
fn image_of(place: usize) -> Features {
    let mut random = Random(place as u64 * 2 + 1);
    let map = map();
    let features = map.nodes()[place].features();
    let mut image = Features::new();
    for (keypoint, descriptor) in
        (features.keypoints().iter().zip(features.descriptors())).step_by(2)
    {
        let mut seen = *descriptor;
        for _ in 0..10 {
            let bit = (random.next() >> 20) as usize % 256;
            seen.0[bit / 64] ^= 1 << (bit % 64);
        }
        let moved = Keypoint {
            x: keypoint.x + 7.0,
            ..*keypoint
        };
        image.push(moved, seen);
    }
    image
}

fn localizer(candidates: PlaceSearch) -> Localizer {
    let cfg = LocalizerConfig::default().with_place_search(candidates);
    Localizer::new(map(), cfg).expect("map fits")
}

fn query(features: &Features, s: i64) -> Query<'_> {
    Query::new(features).at(Time::from_s(1_700_020_000 + s))
}

#[test]
fn candidates_hold_the_place_and_what_they_say_of_it_is_exact() {
    let exact = localizer(PlaceSearch::Exact);
    let mut scratch = exact.scratch();
    for kind in [PlaceSearch::Inverted, PlaceSearch::Words] {
        let listed = localizer(kind);
        for place in (0..NUM_PLACES).step_by(19) {
            let image = image_of(place);
            let all = (exact.localize(&mut scratch, &query(&image, 0))).expect("fits");
            let some = (listed.localize(&mut scratch, &query(&image, 0))).expect("fits");
            assert_eq!(all.ranking.len(), NUM_PLACES);
            assert_eq!(some.ranking.len(), 256, "{kind:?}");
            assert!(some.pairs_compared < all.pairs_compared);
            assert_eq!(all.decision, Decision::At(NodeId(place as u32)));
            assert_eq!(some.decision, all.decision, "{kind:?}");
            for candidate in &some.ranking {
                let same = all.ranking.iter().find(|it| it.node == candidate.node);
                let same = same.expect("every place is there");
                assert_eq!(candidate.score, same.score, "{kind:?}");
                assert_eq!(candidate.matches, same.matches, "{kind:?}");
            }
            // What was not matched keeps a share: the sum of the listed is below 1.
            let sum: f64 = some.ranking.iter().map(|it| it.posterior).sum();
            assert!(sum + some.off_map <= 1.0 + 1e-12);
            assert!((some.off_map - all.off_map).abs() < 0.05);
        }
    }
}

#[test]
fn an_index_is_the_same_in_every_run_and_small_maps_need_none() {
    let image = image_of(5);
    for kind in [PlaceSearch::Inverted, PlaceSearch::Words] {
        let [a, b] = [(); 2].map(|()| localizer(kind));
        let [a, b] = [a, b].map(|it| it.localize(&mut it.scratch(), &query(&image, 0)));
        assert_eq!(a.expect("fits"), b.expect("fits"), "{kind:?}");
    }
    let auto = localizer(PlaceSearch::Auto);
    let found = (auto.localize(&mut auto.scratch(), &query(&image, 0))).expect("fits");
    assert_eq!(found.ranking.len(), NUM_PLACES, "too few to leave any out");
}

#[test]
fn places_vote_by_count_where_nothing_is_calibrated() {
    let cfg = LocalizerConfig::preset(Preset::Lttl)
        .with_score(Score::Count)
        .with_place_search(PlaceSearch::Inverted);
    let localizer = Localizer::new(map(), cfg).expect("map fits");
    for place in [0, 77, 399] {
        let image = image_of(place);
        let found = localizer.localize(&mut localizer.scratch(), &query(&image, 0));
        let found = found.expect("fits");
        assert_eq!(found.ranking.len(), 256);
        assert_eq!(found.decision, Decision::At(NodeId(place as u32)));
    }
}

#[test]
fn a_batch_is_its_single_answers_for_any_number_of_threads() {
    let images: Vec<Features> = (0..12).map(|i| image_of(i * 31)).collect();
    // Times of three buckets, in no order.
    let queries: Vec<Query<'_>> = (images.iter().zip(0..))
        .map(|(image, i)| query(image, (i * 7 % 3) * 5_000))
        .collect();
    for kind in [PlaceSearch::Exact, PlaceSearch::Inverted] {
        let localizer = localizer(kind);
        let singles: Vec<_> = (queries.iter())
            .map(|query| {
                localizer
                    .localize(&mut localizer.scratch(), query)
                    .expect("fits")
            })
            .collect();
        for num_threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(num_threads)
                .build();
            let fresh = self::localizer(kind);
            let batch = pool
                .expect("threads")
                .install(|| fresh.localize_batch(&queries));
            assert_eq!(
                batch.expect("fits"),
                singles,
                "{kind:?}, {num_threads} threads"
            );
        }
    }
    let mut queries = queries;
    queries[7].time = None;
    let localizer = localizer(PlaceSearch::Exact);
    assert!(
        localizer.localize_batch(&queries).is_err(),
        "one has no time"
    );
    assert!(localizer.localize_batch(&[]).expect("none").is_empty());
}

#[test]
fn a_prior_saves_work_and_a_robot_that_was_carried_away_is_found_at_once() {
    for search in [PlaceSearch::Exact, PlaceSearch::Inverted] {
        let localizer = localizer(search);
        let mut scratch = localizer.scratch();
        let mut num_widened = 0;
        for place in (3..NUM_PLACES - 9).step_by(31) {
            let image = image_of(place);
            let whole = localizer.localize(&mut scratch, &query(&image, 0));
            let whole = whole.expect("fits");
            // In any order, one twice.
            let mut prior: Vec<NodeId> = (0..9).map(|it| NodeId((place + 5 - it) as u32)).collect();
            prior.push(prior[2]);
            let near = query(&image, 0).with_prior(&prior);
            let near = localizer.localize(&mut scratch, &near).expect("fits");
            assert_eq!(near.decision, Decision::At(NodeId(place as u32)));
            assert!((64..=90).contains(&near.ranking.len()));
            assert!(3 * near.pairs_compared < whole.pairs_compared, "{search:?}");
            let same = |it: &&Candidate| it.node == near.ranking[0].node;
            let same = whole.ranking.iter().find(same).expect("matched");
            assert_eq!(near.ranking[0].score, same.score);
            assert!((near.ranking[0].posterior - same.posterior).abs() < 0.05);

            let elsewhere = [NodeId((place as u32 + 200) % NUM_PLACES as u32)];
            let away = query(&image, 0).with_prior(&elsewhere);
            let away = localizer.localize(&mut scratch, &away).expect("fits");
            assert_eq!(away.decision, whole.decision);
            assert!(away.ranking.iter().any(|it| it.node == elsewhere[0]));
            // The place may be one of those that are matched to compare with.
            if away.ranking.len() > 100 {
                num_widened += 1;
                assert!(away.pairs_compared > whole.pairs_compared, "both searches");
                if search == PlaceSearch::Exact {
                    assert_eq!(away.ranking, whole.ranking);
                }
            }
            let nothing = query(&image, 0).with_prior(&[]);
            assert_eq!(
                localizer.localize(&mut scratch, &nothing).expect("fits"),
                whole
            );
        }
        assert!(num_widened >= 8, "{num_widened}");
        let image = image_of(0);
        let unknown = [NodeId(1), NodeId(NUM_PLACES as u32)];
        let error = localizer
            .localize(&mut scratch, &query(&image, 0).with_prior(&unknown))
            .expect_err("no such place");
        assert_eq!(error.kind(), ErrorKind::NotFound);
        assert!(error.to_string().contains("names node 400"), "{error}");
    }
}

#[test]
fn a_robot_that_is_followed_is_searched_for_near_where_it_was() {
    let mut snapshot = Snapshot::clone(&map());
    for place in 1..NUM_PLACES {
        let key = |place: usize| snapshot.nodes()[place].key().clone();
        let edge = Edge {
            from: key(place - 1),
            to: key(place),
            name: String::new(),
        };
        snapshot.add_edge(edge).expect("both are there");
    }
    let cfg = LocalizerConfig::default().with_place_search(PlaceSearch::Inverted);
    let localizer = Localizer::new(Arc::new(snapshot), cfg).expect("map fits");
    let mut tracker = Tracker::new(&localizer, MotionConfig::default()).expect("valid");
    let (mut scratch, mut plausible) = (localizer.scratch(), Vec::new());
    let mut see = |place: usize| {
        tracker.plausible_into(100, &mut plausible);
        let image = image_of(place);
        let query = query(&image, 0).with_prior(&plausible);
        let mut answer = localizer.localize(&mut scratch, &query).expect("fits");
        let num_matched = answer.ranking.len();
        (tracker.update(localizer.cfg(), &mut answer)).expect("of this map");
        (answer.decision, num_matched)
    };
    for place in 50..58 {
        let (decision, num_matched) = see(place);
        assert_eq!(decision, Decision::At(NodeId(place as u32)));
        assert_eq!(num_matched < 128, place > 50, "{num_matched} at {place}");
    }
    // Carried away: found within three images.
    let found = (0..3).any(|_| see(333).0 == Decision::At(NodeId(333)));
    assert!(found);
}

#[test]
fn each_image_of_a_batch_has_its_own_prior() {
    let localizer = localizer(PlaceSearch::Inverted);
    let images: Vec<Features> = (0..6).map(|it| image_of(it * 60)).collect();
    let priors: Vec<Vec<NodeId>> = (0..6)
        .map(|it| (0..it).map(|near| NodeId(it * 60 + near)).collect())
        .collect();
    let queries: Vec<Query<'_>> = (images.iter().zip(&priors))
        .map(|(image, prior)| query(image, 0).with_prior(prior))
        .collect();
    let batch = localizer.localize_batch(&queries).expect("fits");
    for (query, answer) in queries.iter().zip(&batch) {
        let single = localizer.localize(&mut localizer.scratch(), query);
        assert_eq!(&single.expect("fits"), answer);
    }
}

//! The rules of `matching` against plain oracles.

use chronotope::feature::{Descriptor, Features, Keypoint};
use chronotope::matching::{
    Direction, Displacement, ExactSearch, InvertedFile, Match, MatchConfig, MatchScratch, Matcher,
    NearestNeighbours, SearchScratch, TwoWay, TwoWayConfig, VoteConfig, VoteScratch, Window,
    displacements_into, vote_displacement, vote_subset,
};
use chronotope::simd::{Kernel, NearestTwo};
use proptest::prelude::*;

/// Descriptors with few different distances, so that ties are common, beside arbitrary ones.
fn descriptor() -> impl Strategy<Value = Descriptor> {
    prop_oneof![
        any::<[u64; 4]>().prop_map(Descriptor),
        [0..3_u64, 0..3_u64, 0..2_u64, 0..2_u64].prop_map(Descriptor),
        Just(Descriptor([0; 4])),
        Just(Descriptor([u64::MAX; 4])),
    ]
}

fn descriptors(max_len: usize) -> impl Strategy<Value = Vec<Descriptor>> {
    prop::collection::vec(descriptor(), 0..=max_len)
}

/// Whole pixels on a small raster, so that equal displacements and window edges are common.
fn features(max_len: usize) -> impl Strategy<Value = Features> {
    let feature = (0..60_u16, 0..40_u16, descriptor());
    prop::collection::vec(feature, 0..=max_len).prop_map(|rows| {
        let mut features = Features::new();
        for (x, y, descriptor) in rows {
            features.push(keypoint(f32::from(x), f32::from(y)), descriptor);
        }
        features
    })
}

fn keypoint(x: f32, y: f32) -> Keypoint {
    Keypoint {
        x,
        y,
        size: 10.0,
        response: 1.0,
    }
}

/// The two nearest by sorting all rows by (distance, row).
fn nearest_two_oracle(query: &Descriptor, train: &[Descriptor]) -> NearestTwo {
    let mut rows: Vec<(u32, u32)> = train
        .iter()
        .zip(0..)
        .map(|(row, id)| (query.distance_bits(row), id))
        .collect();
    rows.sort_unstable();
    let mut nearest = NearestTwo::EMPTY;
    if let Some(&(bits, id)) = rows.first() {
        (nearest.best, nearest.best_bits) = (id, bits as u16);
    }
    if let Some(&(bits, id)) = rows.get(1) {
        (nearest.second, nearest.second_bits) = (id, bits as u16);
    }
    nearest
}

fn nearest_two_of_all(queries: &[Descriptor], train: &[Descriptor]) -> Vec<NearestTwo> {
    queries
        .iter()
        .map(|query| nearest_two_oracle(query, train))
        .collect()
}

proptest! {
    #[test]
    fn hamming_is_a_metric(a in descriptor(), b in descriptor(), c in descriptor()) {
        prop_assert_eq!(a.distance_bits(&a), 0);
        prop_assert_eq!(a.distance_bits(&b), b.distance_bits(&a));
        prop_assert_eq!(a.distance_bits(&b) == 0, a == b);
        prop_assert!(a.distance_bits(&c) <= a.distance_bits(&b) + b.distance_bits(&c));
    }

    #[test]
    fn an_inverted_file_of_which_all_lists_are_searched_finds_every_near_row(
        queries in descriptors(9),
        train in descriptors(90),
        max_bits in 0_u16..=256,
    ) {
        let file = InvertedFile::new(&train, 7, 7).unwrap();
        let mut found = Vec::new();
        let scratch = &mut SearchScratch::default();
        file.rows_within(scratch, &queries, max_bits, |query, row, bits| {
            found.push((query, row, bits));
        });
        found.sort_unstable();
        let mut expected = Vec::new();
        for (query, wanted) in (0..).zip(&queries) {
            let rows = (0..).zip(&train);
            expected.extend(rows.map(|(row, other)| (query, row, wanted.distance_bits(other) as u16)));
        }
        expected.retain(|&(.., bits): &(u32, u32, u16)| bits <= max_bits);
        expected.sort_unstable();
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn matching_many_parts_is_matching_each(
        parts in prop::collection::vec(features(30), 0..6),
        live in features(40),
        is_map_asking: bool,
        mutual: bool,
        unique: bool,
        has_window: bool,
        max_bits in 0_u16..=256,
    ) {
        let direction = if is_map_asking { Direction::MapToLive } else { Direction::LiveToMap };
        let window = has_window.then(|| Window::new(20.0, 10.0).unwrap());
        let cfg = MatchConfig::builder()
            .with_direction(direction)
            .with_mutual(mutual)
            .with_unique(unique)
            .with_window(window)
            .with_max_bits(max_bits)
            .build()
            .unwrap();
        let mut map = Features::new();
        let ends: Vec<usize> = parts.iter().map(|part| {
            map.append_view(part.view());
            map.len()
        }).collect();
        for kernel in Kernel::available() {
            let matcher = Matcher::with_kernel(cfg.clone(), kernel);
            let mut scratch = MatchScratch::default();
            let mut found = Vec::new();
            matcher.parts_into(&mut scratch, map.view(), &ends, live.view(), |part, matches| {
                assert_eq!(part, found.len());
                found.push(matches.to_vec());
            });
            prop_assert_eq!(found.len(), parts.len());
            for (part, found) in parts.iter().zip(found) {
                let mut alone = Vec::new();
                matcher.matches_into(&mut scratch, part.view(), live.view(), &mut alone);
                prop_assert_eq!(found, alone, "{}", kernel);
            }
        }
    }

    #[test]
    fn an_inverted_file_that_searches_every_list_is_exact(
        queries in descriptors(9),
        train in descriptors(120),
        num_lists in 1_usize..20,
    ) {
        let expected = nearest_two_of_all(&queries, &train);
        let mut scratch = SearchScratch::default();
        let mut out = vec![NearestTwo::EMPTY; queries.len()];
        ExactSearch::new(&train).nearest_two_into(&mut scratch, &queries, &mut out);
        prop_assert_eq!(&out, &expected);
        let file = InvertedFile::new(&train, num_lists, num_lists).expect("valid");
        prop_assert_eq!(file.num_rows(), train.len());
        file.nearest_two_into(&mut scratch, &queries, &mut out);
        prop_assert_eq!(&out, &expected);
    }

    #[test]
    fn an_inverted_file_answers_alike_with_every_kernel_and_finds_itself(
        train in descriptors(120),
        num_lists in 1_usize..20,
        probes in 1_usize..4,
    ) {
        let mut scratch = SearchScratch::default();
        let mut out = vec![NearestTwo::EMPTY; train.len()];
        let mut first = None;
        for kernel in Kernel::available() {
            let file = InvertedFile::with_kernel(&train, num_lists, probes, kernel).expect("valid");
            file.nearest_two_into(&mut scratch, &train, &mut out);
            // A row is in the list of its nearest centroid, which is the first to be searched.
            prop_assert!(out.iter().all(|found| found.best_bits == 0));
            for (i, (row, found)) in train.iter().zip(&out).enumerate() {
                let mut alone = [NearestTwo::EMPTY];
                file.nearest_two_into(&mut scratch, std::slice::from_ref(row), &mut alone);
                prop_assert_eq!(alone[0], *found, "query {}", i);
            }
            prop_assert_eq!(&out, first.get_or_insert_with(|| out.clone()));
        }
    }

}

#[test]
fn an_inverted_file_of_nothing_is_refused_or_finds_nothing() {
    for (num_lists, probes) in [(0, 1), (1, 0)] {
        let error = InvertedFile::new(&[], num_lists, probes).unwrap_err();
        assert_eq!(error.kind(), chronotope::ErrorKind::Config);
    }
    let empty = InvertedFile::new(&[], 8, 2).unwrap();
    assert!(empty.clone().with_probes(0).is_err());
    let mut out = [NearestTwo::EMPTY];
    let mut scratch = SearchScratch::default();
    empty.nearest_two_into(&mut scratch, &[Descriptor([1; 4])], &mut out);
    assert_eq!((out[0], empty.num_lists()), (NearestTwo::EMPTY, 0));
}

/// The rules of the module's documentation, one after the other, in `O(map * live)` each.
fn matches_oracle(cfg: &MatchConfig, map: &Features, live: &Features) -> Vec<Match> {
    let from_map = cfg.direction() == Direction::MapToLive;
    let (asking, answering) = if from_map { (map, live) } else { (live, map) };
    let mut found = Vec::new();
    for (id, descriptor) in asking.descriptors().iter().enumerate() {
        let nearest = nearest_two_oracle(descriptor, answering.descriptors());
        if nearest.best_bits > cfg.max_bits() {
            continue;
        }
        if let Some(ratio) = cfg.ratio() {
            let passes = if nearest.second == NearestTwo::NONE {
                cfg.accept_lone()
            } else {
                f64::from(nearest.best_bits) < ratio * f64::from(nearest.second_bits)
            };
            if !passes {
                continue;
            }
        }
        let answer = &answering.descriptors()[nearest.best as usize];
        if cfg.mutual() && nearest_two_oracle(answer, asking.descriptors()).best as usize != id {
            continue;
        }
        let (map_id, live_id) = if from_map {
            (id as u32, nearest.best)
        } else {
            (nearest.best, id as u32)
        };
        let from = map.keypoints()[map_id as usize];
        let to = live.keypoints()[live_id as usize];
        if let Some(window) = cfg.window()
            && (f64::from(to.x - from.x).abs() >= window.max_dx_px()
                || f64::from(to.y - from.y).abs() >= window.max_dy_px())
        {
            continue;
        }
        found.push(Match {
            map: map_id,
            live: live_id,
            distance_bits: nearest.best_bits,
        });
    }
    let sides = |m: &Match| {
        if from_map {
            (m.map, m.live)
        } else {
            (m.live, m.map)
        }
    };
    if cfg.unique() {
        let all = found.clone();
        found.retain(|m| {
            all.iter()
                .filter(|other| sides(other).1 == sides(m).1)
                .map(|other| (other.distance_bits, sides(other).0))
                .min()
                == Some((m.distance_bits, sides(m).0))
        });
    }
    found
}

fn config() -> impl Strategy<Value = MatchConfig> {
    (
        prop_oneof![Just(Direction::MapToLive), Just(Direction::LiveToMap)],
        prop_oneof![Just(256_u16), Just(130), Just(3)],
        prop::option::of(prop_oneof![Just(0.7), Just(1.0)]),
        any::<[bool; 3]>(),
        any::<bool>(),
    )
        .prop_filter_map(
            "every one is valid",
            |(direction, max_bits, ratio, [lone, mutual, unique], windowed)| {
                let window = windowed.then(|| Window::new(25.0, 15.0).ok()).flatten();
                MatchConfig::builder()
                    .with_direction(direction)
                    .with_max_bits(max_bits)
                    .with_ratio(ratio)
                    .with_accept_lone(lone)
                    .with_mutual(mutual)
                    .with_unique(unique)
                    .with_window(window)
                    .build()
                    .ok()
            },
        )
}

fn matches(cfg: &MatchConfig, map: &Features, live: &Features) -> Vec<Match> {
    let mut out = Vec::new();
    let matcher = Matcher::new(cfg.clone());
    matcher.matches_into(
        &mut MatchScratch::default(),
        map.view(),
        live.view(),
        &mut out,
    );
    out
}

proptest! {
    #[test]
    fn every_combination_of_rules_equals_its_oracle(
        cfg in config(), map in features(40), live in features(40),
    ) {
        let expected = matches_oracle(&cfg, &map, &live);
        let mut scratch = MatchScratch::default();
        let mut out = Vec::new();
        for kernel in Kernel::available() {
            let matcher = Matcher::with_kernel(cfg.clone(), kernel);
            matcher.matches_into(&mut scratch, map.view(), live.view(), &mut out);
            prop_assert_eq!(&out, &expected, "{}", kernel);
        }
    }

    #[test]
    fn all_prefixes_of_a_map_equal_separate_maps(
        cfg in config(), map in features(40), live in features(20),
        mut checkpoints in prop::collection::vec(0..45_usize, 0..6),
    ) {
        checkpoints.sort_unstable();
        let matcher = Matcher::new(cfg.clone());
        let mut seen = Vec::new();
        matcher.prefixes_into(
            &mut MatchScratch::default(), map.view(), live.view(), &checkpoints,
            |_, matches| seen.push(matches.to_vec()),
        );
        let expected: Vec<_> = checkpoints
            .iter()
            .map(|&count| {
                let mut prefix = map.clone();
                prefix.truncate(count);
                matches_oracle(&cfg, &prefix, &live)
            })
            .collect();
        prop_assert_eq!(seen, expected);
    }

    #[test]
    fn selecting_from_evidence_equals_matching_the_selected_map(
        cfg in config(), map in features(40), live in features(20), keep in any::<u64>(),
    ) {
        let cfg = cfg.to_builder().with_direction(Direction::MapToLive).with_mutual(false);
        let cfg = cfg.build().unwrap();
        let ids: Vec<u32> = (0..map.len() as u32).filter(|id| keep >> id & 1 == 1).collect();
        let matcher = Matcher::new(cfg.clone());
        let mut scratch = MatchScratch::default();
        let (mut nearest, mut out) = (Vec::new(), Vec::new());
        matcher.nearest_live_into(
            &mut scratch, map.descriptors(), live.descriptors(), &mut nearest,
        );
        matcher.select_into(&mut scratch, map.view(), live.view(), &nearest, &ids, &mut out);
        for found in &mut out {
            found.map = ids.iter().position(|&id| id == found.map).unwrap() as u32;
        }
        prop_assert_eq!(out, matches_oracle(&cfg, &map.select(&ids), &live));
    }

    #[test]
    fn mutual_matching_is_symmetric(map in features(40), live in features(40)) {
        let mutual = MatchConfig::builder().with_max_bits(256).with_mutual(true);
        let from = |direction, a: &Features, b: &Features| {
            let cfg = mutual.clone().with_direction(direction).build().unwrap();
            let mut found = matches(&cfg, a, b);
            found.sort_unstable_by_key(|m| (m.map, m.live));
            found
        };
        let forward = from(Direction::MapToLive, &map, &live);
        prop_assert_eq!(&forward, &from(Direction::LiveToMap, &map, &live));
        let mut swapped: Vec<_> = from(Direction::MapToLive, &live, &map)
            .iter()
            .map(|m| Match { map: m.live, live: m.map, distance_bits: m.distance_bits })
            .collect();
        swapped.sort_unstable_by_key(|m| (m.map, m.live));
        prop_assert_eq!(&forward, &swapped);
    }

    #[test]
    fn a_live_feature_is_used_once(map in features(40), live in features(10)) {
        let cfg = MatchConfig::builder().with_max_bits(256).build().unwrap();
        let found = matches(&cfg, &map, &live);
        let mut used: Vec<_> = found.iter().map(|m| m.live).collect();
        used.sort_unstable();
        used.dedup();
        prop_assert_eq!(used.len(), found.len());
        prop_assert_eq!(found.is_empty(), map.is_empty() || live.is_empty());
    }

    #[test]
    fn the_two_way_comparison_is_two_one_way_ones(map in features(30), live in features(30)) {
        let cfg = TwoWayConfig::default();
        let mut two_way = TwoWay::new();
        two_way.compare(&cfg, Kernel::best(), map.view(), live.view());
        let forward = nearest_two_of_all(live.descriptors(), map.descriptors());
        let backward = nearest_two_of_all(map.descriptors(), live.descriptors());
        prop_assert_eq!(two_way.live_to_map(), &forward[..]);
        prop_assert_eq!(two_way.map_to_live(), &backward[..]);
        let passes = |n: &NearestTwo| {
            n.has_second() && f64::from(n.best_bits) < 0.7 * f64::from(n.second_bits)
        };
        for (verdict, nearest) in two_way.verdicts().iter().zip(&forward) {
            prop_assert_eq!(verdict.forward, passes(nearest));
            let answer = nearest.has_best().then(|| &backward[nearest.best as usize]);
            prop_assert_eq!(verdict.backward, answer.is_some_and(passes));
            prop_assert_eq!(verdict.is_new(), !verdict.forward && !verdict.backward);
            prop_assert!(!(verdict.is_new() && verdict.seen().is_some()));
            let both = verdict.forward && verdict.backward;
            prop_assert_eq!(verdict.seen().is_some(), both && verdict.in_window);
        }
    }
}

/// The fullest closed window by trying every pair of edges, with the documented tie rule.
fn vote_oracle(points: &[Displacement], width_px: f64, height_px: f64) -> Vec<bool> {
    let mut winner: Option<(usize, [f64; 3], Vec<bool>)> = None;
    for left in points {
        for top in points {
            let inside = |p: &Displacement| {
                (0.0..=width_px).contains(&(p.dx_px - left.dx_px))
                    && (0.0..=height_px).contains(&(p.dy_px - top.dy_px))
            };
            let inliers: Vec<bool> = points.iter().map(inside).collect();
            let members: Vec<_> = points.iter().filter(|p| inside(p)).collect();
            let centre = |of: fn(&Displacement) -> f64| {
                let least = members.iter().map(|p| of(p)).fold(f64::INFINITY, f64::min);
                let most = members
                    .iter()
                    .map(|p| of(p))
                    .fold(f64::NEG_INFINITY, f64::max);
                f64::midpoint(least, most)
            };
            if members.is_empty() {
                continue;
            }
            let (x, y) = (centre(|p| p.dx_px), centre(|p| p.dy_px));
            let rank = [x.abs() + y.abs(), x, y];
            if winner.as_ref().is_none_or(|(count, best, _)| {
                members.len() > *count || (members.len() == *count && rank < *best)
            }) {
                winner = Some((members.len(), rank, inliers));
            }
        }
    }
    winner.map_or_else(Vec::new, |(.., inliers)| inliers)
}

fn displacements() -> impl Strategy<Value = Vec<Displacement>> {
    let at = (-90..90_i16, -40..40_i16).prop_map(|(dx, dy)| Displacement {
        dx_px: f64::from(dx),
        dy_px: f64::from(dy),
    });
    prop::collection::vec(at, 0..30)
}

proptest! {
    #[test]
    fn the_vote_equals_trying_every_window(points in displacements()) {
        let mut scratch = VoteScratch::default();
        let vote = vote_displacement(&VoteConfig::default(), &mut scratch, &points);
        prop_assert_eq!(scratch.inliers(), vote_oracle(&points, 40.0, 20.0));
        let count = scratch.inliers().iter().filter(|&&inlier| inlier).count();
        prop_assert_eq!(vote.num_inliers as usize, count);
    }

    #[test]
    fn shifting_all_live_keypoints_shifts_the_vote_and_changes_no_count(
        map in features(30), live in features(30), dx in -50..50_i16, dy in -50..50_i16,
    ) {
        let cfg = MatchConfig::builder().with_max_bits(256).with_unique(false).build().unwrap();
        let found = matches(&cfg, &map, &live);
        let shifted: Vec<_> = live
            .keypoints()
            .iter()
            .map(|k| keypoint(k.x + f32::from(dx), k.y + f32::from(dy)))
            .collect();
        let (mut scratch, mut at) = (VoteScratch::default(), Vec::new());
        displacements_into(&found, map.keypoints(), live.keypoints(), &mut at);
        let before = vote_displacement(&VoteConfig::default(), &mut scratch, &at);
        displacements_into(&found, map.keypoints(), &shifted, &mut at);
        let after = vote_displacement(&VoteConfig::default(), &mut scratch, &at);
        prop_assert_eq!(before.num_inliers, after.num_inliers);
    }

    #[test]
    fn voting_on_a_subset_equals_voting_on_its_copy(
        points in displacements(),
        keep in any::<u32>(),
    ) {
        let ids: Vec<u32> = (0..points.len() as u32).filter(|id| keep >> id & 1 == 1).collect();
        let copy: Vec<_> = ids.iter().map(|&id| points[id as usize]).collect();
        let (cfg, mut scratch) = (VoteConfig::default(), VoteScratch::default());
        let of_copy = vote_displacement(&cfg, &mut scratch, &copy);
        let inliers = scratch.inliers().to_vec();
        prop_assert_eq!(vote_subset(&cfg, &mut scratch, &points, &ids), of_copy);
        prop_assert_eq!(scratch.inliers(), inliers);
    }
}

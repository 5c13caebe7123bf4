//! What holds of every plan?

use fremen::online::OnlineConfig;
use fremen::{Period, Time};
use fremen_explore::{ExploreConfig, Explored, Explorer, Share, Strategy, Visit, simulate};
use proptest::prelude::*;

use crate::worlds::rhythms_and_coins;

fn strategies() -> impl proptest::strategy::Strategy<Value = Strategy> {
    prop::sample::select(Strategy::ALL.to_vec())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_plan_keeps_to_its_share_and_never_overlaps(
        strategy in strategies(),
        share in 0.0..=1.0_f64,
        seed in any::<u64>(),
        num_places in 1..6_usize,
        num_slots in 1..60_usize,
        slot_s in 1..2_000_i64,
    ) {
        let slot = Period::from_us(slot_s * 1_000_000).unwrap();
        let cfg = ExploreConfig::new(strategy).unwrap()
            .with_share(Share::new(share).unwrap())
            .with_seed(seed)
            .with_slot(slot);
        let names: Vec<String> = (0..num_places).map(|i| i.to_string()).collect();
        let places = names.iter().map(|name| (name.as_str(), 2));
        let mut explorer = Explorer::new(places, &OnlineConfig::default(), cfg);
        let mut start = Time::from_s(1_000);
        for day in 0..3_i64 {
            explorer.plan(start, num_slots).unwrap();
            let mut visits: Vec<Visit> = Vec::new();
            for slot in 0..num_slots {
                let Some(visit) = explorer.next(slot).unwrap() else { continue };
                let states = [day % 2 == 0, slot % 3 == 0];
                explorer.observe(visit.place, visit.start, &states).unwrap();
                visits.push(visit);
            }
            prop_assert!(visits.len() as f64 <= share * num_slots as f64 + 1e-6);
            prop_assert!(visits.iter().all(|visit| visit.place < explorer.beliefs().num_places()));
            prop_assert!(visits.iter().all(|visit| visit.info_bits.is_finite() && visit.info_bits >= 0.0));
            prop_assert!(visits.iter().all(|visit| visit.start < visit.end));
            prop_assert!(visits.windows(2).all(|pair| pair[0].end <= pair[1].start));
            start = explorer.present_plan().unwrap().slots().end();
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_visits() {
    let recording = rhythms_and_coins(4, 1, 5, 600, 1);
    for strategy in Strategy::ALL {
        let run = |seed| {
            let cfg = ExploreConfig::new(strategy).unwrap().with_seed(seed);
            let outcome = simulate(&recording, &OnlineConfig::default(), &cfg, 144).unwrap();
            format!("{outcome:?}")
        };
        assert_eq!(run(3), run(3), "{strategy}");
        if strategy != Strategy::RoundRobin {
            assert_ne!(run(3), run(4), "{strategy}");
        }
    }
}

#[test]
fn a_share_of_nothing_visits_nothing_and_all_of_it_every_slot() {
    let recording = rhythms_and_coins(3, 0, 3, 600, 1);
    for strategy in Strategy::ALL {
        for (share, visits) in [(0.0, 0), (1.0, 3 * 144)] {
            let cfg = ExploreConfig::new(strategy).unwrap();
            let cfg = cfg.with_share(Share::new(share).unwrap());
            let outcome = simulate(&recording, &OnlineConfig::default(), &cfg, 144).unwrap();
            assert_eq!(outcome.visits.len(), visits, "{strategy} {share}");
        }
    }
}

#[test]
fn one_place_is_all_that_is_visited() {
    let recording = rhythms_and_coins(1, 0, 3, 600, 1);
    for strategy in Strategy::ALL {
        let cfg = ExploreConfig::new(strategy).unwrap();
        let outcome = simulate(&recording, &OnlineConfig::default(), &cfg, 144).unwrap();
        assert_eq!(outcome.visits.len(), 3 * 72, "{strategy}");
    }
}

//! What holds of every plan?

use fremen::online::OnlineConfig;
use fremen::{Period, Time};
use fremen_explore::{
    Beliefs, ExploreConfig, Explored, Explorer, InZone, MadeVisits, Share, Slots, Strategy, Visit,
    next_look_bits, plan, plan_rest, simulate,
};
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

/// Three places that were looked at every hour for a week, the last look in the morning of the eighth
/// day's slot 60.
fn a_week() -> (Beliefs, Slots) {
    let mut beliefs = Beliefs::new([("a", 1), ("b", 1), ("c", 1)], &OnlineConfig::default());
    for hour in 0..7 * 24 {
        for place in 0..3 {
            let state = (8..16).contains(&((hour + 3 * place) % 24));
            let time = Time::from_s(hour as i64 * 3_600);
            beliefs.observe(place, time, &[state]).unwrap();
        }
        if hour % 24 == 23 {
            beliefs.learn().unwrap();
        }
    }
    let start = Time::from_s(7 * 86_400);
    (beliefs, Slots::of_s(start, 600.0, 144).unwrap())
}

#[test]
fn visits_that_were_made_are_taken_off_the_share_of_what_is_left() {
    let (beliefs, slots) = a_week();
    for strategy in Strategy::ALL {
        let cfg = ExploreConfig::new(strategy).unwrap();
        let rest = |made: &MadeVisits| plan_rest(&beliefs, slots, &cfg, 60, made).unwrap();
        let nothing = rest(&MadeVisits::default());
        assert_eq!(nothing.num_visits(), 72, "{strategy}");
        // Two places in slot 4 are one visit.
        let made = MadeVisits {
            at: vec![(4, 0), (4, 1), (9, 2)],
            elsewhere: 30,
        };
        let after = rest(&made);
        assert_eq!(after.num_visits(), 72 - 32, "{strategy}");
        assert!(after.visits().all(|visit| visit.slot >= 60), "{strategy}");
        let all = MadeVisits {
            at: vec![(4, 0)],
            elsewhere: 100,
        };
        assert_eq!(rest(&all).num_visits(), 0, "{strategy}");
        // From the first slot on it is the plan of all of it.
        let whole = plan_rest(&beliefs, slots, &cfg, 0, &MadeVisits::default()).unwrap();
        assert_eq!(whole, plan(&beliefs, slots, &cfg).unwrap(), "{strategy}");
        let over = plan_rest(&beliefs, slots, &cfg, 144, &MadeVisits::default()).unwrap();
        assert_eq!(over.num_visits(), 0, "{strategy}");
        for at in [(60, 0), (4, 3)] {
            let made = MadeVisits {
                at: vec![at],
                elsewhere: 0,
            };
            let error = plan_rest(&beliefs, slots, &cfg, 60, &made).unwrap_err();
            assert_eq!(error.kind(), fremen::ErrorKind::NotFound, "{at:?}");
        }
    }
}

#[test]
fn a_place_that_was_looked_at_this_hour_is_worth_less_and_round_robin_goes_on() {
    let (beliefs, slots) = a_week();
    let cfg = ExploreConfig::new(Strategy::Information).unwrap();
    let bits = |at: Vec<(usize, usize)>| {
        let made = MadeVisits { at, elsewhere: 0 };
        let plan = plan_rest(&beliefs, slots, &cfg, 60, &made).unwrap();
        let near = plan
            .visits()
            .filter(|visit| visit.place == 0 && visit.slot < 66);
        near.map(|visit| visit.info_bits).fold(0.0, f64::max)
    };
    assert!(bits(vec![(55, 0), (57, 0), (59, 0)]) < bits(Vec::new()));
    let cfg = ExploreConfig::new(Strategy::RoundRobin).unwrap();
    let made = MadeVisits {
        at: vec![(3, 2), (9, 0)],
        elsewhere: 0,
    };
    let plan = plan_rest(&beliefs, slots, &cfg, 60, &made).unwrap();
    assert_eq!(plan.visits().next().unwrap().place, 1);
}

#[test]
fn each_further_look_of_a_day_is_expected_to_add_less() {
    let (beliefs, slots) = a_week();
    let bits = next_look_bits(&beliefs, &slots).unwrap();
    assert_eq!(bits.len(), 144);
    assert!(bits.iter().all(|bits| bits.is_finite() && *bits >= 0.0));
    // The best look comes first; a look between two others may teach more of how long states stay.
    assert!(bits[0] >= bits.iter().copied().fold(0.0, f64::max) - 1e-9);
    assert!(bits[143] < 0.5 * bits[0], "{} {}", bits[143], bits[0]);
}

#[test]
fn looks_are_learnt_in_order_of_time_and_once_a_day() {
    let looks: Vec<(Time, usize, bool)> = (0..600)
        .map(|hour| {
            (
                Time::from_s(3_600 * hour),
                (hour % 2) as usize,
                hour % 24 > 12,
            )
        })
        .collect();
    let reversed = looks.iter().rev().copied().collect();
    let model = OnlineConfig::default();
    let mut by_hand = Beliefs::new([("a", 1), ("b", 1)], &model);
    for (at, &(time, place, state)) in looks.iter().enumerate() {
        if at > 0 && at % 24 == 0 {
            by_hand.learn().unwrap();
        }
        by_hand.observe(place, time, &[state]).unwrap();
    }
    by_hand.learn().unwrap();
    let learnt = Beliefs::of_looks(["a", "b"], &model, reversed).unwrap();
    // Without a zone times are what they are; in a zone its clocks count.
    let zone = fremen::time::Zone::new("Etc/GMT-3").unwrap();
    let plain = InZone::new(Beliefs::of_looks(["a", "b"], &model, looks).unwrap(), None);
    let zoned = InZone::new(learnt, Some(zone));
    for hour in 600..640 {
        let time = Time::from_s(3_600 * hour);
        for place in 0..2 {
            let p = |explored: &dyn Explored, time| {
                let mut p = [0.0];
                explored.predict_into(place, time, &mut p);
                (p, explored.looks(place, time))
            };
            assert_eq!(p(&plain, time), p(&by_hand, time));
            assert_eq!(
                p(&zoned, time.plus_us(-3 * 3_600_000_000)),
                p(&by_hand, time)
            );
        }
    }
    assert!(Beliefs::of_looks(["a"], &model, vec![(Time::default(), 1, true)]).is_err());
}

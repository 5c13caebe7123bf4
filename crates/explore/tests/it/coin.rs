//! Is time wasted on a place that cannot be learnt, and is no place given up that can?

use fremen::Time;
use fremen::online::OnlineConfig;
use fremen_explore::{ExploreConfig, Recording, Strategy, simulate};

use crate::worlds::{Numbers, rhythms_and_coins};

/// The share of visits that goes to the one coin among ten rhythms.
fn share_of_the_coin(strategy: Strategy, every_s: usize, toss: usize, seed: u64) -> f64 {
    let recording = rhythms_and_coins(10, 1, 28, every_s, toss);
    let cfg = ExploreConfig::new(strategy).unwrap().with_seed(seed);
    let outcome = simulate(&recording, &OnlineConfig::default(), &cfg, 144).unwrap();
    let to_coin = outcome
        .visits
        .iter()
        .filter(|visit| visit.place == 10)
        .count();
    to_coin as f64 / outcome.visits.len() as f64
}

#[test]
fn a_coin_gets_no_more_than_its_fair_share_by_default_and_more_than_twice_of_it_by_entropy() {
    // Tossed at every look, for each slot, and looked at once a slot.
    let fair = 1.0 / 11.0;
    for (every_s, toss) in [(60, 1), (60, 10), (600, 1)] {
        let shares: Vec<f64> = (0..6)
            .map(|seed| share_of_the_coin(Strategy::Information, every_s, toss, seed))
            .collect();
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        let most = shares.iter().copied().fold(0.0, f64::max);
        let greedy = share_of_the_coin(Strategy::Greedy, every_s, toss, 0);
        println!(
            "every {every_s} s, tossed each {toss}: {mean:.3}, at most {most:.3}; greedy {greedy:.3}"
        );
        assert!(mean <= fair, "{every_s} {toss}: {shares:?}");
        // It takes a while until a coin that is looked at once a slot is known to be one.
        let limit = if every_s == 60 { fair } else { 1.1 * fair };
        assert!(most <= limit, "{every_s} {toss}: {shares:?}");
        assert!(greedy > 2.0 * fair, "{every_s} {toss}: {greedy}");
    }
}

/// Six places of three weeks, a moment a minute. On the first day each slot of the first is tossed; from
/// then on somebody is there every night and now and then in the evening, for hours. In the others
/// somebody is for an hour or so a day.
fn a_bad_first_day(seed: u64) -> Recording {
    let mut numbers = Numbers::new(seed);
    let moments = (0..21 * 1_440).map(|minute| Time::from_s(minute * 60));
    let mut recording = Recording::new(moments.collect()).unwrap();
    for place in 0..6 {
        let mut states = Vec::new();
        for day in 0..21 {
            let from = 300 + (900.0 * numbers.unit()) as usize;
            let until = from + 30 + (60.0 * numbers.unit()) as usize;
            let sleeps_from = 1_200 + (240.0 * numbers.unit()) as usize;
            let sleeps_until = 360 + (120.0 * numbers.unit()) as usize;
            let tossed: Vec<bool> = (0..144).map(|_| numbers.unit() < 0.5).collect();
            states.extend((0..1_440).map(|minute| match (place, day) {
                (0, 0) => tossed[minute / 10],
                (0, _) => minute < sleeps_until || sleeps_from <= minute,
                _ => (from..until).contains(&minute),
            }));
        }
        recording.push(format!("place {place}"), 1, states).unwrap();
    }
    recording
}

#[test]
fn a_place_whose_first_day_looked_like_a_coin_is_not_given_up() {
    for seed in 0..12 {
        let recording = a_bad_first_day(seed);
        let cfg = ExploreConfig::new(Strategy::Information).unwrap();
        let cfg = cfg.with_seed(seed);
        let outcome = simulate(&recording, &OnlineConfig::default(), &cfg, 144).unwrap();
        let week = |first: usize| first * 7 * 72..(first + 1) * 7 * 72;
        let later = &outcome.visits[week(2)];
        let to_it = later.iter().filter(|visit| visit.place == 0).count();
        let share = to_it as f64 / later.len() as f64;
        let error = outcome.by_day[14..].iter().sum::<f64>() / 7.0;
        println!("seed {seed}: {share:.3} of the third week's visits, {error:.4} of states wrong");
        // The nights alone are a third of one of six places.
        assert!(share > 0.05, "{seed}: {share}");
        assert!(error < 0.05, "{seed}: {error}");
    }
}

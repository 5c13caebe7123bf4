//! Is time wasted on a place that cannot be learnt?

use fremen::online::OnlineConfig;
use fremen_explore::{ExploreConfig, Strategy, simulate};

use crate::worlds::rhythms_and_coins;

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
fn a_coin_gets_no_more_than_its_fair_share_by_default_and_most_of_the_time_by_entropy() {
    for (every_s, toss) in [(60, 1)] {
        for seed in 0..3 {
            let default = share_of_the_coin(Strategy::Information, every_s, toss, seed);
            let greedy = share_of_the_coin(Strategy::Greedy, every_s, toss, seed);
            println!("every {every_s} s, tossed each {toss}: {default:.3}, greedy {greedy:.3}");
            assert!(default <= 1.0 / 11.0, "{every_s} {toss} {seed}: {default}");
            assert!(greedy > 2.0 / 11.0, "{every_s} {toss} {seed}: {greedy}");
        }
    }
}

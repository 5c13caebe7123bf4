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

//! Are the published numbers reproduced, and beaten?

use std::path::PathBuf;

use fremen::Time;
use fremen::online::OnlineConfig;
use fremen_explore::{ExploreConfig, Recording, Strategy, simulate};

/// One person in ten rooms, a moment a minute for 16 weeks; `None` where there are no datasets.
fn aruba() -> Option<Recording> {
    let Some(root) = std::env::var_os("CHRONOTOPE_DATA") else {
        eprintln!("SKIPPED: set CHRONOTOPE_DATA to the datasets' folder to test with aruba");
        return None;
    };
    let path = PathBuf::from(root).join("series/aruba/location.min");
    let text = std::fs::read_to_string(path).expect("the rooms are there");
    let rooms: Vec<usize> = text
        .lines()
        .map(|line| line.trim().parse().unwrap())
        .collect();
    let minutes = (0..rooms.len()).map(|minute| Time::from_s(minute as i64 * 60));
    let mut recording = Recording::new(minutes.collect()).unwrap();
    for room in 1..=10 {
        let states = rooms.iter().map(|&it| it == room).collect();
        recording.push(format!("room {room}"), 1, states).unwrap();
    }
    Some(recording)
}

/// The mean model error in percent.
fn percent(recording: &Recording, strategy: Strategy, model: &str, seeds: u64) -> f64 {
    let model: OnlineConfig = model.parse().unwrap();
    let errors = (0..seeds).map(|seed| {
        let cfg = ExploreConfig::new(strategy).unwrap().with_seed(seed);
        simulate(recording, &model, &cfg, 144).unwrap().error
    });
    100.0 * errors.sum::<f64>() / seeds as f64
}

#[test]
fn real_data_of_rooms_give_the_numbers_of_the_paper_and_better_ones() {
    let Some(recording) = aruba() else { return };
    // Published: 8.9, 9.7, 5.8, 9.2 (RAS 2016, table 1).
    let long_term = percent(&recording, Strategy::MonteCarlo, "long-term", 5);
    assert!((long_term - 8.9).abs() <= 0.15, "{long_term}");
    let round_robin = percent(&recording, Strategy::RoundRobin, "long-term", 1);
    assert!((round_robin - 9.5).abs() <= 0.15, "{round_robin}");
    let fremen = percent(&recording, Strategy::MonteCarlo, "fremen", 5);
    assert!(fremen <= 6.1, "{fremen}");
    let random = percent(&recording, Strategy::Random, "fremen", 5);
    assert!(random <= 6.8, "{random}");
    // Published best: 5.7. With the last two seeds a room looked like a coin on the first day, and was
    // once given up for it (10.4 and 5.4).
    let cfg = |seed| {
        ExploreConfig::new(Strategy::default())
            .unwrap()
            .with_seed(seed)
    };
    let model = OnlineConfig::default();
    let default = [0, 18, 19]
        .map(|seed| 100.0 * simulate(&recording, &model, &cfg(seed), 144).unwrap().error);
    println!("{long_term:.2} {round_robin:.2} {fremen:.2} {random:.2} {default:.2?}");
    assert!(default.iter().all(|&error| error <= 4.6), "{default:?}");
}

//! Prints the model errors of every strategy with every model on the rooms of Aruba, next to those
//! of RAS 2016, table 1 (symbolic).
//!
//! `CHRONOTOPE_DATA=DIR cargo run --release -p fremen-explore --example parity -- 20`, with the
//! number of seeds.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "an example that cannot read its data has nothing else to say"
)]

use std::path::Path;

use fremen::Time;
use fremen_explore::{ExploreConfig, Recording, Strategy, simulate};

/// Round robin, random, greedy, Monte Carlo, novelty; short-term, long-term, FreMEn, mixture.
const PUBLISHED: [[f64; 4]; 5] = [
    [9.3, 9.7, 6.5, 7.5],
    [8.9, 9.5, 9.2, 7.5],
    [8.5, 8.7, 7.0, 9.4],
    [8.5, 8.9, 5.8, 6.4],
    [8.5, 8.9, 5.7, 6.1],
];

/// The published models, then those that go beyond.
const MODELS: [&str; 7] = [
    "short-term",
    "long-term",
    "fremen",
    "gaussians",
    "natural",
    "histogram",
    "histogram-persistent",
];

fn main() {
    let data = std::env::var("CHRONOTOPE_DATA").unwrap_or_else(|_| "datasets".into());
    let seeds: u64 = std::env::args()
        .nth(1)
        .map_or(3, |count| count.parse().unwrap());
    let path = Path::new(&data).join("series/aruba/location.min");
    let text = fremen::file::read(&path, 1 << 28).unwrap();
    let ids: Vec<usize> = (std::str::from_utf8(&text).unwrap().lines())
        .map(|line| line.trim().parse().unwrap())
        .collect();
    let minutes = (0..ids.len()).map(|minute| Time::from_s(minute as i64 * 60));
    let mut recording = Recording::new(minutes.collect()).unwrap();
    for room in 1..=10 {
        let states = ids.iter().map(|&id| id == room).collect();
        recording.push(format!("room {room}"), 1, states).unwrap();
    }
    for (row, strategy) in Strategy::ALL.into_iter().enumerate() {
        for (column, model) in MODELS.into_iter().enumerate() {
            let errors: Vec<f64> = (0..seeds)
                .map(|seed| {
                    let cfg = ExploreConfig::new(strategy).unwrap().with_seed(seed);
                    let outcome = simulate(&recording, &model.parse().unwrap(), &cfg, 144);
                    100.0 * outcome.unwrap().error
                })
                .collect();
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            let squares: f64 = errors.iter().map(|error| (error - mean).powi(2)).sum();
            let spread = (squares / errors.len() as f64).sqrt();
            let published = PUBLISHED.get(row).and_then(|row| row.get(column));
            let published = published.map_or("   -".to_owned(), |it| format!("{it:4.1}"));
            println!(
                "{:12} {model:21} published {published}  here {mean:5.2} ({spread:.2} between seeds)",
                strategy.name()
            );
        }
    }
}

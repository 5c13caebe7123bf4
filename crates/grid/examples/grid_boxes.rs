//! Which boxes are foreseen? Prints a table:
//! `cargo run --release -p fremen-grid --example grid_boxes -- [WORLDS] [FIRST_SEED] [EVERY] [noisy]
//! [any]`; of every so many local maps one is predicted. Seeds 0 and 1 are those that constants were
//! chosen in.

use std::io::Write as _;

use fremen_grid::Result;
use fremen_grid::experiment::{BoxesConfig, boxes};
use fremen_grid::simulation::BoxPeriods;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let has = |word: &str| arguments.iter().any(|argument| argument == word);
    let number = |at: usize| arguments.get(at).and_then(|text| text.parse::<u64>().ok());
    let (count, first) = (number(0).unwrap_or(5), number(1).unwrap_or(10));
    let config = BoxesConfig {
        seeds: (first..first + count).collect(),
        every: number(2).map_or(11, |it| it as i64),
        is_noisy: has("noisy"),
        periods: if has("any") {
            BoxPeriods::Any
        } else {
            BoxPeriods::Candidates
        },
        ..BoxesConfig::default()
    };
    let report = boxes(&config)?;
    let text = format!(
        "{}{} measured obstacles\n",
        report.table(),
        report.counts[0][0].num_obstacles
    );
    // Nobody may be listening any more.
    let _ = std::io::stdout().write_all(text.as_bytes());
    Ok(())
}

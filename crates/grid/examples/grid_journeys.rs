//! Prints how often planned ways are blocked in a changing office.
//!
//! `cargo run --release -p fremen-grid --example grid_journeys -- [OFFICES] [JOURNEYS] [dev]`

use std::io::Write as _;

use fremen_grid::Result;
use fremen_grid::experiment::{JourneysConfig, journeys};
use fremen_grid::simulation::Layout;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize, default: u64| {
        arguments
            .get(at)
            .and_then(|text| text.parse().ok())
            .unwrap_or(default)
    };
    let mut config = JourneysConfig {
        num_journeys: number(1, 40) as usize,
        ..JourneysConfig::default()
    };
    config.seeds = (0..number(0, 10)).collect();
    if arguments.iter().any(|argument| argument == "dev") {
        config.layout = Layout::Development;
        config.seeds = (100..100 + number(0, 10)).collect();
    }
    let report = journeys(&config)?;
    // Nobody may be listening any more.
    let _ = std::io::stdout().write_all(report.table().as_bytes());
    Ok(())
}

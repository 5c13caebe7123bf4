//! Prints how well robots localise in maps of a changing office.
//!
//! `cargo run --release -p fremen-grid --example grid_patrol -- [OFFICES] [PASSES] [dev]`

use std::io::Write as _;

use fremen_grid::Result;
use fremen_grid::experiment::{PassesConfig, passes};
use fremen_grid::simulation::Layout;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize, default: u64| {
        arguments
            .get(at)
            .and_then(|text| text.parse().ok())
            .unwrap_or(default)
    };
    let mut config = PassesConfig {
        num_passes: number(1, 20) as usize,
        ..PassesConfig::default()
    };
    config.seeds = (0..number(0, 10)).collect();
    if arguments.iter().any(|argument| argument == "dev") {
        config.layout = Layout::Development;
        config.seeds = (100..100 + number(0, 10)).collect();
    }
    let report = passes(&config)?;
    // Nobody may be listening any more.
    let _ = std::io::stdout().write_all(report.table().as_bytes());
    Ok(())
}

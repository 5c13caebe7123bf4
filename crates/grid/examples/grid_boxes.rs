//! Prints which boxes of the thesis' world a grid foresees.
//!
//! `cargo run --release -p fremen-grid --example grid_boxes -- [WORLDS]`

use std::io::Write as _;

use fremen_grid::Result;
use fremen_grid::experiment::{BoxesConfig, boxes};
use fremen_grid::simulation::BoxPeriods;

fn main() -> Result<()> {
    let count = std::env::args()
        .nth(1)
        .and_then(|text| text.parse().ok())
        .unwrap_or(5);
    for (title, periods, is_noisy) in [
        (
            "ideal, periods that are candidates",
            BoxPeriods::Candidates,
            false,
        ),
        ("ideal, any periods", BoxPeriods::Any, false),
        (
            "noisy, periods that are candidates",
            BoxPeriods::Candidates,
            true,
        ),
        ("noisy, any periods", BoxPeriods::Any, true),
    ] {
        let config = BoxesConfig {
            seeds: (0..count).collect(),
            periods,
            is_noisy,
            ..BoxesConfig::default()
        };
        let text = format!("{title}\n{}", boxes(&config)?.table());
        // Nobody may be listening any more.
        let _ = std::io::stdout().write_all(text.as_bytes());
    }
    Ok(())
}

//! Prints how well the scans of CARMEN logs make a map and are localised in it:
//! `cargo run --release -p fremen-grid --example grid_carmen -- LOG...`

use std::io::Write as _;

use fremen_grid::Result;
use fremen_grid::experiment::{CarmenConfig, carmen};
use fremen_grid::scan::read_carmen;

fn main() -> Result<()> {
    let mut out = std::io::stdout().lock();
    for path in std::env::args().skip(1) {
        let log = read_carmen(&path)?;
        let report = carmen(&log, &CarmenConfig::default())?;
        let mut text = format!(
            "{path}: {} scans mapped, {} localised, {:.1} % of ends within one cell of a wall\n\
             range m | median m | 95 % m | within 0.1 m % | found from anywhere %\n",
            report.num_mapped,
            report.num_localized,
            100.0 * report.within_one_cell,
        );
        for row in &report.ranges {
            text += &format!(
                "{:7} | {:8.3} | {:6.3} | {:14.1} | {:.1}\n",
                row.range_m,
                row.median_m,
                row.p95_m,
                100.0 * row.within_10_cm,
                100.0 * row.global,
            );
        }
        // Nobody may be listening any more.
        let _ = out.write_all(text.as_bytes());
    }
    Ok(())
}

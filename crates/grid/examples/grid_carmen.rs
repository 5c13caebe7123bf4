//! Prints how well the scans of CARMEN logs make a map and are localised in it.
//!
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
        // Nobody may be listening any more.
        let _ = out.write_all(format!("{path}: {}", report.table()).as_bytes());
    }
    Ok(())
}

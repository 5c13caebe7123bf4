//! Are boxes found again that are put into a recorded CARMEN log? Prints what was found:
//! `cargo run --release -p fremen-grid --example grid_injected -- LOG [PATROLS] [SEED]`

use std::io::Write as _;

use fremen_grid::experiment::{DAILY_BY, InjectedConfig, injected};
use fremen_grid::scan::read_carmen;
use fremen_grid::{Error, ErrorKind, Result};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize| arguments.get(at).and_then(|text| text.parse::<u64>().ok());
    let path = arguments
        .first()
        .ok_or_else(|| Error::new(ErrorKind::Config, "no log is named"))?;
    let usual = InjectedConfig::default();
    let config = InjectedConfig {
        num_patrols: number(1).map_or(usual.num_patrols, |it| it as usize),
        seed: number(2).unwrap_or(usual.seed),
        draws: false,
        ..usual
    };
    let report = injected(&read_carmen(path)?, &config)?;
    let text = format!(
        "{:#?}\n{:#?}\n{:#?}\npredicted by {DAILY_BY:?}\n",
        report.sudden, report.daily, report.moved
    );
    // Nobody may be listening any more.
    let _ = std::io::stdout().write_all(text.as_bytes());
    Ok(())
}

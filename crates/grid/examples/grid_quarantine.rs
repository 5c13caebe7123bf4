//! How does a grid deal with corrupted maps, and with furniture that was moved? Prints a table:
//! `cargo run --release -p fremen-grid --example grid_quarantine -- [OFFICES] [FIRST_SEED] [dev]
//! [moved] [list]`

use std::io::Write as _;

use fremen_grid::Result;
use fremen_grid::experiment::{QuarantineConfig, quarantine};
use fremen_grid::simulation::Layout;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let has = |word: &str| arguments.iter().any(|argument| argument == word);
    let number = |at: usize| arguments.get(at).and_then(|text| text.parse::<u64>().ok());
    let (count, first) = (number(0).unwrap_or(10), number(1).unwrap_or(20));
    let mut config = QuarantineConfig {
        seeds: (first..first + count).collect(),
        ..QuarantineConfig::default()
    };
    if has("dev") {
        config.layout = Layout::Development;
        config.seeds = (100..100 + count).collect();
    }
    if has("moved") {
        config.rearranged_at = Some(40);
        config.corrupted = 0.0;
    }
    let report = quarantine(&config)?;
    let mut text = report.table();
    if has("list") {
        for office in &report.offices {
            for (number, (with, without)) in
                office.guarded.iter().zip(&office.unguarded).enumerate()
            {
                text += &[
                    format!(
                        "{} {number:2} {:8}",
                        office.seed,
                        format!("{:?}", with.corruption)
                    ),
                    format!(
                        " with: {:.3} {:.3} {:.3}",
                        with.disagreement, with.error, with.lost_by_m
                    ),
                    format!(
                        " {}{}",
                        u8::from(with.is_quarantined),
                        u8::from(with.is_adopted)
                    ),
                    format!(
                        " without: {:.3} {:.3} ",
                        without.disagreement, without.error
                    ),
                    format!("{:.3}\n", without.lost_by_m),
                ]
                .concat();
            }
        }
    }
    // Nobody may be listening any more.
    let _ = std::io::stdout().write_all(text.as_bytes());
    Ok(())
}

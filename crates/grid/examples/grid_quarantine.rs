//! How does a grid deal with corrupted maps, and with furniture that was moved? Prints a table:
//! `cargo run --release -p fremen-grid --example grid_quarantine -- [OFFICES] [FIRST_SEED] [dev]
//! [moved] [guarded] [list]`

use std::fmt::Write as _;
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
    if has("guarded") {
        config.with_unguarded = false;
    }
    if has("moved") {
        config.rearranged_at = Some(40);
        config.corrupted = 0.0;
    }
    let report = quarantine(&config)?;
    let mut text = report.table();
    if has("list") {
        for office in &report.offices {
            for (number, patrol) in office.guarded.iter().enumerate() {
                let _ = writeln!(
                    text,
                    "{} {number:2} {:8} wrong {:.4} expected {:.4} limit {:.4} error {:.4} lost \
                     {:.3} {}{}",
                    office.seed,
                    format!("{:?}", patrol.corruption),
                    patrol.disagreement,
                    patrol.expected,
                    patrol.limit,
                    patrol.error,
                    patrol.lost_by_m,
                    patrol.reason.map_or(String::new(), |it| format!("{it:?}")),
                    if patrol.is_adopted { " adopted" } else { "" },
                );
            }
        }
    }
    // Nobody may be listening any more.
    let _ = std::io::stdout().write_all(text.as_bytes());
    Ok(())
}

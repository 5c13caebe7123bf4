//! Prints how well a day of detections of people foretells others.
//!
//! `cargo run --release -p fremen-grid --example grid_presence -- LEARNT FORESEEN`

use std::io::Write as _;

use fremen_grid::experiment::{Detections, PresenceConfig, presence, presence_table};
use fremen_grid::{Error, ErrorKind, Result};

fn main() -> Result<()> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [learnt, foreseen] = &paths[..] else {
        let message = "two files of detections are needed";
        return Err(Error::new(ErrorKind::Config, message));
    };
    let (learnt, foreseen) = (Detections::read(learnt)?, Detections::read(foreseen)?);
    let results = presence(&learnt, &foreseen, &PresenceConfig::default())?;
    // Nobody may be listening any more.
    let _ = std::io::stdout().write_all(presence_table(&results).as_bytes());
    Ok(())
}

//! Recorded scans: is the map right, and does the robot find itself in it?

use std::path::Path;

use anyhow::Result;
use fremen_grid::experiment::{CarmenConfig, carmen};
use fremen_grid::scan::read_carmen;

use super::recordings::recordings;
use super::results::{Cell, GridResults, GridTable};
use crate::progress::Progress;

/// The range at which localisation is judged.
const JUDGED_M: f64 = 5.0;

pub(super) fn run(folder: &Path, results: &mut GridResults) -> Result<()> {
    let names = recordings(folder, "log")?;
    results.setup.push(
        "a map of four fifths of the scans of each log; the others are localised in it, with noise added \
         to the motion between corrected poses, because the logs have no raw odometry"
            .into(),
    );
    results.notes.push(
        "A log is one session: there is no other day to predict. So there are no baselines but the \
         corrected poses, which are the oracle"
            .into(),
    );
    let mut walls = GridTable::new(
        "walls",
        "Do the walls lie where the scans end?",
        "log",
        &[
            ("mapped", "scans mapped", 0),
            ("localized", "scans localised", 0),
            ("within_one_cell", "ends within one cell of a wall %", 1),
        ],
    );
    let bar = Progress::new(names.len(), "logs");
    let mut tables = Vec::new();
    for name in &names {
        let log = read_carmen(folder.join(name))?;
        let report = carmen(&log, &CarmenConfig::default())?;
        bar.inc();
        walls.push(
            name,
            false,
            &[
                Some(Cell::exact(report.num_mapped as f64)),
                Some(Cell::exact(report.num_localized as f64)),
                Some(Cell::exact(100.0 * report.within_one_cell)),
            ],
        );
        let short = name.split(['.', '-']).next().unwrap_or(name);
        let mut table = GridTable::new(
            &format!("ranges-{short}"),
            &format!("{name}: localisation at trimmed ranges"),
            "range m",
            &[
                ("median_m", "median m", 3),
                ("p95_m", "95 % m", 3),
                ("within_10_cm", "within 0.1 m %", 1),
                ("global", "found from anywhere %", 1),
            ],
        );
        for row in &report.ranges {
            let near = (row.within_10_cm * report.num_localized as f64).round() as usize;
            table.push(
                &row.range_m.to_string(),
                false,
                &[
                    Some(Cell::exact(row.median_m)),
                    Some(Cell::exact(row.p95_m)),
                    Some(Cell::share(near, report.num_localized)),
                    Some(Cell::exact(100.0 * row.global)),
                ],
            );
            if row.range_m == JUDGED_M {
                results.target(
                    row.within_10_cm >= 0.95,
                    &format!("{short}: at {JUDGED_M} m at least 95 % within 0.1 m"),
                    format!("{:.1} %", 100.0 * row.within_10_cm),
                );
            }
        }
        tables.push(table);
    }
    results.tables.push(walls);
    results.tables.extend(tables);
    Ok(())
}

//! Recorded scans: is the map right, and does the robot find itself in it?

use std::path::Path;

use anyhow::Result;
use fremen_grid::experiment::{
    CarmenConfig, DAILY_BY, Daily, InjectedConfig, InjectedReport, RangeResult, carmen, injected,
};
use fremen_grid::scan::read_carmen;

use super::recordings::recordings;
use super::results::{Cell, Curve, GridResults, GridTable, Picture, Plot};
use crate::progress::Progress;

/// By which of [`DAILY_BY`] boxes of every day are judged: the rhythms, without the last observation.
const JUDGED_DAILY: usize = 3;
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
    let bar = Progress::new(2 * names.len(), "logs");
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
        plot(short, &report.ranges, results);
        let changes = injected(&log, &InjectedConfig::default())?;
        bar.inc();
        tables.extend(change_tables(short, &changes));
        judge_changes(short, &changes, results);
        draw_changes(short, changes, results);
    }
    results.tables.push(walls);
    results.tables.extend(tables);
    Ok(())
}

/// The error over the range.
fn plot(short: &str, ranges: &[RangeResult], results: &mut GridResults) {
    let curve = |name: &str, of: fn(&RangeResult) -> f64| Curve {
        name: name.to_owned(),
        points: (ranges.iter())
            .map(|row| (row.range_m, 100.0 * of(row)))
            .collect(),
    };
    results.plots.push(Plot {
        title: format!("Where is the robot? {short}, error over the range of the laser"),
        axes: ["range, m".into(), "error, cm".into()],
        curves: vec![
            curve("median", |row| row.median_m),
            curve("95 % of scans are nearer", |row| row.p95_m),
        ],
    });
}

fn change_tables(short: &str, report: &InjectedReport) -> Vec<GridTable> {
    let mut sudden = GridTable::new(
        &format!("sudden-{short}"),
        &format!("{short}: boxes put into one patrol of five"),
        "boxes",
        &[
            ("changed", "patrols with boxes", 0),
            ("changed_held", "quarantined %", 1),
            ("unchanged", "patrols without", 0),
            ("unchanged_held", "quarantined %", 1),
        ],
    );
    for it in &report.sudden {
        sudden.push(
            &it.num_boxes.to_string(),
            false,
            &[
                Some(Cell::exact(it.num_changed as f64)),
                Some(Cell::share(it.num_changed_held, it.num_changed)),
                Some(Cell::exact(it.num_unchanged as f64)),
                Some(Cell::share(it.num_unchanged_held, it.num_unchanged)),
            ],
        );
    }
    let mut daily = GridTable::new(
        &format!("daily-{short}"),
        &format!("{short}: boxes from 8 to 18 o'clock, foreseen in the last two days"),
        "predicted by",
        &[
            ("there", "cells seen with a box", 0),
            ("there_right", "foreseen %", 1),
            ("gone", "seen without", 0),
            ("gone_right", "foreseen %", 1),
        ],
    );
    let it = &report.daily;
    let rows = (it.num_there_foreseen.into_iter()).zip(it.num_gone_foreseen);
    for (name, (there, gone)) in DAILY_BY.into_iter().zip(rows) {
        let share = |right: u64, all: u64| Some(Cell::exact(percent(right, all)));
        daily.push(
            name,
            name == DAILY_BY[JUDGED_DAILY],
            &[
                Some(Cell::exact(it.num_there as f64)),
                share(there, it.num_there),
                Some(Cell::exact(it.num_gone as f64)),
                share(gone, it.num_gone),
            ],
        );
    }
    let mut moved = GridTable::new(
        &format!("moved-{short}"),
        &format!("{short}: boxes that come and stay"),
        "boxes",
        &[
            ("held", "quarantined before they are believed", 0),
            ("believed_with", "believed with patrol", 0),
            ("is_adopted", "by recognising it", 0),
            ("there", "their cells seen after five patrols", 0),
            ("there_right", "foreseen %", 1),
        ],
    );
    let it = &report.moved;
    moved.push(
        &it.num_boxes.to_string(),
        false,
        &[
            Some(Cell::exact(it.num_held as f64)),
            Some(Cell::exact((it.believed_after + 1) as f64)),
            Some(Cell::exact(f64::from(u8::from(it.is_adopted)))),
            Some(Cell::exact(it.num_there as f64)),
            Some(Cell::exact(percent(it.num_there_foreseen, it.num_there))),
        ],
    );
    vec![sudden, daily, moved]
}

fn percent(part: u64, all: u64) -> f64 {
    100.0 * part as f64 / all.max(1) as f64
}

/// What is put in has to be found again: as quarantine, or as a new rhythm.
fn judge_changes(short: &str, report: &InjectedReport, results: &mut GridResults) {
    if let Some(most) = report.sudden.last() {
        results.target(
            most.num_changed_held == most.num_changed && most.num_changed > 0,
            &format!("{short}: {} sudden boxes are quarantined", most.num_boxes),
            format!("{} of {}", most.num_changed_held, most.num_changed),
        );
    }
    let unchanged: usize = report.sudden.iter().map(|it| it.num_unchanged).sum();
    let held: usize = report.sudden.iter().map(|it| it.num_unchanged_held).sum();
    results.target(
        held as f64 <= 0.02 * unchanged as f64,
        &format!("{short}: at most 2 % of unchanged maps"),
        format!("{held} of {unchanged}"),
    );
    let Daily {
        num_there,
        num_there_foreseen,
        num_gone,
        num_gone_foreseen,
        num_cells,
        num_of_a_day,
        num_held,
        ..
    } = report.daily;
    let (there, gone) = (
        percent(num_there_foreseen[JUDGED_DAILY], num_there),
        percent(num_gone_foreseen[JUDGED_DAILY], num_gone),
    );
    results.target(
        there >= 90.0 && gone >= 90.0 && num_held == 0,
        &format!("{short}: boxes of every day are foreseen, both ways, in 90 % of their cells"),
        format!(
            "{there:.1} % there, {gone:.1} % gone by {}, {num_held} maps held",
            DAILY_BY[JUDGED_DAILY]
        ),
    );
    let share = percent(num_of_a_day, num_cells);
    results.target(
        share >= 90.0,
        &format!("{short}: a day is the strongest rhythm of 90 % of these cells"),
        format!("{share:.1} % of {num_cells}"),
    );
    results.target(
        report.moved.believed_after < 5,
        &format!("{short}: boxes that stay are believed within five patrols"),
        format!("with patrol {}", report.moved.believed_after + 1),
    );
}

fn draw_changes(short: &str, report: InjectedReport, results: &mut GridResults) {
    let seen = |is_changed: bool| Curve {
        name: if is_changed {
            "changed maps".into()
        } else {
            "unchanged maps".into()
        },
        points: (report.seen.iter().enumerate())
            .filter(|(_, it)| it.2 == is_changed)
            .map(|(number, it)| (number as f64 / 8.0, 100.0 * it.0))
            .collect(),
    };
    let limits = report.seen.iter().enumerate();
    let limit = Curve {
        name: "limit".into(),
        points: limits
            .filter(|(_, it)| it.1.is_finite())
            .map(|(number, it)| (number as f64 / 8.0, 100.0 * it.1))
            .collect(),
    };
    results.plots.push(Plot {
        title: format!("What did the guard see? {short}"),
        axes: ["day".into(), "contradicts the prediction, %".into()],
        curves: vec![seen(false), seen(true), limit],
    });
    let picture = |(title, png): (String, Vec<u8>)| Picture { title, png };
    results.pictures.push((
        format!("What was put into {short}, and what became of it?"),
        "Boxes from 8 to 18 o'clock as they are predicted for four hours of the day after, the cells' \
         rhythms (a day is yellow to green), and maps in quarantine: red surfaces were not predicted, \
         blue ones are missing. Blue-grey was never seen"
            .into(),
        report.pictures.into_iter().map(picture).collect(),
    ));
}

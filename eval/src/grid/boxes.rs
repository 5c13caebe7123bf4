//! The thesis' boxes: which local maps are foreseen?

use anyhow::Result;
use fremen_grid::experiment::{
    BoxCounts, BoxesConfig, BoxesReport, OCCUPIED_FROM, PREDICTED_BY, boxes, boxes_gallery,
};
use fremen_grid::simulation::BoxPeriods;

use super::results::{Cell, Curve, GridResults, GridTable, Plot};
use crate::progress::Progress;

/// The four worlds of the table: name in links, in words, periods, noise.
const WORLDS: [(&str, &str, BoxPeriods, bool); 4] = [
    (
        "ideal",
        "Ideal sensors, periods that are candidates",
        BoxPeriods::Candidates,
        false,
    ),
    (
        "ideal-any",
        "Ideal sensors, any periods",
        BoxPeriods::Any,
        false,
    ),
    (
        "noisy",
        "Noisy sensors, periods that are candidates",
        BoxPeriods::Candidates,
        true,
    ),
    (
        "noisy-any",
        "Noisy sensors, any periods",
        BoxPeriods::Any,
        true,
    ),
];

/// Positions in [`PREDICTED_BY`]: what was chosen in the worlds of seeds 0 and 1, which are no part of
/// the suite, and the last observation.
const CHOSEN: usize = 3;
const LAST: usize = 4;
/// The threshold that was chosen there, by its position in [`OCCUPIED_FROM`].
const CAREFUL: usize = 1;
/// Minutes of the drive that are counted together.
const SLOT_MIN: f64 = 10.0;

pub(super) fn run(seeds: &[u64], results: &mut GridResults) -> Result<()> {
    results.setup.push(format!(
        "{} simulated worlds a table (seeds {} to {}), a robot that drives through boxes for two hours; a \
         local map of five seconds is predicted before it is observed, every 55 seconds from the second \
         hour on. Occupied is what has a probability above 0.5, in the last columns above {}",
        seeds.len(),
        seeds[0],
        seeds[seeds.len() - 1],
        OCCUPIED_FROM[CAREFUL]
    ));
    results.notes.push(
        "Recall is the share of measured obstacles that were predicted (the thesis: 74.0 ideal, 46.9 \
         noisy), which whoever predicts everything as occupied has in full; accuracy is over the cells \
         that were seen both free and occupied. The true boxes are the scene itself without the laser: \
         beams that graze the cell of a surface measure it as free, so even who knows everything about \
         the boxes is not right about all measured cells"
            .into(),
    );
    let bar = Progress::new(WORLDS.len() + 1, "worlds");
    for (id, title, periods, is_noisy) in WORLDS {
        let config = BoxesConfig {
            seeds: seeds.to_vec(),
            periods,
            is_noisy,
            ..BoxesConfig::default()
        };
        let report = boxes(&config)?;
        bar.inc();
        table(id, title, &report, results);
        judge(id, &report.counts, results);
        over_time(title, &report, results);
    }
    let config = BoxesConfig {
        is_noisy: true,
        ..BoxesConfig::default()
    };
    let gallery = boxes_gallery(seeds[0], &config)?;
    results.gallery(
        "What is predicted for minutes that nobody has seen?",
        &format!(
            "The noisy world {}, learnt from a drive of two hours, by {}. White is free, black \
             occupied, blue-grey was never seen; the truth knows the whole world",
            seeds[0], PREDICTED_BY[CHOSEN]
        ),
        "A period of 1,200 s is red, one of 300 s green to blue, one of 60 s violet; deeper colours are \
         stronger rhythms; grey is what never changes",
        gallery,
    );
    bar.inc();
    Ok(())
}

fn table(id: &str, title: &str, report: &BoxesReport, results: &mut GridResults) {
    let mut table = GridTable::new(
        id,
        title,
        "predicted by",
        &[
            ("obstacles", "measured obstacles", 0),
            ("recall", "recall %", 1),
            ("recall_changing", "recall of what changes %", 1),
            ("accuracy", "accuracy of what changes %", 1),
            ("careful_recall", "recall % above 0.35", 1),
            ("careful_accuracy", "accuracy % above 0.35", 1),
        ],
    );
    for (at, name) in PREDICTED_BY.iter().enumerate() {
        let ratio = |threshold: usize, of: fn(&BoxCounts) -> (u64, u64)| {
            let worlds = report.worlds.iter();
            Some(Cell::ratio_of_worlds(
                worlds.map(|world| of(&world[at][threshold])),
            ))
        };
        let recall = |it: &BoxCounts| (it.num_foreseen, it.num_obstacles);
        let accuracy = |it: &BoxCounts| (it.num_right, it.num_changing);
        table.push(
            name,
            at == CHOSEN,
            &[
                Some(Cell::exact(report.counts[at][0].num_obstacles as f64)),
                ratio(0, recall),
                ratio(0, |it| (it.num_boxes_foreseen, it.num_boxes)),
                ratio(0, accuracy),
                ratio(CAREFUL, recall),
                ratio(CAREFUL, accuracy),
            ],
        );
    }
    results.tables.push(table);
}

/// Recall of all models in the course of the drive.
fn over_time(title: &str, report: &BoxesReport, results: &mut GridResults) {
    let curves = PREDICTED_BY.iter().enumerate().map(|(at, name)| {
        let points = report.over_time.iter().enumerate().map(|(slot, counts)| {
            let minute = 60.0 + SLOT_MIN * (slot as f64 + 0.5);
            (minute, 100.0 * (1.0 - counts[at][0].accuracy()))
        });
        Curve {
            name: (*name).to_owned(),
            points: points.collect(),
        }
    });
    results.plots.push(Plot {
        title: format!("{title}: wrong among the cells that change"),
        axes: ["minute of the drive".into(), "wrong, %".into()],
        curves: curves.collect(),
    });
}

/// What is wanted of the form that was chosen.
fn judge(id: &str, counts: &[[BoxCounts; 2]], results: &mut GridResults) {
    let recall = |at: usize| 100.0 * counts[at][CAREFUL].recall();
    let accuracy = |at: usize| 100.0 * counts[at][CAREFUL].accuracy();
    let last = 100.0 * counts[LAST][0].accuracy();
    let wanted = match id {
        "ideal" => 95.0,
        "noisy" => 75.0,
        _ => return,
    };
    results.target(
        recall(CHOSEN) >= wanted,
        &format!("{id}, recall >= {wanted} %"),
        format!(
            "{:.1} % by {} above {}",
            recall(CHOSEN),
            PREDICTED_BY[CHOSEN],
            OCCUPIED_FROM[CAREFUL]
        ),
    );
    results.target(
        accuracy(CHOSEN) > last,
        &format!("{id}, at that recall more accurate than the last observation"),
        format!("{:.1} % against {last:.1} %", accuracy(CHOSEN)),
    );
}

//! An office that robots patrol: where are they, which maps are believed, which ways are free?
//! (IROS 2016, figures 6 and 7, table I)

use anyhow::Result;
use fremen_grid::experiment::{
    Corruption, JourneyCounts, JourneysConfig, MAPS, OfficePatrols, PLANNED_IN, PassesConfig,
    PassesReport, QuarantineConfig, QuarantineReport, gallery, journeys, passes, quarantine,
};
use fremen_grid::simulation::Layout;

use super::results::{Cell, Curve, GridResults, GridTable, Picture, Plot};
use crate::progress::Progress;

/// Positions in [`MAPS`] and [`PLANNED_IN`].
const NIGHT: usize = 0;
const AVERAGED: usize = 1;
const PREDICTED: usize = 3;
const ORACLE: usize = 4;
/// The patrol from which on furniture stands elsewhere, where it is moved.
const MOVED_AT: usize = 40;
/// What colours of rhythms mean.
pub(super) const DAYS_IN_COLOURS: &str = "A week is red, a day yellow to green, an hour blue; deeper \
    colours are stronger rhythms; grey is what never changes";
/// Side of a cell of the pictures, in metres.
const PICTURE_M: f64 = 0.05;

pub(super) fn run(seeds: &[u64], results: &mut GridResults) -> Result<()> {
    results.setup.push(format!(
        "{} simulated offices (seeds {} to {}, the layout that no constant was chosen in)",
        seeds.len(),
        seeds[0],
        seeds[seeds.len() - 1]
    ));
    let bar = Progress::new(5, "experiments");
    let seeds = seeds.to_vec();
    let guarding = QuarantineConfig {
        seeds: seeds.clone(),
        ..QuarantineConfig::default()
    };
    let guarded = quarantine(&guarding)?;
    bar.inc();
    corrupted(&guarded, results);
    let moved = quarantine(&QuarantineConfig {
        rearranged_at: Some(MOVED_AT),
        corrupted: 0.0,
        with_unguarded: false,
        ..guarding
    })?;
    bar.inc();
    rearranged(&moved, results);
    let report = passes(&PassesConfig {
        seeds: seeds.clone(),
        ..PassesConfig::default()
    })?;
    bar.inc();
    localised(&report, results);
    let offices = journeys(&JourneysConfig {
        seeds: seeds.clone(),
        ..JourneysConfig::default()
    })?;
    bar.inc();
    ways(&offices.offices, results);
    draw(seeds[0], results)?;
    bar.inc();
    Ok(())
}

fn localised(report: &PassesReport, results: &mut GridResults) {
    let mut table = GridTable::new(
        "passes",
        "Localisation by map: median of the passes' mean position errors, m",
        "range m",
        &[
            ("night", MAPS[NIGHT], 3),
            ("averaged", MAPS[AVERAGED], 3),
            ("last", MAPS[2], 3),
            ("predicted", MAPS[PREDICTED], 3),
            ("oracle", MAPS[ORACLE], 3),
            ("against_averaged_mm", "predicted - averaged, mean, mm", 2),
            ("above", "predicted above 0.15 m, %", 1),
        ],
    );
    let mut curves: Vec<Curve> = (MAPS.iter())
        .map(|name| Curve {
            name: (*name).to_owned(),
            points: Vec::new(),
        })
        .collect();
    let (mut worst_ratio, mut worst_lead, mut worst_share) = (0.0_f64, f64::NEG_INFINITY, 0.0_f64);
    for (range, &range_m) in report.ranges_m.iter().enumerate() {
        let [mean, low, high] = report.against_averaged_m(range).map(|it| 1e3 * it);
        let share = 100.0 * report.share_above(range, PREDICTED, 0.15);
        let medians: Vec<f64> = (0..MAPS.len())
            .map(|map| report.median_m(range, map))
            .collect();
        let mut cells: Vec<Option<Cell>> =
            medians.iter().map(|&it| Some(Cell::exact(it))).collect();
        cells.push(Some(Cell::between(mean, low, high)));
        cells.push(Some(Cell::exact(share)));
        table.push(&range_m.to_string(), false, &cells);
        for (curve, median) in curves.iter_mut().zip(&medians) {
            curve.points.push((range_m, 100.0 * median));
        }
        worst_ratio = worst_ratio.max(medians[PREDICTED] / medians[ORACLE]);
        worst_lead = worst_lead.max(low);
        if (2.0..=6.0).contains(&range_m) {
            worst_share = worst_share.max(share);
        }
    }
    results.tables.push(table);
    results.plots.push(Plot {
        title: "Where is the robot? Error over the range of the laser".into(),
        axes: ["range, m".into(), "median error, cm".into()],
        curves,
    });
    results.target(
        worst_ratio <= 1.15,
        "median error at most 1.15 x the oracle's at every range",
        format!("{worst_ratio:.2} x at the worst"),
    );
    results.target(
        worst_lead <= 0.0,
        "nowhere worse than the averaged map beyond the interval",
        format!("lower end of the difference at the worst {worst_lead:+.2} mm"),
    );
    results.target(
        worst_share <= 1.0,
        "at most 1 % of passes above 0.15 m at 2 to 6 m",
        format!("{worst_share:.1} %"),
    );
}

fn corrupted(report: &QuarantineReport, results: &mut GridResults) {
    let mut table = GridTable::new(
        "quarantine",
        "Corrupted maps among good ones: what the guard does",
        "office",
        &[
            ("corrupted", "corrupted", 0),
            ("corrupted_held", "quarantined %", 1),
            ("good", "good", 0),
            ("good_held", "quarantined %", 1),
            ("guarded", "wrong at the end, guarded %", 1),
            ("unguarded", "unguarded %", 1),
        ],
    );
    let mut push = |name: &str, part: &QuarantineReport| {
        let (corrupted, good) = (part.corrupted(), part.good());
        let [guarded, unguarded] = part.final_errors();
        table.push(
            name,
            false,
            &[
                Some(Cell::exact(corrupted.0 as f64)),
                Some(Cell::share(corrupted.1, corrupted.0)),
                Some(Cell::exact(good.0 as f64)),
                Some(Cell::share(good.1, good.0)),
                Some(Cell::exact(100.0 * guarded)),
                Some(Cell::exact(100.0 * unguarded)),
            ],
        );
    };
    for office in &report.offices {
        let alone = QuarantineReport {
            offices: vec![office.clone()],
            num_trusted: report.num_trusted,
        };
        push(&format!("seed {}", office.seed), &alone);
    }
    push("all", report);
    results.tables.push(table);
    judge_guard(report, results);
    draw_guard(report, results);
}

fn judge_guard(report: &QuarantineReport, results: &mut GridResults) {
    let (corrupted, good) = (report.corrupted(), report.good());
    results.target(
        corrupted.0 == corrupted.1,
        "all corrupted maps quarantined",
        format!("{} of {}", corrupted.1, corrupted.0),
    );
    results.target(
        good.1 as f64 <= 0.02 * good.0 as f64,
        "at most 2 % of good ones",
        format!("{} of {}", good.1, good.0),
    );
    let [guarded, unguarded] = report.final_errors();
    results.target(
        guarded < unguarded,
        "without the guard the grid is harmed",
        format!(
            "wrong at the end {:.1} % against {:.1} %",
            100.0 * guarded,
            100.0 * unguarded
        ),
    );
}

/// The error day by day, and what the guard saw.
fn draw_guard(report: &QuarantineReport, results: &mut GridResults) {
    let mean = |of: &dyn Fn(&OfficePatrols) -> &Vec<fremen_grid::experiment::PatrolResult>| {
        let num = report
            .offices
            .iter()
            .map(|it| of(it).len())
            .max()
            .unwrap_or(0);
        (0..num)
            .map(|number| {
                let errors = report.offices.iter().filter_map(|it| of(it).get(number));
                let errors: Vec<f64> = errors.map(|it| 100.0 * it.error).collect();
                let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
                // Eight patrols a day.
                (number as f64 / 8.0, mean)
            })
            .collect()
    };
    results.plots.push(Plot {
        title: "Does the grid survive? Wrong cells near surfaces, day by day".into(),
        axes: ["day".into(), "wrong, %".into()],
        curves: vec![
            Curve {
                name: "guarded".into(),
                points: mean(&|it| &it.guarded),
            },
            Curve {
                name: "unguarded".into(),
                points: mean(&|it| &it.unguarded),
            },
        ],
    });
    if let Some(office) = report.offices.first() {
        results.plots.push(evidence(office));
    }
    let pictures = report.offices.iter().filter_map(|it| {
        let (title, png) = it.evidence.clone()?;
        Some(Picture {
            title: format!("office {}, {title}", it.seed),
            png,
        })
    });
    results.pictures.push((
        "What speaks against a map in quarantine?".into(),
        "The last quarantined map of each of four offices. Red surfaces were not predicted, blue ones \
         were predicted and are not there; blue-grey was not seen"
            .into(),
        pictures.take(4).collect(),
    ));
}

/// What the guard saw in one office: each map, its limit, and which of them were corrupted.
fn evidence(office: &OfficePatrols) -> Plot {
    let day = |number: usize| number as f64 / 8.0;
    let of = |is_meant: &dyn Fn(Corruption) -> bool| {
        let patrols = office.guarded.iter().enumerate();
        let meant = patrols.filter(|(_, it)| is_meant(it.corruption));
        meant
            .map(|(number, it)| (day(number), 100.0 * it.disagreement))
            .collect()
    };
    let limits = office
        .guarded
        .iter()
        .enumerate()
        .filter(|(_, it)| it.limit.is_finite());
    Plot {
        title: format!("What did the guard see in office {}?", office.seed),
        axes: ["day".into(), "contradicts the prediction, %".into()],
        curves: vec![
            Curve {
                name: "good maps".into(),
                points: of(&|it| it == Corruption::None),
            },
            Curve {
                name: "corrupted maps".into(),
                points: of(&|it| it != Corruption::None),
            },
            Curve {
                name: "limit".into(),
                points: limits
                    .map(|(number, it)| (day(number), 100.0 * it.limit))
                    .collect(),
            },
        ],
    }
}

fn rearranged(report: &QuarantineReport, results: &mut GridResults) {
    let mut table = GridTable::new(
        "rearranged",
        &format!("Furniture that is moved before patrol {MOVED_AT}"),
        "office",
        &[
            ("held", "quarantined before it is believed", 0),
            ("believed_with", "believed with patrol", 0),
            ("is_adopted", "by recognising it", 0),
            ("held_before", "good maps quarantined before", 0),
        ],
    );
    let (mut num_soon, mut num_before, mut num_good) = (0, 0, 0);
    for office in &report.offices {
        let (before, after) = office.guarded.split_at(MOVED_AT.min(office.guarded.len()));
        let judged = &before[report.num_trusted.min(before.len())..];
        let held = after.iter().filter(|patrol| patrol.is_quarantined).count();
        let held_before = judged.iter().filter(|patrol| patrol.is_quarantined).count();
        // The first patrol from which on no map is held.
        let last = after.iter().rposition(|patrol| patrol.is_quarantined);
        let believed = last.map_or(0, |at| at + 1);
        let is_adopted = after.iter().any(|patrol| patrol.is_adopted);
        num_soon += usize::from(believed < 5);
        num_before += held_before;
        num_good += judged.len();
        table.push(
            &format!("seed {}", office.seed),
            false,
            &[
                Some(Cell::exact(held as f64)),
                Some(Cell::exact((believed + 1) as f64)),
                Some(Cell::exact(f64::from(u8::from(is_adopted)))),
                Some(Cell::exact(held_before as f64)),
            ],
        );
    }
    results.tables.push(table);
    results.target(
        num_soon == report.offices.len(),
        "a rearrangement is believed within five patrols",
        format!("in {num_soon} of {} offices", report.offices.len()),
    );
    results.notes.push(format!(
        "Where furniture is moved, {num_before} of {num_good} maps before that were quarantined"
    ));
}

fn ways(offices: &[[JourneyCounts; 5]], results: &mut GridResults) {
    let mut table = GridTable::new(
        "journeys",
        "Ways that are planned: how often is one blocked?",
        "planned in",
        &[
            ("blocked", "blocked %", 1),
            ("replans", "new plans a journey", 2),
            ("way_m", "mean way m", 1),
            ("brier", "Brier of p(free)", 3),
        ],
    );
    let sum = |of: &dyn Fn(&[JourneyCounts; 5]) -> f64| offices.iter().map(of).sum::<f64>();
    let ratio = |map: usize, part: fn(&JourneyCounts) -> f64, all: fn(&JourneyCounts) -> f64| {
        sum(&|office| part(&office[map])) / sum(&|office| all(&office[map])).max(1.0)
    };
    for (map, name) in PLANNED_IN.iter().enumerate() {
        let blocked = Cell::ratio_of_worlds(offices.iter().map(|office| {
            (
                office[map].num_blocked as u64,
                office[map].num_journeys as u64,
            )
        }));
        let planned =
            |it: &JourneyCounts| (it.num_journeys - it.num_given_up.min(it.num_journeys)) as f64;
        table.push(
            name,
            map == PREDICTED,
            &[
                Some(blocked),
                Some(Cell::exact(ratio(
                    map,
                    |it| it.num_replans as f64,
                    |it| it.num_journeys as f64,
                ))),
                Some(Cell::exact(ratio(
                    map,
                    |it| it.driven_m,
                    |it| it.num_arrived as f64,
                ))),
                Some(Cell::exact(ratio(map, |it| it.brier_sum, planned))),
            ],
        );
    }
    let blocked = |map: usize| sum(&|office| office[map].num_blocked as f64);
    let fewer = 100.0 * (1.0 - blocked(PREDICTED) / blocked(NIGHT).max(1.0));
    results.tables.push(table);
    results.target(
        fewer >= 35.0,
        "at least 35 % fewer blocked plans than in the static map",
        format!(
            "{fewer:.0} % fewer ({} against {})",
            blocked(PREDICTED),
            blocked(NIGHT)
        ),
    );
}

fn draw(seed: u64, results: &mut GridResults) -> Result<()> {
    let gallery = gallery(seed, Layout::Paper, PICTURE_M)?;
    results.gallery(
        "What is predicted for a day that nobody has seen?",
        &format!(
            "Office {seed}, learnt from two weeks of patrols every two hours; the second Tuesday after. \
             White is free, black occupied, blue-grey was never seen; the truth knows the whole office"
        ),
        DAYS_IN_COLOURS,
        gallery,
    );
    Ok(())
}

//! An office that is watched for weeks: how fast, how small, how right?

use anyhow::Result;
use fremen_grid::experiment::{OfficeConfig, OfficeReport, office};

use super::process::{cpu_s, peak_bytes};
use super::results::{Cell, Curve, GridResults, GridTable, Picture, Plot};
use crate::progress::Progress;

/// What a static map gets wrong, and what the best model of the paper may at most.
const WANTED_OF_STATIC: f64 = 0.6;

pub(super) fn run(seeds: &[u64], results: &mut GridResults) -> Result<()> {
    results.setup.push(
        "a simulated office after T-RO 2017, section VI: 213,000 voxels, a frame every 5 s, 112 days; \
         times are those of the processor, on one thread with RAYON_NUM_THREADS=1"
            .into(),
    );
    results.notes.push(
        "Errors are over the voxels that ever changed, on every 301st frame. The oracle is the history \
         itself, right by definition; the last observation says nothing of earlier frames"
            .into(),
    );
    let bar = Progress::new(seeds.len(), "offices");
    let mut reports = Vec::new();
    for &seed in seeds {
        let config = OfficeConfig {
            seed,
            ..OfficeConfig::default()
        };
        reports.push((seed, office(&config, &cpu_s)?));
        bar.inc();
    }
    drop(bar);
    size(&reports, results);
    models(&reports, results);
    targets(&reports, results);
    draw(reports, results);
    Ok(())
}

/// The models that are drawn day by day.
const DRAWN: [&str; 5] = [
    "static (mean)",
    "FreMEn day/1..24, order 2",
    "FreMEn week/1..168, order 2",
    "FreMEn week/1..168, order 5",
    "histogram, hours of a week",
];

/// The error day by day, and the predicted day after of the first office.
fn draw(reports: Vec<(u64, OfficeReport)>, results: &mut GridResults) {
    let Some((seed, report)) = reports.into_iter().next() else {
        return;
    };
    let drawn = report
        .models
        .iter()
        .filter(|model| DRAWN.contains(&&*model.name));
    results.plots.push(Plot {
        title: format!("How wrong is each model, day by day? Office {seed}"),
        axes: ["day".into(), "wrong, %".into()],
        curves: drawn
            .map(|model| Curve {
                name: model.name.clone(),
                points: (model.by_day.iter().enumerate())
                    .map(|(day, error)| (day as f64, 100.0 * error))
                    .collect(),
            })
            .collect(),
    });
    let curve = |base: &str| {
        let of_base = report.models.iter().filter(|it| it.name.contains(base));
        let orders = (1..).zip(of_base.filter(|it| it.name.starts_with("FreMEn")));
        Curve {
            name: format!("periods of a {base}"),
            points: orders
                .map(|(order, it)| (f64::from(order), 100.0 * it.error / it.static_error))
                .collect(),
        }
    };
    results.plots.push(Plot {
        title: "What does each rhythm more bring?".into(),
        axes: ["order".into(), "of the static error, %".into()],
        curves: vec![curve("day"), curve("week")],
    });
    let mut pictures = report.pictures;
    let rhythms = pictures.pop();
    let picture = |(title, png): (String, Vec<u8>)| Picture { title, png };
    results.pictures.push((
        "What is predicted for the day after sixteen weeks?".into(),
        format!(
            "Office {seed} from above on a Monday, each pixel the most occupied voxel of its column; by \
             the periods of a week, order 5. White is free, black occupied"
        ),
        pictures.into_iter().map(picture).collect(),
    ));
    results.pictures.push((
        "Which rhythm has which cell?".into(),
        super::patrol::DAYS_IN_COLOURS.into(),
        rhythms.into_iter().map(picture).collect(),
    ));
}

fn size(reports: &[(u64, OfficeReport)], results: &mut GridResults) {
    let mut table = GridTable::new(
        "size",
        "How fast is it observed, and in how few bytes kept?",
        "office",
        &[
            ("changes", "changes", 0),
            ("observe_s", "observed in s", 2),
            ("rate", "1e9 cells/s", 1),
            ("log_mb", "logs MB", 1),
            ("bytes_per_changing", "bytes a changing voxel", 0),
            ("bytes_per_other", "bytes a voxel (tiles)", 2),
            ("packed_mb", "packed MB", 2),
            ("packed_ratio", "1 :", 0),
            ("varint_ratio", "varint x", 2),
            ("pack_s", "packed in s", 1),
            ("unpack_s", "unpacked in s", 1),
            ("is_lossless", "bit for bit", 0),
        ],
    );
    for (seed, it) in reports {
        let observed = it.num_frames as f64 * it.num_cells as f64;
        let values = [
            it.num_changes as f64,
            it.observe_s,
            observed / it.observe_s.max(1e-3) / 1e9,
            it.memory.log_bytes as f64 / 1e6,
            it.memory.log_bytes as f64 / it.memory.num_changing_cells.max(1) as f64,
            it.memory.tile_bytes as f64 / it.num_cells as f64,
            it.packed_bytes as f64 / 1e6,
            it.raw_bytes() / it.packed_bytes as f64,
            it.varint_bytes as f64 / it.packed_bytes as f64,
            it.pack_s[0],
            it.pack_s[1],
            f64::from(u8::from(it.is_lossless)),
        ];
        let cells = values.map(|value| Some(Cell::exact(value)));
        table.push(&format!("seed {seed}"), false, &cells);
    }
    results.tables.push(table);
}

fn models(reports: &[(u64, OfficeReport)], results: &mut GridResults) {
    let mut table = GridTable::new(
        "models",
        "How right is each model, and in how few bytes?",
        "model",
        &[
            ("learn_s", "learnt in s", 1),
            ("error", "wrong %", 2),
            ("of_static", "of the static error", 3),
            ("kb", "rhythms kB", 0),
            ("ratio", "1 :", 0),
            ("lossy_error", "wrong by rhythms alone %", 2),
        ],
    );
    let Some((_, first)) = reports.first() else {
        return;
    };
    for (number, model) in first.models.iter().enumerate() {
        let all = || {
            reports
                .iter()
                .map(|(_, report)| (report, &report.models[number]))
        };
        let mean =
            |of: &dyn Fn(&OfficeReport, &fremen_grid::experiment::OfficeModel) -> Option<f64>| {
                let values: Option<Vec<f64>> =
                    all().map(|(report, model)| of(report, model)).collect();
                values.map(|it| Cell::exact(it.iter().sum::<f64>() / it.len().max(1) as f64))
            };
        table.push(
            &model.name,
            false,
            &[
                mean(&|_, it| Some(it.learn_s)),
                mean(&|_, it| Some(100.0 * it.error)),
                mean(&|_, it| Some(it.error / it.static_error)),
                mean(&|_, it| it.lossy.map(|(bytes, _)| bytes as f64 / 1e3)),
                mean(&|report, it| it.lossy.map(|(bytes, _)| report.raw_bytes() / bytes as f64)),
                mean(&|_, it| it.lossy.map(|(_, error)| 100.0 * error)),
            ],
        );
    }
    results.tables.push(table);
}

fn targets(reports: &[(u64, OfficeReport)], results: &mut GridResults) {
    let worst = |of: &dyn Fn(&OfficeReport) -> f64| {
        reports
            .iter()
            .map(|(_, it)| of(it))
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let built = |name: &'static str| {
        worst(&move |it: &OfficeReport| {
            let of = it.models.iter().filter(|model| model.name.contains(name));
            it.observe_s + of.map(|model| model.learn_s).fold(0.0, f64::max)
        })
    };
    let (day, week) = (built("day/1..24"), built("week/1..168"));
    results.target(
        day < 60.0,
        "built with 24 periods in < 60 s",
        format!("{day:.1} s"),
    );
    results.target(
        week < 180.0,
        "built with 168 periods in < 180 s",
        format!("{week:.1} s"),
    );
    if let Some(bytes) = peak_bytes() {
        let gb = bytes as f64 / 1e9;
        results.target(gb < 1.0, "peak memory < 1 GB", format!("{gb:.2} GB"));
    }
    let ratio = -worst(&|it| -(it.raw_bytes() / it.packed_bytes as f64));
    let varint = -worst(&|it| -(it.varint_bytes as f64 / it.packed_bytes as f64));
    let is_lossless = reports.iter().all(|(_, it)| it.is_lossless);
    results.target(
        is_lossless && ratio >= 500.0 && varint >= 2.0,
        "lossless bit for bit, 1:500 and half of varint runs",
        format!(
            "{}, 1:{ratio:.0}, {varint:.2} x smaller",
            if is_lossless {
                "the same"
            } else {
                "NOT THE SAME"
            }
        ),
    );
    let rate = -worst(&|it| -(it.num_frames as f64 * it.num_cells as f64 / it.observe_s.max(1e-3)));
    results.target(
        rate >= 1e9,
        "at least 1e9 cell observations/s",
        format!("{rate:.1e}"),
    );
    let best = worst(&|it| {
        let lossy = it.models.iter().filter_map(|model| {
            let (bytes, error) = model.lossy?;
            (it.raw_bytes() / bytes as f64 >= 1e4).then_some(error / model.static_error)
        });
        lossy.fold(f64::INFINITY, f64::min)
    });
    results.target(
        best <= WANTED_OF_STATIC,
        "rhythms alone, 1:10,000 or smaller, at most 60 % of the static error",
        format!("{:.0} % with the best order", 100.0 * best),
    );
}

//! People in a corridor: does one recorded day predict another?

use std::path::Path;

use anyhow::{Result, bail};
use fremen_grid::experiment::{
    Detections, PresenceConfig, PresenceResult, presence, presence_gallery,
};

use super::recordings::recordings;
use super::results::{Cell, Curve, GridResults, GridTable, Plot};

pub(super) fn run(folder: &Path, results: &mut GridResults) -> Result<()> {
    let names = recordings(folder, "txt")?;
    let [learnt, predicted @ ..] = &names[..] else {
        bail!("{}: no recorded days", folder.display());
    };
    if predicted.is_empty() {
        bail!(
            "{}: one recorded day, where two are needed (help: the first by name is learnt, the others \
             are predicted)",
            folder.display()
        );
    }
    let day = Detections::read(folder.join(learnt))?;
    results.setup.push(format!(
        "{learnt} is learnt; cells of 1 m, slots of a minute"
    ));
    results.notes.push(
        "The mean is the averaged map. The last minute of the learnt day says nothing of another day, and \
         the oracle, that day itself, has a Brier score of 0"
            .into(),
    );
    for (number, name) in predicted.iter().enumerate() {
        let other = Detections::read(folder.join(name))?;
        let found = presence(&day, &other, &PresenceConfig::default())?;
        let mut table = GridTable::new(
            &format!("day-{}", number + 1),
            &format!("{name} is predicted"),
            "model",
            &[
                ("brier", "Brier", 5),
                ("gain", "better than the mean by %", 1),
            ],
        );
        let mean = found.first().map_or(f64::NAN, |it| it.brier);
        for it in &found {
            let gain = 100.0 * (1.0 - it.brier / mean);
            table.push(
                it.name,
                it.name == "FreMEn, order 2",
                &[Some(Cell::exact(it.brier)), Some(Cell::exact(gain))],
            );
        }
        results.tables.push(table);
        plots(name, &found, results);
    }
    let other = Detections::read(folder.join(&predicted[0]))?;
    let gallery = presence_gallery(&day, &other, &PresenceConfig::default())?;
    results.gallery(
        "Where are people expected, and where were they?",
        &format!(
            "{}, learnt from {learnt}, by FreMEn of order 2; hours are counted from the beginning of the \
             recording. The darker, the more slots of a minute with somebody in the cell",
            predicted[0]
        ),
        super::patrol::DAYS_IN_COLOURS,
        gallery,
    );
    Ok(())
}

/// How many cells are expected to be occupied, hour by hour, and how wrong that is.
fn plots(name: &str, found: &[PresenceResult], results: &mut GridResults) {
    let drawn = ["mean", "histogram, 24 h", "FreMEn, order 2"];
    let of = |number: usize| {
        let models = found.iter().filter(|it| drawn.contains(&it.name));
        models.map(move |it| Curve {
            name: it.name.to_owned(),
            points: hours(it.by_hour.iter().map(|hour| hour[number])),
        })
    };
    let mut expected: Vec<Curve> = of(0).collect();
    if let Some(first) = found.first() {
        expected.push(Curve {
            name: "seen".to_owned(),
            points: hours(first.seen_by_hour.iter().copied()),
        });
    }
    let hour = "hour of the recording".to_owned();
    results.plots.push(Plot {
        title: format!("How much is going on? {name}"),
        axes: [hour.clone(), "occupied cells".into()],
        curves: expected,
    });
    results.plots.push(Plot {
        title: format!("How wrong is that, hour by hour? {name}"),
        axes: [hour, "Brier score".into()],
        curves: of(1).collect(),
    });
}

fn hours(values: impl Iterator<Item = f64>) -> Vec<(f64, f64)> {
    let numbered = values.enumerate();
    numbered.map(|(hour, it)| (hour as f64 + 0.5, it)).collect()
}

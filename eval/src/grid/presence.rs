//! People in a corridor: does one recorded day predict another?

use std::path::Path;

use anyhow::{Result, bail};
use fremen_grid::experiment::{Detections, PresenceConfig, presence};

use super::recordings::recordings;
use super::results::{Cell, GridResults, GridTable};

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
    }
    Ok(())
}

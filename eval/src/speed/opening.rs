//! How long does a robot wait for its map, and how much memory does the map take?
//!
//! The map of the section before is written to a file in a folder of its own and opened in three
//! ways, all of them warm, so that the disk has no part in it: read as a whole, fitted and
//! calibrated; by way of a query form that has to be made first; and by way of the one that is
//! there then. What was opened in different ways has to give the same answer. Last, how long it
//! takes to go on with a newer map in which one place has changed, predictions of all places with
//! it.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use chronotope::Time;
use chronotope::localize::{Localizer, LocalizerConfig, Query};
use chronotope::map::{Map, NodeId, Snapshot};

use super::measurement::Measurement;
use super::workload::Workload;

/// What the section is called.
pub(super) const SECTION: &str = "opening a map of 500 features a place";
/// Who opens it fast; the targets look for it.
pub(super) const BY_QUERY_FORM: &str = "by its query form";

/// Times a map is opened by its query form.
const NUM_TIMES: usize = 5;

/// Opens `snapshot` from a file.
pub(super) fn measure(
    workload: &Workload,
    snapshot: &Arc<Snapshot>,
    cfg: &LocalizerConfig,
    time: Time,
) -> Result<Vec<Measurement>> {
    let case = format!("{} places", snapshot.nodes().len());
    let row = |subject: &str, ms: &[f64]| Measurement::new(SECTION, &case, subject, ms);
    let num_features: usize = snapshot
        .nodes()
        .iter()
        .map(|node| node.features().len())
        .sum();
    let folder = tempfile::tempdir().context("no temporary folder")?;
    let path = folder.path().join("map");
    Map::create(&path, snapshot.meta().clone())?.commit(snapshot)?;
    let map_bytes = bytes_of(&path)?;

    let (whole, whole_ms) = timed(|| -> Result<Localizer> {
        Ok(Localizer::new(
            Map::open_read_only(&path)?.snapshot(),
            cfg.clone(),
        )?)
    })?;
    let newer = going_on(&whole, workload, time)?;
    let (_, making_ms) = timed(|| Ok(Localizer::open(&path, cfg.clone())?))?;
    let mut opening = Vec::new();
    let mut opened = None;
    for _ in 0..NUM_TIMES {
        // Two maps at a time would not be what a robot holds.
        drop(opened.take());
        let (localizer, ms) = timed(|| Ok(Localizer::open(&path, cfg.clone())?))?;
        opening.push(ms);
        opened = Some(localizer);
    }
    let mut query_bytes = 0;
    for entry in std::fs::read_dir(folder.path())? {
        let entry = entry?.path();
        query_bytes += if entry == path { 0 } else { bytes_of(&entry)? };
    }
    ensure!(query_bytes > 0, "no query form was kept");
    let mut first = Vec::new();
    if let (Some(opened), Some(features)) = (&opened, workload.queries.first()) {
        let query = Query::new(features).at(time);
        let (answer, ms) = timed(|| Ok(opened.localize(&mut opened.scratch(), &query)?))?;
        first.push(ms);
        ensure!(
            answer == whole.localize(&mut whole.scratch(), &query)?,
            "a map opened by its query form gives other answers"
        );
    }
    let per_feature = |bytes: u64| bytes as f64 / num_features as f64;
    Ok(vec![
        row("read, fitted, calibrated", &[whole_ms])
            .bytes_per_feature(per_feature(map_bytes))
            .note("the map file alone"),
        row("the same, query form made", &[making_ms]),
        row(BY_QUERY_FORM, &opening)
            .bytes_per_feature(per_feature(query_bytes))
            .note(format!("{num_features} features")),
        row("first answer after that", &first).note("one thread predicts its bucket"),
        row("going on, one place is newer", &newer).note("predictions of all places with it"),
    ])
}

/// Milliseconds that a localizer takes to go on with a newer map, in which one place forgot a
/// visit.
fn going_on(older: &Localizer, workload: &Workload, time: Time) -> Result<Vec<f64>> {
    let mut newer = Snapshot::clone(older.snapshot());
    let place = NodeId(newer.nodes().len() as u32 / 2);
    let node = newer.node(place);
    let mut visits = vec![true; node.visits().len()];
    ensure!(visits.pop().is_some(), "the map has no visits");
    let (shorter, _) = node.retained(&visits, &vec![true; node.features().len()])?;
    newer.replace_node(place, shorter)?;
    let newer = Arc::new(newer);
    let query = workload
        .queries
        .first()
        .map(|features| Query::new(features).at(time));
    // Nothing is predicted yet, so all of it will be made anew.
    let anew = older.with_snapshot(Arc::clone(&newer))?;
    older.prefetch(time);
    let mut took = Vec::new();
    for _ in 0..NUM_TIMES {
        let (localizer, ms) = timed(|| Ok(older.with_snapshot(Arc::clone(&newer))?))?;
        took.push(ms);
        if let Some(query) = &query {
            ensure!(
                localizer.localize(&mut localizer.scratch(), query)?
                    == anew.localize(&mut anew.scratch(), query)?,
                "a localizer that went on gives other answers"
            );
        }
    }
    Ok(took)
}

fn bytes_of(path: &Path) -> Result<u64> {
    let metadata = std::fs::metadata(path);
    Ok(metadata
        .with_context(|| format!("cannot look at {}", path.display()))?
        .len())
}

/// What was done, and its milliseconds.
fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, f64)> {
    let start = Instant::now();
    let done = work()?;
    Ok((done, start.elapsed().as_secs_f64() * 1e3))
}

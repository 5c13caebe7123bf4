//! What does a grid say of itself, in the words of the command's `--json`?

use std::path::Path;

use chronotope::Time;
use fremen_grid::file::{Generation, Verified};
use fremen_grid::history::Memory;
use fremen_grid::lifelong::MapId;
use fremen_grid::registration::{Quarantined, Reason};
use fremen_grid::{Explanation, FittedGrid};
use serde_json::{Value, json};

use crate::map_json::hex;

/// JSON knows no infinity.
pub(crate) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// `chronotope grid verify --json`.
pub(crate) fn verified(path: &Path, verified: &Verified) -> Value {
    let faults: Vec<_> = verified.faults.iter().map(ToString::to_string).collect();
    json!({
        "grid": path,
        "clean": faults.is_empty(),
        "generation": verified.generation,
        "faults": faults,
    })
}

/// One line of `chronotope grid log --json`.
pub(crate) fn generation(it: &Generation) -> Value {
    json!({
        "number": it.number,
        "parent": it.parent,
        "time": Time::from_us(it.time_us).to_string(),
        "num_observations": it.notes.first().copied().unwrap_or_default(),
        "digest": hex(&it.digest),
    })
}

/// One line of `chronotope grid quarantine list --json`.
pub(crate) fn held(held: &Quarantined) -> Value {
    let judgement = &held.judgement;
    json!({
        "id": MapId::of(held).to_string(),
        "time": judgement.time.to_string(),
        "observer": held.observer,
        "reason": judgement.reason.map(Reason::name),
        "disagreement": judgement.disagreement,
        "expected": judgement.expected,
        "limit": finite(judgement.limit),
        "shift_m": judgement.registration.map(|it| it.shift_m),
        "shift_limit_m": finite(judgement.shift_limit_m),
        "num_new_surfaces": held.contradictions[0].len(),
        "num_lost_surfaces": held.contradictions[1].len(),
        "picture": None::<String>,
    })
}

/// `chronotope grid inspect --json`, but for the file: `memory` is what the history costs as it was
/// read.
pub(crate) fn inspected(memory: &Memory, fitted: &FittedGrid<'_>) -> Value {
    let history = fitted.history();
    let spec = history.spec();
    let mut times = history.observation_names().map(|it| it.0);
    let first = times.next();
    let last = times.last().or(first);
    json!({
        "is_2d": spec.is_2d(),
        "origin_m": spec.origin_m(),
        "resolution_m": spec.resolution_m(),
        "dims": spec.dims(),
        "num_observations": history.num_observations(),
        "first": first.map(|it| it.to_string()),
        "last": last.map(|it| it.to_string()),
        "num_tiles": memory.num_tiles,
        "num_changing_cells": memory.num_changing_cells,
        "num_varying_cells": fitted.num_varying(),
        "memory_bytes": memory.total_bytes(),
    })
}

/// `chronotope grid explain --json`.
pub(crate) fn explained(cell: [u32; 3], time: Time, found: &Explanation) -> Value {
    let rhythms = found.rhythms.iter().map(|it| {
        json!({
            "period_s": it.period_s,
            "amplitude": it.amplitude,
            "phase_rad": it.phase_rad,
        })
    });
    json!({
        "cell": cell,
        "time": time.to_string(),
        "p": found.probability,
        "periodic": found.periodic,
        "persistence": found.persistence,
        "last_seen": found.last_seen.map(|(time, _)| time.to_string()),
        "last_state": found.last_seen.map(|(_, it)| it.name()),
        "num_observed": found.num_observed,
        "num_occupied": found.num_occupied,
        "num_changes": found.num_changes,
        "tau_s": found.tau_s,
        "rhythms": rhythms.collect::<Vec<_>>(),
    })
}

//! What does a grid answer: of an observation, of a map that was judged, of a cell?

use chronotope::Time;
use fremen_grid::Explanation;
use fremen_grid::history::{Outcome, Verdict};
use fremen_grid::lifelong::{MapId, TakenIn};
use fremen_grid::registration::{Judgement, Reason};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::failure::Result;
use crate::grid_json::{explained, finite};
use crate::hints::{Json, MaybeMoment, Moment, Triples};
use crate::python::{json_line, loads, maybe_moment, moment, table};

/// What an observation said, compared with what was last known of its cells before it.
#[pyclass(frozen, module = "chronotope", name = "GridObservation")]
pub(crate) struct PyObserved {
    pub(crate) verdict: Verdict,
}

impl PyObserved {
    fn outcome(&self) -> &'static str {
        if self.verdict.outcome == Outcome::AlreadyKnown {
            "known"
        } else {
            "integrated"
        }
    }

    fn value(&self) -> Value {
        json!({
            "outcome": self.outcome(),
            "num_known": self.verdict.num_known,
            "num_changed": self.verdict.num_changed,
            "num_revealed": self.verdict.num_revealed,
            "num_hidden": self.verdict.num_hidden,
        })
    }
}

#[pymethods]
impl PyObserved {
    /// ``"integrated"``, or ``"known"`` for one that had been added before.
    #[getter(outcome)]
    fn outcome_name(&self) -> &'static str {
        self.outcome()
    }

    /// Cells that it saw free or occupied.
    #[getter]
    fn num_known(&self) -> usize {
        self.verdict.num_known
    }

    /// Cells that were free and are occupied, or the reverse.
    #[getter]
    fn num_changed(&self) -> usize {
        self.verdict.num_changed
    }

    /// Cells that the last observation around them had not seen.
    #[getter]
    fn num_revealed(&self) -> usize {
        self.verdict.num_revealed
    }

    /// Cells that the last observation around them had seen, and this one did not.
    #[getter]
    fn num_hidden(&self) -> usize {
        self.verdict.num_hidden
    }

    /// All of it, as a dictionary.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &json_line(&self.value())?)
    }

    fn __repr__(&self) -> String {
        format!(
            "<GridObservation {}: {} cells, {} of them changed>",
            self.outcome(),
            self.verdict.num_known,
            self.verdict.num_changed
        )
    }
}

/// What became of a map that was judged, and why.
///
/// ``outcome`` is ``"integrated"``; ``"quarantined"``: it is not believed and kept (``Grid.held``);
/// ``"adopted"``: it shows the same change as others in quarantine, and ``num_maps`` of them were
/// integrated; or ``"known"``: it was in the grid already.
#[pyclass(frozen, module = "chronotope", name = "GridVerdict")]
pub(crate) struct PyVerdict {
    outcome: &'static str,
    judgement: Option<Judgement>,
    num_maps: usize,
    observer: String,
    time: Time,
}

impl PyVerdict {
    pub(crate) fn of(taken: TakenIn, observer: &str, time: Time) -> Self {
        let (outcome, judgement, num_maps) = match taken {
            TakenIn::Known => ("known", None, 0),
            TakenIn::Integrated(judgement) => ("integrated", Some(judgement), 1),
            TakenIn::Adopted {
                num_maps,
                judgement,
            } => ("adopted", Some(judgement), num_maps),
            TakenIn::Quarantined(judgement) | TakenIn::QuarantinedBefore(judgement) => {
                ("quarantined", Some(judgement), 0)
            }
        };
        Self {
            outcome,
            judgement,
            num_maps,
            observer: observer.to_owned(),
            time,
        }
    }

    fn value(&self) -> Value {
        json!({
            "outcome": self.outcome,
            "id": self.id(),
            "time": self.time.to_string(),
            "observer": self.observer,
            "num_maps": self.num_maps,
            "reason": self.reason(),
            "why": self.why(),
            "disagreement": self.disagreement(),
            "expected": self.expected(),
            "limit": self.limit(),
            "shift_m": self.shift_m(),
            "shift_limit_m": self.shift_limit_m(),
        })
    }
}

#[pymethods]
impl PyVerdict {
    /// ``"integrated"``, ``"quarantined"``, ``"adopted"`` or ``"known"``.
    #[getter]
    fn outcome(&self) -> &'static str {
        self.outcome
    }

    /// How many maps were integrated: one, none, or with others out of quarantine several.
    #[getter]
    fn num_maps(&self) -> usize {
        self.num_maps
    }

    /// The map's identity, by which ``Grid.accept`` and ``Grid.drop_held`` know it.
    #[getter]
    fn id(&self) -> String {
        MapId::new(&self.observer, self.time).to_string()
    }

    /// When it was made, in UTC.
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Result<Moment<'py>> {
        moment(py, self.time)
    }

    /// Who made it.
    #[getter]
    fn observer(&self) -> &str {
        &self.observer
    }

    /// Why it is not believed: ``"contradiction"``, ``"shift"``, ``"nothing"`` (nothing of it can be
    /// compared), or None where it is.
    #[getter]
    fn reason(&self) -> Option<&'static str> {
        self.judgement?.reason.map(Reason::name)
    }

    /// The same as a sentence with the numbers.
    #[getter]
    fn why(&self) -> String {
        match &self.judgement {
            Some(judgement) => judgement.why(),
            None => "it is in the grid already".to_owned(),
        }
    }

    /// The share of its cells that were wrongly predicted, after it was laid onto the prediction.
    #[getter]
    fn disagreement(&self) -> Option<f64> {
        Some(self.judgement?.disagreement)
    }

    /// The share that the prediction itself expected to be wrong.
    #[getter]
    fn expected(&self) -> Option<f64> {
        Some(self.judgement?.expected)
    }

    /// The largest share that is usual; None as long as maps are not judged.
    #[getter]
    fn limit(&self) -> Option<f64> {
        finite(self.judgement?.limit)
    }

    /// By how many metres it had to be moved; None where nothing was predicted to lay it onto.
    #[getter]
    fn shift_m(&self) -> Option<f64> {
        Some(self.judgement?.registration?.shift_m)
    }

    /// The largest shift that is usual, m; None as long as maps are not judged.
    #[getter]
    fn shift_limit_m(&self) -> Option<f64> {
        finite(self.judgement?.shift_limit_m)
    }

    /// All of it, as a dictionary.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &json_line(&self.value())?)
    }

    fn __repr__(&self) -> String {
        format!(
            "<GridVerdict {} at {}: {}>",
            self.outcome,
            self.time,
            self.why()
        )
    }
}

/// Why a cell is predicted as it is.
#[pyclass(frozen, module = "chronotope", name = "CellExplanation")]
pub(crate) struct PyCellExplanation {
    pub(crate) cell: [u32; 3],
    pub(crate) time: Time,
    pub(crate) found: Explanation,
}

#[pymethods]
impl PyCellExplanation {
    /// The cell (x, y, z), counted from the grid's lower corner; in an array [y, x], in 3-D [z, y, x].
    #[getter]
    fn cell(&self) -> (u32, u32, u32) {
        let [x, y, z] = self.cell;
        (x, y, z)
    }

    /// The time, in UTC.
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Result<Moment<'py>> {
        moment(py, self.time)
    }

    /// The probability that it is occupied; None where it was never seen.
    #[getter]
    fn p(&self) -> Option<f64> {
        self.found.probability
    }

    /// The part of the rhythms.
    #[getter]
    fn periodic(&self) -> f64 {
        self.found.periodic
    }

    /// The weight of the last observation against them.
    #[getter]
    fn persistence(&self) -> f64 {
        self.found.persistence
    }

    /// When it was last seen, in UTC; None where it never was.
    #[getter]
    fn last_seen<'py>(&self, py: Python<'py>) -> Result<MaybeMoment<'py>> {
        maybe_moment(py, self.found.last_seen.map(|(time, _)| time))
    }

    /// How it was last seen: ``"free"`` or ``"occupied"``.
    #[getter]
    fn last_state(&self) -> Option<&'static str> {
        self.found.last_seen.map(|(_, state)| state.name())
    }

    /// Observations that saw it.
    #[getter]
    fn num_observed(&self) -> u32 {
        self.found.num_observed
    }

    /// Observations that saw it occupied.
    #[getter]
    fn num_occupied(&self) -> u32 {
        self.found.num_occupied
    }

    /// Changes between free and occupied.
    #[getter]
    fn num_changes(&self) -> u32 {
        self.found.num_changes
    }

    /// How long a state lasts on average, s; None where it never changed.
    #[getter]
    fn tau_s(&self) -> Option<f64> {
        self.found.tau_s
    }

    /// Its rhythms, strongest first, float64 (k, 3): period in s, amplitude, phase in rad.
    #[getter]
    fn rhythms<'py>(&self, py: Python<'py>) -> Result<Triples<'py>> {
        let rows = self.found.rhythms.iter();
        let rows = rows.flat_map(|it| [it.period_s, it.amplitude, it.phase_rad]);
        Ok(Triples(table(py, rows.collect(), 3)?))
    }

    /// As ``chronotope grid explain --json`` prints it.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &self.to_json()?)
    }

    /// The line that ``chronotope grid explain --json`` prints.
    fn to_json(&self) -> Result<String> {
        json_line(&explained(self.cell, self.time, &self.found))
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.cell;
        match self.found.probability {
            Some(p) => format!(
                "<CellExplanation of [{x}, {y}, {z}] at {}: p = {p:.3}, {} rhythms>",
                self.time,
                self.found.rhythms.len()
            ),
            None => format!("<CellExplanation of [{x}, {y}, {z}]: never seen>"),
        }
    }
}

//! How does a robot in Python explore: plan a day, look, learn, and plan again?

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use chronotope::{Error, ErrorKind, Time};
use fremen::Period;
use fremen::online::OnlineConfig;
use fremen_explore::{
    ExploreConfig, Explored, Explorer, Plan, Prospect, Share, Slots, Strategy, Visit, prospects,
};
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use serde_json::{Value, json};

use crate::failure::{Result, detached, interruptible};
use crate::hints::{Json, LookLike, Moment, Numbers, PlacesLike, TimeLike};
use crate::python::{column, json_line, loads, moment, time_of};

/// How visits are chosen.
pub(crate) struct Choice<'a> {
    pub(crate) strategy: &'a str,
    pub(crate) share: f64,
    pub(crate) slot_s: f64,
    pub(crate) seed: u64,
}

impl Choice<'_> {
    pub(crate) fn config(&self) -> Result<ExploreConfig> {
        let strategy: Strategy =
            (self.strategy.parse()).map_err(|error: Error| error.with_place("strategy"))?;
        let slots = Slots::of_s(Time::default(), self.slot_s, 1)
            .map_err(|error| error.with_place("slot"))?;
        Ok(ExploreConfig::new(strategy)?
            .with_share(share_of(self.share)?)
            .with_slot(slots.length())
            .with_seed(self.seed))
    }
}

pub(crate) fn share_of(share: f64) -> Result<Share> {
    Ok(Share::new(share).map_err(|error| error.with_place("share"))?)
}

pub(crate) fn model_of(name: &str) -> Result<OnlineConfig> {
    Ok((name.parse()).map_err(|error: Error| error.with_place("model"))?)
}

/// A robot that plans where to look when, looks, and learns what it has seen.
///
/// ``places`` are names, or a dictionary of names and how many 0/1 states each place shows at once (the
/// features of a view, the seats of a room). At most ``share`` of the slots of ``slot`` seconds are
/// spent on visits.
///
/// ``strategy`` is ``"information"`` (what a look leaves behind: states that stay, and a better model),
/// ``"greedy"``, ``"monte-carlo"``, ``"novelty"``, ``"round-robin"`` or ``"random"``; what is drawn
/// follows from ``seed``. ``model`` is what is believed of each place: ``"histogram-persistent"``,
/// ``"short-term"``, ``"long-term"``, ``"fremen"``, ``"gaussians"``, ``"natural"`` or ``"histogram"``,
/// and each with ``-persistent``.
///
/// The loop: ``plan`` a day; for each slot ask ``next``, go there, ``observe``; the next day, ``plan``
/// again.
///
/// Source: J. M. Santos, T. Krajník, T. Duckett: Spatio-temporal exploration strategies for long-term
/// autonomy of mobile robots, Robotics and Autonomous Systems, 2017, eq. 10 to 12; ``"information"`` is
/// this project's own.
///
/// Errors: ``ConfigError`` for unknown names and numbers out of range, ``AlreadyExistsError`` for a
/// name that comes twice.
#[pyclass(frozen, module = "chronotope", name = "Explorer")]
pub(crate) struct PyExplorer {
    names: Vec<String>,
    num_states: Vec<usize>,
    slot: Period,
    explorer: Arc<Mutex<Explorer>>,
}

/// Names and numbers of states.
fn places_of(object: &Bound<'_, PyAny>) -> Result<Vec<(String, usize)>> {
    let places: Vec<(String, usize)> = if let Ok(mapping) = object.cast::<PyMapping>() {
        mapping.items()?.extract()?
    } else {
        let names: Vec<String> = object.extract()?;
        names.into_iter().map(|name| (name, 1)).collect()
    };
    let mut known = BTreeSet::new();
    for (name, num_states) in &places {
        if *num_states == 0 {
            return Err(Error::new(ErrorKind::Shape, "a place without states")
                .with_place(format!("places['{name}']"))
                .with_help("a place shows at least one state")
                .into());
        }
        if !known.insert(name.as_str()) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("there are two places `{name}`"),
            )
            .with_place("places")
            .into());
        }
    }
    Ok(places)
}

/// The place of a name.
pub(crate) fn place_named<N: AsRef<str>>(names: &[N], name: &str) -> chronotope::Result<usize> {
    let found = names.iter().position(|it| it.as_ref() == name);
    found.ok_or_else(|| {
        let known: Vec<&str> = names.iter().take(20).map(AsRef::as_ref).collect();
        Error::new(ErrorKind::NotFound, format!("there is no place `{name}`"))
            .with_help(format!("places are {}", known.join(", ")))
    })
}

impl PyExplorer {
    fn place(&self, name: &str) -> Result<usize> {
        Ok(place_named(&self.names, name)?)
    }

    fn visits(&self, plan: &Plan) -> Vec<PyVisit> {
        let visit = |visit: &Visit| PyVisit::of(visit, &self.names[visit.place]);
        plan.visits().map(visit).collect()
    }

    /// Works with the explorer; Ctrl-C ends the wait.
    fn with<T: Send + 'static>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Explorer) -> chronotope::Result<T> + Send + 'static,
    ) -> Result<T> {
        let explorer = Arc::clone(&self.explorer);
        interruptible(py, move || {
            let mut explorer = explorer.lock().unwrap_or_else(PoisonError::into_inner);
            work(&mut explorer)
        })
    }
}

#[pymethods]
impl PyExplorer {
    #[new]
    #[pyo3(signature = (places, *, model="histogram-persistent", strategy="information", share=0.5,
                        slot=600.0, seed=0))]
    fn new(
        places: PlacesLike<'_>,
        model: &str,
        strategy: &str,
        share: f64,
        slot: f64,
        seed: u64,
    ) -> Result<Self> {
        let choice = Choice {
            strategy,
            share,
            slot_s: slot,
            seed,
        };
        let (cfg, model) = (choice.config()?, model_of(model)?);
        let places = places_of(&places.0)?;
        let slot = cfg.slot();
        let named = places.iter().map(|(name, num)| (name.as_str(), *num));
        let explorer = Explorer::new(named, &model, cfg);
        let (names, num_states) = places.into_iter().unzip();
        Ok(Self {
            names,
            num_states,
            slot,
            explorer: Arc::new(Mutex::new(explorer)),
        })
    }

    /// Learns from what was seen, plans ``slots`` slots from ``start`` on, and gives the visits in
    /// order of time.
    ///
    /// Errors: ``TimeError``, ``ConfigError`` for no slots or too many.
    #[pyo3(signature = (start, slots=144))]
    fn plan(&self, py: Python<'_>, start: TimeLike<'_>, slots: usize) -> Result<Vec<PyVisit>> {
        let start = time_of(&start.0)?;
        let plan = self.with(py, move |explorer| explorer.plan(start, slots).cloned())?;
        Ok(self.visits(&plan))
    }

    /// Where to be in a slot of the present plan, counted from 0; None if it is for other tasks, or if
    /// nothing is planned. What was seen since may have changed it. Slots are asked for in order, and
    /// each once.
    fn next(&self, py: Python<'_>, slot: usize) -> Result<Option<PyVisit>> {
        let visit = self.with(py, move |explorer| explorer.next(slot))?;
        Ok(visit.map(|visit| PyVisit::of(&visit, &self.names[visit.place])))
    }

    /// Takes what was seen at a place: True or False, or as many of them as it has states. A look that
    /// is older than the last one is learnt from, and is not taken for the last.
    ///
    /// Errors: ``NotFoundError`` for an unknown place, ``TimeError``, ``ConfigError`` for what are no
    /// states, ``ShapeError`` for another number of them.
    fn observe(
        &self,
        py: Python<'_>,
        place: &str,
        time: TimeLike<'_>,
        states: LookLike<'_>,
    ) -> Result<()> {
        let (place, time) = (self.place(place)?, time_of(&time.0)?);
        let states: Vec<bool> = if let Ok(state) = states.0.extract::<bool>() {
            vec![state]
        } else {
            let module = py.import("chronotope.explore")?;
            (module.getattr("_look")?.call1((&states.0,))?).extract()?
        };
        detached(py, || {
            let mut explorer = self.explorer.lock().unwrap_or_else(PoisonError::into_inner);
            explorer.observe(place, time, &states)
        })
    }

    /// What is believed of a place at a time: the probability of each state, float64 (states,).
    ///
    /// Errors: ``NotFoundError``, ``TimeError``.
    fn predict<'py>(
        &self,
        py: Python<'py>,
        place: &str,
        time: TimeLike<'py>,
    ) -> Result<Numbers<'py>> {
        let (place, time) = (self.place(place)?, time_of(&time.0)?);
        let num_states = self.num_states[place];
        let p = detached(py, || {
            let explorer = self.explorer.lock().unwrap_or_else(PoisonError::into_inner);
            let mut p = vec![0.0; num_states];
            explorer.beliefs().predict_into(place, time, &mut p);
            Ok(p)
        })?;
        Ok(Numbers(column(py, p)?))
    }

    /// What a look at a time would be worth at each place, the best first, by what was learnt until the
    /// last ``plan``. ``slots`` is how far ahead what is seen counts.
    ///
    /// Errors: ``TimeError``, ``ConfigError``.
    #[pyo3(signature = (time, *, slots=144))]
    fn prospects(
        &self,
        py: Python<'_>,
        time: TimeLike<'_>,
        slots: usize,
    ) -> Result<Vec<PyProspect>> {
        let slots = Slots::new(time_of(&time.0)?, self.slot, slots)?;
        let found = self.with(py, move |explorer| prospects(explorer.beliefs(), &slots, 0))?;
        let found = found.into_iter();
        Ok(found
            .map(|it| PyProspect::of(it, &self.names[it.place]))
            .collect())
    }

    /// The plan as it stands now, changed by what was seen since it was made.
    #[getter]
    fn planned(&self, py: Python<'_>) -> Result<Vec<PyVisit>> {
        let plan = detached(py, || {
            let explorer = self.explorer.lock().unwrap_or_else(PoisonError::into_inner);
            Ok(explorer.present_plan().cloned())
        })?;
        Ok(plan.map_or_else(Vec::new, |plan| self.visits(&plan)))
    }

    /// The names of the places.
    #[getter]
    fn places(&self) -> Vec<String> {
        self.names.clone()
    }

    /// How often a visit was changed by what was seen since it was planned.
    #[getter]
    fn num_rerouted(&self, py: Python<'_>) -> Result<usize> {
        detached(py, || {
            let explorer = self.explorer.lock().unwrap_or_else(PoisonError::into_inner);
            Ok(explorer.num_rerouted())
        })
    }

    fn __repr__(&self) -> String {
        let slot_s = self.slot.as_s();
        format!(
            "<Explorer of {} places, slots of {slot_s} s>",
            self.names.len()
        )
    }
}

/// One visit of a plan, or one stop of a tour.
#[pyclass(frozen, module = "chronotope.explore", name = "PlannedVisit")]
pub(crate) struct PyVisit {
    pub(crate) place: String,
    pub(crate) start: Time,
    pub(crate) end: Time,
    pub(crate) slot: Option<usize>,
    pub(crate) info_bits: f64,
    pub(crate) reason: String,
}

impl PyVisit {
    pub(crate) fn of(visit: &Visit, place: &str) -> Self {
        Self {
            place: place.to_owned(),
            start: visit.start,
            end: visit.end,
            slot: Some(visit.slot),
            info_bits: visit.info_bits,
            reason: visit.reason.to_string(),
        }
    }

    pub(crate) fn value(&self) -> Value {
        json!({
            "start": self.start.to_string(),
            "end": self.end.to_string(),
            "place": self.place,
            "info_bits": self.info_bits,
            "reason": self.reason,
        })
    }
}

#[pymethods]
impl PyVisit {
    /// Where.
    #[getter]
    fn place(&self) -> &str {
        &self.place
    }

    /// When the robot is to be there, in UTC.
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Result<Moment<'py>> {
        moment(py, self.start)
    }

    /// When it may leave, in UTC.
    #[getter]
    fn end<'py>(&self, py: Python<'py>) -> Result<Moment<'py>> {
        moment(py, self.end)
    }

    /// The slot of the plan that it fills, counted from 0; None for a stop of a tour.
    #[getter]
    fn slot(&self) -> Option<usize> {
        self.slot
    }

    /// What it is expected to teach, in the bits of the strategy.
    #[getter]
    fn info_bits(&self) -> f64 {
        self.info_bits
    }

    /// Why, in words.
    #[getter]
    fn reason(&self) -> &str {
        &self.reason
    }

    /// As ``chronotope explore plan --json`` prints it.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &self.to_json()?)
    }

    /// The line that ``chronotope explore plan --json`` prints.
    fn to_json(&self) -> Result<String> {
        json_line(&self.value())
    }

    fn __repr__(&self) -> String {
        format!(
            "<PlannedVisit '{}' at {}, {:.2} bits>",
            self.place, self.start, self.info_bits
        )
    }
}

/// What a look at a place would be worth, if nothing else were planned.
#[pyclass(frozen, module = "chronotope.explore", name = "Prospect")]
pub(crate) struct PyProspect {
    place: String,
    found: Prospect,
}

impl PyProspect {
    pub(crate) fn of(found: Prospect, place: &str) -> Self {
        Self {
            place: place.to_owned(),
            found,
        }
    }
}

#[pymethods]
impl PyProspect {
    /// The place.
    #[getter]
    fn place(&self) -> &str {
        &self.place
    }

    /// The mean over its states of the probability of 1.
    #[getter]
    fn p(&self) -> f64 {
        self.found.p
    }

    /// The uncertainty of its states at the look, bits.
    #[getter]
    fn state_bits(&self) -> f64 {
        self.found.state_bits
    }

    /// For so many slots what is seen stays true.
    #[getter]
    fn slots(&self) -> f64 {
        self.found.slots
    }

    /// Looks that the model of this hour rests on.
    #[getter]
    fn looks(&self) -> f64 {
        self.found.looks
    }

    /// What a look tells of the model, in bits of a state that is known for one slot.
    #[getter]
    fn model_bits(&self) -> f64 {
        self.found.model_bits
    }

    /// What places are ranked by.
    #[getter]
    fn value(&self) -> f64 {
        self.found.value
    }

    /// As ``chronotope explore explain --json`` prints it.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &self.to_json()?)
    }

    /// The line that ``chronotope explore explain --json`` prints.
    fn to_json(&self) -> Result<String> {
        let it = &self.found;
        json_line(&json!({
            "place": self.place,
            "p": it.p,
            "state_bits": it.state_bits,
            "slots": it.slots,
            "looks": it.looks,
            "model_bits": it.model_bits,
            "value": it.value,
        }))
    }

    fn __repr__(&self) -> String {
        let it = &self.found;
        format!(
            "<Prospect '{}': p = {:.3}, value {:.2}>",
            self.place, it.p, it.value
        )
    }
}

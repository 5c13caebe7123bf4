//! When and where should somebody look who has series or a map, for `chronotope.explore`?

use std::path::PathBuf;
use std::sync::Arc;

use chronotope::map::Snapshot;
use chronotope::{Error, ErrorKind, Time};
use fremen::Series;
use fremen::online::OnlineConfig;
use fremen::time::Zone;
use fremen_explore::{
    Beliefs, Charger, Fitted, InZone, MadeVisits, Opening, Outcome, Plan, Recording, Roads, Slots,
    Stop, Tour, TourConfig, prospects, simulate,
};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::explorer::{Choice, PyProspect, PyVisit, model_of, place_named, share_of};
use crate::failure::{Result, interruptible};
use crate::hints::{ExploredLike, Json, Microseconds, Numbers, States, TimeLike};
use crate::map::{PyMap, snapshot_of};
use crate::python::{column, json_line, loads, time_of};
use crate::series::{series_of, times_of_us};

/// What is explored, before anything was learnt of it.
enum Data {
    Map(Arc<Snapshot>),
    Series(Vec<(String, Series)>),
}

/// Some places, learnt from what was seen before a moment.
struct Known {
    places: InZone,
    names: Vec<String>,
    /// The times and places of looks since a moment that the caller asked for.
    lately: Vec<(Time, usize)>,
}

/// How places are learnt.
struct Learning {
    data: Data,
    model: OnlineConfig,
    zone: Option<Zone>,
}

impl Learning {
    fn of(data: &Bound<'_, PyAny>, model: &str, zone: Option<&str>) -> Result<Self> {
        let is_map = data.cast::<PyMap>().is_ok() || data.extract::<PathBuf>().is_ok();
        let data = if is_map {
            Data::Map(snapshot_of(data)?.1)
        } else {
            let given: Vec<(String, Microseconds<'_>, States<'_>)> = data.extract()?;
            let series = (given.into_iter())
                .map(|(name, times, states)| Ok((name, series_of(&times, &states)?)))
                .collect::<Result<Vec<_>>>()?;
            Data::Series(series)
        };
        Ok(Self {
            data,
            model: model_of(model)?,
            zone: zone.map(Zone::new).transpose()?,
        })
    }

    /// What is known before `before`, with the looks from `since` on.
    fn known(&self, since: Time, before: Time) -> chronotope::Result<Known> {
        match &self.data {
            Data::Map(snapshot) => of_map(snapshot, since, before),
            Data::Series(series) => self.of_series(series, since, before),
        }
    }

    fn of_series(
        &self,
        series: &[(String, Series)],
        since: Time,
        before: Time,
    ) -> chronotope::Result<Known> {
        let zone = self.zone.as_ref();
        let wall = |time: Time| zone.map_or(time, |zone| zone.wall(time));
        let (mut looks, mut lately) = (Vec::new(), Vec::new());
        for (place, (_, series)) in series.iter().enumerate() {
            for &(time, state) in series.states() {
                if time < before {
                    looks.push((wall(time), place, state));
                    if time >= since {
                        lately.push((time, place));
                    }
                }
            }
        }
        let names: Vec<String> = series.iter().map(|(name, _)| name.clone()).collect();
        let beliefs = Beliefs::of_looks(&names, &self.model, looks)?;
        Ok(Known {
            places: InZone::new(beliefs, self.zone.clone()),
            names,
            lately,
        })
    }
}

/// The features of each place of a map, by their natural rhythms and the clocks of the map's zone.
fn of_map(snapshot: &Snapshot, since: Time, before: Time) -> chronotope::Result<Known> {
    let zone = snapshot.meta().civil_zone()?;
    let (mut fitted, mut names, mut lately) = (Fitted::new(), Vec::new(), Vec::new());
    for (place, node) in snapshot.nodes().iter().enumerate() {
        let times = node.log().times().iter().copied();
        let times = times.filter(|time| (since..before).contains(time));
        lately.extend(times.map(|time| (time, place)));
        fitted.push_log(node.key().as_str(), node.log(), before, zone.as_ref())?;
        names.push(node.key().as_str().to_owned());
    }
    Ok(Known {
        places: InZone::new(fitted, zone),
        names,
        lately,
    })
}

impl Known {
    fn visits(&self, plan: &Plan) -> Vec<PyVisit> {
        let visits = plan.visits();
        visits
            .map(|visit| PyVisit::of(visit, &self.names[visit.place]))
            .collect()
    }
}

/// The visits of a day.
#[pyfunction]
#[pyo3(signature = (data, start, *, slots, slot, share, strategy, seed, model, zone))]
#[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
pub(crate) fn explore_plan(
    py: Python<'_>,
    data: ExploredLike<'_>,
    start: TimeLike<'_>,
    slots: usize,
    slot: f64,
    share: f64,
    strategy: &str,
    seed: u64,
    model: &str,
    zone: Option<&str>,
) -> Result<Vec<PyVisit>> {
    let choice = Choice {
        strategy,
        share,
        slot_s: slot,
        seed,
    };
    let (cfg, start) = (choice.config()?, time_of(&start.0)?);
    let slots = Slots::new(start, cfg.slot(), slots)?;
    let learning = Learning::of(&data.0, model, zone)?;
    interruptible(py, move || {
        let known = learning.known(start, start)?;
        let plan = fremen_explore::plan(&known.places, slots, &cfg)?;
        Ok(known.visits(&plan))
    })
}

/// Where to go now, if the share of the day's time is not spent.
#[pyfunction]
#[pyo3(signature = (data, now, *, day_from, visited, slots, slot, share, strategy, seed, model, zone))]
#[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
pub(crate) fn explore_next(
    py: Python<'_>,
    data: ExploredLike<'_>,
    now: TimeLike<'_>,
    day_from: Option<TimeLike<'_>>,
    visited: Vec<(String, TimeLike<'_>)>,
    slots: usize,
    slot: f64,
    share: f64,
    strategy: &str,
    seed: u64,
    model: &str,
    zone: Option<&str>,
) -> Result<Option<PyVisit>> {
    let choice = Choice {
        strategy,
        share,
        slot_s: slot,
        seed,
    };
    let (cfg, now) = (choice.config()?, time_of(&now.0)?);
    let day_from = day_from.map_or(Ok(now), |time| time_of(&time.0))?;
    if day_from > now {
        let message = format!("a day that begins at {day_from} is not under way at {now}");
        return Err(Error::new(ErrorKind::Config, message)
            .with_place("day_from")
            .with_help("give a time before `now`")
            .into());
    }
    let visited = (visited.into_iter())
        .map(|(name, time)| Ok((name, time_of(&time.0)?)))
        .collect::<Result<Vec<_>>>()?;
    let slots = Slots::new(day_from, cfg.slot(), slots)?;
    let learning = Learning::of(&data.0, model, zone)?;
    interruptible(py, move || {
        let known = learning.known(day_from, now)?;
        let made = made(&known, &visited, &slots, now)?;
        // The slot under way belongs to what is done already, unless it begins now.
        let passed = |slot: &usize| slots.begin(*slot) < now;
        let from = (0..slots.len()).take_while(passed).count();
        let plan = fremen_explore::plan_rest(&known.places, slots, &cfg, from, &made)?;
        Ok(known.visits(&plan).into_iter().next())
    })
}

/// The visits of the day: those that the data has, and those that it is told.
fn made(
    known: &Known,
    visited: &[(String, Time)],
    slots: &Slots,
    now: Time,
) -> chronotope::Result<MadeVisits> {
    let mut made = MadeVisits::default();
    let looks = known.lately.iter();
    made.at
        .extend(looks.filter_map(|&(time, place)| Some((slots.slot_of(time)?, place))));
    for (name, time) in visited {
        let slot = slots
            .slot_of(*time)
            .filter(|_| *time < now)
            .ok_or_else(|| {
                let from = slots.start();
                let message = format!("a visit at {time} is not between {from} and {now}");
                Error::new(ErrorKind::Config, message)
                    .with_place("visited")
                    .with_help("visits that were made are from `day_from` to `now`")
            })?;
        match known.names.iter().position(|known| known == name) {
            Some(place) => made.at.push((slot, place)),
            None => made.elsewhere += 1,
        }
    }
    made.at.sort_unstable();
    made.at.dedup();
    Ok(made)
}

/// What a look at a time would be worth at each place.
#[pyfunction]
#[pyo3(signature = (data, time, *, slots, slot, model, zone))]
pub(crate) fn explore_prospects(
    py: Python<'_>,
    data: ExploredLike<'_>,
    time: TimeLike<'_>,
    slots: usize,
    slot: f64,
    model: &str,
    zone: Option<&str>,
) -> Result<Vec<PyProspect>> {
    let time = time_of(&time.0)?;
    let slots = Slots::of_s(time, slot, slots)?;
    let learning = Learning::of(&data.0, model, zone)?;
    interruptible(py, move || {
        let known = learning.known(time, time)?;
        let found = prospects(&known.places, &slots, 0)?.into_iter();
        Ok(found
            .map(|it| PyProspect::of(it, &known.names[it.place]))
            .collect())
    })
}

/// What driving takes and allows.
struct Driving {
    links: Vec<(String, String, f64)>,
    at: Option<String>,
    charger: Option<(String, f64, f64)>,
    open: Vec<(String, Time, Time)>,
    share: f64,
    slot_s: f64,
}

impl Driving {
    fn roads(&self, names: &[String]) -> chronotope::Result<Roads> {
        let mut nodes: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut links = Vec::new();
        for (a, b, travel_s) in &self.links {
            let mut node = |name| {
                nodes.iter().position(|it| *it == name).unwrap_or_else(|| {
                    nodes.push(name);
                    nodes.len() - 1
                })
            };
            links.push((node(a.as_str()), node(b.as_str()), *travel_s));
        }
        Roads::among(names.len(), nodes.len(), &links).map_err(|error| error.with_place("roads"))
    }

    fn config(&self, names: &[String], slots: &Slots) -> chronotope::Result<TourConfig> {
        let place = |name: &str| place_named(names, name);
        let at = self.at.as_deref().map_or(Ok(0), place)?;
        let budget_s = self.share * slots.end().since_s(slots.start());
        let mut cfg = TourConfig::new(slots.start(), slots.end(), at, names.len(), self.slot_s)?
            .with_budget_s(budget_s)?;
        if let Some((name, run_s, charge_s)) = &self.charger {
            cfg = cfg.with_charger(Charger {
                place: place(name)?,
                run_s: *run_s,
                charge_s: *charge_s,
            })?;
        }
        let mut openings: Vec<Vec<Opening>> = vec![Vec::new(); names.len()];
        for (name, from, to) in &self.open {
            if from >= to {
                let message = format!("`{name}` is open from {from} to {to}");
                return Err(Error::new(ErrorKind::Config, message)
                    .with_place("open")
                    .with_help("the earlier time comes first"));
            }
            openings[place(name)?].push(Opening {
                from: *from,
                to: *to,
            });
        }
        for (place, openings) in openings.into_iter().enumerate() {
            cfg = cfg.with_openings(place, openings)?;
        }
        Ok(cfg)
    }
}

/// A tour of a robot for which driving takes time.
#[pyfunction]
#[pyo3(signature = (data, start, roads, *, at, charger, open, slots, slot, share, model, zone))]
#[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
pub(crate) fn explore_tour(
    py: Python<'_>,
    data: ExploredLike<'_>,
    start: TimeLike<'_>,
    roads: Vec<(String, String, f64)>,
    at: Option<String>,
    charger: Option<(String, f64, f64)>,
    open: Vec<(String, TimeLike<'_>, TimeLike<'_>)>,
    slots: usize,
    slot: f64,
    share: f64,
    model: &str,
    zone: Option<&str>,
) -> Result<PyTour> {
    let start = time_of(&start.0)?;
    let slots = Slots::of_s(start, slot, slots)?;
    let open = (open.into_iter())
        .map(|(name, from, to)| Ok((name, time_of(&from.0)?, time_of(&to.0)?)))
        .collect::<Result<Vec<_>>>()?;
    let driving = Driving {
        links: roads,
        at,
        charger,
        open,
        share: share_of(share)?.get(),
        slot_s: slot,
    };
    let learning = Learning::of(&data.0, model, zone)?;
    interruptible(py, move || {
        let known = learning.known(start, start)?;
        let roads = driving.roads(&known.names)?;
        let cfg = driving.config(&known.names, &slots)?;
        let tour = fremen_explore::plan_tour(&known.places, &slots, &roads, &cfg)?;
        Ok(PyTour {
            tour,
            names: known.names,
        })
    })
}

/// A way through places, with what is looked at when.
#[pyclass(frozen, module = "chronotope.explore", name = "Tour")]
pub(crate) struct PyTour {
    tour: Tour,
    names: Vec<String>,
}

#[pymethods]
impl PyTour {
    /// Its stops in order of time: visits, and when it is charged.
    #[getter]
    fn stops(&self) -> Vec<PyVisit> {
        let stops = self.tour.stops.iter().map(|stop| {
            let (info_bits, reason) = match stop.stop {
                Stop::Visit { value } => (value, "teaches most for the time that it takes"),
                Stop::Charge => (0.0, "charging"),
            };
            PyVisit {
                place: self.names[stop.place].clone(),
                start: stop.start,
                end: stop.end,
                slot: None,
                info_bits,
                reason: reason.to_owned(),
            }
        });
        stops.collect()
    }

    /// The sum of what its visits add.
    #[getter]
    fn value(&self) -> f64 {
        self.tour.value
    }

    /// Seconds of driving and visiting.
    #[getter]
    fn spent_s(&self) -> f64 {
        self.tour.spent_s
    }

    /// Seconds of driving alone.
    #[getter]
    fn travel_s(&self) -> f64 {
        self.tour.travel_s
    }

    /// All of it, as a dictionary; stops are as ``chronotope explore plan --roads --json`` prints them.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        let stops: Vec<Value> = self.stops().iter().map(PyVisit::value).collect();
        let value = json!({
            "stops": stops,
            "value": self.tour.value,
            "spent_s": self.tour.spent_s,
            "travel_s": self.tour.travel_s,
        });
        loads(py, &json_line(&value)?)
    }

    fn __len__(&self) -> usize {
        self.tour.stops.len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<Tour: {} stops, {:.0} s spent, {:.0} s of it on the way>",
            self.tour.stops.len(),
            self.tour.spent_s,
            self.tour.travel_s
        )
    }
}

/// Plays a recording through.
#[pyfunction]
#[pyo3(signature = (times_us, places, *, slots, slot, share, strategy, seed, model))]
#[allow(clippy::too_many_arguments)] // reason: keyword arguments of Python.
pub(crate) fn explore_simulate(
    py: Python<'_>,
    times_us: Microseconds<'_>,
    places: Vec<(String, usize, States<'_>)>,
    slots: usize,
    slot: f64,
    share: f64,
    strategy: &str,
    seed: u64,
    model: &str,
) -> Result<PySimulation> {
    let choice = Choice {
        strategy,
        share,
        slot_s: slot,
        seed,
    };
    let (cfg, model) = (choice.config()?, model_of(model)?);
    let mut recording = Recording::new(times_of_us(&times_us)?)?;
    for (name, num_states, states) in places {
        let states: numpy::PyReadonlyArray1<'_, i8> = states.0.extract()?;
        let states = states.as_array().iter().map(|&state| state == 1).collect();
        recording.push(name, num_states, states)?;
    }
    interruptible(py, move || {
        let outcome = simulate(&recording, &model, &cfg, slots)?;
        let names = recording.places().map(|(name, _)| name.to_owned());
        Ok(PySimulation {
            names: names.collect(),
            outcome,
            strategy: cfg.strategy().name(),
            model: model.to_string(),
            share: cfg.share().get(),
            seed,
        })
    })
}

/// How well a robot has known the places that it explored.
#[pyclass(frozen, module = "chronotope.explore", name = "Simulation")]
pub(crate) struct PySimulation {
    names: Vec<String>,
    outcome: Outcome,
    strategy: &'static str,
    model: String,
    share: f64,
    seed: u64,
}

impl PySimulation {
    fn bits(&self) -> f64 {
        let visits = &self.outcome.visits;
        let bits: f64 = visits.iter().map(|visit| visit.info_bits).sum();
        bits / visits.len().max(1) as f64
    }
}

#[pymethods]
impl PySimulation {
    /// The share of states, over places and moments, that it had wrong when it took each to be 1 if p >
    /// 1/2; what it was looking at it knew (RAS 2017 eq. 1 and 2).
    #[getter]
    fn error(&self) -> f64 {
        self.outcome.error
    }

    /// The same of each planned stretch, float64 (n,).
    #[getter]
    fn by_day<'py>(&self, py: Python<'py>) -> Result<Numbers<'py>> {
        Ok(Numbers(column(py, self.outcome.by_day.clone())?))
    }

    /// Every visit that was made, in order of time.
    #[getter]
    fn visits(&self) -> Vec<PyVisit> {
        let visits = self.outcome.visits.iter();
        visits
            .map(|visit| PyVisit::of(visit, &self.names[visit.place]))
            .collect()
    }

    /// How many they are.
    #[getter]
    fn num_visits(&self) -> usize {
        self.outcome.visits.len()
    }

    /// How often a visit was not the one that had been planned.
    #[getter]
    fn num_rerouted(&self) -> usize {
        self.outcome.num_rerouted
    }

    /// What a visit was expected to teach, on average, in the bits of the strategy.
    #[getter]
    fn bits_a_visit(&self) -> f64 {
        self.bits()
    }

    /// As ``chronotope explore simulate --by-day --json`` prints it.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Json<'py>> {
        loads(py, &self.to_json()?)
    }

    /// The line that ``chronotope explore simulate --by-day --json`` prints.
    fn to_json(&self) -> Result<String> {
        json_line(&json!({
            "strategy": self.strategy,
            "model": self.model,
            "share": self.share,
            "seed": self.seed,
            "error": self.outcome.error,
            "num_visits": self.outcome.visits.len(),
            "num_rerouted": self.outcome.num_rerouted,
            "bits_a_visit": self.bits(),
            "by_day": self.outcome.by_day,
        }))
    }

    fn __repr__(&self) -> String {
        format!(
            "<Simulation of {} with {}, seed {}: {:.2} % of states wrong, {} visits>",
            self.strategy,
            self.model,
            self.seed,
            100.0 * self.outcome.error,
            self.outcome.visits.len()
        )
    }
}

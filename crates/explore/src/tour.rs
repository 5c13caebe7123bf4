//! Which way through the places brings most, if driving takes time?
//!
//! An orienteering problem whose rewards depend on the time of day and on earlier visits. States of
//! a robot (when, where, what it has visited, when it was last charged) are expanded in order of
//! time: it may visit any place that it can reach, wait, or charge. Of all states with about the
//! same time and place only the few best are kept (a beam), each with its whole past, so that what
//! another visit adds is always worked out exactly. No state spends more time on driving and visiting
//! than it may; where that is short, several prices for a second are tried and the best tour kept.

use fremen::{Error, ErrorKind, Period, Result, Time};

use crate::roads::Roads;

/// Between these moments a place may be visited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Opening {
    /// The first.
    pub from: Time,
    /// When a visit must have ended.
    pub to: Time,
}

/// Where and how a robot is charged; not before half of the time to run has passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Charger {
    /// The place.
    pub place: usize,
    /// Seconds from the end of one charging to the end of the next way to the charger, at most.
    pub run_s: f64,
    /// Seconds that a charging takes.
    pub charge_s: f64,
}

/// What a tour must keep to.
#[derive(Clone, Debug)]
pub struct TourConfig {
    start: Time,
    end: Time,
    at: usize,
    budget_s: f64,
    step: Period,
    width: usize,
    visit_s: Vec<f64>,
    openings: Vec<Vec<Opening>>,
    charger: Option<Charger>,
}

impl TourConfig {
    /// From `start` to `end`, beginning at place `at`, with visits of `visit_s` seconds everywhere.
    ///
    /// Fails if `end` is not after `start`, or if visits do not take some time.
    pub fn new(start: Time, end: Time, at: usize, num_places: usize, visit_s: f64) -> Result<Self> {
        let config = |message: String| Error::new(ErrorKind::Config, message);
        if end <= start {
            return Err(config(format!("a tour from {start} to {end} has no time")));
        }
        if !(visit_s.is_finite() && visit_s > 0.0) {
            return Err(config(format!("a visit takes {visit_s} s"))
                .with_help("a visit takes some seconds"));
        }
        if at >= num_places {
            return Err(Error::new(
                ErrorKind::NotFound,
                format!("the robot is at place {at} of {num_places}"),
            ));
        }
        Ok(Self {
            start,
            end,
            at,
            budget_s: end.since_s(start),
            step: Period::from_s((visit_s / 2.0).max(1.0))?,
            width: (256 / num_places).clamp(8, 64),
            visit_s: vec![visit_s; num_places],
            openings: vec![Vec::new(); num_places],
            charger: None,
        })
    }

    /// Drives and visits for so many seconds at most, 0 or more.
    pub fn with_budget_s(mut self, budget_s: f64) -> Result<Self> {
        if budget_s.is_nan() || budget_s < 0.0 {
            return Err(Error::new(
                ErrorKind::Config,
                format!("{budget_s} s cannot be spent"),
            ));
        }
        self.budget_s = budget_s;
        Ok(self)
    }

    /// `place` may be visited within these times only; always, if none is given.
    pub fn with_openings(mut self, place: usize, openings: Vec<Opening>) -> Result<Self> {
        if place >= self.openings.len() {
            return Err(Error::new(
                ErrorKind::NotFound,
                format!("there is no place {place}"),
            ));
        }
        self.openings[place] = openings;
        Ok(self)
    }

    /// The robot must be charged, and is charged when the tour begins.
    ///
    /// Fails if there is no such place, or if the times are no times.
    pub fn with_charger(mut self, charger: Charger) -> Result<Self> {
        let is_time = |s: f64| s.is_finite() && s > 0.0;
        if charger.place >= self.visit_s.len() {
            return Err(Error::new(
                ErrorKind::NotFound,
                format!(
                    "the charger is at place {}, which is not there",
                    charger.place
                ),
            ));
        }
        if !is_time(charger.run_s) || !is_time(charger.charge_s) {
            return Err(Error::new(
                ErrorKind::Config,
                "a charger needs times above 0 s to run and to charge",
            ));
        }
        self.charger = Some(charger);
        Ok(self)
    }

    /// Waiting goes on in steps of this.
    #[must_use]
    pub fn with_step(mut self, step: Period) -> Self {
        self.step = step;
        self
    }

    /// States of about the same time and place that are kept, 1 or more; by default 256 for all
    /// places, 8 to 64 for each.
    pub fn with_width(mut self, width: usize) -> Result<Self> {
        if width == 0 {
            return Err(Error::new(
                ErrorKind::Config,
                "no tour is planned from 0 states",
            ));
        }
        self.width = width;
        Ok(self)
    }
}

/// What a robot does at a stop of its tour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// It looks at the place.
    Visit {
        /// What that adds.
        value: f64,
    },
    /// It is charged.
    Charge,
}

/// One stop of a tour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TourStop {
    /// When it is there.
    pub start: Time,
    /// When it leaves, at the earliest.
    pub end: Time,
    /// Where.
    pub place: usize,
    /// For what.
    pub stop: Stop,
}

/// A way through the places.
#[derive(Clone, Debug, PartialEq)]
pub struct Tour {
    /// In order of time.
    pub stops: Vec<TourStop>,
    /// The sum of what visits add.
    pub value: f64,
    /// Seconds of driving and visiting.
    pub spent_s: f64,
    /// Seconds of driving alone.
    pub travel_s: f64,
}

/// What a visit to a place that begins then adds, after visits to it that began at these times
/// (ascending): 0 or more.
pub trait TourValue {
    /// See the trait.
    fn value(&self, place: usize, start: Time, earlier: &[Time]) -> f64;
}

impl<F: Fn(usize, Time, &[Time]) -> f64> TourValue for F {
    fn value(&self, place: usize, start: Time, earlier: &[Time]) -> f64 {
        self(place, start, earlier)
    }
}

/// The best tour that the beam finds: every stop can be reached in time, is within opening times,
/// and the battery lasts; places without a way are never visited. Empty if nothing is worth it.
///
/// O(steps x width x places) values, seven times where not all of the time may be spent.
pub fn tour(value: &dyn TourValue, roads: &Roads, cfg: &TourConfig) -> Result<Tour> {
    if roads.num_places() != cfg.visit_s.len() {
        return Err(Error::new(
            ErrorKind::Shape,
            format!(
                "roads of {} places, a tour of {}",
                roads.num_places(),
                cfg.visit_s.len()
            ),
        ));
    }
    let mut best = Search::new(value, roads, cfg).run(0.0);
    if cfg.budget_s >= cfg.end.since_s(cfg.start) {
        return Ok(best);
    }
    // Time is short: some of it is better spent later.
    let dearest = best
        .stops
        .iter()
        .fold(0.0, |most: f64, stop| match stop.stop {
            Stop::Visit { value } => most.max(value / stop.end.since_s(stop.start)),
            Stop::Charge => most,
        });
    for share in PRICES {
        let found = Search::new(value, roads, cfg).run(share * dearest);
        if found.value > best.value {
            best = found;
        }
    }
    Ok(best)
}

/// Prices of a second that are tried, as shares of the dearest second of a visit.
const PRICES: [f64; 6] = [0.15, 0.3, 0.45, 0.6, 0.75, 0.9];

/// A robot somewhere on its way.
#[derive(Clone, Copy, Debug)]
struct State {
    time: Time,
    place: usize,
    value: f64,
    spent_s: f64,
    travel_s: f64,
    charged: Time,
    /// The last stop, and the state before it.
    stop: Option<TourStop>,
    before: Option<usize>,
}

struct Search<'a> {
    value: &'a dyn TourValue,
    roads: &'a Roads,
    cfg: &'a TourConfig,
    states: Vec<State>,
    /// Of each step and place, the best states by value less price, best first.
    buckets: Vec<Vec<(f64, usize)>>,
}

impl<'a> Search<'a> {
    fn new(value: &'a dyn TourValue, roads: &'a Roads, cfg: &'a TourConfig) -> Self {
        let num_steps = (cfg.end.since_s(cfg.start) / cfg.step.as_s()).floor() as usize + 1;
        Self {
            value,
            roads,
            cfg,
            states: Vec::new(),
            buckets: vec![Vec::new(); num_steps * roads.num_places()],
        }
    }

    fn bucket(&self, time: Time, place: usize) -> usize {
        let step = (time.since_s(self.cfg.start) / self.cfg.step.as_s()) as usize;
        step * self.roads.num_places() + place
    }

    fn run(mut self, price: f64) -> Tour {
        let first = State {
            time: self.cfg.start,
            place: self.cfg.at,
            value: 0.0,
            spent_s: 0.0,
            travel_s: 0.0,
            charged: self.cfg.start,
            stop: None,
            before: None,
        };
        self.keep(first, price);
        for bucket in 0..self.buckets.len() {
            // Visits may be shorter than a step, so that a bucket can grow while it is expanded.
            let mut next = 0;
            while let Some(&(_, state)) = self.buckets[bucket].get(next) {
                next += 1;
                self.expand(state, price);
            }
        }
        let score = |state: &State| state.value - price * state.spent_s;
        let best = (0..self.states.len()).max_by(|&a, &b| {
            let (a_state, b_state) = (&self.states[a], &self.states[b]);
            score(a_state).total_cmp(&score(b_state)).then(b.cmp(&a))
        });
        self.unwind(best.unwrap_or_default())
    }

    /// Puts a state into its bucket if it is among the best there.
    fn keep(&mut self, state: State, price: f64) {
        let score = state.value - price * state.spent_s;
        let bucket = self.bucket(state.time, state.place);
        let width = self.cfg.width;
        let index = self.states.len();
        let Some(kept) = self.buckets.get_mut(bucket) else {
            return;
        };
        let at = kept.partition_point(|&(other, _)| other >= score);
        if at >= width {
            return;
        }
        kept.insert(at, (score, index));
        kept.truncate(width);
        self.states.push(state);
    }

    fn expand(&mut self, index: usize, price: f64) {
        let state = self.states[index];
        let wait = State {
            time: state.time.plus_us(self.cfg.step.as_us()),
            stop: None,
            before: Some(index),
            ..state
        };
        if wait.time <= self.cfg.end && self.can_return(&wait) {
            self.keep(wait, price);
        }
        for place in 0..self.roads.num_places() {
            if let Some(next) = self.visit(index, &state, place) {
                self.keep(next, price);
            }
        }
        if let Some(next) = self.charge(index, &state) {
            self.keep(next, price);
        }
    }

    fn visit(&self, index: usize, state: &State, place: usize) -> Option<State> {
        let travel_s = self.roads.travel_s(state.place, place)?;
        let arrival = after_s(state.time, travel_s);
        let visit_s = self.cfg.visit_s[place];
        let openings = &self.cfg.openings[place];
        let start = if openings.is_empty() {
            arrival
        } else {
            let fits =
                |opening: &&Opening| after_s(arrival.max(opening.from), visit_s) <= opening.to;
            let first = openings
                .iter()
                .filter(fits)
                .min_by_key(|opening| opening.from)?;
            arrival.max(first.from)
        };
        let end = after_s(start, visit_s);
        let spent_s = state.spent_s + travel_s + visit_s;
        if end > self.cfg.end || spent_s > self.cfg.budget_s {
            return None;
        }
        let earlier = self.earlier(index, place);
        let value = self.value.value(place, start, &earlier);
        if value.is_nan() || value <= 0.0 {
            return None;
        }
        let next = State {
            time: end,
            place,
            value: state.value + value,
            spent_s,
            travel_s: state.travel_s + travel_s,
            charged: state.charged,
            stop: Some(TourStop {
                start,
                end,
                place,
                stop: Stop::Visit { value },
            }),
            before: Some(index),
        };
        self.can_return(&next).then_some(next)
    }

    fn charge(&self, index: usize, state: &State) -> Option<State> {
        let charger = self.cfg.charger?;
        let travel_s = self.roads.travel_s(state.place, charger.place)?;
        let start = after_s(state.time, travel_s);
        let end = after_s(start, charger.charge_s);
        let spent_s = state.spent_s + travel_s;
        // Not before the battery is half empty.
        let is_full = start.since_s(state.charged) < 0.5 * charger.run_s;
        if end > self.cfg.end || spent_s > self.cfg.budget_s || is_full {
            return None;
        }
        Some(State {
            time: end,
            place: charger.place,
            spent_s,
            travel_s: state.travel_s + travel_s,
            charged: end,
            stop: Some(TourStop {
                start,
                end,
                place: charger.place,
                stop: Stop::Charge,
            }),
            before: Some(index),
            ..*state
        })
    }

    /// Whether the battery still lasts until the charger.
    fn can_return(&self, state: &State) -> bool {
        let Some(charger) = self.cfg.charger else {
            return true;
        };
        let way_s = self.roads.travel_s(state.place, charger.place);
        way_s.is_some_and(|way_s| state.time.since_s(state.charged) + way_s <= charger.run_s)
    }

    /// When visits to `place` began, ascending.
    fn earlier(&self, mut index: usize, place: usize) -> Vec<Time> {
        let mut earlier = Vec::new();
        loop {
            let state = &self.states[index];
            if let Some(stop) = state.stop.filter(|stop| stop.place == place)
                && matches!(stop.stop, Stop::Visit { .. })
            {
                earlier.push(stop.start);
            }
            let Some(before) = state.before else { break };
            index = before;
        }
        earlier.reverse();
        earlier
    }

    fn unwind(&self, mut index: usize) -> Tour {
        let last = self.states[index];
        let mut stops = Vec::new();
        loop {
            let state = &self.states[index];
            stops.extend(state.stop);
            let Some(before) = state.before else { break };
            index = before;
        }
        stops.reverse();
        Tour {
            stops,
            value: last.value,
            spent_s: last.spent_s,
            travel_s: last.travel_s,
        }
    }
}

/// Rounded up to a microsecond, so that nobody is early.
fn after_s(time: Time, seconds: f64) -> Time {
    time.plus_us((seconds * 1e6).ceil() as i64)
}

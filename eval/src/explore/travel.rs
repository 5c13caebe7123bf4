//! What does an hour of driving and visiting teach, with and without knowing the roads?
//!
//! Both robots learn by the same model and are measured by the same bits: what each look leaves behind
//! (`prospects`), worked out when it begins, and less where it is cut short. A tour leaves in time; whoever
//! knows nothing of roads leaves when a slot begins, and is late wherever it has to drive.

use anyhow::{Context, Result};
use chronotope::{Period, Time};
use fremen::online::OnlineConfig;
use fremen_explore::{
    ExploreConfig, Explored, Explorer, Recording, Roads, Share, Slots, Stop, Strategy, TourConfig,
    plan_tour, prospects,
};
use rayon::prelude::*;

use super::data::Dataset;
use super::results::{Curve, ExploreResults, Row, SCHEMA_VERSION, measured};

const SLOTS: usize = 144;
const DAYS: usize = 14;
const VISIT_S: f64 = 600.0;

/// States of a tour that are kept for each moment and place.
const WIDTH: usize = 3;

/// Shares of time at which the curve is taken.
const SHARES: [f64; 5] = [0.1, 0.25, 0.5, 0.75, 1.0];

pub(super) fn travel(dataset: &Dataset, num_seeds: u64) -> Result<ExploreResults> {
    let recording = &dataset.recording;
    let roads = dataset.roads.as_ref().context("a world without roads")?;
    let mut rows = Vec::new();
    for is_tour in [false, true] {
        rows.push(row(
            is_tour,
            &trips(recording, roads, is_tour, 0.5, num_seeds)?,
        ));
    }
    let mut over_share = Vec::new();
    for is_tour in [true, false] {
        let points = SHARES.iter().map(|&share| {
            let trips = trips(recording, roads, is_tour, share, num_seeds.min(5))?;
            let an_hour: Vec<f64> = trips.iter().map(Trip::bits_an_hour).collect();
            Ok((share, measured(&an_hour)))
        });
        over_share.push(Curve {
            name: name(is_tour).into(),
            is_default: is_tour,
            points: points.collect::<Result<_>>()?,
        });
    }
    let reachable = (0..recording.num_places()).filter(|&it| roads.travel_s(0, it).is_some());
    Ok(ExploreResults {
        schema_version: SCHEMA_VERSION,
        protocol: format!(
            "{} places, {} of which can be reached; {DAYS} days from another one for each of {num_seeds} \
             seeds, visits of ten minutes, half of the time for driving and visits; model {}",
            recording.num_places(),
            reachable.count(),
            OnlineConfig::default()
        ),
        notes: vec![
            "Bits: what a look leaves behind, for both by the measure that tours maximise.".into(),
        ],
        rows,
        over_share,
        ..ExploreResults::default()
    })
}

const fn name(is_tour: bool) -> &'static str {
    if is_tour { "tours" } else { "monte-carlo" }
}

fn trips(
    recording: &Recording,
    roads: &Roads,
    is_tour: bool,
    share: f64,
    num_seeds: u64,
) -> Result<Vec<Trip>> {
    let num_days = recording.times().len() / 1_440;
    (0..num_seeds)
        .into_par_iter()
        .map(|seed| {
            let first = (num_days - DAYS) * seed as usize / (num_seeds as usize).max(2);
            let cfg = ExploreConfig::new(Strategy::MonteCarlo)?
                .with_share(Share::new(share)?)
                .with_seed(seed);
            let mut drive = Drive {
                recording,
                roads,
                explorer: Explorer::new(recording.places(), &OnlineConfig::default(), cfg),
                at: 0,
                trip: Trip::default(),
            };
            for day in first..first + DAYS {
                drive.day(recording.times()[day * 1_440], is_tour, share)?;
            }
            Ok(drive.trip)
        })
        .collect()
}

fn row(is_tour: bool, trips: &[Trip]) -> Row {
    let an_hour: Vec<f64> = trips.iter().map(Trip::bits_an_hour).collect();
    let errors: Vec<f64> = (trips.iter())
        .map(|trip| trip.wrong as f64 / trip.states.max(1) as f64)
        .collect();
    let sum = |of: fn(&Trip) -> f64| trips.iter().map(of).sum::<f64>();
    Row {
        strategy: name(is_tour).into(),
        model: OnlineConfig::default().to_string(),
        is_default: is_tour,
        worst: errors.iter().copied().fold(0.0, f64::max),
        error: measured(&errors),
        published: None,
        bits_a_visit: sum(|trip| trip.bits) / sum(|trip| trip.num_visits as f64).max(1.0),
        bits_an_hour: Some(measured(&an_hour)),
        travel_s_a_day: sum(|trip| trip.travel_s) / (DAYS * trips.len().max(1)) as f64,
        num_late: trips.iter().map(|trip| trip.num_late).sum(),
        num_seeds: trips.len() as u64,
    }
}

/// What came of two weeks.
#[derive(Debug, Default)]
struct Trip {
    bits: f64,
    num_visits: usize,
    spent_s: f64,
    travel_s: f64,
    num_late: usize,
    wrong: usize,
    states: usize,
}

impl Trip {
    fn bits_an_hour(&self) -> f64 {
        self.bits / (self.spent_s / 3_600.0).max(1e-9)
    }
}

/// A visit as it is planned: from when to when, and where.
type Planned = (Time, Time, usize);

struct Drive<'a> {
    recording: &'a Recording,
    roads: &'a Roads,
    explorer: Explorer,
    at: usize,
    trip: Trip,
}

impl Drive<'_> {
    fn day(&mut self, start: Time, is_tour: bool, share: f64) -> Result<()> {
        let plan = self.explorer.plan(start, SLOTS)?.clone();
        let slots = *plan.slots();
        let planned: Vec<Planned> = if is_tour {
            let seconds = slots.end().since_s(start);
            let cfg = TourConfig::new(
                start,
                slots.end(),
                self.at,
                self.roads.num_places(),
                VISIT_S,
            )?
            .with_budget_s(share * seconds)?
            .with_width(WIDTH)?;
            let tour = plan_tour(self.explorer.beliefs(), &slots, self.roads, &cfg)?;
            let visits = (tour.stops.iter()).filter(|stop| stop.stop != Stop::Charge);
            visits
                .map(|stop| (stop.start, stop.end, stop.place))
                .collect()
        } else {
            let visits = plan.visits();
            visits
                .map(|visit| (visit.start, visit.end, visit.place))
                .collect()
        };
        let mut free = start;
        let mut seen = Vec::new();
        for (from, end, place) in planned {
            let Some(way_s) = self.roads.travel_s(self.at, place) else {
                continue;
            };
            let leaves = if is_tour { free } else { free.max(from) };
            let begins = leaves.plus_us((way_s * 1e6) as i64).max(from);
            self.trip.num_late += usize::from(begins > from);
            if begins >= end {
                continue;
            }
            self.visit(&slots, (begins, end, place), way_s)?;
            free = end;
            seen.push((begins, end, place));
        }
        self.judge(&slots, &seen);
        Ok(())
    }

    fn visit(&mut self, slots: &Slots, (begins, end, place): Planned, way_s: f64) -> Result<()> {
        let slot = slots
            .slot_of(begins)
            .context("a visit outside of its day")?;
        let now = Slots::new(slots.begin(slot), Period::from_s(VISIT_S)?, SLOTS)?;
        let all = prospects(self.explorer.beliefs(), &now, 0)?;
        let bits = (all.iter().find(|it| it.place == place)).map_or(0.0, |it| it.value);
        let lasts_s = end.since_s(begins);
        self.trip.bits += bits * (lasts_s / VISIT_S).min(1.0);
        self.trip.num_visits += 1;
        self.trip.travel_s += way_s;
        self.trip.spent_s += way_s + lasts_s;
        self.at = place;
        for moment in self.recording.between(begins, end) {
            let time = self.recording.times()[moment];
            let states = self.recording.states(place, moment);
            self.explorer.observe(place, time, states)?;
        }
        Ok(())
    }

    /// What the model of the end of the day has wrong of that day, what was looked at left out.
    fn judge(&mut self, slots: &Slots, seen: &[Planned]) {
        for moment in self.recording.between(slots.start(), slots.end()) {
            let time = self.recording.times()[moment];
            for place in 0..self.recording.num_places() {
                self.trip.states += 1;
                let is_seen =
                    |&(begin, end, at): &Planned| at == place && begin <= time && time < end;
                if seen.iter().any(is_seen) {
                    continue;
                }
                let mut p = [0.0];
                self.explorer.beliefs().usual_into(place, time, &mut p);
                let state = self.recording.states(place, moment)[0];
                self.trip.wrong += usize::from((p[0] > 0.5) != state);
            }
        }
    }
}

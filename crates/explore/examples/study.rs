//! Which strategy with which model knows a world best? Prints the model errors of all of them, with
//! 95 % intervals over seeds, on one person in rooms (`aruba`, next to RAS 2016, table 1, symbolic) or
//! several in areas of an office (`witham`); or what tours bring an hour when driving takes time
//! (`aruba-travel`).
//!
//! `CHRONOTOPE_DATA=DIR cargo run --release -p fremen-explore --example study -- aruba 20`, with the
//! number of seeds; a strategy after it restricts the table.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "an example that cannot read its data has nothing else to say"
)]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use fremen::online::OnlineConfig;
use fremen::{Period, Time};
use fremen_explore::{
    Beliefs, ExploreConfig, Explored, Explorer, Recording, Roads, Slots, Stop, Strategy,
    TourConfig, plan_tour, prospects, simulate,
};

/// Round robin, random, greedy, Monte Carlo, novelty; short-term, long-term, FreMEn, mixture.
const PUBLISHED: [[f64; 4]; 5] = [
    [9.3, 9.7, 6.5, 7.5],
    [8.9, 9.5, 9.2, 7.5],
    [8.5, 8.7, 7.0, 9.4],
    [8.5, 8.9, 5.8, 6.4],
    [8.5, 8.9, 5.7, 6.1],
];

/// The published models, then those that go beyond.
const MODELS: [&str; 7] = [
    "short-term",
    "long-term",
    "fremen",
    "gaussians",
    "natural",
    "histogram",
    "histogram-persistent",
];

const SLOTS: usize = 144;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let suite = arguments.first().map_or("aruba", String::as_str);
    let seeds: u64 = arguments.get(1).map_or(3, |count| count.parse().unwrap());
    let only = arguments
        .get(2)
        .map(|name| name.parse::<Strategy>().unwrap());
    match suite {
        "aruba" => table(&aruba(), Some(&PUBLISHED), seeds, only),
        "witham" => table(&witham(), None, seeds, only),
        "aruba-travel" => travel(&aruba(), seeds),
        other => println!("there is no study `{other}`: aruba, witham, aruba-travel"),
    }
}

fn data() -> PathBuf {
    std::env::var("CHRONOTOPE_DATA")
        .unwrap_or_else(|_| "datasets".into())
        .into()
}

fn text(path: &Path) -> String {
    String::from_utf8(fremen::file::read(path, 1 << 28).unwrap()).unwrap()
}

/// Where somebody is in each minute, as a place with one state for each name.
fn people(path: &str, names: &str) -> Recording {
    let ids: Vec<usize> = text(&data().join(path))
        .lines()
        .map(|it| it.trim().parse().unwrap())
        .collect();
    let minutes = (0..ids.len()).map(|minute| Time::from_s(minute as i64 * 60));
    let mut recording = Recording::new(minutes.collect()).unwrap();
    for (place, name) in text(&data().join(names)).lines().enumerate() {
        let states = ids.iter().map(|&id| id == place + 1).collect();
        recording.push(name.trim(), 1, states).unwrap();
    }
    recording
}

fn aruba() -> Recording {
    people("series/aruba/location.min", "series/aruba/location.names")
}

fn witham() -> Recording {
    people(
        "series/people/witham_location.min",
        "series/people/witham_location.names",
    )
}

/// The mean and half of its 95 % interval.
fn mean(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (
        mean,
        1.96 * (squares / (count - 1.0).max(1.0) / count).sqrt(),
    )
}

fn table(
    recording: &Recording,
    published: Option<&[[f64; 4]; 5]>,
    seeds: u64,
    only: Option<Strategy>,
) {
    let days = recording.times().len() / 1_440;
    println!(
        "{} places, {days} days, {seeds} seeds",
        recording.num_places()
    );
    if only.is_none() {
        println!(
            "static, the majority of each state known from the start: {:.2} %",
            majority(recording)
        );
        let oracle = oracle(recording);
        println!("oracle, visits where the default model is wrong: {oracle:.2} %");
    }
    for (row, strategy) in Strategy::ALL.into_iter().enumerate() {
        if only.is_some_and(|only| only != strategy) {
            continue;
        }
        for (column, model) in MODELS.into_iter().enumerate() {
            // Nothing is drawn there.
            let seeds = if strategy == Strategy::RoundRobin {
                1
            } else {
                seeds
            };
            let (mut errors, mut bits) = (Vec::new(), 0.0);
            for seed in 0..seeds {
                let cfg = ExploreConfig::new(strategy).unwrap().with_seed(seed);
                let outcome = simulate(recording, &model.parse().unwrap(), &cfg, SLOTS).unwrap();
                errors.push(100.0 * outcome.error);
                let of_all: f64 = outcome.visits.iter().map(|visit| visit.info_bits).sum();
                bits += of_all / outcome.visits.len() as f64 / seeds as f64;
            }
            let (mean, half) = mean(&errors);
            let known = published.and_then(|rows| rows.get(row)?.get(column));
            let known = known.map_or(String::new(), |it| format!("published {it:4.1}, here "));
            println!(
                "{:12} {model:21} {known}{mean:5.2} % (+- {half:.2}), {bits:.2} bits a visit",
                strategy.name()
            );
        }
    }
}

/// The error of always believing of each state what it is most of the time, in percent.
fn majority(recording: &Recording) -> f64 {
    let moments = recording.times().len();
    let wrong: usize = (0..recording.num_places())
        .map(|place| {
            let ones = (0..moments)
                .filter(|&moment| recording.states(place, moment)[0])
                .count();
            ones.min(moments - ones)
        })
        .sum();
    100.0 * wrong as f64 / (moments * recording.num_places()) as f64
}

/// The error of the default model where each visit goes to the place that it has most wrong, as long
/// as half of the slots last, in percent.
fn oracle(recording: &Recording) -> f64 {
    let mut beliefs = Beliefs::new(recording.places(), &OnlineConfig::default());
    let (mut wrong, mut states) = (0, 0);
    let mut start = recording.times()[0];
    let length = Period::from_s(600.0).unwrap();
    while let Ok(slots) = Slots::new(start, length, SLOTS)
        && slots.end() <= recording.times()[recording.times().len() - 1].plus_us(60_000_000)
    {
        beliefs.learn().unwrap();
        let mut left = slots.budget(0.5);
        for slot in 0..SLOTS {
            let moments = recording.between(slots.begin(slot), slots.begin(slot + 1));
            let wrong_at = |place: usize| {
                let is_wrong = |moment: &usize| {
                    let mut p = [0.0];
                    beliefs.predict_into(place, recording.times()[*moment], &mut p);
                    (p[0] > 0.5) != recording.states(place, *moment)[0]
                };
                moments.clone().filter(is_wrong).count()
            };
            let all: Vec<usize> = (0..recording.num_places()).map(wrong_at).collect();
            states += moments.len() * all.len();
            wrong += all.iter().sum::<usize>();
            let worst = (0..all.len()).max_by_key(|&place| all[place]).unwrap();
            if left > 0 && all[worst] > 0 {
                left -= 1;
                wrong -= all[worst];
                for moment in moments {
                    let states = recording.states(worst, moment);
                    beliefs
                        .observe(worst, recording.times()[moment], states)
                        .unwrap();
                }
            }
        }
        start = slots.end();
    }
    100.0 * f64::from(u32::try_from(wrong).unwrap()) / f64::from(u32::try_from(states).unwrap())
}

/// Four weeks on the road: what is learnt for an hour of driving and visiting, and how many visits are
/// late, by tours and by plans of Monte Carlo that know nothing of roads.
fn travel(recording: &Recording, seeds: u64) {
    // The place that the topology calls by another name, and the one that is outside.
    let names: Vec<&str> = (recording.places())
        .map(|(name, _)| if name == "Junction" { "Center" } else { name })
        .collect();
    let topology = text(&data().join("series/people/aruba_topology.txt"));
    let roads = Roads::parse(&topology, &names).unwrap();
    let reachable: BTreeSet<usize> = (0..names.len())
        .filter(|&place| roads.travel_s(0, place).is_some())
        .collect();
    println!(
        "{} of {} places can be reached",
        reachable.len(),
        names.len()
    );
    for is_tour in [false, true] {
        let (mut an_hour, mut late, mut travel_s, mut errors) = (vec![], 0, 0.0, vec![]);
        let seeds = if is_tour { 1 } else { seeds };
        for seed in 0..seeds {
            let trip = Trip::new(recording, &roads, seed).run(is_tour, 28);
            an_hour.push(trip.value / (trip.spent_s / 3_600.0));
            late += trip.num_late;
            travel_s += trip.travel_s;
            errors.push(100.0 * trip.wrong as f64 / trip.states as f64);
        }
        let (value, half) = mean(&an_hour);
        let (error, _) = mean(&errors);
        println!(
            "{:28} {value:.2} (+- {half:.2}) an hour, {late} visits late, {:.0} s of driving a day, {error:.2} % of states wrong",
            if is_tour {
                "tours"
            } else {
                "Monte Carlo without roads"
            },
            travel_s / 28.0 / seeds as f64
        );
    }
}

struct Trip<'a> {
    recording: &'a Recording,
    roads: &'a Roads,
    explorer: Explorer,
    at: usize,
    /// What looks left behind, by the measure of the default strategy at the time of the look.
    value: f64,
    spent_s: f64,
    travel_s: f64,
    num_late: usize,
    wrong: usize,
    states: usize,
}

impl<'a> Trip<'a> {
    fn new(recording: &'a Recording, roads: &'a Roads, seed: u64) -> Self {
        let cfg = ExploreConfig::new(Strategy::MonteCarlo)
            .unwrap()
            .with_seed(seed);
        Self {
            recording,
            roads,
            explorer: Explorer::new(recording.places(), &OnlineConfig::default(), cfg),
            at: 0,
            value: 0.0,
            spent_s: 0.0,
            travel_s: 0.0,
            num_late: 0,
            wrong: 0,
            states: 0,
        }
    }

    fn run(mut self, is_tour: bool, days: usize) -> Self {
        let mut start = self.recording.times()[0];
        for _ in 0..days {
            let plan = self.explorer.plan(start, SLOTS).unwrap().clone();
            let slots = *plan.slots();
            let mut free = start;
            let stops: Vec<(Time, Time, usize)> = if is_tour {
                let cfg =
                    TourConfig::new(start, slots.end(), self.at, self.roads.num_places(), 600.0);
                let cfg = cfg.unwrap().with_budget_s(43_200.0).unwrap().with_width(3);
                let tour = plan_tour(self.explorer.beliefs(), &slots, self.roads, &cfg).unwrap();
                let visits = tour.stops.iter().filter(|stop| stop.stop != Stop::Charge);
                visits
                    .map(|stop| (stop.start, stop.end, stop.place))
                    .collect()
            } else {
                plan.visits()
                    .map(|visit| (visit.start, visit.end, visit.place))
                    .collect()
            };
            let mut seen: Vec<(Time, Time, usize)> = Vec::new();
            for (planned, end, place) in stops {
                let Some(way_s) = self.roads.travel_s(self.at, place) else {
                    continue;
                };
                // A tour leaves in time; whoever knows nothing of roads leaves when a slot begins.
                let leaves = if is_tour { free } else { free.max(planned) };
                let arrival = leaves.plus_us((way_s * 1e6) as i64);
                let begins = arrival.max(planned);
                self.num_late += usize::from(begins > planned);
                if begins >= end {
                    continue;
                }
                self.travel_s += way_s;
                self.spent_s += way_s + end.since_s(begins);
                self.at = place;
                free = end;
                let slot = slots.slot_of(begins).unwrap();
                let now = Slots::new(slots.begin(slot), slots.length(), SLOTS).unwrap();
                let all = prospects(self.explorer.beliefs(), &now, 0).unwrap();
                let worth = all.iter().find(|it| it.place == place).unwrap().value;
                // A look that is cut short counts for as long as it lasts.
                self.value += worth * (end.since_s(begins) / 600.0).min(1.0);
                for moment in self.recording.between(begins, end) {
                    let (time, states) = (
                        self.recording.times()[moment],
                        self.recording.states(place, moment),
                    );
                    self.explorer.observe(place, time, states).unwrap();
                }
                seen.push((begins, end, place));
            }
            self.judge(&slots, &seen);
            start = slots.end();
        }
        self
    }

    /// What the model of the end of the day has wrong of that day, what was looked at left out.
    fn judge(&mut self, slots: &Slots, seen: &[(Time, Time, usize)]) {
        for moment in self.recording.between(slots.start(), slots.end()) {
            let time = self.recording.times()[moment];
            for place in 0..self.recording.num_places() {
                self.states += 1;
                let is_seen = |&(begin, end, at): &(Time, Time, usize)| {
                    at == place && begin <= time && time < end
                };
                if seen.iter().any(is_seen) {
                    continue;
                }
                let mut p = [0.0];
                self.explorer.beliefs().usual_into(place, time, &mut p);
                self.wrong += usize::from((p[0] > 0.5) != self.recording.states(place, moment)[0]);
            }
        }
    }
}

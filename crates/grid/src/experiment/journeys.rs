//! How often is a planned way blocked? (IROS 2016, section V-B, table I)

use fremen::{Result, Time};
use rayon::prelude::*;

use crate::cells::{GridSpec, OccupancyMap};
use crate::experiment::world::{moment, patch_of, patrol_map};
use crate::model::{CellModel, GridConfig};
use crate::plan::{Forecast, Plan, Planner};
use crate::random::Random;
use crate::simulation::{Layout, Office, is_weekend};
use crate::temporal::TemporalGrid;

/// What is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct JourneysConfig {
    /// One office for each seed.
    pub seeds: Vec<u64>,
    /// Which office.
    pub layout: Layout,
    /// Days of patrols before the first journey.
    pub num_days: i64,
    /// Hours between patrols on average, before and between the journeys.
    pub every_h: f64,
    /// Journeys from room to room in each office, by day on weekdays.
    pub num_journeys: usize,
    /// Side of a cell.
    pub resolution_m: f64,
    /// How the robot drives.
    pub planner: Planner,
    /// How the map is predicted.
    pub predicted: GridConfig,
}

impl Default for JourneysConfig {
    fn default() -> Self {
        Self {
            seeds: (0..10).collect(),
            layout: Layout::Paper,
            num_days: 14,
            every_h: 1.0,
            num_journeys: 40,
            resolution_m: 0.1,
            planner: Planner::default(),
            predicted: GridConfig::default(),
        }
    }
}

/// In what ways are planned.
pub const PLANNED_IN: [&str; 5] = ["night", "averaged", "last", "predicted", "oracle"];

/// How journeys went with one kind of map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JourneyCounts {
    /// Journeys that were possible.
    pub num_journeys: usize,
    /// First plans that were blocked on the way.
    pub num_blocked: usize,
    /// Times that a new way was planned because of that.
    pub num_replans: usize,
    /// Journeys for which no way was found although there was one.
    pub num_given_up: usize,
    /// Metres driven on journeys that arrived.
    pub driven_m: f64,
    /// Journeys that arrived.
    pub num_arrived: usize,
    /// Sum of squared differences of "the plan is free" and its probability.
    pub brier_sum: f64,
}

impl JourneyCounts {
    fn add(&mut self, other: &Self) {
        self.num_journeys += other.num_journeys;
        self.num_blocked += other.num_blocked;
        self.num_replans += other.num_replans;
        self.num_given_up += other.num_given_up;
        self.driven_m += other.driven_m;
        self.num_arrived += other.num_arrived;
        self.brier_sum += other.brier_sum;
    }
}

/// All journeys.
#[derive(Clone, Debug, PartialEq)]
pub struct JourneysReport {
    /// For each office the counts for each of [`PLANNED_IN`].
    pub offices: Vec<[JourneyCounts; 5]>,
}

impl JourneysReport {
    /// The counts of all offices, for each of [`PLANNED_IN`].
    pub fn totals(&self) -> [JourneyCounts; 5] {
        let mut totals = [JourneyCounts::default(); 5];
        for office in &self.offices {
            for (total, counts) in totals.iter_mut().zip(office) {
                total.add(counts);
            }
        }
        totals
    }

    /// The table.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let totals = self.totals();
        let mut text = format!(
            "{} journeys in {} offices\n\
             map       | blocked | re-plans | no way found | mean way m | Brier of p(free) | \
             offices in which fewer are blocked than at night\n",
            totals[0].num_journeys,
            self.offices.len()
        );
        for (map, name) in PLANNED_IN.iter().enumerate() {
            let total = &totals[map];
            let fewer = (self.offices.iter())
                .filter(|office| office[map].num_blocked < office[0].num_blocked)
                .count();
            let planned = total.num_journeys - total.num_given_up.min(total.num_journeys);
            let _ = writeln!(
                text,
                "{name:9} | {:7} | {:8} | {:12} | {:10.1} | {:16.3} | {fewer}",
                total.num_blocked,
                total.num_replans,
                total.num_given_up,
                total.driven_m / total.num_arrived.max(1) as f64,
                total.brier_sum / planned.max(1) as f64,
            );
        }
        text
    }
}

/// Lets robots learn offices with trolleys and doors by patrols, and sends them from room to room.
///
/// # Errors
/// As the grid and the planner.
pub fn journeys(config: &JourneysConfig) -> Result<JourneysReport> {
    let offices = (config.seeds.par_iter())
        .map(|&seed| in_office(seed, config))
        .collect::<Result<_>>()?;
    Ok(JourneysReport { offices })
}

fn in_office(seed: u64, config: &JourneysConfig) -> Result<[JourneyCounts; 5]> {
    let office = Office::new(seed, config.layout)
        .with_trolleys()
        .without_people();
    let spec = office.spec(config.resolution_m)?;
    let mut random = Random::stream(seed, &[0x4a4f_5552]);
    let averaged = GridConfig::new(CellModel::Mean)?.with_persistence(false);
    let last = GridConfig::new(CellModel::LastObservation)?;
    let mut grid = TemporalGrid::new(spec, averaged.clone());
    let mut night = patrol_map(&office, spec, moment(0, 3.0), &mut random)?;
    let mut starts: Vec<f64> = Vec::new();
    let mut day = config.num_days;
    while starts.len() < config.num_journeys {
        if !is_weekend(day) {
            for _ in 0..8 {
                starts.push(24.0 * day as f64 + random.between(8.5, 17.5));
            }
        }
        day += 1;
    }
    starts.truncate(config.num_journeys);
    starts.sort_by(f64::total_cmp);
    let mut counts = [JourneyCounts::default(); 5];
    let mut next_h = 1.0;
    for start_h in starts {
        while next_h < start_h {
            let map = patrol_map(&office, spec, moment(0, next_h), &mut random)?;
            grid.observe(&patch_of(&map), moment(0, next_h))?;
            // At any hour, so that what comes at fixed hours is met.
            next_h += config.every_h * random.between(0.5, 1.5);
        }
        let [mut from, mut to] = office.places();
        if random.chance(0.5) {
            std::mem::swap(&mut from, &mut to);
        }
        let journey = Journey {
            office: &office,
            planner: &config.planner,
            from,
            to,
            depart: moment(0, start_h),
        };
        let mut truth = Truth {
            office: &office,
            spec,
        };
        let Some(oracle) = journey.go(&mut truth)? else {
            // Not even who knows everything finds a way.
            continue;
        };
        let mut results = [None; 5];
        results[4] = Some(oracle);
        results[0] = journey.go(&mut night)?;
        for (at, model) in [(1, &averaged), (2, &last), (3, &config.predicted)] {
            grid.set_config(model.clone());
            results[at] = journey.go(&mut grid)?;
        }
        for (count, result) in counts.iter_mut().zip(results) {
            count.num_journeys += 1;
            match result {
                Some(result) => count.add(&result),
                None => count.num_given_up += 1,
            }
        }
    }
    Ok(counts)
}

/// What really will be.
struct Truth<'o> {
    office: &'o Office,
    spec: GridSpec,
}

impl Forecast for Truth<'_> {
    fn spec(&self) -> GridSpec {
        self.spec
    }

    fn predict_into(&mut self, time: Time, map: &mut OccupancyMap) -> Result<()> {
        *map = self.office.true_map(time, self.spec);
        Ok(())
    }
}

/// A forecast, and what the robot has met on its way.
struct Seen<'f> {
    forecast: &'f mut dyn Forecast,
    met_m: Vec<[f64; 2]>,
}

impl Forecast for Seen<'_> {
    fn spec(&self) -> GridSpec {
        self.forecast.spec()
    }

    fn predict_into(&mut self, time: Time, map: &mut OccupancyMap) -> Result<()> {
        self.forecast.predict_into(time, map)?;
        let spec = *map.spec();
        for index in 0..spec.num_cells() {
            let [x, y, _] = spec.center(spec.cell(index));
            let is_met = self
                .met_m
                .iter()
                .any(|met| (met[0] - x).hypot(met[1] - y) < MET_M);
            if is_met {
                map.set(index, Some(1.0));
            }
        }
        Ok(())
    }
}

/// What stops a robot closes a corridor.
const MET_M: f64 = 0.7;
/// How far ahead a robot sees that it cannot go on.
const AHEAD_M: f64 = 1.0;
/// A robot touches what is nearer than this share of the distance that it means to keep.
const TOUCHES: f64 = 0.6;
/// After so many new plans a robot gives up.
const MAX_REPLANS: usize = 5;

/// One journey.
struct Journey<'o> {
    office: &'o Office,
    planner: &'o Planner,
    from: [f64; 2],
    to: [f64; 2],
    depart: Time,
}

impl Journey<'_> {
    /// Goes by a forecast, and plans again where the way is blocked; none without a first plan.
    fn go(&self, forecast: &mut dyn Forecast) -> Result<Option<JourneyCounts>> {
        let mut seen = Seen {
            forecast,
            met_m: Vec::new(),
        };
        let mut counts = JourneyCounts::default();
        let (mut at, mut time) = (self.from, self.depart);
        for attempt in 0..=MAX_REPLANS {
            let Some(plan) = self.planner.plan(&mut seen, at, self.to, time)? else {
                break;
            };
            let stop = self.first_blocked(&plan);
            if attempt == 0 {
                counts.num_blocked = usize::from(stop.is_some());
                let was_free = f64::from(u8::from(stop.is_none()));
                counts.brier_sum = (plan.p_free - was_free).powi(2);
            } else {
                counts.num_replans += 1;
            }
            let Some(stop) = stop else {
                counts.driven_m += plan.length_m;
                counts.num_arrived = 1;
                return Ok(Some(counts));
            };
            seen.met_m.push(plan.points_m[stop]);
            // It stops before that.
            let back = (AHEAD_M / seen.spec().resolution_m()) as usize;
            let here = stop.saturating_sub(back);
            counts.driven_m += plan.times[here].since_s(time) * self.planner.speed_m_s;
            (at, time) = (plan.points_m[here], plan.times[here]);
        }
        counts.driven_m = 0.0;
        let has_begun = counts.num_blocked > 0;
        Ok(has_begun.then_some(counts))
    }

    /// Where the way is blocked at the time at which the robot comes there.
    fn first_blocked(&self, plan: &Plan) -> Option<usize> {
        let radius_m = TOUCHES * self.planner.radius_m;
        (plan.points_m.iter().zip(&plan.times))
            .position(|(point, time)| self.office.scene(*time).is_blocked(*point, radius_m))
    }
}

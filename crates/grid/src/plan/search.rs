//! Which path costs least, when every cell is taken as it is predicted for the time of arrival?

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use fremen::{Error, ErrorKind, Result, Time};

use crate::cells::{GridSpec, OccupancyMap};
use crate::plan::inflate::inflated;
use crate::temporal::TemporalGrid;

/// Says what the world will look like.
pub trait Forecast {
    /// The cells.
    fn spec(&self) -> GridSpec;

    /// Writes the map that is expected at a time.
    fn predict_into(&mut self, time: Time, map: &mut OccupancyMap) -> Result<()>;
}

impl Forecast for TemporalGrid {
    fn spec(&self) -> GridSpec {
        *Self::spec(self)
    }

    fn predict_into(&mut self, time: Time, map: &mut OccupancyMap) -> Result<()> {
        Self::predict_into(self, time, map)
    }
}

impl Forecast for OccupancyMap {
    /// A map that stays as it is.
    fn spec(&self) -> GridSpec {
        *Self::spec(self)
    }

    fn predict_into(&mut self, _: Time, map: &mut OccupancyMap) -> Result<()> {
        map.clone_from(self);
        Ok(())
    }
}

/// How a robot drives, and what it is ready to risk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planner {
    /// It keeps this far from surfaces.
    pub radius_m: f64,
    /// How fast it drives.
    pub speed_m_s: f64,
    /// How long a predicted map stands for.
    pub bucket_s: f64,
    /// Cells that are occupied with this probability are never entered.
    pub blocked: f32,
    /// How likely a cell is occupied of which nothing is known; none where it must not be entered.
    pub unknown: Option<f32>,
    /// Occupied cells come together: how long obstacles are, the robot's own size included. Over this
    /// length a probability p of being occupied counts as one chance of p to be stopped.
    pub obstacle_m: f64,
    /// The way round that is worth avoiding an obstacle which is almost surely there: what a path
    /// costs per -ln(1 - p).
    pub detour_m: f64,
}

impl Default for Planner {
    fn default() -> Self {
        Self {
            radius_m: 0.25,
            speed_m_s: 0.5,
            bucket_s: 60.0,
            blocked: 0.95,
            unknown: None,
            obstacle_m: 1.5,
            detour_m: 30.0,
        }
    }
}

/// A path.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The centres of its cells, from start to goal.
    pub points_m: Vec<[f64; 2]>,
    /// When the robot comes to each.
    pub times: Vec<Time>,
    /// Its length.
    pub length_m: f64,
    /// How likely nothing stops the robot on it.
    pub p_free: f64,
}

/// A cell that can be reached, in the order of the search: cheapest first, then by number.
#[derive(Clone, Copy, PartialEq)]
struct Open {
    /// Cost so far, and the straight way to the goal.
    estimate: f64,
    index: usize,
}

impl Eq for Open {}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        // The heap gives the largest.
        (other.estimate.total_cmp(&self.estimate)).then(other.index.cmp(&self.index))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The best way to a cell that was found so far.
#[derive(Clone, Copy)]
struct Reached {
    cost: f64,
    length_m: f64,
    /// -ln of the probability that all of it is free.
    risk: f64,
    from: usize,
    is_done: bool,
}

impl Planner {
    fn check(&self) -> Result<()> {
        let positive = [self.speed_m_s, self.bucket_s, self.obstacle_m];
        let is_valid = positive.iter().all(|x| *x > 0.0 && x.is_finite())
            && self.radius_m >= 0.0
            && self.radius_m.is_finite()
            && self.detour_m >= 0.0
            && self.detour_m.is_finite()
            && self.blocked > 0.0
            && self.blocked <= 1.0;
        if is_valid {
            return Ok(());
        }
        Err(Error::new(
            ErrorKind::Config,
            format!("a robot cannot drive by {self:?}"),
        ))
    }

    /// The path from `start_m` to `goal_m` that costs least for a robot that departs at a time: its
    /// length, and [`detour_m`](Self::detour_m) for each unit of -ln of the probability that it is
    /// free. None where there is no path.
    ///
    /// Paths lead from cell to cell over sides and corners (A*). Of two ways to a cell the cheaper
    /// one is kept, also where it comes later: the robot does not wait, and dearer ways that would
    /// meet a better time further on are not found.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the planner's numbers are none, [`ErrorKind::NotFound`] where
    /// start or goal lie outside; as the forecast otherwise.
    pub fn plan(
        &self,
        forecast: &mut dyn Forecast,
        start_m: [f64; 2],
        goal_m: [f64; 2],
        depart: Time,
    ) -> Result<Option<Plan>> {
        self.check()?;
        let spec = forecast.spec();
        let cell = |[x, y]: [f64; 2]| {
            (spec.cell_at([x, y, 0.0]))
                .map(|cell| spec.index(cell))
                .ok_or_else(|| {
                    let message = format!("({x}, {y}) is outside of the grid");
                    Error::new(ErrorKind::NotFound, message).with_help("give a place in the map")
                })
        };
        let (start, goal) = (cell(start_m)?, cell(goal_m)?);
        let mut buckets = Buckets {
            forecast,
            planner: *self,
            depart,
            maps: BTreeMap::new(),
            scratch: OccupancyMap::new_unknown(spec),
        };
        let mut reached: Vec<Option<Reached>> = vec![None; spec.num_cells()];
        let mut open = BinaryHeap::new();
        reached[start] = Some(Reached {
            cost: 0.0,
            length_m: 0.0,
            risk: 0.0,
            from: start,
            is_done: false,
        });
        open.push(Open {
            estimate: 0.0,
            index: start,
        });
        while let Some(Open { index, .. }) = open.pop() {
            let Some(here) = reached[index].filter(|here| !here.is_done) else {
                continue;
            };
            reached[index] = Some(Reached {
                is_done: true,
                ..here
            });
            if index == goal {
                return Ok(Some(self.trace(&spec, &reached, goal, depart)));
            }
            for (next, step_m) in neighbours(&spec, index) {
                let length_m = here.length_m + step_m;
                let p = buckets.p(next, length_m)?;
                // NaN is unknown.
                if p.is_nan() || p >= self.blocked {
                    continue;
                }
                let risk_step = -f64::from(1.0 - p).ln() * step_m / self.obstacle_m;
                let cost = here.cost + step_m + self.detour_m * risk_step;
                if reached[next].is_none_or(|known| !known.is_done && cost < known.cost) {
                    reached[next] = Some(Reached {
                        cost,
                        length_m,
                        risk: here.risk + risk_step,
                        from: index,
                        is_done: false,
                    });
                    let estimate = cost + straight_m(&spec, next, goal);
                    open.push(Open {
                        estimate,
                        index: next,
                    });
                }
            }
        }
        Ok(None)
    }

    fn trace(
        &self,
        spec: &GridSpec,
        reached: &[Option<Reached>],
        goal: usize,
        depart: Time,
    ) -> Plan {
        let mut plan = Plan {
            points_m: Vec::new(),
            times: Vec::new(),
            length_m: 0.0,
            p_free: 1.0,
        };
        let mut index = goal;
        while let Some(here) = reached[index] {
            if index == goal {
                plan.length_m = here.length_m;
                plan.p_free = (-here.risk).exp();
            }
            let [x, y, _] = spec.center(spec.cell(index));
            plan.points_m.push([x, y]);
            plan.times.push(self.arrival(depart, here.length_m));
            if here.from == index {
                break;
            }
            index = here.from;
        }
        plan.points_m.reverse();
        plan.times.reverse();
        plan
    }

    fn arrival(&self, depart: Time, length_m: f64) -> Time {
        depart.plus_us((length_m / self.speed_m_s * 1e6) as i64)
    }
}

/// Predicted maps by the time of arrival, made when they are needed.
struct Buckets<'f> {
    forecast: &'f mut dyn Forecast,
    planner: Planner,
    depart: Time,
    maps: BTreeMap<i64, Vec<f32>>,
    scratch: OccupancyMap,
}

impl Buckets<'_> {
    /// The probability that the robot cannot be at a cell when it comes there after so many metres.
    fn p(&mut self, index: usize, length_m: f64) -> Result<f32> {
        let planner = self.planner;
        let after_s = length_m / planner.speed_m_s;
        let bucket = (after_s / planner.bucket_s) as i64;
        if let Some(map) = self.maps.get(&bucket) {
            return Ok(map[index]);
        }
        let middle_s = (bucket as f64 + 0.5) * planner.bucket_s;
        let time = self.depart.plus_us((middle_s * 1e6) as i64);
        self.forecast.predict_into(time, &mut self.scratch)?;
        let map = inflated(&self.scratch, planner.radius_m, planner.unknown);
        let p = map[index];
        self.maps.insert(bucket, map);
        Ok(p)
    }
}

/// The cells around a cell and how far they are.
fn neighbours(spec: &GridSpec, index: usize) -> impl Iterator<Item = (usize, f64)> {
    let [x, y, _] = spec.cell(index).map(i64::from);
    let [width, height, _] = spec.dims().map(i64::from);
    let side = spec.resolution_m();
    (0..9_i64).filter_map(move |step| {
        let (dx, dy) = (step % 3 - 1, step / 3 - 1);
        let (nx, ny) = (x + dx, y + dy);
        let is_inside = nx >= 0 && ny >= 0 && nx < width && ny < height;
        let is_other = dx != 0 || dy != 0;
        let length = if dx != 0 && dy != 0 {
            side * std::f64::consts::SQRT_2
        } else {
            side
        };
        (is_inside && is_other).then_some(((nx + width * ny) as usize, length))
    })
}

/// The straight way between two cells.
fn straight_m(spec: &GridSpec, a: usize, b: usize) -> f64 {
    let (a, b) = (spec.center(spec.cell(a)), spec.center(spec.cell(b)));
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two corridors of 20 m; the lower one is closed in every other minute.
    struct Gate {
        spec: GridSpec,
        p_closed: f32,
    }

    impl Gate {
        fn new(p_closed: f32) -> Result<Self> {
            let spec = GridSpec::new_2d([0.0, 0.0], 0.25, [80, 40])?;
            Ok(Self { spec, p_closed })
        }
    }

    impl Forecast for Gate {
        fn spec(&self) -> GridSpec {
            self.spec
        }

        fn predict_into(&mut self, time: Time, map: &mut OccupancyMap) -> Result<()> {
            let is_closed = time.as_s().rem_euclid(120.0) >= 60.0;
            for index in 0..self.spec.num_cells() {
                let [x, y, _] = self.spec.cell(index);
                let is_wall = (12..68).contains(&x) && (16..24).contains(&y);
                let is_gate = (38..42).contains(&x) && y < 16;
                let p = match (is_wall, is_gate && is_closed) {
                    (true, _) => 1.0,
                    (_, true) => self.p_closed,
                    _ => 0.0,
                };
                map.set(index, Some(p));
            }
            Ok(())
        }
    }

    const START: [f64; 2] = [1.0, 2.0];
    const GOAL: [f64; 2] = [19.0, 2.0];

    #[test]
    fn the_way_depends_on_what_is_there_when_the_robot_comes() -> Result<()> {
        let mut gate = Gate::new(0.9)?;
        let planner = Planner {
            speed_m_s: 1.0,
            bucket_s: 5.0,
            ..Planner::default()
        };
        // The gate is 9 m away.
        let mut plan = |depart: i64| planner.plan(&mut gate, START, GOAL, Time::from_s(depart));
        let open = plan(0)?.expect("a path");
        assert!((open.length_m - 18.0).abs() < 0.3 && open.p_free > 0.999);
        // Open now, but closed on arrival.
        let closed = plan(56)?.expect("a path");
        assert!(
            closed.length_m > 20.0 && closed.p_free > 0.999,
            "{}",
            closed.length_m
        );
        // Closed now, but open on arrival.
        let reopened = plan(116)?.expect("a path");
        assert!((reopened.length_m - 18.0).abs() < 0.3);
        let last = reopened.times.len() - 1;
        assert!((reopened.times[last].since_s(Time::from_s(116)) - reopened.length_m).abs() < 1e-3);
        Ok(())
    }

    #[test]
    fn a_risk_is_taken_where_the_way_round_is_longer_than_it_is_worth() -> Result<()> {
        let mut gate = Gate::new(0.3)?;
        let mut planner = Planner {
            bucket_s: 5.0,
            obstacle_m: 1.5,
            detour_m: 1.0,
            ..Planner::default()
        };
        let mut plan = |planner: &Planner| planner.plan(&mut gate, START, GOAL, Time::from_s(56));
        let risky = plan(&planner)?.expect("a path");
        assert!((risky.length_m - 18.0).abs() < 0.3);
        // The gate with the robot's radius is as long as an obstacle is meant to be.
        assert!((risky.p_free - 0.7).abs() < 0.06, "{}", risky.p_free);
        planner.detour_m = 100.0;
        assert!(plan(&planner)?.expect("a path").length_m > 20.0);
        Ok(())
    }

    #[test]
    fn without_a_path_there_is_no_plan_and_a_place_outside_is_an_error() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 0.25, [80, 40])?;
        let mut map = OccupancyMap::new_unknown(spec);
        for index in 0..spec.num_cells() {
            map.set(
                index,
                Some(if spec.cell(index)[0] == 40 { 1.0 } else { 0.0 }),
            );
        }
        let planner = Planner::default();
        assert_eq!(planner.plan(&mut map, START, GOAL, Time::from_s(0))?, None);
        let outside = planner.plan(&mut map, START, [99.0, 0.0], Time::from_s(0));
        assert_eq!(outside.expect_err("outside").kind(), ErrorKind::NotFound);
        let stopped = Planner {
            speed_m_s: 0.0,
            ..planner
        };
        assert!(
            stopped
                .plan(&mut map, START, GOAL, Time::from_s(0))
                .is_err()
        );
        // What is unknown is not entered, unless the robot is told to.
        let mut unknown = OccupancyMap::new_unknown(spec);
        assert_eq!(
            planner.plan(&mut unknown, START, GOAL, Time::from_s(0))?,
            None
        );
        let bold = Planner {
            unknown: Some(0.1),
            ..planner
        };
        assert!(
            bold.plan(&mut unknown, START, GOAL, Time::from_s(0))?
                .is_some()
        );
        Ok(())
    }
}

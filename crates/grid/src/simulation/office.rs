//! What does an office look like at any hour of any day?
//!
//! After the paper on lifelong maps (IROS 2016, sections V and VI): two rooms, between them a
//! corridor 1.5 m wide that is lined by cupboards 0.5 m deep, which are open by day; a second way
//! round through doors; desks, chairs and people.

use fremen::{Result, Time};

use crate::cells::{GridSpec, OccupancyMap};
use crate::pose::Pose2;
use crate::random::Random;
use crate::simulation::drive::resample;
use crate::simulation::habit::{Habit, day_of, hour_of, is_weekend};
use crate::simulation::people::Walkers;
use crate::simulation::scene::Scene;

/// Which of two offices: constants are chosen in one and judged in the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Eight cupboards along the corridor, as in the paper.
    Paper,
    /// A smaller office with six, to develop in.
    Development,
}

/// An office whose content follows the time of day and week.
#[derive(Clone, Debug)]
pub struct Office {
    seed: u64,
    plan: Plan,
    walls: Scene,
    cupboards: Vec<Cupboard>,
    doors: Vec<Door>,
    chairs: Vec<Chair>,
    trolleys: Vec<Habit>,
    walkers: Option<Walkers>,
    /// Furniture from the beginning, and what it becomes at a time.
    furniture: Scene,
    rearranged: Option<(Time, Scene)>,
}

/// Sizes of the rooms. x runs through the first room, the corridors and the second room.
#[derive(Clone, Copy, Debug)]
struct Plan {
    room_m: f64,
    height_m: f64,
    length_m: f64,
    /// Lower sides of the two corridors.
    main_m: f64,
    second_m: f64,
    per_side: usize,
}

const CORRIDOR_M: f64 = 1.5;
const CUPBOARD_M: f64 = 0.5;
/// Of the corridor before the first and behind the last cupboard.
const ENDS_M: f64 = 0.3;

#[derive(Clone, Copy, Debug)]
struct Cupboard {
    from_m: f64,
    to_m: f64,
    is_upper: bool,
    habit: Habit,
    id: u64,
}

#[derive(Clone, Copy, Debug)]
struct Door {
    from_m: [f64; 2],
    to_m: [f64; 2],
    habit: Habit,
    id: u64,
}

#[derive(Clone, Copy, Debug)]
struct Chair {
    home_m: [f64; 2],
    habit: Habit,
    id: u64,
}

/// What the streams of random numbers are for.
const BUILD: u64 = 1;
const FURNISH: u64 = 2;
const PULL: u64 = 3;
const CORNER: u64 = 4;
const TROLLEY: u64 = 900;

impl Office {
    /// The office of a seed: sizes of cupboards, habits and furniture differ from seed to seed.
    pub fn new(seed: u64, layout: Layout) -> Self {
        let mut random = Random::stream(seed, &[BUILD]);
        let mut plan = match layout {
            Layout::Paper => Plan {
                room_m: 8.0,
                height_m: 11.0,
                length_m: 0.0,
                main_m: 4.25,
                second_m: 8.6,
                per_side: 4,
            },
            Layout::Development => Plan {
                room_m: 6.0,
                height_m: 9.0,
                length_m: 0.0,
                main_m: 2.75,
                second_m: 6.8,
                per_side: 3,
            },
        };
        let width = random.between(1.3, 1.7);
        plan.length_m = plan.per_side as f64 * width + 2.0 * ENDS_M;
        let (first, length) = (plan.room_m, plan.length_m);
        let (right, height) = (first + length, plan.height_m);
        let mut walls = Scene::default();
        walls.add_box([0.0, 0.0], [right + plan.room_m, height]);
        let (low, high) = (plan.main_m, plan.main_m + CORRIDOR_M);
        let (second, top) = (plan.second_m, plan.second_m + CORRIDOR_M);
        // The walls between rooms and corridors leave the two ways open.
        for x in [first, right] {
            walls.add_segment([x, 0.0], [x, low]);
            walls.add_segment([x, high], [x, second]);
            walls.add_segment([x, top], [x, height]);
        }
        walls.add_segment([first, low - CUPBOARD_M], [right, low - CUPBOARD_M]);
        walls.add_segment([first, high + CUPBOARD_M], [right, high + CUPBOARD_M]);
        walls.add_segment([first, second], [right, second]);
        walls.add_segment([first, top], [right, top]);
        let cupboards = cupboards(&plan, width, &mut random);
        let doors = [first, right].map(|x| Door {
            from_m: [x, second],
            to_m: [x, top],
            habit: Habit {
                begin_h: random.between(6.5, 8.0),
                end_h: random.between(18.0, 20.0),
                jitter_h: 0.3,
                on_weekdays: 0.95,
                on_weekends: 0.05,
            },
            id: 500 + u64::from(x > first),
        });
        let (furniture, chairs) = furnish(&plan, &mut Random::stream(seed, &[FURNISH, 0]));
        let middle = low + 0.5 * CORRIDOR_M;
        let walkers = Walkers {
            num_people: 6,
            num_trips: 12,
            speed_m_s: 1.2,
            path: vec![
                [0.5 * first, 1.5],
                [0.5 * first, middle],
                [right + 0.5 * plan.room_m, middle],
                [right + 0.5 * plan.room_m, 1.5],
            ],
        };
        Self {
            seed,
            plan,
            walls,
            cupboards,
            doors: doors.to_vec(),
            chairs,
            trolleys: Vec::new(),
            walkers: Some(walkers),
            furniture,
            rearranged: None,
        }
    }

    /// The same office with trolleys that stand in the main corridor at certain hours, so that
    /// nobody passes there.
    #[must_use]
    pub fn with_trolleys(mut self) -> Self {
        let mut random = Random::stream(self.seed, &[TROLLEY]);
        let begin = random.between(9.0, 10.5);
        let later = random.between(14.0, 15.5);
        self.trolleys = [begin, later]
            .map(|begin_h| Habit {
                begin_h,
                end_h: begin_h + 1.5,
                jitter_h: 0.15,
                on_weekdays: 0.95,
                on_weekends: 0.0,
            })
            .to_vec();
        self
    }

    /// The same office without people.
    #[must_use]
    pub fn without_people(mut self) -> Self {
        self.walkers = None;
        self
    }

    /// The same office, whose furniture is moved to other places at `time` and stays there.
    #[must_use]
    pub fn rearranged_at(mut self, time: Time) -> Self {
        let mut random = Random::stream(self.seed, &[FURNISH, 1]);
        self.rearranged = Some((time, furnish(&self.plan, &mut random).0));
        self
    }

    /// Everything at one moment.
    pub fn scene(&self, time: Time) -> Scene {
        let mut scene = self.without_walkers(time);
        if let Some(walkers) = &self.walkers {
            for position in walkers.positions(self.seed, time) {
                scene.add_disc(position, 0.22);
            }
        }
        scene
    }

    /// Everything but people on their way.
    fn without_walkers(&self, time: Time) -> Scene {
        let mut scene = self.walls.clone();
        match &self.rearranged {
            Some((from, furniture)) if time >= *from => scene.extend(furniture),
            _ => scene.extend(&self.furniture),
        }
        for cupboard in &self.cupboards {
            cupboard.add_to(&mut scene, &self.plan, self.seed, time);
        }
        for door in &self.doors {
            if !door.habit.is_on(self.seed, door.id, time) {
                scene.add_segment(door.from_m, door.to_m);
            }
        }
        let (day, hour) = (day_of(time), hour_of(time).floor() as u64);
        for chair in &self.chairs {
            let [mut x, mut y] = chair.home_m;
            if chair.habit.is_on(self.seed, chair.id, time) {
                // Somebody sits there, and moves about once an hour.
                let mut random = Random::stream(self.seed, &[PULL, chair.id, day as u64, hour]);
                x += random.between(-0.3, 0.3);
                y += random.between(-0.3, 0.3);
            }
            scene.add_disc([x, y], 0.22);
        }
        let low = self.plan.main_m;
        let middle = self.plan.room_m + 0.5 * self.plan.length_m;
        for (number, trolley) in self.trolleys.iter().enumerate() {
            if trolley.is_on(self.seed, TROLLEY + number as u64, time) {
                scene.add_box(
                    [middle - 0.5, low + 0.2],
                    [middle + 0.5, low + CORRIDOR_M - 0.2],
                );
            }
        }
        scene
    }

    /// A grid over the whole office.
    ///
    /// # Errors
    /// As [`GridSpec::new_2d`].
    pub fn spec(&self, resolution_m: f64) -> Result<GridSpec> {
        let margin = 0.5;
        let size = [self.width_m(), self.plan.height_m]
            .map(|length| ((length + 2.0 * margin) / resolution_m).ceil() as u32);
        // Where surfaces lie inside of their cells is anybody's guess, as in a real building.
        let mut random = Random::stream(self.seed, &[CORNER]);
        let corner = [0, 1].map(|_| -margin - random.between(0.1, 0.9) * resolution_m);
        GridSpec::new_2d(corner, resolution_m, size)
    }

    fn width_m(&self) -> f64 {
        2.0 * self.plan.room_m + self.plan.length_m
    }

    /// The true map of furniture, doors and cupboards (not of people who walk by).
    pub fn true_map(&self, time: Time, spec: GridSpec) -> OccupancyMap {
        self.without_walkers(time).rasterize(spec, self.places()[0])
    }

    /// Places to go: in the first room, in the second room; nothing ever stands there.
    pub fn places(&self) -> [[f64; 2]; 2] {
        let x = 0.5 * self.plan.room_m;
        [[x, 1.5], [self.width_m() - x, 1.5]]
    }

    /// Whether the doors of the second way are all open.
    fn is_round_open(&self, time: Time) -> bool {
        self.doors
            .iter()
            .all(|door| door.habit.is_on(self.seed, door.id, time))
    }

    /// Whether no trolley stands in the main corridor.
    fn is_main_open(&self, time: Time) -> bool {
        let mut trolleys = self.trolleys.iter().enumerate();
        !trolleys.any(|(number, habit)| habit.is_on(self.seed, TROLLEY + number as u64, time))
    }

    /// The way of a patrol: through both rooms and corridors, as far as they are open; into the
    /// others it looks.
    pub fn patrol(&self, time: Time, step_m: f64) -> Vec<Pose2> {
        let plan = &self.plan;
        let middle = plan.main_m + 0.5 * CORRIDOR_M;
        let round = plan.second_m + 0.5 * CORRIDOR_M;
        let [a, b] = self.places();
        // Patrols take minutes.
        let soon = time.plus_us(600_000_000);
        let is_open = |is_open: &dyn Fn(Time) -> bool| is_open(time) && is_open(soon);
        let is_main_open = is_open(&|time| self.is_main_open(time));
        let is_round_open = is_open(&|time| self.is_round_open(time));
        let mut corners = match (is_main_open, is_round_open) {
            (true, true) => vec![
                a,
                [a[0], middle],
                [b[0], middle],
                b,
                [b[0], round],
                [a[0], round],
            ],
            (true, false) => vec![
                a,
                [a[0], middle],
                [b[0], middle],
                b,
                [b[0], round],
                [b[0], middle],
                [a[0], middle],
                [a[0], round],
            ],
            (false, true) => vec![
                a,
                [a[0], middle],
                [a[0], round],
                [b[0], round],
                [b[0], middle],
                b,
                [b[0], round],
                [a[0], round],
            ],
            (false, false) => vec![a, [a[0], middle], [a[0], round]],
        };
        corners.push(a);
        resample(&corners, step_m)
    }

    /// A pass through the corridor of cupboards, in either direction and not quite in its middle.
    pub fn pass(&self, step_m: f64, random: &mut Random) -> Vec<Pose2> {
        let plan = &self.plan;
        let middle = plan.main_m + 0.5 * CORRIDOR_M + random.between(-0.2, 0.2);
        let mut ends = [plan.room_m - 2.0, plan.room_m + plan.length_m + 2.0];
        if random.chance(0.5) {
            ends.reverse();
        }
        let aside = random.between(-0.15, 0.15);
        resample(
            &[[ends[0], middle - aside], [ends[1], middle + aside]],
            step_m,
        )
    }

    /// Whether `time` is in the working hours of a weekday.
    pub fn is_at_work(time: Time) -> bool {
        !is_weekend(day_of(time)) && (9.5..16.5).contains(&hour_of(time))
    }
}

impl Cupboard {
    fn add_to(&self, scene: &mut Scene, plan: &Plan, seed: u64, time: Time) {
        let (front, back) = if self.is_upper {
            (
                plan.main_m + CORRIDOR_M,
                plan.main_m + CORRIDOR_M + CUPBOARD_M,
            )
        } else {
            (plan.main_m, plan.main_m - CUPBOARD_M)
        };
        // The sides are there in any case; where all are closed, the corridor is smooth.
        for x in [self.from_m, self.to_m] {
            scene.add_segment([x, front], [x, back]);
        }
        if !self.habit.is_on(seed, self.id, time) {
            scene.add_segment([self.from_m, front], [self.to_m, front]);
        }
    }
}

fn cupboards(plan: &Plan, width_m: f64, random: &mut Random) -> Vec<Cupboard> {
    let mut cupboards = Vec::new();
    for is_upper in [false, true] {
        let mut x = plan.room_m + ENDS_M;
        for number in 0..plan.per_side {
            // Most are open all day, some in the morning or afternoon, some hardly ever.
            let (begin_h, end_h, on_weekdays) = match random.below(10) {
                0 => (8.5, 17.0, 0.05),
                1 | 2 => (8.0, 12.5, 0.85),
                3 | 4 => (12.5, 17.5, 0.85),
                _ => (8.2, 17.6, 0.92),
            };
            cupboards.push(Cupboard {
                from_m: x,
                to_m: x + width_m,
                is_upper,
                habit: Habit {
                    begin_h,
                    end_h,
                    jitter_h: 0.4,
                    on_weekdays,
                    on_weekends: 0.03,
                },
                id: 100 + number as u64 + if is_upper { 50 } else { 0 },
            });
            x += width_m;
        }
    }
    cupboards
}

/// Desks and shelves beside the ways, and a chair for each desk.
fn furnish(plan: &Plan, random: &mut Random) -> (Scene, Vec<Chair>) {
    let mut scene = Scene::default();
    let mut chairs = Vec::new();
    let second_room = plan.room_m + plan.length_m;
    let mut taken: Vec<[f64; 2]> = Vec::new();
    for (room, left) in [(0_u64, 0.0), (1, second_room)] {
        let middle = left + 0.5 * plan.room_m;
        let mut number = 0_u64;
        for _ in 0..400 {
            if number == 6 {
                break;
            }
            let size = [random.between(0.5, 0.9), random.between(0.4, 0.7)];
            let at = [
                random.between(left + 0.7, left + plan.room_m - 0.7),
                random.between(0.7, plan.height_m - 0.7),
            ];
            // Not on the ways through the room, and not on other furniture.
            let ways = [plan.main_m, plan.second_m].map(|y| y + 0.5 * CORRIDOR_M);
            let on_way =
                (at[0] - middle).abs() < 1.3 || ways.iter().any(|y| (at[1] - y).abs() < 1.6);
            let on_other = taken
                .iter()
                .any(|t| (t[0] - at[0]).hypot(t[1] - at[1]) < 1.4);
            if on_way || on_other {
                continue;
            }
            taken.push(at);
            scene.add_box(
                [at[0] - 0.5 * size[0], at[1] - 0.5 * size[1]],
                [at[0] + 0.5 * size[0], at[1] + 0.5 * size[1]],
            );
            let toward = if at[0] < middle { 1.0 } else { -1.0 };
            chairs.push(Chair {
                home_m: [at[0] + toward * (0.5 * size[0] + 0.3), at[1]],
                habit: Habit {
                    begin_h: random.between(8.0, 10.0),
                    end_h: random.between(15.5, 18.5),
                    jitter_h: 0.5,
                    on_weekdays: random.between(0.6, 0.95),
                    on_weekends: 0.05,
                },
                id: 700 + 20 * room + number,
            });
            number += 1;
        }
    }
    (scene, chairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells::{CellState, Thresholds};
    use crate::simulation::habit::MONDAY;

    fn at(day: i64, hour: i64) -> Time {
        MONDAY.plus_us((day * 24 + hour) * 3_600_000_000)
    }

    #[test]
    fn cupboards_are_open_by_day_and_hide_their_back_at_night() -> Result<()> {
        let office = Office::new(4, Layout::Paper);
        let spec = office.spec(0.05)?;
        let (night, day) = (
            office.true_map(at(1, 3), spec),
            office.true_map(at(1, 14), spec),
        );
        let count = |map: &OccupancyMap, state| {
            (0..spec.num_cells())
                .filter(|&index| map.state(index, Thresholds::default()) == state)
                .count()
        };
        // By day more is seen, and less of it is hidden.
        assert!(count(&day, CellState::Free) > count(&night, CellState::Free) + 500);
        assert!(count(&day, CellState::Unknown) + 500 < count(&night, CellState::Unknown));
        // Sundays are like nights.
        let sunday = office.true_map(at(6, 14), spec);
        assert!(
            count(&sunday, CellState::Free) < count(&night, CellState::Free) + 300,
            "few things move on Sundays"
        );
        Ok(())
    }

    #[test]
    fn ways_are_free_and_rearranged_furniture_stays() {
        for layout in [Layout::Paper, Layout::Development] {
            for seed in 0..5 {
                let office = Office::new(seed, layout).without_people();
                for (day, hour) in [(0, 3), (1, 11), (2, 15), (6, 12)] {
                    let time = at(day, hour);
                    let scene = office.scene(time);
                    for pose in office.patrol(time, 0.5) {
                        assert!(!scene.is_blocked([pose.x_m, pose.y_m], 0.25), "{pose:?}");
                    }
                }
            }
        }
        let office = Office::new(1, Layout::Paper).rearranged_at(at(3, 0));
        let before = office.scene(at(2, 3));
        assert_eq!(before, Office::new(1, Layout::Paper).scene(at(2, 3)));
        assert_ne!(
            office.scene(at(3, 3)),
            Office::new(1, Layout::Paper).scene(at(3, 3))
        );
    }

    #[test]
    fn trolleys_close_the_corridor_at_their_hours_only() {
        let office = Office::new(2, Layout::Paper)
            .with_trolleys()
            .without_people();
        let mut random = Random::new(1);
        let path = office.pass(0.1, &mut random);
        let blocked = |time| {
            let scene = office.scene(time);
            path.iter()
                .any(|pose| scene.is_blocked([pose.x_m, pose.y_m], 0.25))
        };
        assert!(!blocked(at(1, 3)) && !blocked(at(6, 11)));
        let num_blocked = (0..14).filter(|&hour| blocked(at(1, 8 + hour))).count();
        assert!((2..6).contains(&num_blocked), "{num_blocked}");
    }
}

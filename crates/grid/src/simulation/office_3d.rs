//! What does a fixed depth camera see of an office in sixteen weeks?
//!
//! After the experiment of T-RO 2017, section VI: 213,000 voxels, a frame every five seconds,
//! 112 days. People sit at their desks on weekdays, with lunch and breaks; cupboards and blinds
//! have their hours, a door opens and closes, a robot charges at night, boxes come and go without
//! any rhythm, somebody walks through, and voxels at the edges of surfaces flicker. Voxels inside
//! of walls and furniture are never seen: they are unknown.

use std::collections::BTreeMap;

use fremen::{Result, Time};

use super::habit::{MONDAY, is_weekend};
use crate::cells::{CellState, GridSpec, Patch};
use crate::random::Random;

/// Voxels along each axis: 213,000.
const DIMS: [u32; 3] = [71, 60, 50];
const RESOLUTION_M: f64 = 0.1;
const FRAME_S: i64 = 5;
const FRAMES_PER_DAY: i64 = 86_400 / FRAME_S;
const FRAMES_PER_HOUR: f64 = 3_600.0 / FRAME_S as f64;
/// Flickering voxels a frame, on average.
const FLICKERS_PER_FRAME: f64 = 3.0;

/// A box of voxels: from, to (exclusive).
type Extent = [[u32; 3]; 2];

/// The simulated office; a function of its seed and its number of days.
#[derive(Debug)]
pub struct Office3d {
    spec: GridSpec,
    num_frames: usize,
    /// The voxels of each thing that comes and goes.
    things: Vec<Vec<u32>>,
    /// Frame, thing, whether it is there from then on; in the order of frames.
    events: Vec<(u32, u16, bool)>,
    /// Voxels that flicker.
    edges: Vec<u32>,
    first: Patch,
    seed: u64,
}

impl Office3d {
    /// An office that is watched for `num_days` from a Monday on.
    ///
    /// # Errors
    /// None in practice: the grid is valid.
    pub fn new(seed: u64, num_days: u32) -> Result<Self> {
        let spec = GridSpec::new_3d([0.0; 3], RESOLUTION_M, DIMS)?;
        let mut plan = Plan::new(seed, i64::from(num_days));
        plan.furnish();
        let mut first = Patch::new([0; 3], DIMS, vec![CellState::Free; spec.num_cells()])?;
        for &(extent, state) in &fixtures() {
            fill(extent, |cell| first.set(cell, state));
        }
        let visible = |index: u32| first.get(spec.cell(index as usize)) == CellState::Free;
        let things = plan.things.iter().map(|extents| {
            let mut cells: Vec<u32> = Vec::new();
            for &extent in extents {
                fill(extent, |cell| cells.push(spec.index(cell) as u32));
            }
            cells.sort_unstable();
            cells.dedup();
            cells.retain(|&index| visible(index));
            cells
        });
        let things: Vec<Vec<u32>> = things.collect();
        let edges = edges_of(&spec, &first, &mut Random::stream(seed, &[99]));
        plan.events.sort_unstable();
        Ok(Self {
            spec,
            num_frames: num_days as usize * FRAMES_PER_DAY as usize,
            things,
            events: plan.events,
            edges,
            first,
            seed,
        })
    }

    /// Where the voxels are.
    pub const fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// How many frames there are, the first among them.
    pub const fn num_frames(&self) -> usize {
        self.num_frames
    }

    /// The first frame, at midnight: nobody is there.
    pub const fn first(&self) -> &Patch {
        &self.first
    }

    /// When a frame is taken.
    pub const fn time(&self, frame: usize) -> Time {
        MONDAY.plus_us(frame as i64 * FRAME_S * 1_000_000)
    }

    /// The frames after the first, each as the voxels that changed since the one before.
    pub fn frames(&self) -> Frames<'_> {
        let num_cells = self.spec.num_cells();
        let mut covers = vec![0; num_cells];
        for (index, cover) in covers.iter_mut().enumerate() {
            let state = self.first.states()[index];
            // What is fixed stays occupied, whatever else is there.
            *cover = u16::from(state == CellState::Occupied);
        }
        let is_occupied = covers.iter().map(|&it| it > 0).collect();
        Frames {
            office: self,
            random: Random::stream(self.seed, &[7]),
            frame: 0,
            next_event: 0,
            covers,
            flickers: BTreeMap::new(),
            is_occupied,
            touched: Vec::new(),
            changes: Vec::new(),
        }
    }
}

/// Frame after frame of an office.
#[derive(Debug)]
pub struct Frames<'a> {
    office: &'a Office3d,
    random: Random,
    frame: usize,
    next_event: usize,
    /// How many things are in each voxel.
    covers: Vec<u16>,
    /// Voxels that are seen wrongly, and until which frame.
    flickers: BTreeMap<u32, usize>,
    is_occupied: Vec<bool>,
    touched: Vec<u32>,
    changes: Vec<(u32, CellState)>,
}

impl Frames<'_> {
    /// Goes on to the next frame: when it is taken, and what changed, ascending; none at the end.
    pub fn advance(&mut self) -> Option<(Time, &[(u32, CellState)])> {
        let office = self.office;
        self.frame += 1;
        if self.frame >= office.num_frames {
            return None;
        }
        self.touched.clear();
        while let Some(&(frame, thing, comes)) = office.events.get(self.next_event)
            && frame as usize <= self.frame
        {
            for &cell in &office.things[usize::from(thing)] {
                let cover = &mut self.covers[cell as usize];
                *cover = if comes {
                    *cover + 1
                } else {
                    cover.saturating_sub(1)
                };
            }
            self.touched
                .extend_from_slice(&office.things[usize::from(thing)]);
            self.next_event += 1;
        }
        self.flicker();
        self.touched.sort_unstable();
        self.touched.dedup();
        self.changes.clear();
        for &cell in &self.touched {
            let at = cell as usize;
            let is_occupied = (self.covers[at] > 0) != self.flickers.contains_key(&cell);
            if is_occupied != self.is_occupied[at] {
                self.is_occupied[at] = is_occupied;
                let state = if is_occupied {
                    CellState::Occupied
                } else {
                    CellState::Free
                };
                self.changes.push((cell, state));
            }
        }
        Some((office.time(self.frame), &self.changes))
    }

    /// Some voxels begin to be seen wrongly, others end.
    fn flicker(&mut self) {
        let frame = self.frame;
        let touched = &mut self.touched;
        self.flickers.retain(|&cell, &mut until| {
            if until <= frame {
                touched.push(cell);
            }
            until > frame
        });
        let mut left = FLICKERS_PER_FRAME;
        while self.random.uniform() < left {
            let cell = self.office.edges[self.random.below(self.office.edges.len())];
            let len = 1 + usize::from(self.random.chance(0.2));
            self.flickers.insert(cell, frame + len);
            self.touched.push(cell);
            left -= 0.5;
        }
    }
}

/// What comes and goes when.
struct Plan {
    random: Random,
    num_days: i64,
    things: Vec<Vec<Extent>>,
    events: Vec<(u32, u16, bool)>,
}

impl Plan {
    fn new(seed: u64, num_days: i64) -> Self {
        let random = Random::stream(seed, &[1]);
        Self {
            random,
            num_days,
            things: Vec::new(),
            events: Vec::new(),
        }
    }

    fn furnish(&mut self) {
        for desk in 0..6 {
            self.worker(desk);
        }
        for cupboard in 0..8 {
            self.cupboard(cupboard);
        }
        for window in 0..3 {
            self.blind(window);
        }
        self.door();
        self.robot();
        for shelf in 0..10 {
            self.parcel(shelf);
        }
        self.walkers();
    }

    fn thing(&mut self, extents: Vec<Extent>) -> u16 {
        self.things.push(extents);
        self.things.len() as u16 - 1
    }

    /// A thing is there from one hour of a day to another, as far as that is watched.
    fn is_there(&mut self, thing: u16, day: i64, from_h: f64, to_h: f64) {
        let frame = |hour: f64| {
            let frame = day * FRAMES_PER_DAY + (hour * FRAMES_PER_HOUR) as i64;
            frame.clamp(0, self.num_days * FRAMES_PER_DAY) as u32
        };
        let (from, to) = (frame(from_h).max(1), frame(to_h));
        if from < to {
            self.events.push((from, thing, true));
            self.events.push((to, thing, false));
        }
    }

    /// At work on weekdays, at the desk but for lunch and breaks; the empty chair stands pushed in.
    fn worker(&mut self, desk: u32) {
        let [x, y] = [6 + 20 * (desk % 3), 14 + 26 * (desk / 3)];
        let person = self.thing(vec![
            [[x, y, 0], [x + 5, y + 6, 9]],
            [[x + 1, y + 1, 9], [x + 4, y + 5, 14]],
        ]);
        let chair = self.thing(vec![[[x, y + 6, 0], [x + 5, y + 9, 8]]]);
        let mut left_h = 0.0;
        let mut chair_from = 0;
        for day in 0..self.num_days {
            let works = if is_weekend(day) { 0.03 } else { 0.93 };
            if !self.random.chance(works) {
                continue;
            }
            let arrives = 8.4 + self.random.normal(0.4);
            let leaves = 17.0 + self.random.normal(0.5);
            let lunch = 12.1 + self.random.normal(0.15);
            self.chair(chair, (chair_from, left_h), (day, arrives));
            self.sits(person, day, arrives, lunch);
            let back = lunch + self.random.between(0.5, 0.9);
            self.sits(person, day, back, leaves);
            (chair_from, left_h) = (day, leaves);
        }
        self.chair(chair, (chair_from, left_h), (self.num_days, 0.0));
    }

    fn chair(&mut self, chair: u16, from: (i64, f64), to: (i64, f64)) {
        self.is_there(chair, from.0, from.1, (to.0 - from.0) as f64 * 24.0 + to.1);
    }

    /// At the desk, with a break now and then.
    fn sits(&mut self, person: u16, day: i64, from_h: f64, to_h: f64) {
        let mut from_h = from_h;
        while from_h < to_h {
            let until_h = (from_h + self.random.between(0.6, 2.2)).min(to_h);
            self.is_there(person, day, from_h, until_h);
            from_h = until_h + self.random.between(0.05, 0.2);
        }
    }

    /// The doors of a cupboard stand open by day.
    fn cupboard(&mut self, cupboard: u32) {
        let x = 3 + 8 * cupboard;
        let open = self.thing(vec![[[x, 50, 1], [x + 1, 55, 19]]]);
        let closed = self.thing(vec![[[x, 55, 1], [x + 5, 56, 19]]]);
        let mut closed_h = 0.0;
        for day in 0..self.num_days {
            let opens = if is_weekend(day) { 0.02 } else { 0.85 };
            if self.random.chance(opens) {
                let from = 8.8 + 0.2 * f64::from(cupboard % 4) + self.random.normal(0.4);
                let to = 16.8 + self.random.normal(0.5);
                self.is_there(open, day, from, to);
                self.is_there(closed, 0, closed_h, day as f64 * 24.0 + from);
                closed_h = day as f64 * 24.0 + to;
            }
        }
        self.is_there(closed, 0, closed_h, self.num_days as f64 * 24.0);
    }

    /// Down while the sun shines in, on most days of the week.
    fn blind(&mut self, window: u32) {
        let y = 6 + 18 * window;
        let blind = self.thing(vec![[[68, y, 10], [69, y + 14, 30]]]);
        for day in 0..self.num_days {
            if self.random.chance(0.8) {
                let from = 10.5 + self.random.normal(0.4);
                let to = 15.5 + self.random.normal(0.4);
                self.is_there(blind, day, from, to);
            }
        }
    }

    /// Opens and closes all day, and is locked at night.
    fn door(&mut self) {
        let open = self.thing(vec![[[30, 1, 0], [31, 10, 21]]]);
        let closed = self.thing(vec![[[30, 1, 0], [39, 2, 21]]]);
        let mut closed_h = 0.0;
        for day in 0..self.num_days {
            if is_weekend(day) {
                continue;
            }
            let start = day as f64 * 24.0;
            let mut hour = 7.8 + self.random.normal(0.2);
            while hour < 18.0 {
                let until = hour + self.random.between(0.3, 1.6);
                self.is_there(open, day, hour, until);
                self.is_there(closed, 0, closed_h, start + hour);
                closed_h = start + until;
                hour = until + self.random.between(0.05, 0.3);
            }
        }
        self.is_there(closed, 0, closed_h, self.num_days as f64 * 24.0);
    }

    /// Charges at night, and an hour at noon.
    fn robot(&mut self) {
        let robot = self.thing(vec![[[60, 3, 0], [66, 9, 14]]]);
        for day in 0..self.num_days {
            let leaves = 6.9 + self.random.normal(0.1);
            self.is_there(robot, day, 0.0, leaves);
            let noon = 12.0 + self.random.normal(0.3);
            self.is_there(robot, day, noon, noon + 1.0);
            let returns = 19.2 + self.random.normal(0.2);
            self.is_there(robot, day, returns, 24.0);
        }
    }

    /// Comes and goes on working days, without any rhythm.
    fn parcel(&mut self, shelf: u32) {
        let x = 4 + 6 * shelf;
        let parcel = self.thing(vec![[[x, 3, 10], [x + 4, 7, 14]]]);
        let mut day = self.random.below(12) as i64;
        while day < self.num_days {
            let from = self.random.between(9.0, 17.0);
            let stays = self.random.between(1.0, 9.0);
            self.is_there(parcel, day, from, from + 24.0 * stays);
            day += stays as i64 + 2 + self.random.below(9) as i64;
        }
    }

    /// Somebody crosses the room, seen in three frames.
    fn walkers(&mut self) {
        let steps: Vec<Vec<u16>> = (0..6)
            .map(|lane| {
                let step = |i: u32| {
                    let [x, y] = [4 + 22 * i + 2 * lane, 24 + 2 * lane];
                    self.thing(vec![
                        [[x, y, 0], [x + 3, y + 5, 15]],
                        [[x, y + 1, 15], [x + 3, y + 4, 18]],
                    ])
                };
                (0..3).map(step).collect()
            })
            .collect();
        for day in 0..self.num_days {
            let num = if is_weekend(day) {
                2
            } else {
                90 + self.random.below(40)
            };
            for _ in 0..num {
                let hour = 8.0 + 9.5 * (self.random.uniform() + self.random.uniform()) / 2.0;
                let lane = &steps[self.random.below(steps.len())];
                for (i, &thing) in lane.iter().enumerate() {
                    let from = hour + i as f64 / FRAMES_PER_HOUR;
                    self.is_there(thing, day, from, from + 1.0 / FRAMES_PER_HOUR);
                }
            }
        }
    }
}

/// Walls, floor, desks, and what cannot be seen inside of them.
fn fixtures() -> Vec<(Extent, CellState)> {
    use CellState::{Occupied, Unknown};
    let [w, h, d] = DIMS;
    let mut fixtures = vec![
        ([[0, h - 1, 0], [w, h, d]], Occupied),
        ([[0, 0, 0], [1, h, d]], Occupied),
        ([[w - 1, 0, 0], [w, h, d]], Occupied),
        // Behind the front of the cupboards.
        ([[2, 57, 1], [68, 59, 20]], Unknown),
    ];
    for desk in 0..6 {
        let [x, y] = [4 + 20 * (desk % 3), 20 + 26 * (desk / 3)];
        fixtures.push(([[x, y, 7], [x + 12, y + 4, 8]], Occupied));
        // Drawers below it.
        fixtures.push(([[x + 8, y, 0], [x + 12, y + 4, 7]], Occupied));
        fixtures.push(([[x + 9, y + 1, 0], [x + 11, y + 3, 6]], Unknown));
    }
    fixtures
}

fn fill(extent: Extent, mut with: impl FnMut([u32; 3])) {
    let [from, to] = extent;
    for z in from[2]..to[2].min(DIMS[2]) {
        for y in from[1]..to[1].min(DIMS[1]) {
            for x in from[0]..to[0].min(DIMS[0]) {
                with([x, y, z]);
            }
        }
    }
}

/// Free voxels in front of something fixed: some of them are seen wrongly now and then.
fn edges_of(spec: &GridSpec, first: &Patch, random: &mut Random) -> Vec<u32> {
    let mut edges = Vec::new();
    for index in 0..spec.num_cells() {
        let [x, y, z] = spec.cell(index);
        let is_edge = first.get([x, y, z]) == CellState::Free
            && (first.get([x, y + 1, z]) == CellState::Occupied
                || first.get([x + 1, y, z]) == CellState::Occupied
                || first.get([x, y, z + 1]) == CellState::Occupied);
        if is_edge && random.chance(0.4) {
            edges.push(index as u32);
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_office_is_seen_each_time_and_frames_are_what_changes() -> Result<()> {
        let office = Office3d::new(3, 2)?;
        assert_eq!(office.spec().num_cells(), 213_000);
        let mut states: Vec<CellState> = office.first().states().to_vec();
        let (mut frames, mut again) = (office.frames(), office.frames());
        let (mut num_frames, mut num_changes) = (1, 0);
        while let Some((time, changes)) = frames.advance() {
            assert_eq!(again.advance(), Some((time, changes)));
            assert!(changes.windows(2).all(|pair| pair[0].0 < pair[1].0));
            for &(cell, state) in changes {
                let before = std::mem::replace(&mut states[cell as usize], state);
                assert!(before.is_known() && before != state);
            }
            num_frames += 1;
            num_changes += changes.len();
        }
        assert_eq!(num_frames, office.num_frames());
        assert!(num_changes > 100_000, "{num_changes}");
        Ok(())
    }
}

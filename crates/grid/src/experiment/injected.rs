//! Are changes found again that were put into recorded scans?
//!
//! A log is one session of a still building. Here its scans are dealt out to patrols of a week, one
//! every three hours, and boxes are put into the building: every beam that would meet one ends there.
//! Everything else, the walls with all their faults, is as it was recorded.

use fremen::{CandidatePeriods, Period, Result, Time};

use super::carmen::{CarmenConfig, map_of};
use super::world::{moment, patch_of};
use crate::cells::{CellState, GridSpec, OccupancyMap, Patch, Thresholds};
use crate::localize::DistanceField;
use crate::model::{CellModel, GridConfig, Persistence};
use crate::picture::{contradictions_png, occupancy_png, rhythms_png};
use crate::pose::{Pose2, wrap};
use crate::random::Random;
use crate::registration::{Decision, Guard, GuardConfig};
use crate::scan::{Beam, CarmenLog, CarmenScan, InverseSensorModel, LaserScan, ScanMapper};
use crate::simulation::Scene;
use crate::temporal::TemporalGrid;

/// What is put in.
#[derive(Clone, Debug, PartialEq)]
pub struct InjectedConfig {
    /// How the log is read.
    pub carmen: CarmenConfig,
    /// Of the boxes' places and of the noise of poses.
    pub seed: u64,
    /// Patrols, one every three hours.
    pub num_patrols: usize,
    /// Boxes that are there every day from 8 to 18 o'clock.
    pub num_daily: usize,
    /// Boxes that are put in for one patrol: a row of the table each.
    pub num_sudden: Vec<usize>,
    /// How maps are judged.
    pub guard: GuardConfig,
    /// Whether pictures are drawn.
    pub draws: bool,
}

impl Default for InjectedConfig {
    fn default() -> Self {
        Self {
            carmen: CarmenConfig::default(),
            seed: 1,
            num_patrols: 72,
            num_daily: 10,
            num_sudden: vec![1, 5, 20],
            guard: GuardConfig::default(),
            draws: true,
        }
    }
}

/// Patrols with boxes that are there for one patrol only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sudden {
    /// Boxes in each of these patrols.
    pub num_boxes: usize,
    /// Judged patrols with boxes, and how many of these maps were quarantined.
    pub num_changed: usize,
    /// See [`num_changed`](Self::num_changed).
    pub num_changed_held: usize,
    /// Judged patrols without, and how many of these maps were quarantined.
    pub num_unchanged: usize,
    /// See [`num_unchanged`](Self::num_unchanged).
    pub num_unchanged_held: usize,
}

/// By what boxes that follow the day are predicted.
pub const DAILY_BY: [&str; 5] = [
    "FreMEn + persistence",
    "FreMEn + surprise",
    "FreMEn",
    "phase histogram",
    "last",
];

/// Boxes that follow the day.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Daily {
    /// Surfaces of boxes that the last two days' patrols saw.
    pub num_there: u64,
    /// How many of these were predicted by each of [`DAILY_BY`].
    pub num_there_foreseen: [u64; DAILY_BY.len()],
    /// The same cells when they were seen without a box.
    pub num_gone: u64,
    /// How often that was predicted.
    pub num_gone_foreseen: [u64; DAILY_BY.len()],
    /// Cells of these surfaces, and how many of them have a day as their strongest rhythm.
    pub num_cells: u64,
    /// See [`num_cells`](Self::num_cells).
    pub num_of_a_day: u64,
    /// Judged maps, and how many of them were quarantined.
    pub num_judged: usize,
    /// See [`num_judged`](Self::num_judged).
    pub num_held: usize,
}

/// Boxes that come to stay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moved {
    /// Boxes.
    pub num_boxes: usize,
    /// Maps that were quarantined before the change was believed.
    pub num_held: usize,
    /// After how many patrols all further maps are believed.
    pub believed_after: usize,
    /// Whether the guard recognised the change.
    pub is_adopted: bool,
    /// Surfaces of these boxes in the last patrols, and how many of them were predicted.
    pub num_there: u64,
    /// See [`num_there`](Self::num_there).
    pub num_there_foreseen: u64,
}

/// What was found of what was put into a log.
#[derive(Clone, Debug, PartialEq)]
pub struct InjectedReport {
    /// One for each number of boxes.
    pub sudden: Vec<Sudden>,
    /// The boxes of every day.
    pub daily: Daily,
    /// As many boxes as the most sudden ones, from two thirds of the patrols on.
    pub moved: Moved,
    /// What the guard saw of each map of the patrols with the most boxes: the disagreement, the
    /// limit, whether boxes were put in.
    pub seen: Vec<(f64, f64, bool)>,
    /// Pictures with their titles: four hours of the day after, the rhythms, a quarantined map.
    pub pictures: Vec<(String, Vec<u8>)>,
}

/// What the guard saw of a map: the disagreement, the limit, whether boxes were put in.
type Seen = (f64, f64, bool);
/// With their titles.
type Pictures = Vec<(String, Vec<u8>)>;

/// Side of a box.
const BOX_M: f64 = 0.7;
/// Hours between patrols.
const EVERY_H: f64 = 3.0;
/// Boxes of every day are there between these hours.
const THERE_H: [f64; 2] = [8.0, 18.0];
/// One judged patrol of so many has sudden boxes.
const SUDDEN_EVERY: usize = 5;
/// The hours that are drawn.
const DRAWN_H: [f64; 4] = [3.0, 9.5, 13.0, 21.0];

/// Puts boxes into the scans of a log.
///
/// # Errors
/// As the map, the guard and the grid.
pub fn injected(log: &CarmenLog, config: &InjectedConfig) -> Result<InjectedReport> {
    let site = Site::new(log, config)?;
    let mut seen = Vec::new();
    let mut pictures = Vec::new();
    let mut sudden = Vec::new();
    for &num_boxes in &config.num_sudden {
        let (found, row) = site.sudden(num_boxes, &mut pictures)?;
        sudden.push(found);
        seen = row;
    }
    let most = config.num_sudden.iter().copied().max().unwrap_or(1);
    let moved = site.moved(most)?;
    let (daily, drawn) = site.daily()?;
    pictures.splice(0..0, drawn);
    Ok(InjectedReport {
        sudden,
        daily,
        moved,
        seen,
        pictures,
    })
}

/// A recorded building.
struct Site<'a> {
    log: &'a CarmenLog,
    config: &'a InjectedConfig,
    spec: GridSpec,
    /// Where a box fits: free all round, seen by the robot, off its way.
    places: Vec<[f64; 2]>,
}

/// One patrol's map with what was put into it.
struct Patrol {
    time: Time,
    patch: Patch,
    map: OccupancyMap,
    /// Cells in which a beam ended on a box.
    boxes: Vec<usize>,
}

impl<'a> Site<'a> {
    fn new(log: &'a CarmenLog, config: &'a InjectedConfig) -> Result<Self> {
        let map = map_of(log, &config.carmen)?;
        let spec = *map.spec();
        let far_m = 4.0 * BOX_M;
        let walls = DistanceField::new(&map, Thresholds::default(), far_m);
        let mut is_way = vec![false; spec.num_cells()];
        for scan in &log.scans {
            if let Some(cell) = spec.cell_at([scan.pose.x_m, scan.pose.y_m, 0.0]) {
                is_way[spec.index(cell)] = true;
            }
        }
        let way = DistanceField::to_cells(spec, far_m, |index| is_way[index]);
        let fits = |index: usize| {
            map.get(index).is_some_and(|p| p < 0.2)
                && walls.of_cell(index) > 0.5 * BOX_M + 0.15
                && (BOX_M..far_m).contains(&way.of_cell(index))
        };
        let places = (0..spec.num_cells()).filter(|&index| fits(index));
        let places = places.map(|index| {
            let [x, y, _] = spec.center(spec.cell(index));
            [x, y]
        });
        Ok(Self {
            log,
            config,
            spec,
            places: places.collect(),
        })
    }

    /// Boxes at random places, apart from each other as far as there is room.
    fn boxes(&self, num: usize, random: &mut Random) -> Scene {
        let mut scene = Scene::default();
        let mut centers: Vec<[f64; 2]> = Vec::new();
        for _ in 0..200 * num {
            if centers.len() == num || self.places.is_empty() {
                break;
            }
            let [x, y] = self.places[random.below(self.places.len())];
            let apart = |other: &[f64; 2]| (x - other[0]).hypot(y - other[1]) > 1.5 * BOX_M;
            if centers.iter().all(apart) {
                let half = 0.5 * BOX_M;
                scene.add_box([x - half, y - half], [x + half, y + half]);
                centers.push([x, y]);
            }
        }
        scene
    }

    fn time(number: usize) -> Time {
        moment(0, 1.0 + EVERY_H * number as f64)
    }

    /// The map of a patrol with these boxes. Every patrol has other scans of the log, as far as they
    /// go, each at a pose that is a little off.
    fn patrol(&self, number: usize, boxes: &Scene) -> Result<Patrol> {
        let num_groups = (self.log.scans.len() / 60).clamp(1, self.config.num_patrols);
        let mut random = Random::stream(self.config.seed, &[0x494e_4a45, number as u64]);
        let mut mapper = ScanMapper::new(self.spec, InverseSensorModel::reduced());
        let mut hits = Vec::new();
        let scans = self.log.scans.iter().skip(number % num_groups);
        for scan in scans.step_by(num_groups) {
            let pose = Pose2::new(
                scan.pose.x_m + random.normal(0.01),
                scan.pose.y_m + random.normal(0.01),
                wrap(scan.pose.heading_rad + random.normal(0.003)),
            );
            let (ranges, on_boxes) = with_boxes(scan, boxes)?;
            let ranges = ranges.trimmed(self.config.carmen.map_range_m)?;
            for index in on_boxes {
                if let Beam::Hit(range) = ranges.beam(index) {
                    let (sin, cos) = ranges.angle_rad(index).sin_cos();
                    let [x, y] = pose.place([range * cos, range * sin]);
                    hits.extend(self.spec.cell_at([x, y, 0.0]));
                }
            }
            mapper.add(&pose, &ranges)?;
        }
        let map = mapper.to_map();
        let patch = patch_of(&map);
        let mut boxes: Vec<usize> = hits.into_iter().map(|cell| self.spec.index(cell)).collect();
        boxes.sort_unstable();
        boxes.dedup();
        boxes.retain(|&index| patch.states()[index] == CellState::Occupied);
        Ok(Patrol {
            time: Self::time(number),
            patch,
            map,
            boxes,
        })
    }

    fn random(&self, what: u64) -> Random {
        Random::stream(self.config.seed, &[0x424f_5853, what])
    }

    /// One judged patrol of five has boxes that no other has.
    fn sudden(
        &self,
        num_boxes: usize,
        pictures: &mut Vec<(String, Vec<u8>)>,
    ) -> Result<(Sudden, Vec<Seen>)> {
        let mut watch = Watch::new(self);
        let mut random = self.random(num_boxes as u64);
        let mut found = Sudden {
            num_boxes,
            ..Sudden::default()
        };
        let (nothing, mut seen) = (Scene::default(), Vec::new());
        for number in 0..self.config.num_patrols {
            let is_judged = number >= self.config.guard.num_trusted;
            let is_changed = is_judged && number % SUDDEN_EVERY == 0;
            let patrol = if is_changed {
                self.patrol(number, &self.boxes(num_boxes, &mut random))?
            } else {
                self.patrol(number, &nothing)?
            };
            let judged = watch.take_in(&patrol)?;
            seen.push((judged.disagreement, judged.limit, is_changed));
            let is_held = usize::from(judged.is_held);
            if is_changed {
                found.num_changed += 1;
                found.num_changed_held += is_held;
            } else if is_judged {
                found.num_unchanged += 1;
                found.num_unchanged_held += is_held;
            }
        }
        if self.config.draws
            && let Some(held) = watch.guard.quarantined().last()
        {
            let [appeared, vanished] = &held.contradictions;
            pictures.push((
                format!(
                    "quarantined with {num_boxes} boxes: {:.2} % contradict, {:.2} % are usual",
                    100.0 * held.judgement.disagreement,
                    100.0 * held.judgement.limit
                ),
                contradictions_png(&held.map, appeared, vanished)?,
            ));
        }
        Ok((found, seen))
    }

    /// Boxes that come after two thirds of the patrols and stay.
    fn moved(&self, num_boxes: usize) -> Result<Moved> {
        let boxes = self.boxes(num_boxes, &mut self.random(1_000));
        let from = 2 * self.config.num_patrols / 3;
        let (mut watch, nothing) = (Watch::new(self), Scene::default());
        let mut found = Moved {
            num_boxes,
            num_held: 0,
            believed_after: 0,
            is_adopted: false,
            num_there: 0,
            num_there_foreseen: 0,
        };
        for number in 0..self.config.num_patrols {
            let there = if number < from { &nothing } else { &boxes };
            let patrol = self.patrol(number, there)?;
            if number >= from + 5 {
                for &index in &patrol.boxes {
                    found.num_there += 1;
                    found.num_there_foreseen += u64::from(watch.foresees(index, patrol.time)?);
                }
            }
            let judged = watch.take_in(&patrol)?;
            if number >= from {
                found.is_adopted |= judged.is_adopted;
                if judged.is_held {
                    found.num_held += 1;
                    found.believed_after = number + 1 - from;
                }
            }
        }
        Ok(found)
    }

    /// Boxes of every day, from the first patrol on; the last two days are foreseen.
    fn daily(&self) -> Result<(Daily, Pictures)> {
        let boxes = self.boxes(self.config.num_daily, &mut self.random(2_000));
        let (mut watch, nothing) = (Watch::new(self), Scene::default());
        let mut surfaces = std::collections::BTreeSet::new();
        let mut found = Daily::default();
        let judged_from = self
            .config
            .num_patrols
            .saturating_sub((48.0 / EVERY_H) as usize);
        for number in 0..self.config.num_patrols {
            let hour = (1.0 + EVERY_H * number as f64).rem_euclid(24.0);
            let is_there = (THERE_H[0]..THERE_H[1]).contains(&hour);
            let patrol = self.patrol(number, if is_there { &boxes } else { &nothing })?;
            if number >= judged_from {
                let predicted = predicted_by_all(&mut watch.grid, patrol.time)?;
                for &index in &surfaces {
                    let is_box = patrol.boxes.binary_search(&index).is_ok();
                    let (all, right) = match patrol.patch.states()[index] {
                        CellState::Occupied if is_box => {
                            (&mut found.num_there, &mut found.num_there_foreseen)
                        }
                        CellState::Free => (&mut found.num_gone, &mut found.num_gone_foreseen),
                        _ => continue,
                    };
                    *all += 1;
                    for (right, map) in right.iter_mut().zip(&predicted) {
                        let expected = map.state(index, Thresholds::default());
                        *right += u64::from(expected == patrol.patch.states()[index]);
                    }
                }
            } else {
                surfaces.extend(patrol.boxes.iter().copied());
            }
            let judged = watch.take_in(&patrol)?;
            if number >= self.config.guard.num_trusted {
                found.num_judged += 1;
                found.num_held += usize::from(judged.is_held);
            }
        }
        let fitted = watch.grid.fitted();
        for &index in &surfaces {
            // Seen once it says nothing of any rhythm.
            if let Some((period_s, _)) = fitted.strongest_rhythm(self.spec.cell(index)) {
                found.num_cells += 1;
                found.num_of_a_day += u64::from(period_s == Period::DAY.as_us() as f64 / 1e6);
            }
        }
        let mut pictures = Vec::new();
        if self.config.draws {
            let day = self.config.num_patrols as i64 / 8 + 1;
            let mut map = OccupancyMap::new_unknown(self.spec);
            for hour in DRAWN_H {
                fitted.predict_into(moment(day, hour), &mut map)?;
                let clock = format!("{:02}:{:02}", hour as u32, (60.0 * hour.fract()) as u32);
                pictures.push((format!("{clock}, predicted"), occupancy_png(&map)?));
            }
            pictures.push((
                "strongest rhythm of each cell".into(),
                rhythms_png(&fitted, &self.spec, moment(day, 13.0))?,
            ));
        }
        Ok((found, pictures))
    }
}

/// The maps that are predicted by each of [`DAILY_BY`]; the grid stays what it is.
fn predicted_by_all(grid: &mut TemporalGrid, time: Time) -> Result<[OccupancyMap; DAILY_BY.len()]> {
    let usual = grid.config().clone();
    let folded = CellModel::Folded {
        candidates: CandidatePeriods::harmonic(Period::DAY, 24)?,
        num_bins: 24,
    };
    let configs = [
        usual.clone(),
        usual.clone().with_persistence_of(Persistence::Surprise),
        usual.clone().with_persistence(false),
        GridConfig::new(folded)?.with_persistence(false),
        GridConfig::new(CellModel::LastObservation)?,
    ];
    let mut maps = std::array::from_fn(|_| OccupancyMap::new_unknown(*grid.spec()));
    for (config, map) in configs.into_iter().zip(&mut maps) {
        grid.set_config(config);
        grid.predict_into(time, map)?;
    }
    grid.set_config(usual);
    Ok(maps)
}

/// A guarded grid.
struct Watch {
    grid: TemporalGrid,
    guard: Guard,
    predicted: OccupancyMap,
    /// Of which time the prediction is.
    is_of: Option<Time>,
}

/// What became of a map.
struct Judged {
    disagreement: f64,
    limit: f64,
    is_held: bool,
    is_adopted: bool,
}

impl Watch {
    fn new(site: &Site<'_>) -> Self {
        Self {
            grid: TemporalGrid::new(site.spec, GridConfig::default()),
            guard: Guard::new(site.config.guard),
            predicted: OccupancyMap::new_unknown(site.spec),
            is_of: None,
        }
    }

    fn predict(&mut self, time: Time) -> Result<()> {
        if self.is_of != Some(time) {
            self.grid.predict_into(time, &mut self.predicted)?;
            self.is_of = Some(time);
        }
        Ok(())
    }

    /// Whether a cell is expected to be occupied.
    fn foresees(&mut self, index: usize, time: Time) -> Result<bool> {
        self.predict(time)?;
        Ok(self.predicted.state(index, Thresholds::default()) == CellState::Occupied)
    }

    fn take_in(&mut self, patrol: &Patrol) -> Result<Judged> {
        self.predict(patrol.time)?;
        let decision = self
            .guard
            .judge("", &self.predicted, &patrol.map, patrol.time)?;
        let judgement = *decision.judgement();
        let mut judged = Judged {
            disagreement: judgement.disagreement,
            limit: judgement.limit,
            is_held: false,
            is_adopted: false,
        };
        match decision {
            Decision::Integrate(map, _) => {
                self.grid.observe(&patch_of(&map), patrol.time)?;
            }
            Decision::Quarantine(_) => judged.is_held = true,
            Decision::Adopt(held, _) => {
                judged.is_adopted = true;
                for it in held {
                    self.grid.observe(&patch_of(&it.map), it.judgement.time)?;
                }
            }
        }
        self.is_of = None;
        Ok(judged)
    }
}

/// The scan as it would have been with boxes there, and which of its beams end on them.
fn with_boxes(scan: &CarmenScan, boxes: &Scene) -> Result<(LaserScan, Vec<usize>)> {
    let it = &scan.scan;
    let mut ranges = it.ranges_m().to_vec();
    let mut on_boxes = Vec::new();
    for (index, range) in ranges.iter_mut().enumerate() {
        let reach = match it.beam(index) {
            Beam::Hit(reach) | Beam::Free(reach) => reach,
            Beam::Invalid => continue,
        };
        let (sin, cos) = (scan.pose.heading_rad + it.angle_rad(index)).sin_cos();
        if let Some(nearer) = boxes.cast([scan.pose.x_m, scan.pose.y_m], [cos, sin], reach) {
            *range = nearer as f32;
            on_boxes.push(index);
        }
    }
    let step_rad = it.angle_rad(1) - it.angle_rad(0);
    let scan = LaserScan::new(it.angle_rad(0), step_rad, it.max_range_m(), ranges)?;
    Ok((scan, on_boxes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_ends_the_beams_that_meet_it_and_no_others() -> Result<()> {
        let scan = CarmenScan {
            time: Time::from_s(0),
            pose: Pose2::new(1.0, 1.0, 0.0),
            odometry: Pose2::default(),
            scan: LaserScan::new(-0.5, 0.5, 10.0, vec![5.0, f32::INFINITY, 2.0])?,
        };
        let mut boxes = Scene::default();
        boxes.add_box([4.0, 0.5], [5.0, 1.5]);
        let (changed, on_boxes) = with_boxes(&scan, &boxes)?;
        assert_eq!(on_boxes, [1]);
        assert_eq!(changed.beam(1), Beam::Hit(3.0));
        for other in [0, 2] {
            assert_eq!(changed.beam(other), scan.scan.beam(other));
        }
        assert_eq!(
            with_boxes(&scan, &Scene::default())?.0.ranges_m(),
            scan.scan.ranges_m()
        );
        Ok(())
    }
}

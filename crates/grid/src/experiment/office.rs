//! How fast, how small and how right is the grid of an office that is watched for weeks? (T-RO 2017,
//! section VI)

use fremen::{CandidatePeriods, Period, Result};

use crate::cells::OccupancyMap;
use crate::compress::{LossyGrid, pack, unpack, varint_bytes};
use crate::history::Memory;
use crate::model::{CellModel, Errors, GridConfig};
use crate::picture::{occupancy_png, rhythms_png};
use crate::simulation::Office3d;
use crate::temporal::TemporalGrid;

/// What is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OfficeConfig {
    /// Of the office.
    pub seed: u64,
    /// Days of frames, one every five seconds.
    pub num_days: u32,
    /// Every so many frames one is compared: 301 is 57 a day, at other times each day.
    pub stride: usize,
    /// Whether pictures are drawn.
    pub draws: bool,
}

impl Default for OfficeConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            num_days: 112,
            stride: 301,
            draws: true,
        }
    }
}

/// How one model did.
#[derive(Clone, Debug, PartialEq)]
pub struct OfficeModel {
    /// Its name.
    pub name: String,
    /// Whether it is the mean alone: a static map.
    pub is_static: bool,
    /// Seconds to learn it.
    pub learn_s: f64,
    /// Share of wrong cells among those that ever changed.
    pub error: f64,
    /// The same of the static map.
    pub static_error: f64,
    /// Bytes of its rhythms alone and the share of wrong cells when no more is kept; none where it
    /// has none.
    pub lossy: Option<(usize, f64)>,
    /// Share of wrong cells in each day.
    pub by_day: Vec<f64>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct OfficeReport {
    /// Voxels.
    pub num_cells: usize,
    /// Frames.
    pub num_frames: usize,
    /// Changes of voxels.
    pub num_changes: usize,
    /// Seconds to observe all frames, without those of the simulation.
    pub observe_s: f64,
    /// What the history takes.
    pub memory: Memory,
    /// Bytes of the history packed without loss, and in runs of variable-length numbers.
    pub packed_bytes: usize,
    /// See [`packed_bytes`](Self::packed_bytes).
    pub varint_bytes: usize,
    /// Whether it came back bit for bit.
    pub is_lossless: bool,
    /// Seconds to pack and to unpack.
    pub pack_s: [f64; 2],
    /// Every model.
    pub models: Vec<OfficeModel>,
    /// Pictures with their titles: four hours of the day after, then the rhythms; none where they
    /// are not wanted.
    pub pictures: Vec<(String, Vec<u8>)>,
}

impl OfficeReport {
    /// Bytes of all frames with one bit for each voxel.
    pub fn raw_bytes(&self) -> f64 {
        self.num_frames as f64 * self.num_cells as f64 / 8.0
    }
}

/// Watches an office; `clock_s` says how many seconds have passed since whenever.
///
/// # Errors
/// As the simulation and the grid.
pub fn office(config: &OfficeConfig, clock_s: &dyn Fn() -> f64) -> Result<OfficeReport> {
    let office = Office3d::new(config.seed, config.num_days)?;
    let mut grid = TemporalGrid::new(*office.spec(), GridConfig::default());
    // How long it takes to make the frames themselves.
    let start_s = clock_s();
    let (mut frames, mut num_changes) = (office.frames(), 0);
    while let Some((_, changes)) = frames.advance() {
        num_changes += changes.len();
    }
    let simulated_s = clock_s() - start_s;
    let start_s = clock_s();
    let (_, mut stream) = grid.frames("camera", office.first(), office.time(0))?;
    let mut frames = office.frames();
    while let Some((time, changes)) = frames.advance() {
        stream.push(time, changes)?;
    }
    drop(stream);
    let observe_s = clock_s() - start_s - simulated_s;
    let start_s = clock_s();
    let packed = pack(grid.history())?;
    let packed_s = clock_s();
    let is_lossless = unpack(&packed)? == *grid.history();
    Ok(OfficeReport {
        num_cells: office.spec().num_cells(),
        num_frames: office.num_frames(),
        num_changes,
        observe_s,
        memory: grid.memory(),
        packed_bytes: packed.len(),
        varint_bytes: varint_bytes(grid.history()),
        is_lossless,
        pack_s: [packed_s - start_s, clock_s() - packed_s],
        models: learn(&mut grid, config, clock_s)?,
        pictures: if config.draws {
            draw(&mut grid, &office)?
        } else {
            Vec::new()
        },
    })
}

/// The hours that are drawn.
const HOURS: [u8; 4] = [3, 10, 13, 19];

/// The day after the last one, by the rhythms of a week.
fn draw(grid: &mut TemporalGrid, office: &Office3d) -> Result<Vec<(String, Vec<u8>)>> {
    let candidates = CandidatePeriods::harmonic(Period::WEEK, 168)?;
    grid.set_config(GridConfig::fremen(candidates, 5)?.with_persistence(false));
    let fitted = grid.fitted();
    let mut map = OccupancyMap::new_unknown(*office.spec());
    let day = office.time(office.num_frames());
    let mut pictures = Vec::new();
    for hour in HOURS {
        fitted.predict_into(day.plus_us(i64::from(hour) * 3_600_000_000), &mut map)?;
        pictures.push((format!("{hour:02}:00, predicted"), occupancy_png(&map)?));
    }
    let rhythms = rhythms_png(&fitted, office.spec(), day.plus_us(13 * 3_600_000_000))?;
    pictures.push(("strongest rhythm of each column of voxels".into(), rhythms));
    Ok(pictures)
}

/// FreMEn with the periods of a day and of a week, and the histograms of their hours.
fn learn(
    grid: &mut TemporalGrid,
    config: &OfficeConfig,
    clock_s: &dyn Fn() -> f64,
) -> Result<Vec<OfficeModel>> {
    let mut results = Vec::new();
    for (name, base, count) in [("day", Period::DAY, 24), ("week", Period::WEEK, 168)] {
        let candidates = CandidatePeriods::harmonic(base, count)?;
        let mut models = Vec::new();
        for order in 0..=5 {
            // The mean is the same whatever it is the mean of.
            if order > 0 || results.is_empty() {
                let model = CellModel::Fremen {
                    candidates: candidates.clone(),
                    order,
                };
                let name = match order {
                    0 => "static (mean)".to_owned(),
                    _ => format!("FreMEn {name}/1..{count}, order {order}"),
                };
                models.push((name, Some(order), model));
            }
        }
        let histogram = CellModel::Histogram {
            period: base,
            num_bins: count,
        };
        models.push((format!("histogram, hours of a {name}"), None, histogram));
        for (name, order, model) in models {
            grid.set_config(GridConfig::new(model)?.with_persistence(false));
            let start_s = clock_s();
            let fitted = grid.fitted();
            let learn_s = clock_s() - start_s;
            let errors = fitted.errors(config.stride);
            let by_day = fitted.errors_by_day(config.stride);
            let lossy = match order {
                Some(order) if order > 0 => {
                    let lossy = LossyGrid::new(&fitted, base, count, order)?;
                    let error = lossy.errors(&fitted, config.stride)?.rate();
                    Some((lossy.to_bytes().len(), error))
                }
                _ => None,
            };
            results.push(OfficeModel {
                name,
                is_static: order == Some(0),
                learn_s,
                error: errors.rate(),
                static_error: errors.static_rate(),
                lossy,
                by_day: by_day.iter().map(Errors::rate).collect(),
            });
        }
    }
    Ok(results)
}

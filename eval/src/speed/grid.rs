//! How fast is a grid that works on changes, next to a dense array that works on every cell?
//!
//! The dense array keeps the sums of 24 rhythms of a day for each cell (192 bytes), as the published
//! code does, or the counts of free and occupied alone; both give what they have counted, which must
//! be what the grid's history says. One thread.

use std::hint::black_box;

use anyhow::{Context, Result, ensure};
use chronotope::Time;
use fremen_grid::random::Random;
use fremen_grid::{CellState, GridConfig, GridSpec, OccupancyMap, Patch, TemporalGrid};

use super::measurement::{Measurement, time};

pub(super) const SECTION: &str = "Grids, one thread";

/// An office of 213,000 voxels, and of how many a frame changes: 0.1 %.
const DIMS: [u32; 3] = [71, 60, 50];
const NUM_CHANGES: usize = 213;
const NUM_FRAMES: usize = 200;
/// Rhythms that the dense array sums.
const NUM_RHYTHMS: usize = 24;
/// Side of the patrol's map and of the map that is predicted, in cells.
const PATROL: u32 = 1_000;
const PREDICTED: u32 = 2_000;
/// Patrols before the map is predicted.
const NUM_PATROLS: i64 = 48;
/// One cell of so many changes by day.
const EVERY: usize = 20;
const NUM_REPEATS: usize = 3;

/// Frames, a patrol's map, a predicted map.
pub(super) fn measure() -> Result<Vec<Measurement>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        let mut rows = frames()?;
        rows.extend(patrol()?);
        rows.extend(predicted()?);
        Ok(rows)
    })
}

/// What changes from frame to frame: the cells and their states, the same for both.
fn changes() -> Vec<Vec<(u32, CellState)>> {
    let num_cells = DIMS.iter().product::<u32>() as usize;
    let mut random = Random::stream(7, &[0x5350_4545]);
    let mut occupied = vec![false; num_cells];
    (0..NUM_FRAMES)
        .map(|_| {
            let mut cells: Vec<usize> = (0..NUM_CHANGES).map(|_| random.below(num_cells)).collect();
            cells.sort_unstable();
            cells.dedup();
            let change = |cell: usize| {
                occupied[cell] = !occupied[cell];
                let state = if occupied[cell] {
                    CellState::Occupied
                } else {
                    CellState::Free
                };
                (cell as u32, state)
            };
            cells.into_iter().map(change).collect()
        })
        .collect()
}

fn frames() -> Result<Vec<Measurement>> {
    let spec = GridSpec::new_3d([0.0; 3], 0.1, DIMS)?;
    let frames = changes();
    let first = Patch::new([0; 3], DIMS, vec![CellState::Free; spec.num_cells()])?;
    let mut grid = TemporalGrid::new(spec, GridConfig::default());
    let mut failed = None;
    let ours_ms = time(NUM_REPEATS, || {
        grid = TemporalGrid::new(spec, GridConfig::default());
        if let Err(error) = watch(&mut grid, &first, &frames) {
            failed = Some(error);
        }
    });
    if let Some(error) = failed {
        return Err(error);
    }
    let mut counts = vec![0_u32; spec.num_cells()];
    let counts_ms = time(NUM_REPEATS, || {
        let mut state = vec![0_u32; spec.num_cells()];
        counts = vec![0; spec.num_cells()];
        for changes in &frames {
            apply(changes, &mut state);
            for (count, state) in counts.iter_mut().zip(&state) {
                *count += state;
            }
        }
    });
    // As many cells as take a second; all of them would only take longer.
    for index in (0..spec.num_cells()).step_by(97) {
        let runs = grid.history().runs(spec.cell(index));
        let occupied = runs.iter().filter(|it| it.2 == CellState::Occupied);
        let seen: u32 = occupied.map(|it| it.1).sum();
        ensure!(
            seen == counts[index],
            "cell {index}: {seen} and {}",
            counts[index]
        );
    }
    let case = format!("{NUM_FRAMES} frames of {} cells", spec.num_cells());
    let observed = (NUM_FRAMES * spec.num_cells()) as f64;
    let row = |subject: &str, ms: &[f64]| {
        let fastest = ms.iter().copied().fold(f64::INFINITY, f64::min);
        Measurement::new(SECTION, &case, subject, ms).note(format!(
            "{:.1e} cell observations/s",
            observed / fastest * 1e3
        ))
    };
    Ok(vec![
        row("dense array of counts", &counts_ms).reference(),
        row(
            "dense array, 24 rhythms",
            &rhythms(&frames, spec.num_cells()),
        ),
        row("ours", &ours_ms),
    ])
}

fn watch(grid: &mut TemporalGrid, first: &Patch, frames: &[Vec<(u32, CellState)>]) -> Result<()> {
    let (_, mut stream) = grid.frames("camera", first, Time::from_s(0))?;
    for (number, changes) in (1..).zip(frames) {
        stream.push(Time::from_s(5 * number), changes)?;
    }
    Ok(())
}

fn apply(changes: &[(u32, CellState)], state: &mut [u32]) {
    for &(cell, to) in changes {
        state[cell as usize] = u32::from(to == CellState::Occupied);
    }
}

/// The published form: every frame adds a phasor of every rhythm to every occupied cell. A twentieth
/// of the frames, times twenty.
fn rhythms(frames: &[Vec<(u32, CellState)>], num_cells: usize) -> Vec<f64> {
    const PART: usize = 20;
    let ms = time(NUM_REPEATS, || {
        let mut state = vec![0_u32; num_cells];
        let mut sums = vec![[0.0_f32; 2 * NUM_RHYTHMS]; num_cells];
        for (number, changes) in frames.iter().enumerate().take(frames.len() / PART) {
            apply(changes, &mut state);
            let phasors: [f32; 2 * NUM_RHYTHMS] = std::array::from_fn(|column| {
                let turns = 5.0 * number as f32 * (column / 2 + 1) as f32 / 86_400.0;
                let (sin, cos) = (std::f32::consts::TAU * turns).sin_cos();
                if column % 2 == 0 { cos } else { sin }
            });
            for (sums, &state) in sums.iter_mut().zip(&state) {
                let state = state as f32;
                for (sum, phasor) in sums.iter_mut().zip(&phasors) {
                    *sum += state * phasor;
                }
            }
        }
        black_box(&sums);
    });
    ms.into_iter().map(|it| it * PART as f64).collect()
}

/// A map of a patrol, in which one cell of twenty is occupied by day and free at night.
fn map(side: u32, hour: i64) -> Result<Patch> {
    let is_day = (8..18).contains(&hour.rem_euclid(24));
    let states = (0..(side * side) as usize).map(|index| {
        let is_wall = index % (7 * EVERY) == 0;
        let changes = index % EVERY == 1;
        if is_wall || changes && is_day {
            CellState::Occupied
        } else {
            CellState::Free
        }
    });
    Ok(Patch::new([0; 3], [side, side, 1], states.collect())?)
}

fn patrol() -> Result<Vec<Measurement>> {
    let spec = GridSpec::new_2d([0.0; 2], 0.05, [PATROL, PATROL])?;
    let maps = [map(PATROL, 2)?, map(PATROL, 12)?];
    let mut grid = TemporalGrid::new(spec, GridConfig::default());
    let (mut hour, mut failed) = (0, None);
    let ours_ms = time(NUM_REPEATS, || {
        hour += 12;
        let observed = grid.observe(&maps[hour as usize / 12 % 2], Time::from_s(3_600 * hour));
        failed = failed.take().or(observed.err());
    });
    if let Some(error) = failed {
        return Err(error).context("a patrol's map");
    }
    let mut sums = vec![[0.0_f32; 2 * NUM_RHYTHMS]; spec.num_cells()];
    let phasors = [0.5_f32; 2 * NUM_RHYTHMS];
    let dense_ms = time(NUM_REPEATS, || {
        for (sums, state) in sums.iter_mut().zip(maps[1].states()) {
            let state = f32::from(u8::from(*state == CellState::Occupied));
            for (sum, phasor) in sums.iter_mut().zip(&phasors) {
                *sum += state * phasor;
            }
        }
        black_box(&sums);
    });
    let case = format!("a map of {PATROL} x {PATROL} integrated");
    let row = |subject, ms: &[f64]| Measurement::new(SECTION, &case, subject, ms);
    Ok(vec![
        row("dense array, 24 rhythms", &dense_ms).reference(),
        row("ours", &ours_ms).note("5 % of the cells change each time"),
    ])
}

fn predicted() -> Result<Vec<Measurement>> {
    let spec = GridSpec::new_2d([0.0; 2], 0.05, [PREDICTED, PREDICTED])?;
    let mut grid = TemporalGrid::new(spec, GridConfig::default());
    for number in 0..NUM_PATROLS {
        let hour = 3 * number;
        grid.observe(&map(PREDICTED, hour)?, Time::from_s(3_600 * hour))?;
    }
    let start = std::time::Instant::now();
    let fitted = grid.fitted();
    let fit_ms = 1e3 * start.elapsed().as_secs_f64();
    let mut predicted = OccupancyMap::new_unknown(spec);
    let noon = Time::from_s(3_600 * (3 * NUM_PATROLS + 12));
    let mut failed = None;
    let ours_ms = time(NUM_REPEATS, || {
        failed = failed
            .take()
            .or(fitted.predict_into(noon, &mut predicted).err());
    });
    if let Some(error) = failed {
        return Err(error).context("a predicted map");
    }
    // It must be right: by day, on a day that nobody has seen.
    let truth = map(PREDICTED, 12)?;
    let wrong = (truth.states().iter().zip(predicted.probabilities()))
        .filter(|(state, p)| (**state == CellState::Occupied) != (**p > 0.5))
        .count();
    ensure!(wrong == 0, "{wrong} cells of the predicted map are wrong");
    // A mean and two rhythms for each cell, whatever it does.
    let records = vec![[0.3_f32, 0.1, 0.05, 0.02, 0.01]; spec.num_cells()];
    let mut dense = vec![0.0_f32; spec.num_cells()];
    let dense_ms = time(NUM_REPEATS, || {
        let [a, b, c, d] = black_box([0.5_f32, 0.8, 0.1, 0.9]);
        for (p, [mean, e, f, g, h]) in dense.iter_mut().zip(&records) {
            *p = (mean + a * e + b * f + c * g + d * h).clamp(0.0, 1.0);
        }
        black_box(&dense);
    });
    let case = format!("a map of {PREDICTED} x {PREDICTED} predicted");
    let row = |subject, ms: &[f64]| Measurement::new(SECTION, &case, subject, ms);
    Ok(vec![
        row("dense array, 2 rhythms", &dense_ms).reference(),
        row("ours", &ours_ms).note(format!(
            "5 % of the cells change; fitted once in {fit_ms:.0} ms"
        )),
    ])
}

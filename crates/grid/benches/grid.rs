//! How long do observing, learning and predicting take?
//!
//! `cargo bench -p fremen-grid`; `RAYON_NUM_THREADS=1` for one thread.
#![allow(
    clippy::unwrap_used,
    missing_docs,
    reason = "a benchmark that cannot prepare itself has failed; criterion's macros document nothing"
)]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use fremen_grid::{CellState, GridConfig, GridSpec, OccupancyMap, Patch, TemporalGrid, Time};

/// A floor of free cells in walls, of which one cell in `one_in` follows the hours of the day.
fn patrols(side: u32, one_in: u32, num_patrols: i64) -> (TemporalGrid, Patch) {
    let spec = GridSpec::new_2d([0.0; 2], 0.05, [side, side]).unwrap();
    let mut grid = TemporalGrid::new(spec, GridConfig::default());
    let mut patch = Patch::new_whole(&spec);
    for patrol in 0..num_patrols {
        let hour = patrol * 5 % 24;
        for y in 0..side {
            for x in 0..side {
                let is_wall = x % 200 == 0 || y % 200 == 0;
                let varies = (x * 7 + y * 13) % one_in == 0;
                let opens = i64::from((x + y) % 12);
                let is_open = (opens..opens + 9).contains(&hour);
                let state = if is_wall || (varies && is_open) {
                    CellState::Occupied
                } else {
                    CellState::Free
                };
                patch.set([x, y, 0], state);
            }
        }
        let time = Time::from_s(patrol * 5 * 3600);
        grid.observe(&patch, time).unwrap();
    }
    (grid, patch)
}

fn observe(c: &mut Criterion) {
    let (grid, patch) = patrols(1_000, 20, 30);
    let last = Time::from_s(30 * 5 * 3600);
    c.bench_function("observe 1000x1000", |b| {
        b.iter_batched_ref(
            || grid.clone(),
            |grid| grid.observe(&patch, last).unwrap().num_changed,
            BatchSize::LargeInput,
        );
    });
    c.bench_function("learn 1000x1000, 1 in 20 cells varies, 30 patrols", |b| {
        b.iter_batched_ref(
            || TemporalGrid::from_history(grid.history().clone(), GridConfig::default()),
            |grid| grid.fitted().num_varying(),
            BatchSize::LargeInput,
        );
    });
}

fn predict(c: &mut Criterion) {
    for one_in in [20, 1] {
        let (mut grid, _) = patrols(2_000, one_in, 12);
        let mut map = OccupancyMap::new_unknown(*grid.spec());
        let fitted = grid.fitted();
        let name = format!("predict 2000x2000, 1 in {one_in} cells varies");
        c.bench_function(&name, |b| {
            b.iter(|| {
                fitted
                    .predict_into(black_box(Time::from_s(10_000_000)), &mut map)
                    .unwrap();
            });
        });
    }
}

fn frames(c: &mut Criterion) {
    const NUM_FRAMES: i64 = 2_000;
    let spec = GridSpec::new_3d([0.0; 3], 0.05, [71, 60, 50]).unwrap();
    let view = Patch::new([0; 3], spec.dims(), vec![CellState::Free; spec.num_cells()]).unwrap();
    // 213 of 213,000 cells change in each frame.
    let mut states = vec![CellState::Free; spec.num_cells()];
    let mut random = 1_u64;
    let frames: Vec<Vec<(u32, CellState)>> = (0..NUM_FRAMES)
        .map(|_| {
            let change = |_| {
                random = random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let index = (random >> 33) as usize % states.len() / 8;
                let is_free = states[index] == CellState::Free;
                states[index] = if is_free {
                    CellState::Occupied
                } else {
                    CellState::Free
                };
                (index as u32, states[index])
            };
            (0..213).map(change).collect()
        })
        .collect();
    c.bench_function("2000 frames of 213000 cells, 0.1 % change", |b| {
        b.iter(|| {
            let mut grid = TemporalGrid::new(spec, GridConfig::default());
            let (_, mut stream) = grid.frames("camera", &view, Time::from_s(0)).unwrap();
            for (i, frame) in (1..).zip(&frames) {
                stream.push(Time::from_s(5 * i), frame).unwrap();
            }
            stream.num_frames()
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = observe, predict, frames
}
criterion_main!(benches);

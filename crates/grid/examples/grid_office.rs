//! How fast, how small and how right is the grid of an office that is watched for sixteen weeks?
//!
//! `cargo run --release -p fremen-grid --example grid_office -- [DAYS [SEED]]`; set
//! `RAYON_NUM_THREADS=1` for the figures of one thread. The experiment is that of T-RO 2017,
//! section VI, in a simulated office.

use std::time::Instant;

use fremen::{CandidatePeriods, Period};
use fremen_grid::compress::{LossyGrid, pack, unpack, varint_bytes};
use fremen_grid::simulation::Office3d;
use fremen_grid::{CellModel, GridConfig, Result, TemporalGrid};

/// Every 301st frame is compared: 57 a day, at other times each day.
const STRIDE: usize = 301;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u32| {
        arguments
            .next()
            .and_then(|it| it.parse().ok())
            .unwrap_or(default)
    };
    let (num_days, seed) = (number(112), number(1));
    let mut say = Printer::new();
    say.line(&format!("seed {seed}"));
    let office = Office3d::new(seed.into(), num_days)?;
    let mut grid = observe(&office, &mut say)?;
    let raw_bytes = (office.num_frames() * office.spec().num_cells()) as f64 / 8.0;
    compress(&grid, raw_bytes, &mut say)?;
    learn(&mut grid, raw_bytes, &mut say)?;
    say.line(&format!("peak memory {}", peak_memory()));
    Ok(())
}

/// A grid that has seen all frames.
fn observe(office: &Office3d, say: &mut Printer) -> Result<TemporalGrid> {
    let mut grid = TemporalGrid::new(*office.spec(), GridConfig::default());
    let num_cells = office.spec().num_cells();
    // How long it takes to make the frames themselves.
    let start = Clock::start();
    let (mut frames, mut num_changes) = (office.frames(), 0);
    while let Some((_, changes)) = frames.advance() {
        num_changes += changes.len();
    }
    let simulation = start.elapsed();
    let start = Clock::start();
    let (_, mut stream) = grid.frames("camera", office.first(), office.time(0))?;
    let mut frames = office.frames();
    while let Some((time, changes)) = frames.advance() {
        stream.push(time, changes)?;
    }
    drop(stream);
    let all = start.elapsed();
    let cpu_s = all.cpu_s - simulation.cpu_s;
    let num_observed = office.num_frames() as f64 * num_cells as f64;
    say.line(&format!(
        "{num_cells} cells x {} frames, {num_changes} changes ({:.4} % a frame)",
        office.num_frames(),
        100.0 * num_changes as f64 / num_observed
    ));
    say.line(&format!(
        "simulated in {simulation}; simulated and observed in {all}: {cpu_s:.2} s CPU to observe, \
         {:.1e} cell observations/s",
        num_observed / cpu_s
    ));
    let memory = grid.memory();
    say.line(&format!(
        "memory: {:.1} MB of tiles, {:.1} MB of logs of {} changing cells, {:.1} MB of times",
        memory.tile_bytes as f64 / 1e6,
        memory.log_bytes as f64 / 1e6,
        memory.num_changing_cells,
        memory.observation_bytes as f64 / 1e6
    ));
    Ok(grid)
}

/// What all observations take, and whether they come back.
fn compress(grid: &TemporalGrid, raw_bytes: f64, say: &mut Printer) -> Result<()> {
    let start = Clock::start();
    let packed = pack(grid.history())?;
    let took = start.elapsed();
    let varint = varint_bytes(grid.history());
    say.line(&format!(
        "lossless {:.2} MB, 1:{:.0}, {:.2} x smaller than varint runs ({:.2} MB), packed in {took}",
        packed.len() as f64 / 1e6,
        raw_bytes / packed.len() as f64,
        varint as f64 / packed.len() as f64,
        varint as f64 / 1e6
    ));
    let start = Clock::start();
    let is_same = unpack(&packed)? == *grid.history();
    let verdict = if is_same { "the same" } else { "NOT THE SAME" };
    say.line(&format!("unpacked in {}: {verdict}", start.elapsed()));
    Ok(())
}

/// Every model: how long it takes, what it gets wrong, and in how few bytes it is kept.
fn learn(grid: &mut TemporalGrid, raw_bytes: f64, say: &mut Printer) -> Result<()> {
    let mut models = Vec::new();
    for (name, base, count) in [
        ("day/1..24", Period::DAY, 24),
        ("week/1..168", Period::WEEK, 168),
    ] {
        let candidates = CandidatePeriods::harmonic(base, count)?;
        for order in 0..=5 {
            let model = CellModel::Fremen {
                candidates: candidates.clone(),
                order,
            };
            models.push((
                format!("order {order} of {name}"),
                Some((base, count)),
                model,
            ));
        }
    }
    for (name, period, num_bins) in [
        ("hours of a day", Period::DAY, 24),
        ("hours of a week", Period::WEEK, 168),
    ] {
        models.push((
            name.to_owned(),
            None,
            CellModel::Histogram { period, num_bins },
        ));
    }
    for (name, periods, model) in models {
        grid.set_config(GridConfig::new(model)?.with_persistence(false));
        let start = Clock::start();
        let fitted = grid.fitted();
        let learnt = start.elapsed();
        let errors = fitted.errors(STRIDE);
        say.line(&format!(
            "{name:24} learnt in {learnt}; wrong {:6.3} %, static {:6.3} %, ratio {:.3} ({} cells, \
             {} samples)",
            100.0 * errors.rate(),
            100.0 * errors.static_rate(),
            errors.rate() / errors.static_rate(),
            errors.num_cells,
            errors.num_compared,
        ));
        if let (Some((base, count)), CellModel::Fremen { order, .. }) =
            (periods, fitted.config().model())
        {
            let lossy = LossyGrid::new(&fitted, base, count, *order)?;
            let (bytes, errors) = (lossy.to_bytes(), lossy.errors(&fitted, STRIDE)?);
            say.line(&format!(
                "{:24} lossy {:.3} MB, 1:{:.0}; wrong {:6.3} %, ratio {:.3}",
                "",
                bytes.len() as f64 / 1e6,
                raw_bytes / bytes.len() as f64,
                100.0 * errors.rate(),
                errors.rate() / errors.static_rate()
            ));
        }
    }
    Ok(())
}

/// Wall and processor time.
struct Clock {
    start: Instant,
    cpu_s: f64,
}

struct Elapsed {
    wall_s: f64,
    cpu_s: f64,
}

impl std::fmt::Display for Elapsed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.2} s ({:.2} s CPU)", self.wall_s, self.cpu_s)
    }
}

impl Clock {
    fn start() -> Self {
        Self {
            start: Instant::now(),
            cpu_s: cpu_s(),
        }
    }

    fn elapsed(&self) -> Elapsed {
        Elapsed {
            wall_s: self.start.elapsed().as_secs_f64(),
            cpu_s: cpu_s() - self.cpu_s,
        }
    }
}

/// What Linux says of this process; 0 elsewhere.
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat
        .rsplit(')')
        .next()
        .unwrap_or("")
        .split_whitespace()
        .collect();
    let ticks = |at: usize| {
        fields
            .get(at)
            .and_then(|it| it.parse::<f64>().ok())
            .unwrap_or(0.0)
    };
    (ticks(11) + ticks(12)) / 100.0
}

fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.map_or("unknown".into(), |line| line[6..].trim().to_owned())
}

struct Printer(std::io::Stdout);

impl Printer {
    fn new() -> Self {
        Self(std::io::stdout())
    }

    fn line(&mut self, text: &str) {
        use std::io::Write;
        // Nobody may be reading any more.
        let _ = writeln!(self.0, "{text}");
        let _ = self.0.flush();
    }
}

//! How fast does one process learn what a fleet has observed, and is it what a cluster has learnt?
//!
//! `make` writes the observations of a made-up fleet, `learn` learns them and says in JSON how long it took,
//! `same` compares two tables of models bit for bit. `scripts/fleet.sh` runs all three.

use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use chronotope_fleet::table::{
    ModelWriter, ObservationWriter, ReadConfig, TableFolder, files_of, read_models,
    read_observations,
};
use chronotope_fleet::{FleetConfig, FleetLog, learn};
use fremen::Time;

const USAGE: &str = "\
usage: fleet make DIR PLACES FEATURES VISITS [skewed]
       fleet learn OUT THREADS INPUT...
       fleet same MODELS MODELS";

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match &words[..] {
        ["make", folder, places, features, visits, rest @ ..] => {
            let fleet = Fleet {
                num_places: places.parse()?,
                num_features: features.parse()?,
                num_visits: visits.parse()?,
                is_skewed: rest == ["skewed"],
            };
            fleet.write(folder)
        }
        ["learn", out, threads, inputs @ ..] => learn_all(out, threads.parse()?, inputs),
        ["same", a, b] => same(a, b),
        _ => bail!("{USAGE}"),
    }
}

/// A fleet whose features are seen by the hour, by the week, or at random.
struct Fleet {
    num_places: usize,
    num_features: u32,
    num_visits: usize,
    /// Half of all visits are of the first place.
    is_skewed: bool,
}

impl Fleet {
    /// As many files as there are robots: four.
    fn write(&self, folder: &str) -> Result<()> {
        const NUM_ROBOTS: usize = 4;
        let output = TableFolder::begin(folder)?;
        let num_all = self.num_places * self.num_visits;
        for robot in 0..NUM_ROBOTS {
            let path = output.file(&format!("robot-{robot}.parquet"));
            let mut table = ObservationWriter::begin(path)?;
            for place in 0..self.num_places {
                let num_visits = match (self.is_skewed, place) {
                    (false, _) => self.num_visits,
                    (true, 0) => num_all / 2,
                    (true, _) => num_all / 2 / (self.num_places - 1),
                };
                self.write_place(&mut table, place, (robot..num_visits).step_by(NUM_ROBOTS))?;
            }
            table.finish()?;
        }
        output.finish()?;
        Ok(())
    }

    fn write_place(
        &self,
        table: &mut ObservationWriter,
        place: usize,
        visits: impl Iterator<Item = usize>,
    ) -> Result<()> {
        let key = format!("place-{place:04}");
        let mut log = FleetLog::new();
        for visit in visits {
            // Every 20 minutes or so, from 2026 on.
            let time = 1_767_225_600 + 1_200 * visit as i64 + (noise(visit as u64) % 600) as i64;
            let id = u128::from(noise(place as u64)) << 64 | u128::from(noise(visit as u64));
            for feature in 0..self.num_features {
                let seed = (place as u64) << 40 | u64::from(feature);
                let p = chance(seed, time);
                let draw = noise(noise(seed) ^ visit as u64) % 1_000;
                log.add(&key, id, Time::from_s(time), feature, draw < p)
                    .map_err(fremen::Error::from)?;
            }
        }
        for known in log.places() {
            for visit in known.visits() {
                table.visit(&key, visit.id, visit.time, &visit.states)?;
            }
        }
        Ok(())
    }
}

/// In thousandths: by day, at the weekend, or always alike.
fn chance(seed: u64, time_s: i64) -> u64 {
    let (hour, day) = (time_s / 3_600 % 24, time_s / 86_400 % 7);
    match noise(seed) % 3 {
        0 if (7..19).contains(&hour) => 900,
        0 => 100,
        1 if day < 2 => 800,
        1 => 200,
        _ => 50 + noise(seed + 1) % 900,
    }
}

/// Numbers that look random and are the same in every run.
fn noise(seed: u64) -> u64 {
    let mut x = seed.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ x >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ x >> 31
}

fn learn_all(out: &str, num_threads: usize, inputs: &[&str]) -> Result<()> {
    let files = files_of(&inputs.iter().map(PathBuf::from).collect::<Vec<_>>())?;
    let begin = Instant::now();
    let cfg = ReadConfig::default().with_num_threads(num_threads);
    let (log, report) = read_observations(&files, &cfg)?;
    let (read_s, read_cpu_s) = (begin.elapsed().as_secs_f64(), cpu_s());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads);
    let models = pool
        .build()?
        .install(|| learn(&log, &FleetConfig::default()))?;
    let learn_s = begin.elapsed().as_secs_f64() - read_s;
    let output = TableFolder::begin(out)?;
    let mut table = ModelWriter::begin(output.file("part-00000.parquet"))?;
    table.write(&models)?;
    table.finish()?;
    output.finish()?;
    let total_s = begin.elapsed().as_secs_f64();
    writeln!(
        std::io::stdout(),
        "{{\"rows\": {}, \"duplicates\": {}, \"visits\": {}, \"models\": {}, \"threads\": {num_threads}, \
         \"read_s\": {read_s:.3}, \"read_cpu_s\": {read_cpu_s:.2}, \"learn_s\": {learn_s:.3}, \"total_s\": {total_s:.3}, \"cpu_s\": {:.2}, \
         \"peak_mb\": {}}}",
        report.num_rows,
        report.num_duplicates,
        log.num_visits(),
        models.len(),
        cpu_s(),
        peak_mb()
    )?;
    Ok(())
}

/// Processor time of this process so far; 0 where the system does not say.
fn cpu_s() -> f64 {
    let stat = fremen::file::read_text("/proc/self/stat", 1 << 16).unwrap_or_default();
    let after_name = stat.rsplit_once(") ").map_or("", |parts| parts.1);
    // Fields 14 and 15 of proc(5), in ticks of 10 ms.
    let ticks = after_name.split(' ').skip(11).take(2);
    ticks.filter_map(|it| it.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// The most memory that this process has had, in MB; 0 where the system does not say.
fn peak_mb() -> u64 {
    let status = fremen::file::read_text("/proc/self/status", 1 << 16).unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok());
    kilobytes.unwrap_or_default() * 1_024 / 1_000_000
}

fn same(a: &str, b: &str) -> Result<()> {
    let read = |path: &str| -> Result<_> {
        let mut models = read_models(&files_of(&[PathBuf::from(path)])?)?;
        models.sort_by(|a, b| (&a.place, a.feature).cmp(&(&b.place, b.feature)));
        Ok(models)
    };
    let (ours, theirs) = (read(a)?, read(b)?);
    if ours.len() != theirs.len() {
        bail!(
            "{} and {} models are not the same",
            ours.len(),
            theirs.len()
        );
    }
    for (a, b) in ours.iter().zip(&theirs) {
        if a != b {
            bail!("feature {} of place `{}` differs", a.feature, a.place);
        }
    }
    writeln!(
        std::io::stdout(),
        "{} models are the same, byte for byte",
        ours.len()
    )?;
    Ok(())
}

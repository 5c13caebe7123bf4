//! Does a map stay small, fast and right, however often a place is visited?
//!
//! [`run`] learns a street in a year, then goes on visiting its first place, thousands of times,
//! with a budget and the guard, and commits to a file as a robot does. For each tenth of these
//! visits it reports what the place and the file hold, the memory of this process, how long
//! `observe` took, and how many of the same later queries (all places) are answered right. Times
//! are of the machine it runs on; all other numbers are the same everywhere.

use std::fmt::Write as _;
use std::sync::Arc;

use anyhow::{Context, Result};
use chronotope::Time;
use chronotope::dataset::synthetic::Schedule;
use chronotope::feature::Features;
use chronotope::localize::{Decision, Localizer, LocalizerConfig, Preset, Query};
use rayon::prelude::*;

use super::street::{
    NUM_FIRST, NUM_QUERIES, Street, StreetOptions, extract, memory_bytes, quantile,
};

/// Visits between commits.
const COMMIT_EVERY: usize = 50;

/// Images that are drawn and extracted at once.
const CHUNK_LEN: usize = 64;

/// What to do.
#[derive(Clone, Debug, clap::Args)]
pub struct SoakOptions {
    /// Visits of the first place.
    #[arg(long = "visits", default_value_t = 10_000)]
    pub num_visits: usize,
    /// The street that is visited.
    #[command(flatten)]
    pub street: StreetOptions,
}

/// One tenth of the run.
struct Part {
    num_features: usize,
    num_visits: usize,
    map_bytes: usize,
    file_bytes: u64,
    memory_bytes: Option<u64>,
    num_held: usize,
    observe_us: [f64; 3],
    num_right: usize,
    num_wrong: usize,
}

struct Soak {
    street: Street,
    queries: Vec<(usize, Time, Features)>,
}

/// Runs it and gives the table.
pub fn run(options: &SoakOptions) -> Result<String> {
    let (mut soak, times) = Soak::new(options)?;
    let mut table = format!(
        "{} visits of place 0 of {} (seed {}), at most {} features and {} visits a place\n\
         {:>7} {:>8} {:>7} {:>8} {:>9} {:>8} {:>5} {:>9} {:>9} {:>9} {:>11}\n",
        options.num_visits,
        options.street.num_places,
        options.street.seed,
        options.street.features_per_place,
        options.street.visits_per_place,
        "visits",
        "features",
        "logged",
        "map kB",
        "file kB",
        "RSS MB",
        "held",
        "p50 ms",
        "p99 ms",
        "max ms",
        "right/wrong",
    );
    let part = soak.part(0, times)?;
    soak.row(&mut table, 0, &part)?;
    for tenth in 0..10 {
        let visits = tenth * options.num_visits / 10..(tenth + 1) * options.num_visits / 10;
        let end = visits.end;
        let (num_held, times) = soak.visit(visits)?;
        let part = soak.part(num_held, times)?;
        soak.row(&mut table, end, &part)?;
        eprintln!("{end} of {} visits", options.num_visits);
    }
    let path = options.street.out.join("soak.txt");
    std::fs::write(&path, &table).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(table)
}

impl Soak {
    fn new(options: &SoakOptions) -> Result<(Self, Vec<f64>)> {
        let (street, times) = Street::known(&options.street, "soak")?;
        let schedule = Schedule::standard(options.street.seed, NUM_FIRST, NUM_QUERIES);
        let wanted: Vec<(usize, Time)> = (schedule.query.iter())
            .flat_map(|&time| (0..options.street.num_places).map(move |place| (place, time)))
            .collect();
        let queries = (wanted.par_iter())
            .map(|&(place, time)| Ok((place, time, extract(&street.world, place, time, 1)?)))
            .collect::<Result<_>>()?;
        let soak = Self { street, queries };
        Ok((soak, times))
    }

    /// Visits the first place again and again, every 53 minutes; gives how many visits were held,
    /// and how long each took, us.
    fn visit(&mut self, visits: std::ops::Range<usize>) -> Result<(usize, Vec<f64>)> {
        let start = Time::parse("2024-01-01T00:00:00Z")?;
        let time = |visit: usize| start.plus_us(visit as i64 * 53 * 60_000_000);
        let (mut num_held, mut times) = (0, Vec::new());
        let visits: Vec<usize> = visits.collect();
        for chunk in visits.chunks(CHUNK_LEN) {
            let images = (chunk.par_iter())
                .map(|&visit| extract(&self.street.world, 0, time(visit), 2))
                .collect::<Result<Vec<_>>>()?;
            for (&visit, features) in chunk.iter().zip(&images) {
                num_held +=
                    usize::from(self.street.observe(0, time(visit), features, &mut times)?);
                if visit % COMMIT_EVERY == COMMIT_EVERY - 1 {
                    self.street.learner.commit()?;
                }
            }
        }
        Ok((num_held, times))
    }

    fn part(&mut self, num_held: usize, mut observe_us: Vec<f64>) -> Result<Part> {
        let snapshot = self.street.learner.snapshot()?;
        let localizer = Localizer::new(
            Arc::clone(&snapshot),
            LocalizerConfig::preset(Preset::Default),
        )?;
        let mut scratch = localizer.scratch();
        let (mut num_right, mut num_wrong) = (0, 0);
        for (place, time, features) in &self.queries {
            let query = Query::new(features).at(*time);
            let answer = localizer.localize(&mut scratch, &query)?;
            if let Decision::At(found) = answer.decision {
                let is_right = *snapshot.node(found).key() == self.street.world.places()[*place];
                num_right += usize::from(is_right);
                num_wrong += usize::from(!is_right);
            }
        }
        let mut quantile = |share| quantile(&mut observe_us, share);
        let first = &snapshot.nodes()[0];
        Ok(Part {
            num_features: first.features().len(),
            num_visits: first.visits().len(),
            map_bytes: snapshot.summary().num_bytes,
            file_bytes: std::fs::metadata(self.street.learner.map().path())?.len(),
            memory_bytes: memory_bytes(),
            num_held,
            observe_us: [quantile(0.5), quantile(0.99), quantile(1.0)],
            num_right,
            num_wrong,
        })
    }

    fn row(&self, table: &mut String, end: usize, part: &Part) -> Result<()> {
        let memory = part
            .memory_bytes
            .map_or_else(|| "-".into(), |bytes| format!("{:.0}", bytes as f64 / 1e6));
        writeln!(
            table,
            "{end:>7} {:>8} {:>7} {:>8} {:>9} {memory:>8} {:>5} {:>9.2} {:>9.2} {:>9.2} {:>11}",
            part.num_features,
            part.num_visits,
            part.map_bytes / 1000,
            part.file_bytes / 1000,
            part.num_held,
            part.observe_us[0] / 1e3,
            part.observe_us[1] / 1e3,
            part.observe_us[2] / 1e3,
            format!(
                "{}/{} of {}",
                part.num_right,
                part.num_wrong,
                self.queries.len()
            ),
        )?;
        Ok(())
    }
}

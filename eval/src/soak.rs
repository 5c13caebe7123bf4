//! Does a map stay small, fast and right, however often a place is visited?
//!
//! [`run`] learns a street in a year, then goes on visiting its first place, thousands of times, with a budget
//! and the guard, and commits to a file as a robot does. For each tenth of these visits it reports what the place and
//! the file hold, the memory of this process, how long `observe` took, and how many of the same later queries (all
//! places) are answered right. Times are of the machine it runs on; all other numbers are the same everywhere.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use chronotope::Time;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{ExtractorConfig, Features};
use chronotope::learn::{BudgetConfig, LearnConfig, Learner, Observation};
use chronotope::localize::{Decision, Localizer, LocalizerConfig, Preset, Query};
use chronotope::map::{Map, MapMeta, SessionId, derived_uuid};
use rayon::prelude::*;

/// Visits of each place in the first year, and queries of each place.
const NUM_FIRST: usize = 40;
const NUM_QUERIES: usize = 20;
/// Visits between commits.
const COMMIT_EVERY: usize = 50;
/// Generations that are kept.
const KEPT_GENERATIONS: usize = 8;
/// Images that are drawn and extracted at once.
const CHUNK_LEN: usize = 64;

/// What to do.
#[derive(Clone, Debug, clap::Args)]
pub struct SoakOptions {
    /// Visits of the first place.
    #[arg(long = "visits", default_value_t = 10_000)]
    pub num_visits: usize,
    /// Seed of the street.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Places of the street.
    #[arg(long = "places", default_value_t = 4)]
    pub num_places: usize,
    /// Features that a place may have.
    #[arg(long, default_value_t = 1_500)]
    pub features_per_place: usize,
    /// Visits that a place may remember.
    #[arg(long, default_value_t = 200)]
    pub visits_per_place: usize,
    /// Where soak.txt and the map are written.
    #[arg(long, default_value = "target/soak")]
    pub out: PathBuf,
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

struct Soak<'a> {
    options: &'a SoakOptions,
    world: World,
    learner: Learner,
    map: Map,
    queries: Vec<(usize, Time, Features)>,
}

/// Runs it and gives the table.
pub fn run(options: &SoakOptions) -> Result<String> {
    let mut soak = Soak::new(options)?;
    let mut table = format!(
        "{} visits of place 0 of {} (seed {}), at most {} features and {} visits a place\n\
         {:>7} {:>8} {:>7} {:>8} {:>9} {:>8} {:>5} {:>9} {:>9} {:>9} {:>11}\n",
        options.num_visits,
        options.num_places,
        options.seed,
        options.features_per_place,
        options.visits_per_place,
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
    let times = soak.first_year()?;
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
    let path = options.out.join("soak.txt");
    std::fs::write(&path, &table).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(table)
}

impl<'a> Soak<'a> {
    fn new(options: &'a SoakOptions) -> Result<Self> {
        let world = World::new(&WorldConfig::new(options.seed).num_places(options.num_places))?;
        let budget = BudgetConfig::default()
            .with_features_per_place(options.features_per_place)
            .with_visits_per_place(options.visits_per_place);
        let cfg = LearnConfig::default().with_budget(budget)?;
        let extractor = ExtractorConfig::default().build()?;
        let seed = format!("soak {}", options.seed);
        let meta = MapMeta::new(derived_uuid(&seed), extractor.id(), "default");
        std::fs::create_dir_all(&options.out)
            .with_context(|| format!("cannot create {}", options.out.display()))?;
        let path = options.out.join("soak.map");
        if path.exists() {
            std::fs::remove_file(&path)
                .with_context(|| format!("cannot replace {}", path.display()))?;
        }
        let schedule = Schedule::standard(options.seed, NUM_FIRST, NUM_QUERIES);
        let wanted: Vec<(usize, Time)> = (schedule.query.iter())
            .flat_map(|&time| (0..options.num_places).map(move |place| (place, time)))
            .collect();
        let queries = (wanted.par_iter())
            .map(|&(place, time)| Ok((place, time, extract(&world, place, time, 1)?)))
            .collect::<Result<_>>()?;
        Ok(Self {
            options,
            learner: Learner::new(cfg, meta.clone()),
            map: Map::create(path, meta)?,
            world,
            queries,
        })
    }

    /// Learns all places; gives how long each visit took, us.
    fn first_year(&mut self) -> Result<Vec<f64>> {
        let schedule = Schedule::standard(self.options.seed, NUM_FIRST, NUM_QUERIES);
        let mut times = Vec::new();
        for time in schedule.learn {
            for place in 0..self.options.num_places {
                let features = extract(&self.world, place, time, 0)?;
                self.observe(place, time, &features, &mut times)?;
            }
        }
        self.store()?;
        // From here on, as a robot goes on.
        let cfg = self.learner.cfg().clone();
        let guard = chronotope::learn::GuardConfig::default();
        let known = (*self.map.snapshot()).clone();
        self.learner = Learner::resume(cfg.with_guard(guard), known)?;
        Ok(times)
    }

    /// Visits the first place again and again, every 53 minutes; gives how many visits were held, and how long
    /// each took, us.
    fn visit(&mut self, visits: std::ops::Range<usize>) -> Result<(usize, Vec<f64>)> {
        let start = Time::parse("2024-01-01T00:00:00Z")?;
        let time = |visit: usize| start.plus_us(visit as i64 * 53 * 60_000_000);
        let (mut num_held, mut times) = (0, Vec::new());
        let visits: Vec<usize> = visits.collect();
        for chunk in visits.chunks(CHUNK_LEN) {
            let images = (chunk.par_iter())
                .map(|&visit| extract(&self.world, 0, time(visit), 2))
                .collect::<Result<Vec<_>>>()?;
            for (&visit, features) in chunk.iter().zip(&images) {
                num_held += usize::from(self.observe(0, time(visit), features, &mut times)?);
                if visit % COMMIT_EVERY == COMMIT_EVERY - 1 {
                    self.store()?;
                }
            }
        }
        Ok((num_held, times))
    }

    /// Whether the visit was held.
    fn observe(
        &mut self,
        place: usize,
        time: Time,
        features: &Features,
        times: &mut Vec<f64>,
    ) -> Result<bool> {
        let start = Instant::now();
        let learnt = self.learner.observe(&Observation {
            place: self.world.places()[place].clone(),
            session: SessionId::derive("soak"),
            time,
            features,
            image_size: (448, 384),
            mask: None,
            source: String::new(),
        })?;
        times.push(start.elapsed().as_secs_f64() * 1e6);
        Ok(learnt.doubt.is_some())
    }

    fn store(&mut self) -> Result<()> {
        self.map.replace(&*self.learner.snapshot()?)?;
        keep_newest(&self.map)
    }

    fn part(&mut self, num_held: usize, mut observe_us: Vec<f64>) -> Result<Part> {
        let snapshot = self.learner.snapshot()?;
        let localizer = Localizer::new(
            Arc::clone(&snapshot),
            LocalizerConfig::preset(Preset::Default),
        )?;
        let mut scratch = localizer.scratch();
        let (mut num_right, mut num_wrong) = (0, 0);
        for (place, time, features) in &self.queries {
            let query = Query {
                features,
                time: Some(*time),
                image_size: None,
            };
            let answer = localizer.localize(&mut scratch, &query)?;
            if let Decision::At(found) = answer.decision {
                let is_right = snapshot.node(found).key == self.world.places()[*place];
                num_right += usize::from(is_right);
                num_wrong += usize::from(!is_right);
            }
        }
        let mut quantile = |share| quantile(&mut observe_us, share);
        let first = &snapshot.nodes[0];
        Ok(Part {
            num_features: first.features.len(),
            num_visits: first.visits.len(),
            map_bytes: snapshot.summary().num_bytes,
            file_bytes: std::fs::metadata(self.map.path())?.len(),
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

/// Prunes all generations of a map but the newest few.
pub(crate) fn keep_newest(map: &Map) -> Result<()> {
    let newest = map.generations()?.into_iter().rev();
    let kept = newest.take(KEPT_GENERATIONS).map(|it| it.number).collect();
    map.prune(&kept)?;
    Ok(())
}

/// The value below which this share lies; 0 of nothing.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = (share * values.len() as f64) as usize;
    let last = values.len().saturating_sub(1);
    values.get(at.min(last)).copied().unwrap_or_default()
}

pub(crate) fn extract(world: &World, place: usize, time: Time, number: u64) -> Result<Features> {
    let extractor = ExtractorConfig::default().build()?;
    Ok(extractor.extract(&world.render(place, time, number), None)?)
}

/// Memory of this process that is in RAM, where Linux tells.
pub(crate) fn memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes * 1024)
}

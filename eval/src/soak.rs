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
use chronotope::learn::{BudgetConfig, GuardConfig, LearnConfig, Learner, Observation};
use chronotope::localize::{Decision, Localizer, LocalizerConfig, Preset, Query};
use chronotope::map::{Map, MapMeta, SessionId, Snapshot, derived_uuid};
use rayon::prelude::*;

/// Visits of each place in the first year, and queries of each place.
const NUM_FIRST: usize = 40;
const NUM_QUERIES: usize = 20;
/// Visits between commits.
const COMMIT_EVERY: usize = 50;
/// A file has at most so many generations, and so many are left then.
const MOST_GENERATIONS: usize = 8;
const KEPT_GENERATIONS: usize = 4;
/// Images that are drawn and extracted at once.
const CHUNK_LEN: usize = 64;

/// A street, and how much its map may hold.
#[derive(Clone, Debug, clap::Args)]
pub struct StreetOptions {
    /// Seed of the street.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Places of the street.
    #[arg(long = "places", default_value_t = 8)]
    pub num_places: usize,
    /// Features that a place may have.
    #[arg(long, default_value_t = 1_500)]
    pub features_per_place: usize,
    /// Visits that a place may remember.
    #[arg(long, default_value_t = 200)]
    pub visits_per_place: usize,
    /// Where the table and the map are written.
    #[arg(long, default_value = "target/soak")]
    pub out: PathBuf,
}

/// What to do.
#[derive(Clone, Debug, clap::Args)]
pub struct SoakOptions {
    /// Visits of the first place.
    #[arg(long = "visits", default_value_t = 10_000)]
    pub num_visits: usize,
    /// Where.
    #[command(flatten)]
    pub street: StreetOptions,
}

/// A street and what was learnt of it.
pub(crate) struct Street {
    pub(crate) world: World,
    pub(crate) learner: Learner,
    pub(crate) map: Map,
    /// Width and height of all images, px.
    pub(crate) image_size: (u32, u32),
}

impl Street {
    /// One that nothing is known of; its map is the file `NAME.map`, written anew.
    fn unknown(options: &StreetOptions, name: &str) -> Result<Self> {
        let world = World::new(&WorldConfig::new(options.seed).num_places(options.num_places))?;
        let budget = BudgetConfig::default()
            .with_features_per_place(options.features_per_place)
            .with_visits_per_place(options.visits_per_place);
        let cfg = LearnConfig::default().with_budget(budget)?;
        let extractor = ExtractorConfig::default().build()?;
        let seed = format!("{name} {}", options.seed);
        let meta = MapMeta::new(derived_uuid(&seed), extractor.id(), "default");
        std::fs::create_dir_all(&options.out)
            .with_context(|| format!("cannot create {}", options.out.display()))?;
        let path = options.out.join(name).with_extension("map");
        if path.exists() {
            std::fs::remove_file(&path)
                .with_context(|| format!("cannot replace {}", path.display()))?;
        }
        let image = world.render(0, Time::from_s(0), 0);
        Ok(Self {
            world,
            learner: Learner::new(cfg, meta.clone()),
            map: Map::create(path, meta)?,
            image_size: (image.width() as u32, image.height() as u32),
        })
    }

    /// One that is known from a year of rounds and learnt on behind the guard; also how long each visit of that
    /// year took to learn, us.
    pub(crate) fn known(options: &StreetOptions, name: &str) -> Result<(Self, Vec<f64>)> {
        let mut street = Self::unknown(options, name)?;
        let mut times = Vec::new();
        for time in Schedule::standard(options.seed, NUM_FIRST, NUM_QUERIES).learn {
            for place in 0..options.num_places {
                let features = extract(&street.world, place, time, 0)?;
                street.observe(place, time, &features, &mut times)?;
            }
        }
        street.store()?;
        let cfg = street.learner.cfg().clone();
        let known = (*street.map.snapshot()).clone();
        street.learner = Learner::resume(cfg.with_guard(GuardConfig::default()), known)?;
        Ok((street, times))
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
            image_size: self.image_size,
            mask: None,
            source: String::new(),
        })?;
        times.push(start.elapsed().as_secs_f64() * 1e6);
        Ok(learnt.doubt.is_some())
    }

    /// Commits, and prunes all generations but the newest few.
    fn store(&mut self) -> Result<()> {
        commit(&self.map, &*self.learner.snapshot()?)
    }
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

    /// Visits the first place again and again, every 53 minutes; gives how many visits were held, and how long
    /// each took, us.
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
                    self.street.store()?;
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
                let is_right = snapshot.node(found).key == self.street.world.places()[*place];
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
            file_bytes: std::fs::metadata(self.street.map.path())?.len(),
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

/// Commits, and prunes all generations but the newest few, where there are many.
pub(crate) fn commit(map: &Map, snapshot: &Snapshot) -> Result<()> {
    map.replace(snapshot)?;
    let generations = map.generations()?;
    if generations.len() > MOST_GENERATIONS {
        let newest = generations.iter().rev().take(KEPT_GENERATIONS);
        map.prune(&newest.map(|it| it.number).collect())?;
    }
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

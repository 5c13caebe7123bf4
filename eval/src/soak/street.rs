//! Which street is driven, what is its map, and what does it hold?

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use chronotope::Time;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{ExtractorConfig, Features};
use chronotope::learn::{BudgetConfig, Circumstances, GuardConfig, LearnConfig, Observation};
use chronotope::map::{Map, MapMeta, SessionId, derived_uuid};
use chronotope::robot::OnlineLearner;

/// Visits of each place in the first year, and queries of each place.
pub(super) const NUM_FIRST: usize = 40;

pub(super) const NUM_QUERIES: usize = 20;

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

/// A street and what was learnt of it.
pub(super) struct Street {
    pub(super) world: World,
    pub(super) learner: OnlineLearner,
    /// Width and height of all images, px.
    pub(super) image_size: (u32, u32),
}

impl Street {
    /// One that nothing is known of; its map is the file `NAME.map`, written anew.
    fn unknown(options: &StreetOptions, name: &str) -> Result<Self> {
        let world =
            World::new(&WorldConfig::new(options.seed).with_num_places(options.num_places))?;
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
            learner: OnlineLearner::new(
                Map::create(path, meta)?,
                cfg.for_building(),
                Duration::ZERO,
            )?,
            image_size: image.size(),
        })
    }

    /// One that is known from a year of rounds and learnt on behind the guard; also how long each
    /// visit of that year took to learn, us.
    pub(super) fn known(options: &StreetOptions, name: &str) -> Result<(Self, Vec<f64>)> {
        let mut street = Self::unknown(options, name)?;
        let mut times = Vec::new();
        for time in Schedule::standard(options.seed, NUM_FIRST, NUM_QUERIES).learn {
            for place in 0..options.num_places {
                let features = extract(&street.world, place, time, 0)?;
                street.observe(place, time, &features, &mut times)?;
            }
        }
        street.learner.commit()?;
        let cfg = street.learner.learner().cfg().clone();
        street.learner = OnlineLearner::new(
            street.learner.into_map(),
            cfg.with_guard(GuardConfig::default()),
            Duration::ZERO,
        )?;
        Ok((street, times))
    }

    /// Whether the visit was held.
    pub(super) fn observe(
        &mut self,
        place: usize,
        time: Time,
        features: &Features,
        times: &mut Vec<f64>,
    ) -> Result<bool> {
        let start = Instant::now();
        let observation = Observation::new(
            self.world.places()[place].clone(),
            SessionId::derive("soak"),
            time,
            features,
            self.image_size,
        );
        let learnt = (self.learner).observe(&observation, &Circumstances::default())?;
        times.push(start.elapsed().as_secs_f64() * 1e6);
        Ok(learnt.doubt.is_some())
    }
}

/// The value below which this share lies; 0 of nothing.
pub(super) fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = (share * values.len() as f64) as usize;
    let last = values.len().saturating_sub(1);
    values.get(at.min(last)).copied().unwrap_or_default()
}

pub(super) fn extract(world: &World, place: usize, time: Time, number: u64) -> Result<Features> {
    let extractor = ExtractorConfig::default().build()?;
    Ok(extractor.extract(&world.render(place, time, number), None)?)
}

/// Memory of this process that is in RAM, where Linux reports it.
pub(super) fn memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes * 1024)
}

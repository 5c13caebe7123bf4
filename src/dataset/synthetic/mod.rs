//! What would a street look like at any time of the year, the week and the day?
//!
//! A [`World`] is a street of look-alike places, drawn in memory from one seed: foliage and snow
//! change with the year, light, shadows, shops and lit windows with the day, doors, stalls and
//! parked vans with the week; passers-by, weather, sensor noise and the viewpoint change at random.
//! The true p(t) of every drawn [`Element`] is known, so it is the ground truth for models of
//! visibility, as well as data for demonstrations and tests on machines without data.
//!
//! The same code draws the control: [`WorldConfig::with_rhythms`]`(false)` gives every element its
//! own long-term mean at all times and stops the sun, so that there is nothing to learn from time.
//!
//! The houses are built alike and what lasts is much the same everywhere: places are distinguished
//! best by what comes and goes. The generator is frozen: its constants were chosen on seeds from
//! 1000 up, so that the n most lasting features of each place mislead at a third of the queries at
//! n = 30; evaluation uses seeds 1 to 30, which played no part in that, and a test holds digests of
//! images.
//!
//! Same seed, same bytes, on every machine: see `render`. It is *not* for claims about accuracy in
//! the real world: it is flat, small, and its rhythms are as regular as no street's.
//!
//! ```
//! use chronotope::dataset::synthetic::{World, WorldConfig};
//! use chronotope::Time;
//!
//! let world = World::new(&WorldConfig::new(7))?;
//! let july = Time::parse("2023-07-15T12:00:00Z")?;
//! let image = world.render(0, july, 0);
//! assert_eq!((image.width(), image.height()), (448, 384));
//! # Ok::<(), chronotope::Error>(())
//! ```

mod paint;
mod random;
mod render;
mod rhythm;
mod scene;

use std::collections::BTreeMap;
use std::sync::Arc;

pub use render::Viewpoint;
pub use scene::{Element, ElementKind};

use self::random::Rng;
use self::scene::{Scene, Street};
use super::types::{Clock, Dataset, Entry, ImageSource};
use crate::feature::GrayImage;
use crate::map::{Edge, PlaceKey};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Period, Time};

/// What world to make.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorldConfig {
    seed: u64,
    num_places: usize,
    rhythms: bool,
    width: usize,
    height: usize,
}

impl WorldConfig {
    /// 8 places with rhythms, seen in images of 448 x 384 pixels.
    pub fn new(seed: u64) -> Self {
        Self {
            seed,
            num_places: 8,
            rhythms: true,
            width: 448,
            height: 384,
        }
    }

    /// How many places there are, 1 to 1000.
    #[must_use]
    pub fn with_num_places(mut self, num_places: usize) -> Self {
        self.num_places = num_places;
        self
    }

    /// Whether anything depends on time; `false` makes the control.
    #[must_use]
    pub fn with_rhythms(mut self, rhythms: bool) -> Self {
        self.rhythms = rhythms;
        self
    }

    /// Size of the images, px: 256 x 240 to 1280 x 1024.
    #[must_use]
    pub fn with_image_size(mut self, width: usize, height: usize) -> Self {
        self.width = width;
        self.height = height;
        self
    }

    fn check(&self) -> Result<()> {
        let message = if !(1..=1000).contains(&self.num_places) {
            format!(
                "a synthetic world has 1 to 1000 places, not {}",
                self.num_places
            )
        } else if !(256..=1280).contains(&self.width) || !(240..=1024).contains(&self.height) {
            format!(
                "images of a synthetic world have 256 x 240 to 1280 x 1024 pixels, not {} x {}",
                self.width, self.height
            )
        } else {
            return Ok(());
        };
        Err(Error::new(ErrorKind::Config, message))
    }
}

/// A street of look-alike places; cheap to clone.
#[derive(Clone)]
pub struct World {
    inner: Arc<Inner>,
}

struct Inner {
    cfg: WorldConfig,
    street: Street,
    scenes: Vec<Scene>,
    keys: Vec<PlaceKey>,
}

impl World {
    /// Draws everything that stands in the world.
    pub fn new(cfg: &WorldConfig) -> Result<Self> {
        cfg.check()?;
        let street = Street {
            seed: cfg.seed,
            width: cfg.width as i32,
            height: cfg.height as i32,
            rhythms: cfg.rhythms,
        };
        let scenes = (0..cfg.num_places)
            .map(|place| Scene::new(&street, place))
            .collect();
        let keys = (0..cfg.num_places)
            .map(|place| PlaceKey::new(&format!("place-{place:02}")))
            .collect::<Result<_>>()?;
        Ok(Self {
            inner: Arc::new(Inner {
                cfg: cfg.clone(),
                street,
                scenes,
                keys,
            }),
        })
    }

    /// What it was made from.
    pub fn config(&self) -> &WorldConfig {
        &self.inner.cfg
    }

    /// The places' names, in order.
    pub fn places(&self) -> &[PlaceKey] {
        &self.inner.keys
    }

    /// Everything of a place that is drawn at some visits and not at others, ordered by cell.
    ///
    /// # Panics
    /// If there is no such place.
    pub fn truth(&self, place: usize) -> &[Element] {
        &self.inner.scenes[place].elements
    }

    /// The ids of the elements that this visit shows, ascending.
    ///
    /// # Panics
    /// If there is no such place.
    pub fn shown(&self, place: usize, time: Time, visit_seed: u64) -> Vec<u32> {
        let key = render::visit_key(&self.inner.street, place, time, visit_seed);
        self.inner.scenes[place]
            .shown(key, time)
            .map(Element::id)
            .collect()
    }

    /// Where the camera of this visit stands.
    ///
    /// # Panics
    /// If there is no such place.
    pub fn viewpoint(&self, place: usize, time: Time, visit_seed: u64) -> Viewpoint {
        assert!(place < self.inner.scenes.len(), "no place {place}");
        let key = render::visit_key(&self.inner.street, place, time, visit_seed);
        render::viewpoint(key)
    }

    /// The image of one visit; another `visit_seed` gives another visit at the same time.
    ///
    /// Costs a few nanoseconds per pixel.
    ///
    /// # Panics
    /// If there is no such place.
    pub fn render(&self, place: usize, time: Time, visit_seed: u64) -> GrayImage {
        let Inner {
            cfg,
            street,
            scenes,
            ..
        } = self.inner.as_ref();
        let key = render::visit_key(street, place, time, visit_seed);
        let data = render::render(street, &scenes[place], key, time);
        match GrayImage::new(cfg.width, cfg.height, data) {
            Ok(image) => image,
            Err(error) => unreachable!("the renderer fills every row: {error}"),
        }
    }

    /// One visit of every place at each of these times, each place a few minutes after the one
    /// before; images are rendered when they are loaded.
    ///
    /// Times that are given twice count once.
    pub fn dataset(&self, name: &str, times: &[Time]) -> Dataset {
        let mut times = times.to_vec();
        times.sort_unstable();
        times.dedup();
        let keys = &self.inner.keys;
        let mut entries = Vec::with_capacity(times.len() * keys.len());
        for &start in &times {
            for (place, key) in keys.iter().enumerate() {
                let time = start.plus_us(place as i64 * WALK_US);
                entries.push(Entry {
                    place: key.clone(),
                    time,
                    id: format!("{key}@{time}"),
                    source: Arc::new(Rendering {
                        world: self.clone(),
                        place,
                        time,
                    }),
                });
            }
        }
        entries.sort_by(|a, b| (a.time, &a.place, &a.id).cmp(&(b.time, &b.place, &b.id)));
        let edges = keys
            .windows(2)
            .flat_map(|pair| [(&pair[0], &pair[1]), (&pair[1], &pair[0])])
            .map(|(from, to)| Edge {
                from: from.clone(),
                to: to.clone(),
                name: String::new(),
            })
            .collect();
        let poses: BTreeMap<PlaceKey, [f64; 3]> = keys
            .iter()
            .enumerate()
            .map(|(place, key)| (key.clone(), [place as f64 * 25.0, 0.0, 0.0]))
            .collect();
        Dataset {
            name: name.to_owned(),
            clock: Clock::Real,
            zone: None,
            image_size: None,
            entries,
            edges,
            poses,
            problems: Vec::new(),
        }
    }
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "World({:?})", self.inner.cfg)
    }
}

/// From one place to the next, at walking pace.
const WALK_US: i64 = 5 * 60 * 1_000_000;

/// An image that is drawn when it is loaded.
struct Rendering {
    world: World,
    place: usize,
    time: Time,
}

impl ImageSource for Rendering {
    fn load(&self) -> Result<GrayImage> {
        Ok(self.world.render(self.place, self.time, 0))
    }
}

/// When the places are visited to learn and to be queried.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Starts of the rounds to learn from, ascending.
    pub learn: Vec<Time>,
    /// Starts of the rounds to localise, ascending, all later.
    pub query: Vec<Time>,
}

impl Schedule {
    /// `num_learn` rounds spread over the year 2023 and `num_query` over 2024.
    ///
    /// Rounds are spread evenly over the year, give or take, and their hours run through the day
    /// by the golden ratio, so that season, weekday and hour do not go together.
    pub fn standard(seed: u64, num_learn: usize, num_query: usize) -> Self {
        let mut rng = Rng::new(&[seed, 0x7173]);
        let offset = rng.unit();
        let mut year = |start_day: i64, num: usize, first: usize| -> Vec<Time> {
            let mut times: Vec<Time> = (0..num)
                .map(|k| {
                    let day = (k as f64 + rng.range(0.1, 0.9)) / num as f64 * 365.0;
                    let hour = offset + (first + k) as f64 * GOLDEN_RATIO + rng.range(-0.03, 0.03);
                    let hour_us = ((hour - hour.floor()) * Period::DAY.as_us() as f64) as i64;
                    // Whole minutes read better.
                    let hour_us = hour_us / MINUTE_US * MINUTE_US;
                    let day = start_day + day as i64;
                    Time::from_us(day * Period::DAY.as_us() + hour_us)
                })
                .collect();
            times.sort_unstable();
            times.dedup();
            times
        };
        // 2023-01-01 and 2024-01-01, in days since the epoch.
        Self {
            learn: year(19_358, num_learn, 0),
            query: year(19_723, num_query, num_learn),
        }
    }
}

const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;
const MINUTE_US: i64 = 60 * 1_000_000;

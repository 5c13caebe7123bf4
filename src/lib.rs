//! Visual topological localisation that knows what each place looks like *at a given time*.
//!
//! A map is a graph of places. Each place holds features (a keypoint with a BRIEF descriptor of 256
//! bits) and the log of the visits at which each was seen. From that log a model of visibility is
//! learnt, FreMEn by default: a mean and a few periodic components. For the time of a live image
//! the features that should be visible are predicted, matched with those of the image, and the
//! places are ranked by how much agrees.
//!
//! ```
//! use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
//! use chronotope::feature::{Extractor, StarBrief, StarBriefConfig};
//! use chronotope::learn::{LearnConfig, Learner, Observation};
//! use chronotope::localize::{Localizer, LocalizerConfig, Query};
//! use chronotope::map::{MapMeta, SessionId, derived_uuid};
//!
//! // Two places, seen six times in 2023 and once in 2024. `Dataset::open` reads a folder instead.
//! let world = World::new(&WorldConfig::new(1).with_num_places(2))?;
//! let schedule = Schedule::standard(1, 6, 1);
//! let extractor = StarBrief::new(StarBriefConfig::default())?;
//!
//! let meta = MapMeta::new(derived_uuid("example"), extractor.id(), "default");
//! let mut learner = Learner::new(LearnConfig::default(), meta);
//! for entry in world.dataset("learn", &schedule.learn).entries {
//!     let image = entry.source.load()?;
//!     let features = extractor.extract(&image, None)?;
//!     let session = SessionId::derive("one run");
//!     let seen = Observation::new(entry.place, session, entry.time, &features, image.size());
//!     learner.observe(&seen.with_source(entry.id))?;
//! }
//!
//! let localizer = Localizer::new(learner.snapshot()?, LocalizerConfig::default())?;
//! let mut scratch = localizer.scratch();
//! for entry in world.dataset("query", &schedule.query).entries {
//!     let features = extractor.extract(&entry.source.load()?, None)?;
//!     let query = Query::new(&features).at(entry.time);
//!     let answer = localizer.localize(&mut scratch, &query)?;
//!     assert_eq!(answer.ranking.len(), 2);
//!     println!("{}: {:?}, because {}", entry.id, answer.decision, answer.reason);
//! }
//! # Ok::<(), chronotope::Error>(())
//! ```
//!
//! # Concepts
//!
//! - A *place* ([`map::Node`] in code) is where the robot may be; [`map::Edge`]s join places.
//! - A *visit* is one observation time of a place. A feature was then seen, not seen, or could not
//!   be observed: before its birth, or under a mask. This log is the truth, every model a cache of
//!   it.
//! - *Visibility* p(t) is the probability that a feature is seen at time t
//!   ([`visibility::VisibilityModel`]). Its *spectrum* holds components (period, amplitude, phase);
//!   its *order* counts the components used, and order 0 is the mean alone.
//! - A *predicted map* ([`predict::PredictedMap`]) is the part of a place that should be visible at
//!   t.
//! - A *query* is the features and time of a live image; its answer ([`localize::Localization`])
//!   holds the ranking, the matches, the *inliers* that agree on one displacement, and a
//!   *decision*: at a place, ambiguous, or unknown. "Not here" is an answer, never an error.
//! - An *experience* is one remembered appearance of a place: what other methods keep instead.
//!
//! # Data flow
//!
//! ```text
//! learn      image -> feature -> learn::Learner -> Snapshot -> Map::commit (a generation of the file)
//! localise   Map::snapshot -> Localizer::new (fits the visibility models)
//!            image -> feature -> Query -> predict -> match -> verify -> score -> decide -> Localization
//! ```
//!
//! A [`map::Snapshot`] is immutable and a [`localize::Localizer`] only reads it, so both may be
//! shared between threads; each thread owns a [`localize::Scratch`]. Learning goes on beside it and
//! publishes the next snapshot.
//!
//! # Conventions
//!
//! - *Pixels*: x to the right, y down, the centre of the upper-left pixel at (0, 0). A displacement
//!   is live minus map, in px. Images are 8-bit grey in rows without padding.
//! - *Time*: [`Time`] counts microseconds since 1970-01-01T00:00:00Z in an `i64`; a [`Period`] is a
//!   whole number of microseconds, and a year has 365.2425 days. Phases are taken modulo the period
//!   before anything becomes a float.
//! - *Bits*: a descriptor's bit 0 is the most significant bit of its first byte, as in OpenCV;
//!   distances are Hamming distances in bits, 0 to 256.
//! - *Probability*: p(t) lies in [0, 1]; features are ranked by its value before clamping. The
//!   posterior of a ranking by counts is a share of the score and not calibrated.
//! - *Names*: numbers carry their unit (`_s`, `_us`, `_px`, `_bits`), counts begin with `num_`.
//! - *Determinism*: the same build and input give the same bytes for any number of threads and any
//!   SIMD kernel; ties go to the lowest id. The environment variable `CHRONOTOPE_KERNEL` forces a
//!   kernel.
//! - *Errors*: one [`Error`] with an [`ErrorKind`], the file, the place in it, and what helps.
//!
//! # Features of the crate
//!
//! - `dataset` (by default): folders of images and the rendered street; image files, EXIF, exported
//!   maps. A robot whose driver hands it frames does without.
//! - `hnsw` (by default): candidates of a large map by a graph of place signatures.
//! - `trace` (by default): one line of JSON for each localisation, with pictures, for dashboards.
//! - `onnx`: features of a layer of a neural network, which the user brings
//!   ([`feature::OnnxConfig`]).
//! - `opencv`: camera and video input, keypoints of ORB, FAST and AGAST. Needs OpenCV 4 and
//!   libclang.
//!
//! # Sources
//!
//! - T. Krajník, J. P. Fentanes, J. M. Santos, T. Duckett: FreMEn: Frequency map enhancement for
//!   long-term mobile robot autonomy in changing environments. IEEE Transactions on Robotics, 2017.
//!   In these docs: T-RO 2017.
//! - T. Krajník, J. P. Fentanes, G. Cielniak, C. Dondrup, T. Duckett: Spectral analysis for
//!   long-term robotic mapping. ICRA 2014.
//! - T. Krajník, J. P. Fentanes, M. Hanheide, T. Duckett: Persistent localization and life-long
//!   mapping in changing environments using the frequency map enhancement. IROS 2016.
//! - J. M. Santos, T. Krajník, T. Duckett: Spatio-temporal exploration strategies for long-term
//!   autonomy of mobile robots. Robotics and Autonomous Systems (RAS), 2017, online 2016.
//! - W. Churchill, P. Newman: Experience-based navigation for long-term localisation. International
//!   Journal of Robotics Research, 2013.
//! - M. Calonder, V. Lepetit, C. Strecha, P. Fua: BRIEF: Binary robust independent elementary
//!   features. ECCV 2010.
//! - M. Agrawal, K. Konolige, M. R. Blas: CenSurE: Center surround extremas for realtime feature
//!   detection and matching. ECCV 2008.

#[cfg(feature = "dataset")]
pub mod dataset;
pub mod feature;
pub mod learn;
pub mod localize;
pub mod map;
pub mod matching;
pub mod predict;
pub mod robot;
pub mod simd;
#[cfg(feature = "trace")]
pub mod trace;
#[cfg(feature = "dataset")]
pub mod training;

pub use fremen::{Error, ErrorKind, Period, Result, Time};
pub use fremen::{error, spectrum, time, visibility};

// What threads share, and what is handed from one to another.
const _: () = {
    const fn is_shared<T: Send + Sync>() {}
    const fn is_sent<T: Send>() {}
    is_shared::<localize::Localizer>();
    is_shared::<localize::Scratch>();
    is_shared::<map::Snapshot>();
    is_shared::<learn::Learner>();
    // The connection to its file is not shared.
    is_sent::<map::Map>();
};

/// The README's examples, so that they compile.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

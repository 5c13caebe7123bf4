//! How does a robot keep knowing where it is, image after image?
//!
//! A [`Robot`] owns the loop that every program on a robot would write: extract, localise, follow
//! the motion if wanted, learn what was located, commit when it is due, go on with the newer map.
//! What one image costs is extraction and localisation; learning happens on a second thread.
//!
//! ```no_run
//! use chronotope::feature::GrayView;
//! use chronotope::robot::{Robot, RobotConfig};
//! use chronotope::Time;
//!
//! # fn main() -> chronotope::Result<()> {
//! # let (frame, stride) = (vec![0; 640 * 480], 640);
//! let mut robot = Robot::open("street.map", RobotConfig::default())?;
//! // The driver's bytes, a row every `stride` of them; `load_gray` reads a file instead.
//! let image = GrayView::new(&frame, 640, 480, stride)?;
//! let answer = robot.see(image, Time::now())?;
//! println!("{:?}: {}", answer.decision, answer.reason);
//! println!("at {:?}", robot.place());
//! # Ok(())
//! # }
//! ```
//!
//! # What may go wrong on a robot
//!
//! - *A covered or black camera*: there is nothing to match, so the answer is unknown, and what is
//!   not located is not learnt.
//! - *A clock that jumps*: an image is answered for the time on its stamp. It is not learnt but
//!   quarantined where the stamp contradicts the robot's own clock or the images before
//!   ([`GuardConfig`](crate::learn::GuardConfig)).
//! - *A learner that cannot keep up*, a full disk, a map that somebody else changed: answers go on.
//!   What was not learnt is counted ([`Totals`]) and reported ([`Event`]).
//! - *The end*: [`Robot::finish`] commits what is left and says what failed; dropping a robot
//!   commits too.
//!
//! The map that answers changes only at the beginning of [`Robot::see`], so everything that was
//! said of one image belongs to one snapshot.

mod config;
mod event;
mod online_learner;
mod worker;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

pub use config::RobotConfig;
pub use event::{Event, Timing, Totals};
pub use online_learner::{Committed, OnlineLearner};

use self::config::Place;
use self::worker::{Lesson, Worker};
use crate::feature::{Extractor, ExtractorConfig, Features, GrayImage, GrayView, shown_by_both};
use crate::learn::{Circumstances, LearnConfig, Recipe};
use crate::localize::{
    Decision, Localization, Localizer, MotionConfig, Query, Score, Scratch, Tracker,
};
use crate::map::{Map, NodeId, PlaceKey, SessionId, Snapshot};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// Events that nobody has taken are kept up to this number; then the oldest go.
const MAX_EVENTS: usize = 256;

/// One image with what is known of it.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    image: GrayView<'a>,
    time: Option<Time>,
    now: Option<Time>,
    mask: Option<&'a GrayImage>,
    source: &'a str,
    place: Option<&'a PlaceKey>,
}

impl<'a> Frame<'a> {
    /// An image of which only the pixels are known: methods that need a time fail, and it is not
    /// learnt.
    pub fn new(image: impl Into<GrayView<'a>>) -> Self {
        Self {
            image: image.into(),
            time: None,
            now: None,
            mask: None,
            source: "",
            place: None,
        }
    }

    /// When it was taken.
    #[must_use]
    pub fn at(mut self, time: Time) -> Self {
        self.time = Some(time);
        self
    }

    /// What the robot's own clock says, if that is not the system's: simulated time.
    #[must_use]
    pub fn with_now(mut self, now: Time) -> Self {
        self.now = Some(now);
        self
    }

    /// Uses nothing of it where `mask` is 0, beside the mask of the robot.
    #[must_use]
    pub fn with_mask(mut self, mask: &'a GrayImage) -> Self {
        self.mask = Some(mask);
        self
    }

    /// Where it came from, for people; kept with a visit that is learnt from it.
    #[must_use]
    pub fn with_source(mut self, source: &'a str) -> Self {
        self.source = source;
        self
    }

    /// Somebody says that it shows this place, which may be new: it is learnt as a visit of it,
    /// whatever the answer is. A robot that does not learn only answers.
    #[must_use]
    pub fn with_place(mut self, place: &'a PlaceKey) -> Self {
        self.place = Some(place);
        self
    }
}

/// A robot that is followed is searched for at no more places first: fewer than a short list has.
const MOST_PLAUSIBLE: usize = 128;

/// Who learns what the robot locates.
#[derive(Debug)]
enum Teaching {
    Nobody,
    Inline(Box<OnlineLearner>),
    Thread(Worker),
}

/// A map, a camera's features, and what is believed: localises image after image and learns from
/// them.
///
/// Not for batches of images at once: a [`Localizer`] is shared by threads, a robot has one owner.
pub struct Robot {
    path: PathBuf,
    localizer: Arc<Localizer>,
    /// The map to go on with from the next image on.
    newer: Option<Arc<Snapshot>>,
    extractor: Box<dyn Extractor>,
    scratch: Scratch,
    tracker: Option<Tracker>,
    motion: Option<MotionConfig>,
    /// Where the next image may be taken, in a map of which a short list is matched.
    plausible: Vec<NodeId>,
    mask: Option<GrayImage>,
    teaching: Teaching,
    is_paused: bool,
    session: SessionId,
    is_live: bool,
    features: Features,
    answer: Localization,
    timing: Timing,
    totals: Totals,
    events: VecDeque<Event>,
}

impl std::fmt::Debug for Robot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Robot")
            .field("path", &self.path)
            .field("totals", &self.totals)
            .finish_non_exhaustive()
    }
}

impl Robot {
    /// Opens a map; its extractor finds the features of every image.
    ///
    /// Fails as [`Localizer::open_with`] and [`ExtractorConfig::build_with`] do, and with [`ErrorKind::Config`] if the robot shall
    /// learn but the map may not be written or the recipe cannot learn image by image, or if it
    /// shall track but places are not ranked by likelihood.
    pub fn open(path: impl AsRef<Path>, cfg: RobotConfig) -> Result<Self> {
        let path = path.as_ref();
        let (localizer, learner) = match cfg.learn {
            None => (
                Localizer::open_with(path, cfg.localize, cfg.index_cache)?,
                None,
            ),
            Some(learn) => {
                let map = Map::open(path)?;
                check_may_learn(&map, &learn)?;
                let localizer = Localizer::new(map.snapshot(), cfg.localize)
                    .map_err(|error| error.with_path(path))?;
                let learner = OnlineLearner::new(map, learn, cfg.commit_interval)?;
                (localizer, Some(learner))
            }
        };
        let extractor = ExtractorConfig::from_id(&localizer.snapshot().meta().extractor)
            .and_then(|extractor| extractor.build_with(&cfg.models))
            .map_err(|error| error.with_path(path).with_place("extractor"))?;
        let tracker = match cfg.motion {
            Some(_) if localizer.cfg().score() != Score::Likelihood => {
                let message = format!(
                    "tracking needs the score `likelihood`, not `{}`",
                    localizer.cfg().score()
                );
                return Err(Error::new(ErrorKind::Config, message)
                    .with_help("rank places by likelihood, which is the default"));
            }
            Some(motion) => Some(Tracker::new(&localizer, motion)?),
            None => None,
        };
        let localizer = Arc::new(localizer);
        let teaching = match learner {
            None => Teaching::Nobody,
            Some(learner) if cfg.learns == Place::Inline => Teaching::Inline(Box::new(learner)),
            Some(learner) => Teaching::Thread(Worker::start(learner, Arc::clone(&localizer))?),
        };
        let session = if cfg.is_live {
            SessionId::random()
        } else {
            session_after(localizer.snapshot())
        };
        Ok(Self {
            path: path.to_owned(),
            scratch: localizer.scratch(),
            localizer,
            newer: None,
            extractor,
            tracker,
            motion: cfg.motion,
            plausible: Vec::new(),
            mask: cfg.mask,
            teaching,
            is_paused: false,
            session,
            is_live: cfg.is_live,
            features: Features::new(),
            answer: Localization::default(),
            timing: Timing::default(),
            totals: Totals::default(),
            events: VecDeque::new(),
        })
    }

    /// Says where an image was taken, at `time`; learns it if that is wanted and it was located.
    ///
    /// Fails if the image has another size than the map's images, or the method needs what is
    /// missing. What goes wrong with learning is an [`Event`] and no failure.
    pub fn see<'a>(&mut self, image: impl Into<GrayView<'a>>, time: Time) -> Result<&Localization> {
        self.see_frame(&Frame::new(image).at(time))
    }

    /// [`see`](Self::see), with all that is known of the image.
    pub fn see_frame(&mut self, frame: &Frame<'_>) -> Result<&Localization> {
        self.go_on_with_newer_map()?;
        let mask = shown_by_both(frame.mask, self.mask.as_ref())?;
        // An image that does not fit may be huge: looking for its features takes memory.
        let nothing = Features::new();
        let query = Query::new(&nothing)
            .at(frame.time)
            .with_image_size(frame.image.size());
        self.localizer.check(&query)?;

        let begun = Instant::now();
        (self.extractor).extract_into(frame.image, mask.as_ref(), &mut self.features)?;
        self.timing.extract = begun.elapsed();

        let begun = Instant::now();
        self.plausible.clear();
        if let Some(tracker) = &mut self.tracker
            && self.localizer.lists_candidates()
        {
            tracker.plausible_into(MOST_PLAUSIBLE, &mut self.plausible);
        }
        let query = Query::new(&self.features)
            .at(frame.time)
            .with_image_size(frame.image.size())
            .with_prior(&self.plausible);
        (self.localizer).localize_into(&mut self.scratch, &query, &mut self.answer)?;
        if let Some(tracker) = &mut self.tracker {
            tracker.update(self.localizer.cfg(), &mut self.answer)?;
        }
        self.timing.localize = begun.elapsed();

        self.totals.num_images += 1;
        if let Decision::At(_) = self.answer.decision {
            self.totals.num_located += 1;
        }
        if let Some(place) = frame.place.or_else(|| self.place()).cloned() {
            self.learn(frame, place, mask);
        }
        Ok(&self.answer)
    }

    /// From now on nothing is learnt, or again what is located; what was learnt before stays.
    pub fn pause_learning(&mut self, is_paused: bool) {
        self.is_paused = is_paused;
    }

    /// Whether what is located is learnt.
    pub fn is_learning(&self) -> bool {
        !self.is_paused && !matches!(self.teaching, Teaching::Nobody)
    }

    /// Waits until everything that was located has been learnt and commits it; the robot is ready
    /// as before.
    ///
    /// Fails as [`OnlineLearner::commit`] does.
    pub fn commit(&mut self) -> Result<()> {
        match &mut self.teaching {
            Teaching::Nobody => {}
            Teaching::Inline(learner) => {
                let committed = learner.commit()?;
                self.note_commit(&committed);
            }
            Teaching::Thread(worker) => {
                let result = worker.flush();
                self.take_reports();
                result?;
            }
        }
        Ok(())
    }

    /// Commits what was learnt, and gives what was done in all.
    pub fn finish(mut self) -> Result<Totals> {
        self.commit()?;
        // Nothing is left to be committed on drop.
        self.teaching = Teaching::Nobody;
        Ok(self.totals)
    }

    /// The place of the last image, if that was decided.
    pub fn place(&self) -> Option<&PlaceKey> {
        match self.answer.decision {
            Decision::At(node) => Some(self.localizer.snapshot().node(node).key()),
            _ => None,
        }
    }

    /// The answer to the last image.
    pub fn answer(&self) -> &Localization {
        &self.answer
    }

    /// The features of the last image.
    pub fn features(&self) -> &Features {
        &self.features
    }

    /// How long the last image took.
    pub fn timing(&self) -> Timing {
        self.timing
    }

    /// What answered the last image.
    pub fn localizer(&self) -> &Localizer {
        &self.localizer
    }

    /// The run that its visits belong to: `learn::forget_session` takes them back.
    pub fn session(&self) -> SessionId {
        self.session
    }

    /// The map's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What was done so far; of what the second thread does, as far as it has reported.
    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// What happened since this was called last, the oldest first; at most 256 events are kept.
    pub fn events(&mut self) -> impl Iterator<Item = Event> + '_ {
        self.take_reports();
        self.events.drain(..)
    }

    fn go_on_with_newer_map(&mut self) -> Result<()> {
        let newer = match (&mut self.teaching, self.newer.take()) {
            (Teaching::Thread(worker), _) => worker.take_newer(),
            (_, Some(snapshot)) => Some(Arc::new(self.localizer.with_snapshot(snapshot)?)),
            _ => None,
        };
        if let Some(newer) = newer {
            let num_places = self.localizer.snapshot().nodes().len();
            self.localizer = newer;
            self.scratch = self.localizer.scratch();
            if let Some(motion) = self.motion
                && self.localizer.snapshot().nodes().len() != num_places
            {
                // A place was added: what was believed is about others.
                self.tracker = Some(Tracker::new(&self.localizer, motion)?);
            }
        }
        Ok(())
    }

    fn learn(&mut self, frame: &Frame<'_>, place: PlaceKey, mask: Option<GrayImage>) {
        if self.is_paused || matches!(self.teaching, Teaching::Nobody) {
            return;
        }
        let Some(time) = frame.time else {
            let error = Error::new(ErrorKind::Time, "without a time it cannot be learnt")
                .with_help("give --time");
            self.note(Event::NotLearnt {
                source: frame.source.to_owned(),
                error,
            });
            return;
        };
        let lesson = Lesson {
            place,
            time,
            circumstances: Circumstances {
                now: frame.now.or_else(|| Some(Time::now())),
                is_live: self.is_live,
                is_labelled: frame.place.is_some(),
                gray_range: frame.image.gray_range(mask.as_ref()),
            },
            session: self.session,
            features: self.features.clone(),
            image_size: frame.image.size(),
            mask,
            source: frame.source.to_owned(),
        };
        match &mut self.teaching {
            Teaching::Nobody => {}
            Teaching::Inline(learner) => {
                let event = lesson.learn(learner);
                self.note(event);
                self.commit_if_due();
            }
            Teaching::Thread(worker) => {
                if let Some(source) = worker.give(lesson) {
                    self.note(Event::Missed { source });
                }
                self.take_reports();
            }
        }
    }

    fn commit_if_due(&mut self) {
        let Teaching::Inline(learner) = &mut self.teaching else {
            return;
        };
        if !learner.is_commit_due() {
            return;
        }
        match learner.commit() {
            Ok(committed) => self.note_commit(&committed),
            Err(error) => self.note(Event::NotCommitted { error }),
        }
    }

    fn note_commit(&mut self, committed: &Committed) {
        self.newer = Some(Arc::clone(&committed.snapshot));
        self.note(Event::Committed {
            generation: committed.snapshot.generation(),
            took: committed.took,
        });
    }

    fn take_reports(&mut self) {
        let mut reports = Vec::new();
        if let Teaching::Thread(worker) = &self.teaching {
            reports.extend(worker.reports());
        }
        for event in reports {
            self.note(event);
        }
    }

    fn note(&mut self, event: Event) {
        self.totals.count(&event);
        if self.events.len() == MAX_EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }
}

impl Drop for Robot {
    /// An error that ends the program loses nothing of what was learnt before.
    fn drop(&mut self) {
        if let Err(error) = self.commit() {
            tracing::warn!("what was learnt last is not kept: {error}");
        }
    }
}

/// The run that goes on from this state of this map: recorded images that are given to the same map
/// again give the same visits.
fn session_after(snapshot: &Snapshot) -> SessionId {
    let (uuid, generation) = (snapshot.meta().uuid, snapshot.generation());
    SessionId::derive(&format!("run on {uuid:032x} after {generation}"))
}

fn check_may_learn(map: &Map, cfg: &LearnConfig) -> Result<()> {
    let (message, help) = if map.is_read_only() {
        (
            "this map may not be written",
            "leave out --learn or copy the map",
        )
    } else if cfg.recipe() == Recipe::Reference {
        (
            "the reference recipe looks at all images of a place at once",
            "leave out --learn and use `chronotope map update`",
        )
    } else {
        return Ok(());
    };
    let error = Error::new(ErrorKind::Config, message).with_path(map.path());
    Err(error.with_help(help))
}

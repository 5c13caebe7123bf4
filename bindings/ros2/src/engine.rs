//! Who answers images, and never keeps a camera waiting?
//!
//! One thread owns the robot. Of images it is given the newest only: one that comes while another
//! waits takes its place, and is counted. What is asked of the robot beside is done between two
//! images; a map that was opened elsewhere is taken over there, too, so that no image is missed.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::{DecodeLimits, GrayImage, LoadOptions};
use chronotope::learn::Learnt;
use chronotope::map::{PlaceKey, Quarantine};
use chronotope::robot::{Event, Frame, Robot};
use chronotope::time::Time;
use chronotope_bags::{Answer, EncodedImage, RawImage};
use chronotope_terminal::reading::Adjust;
use futures::channel::mpsc::UnboundedSender;
use futures::channel::oneshot;

use crate::clerk::Opened;
use crate::messages::{CompressedImage, Header, Image};
use crate::overlay;
use crate::parameters::Settings;
use crate::planner::PlannerView;

/// With no image for so long, what was learnt is committed.
const IDLE: Duration = Duration::from_millis(500);
/// A commit that failed is tried again after so long.
const COMMIT_AGAIN: Duration = Duration::from_secs(5);

/// Pixels as they came.
#[derive(Debug)]
pub(crate) enum Pixels {
    Raw(Image),
    Encoded(CompressedImage),
}

impl Pixels {
    pub(crate) fn header(&self) -> &Header {
        match self {
            Self::Raw(image) => &image.header,
            Self::Encoded(image) => &image.header,
        }
    }

    fn to_gray(&self, limits: &DecodeLimits) -> Result<GrayImage> {
        match self {
            Self::Raw(image) => RawImage {
                height: image.height,
                width: image.width,
                encoding: image.encoding.as_str().into(),
                is_big_endian: image.is_bigendian != 0,
                step: image.step,
                data: &image.data,
            }
            .to_gray(limits),
            Self::Encoded(image) => EncodedImage {
                format: image.format.as_str().into(),
                data: &image.data,
            }
            .to_gray(limits),
        }
    }
}

/// An image that came.
#[derive(Debug)]
pub(crate) struct Shot {
    pub(crate) pixels: Pixels,
    pub(crate) received: Instant,
    /// What the robot's clock said then, if it is simulated.
    pub(crate) simulated: Option<Time>,
}

/// How a request went, for whoever made it.
pub(crate) type Reply = oneshot::Sender<std::result::Result<String, String>>;

/// What is asked of the robot.
pub(crate) enum Command {
    Configure(Box<Settings>),
    /// Go on with this one; `begins`: also if there is none so far.
    TakeOver {
        opened: Opened,
        begins: bool,
        reply: Option<Reply>,
    },
    Commit(Reply),
    /// Commit, and be without a map from then on; `is_last`: also if it cannot be committed.
    Close {
        is_last: bool,
        reply: Reply,
    },
    /// The next image shows this place, if one comes in time.
    Teach {
        place: PlaceKey,
        until: Instant,
        reply: Reply,
    },
    End,
}

/// What happened.
pub(crate) enum Report {
    Answered(Box<Answered>),
    /// An image could not be answered.
    Failed(Error),
    /// What people should know.
    Warning(String),
    Info(String),
    Map(MapState),
    /// What the file was found to hold.
    InFile(InFile),
    Learning(LearningState),
    Ended,
}

/// An answer, as it is published.
pub(crate) struct Answered {
    pub(crate) json: String,
    pub(crate) view: PlannerView,
    pub(crate) time: Time,
    pub(crate) num_features: usize,
    pub(crate) gray_range: Option<(u8, u8)>,
    pub(crate) latency: Duration,
    pub(crate) picture: Option<Image>,
    pub(crate) num_dropped: u64,
}

/// What a map's file holds, beside what was opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum InFile {
    /// What was opened.
    #[default]
    Same,
    /// Another generation, of this map or of one that took its place.
    Other(u64),
    /// Nothing that can be read, and why.
    Nothing(String),
}

/// Which map answers.
#[derive(Clone, Debug, Default)]
pub(crate) struct MapState {
    pub(crate) path: String,
    pub(crate) generation: u64,
    pub(crate) num_places: usize,
    pub(crate) num_held: usize,
    /// Of fewer features an image is blind.
    pub(crate) min_features: usize,
    pub(crate) in_file: InFile,
}

/// What was learnt.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct LearningState {
    pub(crate) is_on: bool,
    pub(crate) num_learnt: usize,
    pub(crate) num_held: usize,
    pub(crate) num_missed: usize,
    /// Why the last commit did not work.
    pub(crate) failure: Option<String>,
}

#[derive(Default)]
struct Inbox {
    image: Option<Shot>,
    commands: VecDeque<Command>,
    num_dropped: u64,
}

/// Where images and requests are left for the thread.
#[derive(Clone, Default)]
pub(crate) struct Mailbox {
    inbox: Arc<(Mutex<Inbox>, Condvar)>,
    wants_picture: Arc<AtomicBool>,
}

impl Mailbox {
    /// Leaves an image, in place of one that waits.
    pub(crate) fn see(&self, shot: Shot) {
        let mut inbox = self.lock();
        if inbox.image.replace(shot).is_some() {
            inbox.num_dropped += 1;
        }
        self.inbox.1.notify_one();
    }

    /// Nobody wants the image that waits.
    pub(crate) fn forget_image(&self) {
        self.lock().image = None;
    }

    pub(crate) fn tell(&self, command: Command) {
        self.lock().commands.push_back(command);
        self.inbox.1.notify_one();
    }

    /// Whether the next answer shall be drawn over its image.
    pub(crate) fn want_picture(&self) {
        self.wants_picture.store(true, Ordering::Relaxed);
    }

    fn lock(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is to be done next, requests first; nothing after some time.
    fn next(&self) -> (Option<Command>, Option<Shot>, u64) {
        let mut inbox = self.lock();
        if inbox.commands.is_empty() && inbox.image.is_none() {
            let waited = self.inbox.1.wait_timeout(inbox, IDLE);
            inbox = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        let command = inbox.commands.pop_front();
        let image = match command {
            Some(_) => None,
            None => inbox.image.take(),
        };
        (command, image, inbox.num_dropped)
    }
}

/// Somebody waits to hear what became of a place that was named.
struct Lesson {
    place: PlaceKey,
    until: Instant,
    reply: Reply,
}

/// What the thread owns.
pub(crate) struct Engine {
    /// `None` while no map is open.
    robot: Option<Box<Robot>>,
    /// Of fewer features an image is blind.
    min_features: usize,
    mailbox: Mailbox,
    reports: UnboundedSender<Report>,
    /// Where robots go that were replaced: to finish takes time.
    retire: Box<dyn Fn(Box<Robot>) + Send>,
    settings: Box<Settings>,
    adjust: Adjust,
    topic: String,
    lesson: Option<Lesson>,
    /// Of the map that was reported last.
    generation: Option<u64>,
    learning: LearningState,
    /// Whether something may have been learnt that is not in the file.
    is_dirty: bool,
    /// When the last commit failed, if it did.
    failed_commit: Option<Instant>,
    last_begun: Option<Instant>,
}

impl Engine {
    /// Starts the thread.
    pub(crate) fn start(
        opened: Option<Opened>,
        settings: Settings,
        topic: String,
        mailbox: Mailbox,
        reports: UnboundedSender<Report>,
        retire: Box<dyn Fn(Box<Robot>) + Send>,
    ) -> Result<JoinHandle<()>> {
        let min_features = opened.as_ref().map_or(0, |it| it.min_features);
        let robot = opened.map(|it| it.robot);
        let mut engine = Self {
            adjust: adjust(&settings, robot.as_deref()),
            robot,
            min_features,
            mailbox,
            reports,
            retire,
            settings: Box::new(settings),
            topic,
            lesson: None,
            generation: None,
            learning: LearningState::default(),
            is_dirty: false,
            failed_commit: None,
            last_begun: None,
        };
        std::thread::Builder::new()
            .name("chronotope-robot".into())
            .spawn(move || engine.run())
            .map_err(|cause| {
                Error::new(ErrorKind::Io, format!("no thread for the robot: {cause}"))
                    .with_source(cause)
            })
    }

    fn run(&mut self) {
        self.configure();
        loop {
            let (command, image, num_dropped) = self.mailbox.next();
            match (command, image) {
                (Some(Command::End), _) => break,
                (Some(command), _) => self.obey(command),
                (None, Some(shot)) => self.see(&shot, num_dropped),
                (None, None) => self.commit_at_rest(),
            }
            self.give_up_lesson();
            self.report_map();
        }
        if let Err(error) = self.commit() {
            self.report(Report::Warning(format!(
                "what was learnt last is not kept: {error}"
            )));
        }
        self.report(Report::Ended);
    }

    fn obey(&mut self, command: Command) {
        match command {
            Command::Configure(settings) => {
                self.settings = settings;
                self.configure();
            }
            Command::TakeOver {
                opened,
                begins,
                reply,
            } => self.take_over(opened, begins, reply),
            Command::Commit(reply) => {
                let done = self.commit().and_then(|()| {
                    let robot = self.robot.as_ref().ok_or_else(no_map)?;
                    Ok(if robot.is_learning() {
                        "what was learnt is in the file".to_owned()
                    } else {
                        let generation = robot.localizer().snapshot().generation();
                        format!("nothing is learnt; generation {generation}")
                    })
                });
                answer(Some(reply), done.map_err(|error| error.to_string()));
            }
            Command::Close { is_last, reply } => {
                let done = self.commit();
                if done.is_ok() || is_last {
                    self.close();
                }
                let done = done.map(|()| "the map is closed".to_owned());
                answer(Some(reply), done.map_err(|error| error.to_string()));
            }
            Command::Teach {
                place,
                until,
                reply,
            } => {
                if self.is_learning() {
                    let lesson = Lesson {
                        place,
                        until,
                        reply,
                    };
                    if let Some(before) = self.lesson.replace(lesson) {
                        let why = "another place was named before an image came";
                        answer(Some(before.reply), Err(why.into()));
                    }
                } else {
                    let why =
                        "nothing is learnt: start the node with learn:=true, and set learning";
                    answer(Some(reply), Err(why.into()));
                }
            }
            Command::End => {}
        }
    }

    fn take_over(&mut self, opened: Opened, begins: bool, reply: Option<Reply>) {
        let robot = opened.robot;
        if self.robot.is_none() && !begins {
            (self.retire)(robot);
            answer(reply, Err(no_map().to_string()));
            return;
        }
        let snapshot = robot.localizer().snapshot();
        let taken = format!(
            "{}: generation {}, {} places",
            robot.path().display(),
            snapshot.generation(),
            snapshot.nodes().len()
        );
        if let Some(retired) = self.robot.replace(robot) {
            (self.retire)(retired);
        }
        (self.generation, self.min_features) = (None, opened.min_features);
        self.configure();
        self.report(Report::Info(format!("goes on with {taken}")));
        answer(reply, Ok(taken));
    }

    fn close(&mut self) {
        if let Some(retired) = self.robot.take() {
            (self.retire)(retired);
        }
        self.generation = None;
        self.learning = LearningState::default();
        self.configure();
        self.report(Report::Map(MapState::default()));
    }

    fn is_learning(&self) -> bool {
        self.robot.as_ref().is_some_and(|it| it.is_learning())
    }

    /// Applies the parameters to the robot and to its images.
    fn configure(&mut self) {
        if let Some(robot) = &mut self.robot {
            robot.pause_learning(!self.settings.is_learning);
        }
        self.adjust = adjust(&self.settings, self.robot.as_deref());
        self.learning.is_on = self.is_learning();
        self.report(Report::Learning(self.learning.clone()));
    }

    fn see(&mut self, shot: &Shot, num_dropped: u64) {
        if self.robot.is_none() {
            // It came before the map was closed.
            return;
        }
        let begun = Instant::now();
        let rate_hz = self.settings.max_rate_hz;
        let is_soon = self.last_begun.is_some_and(|last| {
            // A little less, as images of this very rate come a little early at times.
            rate_hz > 0.0 && begun.duration_since(last).as_secs_f64() < 0.95 / rate_hz
        });
        if is_soon {
            return;
        }
        self.last_begun = Some(begun);
        let lesson = self.lesson.take();
        let answered = self.answer(shot, lesson.as_ref().map(|it| &it.place));
        if let Some(Lesson { reply, .. }) = lesson {
            let outcome = match &answered {
                Ok((_, source)) => self.what_was_taught(source),
                Err(error) => Err(error.to_string()),
            };
            answer(Some(reply), outcome);
        }
        match answered {
            Ok((mut answered, _)) => {
                answered.num_dropped = num_dropped;
                self.report(Report::Answered(answered));
            }
            Err(error) => self.report(Report::Failed(error)),
        }
        self.hear_events(None);
    }

    /// The answer to an image, and its name.
    fn answer(&mut self, shot: &Shot, place: Option<&PlaceKey>) -> Result<(Box<Answered>, String)> {
        let robot = self.robot.as_mut().ok_or_else(no_map)?;
        let header = shot.pixels.header();
        let now = shot.simulated.unwrap_or_else(Time::now);
        let time = header.stamp.time().unwrap_or(now);
        let image = shot.pixels.to_gray(&DecodeLimits::default())?;
        let (image, _) = self.adjust.apply(image, None, &mut String::new())?;
        let source = format!("{}@{time}", self.topic);
        let mut frame = Frame::new(&image)
            .at(time)
            .with_now(now)
            .with_source(&source);
        if let Some(place) = place {
            frame = frame.with_place(place);
        }
        robot.see_frame(&frame)?;
        self.is_dirty |= robot.is_learning();
        let answer = Answer::of(robot, &source, time, None);
        let wants = (self.mailbox.wants_picture).swap(false, Ordering::Relaxed);
        let picture = wants.then(|| overlay::draw(&image, &answer, header.clone()));
        let json = serde_json::to_string(&answer.in_short())
            .map_err(|cause| Error::new(ErrorKind::Format, cause.to_string()))?;
        let answered = Answered {
            json,
            view: PlannerView::of(robot.localizer().snapshot(), robot.answer()),
            time,
            num_features: robot.features().len(),
            gray_range: image.gray_range(None),
            latency: shot.received.elapsed(),
            picture,
            num_dropped: 0,
        };
        Ok((Box::new(answered), source))
    }

    /// Commits a lesson, and says what became of it: who is told so can rely on it.
    fn what_was_taught(&mut self, source: &str) -> std::result::Result<String, String> {
        let robot = self.robot.as_mut().ok_or_else(|| no_map().to_string())?;
        robot.commit().map_err(|error| error.to_string())?;
        self.is_dirty = false;
        let learnt = self.hear_events(Some(source));
        match learnt {
            Some(Ok(learnt)) if learnt.doubt.is_some() => {
                let doubt = learnt.doubt.map_or_else(String::new, |it| it.to_string());
                Err(format!("the visit is quarantined: {doubt}"))
            }
            Some(Ok(learnt)) if learnt.is_same_visit => {
                Ok("it belongs to a visit that was learnt already".into())
            }
            Some(Ok(_)) => Ok("learnt and written".into()),
            Some(Err(error)) => Err(error),
            None => Err("the image came while others were learnt: try again".into()),
        }
    }

    /// Reports what happened beside the answers; gives what became of an image.
    fn hear_events(&mut self, source: Option<&str>) -> Option<std::result::Result<Learnt, String>> {
        let robot = self.robot.as_mut()?;
        let before = self.learning.clone();
        let mut found = None;
        let mut reports = Vec::new();
        for event in robot.events() {
            match event {
                Event::Learnt {
                    source: from,
                    place,
                    learnt,
                    ..
                } => {
                    if let Some(doubt) = learnt.doubt.as_ref().filter(|_| !learnt.is_same_visit) {
                        let text = format!("quarantined: {from} at {place}: {doubt}");
                        reports.push(Report::Warning(text));
                    }
                    if source == Some(&*from) {
                        found = Some(Ok(learnt));
                    }
                }
                Event::NotLearnt {
                    source: from,
                    error,
                } => {
                    reports.push(Report::Warning(format!("not learnt: {from}: {error}")));
                    if source == Some(&*from) {
                        found = Some(Err(error.to_string()));
                    }
                }
                Event::NotCommitted { error } => self.learning.failure = Some(error.to_string()),
                Event::Committed { .. } => self.learning.failure = None,
                _ => {}
            }
        }
        let totals = robot.totals();
        self.learning.num_learnt = totals.num_learnt;
        self.learning.num_held = totals.num_quarantined;
        self.learning.num_missed = totals.num_missed;
        for report in reports {
            self.report(report);
        }
        if self.learning != before {
            self.report(Report::Learning(self.learning.clone()));
        }
        found
    }

    /// Commits what was learnt now that no image comes; where that fails, again and again, but not
    /// so often that an image would wait for it.
    fn commit_at_rest(&mut self) {
        let is_soon = (self.failed_commit).is_some_and(|last| last.elapsed() < COMMIT_AGAIN);
        if !self.is_dirty || is_soon {
            return;
        }
        let before = self.learning.failure.clone();
        if let Err(error) = self.commit() {
            let why = error.to_string();
            if before.as_ref() != Some(&why) {
                self.report(Report::Warning(format!("not written yet: {why}")));
            }
        }
    }

    fn commit(&mut self) -> Result<()> {
        let Some(robot) = &mut self.robot else {
            self.is_dirty = false;
            return Ok(());
        };
        let result = robot.commit();
        self.is_dirty = result.is_err();
        self.failed_commit = result.is_err().then(Instant::now);
        // What happened before does not say how this commit went.
        self.hear_events(None);
        self.learning.failure = result.as_ref().err().map(ToString::to_string);
        self.report(Report::Learning(self.learning.clone()));
        result
    }

    /// Nobody waits for an image for ever.
    fn give_up_lesson(&mut self) {
        if let Some(lesson) = self.lesson.take_if(|it| Instant::now() > it.until) {
            let why = "no image came: is the camera on?".to_owned();
            answer(Some(lesson.reply), Err(why));
        }
    }

    /// Says which map answers, where that has changed.
    fn report_map(&mut self) {
        let Some(robot) = &self.robot else {
            return;
        };
        let snapshot = robot.localizer().snapshot();
        if self.generation == Some(snapshot.generation()) {
            return;
        }
        self.generation = Some(snapshot.generation());
        let num_held = Quarantine::of(snapshot).map_or(0, |it| it.visits().len());
        let state = MapState {
            path: robot.path().display().to_string(),
            generation: snapshot.generation(),
            num_places: snapshot.nodes().len(),
            num_held,
            min_features: self.min_features,
            in_file: InFile::Same,
        };
        self.report(Report::Map(state));
    }

    fn report(&self, report: Report) {
        // Nobody listens any more when the node ends.
        let _ = self.reports.unbounded_send(report);
    }
}

fn adjust(settings: &Settings, robot: Option<&Robot>) -> Adjust {
    let options = LoadOptions::default().with_rotation(settings.rotation());
    let size = robot.and_then(|it| it.localizer().snapshot().meta().image_size);
    Adjust::new(options, size)
}

fn no_map() -> Error {
    Error::new(ErrorKind::NotFound, "no map is open")
        .with_help("configure the node: ros2 lifecycle set NODE configure")
}

/// Tells whoever asked, if they still wait.
pub(crate) fn answer(reply: Option<Reply>, outcome: std::result::Result<String, String>) {
    if let Some(reply) = reply {
        let _ = reply.send(outcome);
    }
}

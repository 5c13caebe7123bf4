//! How does a robot learn without keeping an image waiting?
//!
//! A thread owns the learner. Images reach it through a short queue, which is left out where it is
//! full, as a camera's driver does; its reports come back through another one. After each commit
//! the thread fits a localiser to the newer map, predicts for the time of the latest image, and
//! lays it ready.

use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use super::event::Event;
use super::online_learner::OnlineLearner;
use crate::feature::{Features, GrayImage};
use crate::learn::{Circumstances, Observation};
use crate::localize::Localizer;
use crate::map::{PlaceKey, SessionId};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// Images that wait for the learner.
const QUEUE_LEN: usize = 4;

/// A located image, to be learnt.
#[derive(Debug)]
pub(super) struct Lesson {
    pub(super) place: PlaceKey,
    pub(super) time: Time,
    pub(super) circumstances: Circumstances,
    pub(super) session: SessionId,
    pub(super) features: Features,
    pub(super) image_size: (u32, u32),
    pub(super) mask: Option<GrayImage>,
    pub(super) source: String,
}

impl Lesson {
    pub(super) fn learn(self, learner: &mut OnlineLearner) -> Event {
        let begun = Instant::now();
        let observation = Observation {
            place: self.place,
            session: self.session,
            time: self.time,
            features: &self.features,
            image_size: self.image_size,
            mask: self.mask.as_ref(),
            source: self.source,
        };
        let result = learner.observe(&observation, &self.circumstances);
        let Observation { place, source, .. } = observation;
        match result {
            Ok(learnt) => Event::Learnt {
                place,
                source,
                learnt,
                took: begun.elapsed(),
            },
            Err(error) => Event::NotLearnt { source, error },
        }
    }
}

enum Task {
    Learn(Box<Lesson>),
    /// Commit, and answer when that is done.
    Flush(Sender<Result<()>>),
}

/// The localiser that is ready and not yet taken.
type Ready = Arc<Mutex<Option<Arc<Localizer>>>>;

/// A thread that learns.
#[derive(Debug)]
pub(super) struct Worker {
    /// `None` once the thread shall end.
    tasks: Option<SyncSender<Task>>,
    reports: Receiver<Event>,
    ready: Ready,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    pub(super) fn start(learner: OnlineLearner, localizer: Arc<Localizer>) -> Result<Self> {
        let (to_thread, tasks) = sync_channel(QUEUE_LEN);
        let (to_robot, reports) = channel();
        let ready = Ready::default();
        let mut pupil = Pupil {
            learner,
            localizer,
            latest: Time::default(),
            to_robot,
            ready: Arc::clone(&ready),
        };
        let thread = std::thread::Builder::new()
            .name("chronotope-learn".into())
            .spawn(move || pupil.run(&tasks))
            .map_err(|cause| {
                Error::new(ErrorKind::Io, format!("no thread to learn on: {cause}"))
                    .with_source(cause)
            })?;
        Ok(Self {
            tasks: Some(to_thread),
            reports,
            ready,
            thread: Some(thread),
        })
    }

    /// Gives an image to the thread, or its source back if the thread is busy.
    pub(super) fn give(&self, lesson: Lesson) -> Option<String> {
        let Some(tasks) = &self.tasks else {
            return Some(lesson.source);
        };
        match tasks.try_send(Task::Learn(Box::new(lesson))) {
            Ok(()) => None,
            Err(TrySendError::Full(task) | TrySendError::Disconnected(task)) => match task {
                Task::Learn(lesson) => Some(lesson.source),
                Task::Flush(_) => None,
            },
        }
    }

    /// What the thread has reported.
    pub(super) fn reports(&self) -> impl Iterator<Item = Event> + '_ {
        self.reports.try_iter()
    }

    /// The newest localiser, once.
    pub(super) fn take_newer(&self) -> Option<Arc<Localizer>> {
        (self.ready.lock())
            .unwrap_or_else(PoisonError::into_inner)
            .take()
    }

    /// Waits until everything that was given is learnt and committed.
    pub(super) fn flush(&self) -> Result<()> {
        let ended = || Error::new(ErrorKind::Io, "the thread that learns has ended");
        let Some(tasks) = &self.tasks else {
            return Ok(());
        };
        let (done, answer) = channel();
        tasks.send(Task::Flush(done)).map_err(|_| ended())?;
        answer.recv().map_err(|_| ended())?
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.tasks = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that learns has panicked");
        }
    }
}

/// What the thread owns.
struct Pupil {
    learner: OnlineLearner,
    /// The newest, from which the next one is made.
    localizer: Arc<Localizer>,
    /// The time of the latest image.
    latest: Time,
    to_robot: Sender<Event>,
    ready: Ready,
}

impl Pupil {
    fn run(&mut self, tasks: &Receiver<Task>) {
        for task in tasks {
            match task {
                Task::Learn(lesson) => {
                    self.latest = lesson.circumstances.now.unwrap_or(lesson.time);
                    let event = lesson.learn(&mut self.learner);
                    self.report(event);
                    if self.learner.is_commit_due()
                        && let Err(error) = self.commit()
                    {
                        self.report(Event::NotCommitted { error });
                    }
                }
                Task::Flush(done) => {
                    let result = self.commit();
                    // Nobody waits any more if the robot is gone.
                    let _ = done.send(result);
                }
            }
        }
    }

    /// Commits, and lays a localiser of the newer map ready.
    fn commit(&mut self) -> Result<()> {
        let committed = self.learner.commit()?;
        self.report(Event::Committed {
            generation: committed.snapshot.generation(),
            took: committed.took,
        });
        let newer = self.localizer.with_snapshot(committed.snapshot)?;
        // So that no image waits for it.
        newer.prefetch(self.latest);
        self.localizer = Arc::new(newer);
        let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        *ready = Some(Arc::clone(&self.localizer));
        Ok(())
    }

    fn report(&self, event: Event) {
        // Nobody listens any more if the robot is gone.
        let _ = self.to_robot.send(event);
    }
}

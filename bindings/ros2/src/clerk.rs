//! Who does what takes long, while images are answered?
//!
//! A thread opens maps, accepts and drops quarantined visits, and finishes robots that were
//! replaced. It works on the map's file as every other process does: commits of a robot that learns
//! and those of this thread go on top of each other.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::SystemTime;

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::{LoadOptions, load_mask};
use chronotope::learn::accept_held;
use chronotope::map::{Map, MapMeta, Quarantine, Stamp, VisitId};
use chronotope::robot::{Robot, RobotConfig};
use chronotope_terminal::config::Config;

use futures::channel::mpsc::UnboundedSender;

use crate::engine::{Command, InFile, Mailbox, Reply, Report, answer};
use crate::parameters::MapSource;

/// An answer that takes several packets does not reach whoever asked: the middleware leaves out of
/// such packets which request they answer.
const MAX_ANSWER_BYTES: usize = 900;

/// What the thread is asked for.
pub(crate) enum Task {
    /// Open this, and have the robot go on with it, or begin with it.
    Open {
        source: MapSource,
        begins: bool,
        reply: Option<Reply>,
    },
    /// Look whether the file still holds what was opened; if not, say so, and open it where that is
    /// wanted.
    Look {
        source: MapSource,
        opens: bool,
    },
    Held(PathBuf, Reply),
    /// Visits by the first digits of their identities; none: all.
    Accept(MapSource, Vec<String>, Reply),
    Drop(MapSource, Vec<String>, Reply),
    Retire(Box<Robot>),
}

/// A map that was opened.
pub(crate) struct Opened {
    pub(crate) robot: Box<Robot>,
    /// What the file held then.
    pub(crate) stamp: Stamp,
    /// Of fewer features an image is blind.
    pub(crate) min_features: usize,
}

/// Starts the thread, which knows of the map that was `opened` before; it ends with the last sender.
pub(crate) fn start(
    mailbox: Mailbox,
    reports: UnboundedSender<Report>,
    opened: Option<Stamp>,
) -> Result<(Sender<Task>, JoinHandle<()>)> {
    let (tasks, inbox) = channel();
    let mut clerk = Clerk {
        mailbox,
        reports,
        opened,
        seen: None,
        failure: None,
    };
    let thread = std::thread::Builder::new()
        .name("chronotope-clerk".into())
        .spawn(move || clerk.run(&inbox))
        .map_err(|cause| {
            Error::new(ErrorKind::Io, format!("no thread to open maps: {cause}")).with_source(cause)
        })?;
    Ok((tasks, thread))
}

/// Opens a map as the parameters say.
///
/// Fails if none is named or it cannot be opened.
pub(crate) fn open(source: &MapSource) -> Result<Opened> {
    if source.map.as_os_str().is_empty() {
        return Err(Error::new(ErrorKind::Config, "no map is named")
            .with_place("parameter map")
            .with_help("start it with --ros-args -p map:=site.map, or set the parameter"));
    }
    // Before the map: what is committed meanwhile is seen to be newer.
    let stamp = Stamp::read(&source.map)?;
    let config = Config::read_for(&MapMeta::read(&source.map)?, source.config.as_deref())?;
    let min_features = config.learn.guard().min_features();
    let mut localize = config.localize.clone();
    if let Some(risk) = source.risk {
        localize = localize.with_risk(risk);
    }
    let mut cfg = RobotConfig::default().with_localize(localize);
    if let Some(mask) = &source.mask {
        cfg = cfg.with_mask(load_mask(mask, &LoadOptions::default())?);
    }
    if source.tracks {
        cfg = cfg.with_tracking(config.motion);
    }
    if source.learns {
        cfg = cfg.with_learning(config.learn_within_budget(&source.map)?);
    }
    let robot = Robot::open(&source.map, cfg).map(Box::new)?;
    Ok(Opened {
        robot,
        stamp,
        min_features,
    })
}

/// By what a file shows from outside that it was written to, or that another took its place.
type Outside = (PathBuf, SystemTime, u64);

struct Clerk {
    mailbox: Mailbox,
    reports: UnboundedSender<Report>,
    /// What the file held from which the map that answers was opened.
    opened: Option<Stamp>,
    /// What was found when the file was looked at last.
    seen: Option<(Outside, Stamp)>,
    /// Why the file could not be opened when it was tried last.
    failure: Option<String>,
}

impl Clerk {
    fn run(&mut self, tasks: &Receiver<Task>) {
        for task in tasks {
            match task {
                Task::Open {
                    source,
                    begins,
                    reply,
                } => self.open(&source, begins, reply),
                Task::Look { source, opens } => self.look(&source, opens),
                Task::Held(map, reply) => answer(Some(reply), in_words(held(&map))),
                Task::Accept(source, ids, reply) => {
                    let done = accept(&source, &ids);
                    self.show(&source, done, reply);
                }
                Task::Drop(source, ids, reply) => {
                    let done = drop_visits(&source.map, &ids);
                    self.show(&source, done, reply);
                }
                Task::Retire(robot) => {
                    if let Err(error) = robot.finish() {
                        let text = format!("what was learnt last is not kept: {error}");
                        self.report(Report::Warning(text));
                    }
                }
            }
        }
    }

    fn open(&mut self, source: &MapSource, begins: bool, reply: Option<Reply>) {
        match open(source) {
            Ok(opened) => self.hand_over(opened, begins, reply),
            Err(error) => {
                // The robot goes on with what it has.
                if reply.is_none() {
                    self.report(Report::Warning(error.to_string()));
                }
                answer(reply, Err(error.to_string()));
            }
        }
    }

    fn hand_over(&mut self, opened: Opened, begins: bool, reply: Option<Reply>) {
        (self.opened, self.failure) = (Some(opened.stamp), None);
        self.mailbox.tell(Command::TakeOver {
            opened,
            begins,
            reply,
        });
    }

    fn look(&mut self, source: &MapSource, opens: bool) {
        let found = match self.found_in(&source.map) {
            Ok(found) => found,
            // Somebody writes to it: it is looked at again.
            Err(error) if error.kind() == ErrorKind::Conflict => return,
            Err(error) => {
                self.report(Report::InFile(InFile::Nothing(error.to_string())));
                return;
            }
        };
        if self.opened == Some(found) {
            self.report(Report::InFile(InFile::Same));
            return;
        }
        self.report(Report::InFile(InFile::Other(found.generation)));
        if !opens {
            return;
        }
        match open(source) {
            Ok(opened) => self.hand_over(opened, false, None),
            // It is tried again and again, and told once.
            Err(error) => {
                let failure = error.to_string();
                if self.failure.as_ref() != Some(&failure) {
                    self.report(Report::Warning(failure.clone()));
                }
                self.failure = Some(failure);
            }
        }
    }

    /// What the file holds now.
    fn found_in(&mut self, map: &Path) -> Result<Stamp> {
        let found = std::fs::metadata(map).map_err(|cause| Error::io(map, cause))?;
        let modified = found.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        let outside = (map.to_owned(), modified, found.len());
        if let Some((_, stamp)) = self.seen.as_ref().filter(|it| it.0 == outside) {
            return Ok(*stamp);
        }
        let stamp = Stamp::read(map)?;
        self.seen = Some((outside, stamp));
        Ok(stamp)
    }

    fn report(&self, report: Report) {
        // Nobody listens any more when the node ends.
        let _ = self.reports.unbounded_send(report);
    }

    /// The robot goes on with the map as it was just changed; where that cannot be opened the change
    /// stands all the same.
    fn show(&mut self, source: &MapSource, done: Result<String>, reply: Reply) {
        let done = done.map(|done| match open(source) {
            Ok(opened) => {
                self.hand_over(opened, false, None);
                done
            }
            Err(error) => {
                self.report(Report::Warning(error.to_string()));
                format!("{done}; the node goes on without, as the map cannot be opened: {error}")
            }
        });
        answer(Some(reply), in_words(done));
    }
}

fn in_words(done: Result<String>) -> std::result::Result<String, String> {
    done.map_err(|error| error.to_string())
}

/// One visit a line, the newest first; as many as an answer has room for.
fn held(map: &Path) -> Result<String> {
    let held = Quarantine::of(&Map::open_read_only(map)?.snapshot())?;
    let mut text = String::new();
    for (number, it) in held.visits().iter().rev().enumerate() {
        let (id, reason) = (it.id.to_string(), &it.reason);
        let id = id.get(..8).unwrap_or(&id);
        let line = format!("{id} {} {} {}: {reason}\n", it.time, it.place, it.source);
        if text.len() + line.len() > MAX_ANSWER_BYTES {
            let num_more = held.visits().len() - number;
            let _ = write!(text, "and {num_more} more: `chronotope map held` lists all");
            break;
        }
        text += &line;
    }
    Ok(text.trim_end().to_owned())
}

fn accept(source: &MapSource, ids: &[String]) -> Result<String> {
    let map = Map::open(&source.map)?;
    let config = Config::read_for(map.snapshot().meta(), source.config.as_deref())?;
    let ids = find(&map, ids, false)?;
    let generation = accept_held(&map, &config.learn, &ids)?;
    Ok(format!(
        "{} visits learnt, generation {generation}",
        ids.len()
    ))
}

fn drop_visits(path: &Path, ids: &[String]) -> Result<String> {
    let map = Map::open(path)?;
    let ids = find(&map, ids, true)?;
    let generation = map.drop_held(&ids)?;
    Ok(format!(
        "{} visits dropped, generation {generation}",
        ids.len()
    ))
}

/// The quarantined visits that are meant.
fn find(map: &Map, names: &[String], with_given_up: bool) -> Result<Vec<VisitId>> {
    let held = Quarantine::of(&map.snapshot())?;
    let known = held.ids(with_given_up);
    if known.is_empty() {
        return Err(Error::new(ErrorKind::NotFound, "no visit is quarantined"));
    }
    if names.is_empty() {
        return Ok(known);
    }
    held.choose(names, with_given_up)
        .map_err(|error| error.with_help("~/list_visits lists the visits"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::Settings;

    #[test]
    fn a_node_without_a_map_says_how_to_name_one() {
        let source = Settings::read(|_| None).source;
        let error = open(&source)
            .err()
            .map_or_else(String::new, |it| it.to_string());
        assert!(error.contains("map:="), "{error}");
    }
}

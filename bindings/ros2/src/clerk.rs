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
use chronotope::map::{Map, MapMeta, Quarantine, VisitId};
use chronotope::robot::{Robot, RobotConfig};
use chronotope_terminal::config::Config;

use futures::channel::mpsc::UnboundedSender;

use crate::engine::{Command, Mailbox, Reply, Report, answer};
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
    /// Look whether the file holds a newer generation than this, and open it or only say so.
    Look {
        source: MapSource,
        generation: u64,
        opens: bool,
    },
    Held(PathBuf, Reply),
    /// Visits by the first digits of their identities; none: all.
    Accept(MapSource, Vec<String>, Reply),
    Drop(MapSource, Vec<String>, Reply),
    Retire(Box<Robot>),
}

/// Starts the thread; it ends with the last sender.
pub(crate) fn start(
    mailbox: Mailbox,
    reports: UnboundedSender<Report>,
) -> Result<(Sender<Task>, JoinHandle<()>)> {
    let (tasks, inbox) = channel();
    let thread = std::thread::Builder::new()
        .name("chronotope-clerk".into())
        .spawn(move || Clerk::new(mailbox, reports).run(&inbox))
        .map_err(|cause| {
            Error::new(ErrorKind::Io, format!("no thread to open maps: {cause}")).with_source(cause)
        })?;
    Ok((tasks, thread))
}

/// Opens a map as the parameters say.
///
/// Fails if none is named or it cannot be opened.
pub(crate) fn open(source: &MapSource) -> Result<Box<Robot>> {
    if source.map.as_os_str().is_empty() {
        return Err(Error::new(ErrorKind::Config, "no map is named")
            .with_place("parameter map")
            .with_help("start it with --ros-args -p map:=site.map, or set the parameter"));
    }
    let config = Config::read_for(&MapMeta::read(&source.map)?, source.config.as_deref())?;
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
    Robot::open(&source.map, cfg).map(Box::new)
}

struct Clerk {
    mailbox: Mailbox,
    reports: UnboundedSender<Report>,
    /// Of the file that was looked at last.
    seen: Option<(PathBuf, SystemTime, u64)>,
}

impl Clerk {
    fn new(mailbox: Mailbox, reports: UnboundedSender<Report>) -> Self {
        Self {
            mailbox,
            reports,
            seen: None,
        }
    }

    fn run(&mut self, tasks: &Receiver<Task>) {
        for task in tasks {
            match task {
                Task::Open {
                    source,
                    begins,
                    reply,
                } => self.open(&source, begins, reply),
                Task::Look {
                    source,
                    generation,
                    opens,
                } => self.look(&source, generation, opens),
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

    fn open(&self, source: &MapSource, begins: bool, reply: Option<Reply>) {
        match open(source) {
            Ok(robot) => self.mailbox.tell(Command::TakeOver {
                robot,
                begins,
                reply,
            }),
            Err(error) => {
                // The robot goes on with what it has.
                if reply.is_none() {
                    self.report(Report::Warning(error.to_string()));
                }
                answer(reply, Err(error.to_string()));
            }
        }
    }

    fn look(&mut self, source: &MapSource, generation: u64, opens: bool) {
        let Ok(found) = std::fs::metadata(&source.map) else {
            return;
        };
        let modified = found.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        let seen = (source.map.clone(), modified, found.len());
        if self.seen.as_ref() == Some(&seen) {
            return;
        }
        // While somebody writes to it, it is looked at again.
        let Ok(map) = Map::open_read_only(&source.map) else {
            return;
        };
        self.seen = Some(seen);
        let newest = map.snapshot().generation();
        if newest > generation {
            self.report(Report::Newer(newest));
            if opens {
                self.open(source, false, None);
            }
        }
    }

    fn report(&self, report: Report) {
        // Nobody listens any more when the node ends.
        let _ = self.reports.unbounded_send(report);
    }

    /// The robot goes on with the map as it was just changed.
    fn show(&self, source: &MapSource, done: Result<String>, reply: Reply) {
        let done = done.and_then(|done| {
            let robot = open(source)?;
            self.mailbox.tell(Command::TakeOver {
                robot,
                begins: false,
                reply: None,
            });
            Ok(done)
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
        let error = open(&source).expect_err("no map").to_string();
        assert!(error.contains("map:="), "{error}");
    }
}

//! Which messages are in this bag?
//!
//! A bag is an MCAP file, a `.db3` file, or the folder that `ros2 bag record` writes: a
//! `metadata.yaml` with the names of the files it was split into, each perhaps packed with zstd. A
//! folder without `metadata.yaml`, which is what a recorder leaves that was killed, is read as all
//! of its files in the order of their names.
//!
//! [`Bag::scan`] goes once through all messages of the topics that are wanted, in the order of the
//! files; [`Bag::read`] fetches one of them again. Neither holds more than a few chunks in memory.
//! What cannot be read is a [`Problem`] and no error, as long as something else can: a bag that
//! was cut off is read up to the cut, a chunk that is damaged is left out.

mod chunk;
mod database;
mod folder;
mod log_file;
mod record;
mod types;
mod unpacked;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use chronotope::dataset::Problem;
use chronotope::error::{Error, ErrorKind, Result};

use self::database::Database;
use self::log_file::LogFile;
use self::types::{Visit, Wanted, changed, file_name};
use self::unpacked::Unpacked;
use crate::message::{CameraInfo, MessageType};

pub use self::types::Topic;
pub(crate) use self::types::{Message, Position};

/// One file of a bag.
#[derive(Debug)]
enum Part {
    Log(LogFile),
    Database(Database),
}

/// A bag that is open.
#[derive(Debug)]
pub struct Bag {
    path: PathBuf,
    parts: Vec<Part>,
    /// Files that were unpacked for it, which go with it.
    unpacked: Vec<Unpacked>,
    /// Files of it that are not there or no bags.
    problems: Vec<Problem>,
}

/// What a bag holds.
#[derive(Clone, Debug, Default)]
pub struct Contents {
    /// How many messages each topic has, as far as they could be read.
    pub topics: BTreeMap<Topic, TopicSummary>,
    /// What the first message of each topic of that kind says of a camera.
    pub cameras: BTreeMap<String, CameraInfo>,
    /// What could not be read.
    pub problems: Vec<Problem>,
}

/// The messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicSummary {
    /// How many.
    pub num_messages: usize,
    /// When the first and the last were written, in nanoseconds since 1970.
    pub logged_ns: (i64, i64),
}

impl Bag {
    /// Opens a file or a folder; of packed files the whole content is unpacked into the folder for
    /// temporary files.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::NotFound`] or [`ErrorKind::Io`] if it cannot be opened, [`ErrorKind::Format`] if
    /// it is no bag.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let listed = folder::list(path)?;
        let mut bag = Self {
            path: path.to_owned(),
            parts: Vec::new(),
            unpacked: Vec::new(),
            problems: listed.problems,
        };
        let is_alone = listed.files.len() == 1;
        for file in listed.files {
            match bag.add(&file, listed.packs_messages) {
                Ok(()) => {}
                Err(error) if is_alone => return Err(error),
                // One file of several: the others count.
                Err(error) => bag.problems.push(Problem::of(file_name(&file), error)),
            }
        }
        if bag.parts.is_empty() {
            return Err(bag.empty(&bag.problems));
        }
        Ok(bag)
    }

    fn add(&mut self, file: &Path, packs_messages: bool) -> Result<()> {
        let mut path = file.to_owned();
        if file.extension().is_some_and(|it| it == "zstd") {
            let (unpacked, problem) = Unpacked::of(file)?;
            unpacked.path().clone_into(&mut path);
            self.problems.extend(problem);
            self.unpacked.push(unpacked);
        }
        let number = self.parts.len() as u32;
        let part = match kind_of(&path).map_err(|error| error.with_path(file))? {
            Kind::Log => Part::Log(LogFile::open(&path, file, number)?),
            Kind::Database => Part::Database(Database::open(&path, file, number, packs_messages)?),
        };
        self.parts.push(part);
        Ok(())
    }

    /// The file or folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it is called: its file's name without the ending.
    pub fn name(&self) -> String {
        let absolute = std::path::absolute(&self.path).unwrap_or_else(|_| self.path.clone());
        let name = if absolute.is_dir() {
            absolute.file_name()
        } else {
            absolute.file_stem()
        };
        name.map_or_else(|| "bag".into(), |name| name.to_string_lossy().into_owned())
    }

    /// Counts the messages of every topic. O(bytes of the bag).
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Format`] if there is not one message.
    pub fn contents(&self) -> Result<Contents> {
        let mut topics: BTreeMap<Topic, TopicSummary> = BTreeMap::new();
        let mut cameras = BTreeMap::new();
        let problems = self.scan(&|_| true, &mut |message| {
            let name = &message.topic.name;
            if message.topic.message_type() == Some(MessageType::CameraInfo)
                && !cameras.contains_key(name)
                && let Ok(camera) = CameraInfo::read(message.data)
            {
                cameras.insert(name.clone(), camera);
            }
            let ns = message.logged.as_ns();
            if let Some(summary) = topics.get_mut(message.topic) {
                summary.num_messages += 1;
                let (first, last) = summary.logged_ns;
                summary.logged_ns = (first.min(ns), last.max(ns));
            } else {
                let summary = TopicSummary {
                    num_messages: 1,
                    logged_ns: (ns, ns),
                };
                topics.insert(message.topic.clone(), summary);
            }
            Ok(())
        })?;
        if topics.is_empty() {
            return Err(self.empty(&problems));
        }
        Ok(Contents {
            topics,
            cameras,
            problems,
        })
    }

    /// Calls `visit` for each message of the topics that are wanted, in the order of the files, and
    /// gives what could not be read.
    pub(crate) fn scan(
        &self,
        is_wanted: &Wanted<'_>,
        visit: &mut Visit<'_>,
    ) -> Result<Vec<Problem>> {
        let mut problems = self.problems.clone();
        for part in &self.parts {
            match part {
                Part::Log(part) => part.scan(is_wanted, visit, &mut problems)?,
                Part::Database(part) => part.scan(is_wanted, visit, &mut problems)?,
            }
        }
        Ok(problems)
    }

    /// The message that [`scan`](Self::scan) found there.
    pub(crate) fn read<T>(
        &self,
        position: Position,
        use_data: impl FnOnce(&[u8]) -> Result<T>,
    ) -> Result<T> {
        match self.parts.get(position.file as usize) {
            Some(Part::Log(part)) => part.read(position, use_data),
            Some(Part::Database(part)) => part.read(position, use_data),
            None => Err(changed(&self.path)),
        }
    }

    /// That there is nothing in it, for the first reason that is known.
    pub(crate) fn empty(&self, problems: &[Problem]) -> Error {
        let error = Error::new(ErrorKind::Format, "the bag has no messages").with_path(&self.path);
        match problems.first() {
            Some(problem) => error.with_help(format!("the first problem: {problem}")),
            None => error.with_help("was anything recorded? `ros2 bag info` counts, too"),
        }
    }
}

/// What a file is by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Log,
    Database,
}

fn kind_of(path: &Path) -> Result<Kind> {
    use std::io::Read;
    let mut begins = Vec::new();
    let file = fremen::file::open(path)?;
    (file.take(16).read_to_end(&mut begins)).map_err(|cause| Error::io(path, cause))?;
    let error = |message: &str, help: &str| {
        Err(Error::new(ErrorKind::Format, message)
            .with_path(path)
            .with_help(help))
    };
    match &begins[..] {
        [] => error("the file is empty", "was anything recorded?"),
        bytes if bytes.starts_with(mcap::MAGIC) => Ok(Kind::Log),
        bytes if bytes.starts_with(b"SQLite format 3\0") => Ok(Kind::Database),
        bytes if bytes.starts_with(b"#ROSBAG V") => error(
            "this is a bag of ROS 1",
            "convert it: pip install rosbags; rosbags-convert --src FILE --dst FOLDER",
        ),
        bytes if mcap::MAGIC.starts_with(bytes) => {
            error("the bag ends inside its first bytes", "record it again")
        }
        bytes if bytes.iter().all(|&byte| byte == 0) => error(
            "the file begins with zeros: nothing of it had reached the disk",
            "record it again",
        ),
        _ => error(
            "this is no bag: neither an MCAP file nor a database of rosbag2",
            "name a .mcap file, a .db3 file or the folder that `ros2 bag record` has written",
        ),
    }
}

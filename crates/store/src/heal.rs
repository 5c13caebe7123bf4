//! What is to be done about a commit that did not end?
//!
//! A killed writer leaves a journal, which `SQLite` would play back into whatever file bears the
//! name: also into a new file, or into a backup that was put in its place. So a file with such a
//! journal is looked at first, without it and with it played in memory, each checked as a whole:
//!
//! | without | played | what is done |
//! |---|---|---|
//! | whole | the same state | `SQLite` plays it |
//! | whole | anything else | the file stays; the journal goes, or aside if it is not of this file |
//! | damaged | whole, one commit before | `SQLite` plays it |
//! | damaged | anything else | an error, and nothing is changed |
//!
//! Where that may not be written, the state that would hold is read from memory. A journal whose
//! writer lives is none of this module's business.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fremen::error::{Error, ErrorKind, Result};

use crate::connection::{Access, BUSY_TIMEOUT, connect, connect_image, is_interrupted};
use crate::fault::Faults;
use crate::header::alone;
use crate::journal::{change_counter, has_journal, holds_first_page, journal_of, played};
use crate::kind::Kind;
use crate::transaction::{Check, Reader};

/// How often to look whether another process has finished healing.
const PAUSE: Duration = Duration::from_millis(20);
/// Names that are tried for a journal that is put aside.
const MAX_ASIDE: u32 = 1_000;

/// How a file can be read now.
pub(crate) enum Settled {
    /// As it is; its journal, if there is one, is that of a living writer.
    File,
    /// From memory: its folder may not be written.
    Image(Vec<u8>),
}

/// Which state a file is in: number and digest of its newest generation.
type Standing = (u64, [u8; 32]);

/// Heals the file of an interrupted commit, if there was one.
pub(crate) fn settle(kind: &'static Kind, path: &Path, check: Check) -> Result<Settled> {
    if !has_journal(path) || !is_interrupted(kind, path)? {
        return Ok(Settled::File);
    }
    let _alone = alone();
    let _healing = lock(kind, path)?;
    // Another process may have healed it meanwhile.
    if !has_journal(path) || !is_interrupted(kind, path)? {
        return Ok(Settled::File);
    }
    let journal_path = journal_of(path);
    let file = fremen::file::read(path, u64::MAX)?;
    let journal = fremen::file::read(&journal_path, u64::MAX)?;
    let image = played(&file, &journal);
    // A journal without the first page does not say how often its file was committed to.
    let says_which = holds_first_page(&journal);
    let is_one_before = image.as_deref().is_some_and(|image| {
        let (before, now) = (change_counter(image), change_counter(&file));
        now == before || now == before.map(|it| it.wrapping_add(1))
    });
    let as_it_is = standing(kind, &file, check);
    let once_played = (image.as_deref()).map(|image| standing(kind, image, check));
    match (as_it_is, once_played, image) {
        (Ok(now), Some(Ok(then)), Some(image)) if now == then => Ok(play(kind, path, image)),
        (Ok(_), ..) if is_one_before && says_which => Ok(drop_journal(path, &journal_path, file)),
        (Ok(_), ..) => Ok(put_aside(kind, path, &journal_path, file)),
        (Err(_), Some(Ok(_)), Some(image)) if is_one_before => Ok(play(kind, path, image)),
        (Err(cause), ..) => Err(Error::new(
            ErrorKind::Format,
            format!(
                "the last commit was interrupted, and the {} is whole neither with the journal \
                 `{}` nor without: {cause}",
                kind.noun,
                journal_path.display()
            ),
        )
        .with_help("restore a copy; a journal of another file has to be moved away first")),
    }
}

/// Puts a journal aside that lies where a new file is to be made, and says so.
pub(crate) fn clear_the_way(kind: &Kind, path: &Path) -> Result<()> {
    let journal = journal_of(path);
    if std::fs::symlink_metadata(&journal).is_err() {
        return Ok(());
    }
    let aside = move_aside(path, &journal).map_err(|cause| {
        Error::io(&journal, cause).with_help(format!(
            "it is the journal of a {} that is gone: move it away",
            kind.noun
        ))
    })?;
    tracing::warn!(
        "the journal of a {} that is gone lay beside {}; it is now {}",
        kind.noun,
        path.display(),
        aside.display()
    );
    Ok(())
}

/// Keeps other processes from healing the file at the same time.
fn lock(kind: &Kind, path: &Path) -> Result<File> {
    let file = fremen::file::open(path)?;
    let begun = Instant::now();
    loop {
        match file.try_lock() {
            // A file system without locks: `SQLite` could not keep anybody out there, either.
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(file),
            Err(TryLockError::WouldBlock) if begun.elapsed() < BUSY_TIMEOUT => {
                std::thread::sleep(PAUSE);
            }
            Err(TryLockError::WouldBlock) => {
                let message = format!("another process is healing this {}", kind.noun);
                return Err(Error::new(ErrorKind::Conflict, message)
                    .with_help("wait until it has finished and repeat"));
            }
        }
    }
}

/// The state that these bytes are in, if they are a whole file.
fn standing(kind: &'static Kind, image: &[u8], check: Check) -> Result<Standing> {
    let connection = connect_image(kind, image)?;
    let reader = Reader::new(&connection, kind)?;
    let strict = &mut Faults::strict(kind);
    reader.check_schema(strict)?;
    reader.check_structure("integrity_check", strict)?;
    check(&reader)?;
    let generations = reader.generations(None, strict)?;
    let newest = generations.last().ok_or_else(|| kind.no_generations())?;
    Ok((newest.number, newest.digest))
}

/// Lets `SQLite` undo the commit; where it may not, `image` is what it would have made.
fn play(kind: &Kind, path: &Path, image: Vec<u8>) -> Settled {
    let played = connect(kind, path, Access::ReadWrite).is_ok_and(|connection| {
        let looked = connection.query_row("SELECT count(*) FROM sqlite_schema", [], |_| Ok(()));
        looked.is_ok()
    });
    if played && !has_journal(path) {
        Settled::File
    } else {
        Settled::Image(image)
    }
}

/// Removes the journal of a commit that is whole in the file; where that may not be, the file is
/// read as it is.
fn drop_journal(path: &Path, journal: &Path, file: Vec<u8>) -> Settled {
    let synced = File::open(path).and_then(|file| file.sync_all());
    if synced.and_then(|()| std::fs::remove_file(journal)).is_err() {
        return Settled::Image(file);
    }
    fremen::file::sync_folder_of(path);
    Settled::File
}

/// Gives the journal of another file a name under which nobody plays it, and says so.
fn put_aside(kind: &Kind, path: &Path, journal: &Path, file: Vec<u8>) -> Settled {
    match move_aside(path, journal) {
        Ok(aside) => {
            tracing::warn!(
                "the journal beside {} is of another {}: it is now {}",
                path.display(),
                kind.noun,
                aside.display()
            );
            Settled::File
        }
        Err(_) => Settled::Image(file),
    }
}

/// `FILE.stray-journal`, or with a number where that is taken.
fn move_aside(path: &Path, journal: &Path) -> std::io::Result<PathBuf> {
    for number in 1..MAX_ASIDE {
        let mut name = path.as_os_str().to_owned();
        match number {
            1 => name.push(".stray-journal"),
            _ => name.push(format!(".stray-journal{number}")),
        }
        match fremen::file::rename_new(journal, Path::new(&name)) {
            Ok(()) => {
                fremen::file::sync_folder_of(path);
                return Ok(name.into());
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(std::io::Error::other(error)),
        }
    }
    Err(std::io::ErrorKind::AlreadyExists.into())
}

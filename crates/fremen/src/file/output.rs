//! How is a file written, so that it is whole or not there and nothing else is lost?
//!
//! An [`OutputFile`] is written beside its place under a name of its own
//! (`.NAME.unfinished`), synchronised, and renamed once it is whole. What a killed process left
//! under that name is taken over by the next one that writes the same file; two that run at once
//! exclude each other by a lock ([`Unfinished`] is such a name for other libraries to write to). A
//! file that is there is replaced only if it is an earlier output
//! of the same kind; never through a link, never a device, never one of the inputs.

use std::fs::{File, Metadata};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use super::input::unblocked;
use crate::error::{Error, ErrorKind, Result};

/// How often a name is tried again that another process has just taken or given up.
pub(super) const MAX_ATTEMPTS: usize = 16;

/// What an output is, and how an earlier one is recognised.
#[derive(Clone, Copy, Debug)]
pub struct OutputKind {
    /// In words, with its article: `a trace`.
    pub noun: &'static str,
    /// How every such file begins.
    pub begins: &'static [u8],
}

/// What may be there already.
enum Earlier {
    /// Nothing at all.
    Nothing,
    /// An output of the same kind, or an empty file; none of the inputs.
    Same,
}

/// A file that is being written. Dropped before it is finished, it leaves nothing behind.
#[derive(Debug)]
pub struct OutputFile {
    path: PathBuf,
    /// The name that it has until it is finished; none once it has its own.
    unfinished: Option<PathBuf>,
    /// Whether a file that is there then is replaced.
    replaces: bool,
    writer: BufWriter<File>,
}

/// A name under which another library writes a new file until it is whole. Dropped before it is
/// finished, it leaves nothing behind.
#[derive(Debug)]
pub struct Unfinished {
    /// The name that it will have.
    to: PathBuf,
    path: PathBuf,
    is_finished: bool,
    /// Keeps other processes away.
    _lock: File,
}

impl Unfinished {
    /// An empty file that is to be the one at `path`, where nothing is yet.
    ///
    /// Fails with [`ErrorKind::AlreadyExists`] if something is there.
    pub fn begin(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        check_is_nothing(path)?;
        let unfinished = unfinished_name(path)?;
        let lock = claim(&unfinished).map_err(|error| error.with_path(path))?;
        lock.set_len(0).map_err(|cause| Error::io(path, cause))?;
        remove_journal_of(&unfinished);
        Ok(Self {
            to: path.to_owned(),
            path: unfinished,
            is_finished: false,
            _lock: lock,
        })
    }

    /// The name that it has until then.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name; fails with [`ErrorKind::AlreadyExists`] if another has it now.
    pub fn finish(mut self) -> Result<()> {
        rename_new(&self.path, &self.to)?;
        self.is_finished = true;
        sync_folder_of(&self.to);
        Ok(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if !self.is_finished {
            // Somebody may have removed it; there is nobody to tell.
            let _ = std::fs::remove_file(&self.path);
            remove_journal_of(&self.path);
        }
    }
}

/// What a database leaves beside an unfinished file.
fn remove_journal_of(unfinished: &Path) {
    let mut journal = unfinished.as_os_str().to_owned();
    journal.push("-journal");
    // Mostly there is none.
    let _ = std::fs::remove_file(journal);
}

impl OutputFile {
    /// Begins a file at a path where nothing is yet.
    ///
    /// Fails with [`ErrorKind::AlreadyExists`] if something is there, now or when it is finished.
    pub fn begin_new(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        check_is_nothing(path)?;
        Self::begin(path, &Earlier::Nothing)
    }

    /// Begins a file that replaces an earlier output of the same kind, if there is one.
    ///
    /// Fails with [`ErrorKind::AlreadyExists`] if anything else is there, and with
    /// [`ErrorKind::Config`] if it is one of `inputs`.
    pub fn replace(path: impl AsRef<Path>, kind: OutputKind, inputs: &[&Path]) -> Result<Self> {
        let path = path.as_ref();
        check_is_earlier_output(path, kind, inputs)?;
        Self::begin(path, &Earlier::Same)
    }

    fn begin(path: &Path, earlier: &Earlier) -> Result<Self> {
        let unfinished = unfinished_name(path)?;
        let file = claim(&unfinished).map_err(|error| error.with_path(path))?;
        let output = Self {
            path: path.to_owned(),
            unfinished: Some(unfinished),
            replaces: matches!(earlier, Earlier::Same),
            writer: BufWriter::new(file),
        };
        // What a killed process has left.
        let file = output.writer.get_ref();
        file.set_len(0).map_err(|cause| Error::io(path, cause))?;
        if let Ok(before) = std::fs::metadata(path) {
            copy_rights(&before, file);
        }
        Ok(output)
    }

    /// Where it will be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives it the rights of another file and, where the system allows that, its owner.
    #[must_use]
    pub fn with_rights_of(self, other: &Path) -> Self {
        if let Ok(metadata) = std::fs::metadata(other) {
            copy_rights(&metadata, self.writer.get_ref());
        }
        self
    }

    /// Gives the file its name at once: what is written to it can be followed, and what a killed
    /// process has written of it stays.
    pub fn publish(&mut self) -> Result<()> {
        let Some(unfinished) = self.unfinished.take() else {
            return Ok(());
        };
        let renamed = if self.replaces {
            let renamed = std::fs::rename(&unfinished, &self.path);
            renamed.map_err(|cause| Error::io(&self.path, cause))
        } else {
            rename_new(&unfinished, &self.path)
        };
        if renamed.is_err() {
            // It is ours; that it cannot be removed matters less than why.
            let _ = std::fs::remove_file(&unfinished);
        }
        renamed
    }

    /// Everything is on the disk and has its name once this returns.
    pub fn finish(mut self) -> Result<()> {
        let io = |path: &Path, cause| Error::io(path, cause);
        (self.writer.flush()).map_err(|cause| io(&self.path, cause))?;
        (self.writer.get_ref().sync_all()).map_err(|cause| io(&self.path, cause))?;
        self.publish()?;
        sync_folder_of(&self.path);
        Ok(())
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

impl Seek for OutputFile {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.writer.seek(to)
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        if let Some(unfinished) = &self.unfinished {
            // Somebody may have removed it; there is nobody to tell.
            let _ = std::fs::remove_file(unfinished);
        }
    }
}

/// Gives a file a name that no other file has; an error of kind [`ErrorKind::AlreadyExists`] if
/// one has it, however late it came.
pub fn rename_new(from: &Path, to: &Path) -> Result<()> {
    let failed = |cause: io::Error| {
        let error = Error::io(to, cause);
        match error.kind() {
            ErrorKind::AlreadyExists => already_there(to),
            _ => error,
        }
    };
    #[cfg(any(target_os = "linux", target_os = "android", target_vendor = "apple"))]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        use rustix::io::Errno;
        match renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
            Ok(()) => return Ok(()),
            // This file system or kernel cannot.
            Err(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP) => {}
            Err(cause) => return Err(failed(cause.into())),
        }
    }
    match std::fs::hard_link(from, to) {
        Ok(()) => std::fs::remove_file(from).map_err(failed),
        Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists => Err(failed(cause)),
        // A file system without links: what comes between these two steps is lost.
        Err(_) => {
            check_is_nothing(to)?;
            std::fs::rename(from, to).map_err(failed)
        }
    }
}

/// Makes the names in the folder of `path` survive a power loss; where folders cannot be synced,
/// nothing is lost either.
pub fn sync_folder_of(path: &Path) {
    let folder = match path.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => return,
    };
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
}

/// An error if anything bears this name.
fn check_is_nothing(path: &Path) -> Result<()> {
    match std::fs::symlink_metadata(path) {
        Ok(_) => Err(already_there(path)),
        Err(_) => Ok(()),
    }
}

fn already_there(path: &Path) -> Error {
    Error::new(ErrorKind::AlreadyExists, "this file exists already")
        .with_path(path)
        .with_help("it is never overwritten: choose another name or remove it")
}

fn check_is_earlier_output(path: &Path, kind: OutputKind, inputs: &[&Path]) -> Result<()> {
    let Ok(there) = std::fs::symlink_metadata(path) else {
        return Ok(());
    };
    let refused = |kind, message: &str| {
        Error::new(kind, message)
            .with_path(path)
            .with_help("it is never overwritten: choose another name")
    };
    if there.is_symlink() {
        let message = "this is a link, and nothing is written through one";
        return Err(refused(ErrorKind::AlreadyExists, message));
    }
    if !there.is_file() {
        let message = "this is a folder, a pipe or a device, and only files are written";
        return Err(refused(ErrorKind::AlreadyExists, message));
    }
    if (inputs.iter()).any(|input| is_same(&there, input)) {
        let message = "this is an input of the same command";
        return Err(refused(ErrorKind::Config, message));
    }
    let mut begins = Vec::new();
    io::Read::read_to_end(
        &mut io::Read::take(super::open(path)?, kind.begins.len() as u64),
        &mut begins,
    )
    .map_err(|cause| Error::io(path, cause))?;
    // An empty file has nothing to lose.
    if begins.is_empty() || begins == kind.begins {
        return Ok(());
    }
    let message = format!("the file that is there is not {}", kind.noun);
    Err(refused(ErrorKind::AlreadyExists, &message))
}

/// Whether a file is the one at `path`, by whatever name.
pub(super) fn is_same(file: &Metadata, path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|other| identity(file) == identity(&other))
}

/// What no two files have in common at one time.
#[cfg(unix)]
fn identity(file: &Metadata) -> (u64, u64) {
    use std::os::unix::fs::MetadataExt;
    (file.dev(), file.ino())
}

/// What two files seldom have in common: this system's library does not say more.
#[cfg(not(unix))]
fn identity(file: &Metadata) -> (u64, Option<std::time::SystemTime>) {
    (file.len(), file.modified().ok())
}

/// `.NAME.unfinished`, beside the file.
pub(super) fn unfinished_name(path: &Path) -> Result<PathBuf> {
    let Some(name) = path.file_name() else {
        let error = Error::new(ErrorKind::Config, "this is no name of a file or a folder");
        return Err(error.with_path(path));
    };
    let mut unfinished = std::ffi::OsString::from(".");
    unfinished.push(name);
    unfinished.push(".unfinished");
    Ok(path.with_file_name(unfinished))
}

/// Opens a file that only this process writes, from now until it is closed.
fn claim(path: &Path) -> Result<File> {
    let io = |cause: io::Error| {
        let help = match cause.kind() {
            io::ErrorKind::NotFound => "create the folder first",
            _ => "choose a folder that may be written",
        };
        Error::new(Error::io(path, cause).kind(), "cannot be written").with_help(help)
    };
    for _ in 0..MAX_ATTEMPTS {
        if std::fs::symlink_metadata(path).is_ok_and(|it| !it.is_file()) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("`{}` is in the way", path.display()),
            )
            .with_help("remove it"));
        }
        let file = (unblocked().read(true).write(true).create(true))
            .open(path)
            .map_err(io)?;
        match file.try_lock() {
            // A file system without locks: nobody is kept out.
            Ok(()) | Err(std::fs::TryLockError::Error(_)) => {}
            Err(std::fs::TryLockError::WouldBlock) => {
                return Err(being_written("file"));
            }
        }
        // Before it was locked, another process may have finished or removed it.
        if is_same(&file.metadata().map_err(io)?, path) {
            return Ok(file);
        }
    }
    let message = "other processes are writing this file all the time";
    Err(Error::new(ErrorKind::Conflict, message).with_help("repeat later"))
}

/// The error where another process holds the lock.
pub(super) fn being_written(what: &str) -> Error {
    let message = format!("another process is writing this {what}");
    Error::new(ErrorKind::Conflict, message).with_help("wait until it has finished and repeat")
}

/// Gives a file the rights of another, as far as they are not execution, and its owner if that is
/// allowed.
#[cfg(unix)]
fn copy_rights(from: &Metadata, to: &File) {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    let mode = from.mode() & 0o666;
    // The owner first: changing that may take rights away. Only root may give files away.
    let (owner, group) = (
        rustix::fs::Uid::from_raw(from.uid()),
        rustix::fs::Gid::from_raw(from.gid()),
    );
    let _ = rustix::fs::fchown(to, Some(owner), Some(group));
    let _ = to.set_permissions(std::fs::Permissions::from_mode(mode));
}

#[cfg(not(unix))]
fn copy_rights(_: &Metadata, _: &File) {}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const NOTE: OutputKind = OutputKind {
        noun: "a note",
        begins: b"note",
    };

    /// What is in a folder, in order.
    pub(in crate::file) fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = (std::fs::read_dir(folder).expect("a folder"))
            .map(|it| {
                it.expect("there")
                    .file_name()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        names.sort();
        names
    }

    fn note(path: &Path, text: &str) -> Result<()> {
        let mut file = OutputFile::replace(path, NOTE, &[])?;
        file.write_all(text.as_bytes()).expect("a disk");
        file.finish()
    }

    #[test]
    fn only_an_earlier_output_of_its_kind_is_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        note(&path, "note 1").expect("new");
        note(&path, "note 2").expect("replaced");
        assert_eq!(std::fs::read(&path).expect("there"), b"note 2");
        std::fs::write(&path, "").expect("written");
        note(&path, "note 3").expect("nothing to lose");
        for other in ["not", "a map"] {
            std::fs::write(&path, other).expect("written");
            let error = note(&path, "note 4").expect_err("something else");
            assert!(error.to_string().contains("is not a note"), "{error}");
            assert_eq!(std::fs::read(&path).expect("there"), other.as_bytes());
        }
        std::fs::write(&path, "note 5").expect("written");
        let error = OutputFile::replace(&path, NOTE, &[&path]).expect_err("an input");
        assert_eq!(error.kind(), ErrorKind::Config);
        assert_eq!(names(folder.path()), ["a"]);
        let (link, other) = (folder.path().join("b"), folder.path().join("c"));
        std::fs::hard_link(&path, &link).expect("a link");
        std::fs::write(&other, "note 6").expect("written");
        OutputFile::replace(&path, NOTE, &[&other]).expect("another file is the input");
        let error = OutputFile::replace(&path, NOTE, &[&other, &link]).expect_err("an input");
        assert_eq!(error.kind(), ErrorKind::Config);
        let nowhere = folder.path().join("none/a");
        let error = OutputFile::begin_new(nowhere).expect_err("no folder");
        assert_eq!(error.kind(), ErrorKind::NotFound);
        assert!(error.to_string().contains("create the folder"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_written_through_links_or_into_devices() {
        let folder = tempfile::tempdir().expect("a folder");
        let (link, target) = (folder.path().join("link"), folder.path().join("target"));
        std::os::unix::fs::symlink(&target, &link).expect("a link");
        assert!(note(&link, "note").is_err());
        assert!(OutputFile::begin_new(&link).is_err());
        std::fs::write(&target, "note").expect("written");
        assert!(note(&link, "note of another").is_err());
        assert_eq!(std::fs::read(&target).expect("there"), b"note");
        assert!(note(Path::new("/dev/null"), "note").is_err());
        // Nor through a link that waits where the file is written first.
        std::os::unix::fs::symlink(&target, folder.path().join(".b.unfinished")).expect("a link");
        assert!(note(&folder.path().join("b"), "note of another").is_err());
        assert_eq!(std::fs::read(&target).expect("there"), b"note");
    }

    #[test]
    fn what_a_killed_process_left_is_taken_over_and_a_living_one_is_not_disturbed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        std::fs::write(folder.path().join(".a.unfinished"), "a long rest of old").expect("written");
        note(&path, "note").expect("taken over");
        assert_eq!(std::fs::read(&path).expect("there"), b"note");
        assert_eq!(names(folder.path()), ["a"]);
        let living = OutputFile::replace(&path, NOTE, &[]).expect("begun");
        let error = note(&path, "note 2").expect_err("two at once");
        assert_eq!(error.kind(), ErrorKind::Conflict);
        drop(living);
        assert_eq!(names(folder.path()), ["a"]);
        note(&path, "note 2").expect("alone again");
    }

    #[test]
    fn a_file_that_appears_meanwhile_is_not_overwritten() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        let file = OutputFile::begin_new(&path).expect("begun");
        std::fs::write(&path, "another").expect("written");
        let error = file.finish().expect_err("it is there now");
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
        assert!(error.to_string().contains("never overwritten"), "{error}");
        assert_eq!(std::fs::read(&path).expect("there"), b"another");
        assert_eq!(names(folder.path()), ["a"]);
        assert!(OutputFile::begin_new(&path).is_err());
    }

    /// The same where another library writes the file.
    #[test]
    fn a_name_for_another_library_is_taken_by_nobody_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        let journal = folder.path().join(".a.unfinished-journal");
        for rest in [folder.path().join(".a.unfinished"), journal.clone()] {
            std::fs::write(rest, "of a killed process").expect("written");
        }
        let unfinished = Unfinished::begin(&path).expect("begun");
        assert_eq!(names(folder.path()), [".a.unfinished"]);
        assert_eq!(std::fs::read(unfinished.path()).expect("there"), b"");
        let error = Unfinished::begin(&path).expect_err("two at once");
        assert_eq!(error.kind(), ErrorKind::Conflict);
        std::fs::write(&path, "another").expect("written");
        std::fs::write(&journal, "begun").expect("written");
        let error = unfinished.finish().expect_err("it is there now");
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(&path).expect("there"), b"another");
        assert_eq!(names(folder.path()), ["a"]);
        let error = Unfinished::begin(&path).expect_err("it is there");
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);

        std::fs::remove_file(&path).expect("there");
        let unfinished = Unfinished::begin(&path).expect("begun");
        std::fs::write(unfinished.path(), "ours").expect("written");
        unfinished.finish().expect("nothing came");
        assert_eq!(std::fs::read(&path).expect("there"), b"ours");
        assert_eq!(names(folder.path()), ["a"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_file_takes_the_rights_of_another() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        let secret = folder.path().join("secret");
        std::fs::write(&secret, "").expect("written");
        std::fs::set_permissions(&secret, std::fs::Permissions::from_mode(0o600)).expect("mine");
        let path = folder.path().join("a");
        let file = OutputFile::begin_new(&path).expect("begun");
        file.with_rights_of(&secret).finish().expect("a disk");
        let mode = std::fs::metadata(&path)
            .expect("there")
            .permissions()
            .mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[test]
    fn what_comes_first_can_be_written_last() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        let mut file = OutputFile::begin_new(&path).expect("begun");
        file.write_all(b"____ 1").expect("a disk");
        assert_eq!(file.seek(io::SeekFrom::Start(0)).expect("a disk"), 0);
        file.write_all(b"note").expect("a disk");
        assert_eq!(file.seek(io::SeekFrom::End(0)).expect("a disk"), 6);
        file.finish().expect("nothing came");
        assert_eq!(std::fs::read(&path).expect("there"), b"note 1");
    }

    #[test]
    fn a_published_file_has_its_name_at_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        let mut file = OutputFile::replace(&path, NOTE, &[]).expect("begun");
        file.publish().expect("a disk");
        file.write_all(b"note").expect("a disk");
        file.flush().expect("a disk");
        assert_eq!(std::fs::read(&path).expect("there"), b"note");
        drop(file);
        assert_eq!(names(folder.path()), ["a"]);
    }
}

//! How is a file from outside opened, so that nothing hangs and nothing floods the memory?
//!
//! Only regular files are opened: a pipe without a writer would wait for ever, and some devices do
//! something when they are opened. Whoever reads a file as a whole says how large one of its kind
//! may be.

use std::fs::{File, Metadata, OpenOptions};
use std::io::Read;
use std::path::Path;

use crate::error::{Error, ErrorKind, Result};

/// Opens a regular file to be read, and never waits for anybody.
///
/// Links are followed. Fails with [`ErrorKind::Format`] on a folder, a pipe or a device.
pub fn open(path: impl AsRef<Path>) -> Result<File> {
    let path = path.as_ref();
    let io = |cause| Error::io(path, cause);
    // Looked at twice: before it is opened, because that alone may do something; and once open,
    // because another file may have come to bear the name.
    check_is_regular(path, &std::fs::metadata(path).map_err(io)?)?;
    let file = unblocked().read(true).open(path).map_err(io)?;
    check_is_regular(path, &file.metadata().map_err(io)?)?;
    Ok(file)
}

/// Opens a regular file that was derived from the file at `origin` and lies beside it, if nobody
/// can have made it who could not have made that one.
///
/// Fails with [`ErrorKind::Io`] where the system says who may write files, and the owner is neither
/// that of `origin` nor this process's nor root, or others may write it, or read it but not
/// `origin`, or it has other names.
pub fn open_beside(path: impl AsRef<Path>, origin: &Path) -> Result<File> {
    let path = path.as_ref();
    let file = open(path)?;
    let io = |path: &Path, cause| Error::io(path, cause);
    let found = file.metadata().map_err(|cause| io(path, cause))?;
    let origin = std::fs::metadata(origin).map_err(|cause| io(origin, cause))?;
    let link = std::fs::symlink_metadata(path).map_err(|cause| io(path, cause))?;
    if !link.is_symlink() && has_rights_of(&found, &origin) {
        return Ok(file);
    }
    let message = "somebody else may have made this file: it has not the owner and the rights of \
                   the file that it was made of";
    Err(Error::new(ErrorKind::Io, message)
        .with_path(path)
        .with_help("remove it"))
}

#[cfg(unix)]
fn has_rights_of(found: &Metadata, origin: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    let owners = [origin.uid(), rustix::process::geteuid().as_raw(), 0];
    let more_than_origin = found.mode() & !origin.mode() & 0o666;
    owners.contains(&found.uid()) && more_than_origin & 0o066 == 0 && found.nlink() == 1
}

#[cfg(not(unix))]
fn has_rights_of(_: &Metadata, _: &Metadata) -> bool {
    true
}

/// Device and number of the file that bears a name now: those of no other file as long as this one is open. `None`
/// where no file bears it, and where the system's library does not say.
pub fn number_at(path: impl AsRef<Path>) -> Result<Option<(u64, u64)>> {
    let path = path.as_ref();
    match std::fs::metadata(path) {
        #[cfg(unix)]
        Ok(found) => {
            use std::os::unix::fs::MetadataExt;
            Ok(Some((found.dev(), found.ino())))
        }
        #[cfg(not(unix))]
        Ok(_) => Ok(None),
        Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(cause) => Err(Error::io(path, cause)),
    }
}

/// The bytes of a regular file that has at most `max_bytes`.
pub fn read(path: impl AsRef<Path>, max_bytes: u64) -> Result<Vec<u8>> {
    let path = path.as_ref();
    let io = |cause| Error::io(path, cause);
    let file = open(path)?;
    let found = file.metadata().map_err(io)?.len();
    let too_large = |found: u64| {
        let message = format!("the file has {found} bytes, where at most {max_bytes} are read");
        Error::new(ErrorKind::Format, message)
            .with_path(path)
            .with_help("give a smaller file")
    };
    if found > max_bytes {
        return Err(too_large(found));
    }
    let mut bytes = Vec::new();
    (bytes.try_reserve_exact(found as usize)).map_err(|_| {
        let message = format!("no memory for the {found} bytes of the file");
        Error::new(ErrorKind::Io, message).with_path(path)
    })?;
    // It may have grown since, or not say its size (those of /proc say 0).
    (file
        .take(max_bytes.saturating_add(1))
        .read_to_end(&mut bytes))
    .map_err(io)?;
    if bytes.len() as u64 > max_bytes {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

/// The text of a regular file of UTF-8 that has at most `max_bytes`, without the byte order mark
/// that some editors put before it.
pub fn read_text(path: impl AsRef<Path>, max_bytes: u64) -> Result<String> {
    let path = path.as_ref();
    let text = String::from_utf8(read(path, max_bytes)?).map_err(|cause| {
        let at = cause.utf8_error().valid_up_to();
        Error::new(ErrorKind::Format, "this is no text in UTF-8")
            .with_path(path)
            .with_place(format!("byte {at}"))
            .with_help("save the file as UTF-8, not packed")
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

/// How a file is opened where that must not wait for whoever holds the other end of a pipe.
pub(super) fn unblocked() -> OpenOptions {
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOCTTY;
        options.custom_flags(flags.bits() as i32);
    }
    options
}

fn check_is_regular(path: &Path, metadata: &Metadata) -> Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let (message, help) = if metadata.is_dir() {
        ("this is a folder, not a file", "name a file in it")
    } else {
        (
            "this is a pipe or a device, not a file",
            "write it to a file first",
        )
    };
    let error = Error::new(ErrorKind::Format, message);
    Err(error.with_path(path).with_help(help))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    fn pipe_in(folder: &Path, name: &str) -> std::path::PathBuf {
        let pipe = folder.join(name);
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.expect("mkfifo").success());
        pipe
    }

    #[test]
    fn a_file_is_read_up_to_its_limit_and_nothing_else_is_opened() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("file");
        std::fs::write(&path, "text").expect("written");
        assert_eq!(read(&path, 4).expect("small enough"), b"text");
        let error = read(&path, 3).expect_err("too large");
        assert!(error.to_string().contains("at most 3"), "{error}");
        let missing = read(folder.path().join("none"), 9).expect_err("missing");
        assert_eq!(missing.kind(), ErrorKind::NotFound);
        assert!(open(folder.path()).is_err());
        std::fs::write(&path, [b'a', 0xff]).expect("written");
        let error = read_text(&path, 9).expect_err("no text");
        assert_eq!(error.place(), Some("byte 1"));
        std::fs::write(&path, "\u{feff}a").expect("written");
        assert_eq!(read_text(&path, 9).expect("text"), "a");
    }

    #[cfg(unix)]
    #[test]
    fn neither_a_pipe_nor_a_device_is_opened() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = pipe_in(folder.path(), "pipe");
        for path in [&*pipe, Path::new("/dev/zero")] {
            let error = read(path, 9).expect_err("no file");
            assert!(error.to_string().contains("pipe or a device"), "{error}");
        }
    }

    /// Somebody who waits to write to a pipe would take that for a reader.
    #[cfg(unix)]
    #[test]
    fn a_pipe_is_not_even_opened() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = pipe_in(folder.path(), "pipe");
        let writer = std::thread::spawn({
            let pipe = pipe.clone();
            move || OpenOptions::new().write(true).open(pipe)
        });
        let pause = || std::thread::sleep(std::time::Duration::from_millis(50));
        pause();
        read(&pipe, 9).expect_err("no file");
        pause();
        assert!(!writer.is_finished(), "the pipe was opened");
        let _reader = unblocked().read(true).open(&pipe).expect("there");
        writer.join().expect("no panic").expect("somebody reads");
        // Were one to come between looking and opening, nobody would wait for its other end.
        let (opened, is_open) = std::sync::mpsc::channel();
        let lonely = pipe_in(folder.path(), "lonely");
        std::thread::spawn(move || opened.send(unblocked().read(true).open(lonely).is_ok()));
        let patience = std::time::Duration::from_secs(20);
        assert_eq!(is_open.recv_timeout(patience), Ok(true));
    }

    #[cfg(unix)]
    #[test]
    fn a_file_beside_another_is_opened_only_with_its_rights() {
        use std::os::unix::fs::{PermissionsExt, chown, symlink};
        let folder = tempfile::tempdir().expect("a folder");
        let [origin, path, other] = ["a", "a.derived", "b"].map(|name| folder.path().join(name));
        let write = |path: &Path, mode: u32| {
            std::fs::write(path, "text").expect("written");
            let rights = std::fs::Permissions::from_mode(mode);
            std::fs::set_permissions(path, rights).expect("ours");
        };
        for (of_origin, mode, opens) in [
            (0o600, 0o600, true),
            (0o644, 0o644, true),
            (0o644, 0o600, true),
            (0o600, 0o700, true),
            (0o400, 0o600, true),
            (0o664, 0o664, true),
            (0o600, 0o640, false),
            (0o600, 0o604, false),
            (0o644, 0o664, false),
            (0o644, 0o646, false),
            (0o640, 0o644, false),
        ] {
            write(&origin, of_origin);
            write(&path, mode);
            let opened = open_beside(&path, &origin);
            assert_eq!(opened.is_ok(), opens, "{mode:o} beside {of_origin:o}");
        }
        write(&origin, 0o644);
        write(&path, 0o644);
        std::fs::hard_link(&path, &other).expect("a link");
        let error = open_beside(&path, &origin).expect_err("it has another name");
        assert!(error.to_string().contains("somebody else"), "{error}");
        std::fs::remove_file(&path).expect("ours");
        symlink(&other, &path).expect("a link");
        open_beside(&path, &origin).expect_err("a link");
        std::fs::remove_file(&path).expect("ours");
        // Only root can give files away, and only to root are they ours then.
        write(&path, 0o644);
        if chown(&path, Some(12_345), None).is_ok() {
            open_beside(&path, &origin).expect_err("somebody else's");
            chown(&origin, Some(12_345), None).expect("root");
            open_beside(&path, &origin).expect("the same owner's");
        }
    }
}

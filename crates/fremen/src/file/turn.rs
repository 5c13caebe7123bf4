//! Whose turn is it to change what lies in a folder?
//!
//! Writers of one file that commit whenever they are ready find, one time in a few, that another
//! was faster, and make their change again. One whose change takes long would never be fast enough.
//! So whoever makes a change again takes a [`Turn`] first and keeps it until the change is written,
//! and everybody else waits for it before writing.
//!
//! A turn is an advisory lock on the folder: nothing is left behind, and it ends with its process,
//! however that ends. It guards nothing: where a folder cannot be locked, or a turn takes longer
//! than somebody is willing to wait, writing is as safe without.

use std::fs::{File, TryLockError};
use std::path::Path;
use std::time::{Duration, Instant};

/// How often is looked whether a turn has ended.
const POLL: Duration = Duration::from_millis(1);

/// A turn; it ends when this is dropped.
#[derive(Debug)]
pub struct Turn {
    _folder: Option<File>,
}

impl Turn {
    /// Waits for the turns of others in the folder of `path`, for at most so long.
    pub fn wait(path: &Path, at_most: Duration) -> Self {
        let begun = Instant::now();
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let Ok(folder) = File::open(folder) else {
            return Self { _folder: None };
        };
        loop {
            match folder.try_lock() {
                Ok(()) => {
                    return Self {
                        _folder: Some(folder),
                    };
                }
                Err(TryLockError::WouldBlock) if begun.elapsed() < at_most => {
                    std::thread::sleep(POLL);
                }
                Err(_) => return Self { _folder: None },
            }
        }
    }
}

#[cfg(test)]
#[cfg(unix)]
#[expect(
    clippy::used_underscore_binding,
    reason = "only tests look at what is held"
)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_is_waited_for_until_it_ends_or_patience_does() {
        let folder = tempfile::tempdir().expect("writable");
        let path = folder.path().join("a.map");
        let first = Turn::wait(&path, Duration::ZERO);
        assert!(first._folder.is_some());
        assert!(
            Turn::wait(&path, Duration::from_millis(5))
                ._folder
                .is_none()
        );
        let waiting = std::thread::spawn({
            let path = path.clone();
            move || Turn::wait(&path, Duration::from_secs(60))._folder.is_some()
        });
        std::thread::sleep(Duration::from_millis(50));
        assert!(!waiting.is_finished(), "it did not wait");
        drop(first);
        assert!(waiting.join().expect("no panic"));
        // Nothing is left behind, and a folder that is not there stops nobody.
        assert_eq!(std::fs::read_dir(folder.path()).expect("there").count(), 0);
        // A name without a folder is one in the folder that is worked in.
        let here = Turn::wait(Path::new("a.map"), Duration::from_secs(60));
        assert!(here._folder.is_some());
        let nowhere = folder.path().join("none/a.map");
        assert!(Turn::wait(&nowhere, Duration::ZERO)._folder.is_none());
    }
}

//! How does a new map get its name?
//!
//! What bears the name MAP is finished: a build keeps what it has learnt in `MAP.part`, from which
//! it can go on, and all others write a map in one go.

use std::path::{Path, PathBuf};

use anyhow::Result;

use chronotope::error::{Error, ErrorKind};
use chronotope::map::{Map, Snapshot};

/// Writes a finished map; a file that exists is never overwritten.
pub(super) fn write(out: &Path, snapshot: &Snapshot) -> Result<()> {
    Map::create_from(out, snapshot).map_err(with_help)?;
    Ok(())
}

/// Gives a part its final name.
pub(super) fn finish(part: &Path, out: &Path) -> Result<()> {
    Ok(Map::rename(part, out).map_err(with_help)?)
}

/// Refuses a name that is taken, before anything is done for it.
pub(super) fn refuse_existing(map: &Path) -> Result<()> {
    if std::fs::symlink_metadata(map).is_err() {
        return Ok(());
    }
    let error = Error::new(ErrorKind::AlreadyExists, "this file exists already");
    Err(with_help(error.with_path(map)).into())
}

/// Where the map is kept while it is not finished.
pub(super) fn part_of(map: &Path) -> PathBuf {
    let mut name = map.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

fn with_help(error: Error) -> Error {
    error.with_help("a map is never overwritten: choose another name or remove it")
}

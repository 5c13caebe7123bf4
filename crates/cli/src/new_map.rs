//! How does a new map get its name?
//!
//! It is written as `MAP.part` and renamed once it is whole: what bears the name MAP is finished.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::Result;

use chronotope::error::{Error, ErrorKind};
use chronotope::map::{Map, Snapshot};

/// Writes a finished map; a file that exists is never overwritten.
pub(super) fn write(out: &Path, snapshot: &Snapshot) -> Result<()> {
    refuse_existing(out)?;
    let part = part_of(out);
    refuse_existing(&part)?;
    let written = Map::create(&part, snapshot.meta.clone())
        .and_then(|map| map.commit(snapshot))
        .map_err(anyhow::Error::from)
        .and_then(|_| finish(&part, out));
    if written.is_err() {
        // It is ours; that it cannot be removed matters less than why.
        let _ = std::fs::remove_file(&part);
    }
    written
}

/// Gives a part its final name.
pub(super) fn finish(part: &Path, out: &Path) -> Result<()> {
    refuse_existing(out)?;
    std::fs::rename(part, out).map_err(|cause| Error::io(out, cause))?;
    if let Some(folder) = folder_of(out) {
        // The name survives a power loss; where folders cannot be synced, nothing is lost either.
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
    Ok(())
}

pub(super) fn refuse_existing(map: &Path) -> Result<()> {
    if std::fs::symlink_metadata(map).is_err() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Io, "this file exists already")
        .with_path(map)
        .with_help("a map is never overwritten: choose another name or remove it")
        .into())
}

/// Where the map is kept while it is not finished.
pub(super) fn part_of(map: &Path) -> PathBuf {
    let mut name = map.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

fn folder_of(path: &Path) -> Option<&Path> {
    path.parent().map(|folder| {
        if folder.as_os_str().is_empty() {
            Path::new(".")
        } else {
            folder
        }
    })
}

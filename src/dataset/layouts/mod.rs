//! Which files are the images of which place and time?
//!
//! Every layout hands what it finds to one [`Collector`], which applies the rules about single
//! entries (file there, crop inside, no second image of a place and time, place known) alike.

mod collector;
mod freloc;
mod grief;
mod index;
mod nclt;

use std::collections::BTreeMap;
use std::path::Path;

use self::collector::Collector;
use super::manifest::{
    Layout, Manifest, default_folder_prefix, default_index, default_place_prefix,
};
use super::paths::list;
use super::types::{Clock, Dataset, ReadOptions};
use crate::map::PlaceKey;
use fremen::error::{Error, ErrorKind, Result};

/// The images that `manifest` describes in `root`, which has this layout.
pub(super) fn read(
    manifest: &Manifest,
    layout: &Layout,
    root: &Path,
    options: &ReadOptions,
) -> Result<Dataset> {
    let mut collector = Collector::new(manifest, root, options);
    match layout {
        Layout::Index { file, ignore } => index::read(&mut collector, file, ignore)?,
        Layout::Grief { place_prefix } => grief::read(&mut collector, place_prefix)?,
        Layout::FreLoc {
            origins,
            place_prefix,
            first_place,
        } => freloc::read(&mut collector, origins, |number| {
            PlaceKey::new(&format!(
                "{place_prefix}{}",
                number.saturating_add(i64::from(*first_place))
            ))
        })?,
        Layout::Nclt { .. } => nclt::read(&mut collector, layout)?,
    }
    index::read_poses(&mut collector)?;
    index::read_edges(&mut collector)?;
    collector.finish()
}

/// The layout that a folder without a manifest has, and whether its times are a clock.
pub(super) fn detect(dir: &Path) -> Result<(Layout, Clock)> {
    let index = Layout::Index {
        file: default_index(),
        ignore: Vec::new(),
    };
    if index.is_in(dir) {
        return Ok((index, Clock::Real));
    }
    let numbered = [
        Layout::Grief {
            place_prefix: default_place_prefix(),
        },
        Layout::FreLoc {
            origins: BTreeMap::new(),
            place_prefix: default_folder_prefix(),
            first_place: 0,
        },
    ];
    if let Some(layout) = numbered.into_iter().find(|layout| layout.is_in(dir)) {
        return Ok((layout, Clock::None));
    }
    let error = |help: String| {
        Error::new(
            ErrorKind::Format,
            "no dataset: found no index.csv, no MMLL images (0101.png) and no training/place_N",
        )
        .with_path(dir)
        .with_help(help)
    };
    if !nclt::sessions(dir)?.is_empty() {
        return Err(error(
            "NCLT sessions need a dataset.toml with the poses of the places; datasets/README.md has an example"
                .into(),
        ));
    }
    let inside: Vec<String> = list(dir)?
        .into_iter()
        .filter(|path| path.join(default_index()).is_file())
        .map(|path| path.display().to_string())
        .collect();
    Err(error(if inside.is_empty() {
        "write an index.csv with the header place,time,path".into()
    } else {
        format!("name one dataset: {}", inside.join(", "))
    }))
}

impl Layout {
    /// Whether `dir` has this layout.
    pub fn is_in(&self, dir: &Path) -> bool {
        match self {
            Self::Index { file, .. } => dir.join(file).is_file(),
            Self::Grief { .. } => grief::find_folder(dir).is_some(),
            Self::FreLoc { .. } => freloc::is_in(dir),
            Self::Nclt { .. } => nclt::sessions(dir).is_ok_and(|sessions| !sessions.is_empty()),
        }
    }

    /// What [`is_in`](Self::is_in) looks for, for people.
    pub(super) fn wanted(&self) -> String {
        match self {
            Self::Index { file, .. } => format!("`{file}`"),
            Self::Grief { .. } => "images MMLL.{ppm,png,webp,jpg}".into(),
            Self::FreLoc { .. } => "`training/place_N` or `testing/place_N`".into(),
            Self::Nclt { .. } => "`images/YYYY-MM-DD/lb3`".into(),
        }
    }
}

//! Which dataset is in this folder?

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::layouts;
use super::manifest::{Checksums, Layout, Manifest, Quantum, TimeRule};
use super::types::{Dataset, ReadOptions};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// The file that describes a folder from inside it.
const FOLDER_MANIFEST: &str = "dataset.toml";

impl Dataset {
    /// Opens a folder of images or a manifest (`*.toml`); [`Manifest::locate`] says how the
    /// manifest of a folder is found.
    pub fn open(path: &Path) -> Result<Self> {
        let (manifest, data_dir) = Manifest::locate(path)?;
        Self::open_with(&manifest, &data_dir)
    }

    /// Opens the images of `manifest` in `data_dir`, which is the set's own folder or one that
    /// contains it under the manifest's name.
    pub fn open_with(manifest: &Manifest, data_dir: &Path) -> Result<Self> {
        Self::read(manifest, data_dir, &ReadOptions::default())
    }

    /// [`open_with`](Self::open_with), read in another way than by default.
    pub fn read(manifest: &Manifest, data_dir: &Path, options: &ReadOptions) -> Result<Self> {
        let root = manifest.find_data(data_dir)?;
        let layout = manifest
            .layout
            .iter()
            .find(|layout| layout.is_in(&root))
            .ok_or_else(|| {
                Error::new(ErrorKind::Format, "the folder changed while it was read")
                    .with_path(&root)
            })?;
        if let Some(other) = Manifest::recognise(&root)?
            && other.name != manifest.name
            && manifest.checksums.index.is_some()
        {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "this is the dataset `{}`, not `{}`",
                    other.name, manifest.name
                ),
            )
            .with_path(&root)
            .with_help(format!("name the folder of `{}`", manifest.name)));
        }
        layouts::read(manifest, layout, &root, options)
    }
}

impl Manifest {
    /// The manifest of `path` and the folder of its data.
    ///
    /// `path` is a manifest (a file), or a folder. For a folder: the `dataset.toml` inside it; or
    /// the supported dataset whose index it has, byte for byte; or a plain manifest with the
    /// folder's name and the layout found in it. Without a manifest, the times of an `index.csv`
    /// are taken for real ones and numbered files have no clock.
    pub fn locate(path: &Path) -> Result<(Self, PathBuf)> {
        let meta = std::fs::metadata(path).map_err(|cause| {
            Error::io(path, cause)
                .with_help("give a folder with an index.csv, or a manifest (*.toml)")
        })?;
        if !meta.is_dir() {
            if path.extension().is_none_or(|extension| extension != "toml") {
                return Err(Error::new(
                    ErrorKind::Format,
                    "this is neither a folder nor a manifest (*.toml)",
                )
                .with_path(path)
                .with_help("give the folder that contains index.csv"));
            }
            let manifest = Self::load(path)?;
            let folder = path.parent().unwrap_or(Path::new("."));
            let data_dir = manifest
                .data
                .as_ref()
                .map_or_else(|| folder.to_owned(), |data| folder.join(data));
            return Ok((manifest, data_dir));
        }
        let inside = path.join(FOLDER_MANIFEST);
        if inside.exists() {
            let manifest = Self::load(&inside)?;
            let data_dir = manifest
                .data
                .as_ref()
                .map_or_else(|| path.to_owned(), |data| path.join(data));
            return Ok((manifest, data_dir));
        }
        if let Some(manifest) = Self::recognise(path)? {
            return Ok((manifest, path.to_owned()));
        }
        Ok((Self::plain(path)?, path.to_owned()))
    }

    /// A manifest that knows no more than the folder shows.
    fn plain(data_dir: &Path) -> Result<Self> {
        let (layout, clock) = layouts::detect(data_dir)?;
        let name = std::path::absolute(data_dir)
            .ok()
            .and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
            .unwrap_or_else(|| "dataset".into());
        Ok(Self {
            name,
            aliases: Vec::new(),
            title: String::new(),
            citation: String::new(),
            licence: String::new(),
            obtain: String::new(),
            known_faults: Vec::new(),
            places: Vec::new(),
            image_size: None,
            data: None,
            time: TimeRule {
                clock,
                // One visit a day from the epoch: such times only number the visits.
                origin: Some(Time::from_us(0)),
                quantum: Some(Quantum::Seconds(86_400)),
                first_visit: 0,
                file_name: None,
                base_period: None,
                zone: None,
                place_zones: BTreeMap::new(),
            },
            layout: vec![layout],
            split: None,
            mask: Vec::new(),
            checksums: Checksums::default(),
        })
    }

    /// The folder of this dataset: `dir` itself, or the folder in it that has the dataset's name.
    pub fn find_data(&self, dir: &Path) -> Result<PathBuf> {
        let has_layout = |dir: &Path| self.layout.iter().any(|layout| layout.is_in(dir));
        let named = std::iter::once(&self.name)
            .chain(&self.aliases)
            .map(|name| dir.join(name))
            .find(|path| has_layout(path));
        if let Some(path) = named {
            return Ok(path);
        }
        if has_layout(dir) {
            return Ok(dir.to_owned());
        }
        if !dir.is_dir() {
            return Err(Error::new(ErrorKind::Io, "there is no such folder")
                .with_path(dir)
                .with_help(format!(
                    "give the folder of the dataset `{}` or the one that contains it",
                    self.name
                )));
        }
        let wanted: Vec<_> = self.layout.iter().map(Layout::wanted).collect();
        Err(Error::new(
            ErrorKind::Format,
            format!(
                "the dataset `{}` is neither here nor in the folder `{}` here: found no {}",
                self.name,
                self.name,
                wanted.join(" and no ")
            ),
        )
        .with_path(dir)
        .with_help(if self.obtain.is_empty() {
            "name the folder that contains the data".into()
        } else {
            format!("to get the data: {}", self.obtain.trim())
        }))
    }
}

//! Which picture is in a file, and when was it taken?
//!
//! An image that an index lists is cut, turned and scaled as the index says; one that the index cuts
//! into several pictures is queried once for each. Of several indexes that of the dataset that was
//! named counts ([`PictureFinder::with_manifest`]), else the one in the nearest folder above the
//! image, as its path is given or as links lead to it. An image is known by the file, not by the
//! text of its path.
//!
//! Its time is the one given, else that of the index, else that of its EXIF data, else what the
//! file-name rule of a manifest reads from its name. The present is never assumed.
//!
//! What is odd about an index but does not change the answer is a line in
//! [`PictureTime::warnings`], once for each finder.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use serde::Serialize;

use super::capture::exif_time;
use super::file_image::FileImage;
use super::lookup::{FileIdentity, Lookup};
use super::manifest::Manifest;
use super::types::{Clock, Dataset, ImageSource, ReadOptions};
use crate::map::PlaceKey;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

const INDEX: &str = "index.csv";

/// Two clocks that differ by less are the same, s.
const SAME_CLOCK_S: f64 = 120.0;

/// Who said when a picture was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeSource {
    /// Whoever asked where it was taken.
    Option,
    /// The index next to it.
    Index,
    /// Its EXIF data.
    Exif,
    /// Its name.
    FileName,
    /// The clock, for a camera.
    Clock,
}

impl TimeSource {
    /// For programs.
    pub fn word(self) -> &'static str {
        match self {
            Self::Option => "option",
            Self::Index => "index",
            Self::Exif => "exif",
            Self::FileName => "file-name",
            Self::Clock => "clock",
        }
    }

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Option => "given",
            Self::Index => "from the index",
            Self::Exif => "from EXIF",
            Self::FileName => "from the file name",
            Self::Clock => "now",
        }
    }
}

/// A picture that was found but not decoded.
#[derive(Clone)]
pub struct FoundPicture {
    /// How it is called in results.
    pub name: String,
    /// What decodes it, cut, turned and scaled as its index says.
    pub source: Arc<dyn ImageSource>,
    /// The place that the index says it shows.
    pub truth: Option<PlaceKey>,
    /// When the index says it was taken.
    time: Option<Time>,
    /// The dataset that lists it, unless it is the one that was named.
    found_in: Option<Arc<Index>>,
    /// An index above it that cannot be read.
    broken_index: Option<Arc<Error>>,
}

impl std::fmt::Debug for FoundPicture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (f.debug_struct("FoundPicture"))
            .field("name", &self.name)
            .field("truth", &self.truth)
            .field("time", &self.time)
            .finish_non_exhaustive()
    }
}

/// When a picture was taken.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PictureTime {
    /// The time, with who said so; `None` where nobody does and none is needed.
    pub time: Option<(Time, TimeSource)>,
    /// What is odd about the index above it, and was not said before.
    pub warnings: Vec<String>,
}

/// Finds the pictures of files; every index is read once, and again when it changes.
#[derive(Debug, Default)]
pub struct PictureFinder {
    options: ReadOptions,
    /// The manifest that was named.
    named: Option<Named>,
    /// What helps where nobody says when a picture was taken, in the words of the program.
    time_help: Option<String>,
    /// Names of the files that will be looked for, if they are known.
    names: Option<Arc<BTreeSet<String>>>,
    /// By folder: its index (that of these names, that of all), or why it cannot be read.
    indices: Mutex<BTreeMap<(PathBuf, Rows), Known>>,
    /// What was said of an index already.
    said: Mutex<BTreeSet<String>>,
}

/// Which rows of an index are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Rows {
    /// Those of the names that are looked for.
    Named,
    /// All: an image may be listed by another name, that of a link to it.
    All,
}

/// An index, or why it cannot be read.
type ReadIndex = Result<Arc<Index>, Arc<Error>>;

/// What is known of an index: when it was written, and what it says.
type Known = (Option<SystemTime>, ReadIndex);

/// A manifest, with its data where that is there.
#[derive(Debug)]
struct Named {
    manifest: Manifest,
    index: Option<Arc<Index>>,
}

/// A dataset whose entries are found by file.
#[derive(Debug)]
struct Index {
    dataset: Dataset,
    lookup: Lookup,
}

impl Index {
    fn new(dataset: Dataset) -> Arc<Self> {
        let lookup = Lookup::new(&dataset);
        Arc::new(Self { dataset, lookup })
    }
}

impl PictureFinder {
    /// Reads indexes and images so.
    pub fn new(options: ReadOptions) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// `manifest` is the name of a supported dataset, a manifest or a folder: its index counts
    /// before those above an image, and so does its rule for file names.
    ///
    /// # Errors
    ///
    /// Where there is none of that name, or it says nothing of times.
    pub fn with_manifest(mut self, manifest: &str) -> Result<Self> {
        self.named = Some(Named::find(manifest, &self.options)?);
        Ok(self)
    }

    /// Of an index the rows of these files are read first, and often enough: a few images under a
    /// large index are found in the time that reading its bytes takes.
    #[must_use]
    pub fn with_names_of(mut self, images: &[PathBuf]) -> Self {
        let names = (images.iter().filter_map(|image| image.file_name()))
            .map(|name| name.to_string_lossy().into_owned())
            .collect();
        self.names = Some(Arc::new(names));
        self
    }

    /// What the error advises where nobody says when a picture was taken and it is needed.
    #[must_use]
    pub fn with_time_help(mut self, help: &str) -> Self {
        self.time_help = Some(help.to_owned());
        self
    }

    /// The pictures of a file: one, or as many as its index cuts out of it.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Format`] if its index leaves it out. That a file is not there is an error of
    /// decoding it.
    pub fn find(&self, path: &Path) -> Result<Vec<FoundPicture>> {
        let file = FileIdentity::of(path);
        if let Some(index) = self.named.as_ref().and_then(|named| named.index.clone())
            && let Some(found) = entries_of(&index, &file, path)?
        {
            return Ok(found);
        }
        let mut broken_index = None;
        for folder in folders_above(path) {
            let rows = match &self.names {
                Some(_) => &[Rows::Named, Rows::All][..],
                None => &[Rows::All],
            };
            for &rows in rows {
                match self.open(&folder, rows) {
                    None => break,
                    Some(Err(error)) if rows == Rows::All => {
                        broken_index.get_or_insert(error);
                    }
                    Some(Err(_)) => {}
                    Some(Ok(index)) => {
                        if let Some(mut found) = entries_of(&index, &file, path)? {
                            for picture in &mut found {
                                picture.found_in = Some(Arc::clone(&index));
                                picture.broken_index.clone_from(&broken_index);
                            }
                            return Ok(found);
                        }
                    }
                }
            }
        }
        let source = match &self.named {
            Some(named) => named.manifest.picture(path, None),
            None => FileImage::new(path),
        };
        Ok(vec![FoundPicture {
            name: path.display().to_string(),
            source: Arc::new(source.with_limits(self.options.limits)),
            time: None,
            truth: None,
            found_in: None,
            broken_index,
        }])
    }

    /// The index in a folder.
    fn open(&self, folder: &Path, rows: Rows) -> Option<ReadIndex> {
        let file = std::fs::metadata(folder.join(INDEX)).ok()?;
        if !file.is_file() {
            return None;
        }
        let written = file.modified().ok();
        let key = (folder.to_owned(), rows);
        let mut indices = self.indices.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, index)) = indices.get(&key)
            && *known == written
        {
            return Some(index.clone());
        }
        let options = ReadOptions {
            only: (self.names.clone()).filter(|_| rows == Rows::Named),
            ..self.options.clone()
        };
        let read = || {
            let (manifest, data_dir) = Manifest::locate(folder)?;
            Dataset::read(&manifest, &data_dir, &options)
        };
        let index = read().map(Index::new).map_err(Arc::new);
        indices.insert(key, (written, index.clone()));
        Some(index)
    }

    /// When a picture was taken: `given`, else what its index, its EXIF data or its name say.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Time`] if nobody says it and it is needed, or the error of an index above the
    /// picture that cannot be read.
    pub fn time_of(
        &self,
        picture: &FoundPicture,
        given: Option<Time>,
        is_needed: bool,
    ) -> Result<PictureTime> {
        let mut warnings = Vec::new();
        let file = picture.source.path();
        let time = match self.find_time(picture, file.as_deref(), given) {
            Some((time, source)) => {
                self.warn_of_index(picture, &mut warnings);
                if source == TimeSource::Index {
                    self.warn_of_times(picture, time, file.as_deref(), is_needed, &mut warnings);
                }
                Some((time, source))
            }
            None => match &file {
                Some(file) if is_needed && file.exists() => {
                    return Err(self.no_time(picture, file));
                }
                Some(_) => {
                    self.warn_of_index(picture, &mut warnings);
                    None
                }
                None => None,
            },
        };
        Ok(PictureTime { time, warnings })
    }

    fn find_time(
        &self,
        picture: &FoundPicture,
        file: Option<&Path>,
        given: Option<Time>,
    ) -> Option<(Time, TimeSource)> {
        if let Some(time) = given {
            return Some((time, TimeSource::Option));
        }
        if let Some(time) = picture.time {
            return Some((time, TimeSource::Index));
        }
        let file = file?;
        let zone = self.options.zone.as_ref();
        // What cannot be read is said when it is decoded.
        if let Some(time) = exif_time(file, zone).unwrap_or_default() {
            return Some((time, TimeSource::Exif));
        }
        let name = file.file_name()?.to_str()?;
        let manifest = &self.named.as_ref()?.manifest;
        let time = manifest.time_from_name_in(name, zone)?;
        Some((time, TimeSource::FileName))
    }

    fn no_time(&self, picture: &FoundPicture, file: &Path) -> Error {
        if let Some(error) = &picture.broken_index {
            let (path, place) = (error.path().unwrap_or(file), error.place());
            let mut again = Error::new(error.kind(), error.message()).with_path(path);
            if let Some(place) = place {
                again = again.with_place(place);
            }
            return match error.help() {
                Some(help) => again.with_help(help),
                None => again,
            };
        }
        let rule = (self.named.as_ref())
            .filter(|named| named.manifest.file_name_rule().is_some())
            .map(|named| &named.manifest.name);
        let tried = match rule {
            Some(name) => format!(
                "no index.csv above it lists it, it has no EXIF time with an offset, and its name does \
                 not fit the rule of `{name}`"
            ),
            None => "no index.csv above it lists it and it has no EXIF time with an offset".into(),
        };
        Error::new(ErrorKind::Time, format!("when was it taken? {tried}"))
            .with_path(file)
            .with_help(
                self.time_help
                    .as_deref()
                    .unwrap_or("give its time, or a zone for an EXIF time without an offset"),
            )
    }

    /// Says once that an index cannot be read.
    fn warn_of_index(&self, picture: &FoundPicture, warnings: &mut Vec<String>) {
        if let Some(error) = &picture.broken_index {
            let line = format!("the index above {} is not used: {error}", picture.name);
            if self.is_news(&line) {
                warnings.push(line);
            }
        }
    }

    /// Says once of each index that its times mean nothing, or are not those of the photographs.
    fn warn_of_times(
        &self,
        picture: &FoundPicture,
        time: Time,
        file: Option<&Path>,
        is_needed: bool,
        warnings: &mut Vec<String>,
    ) {
        let (Some(index), Some(file)) = (&picture.found_in, file) else {
            return;
        };
        let name = &index.dataset.name;
        if index.dataset.clock == Clock::None {
            let line =
                format!("the times of `{name}` only number its visits, rhythms mean nothing there");
            if is_needed && self.is_news(&line) {
                warnings.push(line);
            }
            return;
        }
        let key = format!("times of {name}");
        if !self.is_new(&key) {
            return;
        }
        let exif = exif_time(file, self.options.zone.as_ref()).unwrap_or_default();
        if let Some(exif) = exif.filter(|exif| exif.since_s(time).abs() > SAME_CLOCK_S) {
            self.is_news(&key);
            warnings.push(format!(
                "{}: its EXIF data say {exif}, but the index of `{name}` above it says {time}, which \
                 counts; if that index is not of this image, name the right one",
                file.display(),
            ));
        }
    }

    fn is_new(&self, line: &str) -> bool {
        let said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        !said.contains(line)
    }

    /// Whether a line was not said before; from now on it was.
    fn is_news(&self, line: &str) -> bool {
        let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        said.insert(line.to_owned())
    }
}

impl Named {
    fn find(name: &str, options: &ReadOptions) -> Result<Self> {
        let path = Path::new(name);
        let (manifest, dataset) = if path.exists() {
            let (manifest, data_dir) = Manifest::locate(path)?;
            let dataset = Dataset::read(&manifest, &data_dir, options);
            (manifest, Some(dataset))
        } else {
            (Manifest::find_builtin(name)?, None)
        };
        let has_rule = manifest.file_name_rule().is_some();
        let index = match dataset {
            Some(Ok(dataset)) => Some(Index::new(dataset)),
            // Its rule for names is of use without its data.
            Some(Err(error)) if !has_rule => return Err(error),
            _ => None,
        };
        if index.is_none() && !has_rule {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "the manifest `{}` has no rule for file names",
                    manifest.name
                ),
            )
            .with_help("write under [time], for example: file_name = \"{unix_s}\""));
        }
        Ok(Self { manifest, index })
    }
}

/// The pictures that an index cuts out of a file; nothing if it does not list it.
fn entries_of(
    index: &Index,
    file: &FileIdentity,
    path: &Path,
) -> Result<Option<Vec<FoundPicture>>> {
    let positions = index.lookup.entries(file);
    if positions.is_empty() {
        return match index.lookup.problem(file) {
            None => Ok(None),
            Some(problem) => Err(Error::new(
                ErrorKind::Format,
                format!(
                    "its index leaves it out: {}",
                    index.dataset.problems[problem]
                ),
            )
            .with_path(path)),
        };
    }
    let is_cut = positions.len() > 1;
    let listed = positions.iter().map(|&position| {
        let entry = &index.dataset.entries[position];
        FoundPicture {
            name: if is_cut {
                format!("{} ({} at {})", path.display(), entry.place, entry.time)
            } else {
                path.display().to_string()
            },
            source: Arc::clone(&entry.source),
            time: Some(entry.time),
            truth: Some(entry.place.clone()),
            found_in: None,
            broken_index: None,
        }
    });
    Ok(Some(listed.collect()))
}

/// The folders above a file, the nearest first: as its path is given, then as links lead to it.
fn folders_above(path: &Path) -> Vec<PathBuf> {
    let given = std::path::absolute(path).ok();
    let real = std::fs::canonicalize(path).ok();
    let mut folders: Vec<PathBuf> = Vec::new();
    for path in given.iter().chain(&real) {
        for folder in path.ancestors().skip(1) {
            if !folders.iter().any(|known| known == folder) {
                folders.push(folder.to_owned());
            }
        }
    }
    folders
}

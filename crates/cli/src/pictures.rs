//! Which picture is the query, and when was it taken?
//!
//! An image that an index lists is cut, turned and scaled as the index says; one that the index cuts
//! into several pictures is queried once for each. Of several indexes that of the dataset named by
//! `--manifest` counts, else the one in the nearest folder above the image, as its path is given or
//! as links lead to it. An image is known by the file, not by the text of its path.
//!
//! Its time is the one given, else that of the index, else that of its EXIF data, else what the
//! file-name rule of a manifest reads from its name. The present is never assumed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Serialize, Serializer};

use super::reading::{Adjust, ReadingArgs};
use chronotope::dataset::{
    Clock, Dataset, FileIdentity, FileImage, ImageSource, Lookup, Manifest, ReadOptions, exif_time,
};
use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::GrayImage;
use chronotope::map::PlaceKey;
use chronotope::time::Time;

const INDEX: &str = "index.csv";

/// Two clocks that differ by less are the same, s.
const SAME_CLOCK_S: f64 = 120.0;

/// Who said when a picture was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TimeSource {
    /// The option `--time`.
    Option,
    /// The index next to it.
    Index,
    /// Its EXIF data.
    Exif,
    /// Its name.
    FileName,
    /// The clock, for a camera.
    #[cfg_attr(
        not(feature = "opencv"),
        expect(dead_code, reason = "only cameras are live")
    )]
    Clock,
}

impl TimeSource {
    /// For programs.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Option => "option",
            Self::Index => "index",
            Self::Exif => "exif",
            Self::FileName => "file-name",
            Self::Clock => "clock",
        }
    }

    /// For people.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Option => "given",
            Self::Index => "from the index",
            Self::Exif => "from EXIF",
            Self::FileName => "from the file name",
            Self::Clock => "now",
        }
    }
}

impl Serialize for TimeSource {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.serialize_str(self.word())
    }
}

/// One picture to be located.
pub(super) struct Picture {
    /// How it is called in results.
    pub(super) name: String,
    /// The file it comes from.
    pub(super) file: Option<PathBuf>,
    /// What is done to the file, as [`ImageSource::recipe`] says it.
    pub(super) recipe: String,
    pub(super) image: GrayImage,
    pub(super) mask: Option<GrayImage>,
    pub(super) time: Option<(Time, TimeSource)>,
    /// The place that the index says it shows.
    pub(super) truth: Option<PlaceKey>,
}

/// Turns paths into pictures.
pub(super) struct Pictures {
    time: Option<Time>,
    needs_time: bool,
    options: ReadOptions,
    adjust: Adjust,
    /// What `--manifest` names.
    named: Option<Named>,
    /// Names of the files that are asked about.
    names: Arc<BTreeSet<String>>,
    /// By folder: its index (that of these names, that of all), why it cannot be read, or nothing
    /// where there is none.
    indices: BTreeMap<(PathBuf, Rows), Option<ReadIndex>>,
    /// What was said of an index already.
    said: BTreeSet<String>,
}

/// Which rows of an index are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Rows {
    /// Those of the names that are asked about.
    Named,
    /// All: an image may be listed by another name, that of a link to it.
    All,
}

/// An index, or why it cannot be read.
type ReadIndex = Result<Arc<Index>, Arc<Error>>;

/// A manifest, with its data where that is there.
struct Named {
    manifest: Manifest,
    index: Option<Arc<Index>>,
}

/// A dataset whose entries are found by file.
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

/// A picture that was found but not decoded.
pub(super) struct Listed {
    name: String,
    source: Arc<dyn ImageSource>,
    time: Option<Time>,
    truth: Option<PlaceKey>,
    /// The dataset that lists it, unless it is the one that was named.
    found_in: Option<Arc<Index>>,
    /// An index above it that cannot be read.
    broken_index: Option<Arc<Error>>,
}

impl Pictures {
    /// `manifest` is the name of a supported dataset, a manifest or a folder; images are scaled to
    /// `size` where they have its shape; `images` are those that will be asked about.
    pub(super) fn new(
        images: &[PathBuf],
        time: Option<Time>,
        needs_time: bool,
        manifest: Option<&str>,
        reading: &ReadingArgs,
        size: Option<(u32, u32)>,
    ) -> Result<Self> {
        let options = reading.read_options();
        let named = manifest
            .map(|name| Named::find(name, &options))
            .transpose()?;
        Ok(Self {
            time,
            needs_time,
            options,
            adjust: Adjust::new(reading.load_options(), size),
            named,
            names: Arc::new(
                (images.iter().filter_map(|image| image.file_name()))
                    .map(|name| name.to_string_lossy().into_owned())
                    .collect(),
            ),
            indices: BTreeMap::new(),
            said: BTreeSet::new(),
        })
    }

    /// The pictures of a file: one, or as many as its index cuts out of it.
    pub(super) fn list(&mut self, path: &Path) -> Result<Vec<Listed>> {
        let file = FileIdentity::of(path);
        if let Some(index) = self.named.as_ref().and_then(|named| named.index.clone())
            && let Some(listed) = entries_of(&index, &file, path)?
        {
            return Ok(listed);
        }
        let mut broken_index = None;
        for folder in folders_above(path) {
            for rows in [Rows::Named, Rows::All] {
                match self.open(&folder, rows) {
                    None => break,
                    Some(Err(error)) if rows == Rows::All => {
                        broken_index.get_or_insert(error);
                    }
                    Some(Err(_)) => {}
                    Some(Ok(index)) => {
                        if let Some(mut listed) = entries_of(&index, &file, path)? {
                            for picture in &mut listed {
                                picture.found_in = Some(Arc::clone(&index));
                            }
                            return Ok(listed);
                        }
                    }
                }
            }
        }
        let source = match &self.named {
            Some(named) => named.manifest.picture(path, None),
            None => FileImage::new(path),
        };
        Ok(vec![Listed {
            name: path.display().to_string(),
            source: Arc::new(source.with_limits(self.options.limits)),
            time: None,
            truth: None,
            found_in: None,
            broken_index,
        }])
    }

    /// The index in a folder, which is read once.
    fn open(&mut self, folder: &Path, rows: Rows) -> Option<ReadIndex> {
        let key = (folder.to_owned(), rows);
        if !self.indices.contains_key(&key) {
            let options = ReadOptions {
                only: (rows == Rows::Named).then(|| Arc::clone(&self.names)),
                ..self.options.clone()
            };
            let read = || {
                let (manifest, data_dir) = Manifest::locate(folder)?;
                Dataset::read(&manifest, &data_dir, &options)
            };
            let found =
                (folder.join(INDEX).is_file()).then(|| read().map(Index::new).map_err(Arc::new));
            self.indices.insert(key.clone(), found);
        }
        match self.indices.get(&key)? {
            None => None,
            Some(Ok(index)) => Some(Ok(Arc::clone(index))),
            Some(Err(error)) => Some(Err(Arc::clone(error))),
        }
    }

    /// Decodes a picture and finds out when it was taken.
    pub(super) fn load(&mut self, listed: Listed) -> Result<Picture> {
        let file = listed.source.path();
        let time = self.time_of(&listed, file.as_deref())?;
        // What cannot be read is said when it is decoded.
        if let Ok(Some(size)) = listed.source.size() {
            self.adjust.check(size).map_err(|error| match &file {
                Some(file) => error.with_path(file),
                None => error,
            })?;
        }
        let (image, mask) = listed.source.load_masked()?;
        let mut recipe = listed.source.recipe();
        let (image, mask) = self.adjust.apply(image, mask, &mut recipe)?;
        Ok(Picture {
            name: listed.name,
            recipe,
            file,
            image,
            mask,
            time,
            truth: listed.truth,
        })
    }

    fn time_of(
        &mut self,
        listed: &Listed,
        file: Option<&Path>,
    ) -> Result<Option<(Time, TimeSource)>> {
        if let Some(time) = self.time {
            self.warn_of_index(listed);
            return Ok(Some((time, TimeSource::Option)));
        }
        if let Some(time) = listed.time {
            if let (Some(index), Some(file)) = (&listed.found_in, file) {
                self.warn_of_times(&index.dataset, time, file);
            }
            return Ok(Some((time, TimeSource::Index)));
        }
        let Some(file) = file else {
            return Ok(None);
        };
        // What cannot be read is said when it is decoded.
        if let Some(time) = exif_time(file, self.options.zone.as_ref()).unwrap_or_default() {
            self.warn_of_index(listed);
            return Ok(Some((time, TimeSource::Exif)));
        }
        let name = file.file_name().and_then(|name| name.to_str());
        let zone = self.options.zone.as_ref();
        let manifest = self.named.as_ref().map(|named| &named.manifest);
        if let (Some(manifest), Some(name)) = (manifest, name)
            && let Some(time) = manifest.time_from_name_in(name, zone)
        {
            self.warn_of_index(listed);
            return Ok(Some((time, TimeSource::FileName)));
        }
        if !self.needs_time || !file.exists() {
            self.warn_of_index(listed);
            return Ok(None);
        }
        Err(self.no_time(listed, file))
    }

    fn no_time(&self, listed: &Listed, file: &Path) -> Error {
        if let Some(error) = &listed.broken_index {
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
                "give --time 2024-05-01T08:30:00Z, or --zone for an EXIF time without an offset, name \
                 the manifest with the rule of its file name by --manifest, or use --method static",
            )
    }

    /// Says once that an index cannot be read.
    fn warn_of_index(&mut self, listed: &Listed) {
        if let Some(error) = &listed.broken_index {
            self.say(format!(
                "warning: the index above {} is not used: {error}",
                listed.name
            ));
        }
    }

    /// Says once of each index that its times mean nothing, or are not those of the photographs.
    fn warn_of_times(&mut self, dataset: &Dataset, time: Time, file: &Path) {
        if dataset.clock == Clock::None {
            if self.needs_time {
                self.say(format!(
                    "warning: the times of `{}` only number its visits, rhythms mean nothing there",
                    dataset.name
                ));
            }
            return;
        }
        let key = format!("times of {}", dataset.name);
        if self.said.contains(&key) {
            return;
        }
        let exif = exif_time(file, self.options.zone.as_ref()).unwrap_or_default();
        if let Some(exif) = exif.filter(|exif| exif.since_s(time).abs() > SAME_CLOCK_S) {
            self.said.insert(key);
            note!(
                "warning: {}: its EXIF data say {exif}, but the index of `{}` above it says {time}, \
                 which counts; if that index is not of this image, name the right one by --manifest",
                file.display(),
                dataset.name
            );
        }
    }

    fn say(&mut self, line: String) {
        if !self.said.contains(&line) {
            note!("{line}");
            self.said.insert(line);
        }
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
fn entries_of(index: &Index, file: &FileIdentity, path: &Path) -> Result<Option<Vec<Listed>>> {
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
        Listed {
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

//! Which picture is the query, and when was it taken?
//!
//! An image that an `index.csv` in one of its parent folders lists is cut, turned and scaled as the
//! index says; one that the index cuts into several pictures is queried once for each. Its time is
//! the one given, else that of the index, else that of its EXIF data with an offset, else what the
//! file-name rule of a manifest reads from its name. The present is never assumed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Serialize, Serializer};

use chronotope::dataset::{Clock, Dataset, FileImage, ImageSource, Manifest};
use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::GrayImage;
use chronotope::feature::image_file::exif_time;
use chronotope::map::PlaceKey;
use chronotope::time::Time;

const INDEX: &str = "index.csv";

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
    manifest: Option<Manifest>,
    /// The datasets of the folders looked at so far.
    indices: BTreeMap<PathBuf, Arc<Dataset>>,
}

/// A picture that was found but not decoded.
pub(super) struct Listed {
    name: String,
    source: Arc<dyn ImageSource>,
    time: Option<Time>,
    truth: Option<PlaceKey>,
}

impl Pictures {
    /// `manifest` is the name of a supported dataset, a manifest or a folder.
    pub(super) fn new(
        time: Option<Time>,
        needs_time: bool,
        manifest: Option<&str>,
    ) -> Result<Self> {
        let manifest = manifest.map(|name| {
            let path = Path::new(name);
            if path.exists() {
                Manifest::locate(path).map(|(manifest, _)| manifest)
            } else {
                Manifest::find_builtin(name)
            }
        });
        let manifest = manifest.transpose()?;
        if let Some(manifest) = &manifest
            && manifest.time.file_name.is_none()
        {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "the manifest `{}` has no rule for file names",
                    manifest.name
                ),
            )
            .with_help("write under [time], for example: file_name = \"{unix_s}\""));
        }
        Ok(Self {
            time,
            needs_time,
            manifest,
            indices: BTreeMap::new(),
        })
    }

    /// The pictures of a file: one, or as many as its index cuts out of it.
    pub(super) fn list(&mut self, path: &Path) -> Result<Vec<Listed>> {
        let plain = || Listed {
            name: path.display().to_string(),
            source: Arc::new(FileImage::new(path)),
            time: None,
            truth: None,
        };
        let Ok(file) = std::fs::canonicalize(path) else {
            // Decoding says best why it cannot be read.
            return Ok(vec![plain()]);
        };
        let Some(folder) = index_folder(&file) else {
            return Ok(vec![plain()]);
        };
        let dataset = match self.open(folder) {
            Ok(dataset) => dataset,
            Err(error) if self.time.is_some() || !self.needs_time => {
                eprintln!(
                    "warning: the index next to {} is not used: {error}",
                    path.display()
                );
                return Ok(vec![plain()]);
            }
            Err(error) => return Err(error),
        };
        let entries: Vec<_> = (dataset.entries.iter())
            .filter(|entry| {
                let source = entry.source.path();
                source.is_some_and(|source| {
                    source.file_name() == file.file_name()
                        && std::fs::canonicalize(source).is_ok_and(|source| source == file)
                })
            })
            .collect();
        if dataset.clock == Clock::None
            && self.time.is_none()
            && self.needs_time
            && !entries.is_empty()
        {
            eprintln!(
                "warning: the times of `{}` only number its visits, rhythms mean nothing there",
                dataset.name
            );
        }
        if let ([], Some(file_name)) = (entries.as_slice(), file.file_name()) {
            let file_name = file_name.to_string_lossy();
            let why = (dataset.problems.iter()).find(|problem| {
                problem.message.contains(&*file_name) || problem.subject.contains(&*file_name)
            });
            return match why {
                Some(problem) => Err(Error::new(
                    ErrorKind::Format,
                    format!("its index leaves it out: {problem}"),
                )
                .with_path(path)),
                None => Ok(vec![plain()]),
            };
        }
        let is_cut = entries.len() > 1;
        let listed = entries.into_iter().map(|entry| Listed {
            name: if is_cut {
                format!("{} ({} at {})", path.display(), entry.place, entry.time)
            } else {
                path.display().to_string()
            },
            source: Arc::clone(&entry.source),
            time: Some(entry.time),
            truth: Some(entry.place.clone()),
        });
        Ok(listed.collect())
    }

    fn open(&mut self, folder: &Path) -> Result<Arc<Dataset>> {
        if let Some(dataset) = self.indices.get(folder) {
            return Ok(Arc::clone(dataset));
        }
        let dataset = Arc::new(Dataset::open(folder)?);
        self.indices.insert(folder.to_owned(), Arc::clone(&dataset));
        Ok(dataset)
    }

    /// Decodes a picture and finds out when it was taken.
    pub(super) fn load(&self, listed: Listed) -> Result<Picture> {
        let image = listed.source.load()?;
        let mask = listed.source.mask(image.width(), image.height())?;
        let file = listed.source.path();
        let time = self.time_of(listed.time, file.as_deref())?;
        Ok(Picture {
            name: listed.name,
            recipe: listed.source.recipe(),
            file,
            image,
            mask,
            time,
            truth: listed.truth,
        })
    }

    fn time_of(
        &self,
        indexed: Option<Time>,
        file: Option<&Path>,
    ) -> Result<Option<(Time, TimeSource)>> {
        if let Some(time) = self.time {
            return Ok(Some((time, TimeSource::Option)));
        }
        if let Some(time) = indexed {
            return Ok(Some((time, TimeSource::Index)));
        }
        let Some(file) = file else {
            return Ok(None);
        };
        if let Some(text) = exif_time(file)? {
            let time = Time::parse(&text).map_err(|error| error.with_path(file))?;
            return Ok(Some((time, TimeSource::Exif)));
        }
        let name = file.file_name().and_then(|name| name.to_str());
        if let (Some(manifest), Some(name)) = (&self.manifest, name)
            && let Some(time) = manifest.time_from_name(name)
        {
            return Ok(Some((time, TimeSource::FileName)));
        }
        if !self.needs_time {
            return Ok(None);
        }
        let tried = match &self.manifest {
            Some(manifest) => format!(
                "no index.csv above it lists it, it has no EXIF time with an offset, and its name does \
                 not fit the rule of `{}`",
                manifest.name
            ),
            None => "no index.csv above it lists it and it has no EXIF time with an offset".into(),
        };
        Err(
            Error::new(ErrorKind::Time, format!("when was it taken? {tried}"))
                .with_path(file)
                .with_help(
                    "give --time 2024-05-01T08:30:00Z, name the manifest with the rule of its file \
                     name by --manifest, or use --method static",
                ),
        )
    }
}

/// The nearest folder above `file` whose index names it.
fn index_folder(file: &Path) -> Option<&Path> {
    let name = file.file_name()?.as_encoded_bytes();
    file.ancestors().skip(1).find(|folder| {
        let index = std::fs::read(folder.join(INDEX));
        index.is_ok_and(|index| index.windows(name.len()).any(|window| window == name))
    })
}

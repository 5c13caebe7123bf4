//! Which files are the images of which place and time?
//!
//! Every layout hands what it finds to one [`Collector`], which applies the rules about single entries
//! (file there, crop inside, no second image of a place and time, place known) alike.

mod index;
mod nclt;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::dataset::file_image::FileImage;
use crate::dataset::manifest::{default_folder_prefix, default_index, default_place_prefix};
use crate::dataset::{Clock, Dataset, Entry, Layout, Manifest, Problem};
use crate::feature::Rect;
use crate::map::{Edge, PlaceKey};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// File name extensions of images, in order of preference.
const IMAGE_EXTENSIONS: [&str; 10] = [
    "ppm", "png", "webp", "jpg", "jpeg", "bmp", "tiff", "tif", "pgm", "pnm",
];

/// The folders of a FreLoc dataset.
const FRELOC_FOLDERS: [&str; 2] = ["training", "testing"];

pub(in crate::dataset) fn open(manifest: &Manifest, data_dir: &Path) -> Result<Dataset> {
    let root = manifest.find_data(data_dir)?;
    let layout = manifest
        .layout
        .iter()
        .find(|layout| layout.is_in(&root))
        .ok_or_else(|| {
            Error::new(ErrorKind::Format, "the folder changed while it was read").with_path(&root)
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
    let mut collector = Collector::new(manifest, &root);
    match layout {
        Layout::Index { file } => index::read(&mut collector, file)?,
        Layout::Grief { place_prefix } => read_grief(&mut collector, place_prefix)?,
        Layout::FreLoc {
            origins,
            place_prefix,
            first_place,
        } => read_freloc(&mut collector, origins, |number| {
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
pub(in crate::dataset) fn detect(dir: &Path) -> Result<(Layout, Clock)> {
    let index = Layout::Index {
        file: default_index(),
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
            Self::Index { file } => dir.join(file).is_file(),
            Self::Grief { .. } => grief_folder(dir).is_some(),
            Self::FreLoc { .. } => FRELOC_FOLDERS.iter().any(|folder| {
                list(&dir.join(folder)).is_ok_and(|paths| {
                    paths
                        .iter()
                        .any(|path| path.is_dir() && place_number(&name_of(path)).is_some())
                })
            }),
            Self::Nclt { .. } => nclt::sessions(dir).is_ok_and(|sessions| !sessions.is_empty()),
        }
    }

    /// What [`is_in`](Self::is_in) looks for, for people.
    pub(in crate::dataset) fn wanted(&self) -> String {
        match self {
            Self::Index { file } => format!("`{file}`"),
            Self::Grief { .. } => "images MMLL.{ppm,png,webp,jpg}".into(),
            Self::FreLoc { .. } => "`training/place_N` or `testing/place_N`".into(),
            Self::Nclt { .. } => "`images/YYYY-MM-DD/lb3`".into(),
        }
    }
}

/// Gathers entries and what is wrong with those left out.
pub(in crate::dataset) struct Collector<'a> {
    pub(in crate::dataset) manifest: &'a Manifest,
    pub(in crate::dataset) root: &'a Path,
    pub(in crate::dataset) edges: Vec<Edge>,
    pub(in crate::dataset) poses: BTreeMap<PlaceKey, [f64; 3]>,
    entries: Vec<Found>,
    problems: Vec<Problem>,
    /// Where the entry of this place and time was found.
    seen: BTreeMap<(PlaceKey, Time), String>,
    /// Sizes of files whose crops were checked.
    sizes: BTreeMap<PathBuf, Result<(u32, u32), String>>,
}

struct Found {
    place: PlaceKey,
    time: Time,
    path: String,
    source: FileImage,
}

impl<'a> Collector<'a> {
    fn new(manifest: &'a Manifest, root: &'a Path) -> Self {
        Self {
            manifest,
            root,
            edges: Vec::new(),
            poses: BTreeMap::new(),
            entries: Vec::new(),
            problems: Vec::new(),
            seen: BTreeMap::new(),
            sizes: BTreeMap::new(),
        }
    }

    /// Lists something that is left out.
    pub(in crate::dataset) fn problem(
        &mut self,
        subject: impl Into<String>,
        message: impl Into<String>,
    ) {
        self.problems.push(Problem {
            subject: subject.into(),
            message: message.into(),
        });
    }

    /// Adds the image `path` (relative to the dataset's folder), found at `subject`, or lists why not.
    /// `prepare` sets crop, turn and scale.
    pub(in crate::dataset) fn add(
        &mut self,
        subject: &str,
        place: &PlaceKey,
        time: Time,
        path: &str,
        prepare: impl FnOnce(FileImage) -> FileImage,
    ) {
        let masks = self.manifest.masks_of(place);
        let source = prepare(FileImage::new(self.root.join(path)).with_masks(masks));
        let places = &self.manifest.places;
        if !places.is_empty() && !places.contains(place) {
            let known: Vec<_> = places.iter().map(PlaceKey::as_str).collect();
            return self.problem(
                subject,
                format!(
                    "the place `{place}` is not in the manifest (help: correct it, or add it to `places`, which has {})",
                    known.join(", ")
                ),
            );
        }
        if let Err(message) = check_file(source.file(), path) {
            return self.problem(subject, message);
        }
        if let Some(crop) = source.crop()
            && let Err(message) = self.check_crop(source.file(), path, crop)
        {
            return self.problem(subject, message);
        }
        if let Some(first) = self.seen.get(&(place.clone(), time)) {
            let message = format!(
                "a second image of `{place}` at {time}; {first} is kept (help: correct the place or the time, or remove one)"
            );
            return self.problem(subject, message);
        }
        self.seen.insert((place.clone(), time), subject.to_owned());
        self.entries.push(Found {
            place: place.clone(),
            time,
            path: path.to_owned(),
            source,
        });
    }

    fn check_crop(&mut self, file: &Path, path: &str, crop: Rect) -> Result<(), String> {
        let size = self
            .sizes
            .entry(file.to_owned())
            .or_insert_with(|| FileImage::picture_size(file).map_err(|error| error.to_string()))
            .clone();
        let (width, height) = size?;
        let fits = |start: u32, length: u32, size: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= size)
        };
        if fits(crop.x, crop.width, width) && fits(crop.y, crop.height, height) {
            return Ok(());
        }
        Err(outside_message(
            &format!("{},{},{},{}", crop.x, crop.y, crop.width, crop.height),
            path,
            Some((width, height)),
        ))
    }

    fn finish(mut self) -> Result<Dataset> {
        if self.entries.is_empty() {
            let error = match self.problems.first() {
                None => Error::new(ErrorKind::Format, "the dataset has no image"),
                Some(first) => Error::new(
                    ErrorKind::Format,
                    format!(
                        "no image is left: {} left out, the first because of {first}",
                        self.problems.len()
                    ),
                ),
            };
            return Err(error
                .with_path(self.root)
                .with_help("see that the folder is the dataset's and is complete"));
        }
        let entries = self.entries();
        let places: Vec<PlaceKey> = {
            let mut places: Vec<_> = entries.iter().map(|entry| entry.place.clone()).collect();
            places.sort_unstable();
            places.dedup();
            places
        };
        for place in &self.manifest.places {
            if places.binary_search(place).is_err() {
                self.problems.push(Problem {
                    subject: self.manifest.name.clone(),
                    message: format!(
                        "there is no image of the place `{place}` (help: complete the data)"
                    ),
                });
            }
        }
        let known = |place: &PlaceKey| places.binary_search(place).is_ok();
        for edge in std::mem::take(&mut self.edges) {
            if let Some(missing) = [&edge.from, &edge.to].into_iter().find(|end| !known(end)) {
                let message = format!(
                    "there is no image of the place `{missing}` (help: correct the name or remove the edge)"
                );
                self.problem(format!("edge {} -> {}", edge.from, edge.to), message);
            } else {
                self.edges.push(edge);
            }
        }
        for (place, pose) in std::mem::take(&mut self.poses) {
            if known(&place) {
                self.poses.insert(place, pose);
            } else {
                let message =
                    "there is no image of this place (help: correct the name or remove the pose)";
                self.problem(format!("pose of `{place}`"), message);
            }
        }
        Ok(Dataset {
            name: self.manifest.name.clone(),
            clock: self.manifest.time.clock,
            entries,
            edges: self.edges,
            poses: self.poses,
            problems: self.problems,
        })
    }

    /// The entries with their ids, sorted.
    ///
    /// An id is the path; where several entries share the file, also the place; where even those are
    /// the same, also the time.
    fn entries(&mut self) -> Vec<Entry> {
        let mut by_path: BTreeMap<String, usize> = BTreeMap::new();
        let mut by_place: BTreeMap<(String, PlaceKey), usize> = BTreeMap::new();
        for found in &self.entries {
            *by_path.entry(found.path.clone()).or_default() += 1;
            *by_place
                .entry((found.path.clone(), found.place.clone()))
                .or_default() += 1;
        }
        let mut entries: Vec<Entry> = std::mem::take(&mut self.entries)
            .into_iter()
            .map(|found| {
                let mut id = found.path.clone();
                if by_path[&found.path] > 1 || found.source.crop().is_some() {
                    id = format!("{id}@{}", found.place);
                }
                if by_place[&(found.path, found.place.clone())] > 1 {
                    id = format!("{id}@{}", found.time);
                }
                Entry {
                    place: found.place,
                    time: found.time,
                    id,
                    source: Arc::new(found.source),
                }
            })
            .collect();
        entries.sort_by(|a, b| (a.time, &a.place, &a.id).cmp(&(b.time, &b.place, &b.id)));
        // A file may be called like another one's id.
        let mut ids = BTreeSet::new();
        for entry in &mut entries {
            while !ids.insert(entry.id.clone()) {
                entry.id.push('+');
            }
        }
        entries
    }
}

/// Says that a crop (as written) is not inside its image.
pub(in crate::dataset) fn outside_message(
    crop: &str,
    path: &str,
    size: Option<(u32, u32)>,
) -> String {
    let size = size.map_or_else(String::new, |(width, height)| {
        format!(" of {width} x {height} px")
    });
    format!(
        "the crop {crop} (x,y,w,h) is not inside the image `{path}`{size} (help: correct crop_x, crop_y, crop_w and crop_h)"
    )
}

fn check_file(file: &Path, path: &str) -> Result<(), String> {
    match fs::metadata(file) {
        Ok(meta) if meta.is_dir() => Err(format!(
            "`{path}` is a folder, not an image (help: write the path of a file)"
        )),
        // The length of a pipe is not known.
        Ok(meta) if meta.is_file() && meta.len() == 0 => Err(format!(
            "the file `{path}` is empty, 0 bytes (help: copy it again or remove its row)"
        )),
        Ok(_) => Ok(()),
        Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => Err(format!(
            "the file `{path}` does not exist (help: restore it, correct the path or remove the row)"
        )),
        Err(cause) => Err(format!("the file `{path}` cannot be read: {cause}")),
    }
}

fn read_grief(collector: &mut Collector<'_>, place_prefix: &str) -> Result<()> {
    let Some(folder) = grief_folder(collector.root) else {
        return Ok(());
    };
    for path in list(&folder)? {
        let subject = relative(collector.root, &path);
        if path.is_dir() || image_rank(&path).is_none() {
            continue;
        }
        let stem = stem_of(&path);
        let Some((visit, place)) = grief_numbers(&stem) else {
            collector.problem(
                &subject,
                "the name is not MMLL, visit and place with two digits each (help: rename or move it)",
            );
            continue;
        };
        let place = PlaceKey::new(&format!("{place_prefix}{place}"))?;
        let Some(time) = collector.manifest.time.of_visit(visit) else {
            return Err(no_time(&path, visit));
        };
        collector.add(&subject, &place, time, &subject, |image| image);
    }
    Ok(())
}

fn read_freloc(
    collector: &mut Collector<'_>,
    origins: &BTreeMap<String, Time>,
    key: impl Fn(i64) -> Result<PlaceKey>,
) -> Result<()> {
    for folder in FRELOC_FOLDERS {
        let top = collector.root.join(folder);
        if !top.is_dir() {
            continue;
        }
        let time_rule = &collector.manifest.time;
        let origin = origins
            .get(folder)
            .copied()
            .or(time_rule.origin)
            .ok_or_else(|| {
                Error::new(ErrorKind::Config, "no time is given for image 0")
                    .with_path(&top)
                    .with_help("write origin under [time] of the manifest")
            })?;
        for place_dir in list(&top)? {
            if !place_dir.is_dir() {
                continue;
            }
            let Some(number) = place_number(&name_of(&place_dir)) else {
                let subject = relative(collector.root, &place_dir);
                collector.problem(
                    subject,
                    "the folder is not called place_N (help: rename or move it)",
                );
                continue;
            };
            let place = key(number)?;
            for path in list(&place_dir)? {
                if path.is_dir() || image_rank(&path).is_none() {
                    continue;
                }
                let subject = relative(collector.root, &path);
                let stem = stem_of(&path);
                let number: Option<i64> = (stem.len() >= 5).then(|| digits(&stem)).flatten();
                let Some(number) = number else {
                    collector.problem(
                        &subject,
                        "the name is not the number of the image with five digits, as in 00042.bmp (help: rename or move it)",
                    );
                    continue;
                };
                let time_rule = &collector.manifest.time;
                let Some(time) = time_rule.of_number(origin, number) else {
                    return Err(no_time(&path, number));
                };
                collector.add(&subject, &place, time, &subject, |image| image);
            }
        }
    }
    Ok(())
}

fn no_time(path: &Path, number: i64) -> Error {
    Error::new(
        ErrorKind::Time,
        format!("visit number {number} is beyond the calendar"),
    )
    .with_path(path)
    .with_help("correct origin and quantum under [time] of the manifest")
}

/// The folder with `MMLL` images: `dir/images` or `dir`.
fn grief_folder(dir: &Path) -> Option<PathBuf> {
    [dir.join("images"), dir.to_owned()]
        .into_iter()
        .find(|folder| {
            list(folder).is_ok_and(|paths| {
                paths.iter().any(|path| {
                    image_rank(path).is_some() && grief_numbers(&stem_of(path)).is_some()
                })
            })
        })
}

/// Visit and place of `MMLL`.
fn grief_numbers(stem: &str) -> Option<(i64, i64)> {
    let number = (stem.len() == 4).then(|| digits(stem)).flatten()?;
    Some((number / 100, number % 100))
}

fn place_number(name: &str) -> Option<i64> {
    digits(name.strip_prefix("place_")?)
}

/// The number that `text` is in decimal digits alone.
pub(in crate::dataset) fn digits(text: &str) -> Option<i64> {
    (!text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit()))
        .then(|| text.parse().ok())
        .flatten()
}

/// Position of the file's extension in [`IMAGE_EXTENSIONS`].
pub(in crate::dataset) fn image_rank(path: &Path) -> Option<usize> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    IMAGE_EXTENSIONS
        .iter()
        .position(|&known| known == extension)
}

pub(in crate::dataset) fn name_of(path: &Path) -> String {
    path.file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

pub(in crate::dataset) fn stem_of(path: &Path) -> String {
    path.file_stem()
        .map(|stem| stem.to_string_lossy().into_owned())
        .unwrap_or_default()
}

/// `path` relative to `root`, with `/` between folders on every system.
pub(in crate::dataset) fn relative(root: &Path, path: &Path) -> String {
    let relative = path.strip_prefix(root).unwrap_or(path);
    let parts: Vec<_> = relative
        .components()
        .map(|part| part.as_os_str().to_string_lossy())
        .collect();
    parts.join("/")
}

/// What is in a folder: sorted by name without extension, then by preference of extension.
pub(in crate::dataset) fn list(dir: &Path) -> Result<Vec<PathBuf>> {
    let io = |cause: std::io::Error| Error::io(dir, cause);
    let mut paths = fs::read_dir(dir)
        .map_err(io)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<std::io::Result<Vec<_>>>()
        .map_err(io)?;
    paths.sort_by_cached_key(|path| (stem_of(path), image_rank(path), name_of(path)));
    Ok(paths)
}

//! Which of the images that a layout finds can be used?

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::dataset::file_image::FileImage;
use crate::dataset::manifest::Manifest;
use crate::dataset::types::{Dataset, Entry, Problem, ReadOptions};
use crate::feature::{Rect, picture_size};
use crate::map::{Edge, PlaceKey};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// Gathers entries and what is wrong with those left out.
pub(super) struct Collector<'a> {
    pub(super) manifest: &'a Manifest,
    pub(super) root: &'a Path,
    pub(super) options: &'a ReadOptions,
    pub(super) edges: Vec<Edge>,
    pub(super) poses: BTreeMap<PlaceKey, [f64; 3]>,
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
    pub(super) fn new(manifest: &'a Manifest, root: &'a Path, options: &'a ReadOptions) -> Self {
        Self {
            manifest,
            root,
            options,
            edges: Vec::new(),
            poses: BTreeMap::new(),
            entries: Vec::new(),
            problems: Vec::new(),
            seen: BTreeMap::new(),
            sizes: BTreeMap::new(),
        }
    }

    /// Lists something that is left out.
    pub(super) fn problem(&mut self, subject: impl Into<String>, message: impl Into<String>) {
        self.problems.push(Problem::new(subject, message));
    }

    /// Lists an image `path` (relative to the dataset's folder) that is left out.
    pub(super) fn image_problem(
        &mut self,
        subject: impl Into<String>,
        message: impl Into<String>,
        path: &str,
    ) {
        let file = self.root.join(path);
        self.problems
            .push(Problem::new(subject, message).with_file(file));
    }

    /// Adds the image `path` (relative to the dataset's folder), found at `subject`, or lists why
    /// not. `prepare` sets crop, turn and scale.
    pub(super) fn add(
        &mut self,
        subject: &str,
        place: &PlaceKey,
        time: Time,
        path: &str,
        prepare: impl FnOnce(FileImage) -> FileImage,
    ) {
        let picture = self.manifest.picture(&self.root.join(path), Some(place));
        let source = prepare(picture.with_limits(self.options.limits));
        let places = &self.manifest.places;
        if !places.is_empty() && !places.contains(place) {
            let known: Vec<_> = places.iter().map(PlaceKey::as_str).collect();
            return self.image_problem(
                subject,
                format!(
                    "the place `{place}` is not in the manifest (help: correct it, or add it to `places`, which has {})",
                    known.join(", ")
                ),
                path,
            );
        }
        if let Err(message) = check_file(source.file(), path) {
            return self.image_problem(subject, message, path);
        }
        if let Some(crop) = source.crop()
            && let Err(message) = self.check_crop(source.file(), path, crop)
        {
            return self.image_problem(subject, message, path);
        }
        if let Some(first) = self.seen.get(&(place.clone(), time)) {
            let message = format!(
                "a second image of `{place}` at {time}; {first} is kept (help: correct the place or the time, or remove one)"
            );
            return self.image_problem(subject, message, path);
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
        let limits = self.options.limits;
        let size = self
            .sizes
            .entry(file.to_owned())
            .or_insert_with(|| picture_size(file, &limits).map_err(|error| error.to_string()))
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

    pub(super) fn finish(mut self) -> Result<Dataset> {
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
                self.problems.push(Problem::new(
                    &self.manifest.name,
                    format!("there is no image of the place `{place}` (help: complete the data)"),
                ));
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
            zone: match &self.options.zone {
                Some(zone) => Some(zone.name().to_owned()),
                None => self.manifest.time.zone.clone(),
            },
            image_size: self
                .manifest
                .image_size
                .map(|[width, height]| (width, height)),
            entries,
            edges: self.edges,
            poses: self.poses,
            problems: self.problems,
        })
    }

    /// The entries with their ids, sorted.
    ///
    /// An id is the path; where several entries share the file, also the place; where even those
    /// are the same, also the time.
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
pub(super) fn outside_message(crop: &str, path: &str, size: Option<(u32, u32)>) -> String {
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
        Ok(meta) if !meta.is_file() => Err(format!(
            "`{path}` is a pipe or a device, not a file (help: write it to a file first)"
        )),
        Ok(meta) if meta.len() == 0 => Err(format!(
            "the file `{path}` is empty, 0 bytes (help: copy it again or remove its row)"
        )),
        Ok(_) => Ok(()),
        Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => Err(format!(
            "the file `{path}` does not exist (help: restore it, correct the path or remove the row)"
        )),
        Err(cause) => Err(format!("the file `{path}` cannot be read: {cause}")),
    }
}

/// A visit number that no time belongs to.
pub(super) fn no_time(path: &Path, number: i64) -> Error {
    Error::new(
        ErrorKind::Time,
        format!("visit number {number} is beyond the calendar"),
    )
    .with_path(path)
    .with_help("correct origin and quantum under [time] of the manifest")
}

//! Which index does a folder in somebody else's layout need?
//!
//! - `folders`: a folder for each place, images in it; times from EXIF, or from names by a pattern;
//! - `file-names`: places and times from names by a pattern that has `{place}`;
//! - `robotcar` (Oxford): `<µs>.png` of one camera and `gps/ins.csv` (or `ins.csv`) with northing
//!   and easting, in the camera's folder or above it;
//! - `tum` (RGB-D): `rgb.txt` and `groundtruth.txt`, rows of a time in s and a file or a pose;
//! - `euroc`: `mav0/cam0/data.csv` and `mav0/state_groundtruth_estimate0/data.csv`, times in ns.
//!
//! The last three have poses and no places: an image without a place within the radius of its pose
//! begins one, in order of time, called `p0000` and so on. An image has the pose nearest in time.
//!
//! Nothing is written here: an index is text that somebody reads before using it.

use std::collections::BTreeSet;
use std::path::Path;

use super::capture::exif_time;
use super::file_name::{Moment, NamePattern};
use super::paths::{image_rank, list, name_of, relative, stem_of};
use super::table::{MAX_TABLE_BYTES, read_text};
use super::types::Problem;
use crate::map::PlaceKey;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Time, TimeUnit, Zone};

/// A pose further in time from an image than this is not its own, s.
const MAX_POSE_GAP_S: f64 = 0.5;
/// Deeper folders are not looked into.
const MAX_DEPTH: usize = 8;

/// A layout that an index can be made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum IndexSource {
    /// A folder for each place.
    Folders,
    /// Places and times in names.
    FileNames,
    /// Oxford's `RobotCar`.
    RobotCar,
    /// TUM RGB-D.
    Tum,
    /// The `EuRoC` MAV set.
    Euroc,
}

impl IndexSource {
    /// Every layout.
    pub const ALL: [Self; 5] = [
        Self::Folders,
        Self::FileNames,
        Self::RobotCar,
        Self::Tum,
        Self::Euroc,
    ];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Folders => "folders",
            Self::FileNames => "file-names",
            Self::RobotCar => "robotcar",
            Self::Tum => "tum",
            Self::Euroc => "euroc",
        }
    }
}

impl std::str::FromStr for IndexSource {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        (Self::ALL.into_iter())
            .find(|source| source.name() == name)
            .ok_or_else(|| {
                Error::new(ErrorKind::Config, format!("no layout is called `{name}`"))
                    .with_help(format!("choose {}", Self::ALL.map(Self::name).join(", ")))
            })
    }
}

/// What a layout leaves open.
#[derive(Clone, Debug)]
pub struct IndexOptions {
    /// Of names of files, as in a manifest: `{place}_{unix_s}`.
    pub pattern: Option<String>,
    /// The zone of dates without an offset.
    pub zone: Option<Zone>,
    /// How near to each other images of one place were taken, m.
    pub radius_m: f64,
}

/// An index, and what is not in it.
#[derive(Clone, Debug, Default)]
pub struct MadeIndex {
    rows: Vec<Row>,
    /// Images that are left out.
    pub problems: Vec<Problem>,
}

#[derive(Clone, Debug)]
struct Row {
    place: PlaceKey,
    time: Time,
    path: String,
    position: Option<[f64; 2]>,
}

impl MadeIndex {
    /// Makes the index of `dir`.
    ///
    /// Fails if the layout is not there, a file of it cannot be read, or no image is left.
    pub fn of(dir: &Path, source: IndexSource, options: &IndexOptions) -> Result<Self> {
        if !(options.radius_m.is_finite() && options.radius_m > 0.0) {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "a radius is a positive number of metres, not {}",
                    options.radius_m
                ),
            ));
        }
        let mut made = Self::default();
        match source {
            IndexSource::Folders | IndexSource::FileNames => {
                made.read_folders(dir, source == IndexSource::FileNames, options)?;
            }
            IndexSource::RobotCar => made.place(robotcar(dir)?, options.radius_m)?,
            IndexSource::Tum => made.place(tum(dir)?, options.radius_m)?,
            IndexSource::Euroc => made.place(euroc(dir)?, options.radius_m)?,
        }
        if made.rows.is_empty() {
            let why = made
                .problems
                .first()
                .map_or_else(String::new, |it| format!(": {it}"));
            return Err(
                Error::new(ErrorKind::Format, format!("no image is left{why}"))
                    .with_path(dir)
                    .with_help("see that the folder has this layout"),
            );
        }
        made.rows
            .sort_by(|a, b| (a.time, &a.place, &a.path).cmp(&(b.time, &b.place, &b.path)));
        Ok(made)
    }

    /// How many images are in it.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether no image is in it.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The text of `index.csv`.
    pub fn to_csv(&self) -> Result<String> {
        let failed = |cause: String| Error::new(ErrorKind::Format, cause);
        let has_positions = self.rows.iter().all(|row| row.position.is_some());
        let mut writer = csv::Writer::from_writer(Vec::new());
        let header: &[&str] = if has_positions {
            &["place", "time", "path", "x", "y"]
        } else {
            &["place", "time", "path"]
        };
        writer
            .write_record(header)
            .map_err(|cause| failed(cause.to_string()))?;
        for row in &self.rows {
            let mut cells = vec![
                row.place.as_str().to_owned(),
                row.time.to_string(),
                row.path.clone(),
            ];
            if has_positions {
                cells.extend(
                    row.position
                        .iter()
                        .flatten()
                        .map(|value| format!("{value:.3}")),
                );
            }
            writer
                .write_record(cells)
                .map_err(|cause| failed(cause.to_string()))?;
        }
        let bytes = writer
            .into_inner()
            .map_err(|cause| failed(cause.to_string()))?;
        String::from_utf8(bytes).map_err(|cause| failed(cause.to_string()))
    }

    fn read_folders(&mut self, dir: &Path, by_name: bool, options: &IndexOptions) -> Result<()> {
        let pattern = options
            .pattern
            .as_deref()
            .map(NamePattern::parse)
            .transpose()?;
        if by_name && !pattern.as_ref().is_some_and(|pattern| pattern.has("place")) {
            return Err(Error::new(
                ErrorKind::Config,
                "names of files need a pattern with {place} and a time",
            )
            .with_help("an example: {place}_{unix_s}"));
        }
        for path in images_below(dir, 0)? {
            let name = relative(dir, &path);
            let folder = path.parent().filter(|folder| *folder != dir).map(name_of);
            let read = (pattern.as_ref()).and_then(|pattern| {
                pattern.read_with_place(&stem_of(&path), options.zone.as_ref())
            });
            let time = match (&read, by_name) {
                (Some((Moment::At(time), _)), _) => Some(*time),
                (_, true) => None,
                _ => match exif_time(&path, options.zone.as_ref()) {
                    Ok(time) => time,
                    Err(error) => {
                        self.problems.push(Problem::of(name, error).with_file(path));
                        continue;
                    }
                },
            };
            let place = match &read {
                Some((_, Some(place))) if by_name => Some(place.clone()),
                _ => folder.filter(|_| !by_name),
            };
            let (Some(time), Some(place)) = (time, place) else {
                let message = if by_name {
                    "its name does not fit the pattern (help: correct the pattern or move it away)"
                } else {
                    "no place or time: it must be in a folder that is called like its place, with a \
                     time in its EXIF data or its name (help: give --pattern or --zone)"
                };
                self.problems
                    .push(Problem::new(name, message).with_file(path));
                continue;
            };
            self.rows.push(Row {
                place: PlaceKey::written(&place)?,
                time,
                path: name,
                position: None,
            });
        }
        Ok(())
    }

    /// Gives the images of a way their places.
    fn place(&mut self, way: Way, radius_m: f64) -> Result<()> {
        let Way {
            mut images,
            mut poses,
        } = way;
        images.sort();
        poses.sort_by_key(|pose| pose.0);
        let mut centres: Vec<[f64; 2]> = Vec::new();
        for (time, path) in images {
            let next = poses.partition_point(|pose| pose.0 < time);
            let near = [next.checked_sub(1), Some(next)];
            let pose = (near.into_iter().flatten())
                .filter_map(|at| poses.get(at))
                .min_by(|a, b| a.0.since_s(time).abs().total_cmp(&b.0.since_s(time).abs()))
                .filter(|pose| pose.0.since_s(time).abs() <= MAX_POSE_GAP_S);
            let Some(&(_, position)) = pose else {
                let message = format!(
                    "there is no pose within {MAX_POSE_GAP_S} s (help: complete the ground truth)"
                );
                self.problems.push(Problem::new(path, message));
                continue;
            };
            let away = |centre: &[f64; 2]| (centre[0] - position[0]).hypot(centre[1] - position[1]);
            let nearest = (0..centres.len())
                .min_by(|&a, &b| away(&centres[a]).total_cmp(&away(&centres[b])))
                .filter(|&at| away(&centres[at]) <= radius_m);
            let at = nearest.unwrap_or_else(|| {
                centres.push(position);
                centres.len() - 1
            });
            self.rows.push(Row {
                place: PlaceKey::new(&format!("p{at:04}"))?,
                time,
                path,
                position: Some(position),
            });
        }
        Ok(())
    }
}

/// Images and poses of one drive.
struct Way {
    images: Vec<(Time, String)>,
    poses: Vec<(Time, [f64; 2])>,
}

fn images_below(dir: &Path, depth: usize) -> Result<Vec<std::path::PathBuf>> {
    let mut images = Vec::new();
    for path in list(dir)? {
        if path.is_dir() && depth < MAX_DEPTH {
            images.extend(images_below(&path, depth + 1)?);
        } else if image_rank(&path).is_some() {
            images.push(path);
        }
    }
    Ok(images)
}

/// A table of a layout.
fn read_table(path: &Path) -> Result<String> {
    read_text(path, MAX_TABLE_BYTES).map_err(|error| match error.kind() {
        ErrorKind::NotFound => error
            .with_help("the folder lacks this file of the layout: download it, or name another"),
        _ => error,
    })
}

fn robotcar(dir: &Path) -> Result<Way> {
    /// A camera of the stereo rig lies two folders below the drive.
    const MAX_ABOVE: usize = 3;
    let full = std::path::absolute(dir).map_err(|cause| Error::io(dir, cause))?;
    let there = (full.ancestors().take(MAX_ABOVE))
        .flat_map(|folder| ["gps/ins.csv", "ins.csv"].map(|name| folder.join(name)))
        .find(|path| path.is_file());
    let path = &there.unwrap_or_else(|| dir.join("gps/ins.csv"));
    let text = read_table(path)?;
    let header = text.lines().next().unwrap_or_default();
    let column = |name: &str| {
        header
            .split(',')
            .position(|cell| cell.trim() == name)
            .ok_or_else(|| {
                Error::new(ErrorKind::Format, format!("there is no column `{name}`"))
                    .with_path(path)
                    .with_place("line 1")
                    .with_help("give the ins.csv of the dataset")
            })
    };
    let (time, north, east) = (
        column("timestamp")?,
        column("northing")?,
        column("easting")?,
    );
    let poses = rows(path, &text, ',', 1, |cells| {
        let time = TimeUnit::Microseconds.time(cells.get(time)?).ok()?;
        Some((time, [number(cells, east)?, number(cells, north)?]))
    })?;
    let mut folders = BTreeSet::new();
    let mut images = Vec::new();
    for path in images_below(dir, 0)? {
        if let Ok(time) = TimeUnit::Microseconds.time(&stem_of(&path)) {
            images.push((time, relative(dir, &path)));
            folders.extend(path.parent().map(|folder| relative(dir, folder)));
        }
    }
    if folders.len() > 1 {
        // They look to different sides: as visits of one place they would be different places.
        let names: Vec<String> = folders.into_iter().collect();
        let message = format!("these are images of several cameras: {}", names.join(", "));
        return Err(Error::new(ErrorKind::Format, message)
            .with_path(dir)
            .with_help("name the folder of one of them"));
    }
    Ok(Way { images, poses })
}

fn tum(dir: &Path) -> Result<Way> {
    let read = |name: &str| {
        let path = dir.join(name);
        read_table(&path).map(|text| (path, text))
    };
    let (path, text) = read("groundtruth.txt")?;
    let poses = rows(&path, &text, ' ', 0, |cells| {
        let time = TimeUnit::Seconds.time(cells.first()?).ok()?;
        Some((time, [number(cells, 1)?, number(cells, 2)?]))
    })?;
    let (path, text) = read("rgb.txt")?;
    let images = rows(&path, &text, ' ', 0, |cells| {
        let time = TimeUnit::Seconds.time(cells.first()?).ok()?;
        Some((time, (*cells.get(1)?).to_owned()))
    })?;
    Ok(Way { images, poses })
}

fn euroc(dir: &Path) -> Result<Way> {
    // The archives unpack to `mav0`, which may have been named itself.
    let (dir, folder) = match dir.join("mav0") {
        inner if inner.is_dir() => (inner, "mav0/cam0/data"),
        _ => (dir.to_owned(), "cam0/data"),
    };
    let read = |name: &str| {
        let path = dir.join(name);
        read_table(&path).map(|text| (path, text))
    };
    let (path, text) = read("state_groundtruth_estimate0/data.csv")?;
    let poses = rows(&path, &text, ',', 0, |cells| {
        let time = TimeUnit::Nanoseconds.time(cells.first()?).ok()?;
        Some((time, [number(cells, 1)?, number(cells, 2)?]))
    })?;
    let (path, text) = read("cam0/data.csv")?;
    let images = rows(&path, &text, ',', 0, |cells| {
        let time = TimeUnit::Nanoseconds.time(cells.first()?).ok()?;
        Some((time, format!("{folder}/{}", cells.get(1)?)))
    })?;
    Ok(Way { images, poses })
}

/// What `read` makes of the rows of a table without its first lines, comments and empty lines.
fn rows<T>(
    path: &Path,
    text: &str,
    separator: char,
    num_headers: usize,
    read: impl Fn(&[&str]) -> Option<T>,
) -> Result<Vec<T>> {
    let lines = text.lines().enumerate().skip(num_headers);
    lines
        .map(|(number, line)| (number + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
        .map(|(number, line)| {
            let cells: Vec<&str> = if separator == ' ' {
                line.split_whitespace().collect()
            } else {
                line.split(separator).map(str::trim).collect()
            };
            read(&cells).ok_or_else(|| {
                Error::new(
                    ErrorKind::Format,
                    format!("`{line}` is no row of this table"),
                )
                .with_path(path)
                .with_place(format!("line {number}"))
                .with_help("download the file again")
            })
        })
        .collect()
}

fn number(cells: &[&str], at: usize) -> Option<f64> {
    let number: f64 = cells.get(at)?.parse().ok()?;
    number.is_finite().then_some(number)
}

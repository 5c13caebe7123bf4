//! What is this dataset, whose is it, and what do its files and times mean?
//!
//! A [`Manifest`] is a TOML file (schema: `datasets/README.md`). The manifests of the supported
//! datasets are part of the program, so that a dataset's name is enough to read it.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use jiff::{Span, Timestamp, tz::TimeZone};
use serde::{Deserialize, Deserializer};

use super::file_image::FileImage;
use super::file_name::{Moment, NamePattern};
use super::paths::file_sha256;
use super::table;
use super::types::{Clock, Entry};
use crate::feature::{Rect, Rotation};
use crate::map::PlaceKey;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Period, Time, Zone};

/// Bytes of a manifest, at most.
const MAX_BYTES: u64 = 1 << 20;

const BUILTIN: [(&str, &str); 8] = [
    (
        "datasets/stromovka.toml",
        include_str!("../../datasets/stromovka.toml"),
    ),
    (
        "datasets/michigan.toml",
        include_str!("../../datasets/michigan.toml"),
    ),
    (
        "datasets/witham_wharf.toml",
        include_str!("../../datasets/witham_wharf.toml"),
    ),
    (
        "datasets/lasvegas.toml",
        include_str!("../../datasets/lasvegas.toml"),
    ),
    (
        "datasets/tilde.toml",
        include_str!("../../datasets/tilde.toml"),
    ),
    (
        "datasets/floors.toml",
        include_str!("../../datasets/floors.toml"),
    ),
    (
        "datasets/corridor.toml",
        include_str!("../../datasets/corridor.toml"),
    ),
    (
        "datasets/nclt.toml",
        include_str!("../../datasets/nclt.toml"),
    ),
];

/// What a dataset is, and how to read it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Manifest {
    /// Short name for tables and commands.
    pub name: String,
    /// Other names it is known by.
    #[serde(default)]
    pub aliases: Vec<String>,
    /// One line for people.
    #[serde(default)]
    pub title: String,
    /// What to cite, as BibTeX.
    #[serde(default)]
    pub citation: String,
    /// Under which terms it may be used, as far as they are stated.
    #[serde(default)]
    pub licence: String,
    /// How to get it.
    #[serde(default)]
    pub obtain: String,
    /// What to know before believing a result.
    #[serde(default)]
    pub known_faults: Vec<String>,
    /// All places; an entry of any other is a [`Problem`](super::Problem). Empty: any place.
    #[serde(default)]
    pub places: Vec<PlaceKey>,
    /// Columns and rows of its images after turning, cutting and resizing; those of most images, if
    /// not given.
    #[serde(default)]
    pub image_size: Option<[u32; 2]>,
    /// Where the data is, relative to the manifest; its own folder if not given.
    #[serde(default)]
    pub data: Option<PathBuf>,
    /// What its times mean.
    pub time: TimeRule,
    /// How its files are arranged; the first that fits the folder is used.
    #[serde(default = "default_layout")]
    pub layout: Vec<Layout>,
    /// Which part is for learning and which for queries.
    #[serde(default)]
    pub split: Option<Split>,
    /// Rectangles that must not be used, such as burnt-in text.
    #[serde(default)]
    pub mask: Vec<Mask>,
    /// What intact data has.
    #[serde(default)]
    pub checksums: Checksums,
}

/// What the times of a dataset mean.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct TimeRule {
    /// Whether rhythms can be learnt.
    pub clock: Clock,
    /// The time of visit number [`first_visit`](Self::first_visit).
    #[serde(default, deserialize_with = "optional_time")]
    pub origin: Option<Time>,
    /// The time from one visit number to the next.
    #[serde(default)]
    pub quantum: Option<Quantum>,
    /// The number of the visit at the origin.
    #[serde(default)]
    pub first_visit: i64,
    /// Pattern of image file names that contain a time.
    #[serde(default)]
    pub file_name: Option<String>,
    /// The longest rhythm worth looking for first.
    #[serde(default, deserialize_with = "optional_period")]
    pub base_period: Option<Period>,
    /// IANA zone whose civil time people live by there.
    #[serde(default)]
    pub zone: Option<String>,
    /// Zones of places that live by another time.
    #[serde(default)]
    pub place_zones: BTreeMap<PlaceKey, String>,
}

/// The time between two visit numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantum {
    /// So many seconds.
    Seconds(u32),
    /// So many calendar months.
    Months(u32),
}

/// How the files of a dataset are arranged.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
#[non_exhaustive]
pub enum Layout {
    /// A CSV file with `place,time,path` and more; see `datasets/README.md`.
    Index {
        /// Its name.
        #[serde(default = "default_index")]
        file: String,
        /// Columns that are for people: they may be there and mean nothing here.
        #[serde(default)]
        ignore: Vec<String>,
    },
    /// `MMLL.{ppm,png,webp,jpg}`: visit MM of place LL.
    Grief {
        /// What precedes the place's number in its name.
        #[serde(default = "default_place_prefix")]
        place_prefix: String,
    },
    /// `training/place_N/00042.bmp`: image number times quantum after the folder's origin.
    FreLoc {
        /// Origins of single folders: `training` and `testing` have [`TimeRule::origin`] unless
        /// given.
        #[serde(default, deserialize_with = "time_map")]
        origins: BTreeMap<String, Time>,
        /// What precedes the place's number in its name.
        #[serde(default = "default_folder_prefix")]
        place_prefix: String,
        /// The number of the place in the folder `place_0`.
        #[serde(default)]
        first_place: u32,
    },
    /// `images/YYYY-MM-DD/lb3/CamN/<utime>.tiff` and `groundtruth_YYYY-MM-DD.csv`.
    Nclt {
        /// Which of the six cameras.
        camera: u8,
        /// A visit is a pass within this distance of a place, in metres.
        radius_m: f64,
        /// An image further in time than this from any pose is left out, in seconds.
        #[serde(default = "default_pose_gap_s")]
        max_pose_gap_s: f64,
        /// How the raw images must be turned to stand upright, clockwise.
        #[serde(
            default = "default_rotation",
            deserialize_with = "rotation",
            rename = "turn_degrees"
        )]
        rotation: Rotation,
        /// The places.
        #[serde(default)]
        place: Vec<NcltPlace>,
        /// Instead of places: one every so many metres along the earliest session with poses.
        #[serde(default)]
        spacing_m: Option<f64>,
    },
}

/// A place of an NCLT session, in the frame of its ground truth.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NcltPlace {
    /// Its name.
    pub key: PlaceKey,
    /// North, m.
    pub x: f64,
    /// East, m.
    pub y: f64,
    /// Down, m; not compared.
    #[serde(default)]
    pub z: f64,
    /// Which way the robot faces, degrees; any way if not given.
    #[serde(default)]
    pub heading_deg: Option<f64>,
}

/// Which part is for learning and which for queries.
///
/// Either by time (`learn_until`, `query_from`) or by folder (`learn_folder`, `query_folder`).
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Split {
    /// Earlier entries are for learning.
    #[serde(default, deserialize_with = "optional_time")]
    pub learn_until: Option<Time>,
    /// Entries at or after this are queries.
    #[serde(default, deserialize_with = "optional_time")]
    pub query_from: Option<Time>,
    /// Entries whose id starts with this folder are for learning.
    #[serde(default)]
    pub learn_folder: Option<String>,
    /// Entries whose id starts with this folder are queries.
    #[serde(default)]
    pub query_folder: Option<String>,
}

/// What an entry is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The map is built from it.
    Learn,
    /// It is located.
    Query,
}

impl Split {
    /// What `entry` is used for, if for anything.
    pub fn side(&self, entry: &Entry) -> Option<Side> {
        let under = |folder: &Option<String>| {
            folder.as_ref().is_some_and(|folder| {
                Path::new(&entry.id).starts_with(folder.trim_end_matches('/'))
            })
        };
        if self.learn_until.is_some_and(|end| entry.time < end) || under(&self.learn_folder) {
            Some(Side::Learn)
        } else if self.query_from.is_some_and(|start| entry.time >= start)
            || under(&self.query_folder)
        {
            Some(Side::Query)
        } else {
            None
        }
    }
}

/// A rectangle of the pictures that must not be used.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mask {
    /// Only in images of this place.
    #[serde(default)]
    pub place: Option<PlaceKey>,
    /// Leftmost column of the turned picture, before cutting and resizing, px.
    pub x: u32,
    /// Topmost row, px.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// What intact data has; SHA-256 in hexadecimal.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Checksums {
    /// Which copy they are of.
    #[serde(default)]
    pub of: String,
    /// Of the index file.
    #[serde(default)]
    pub index: Option<String>,
    /// Of the output of `sha256sum` over all image files in order of their paths.
    #[serde(default)]
    pub files: Option<String>,
}

impl Manifest {
    /// Reads and checks a manifest file.
    pub fn load(path: &Path) -> Result<Self> {
        Self::parse(&table::read_text(path, MAX_BYTES)?, path)
    }

    /// The manifest of a supported dataset by its name or another name it has.
    pub fn find_builtin(name: &str) -> Result<Self> {
        let mut names = Vec::new();
        for manifest in Self::builtin() {
            let manifest = manifest?;
            if manifest.name == name || manifest.aliases.iter().any(|alias| alias == name) {
                return Ok(manifest);
            }
            names.push(manifest.name);
        }
        Err(Error::new(
            ErrorKind::NotFound,
            format!("no supported dataset is called `{name}`"),
        )
        .with_help(format!(
            "choose one of {}, or give a folder with an index.csv or a manifest",
            names.join(", ")
        )))
    }

    /// The manifests that are part of the program.
    pub fn builtin() -> impl Iterator<Item = Result<Self>> {
        BUILTIN
            .iter()
            .map(|(path, text)| Self::parse(text, Path::new(path)))
    }

    /// The supported dataset whose index file `data_dir` contains, byte for byte.
    pub fn recognise(data_dir: &Path) -> Result<Option<Self>> {
        for manifest in Self::builtin() {
            let manifest = manifest?;
            let (Some(expected), Some(index)) = (&manifest.checksums.index, manifest.index_file())
            else {
                continue;
            };
            let index = data_dir.join(index);
            if index.is_file() && file_sha256(&index)? == *expected {
                return Ok(Some(manifest));
            }
        }
        Ok(None)
    }

    /// When an image with this file name was taken, by the rule of the manifest.
    pub fn time_from_name(&self, file_name: &str) -> Option<Time> {
        self.time_from_name_in(file_name, None)
    }

    /// [`time_from_name`](Self::time_from_name), where dates in names are of `zone`, not UTC.
    pub fn time_from_name_in(&self, file_name: &str, zone: Option<&Zone>) -> Option<Time> {
        let stem = Path::new(file_name).file_stem()?.to_str()?;
        // Checked when the manifest was read.
        let pattern = NamePattern::parse(self.file_name_rule()?).ok()?;
        match pattern.read(stem, zone)? {
            Moment::At(time) => Some(time),
            Moment::Visit(number) => self.time.of_visit(number),
        }
    }

    /// The IANA zone whose civil time people live by at `place`, where known.
    pub fn zone_of(&self, place: &PlaceKey) -> Option<&str> {
        self.time
            .place_zones
            .get(place)
            .or(self.time.zone.as_ref())
            .map(String::as_str)
    }

    pub(super) fn index_file(&self) -> Option<&str> {
        self.layout.iter().find_map(|layout| match layout {
            Layout::Index { file, .. } => Some(file.as_str()),
            _ => None,
        })
    }

    /// The image at `path` as images of this dataset are read: turned as its layout says, without
    /// what its masks hide, of `place` where that is known.
    ///
    /// This is the one place that knows; what an index says of single images comes on top. Of several
    /// layouts only the data show which one it is, so nothing is turned.
    #[must_use]
    pub fn picture(&self, path: &Path, place: Option<&PlaceKey>) -> FileImage {
        let rotation = match &self.layout[..] {
            [Layout::Nclt { rotation, .. }] => *rotation,
            _ => Rotation::None,
        };
        let counts = |mask: &&Mask| mask.place.is_none() || mask.place.as_ref() == place;
        let masks = self.mask.iter().filter(counts).map(|mask| Rect {
            x: mask.x,
            y: mask.y,
            width: mask.width,
            height: mask.height,
        });
        FileImage::new(path)
            .with_rotation(rotation)
            .with_masks(masks.collect())
    }

    /// The rule by which names of image files say a time: the manifest's, or that of its layout.
    pub fn file_name_rule(&self) -> Option<&str> {
        let is_nclt = |layout: &Layout| matches!(layout, Layout::Nclt { .. });
        match &self.time.file_name {
            Some(rule) => Some(rule),
            None if self.layout.iter().any(is_nclt) => Some("{unix_us}"),
            None => None,
        }
    }

    fn parse(text: &str, path: &Path) -> Result<Self> {
        let mut manifest: Self = toml::from_str(text).map_err(|cause| {
            let error = Error::new(ErrorKind::Format, cause.message().trim())
                .with_path(path)
                .with_help("datasets/README.md lists every key of a manifest");
            match cause.span() {
                Some(span) => {
                    let line = table::line_at(text.as_bytes(), span.start);
                    error.with_place(format!("line {line}"))
                }
                None => error,
            }
        })?;
        (manifest.compose_names())
            .and_then(|()| manifest.validate())
            .map_err(|error| error.with_path(path))?;
        Ok(manifest)
    }

    /// Names of places as [`PlaceKey::written`] has them, which the index's are, too.
    fn compose_names(&mut self) -> Result<()> {
        let compose = |key: &mut PlaceKey| -> Result<()> {
            *key = PlaceKey::written(key.as_str())?;
            Ok(())
        };
        self.places.iter_mut().try_for_each(compose)?;
        (self.mask.iter_mut().filter_map(|mask| mask.place.as_mut())).try_for_each(compose)?;
        for layout in &mut self.layout {
            if let Layout::Nclt { place, .. } = layout {
                place
                    .iter_mut()
                    .map(|place| &mut place.key)
                    .try_for_each(compose)?;
            }
        }
        let zones = std::mem::take(&mut self.time.place_zones);
        for (mut key, zone) in zones {
            compose(&mut key)?;
            self.time.place_zones.insert(key, zone);
        }
        Ok(())
    }

    fn validate(&self) -> Result<()> {
        let bad = |place: &str, message: String, help: &str| {
            Err(Error::new(ErrorKind::Config, message)
                .with_place(place)
                .with_help(help))
        };
        let legal = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if self.name.is_empty() || !self.name.chars().all(legal) {
            return bad(
                "name",
                format!("`{}` is no name for a dataset", self.name.escape_debug()),
                "use letters, digits, `-`, `_` and `.`",
            );
        }
        if self.layout.is_empty() {
            return bad(
                "layout",
                "the list of layouts is empty".into(),
                "remove it to read an index.csv",
            );
        }
        let zones = self.time.zone.iter().chain(self.time.place_zones.values());
        for zone in zones {
            if TimeZone::get(zone).is_err() {
                return bad(
                    "time",
                    format!("`{zone}` is no time zone"),
                    "use an IANA name such as Europe/Prague",
                );
            }
        }
        if matches!(
            self.time.quantum,
            Some(Quantum::Seconds(0) | Quantum::Months(0))
        ) {
            return bad(
                "time.quantum",
                "the time between two visits is 0".into(),
                "write the seconds or months between visit numbers",
            );
        }
        if let Some(pattern) = &self.time.file_name {
            let pattern =
                NamePattern::parse(pattern).map_err(|error| error.with_place("time.file_name"))?;
            if pattern.has("visit") {
                self.time.need_rule("time.file_name")?;
            }
        }
        for layout in &self.layout {
            layout.validate(&self.time)?;
        }
        for sum in self.checksums.index.iter().chain(&self.checksums.files) {
            if sum.len() != 64 || !sum.bytes().all(|byte| byte.is_ascii_hexdigit()) {
                return bad(
                    "checksums",
                    format!("`{sum}` is no SHA-256"),
                    "write 64 hexadecimal digits",
                );
            }
        }
        if let Some(split) = &self.split {
            let has_learn = split.learn_until.is_some() || split.learn_folder.is_some();
            let has_query = split.query_from.is_some() || split.query_folder.is_some();
            if !has_learn || !has_query {
                return bad(
                    "split",
                    "the split has only one side".into(),
                    "write learn_until and query_from, or learn_folder and query_folder",
                );
            }
            if let (Some(until), Some(from)) = (split.learn_until, split.query_from)
                && from < until
            {
                return bad(
                    "split",
                    format!("queries start at {from}, before learning ends at {until}"),
                    "let query_from be learn_until or later",
                );
            }
        }
        Ok(())
    }
}

impl TimeRule {
    /// The time of a visit number, where the rule has an origin and a quantum.
    pub fn of_visit(&self, number: i64) -> Option<Time> {
        self.of_number(self.origin?, number.checked_sub(self.first_visit)?)
    }

    /// The time `count` quanta after `origin`, where the rule has a quantum.
    pub(super) fn of_number(&self, origin: Time, count: i64) -> Option<Time> {
        match self.quantum? {
            Quantum::Seconds(seconds) => {
                let us = count
                    .checked_mul(i64::from(seconds))?
                    .checked_mul(1_000_000)?;
                origin.as_us().checked_add(us).map(Time::from_us)
            }
            Quantum::Months(months) => {
                let span = Span::new()
                    .try_months(count.checked_mul(i64::from(months))?)
                    .ok()?;
                let origin = Timestamp::from_microsecond(origin.as_us()).ok()?;
                let later = origin.to_zoned(TimeZone::UTC).checked_add(span).ok()?;
                Some(Time::from_us(later.timestamp().as_microsecond()))
            }
        }
    }

    pub(super) fn need_rule(&self, place: &str) -> Result<()> {
        if self.origin.is_some() && self.quantum.is_some() {
            return Ok(());
        }
        Err(Error::new(
            ErrorKind::Config,
            "visit numbers need a time rule, and the manifest has none",
        )
        .with_place(place)
        .with_help(
            "write under [time], for example: origin = \"2013-11-11T00:00:00Z\" and quantum = { seconds = 600 }",
        ))
    }
}

impl Layout {
    fn validate(&self, time: &TimeRule) -> Result<()> {
        match self {
            Self::Index { .. } => Ok(()),
            Self::Grief { .. } => time.need_rule("layout grief"),
            Self::FreLoc { .. } => time.need_rule("layout freloc"),
            Self::Nclt {
                camera,
                radius_m,
                max_pose_gap_s,
                place,
                spacing_m,
                ..
            } => {
                let bad = |message: String, help: &str| {
                    Err(Error::new(ErrorKind::Config, message)
                        .with_place("layout nclt")
                        .with_help(help))
                };
                if *camera > 5 {
                    return bad(
                        format!("there is no camera {camera}"),
                        "the cameras are 0 (up) to 5",
                    );
                }
                for (name, value) in [("radius_m", radius_m), ("max_pose_gap_s", max_pose_gap_s)] {
                    if !value.is_finite() || *value <= 0.0 {
                        return bad(format!("{name} is {value}"), "write a positive number");
                    }
                }
                match spacing_m {
                    None if place.is_empty() => {
                        return bad(
                            "there is no place".into(),
                            "write [[layout.place]] tables, or spacing_m",
                        );
                    }
                    Some(_) if !place.is_empty() => {
                        return bad(
                            "there are places and spacing_m".into(),
                            "remove spacing_m, or the places",
                        );
                    }
                    Some(spacing_m) if !(spacing_m.is_finite() && *spacing_m >= 2.0 * radius_m) => {
                        return bad(
                            format!("spacing_m is {spacing_m}"),
                            "write at least twice radius_m, so that places do not overlap",
                        );
                    }
                    _ => {}
                }
                for (position, one) in place.iter().enumerate() {
                    let heading = one.heading_deg.unwrap_or(0.0);
                    if ![one.x, one.y, one.z, heading].iter().all(|v| v.is_finite()) {
                        return bad(
                            format!("the pose of `{}` is not finite", one.key),
                            "write numbers of metres and degrees",
                        );
                    }
                    if place[..position].iter().any(|other| other.key == one.key) {
                        return bad(
                            format!("the place `{}` is listed twice", one.key),
                            "give each place one name",
                        );
                    }
                }
                Ok(())
            }
        }
    }
}

fn default_layout() -> Vec<Layout> {
    vec![Layout::Index {
        file: default_index(),
        ignore: Vec::new(),
    }]
}

pub(super) fn default_index() -> String {
    "index.csv".into()
}

pub(super) fn default_place_prefix() -> String {
    "loc".into()
}

pub(super) fn default_folder_prefix() -> String {
    "place_".into()
}

fn default_pose_gap_s() -> f64 {
    0.5
}

fn default_rotation() -> Rotation {
    Rotation::Clockwise90
}

fn rotation<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Rotation, D::Error> {
    match u32::deserialize(deserializer)? {
        0 => Ok(Rotation::None),
        90 => Ok(Rotation::Clockwise90),
        180 => Ok(Rotation::Half),
        270 => Ok(Rotation::Clockwise270),
        degrees => Err(custom(format_args!(
            "an image cannot be turned by {degrees} degrees, only by 0, 90, 180 or 270"
        ))),
    }
}

fn custom<E: serde::de::Error>(error: impl fmt::Display) -> E {
    E::custom(error)
}

fn optional_time<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Time>, D::Error> {
    let text = String::deserialize(deserializer)?;
    Time::parse(&text).map(Some).map_err(custom)
}

fn time_map<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<BTreeMap<String, Time>, D::Error> {
    BTreeMap::<String, String>::deserialize(deserializer)?
        .into_iter()
        .map(|(key, text)| Ok((key, Time::parse(&text).map_err(custom)?)))
        .collect()
}

fn optional_period<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Period>, D::Error> {
    #[derive(Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Name {
        Hour,
        Day,
        Week,
        Year,
    }
    Name::deserialize(deserializer).map(|name| {
        Some(match name {
            Name::Hour => Period::HOUR,
            Name::Day => Period::DAY,
            Name::Week => Period::WEEK,
            Name::Year => Period::YEAR,
        })
    })
}

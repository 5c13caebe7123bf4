//! What do the shades of a `map_server` map mean, cell by cell?
//!
//! Values are those of `nav_msgs/OccupancyGrid`: 0 (free) to 100 (occupied), -1 unknown.
//!
//! | mode | read from a shade s in 0..=1 (`occ = 1 - s`, or s with `negate`) | written |
//! |---|---|---|
//! | trinary | 100 where occ > `occupied_thresh`, 0 where occ < `free_thresh`, else -1 | 0, 254, 205 |
//! | scale | -1 where transparent; between the thresholds `rint(100 (occ - free) / (occupied - free))` | `(100 - c) / 100`, transparent where unknown |
//! | raw | `round(255 s)` where that is at most 100, else -1; `negate` is ignored | c, 255 where unknown |
//!
//! In trinary mode `map_server` takes the opacity of a picture that has one for a fourth colour: the
//! shade of a grey pixel s with opacity a is (3 s + a) / 4. So an opaque pixel of 205 is *free* there,
//! and not unknown as in a picture without opacity.
//!
//! Row 0 of the picture is the one with the highest y. `map_server`'s own default `free_thresh` of
//! 0.25 reads the unknown that it writes (205, occ 0.196) as *free*; what is written here has
//! thresholds with which every value comes back.

use std::io::Write;
use std::path::Path;

use fremen::file::{OutputFile, OutputKind};
use fremen::{Error, ErrorKind, Result};

use super::mode::MapMode;
use super::picture::Picture;
use super::yaml::Description;
use crate::cells::{GridSpec, OccupancyMap};

/// The value of a cell of which nothing is known.
pub const UNKNOWN: i8 = -1;

const OCCUPIED: i8 = 100;
const YAML: OutputKind = OutputKind {
    noun: "the YAML file of a map",
    begins: b"image:",
};
const PGM: OutputKind = OutputKind {
    noun: "a PGM picture",
    begins: b"P5",
};
const PNG: OutputKind = OutputKind {
    noun: "a PNG picture",
    begins: b"\x89PNG",
};

/// A 2-D map as `map_server` knows it.
#[derive(Clone, Debug, PartialEq)]
pub struct MapServerMap {
    spec: GridSpec,
    /// In the order of [`GridSpec::index`].
    values: Vec<i8>,
}

impl MapServerMap {
    /// A map of given values, in the order of [`GridSpec::index`]: 0 to 100, or [`UNKNOWN`].
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where they are not as many as the cells or the grid is 3-D,
    /// [`ErrorKind::Config`] for another value.
    pub fn new(spec: GridSpec, values: Vec<i8>) -> Result<Self> {
        if !spec.is_2d() || values.len() != spec.num_cells() {
            let message = format!(
                "{} values for a map of {:?} cells",
                values.len(),
                spec.dims()
            );
            return Err(Error::new(ErrorKind::Shape, message));
        }
        match values.iter().find(|it| !(UNKNOWN..=OCCUPIED).contains(*it)) {
            Some(value) => Err(Error::new(
                ErrorKind::Config,
                format!("{value} is no value of a cell"),
            )),
            None => Ok(Self { spec, values }),
        }
    }

    /// A predicted map, each probability rounded to whole percent.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] for a 3-D map.
    pub fn from_map(map: &OccupancyMap) -> Result<Self> {
        let value = |index| {
            map.get(index)
                .map_or(UNKNOWN, |p| (p * f32::from(OCCUPIED)).round() as i8)
        };
        Self::new(
            *map.spec(),
            (0..map.spec().num_cells()).map(value).collect(),
        )
    }

    /// The values as probabilities.
    pub fn to_map(&self) -> OccupancyMap {
        let mut map = OccupancyMap::new_unknown(self.spec);
        for (index, &value) in self.values.iter().enumerate() {
            map.set(
                index,
                (value >= 0).then(|| f32::from(value) / f32::from(OCCUPIED)),
            );
        }
        map
    }

    /// Where its cells are.
    pub const fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// The value of each cell, in the order of [`GridSpec::index`].
    pub fn values(&self) -> &[i8] {
        &self.values
    }

    /// Reads the map that a YAML file describes; its picture is a PGM or a PNG beside it.
    ///
    /// # Errors
    /// [`ErrorKind::Format`] where the description is not complete, has keys of its own, is
    /// rotated, or names a picture outside of its folder; where the picture is cut off, coloured
    /// or has 16 bits a pixel.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let description = Description::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let picture = Picture::read(&folder.join(&description.image))?;
        let (width, height) = (picture.width, picture.height);
        let spec = GridSpec::new_2d(
            description.origin_m,
            description.resolution_m,
            [width, height],
        )
        .map_err(|error| error.with_path(path))?;
        let rows = picture.pixels.chunks_exact(width as usize).rev();
        let values = rows
            .flatten()
            .map(|&pixel| value_of(pixel, picture.has_alpha, &description))
            .collect();
        Ok(Self { spec, values })
    }

    /// Writes the map as `NAME.yaml` with its picture beside it: a PNG where the mode needs
    /// opacity, else a PGM. Earlier maps of that name are replaced.
    ///
    /// In trinary mode, values from 20 to 64 become unknown, as `map_server` has it; in the others
    /// every value comes back.
    ///
    /// # Errors
    /// What the file system says; [`ErrorKind::AlreadyExists`] where another kind of file has the
    /// name.
    pub fn write(&self, path: impl AsRef<Path>, mode: MapMode) -> Result<()> {
        let path = path.as_ref();
        let (free_thresh, occupied_thresh) = mode.safe_thresholds();
        let (extension, kind) = match mode {
            MapMode::Scale => ("png", PNG),
            MapMode::Trinary | MapMode::Raw => ("pgm", PGM),
        };
        let image = path.with_extension(extension);
        let Some(name) = image.file_name().filter(|_| image != path) else {
            return Err(
                Error::new(ErrorKind::Config, "a map is written to a file NAME.yaml")
                    .with_path(path),
            );
        };
        let [w, h, _] = self.spec.dims();
        let rows = self.values.chunks_exact(w as usize).rev().flatten();
        let picture = Picture {
            width: w,
            height: h,
            has_alpha: mode == MapMode::Scale,
            pixels: rows.map(|&value| pixel_of(value, mode)).collect(),
        };
        let [x, y, _] = self.spec.origin_m();
        let description = Description {
            image: name.into(),
            resolution_m: self.spec.resolution_m(),
            origin_m: [x, y],
            negate: false,
            occupied_thresh,
            free_thresh,
            mode,
        };
        let bytes = match mode {
            MapMode::Scale => picture.to_png()?,
            MapMode::Trinary | MapMode::Raw => picture.to_pgm(),
        };
        write_file(&image, kind, &bytes)?;
        write_file(path, YAML, description.to_text().as_bytes())
    }
}

fn write_file(path: &Path, kind: OutputKind, bytes: &[u8]) -> Result<()> {
    let mut output = OutputFile::replace(path, kind, &[])?;
    output
        .write_all(bytes)
        .map_err(|cause| Error::io(path, cause))?;
    output.finish()
}

/// As `nav2_map_server` reads a pixel.
fn value_of([shade, alpha]: [u8; 2], has_alpha: bool, description: &Description) -> i8 {
    let shade = if has_alpha && description.mode == MapMode::Trinary {
        (3.0 * f64::from(shade) + f64::from(alpha)) / (4.0 * 255.0)
    } else {
        f64::from(shade) / 255.0
    };
    let occ = if description.negate {
        shade
    } else {
        1.0 - shade
    };
    let (free, occupied) = (description.free_thresh, description.occupied_thresh);
    match description.mode {
        MapMode::Raw => {
            let value = (shade * 255.0).round();
            if value <= f64::from(OCCUPIED) {
                value as i8
            } else {
                UNKNOWN
            }
        }
        MapMode::Scale if alpha != u8::MAX => UNKNOWN,
        _ if occ > occupied => OCCUPIED,
        _ if occ < free => 0,
        MapMode::Trinary => UNKNOWN,
        MapMode::Scale => ((occ - free) / (occupied - free) * 100.0).round_ties_even() as i8,
    }
}

/// As `nav2_map_server` writes a value.
fn pixel_of(value: i8, mode: MapMode) -> [u8; 2] {
    let (free_thresh, occupied_thresh) = mode.safe_thresholds();
    let opaque = |shade| [shade, u8::MAX];
    let percent = f64::from(value);
    match mode {
        MapMode::Trinary if value == UNKNOWN => opaque(205),
        MapMode::Trinary if percent <= free_thresh * 100.0 => opaque(254),
        MapMode::Trinary if percent >= occupied_thresh * 100.0 => opaque(0),
        MapMode::Trinary => opaque(205),
        MapMode::Scale if value == UNKNOWN => [128, 0],
        MapMode::Scale => opaque(((100.0 - percent) / 100.0 * 255.0).round() as u8),
        MapMode::Raw if value == UNKNOWN => opaque(u8::MAX),
        MapMode::Raw => opaque(value as u8),
    }
}

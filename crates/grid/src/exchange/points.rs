//! Which voxels does a list of points mean, and which points are a map's voxels?
//!
//! Point lists are what most programs read: CSV with a header, and PLY, the polygon format of Stanford.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use fremen::file::{OutputFile, OutputKind};
use fremen::{Error, ErrorKind, Result};

use crate::cells::{GridSpec, OccupancyMap};

/// The most bytes of one file.
const MAX_BYTES: u64 = 1 << 30;
const PLY: OutputKind = OutputKind {
    noun: "a PLY file",
    begins: b"ply\n",
};
const CSV_HEADER: &str = "x,y,z,p";
const CSV: OutputKind = OutputKind {
    noun: "a list of points",
    begins: CSV_HEADER.as_bytes(),
};

/// A point, and the probability that its voxel is occupied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPoint {
    /// Where it is.
    pub at_m: [f64; 3],
    /// 1 where the list does not say.
    pub p: f32,
}

/// Reads points from a PLY file (ASCII or binary, little endian: an element `vertex` with `x`, `y`,
/// `z` and perhaps `p`) or, by any other name than `*.ply`, from CSV (columns `x`, `y`, `z` and perhaps
/// `p`).
///
/// # Errors
/// [`ErrorKind::Format`] with the line or the point where a column is missing, something is no finite
/// number, a probability is not in 0..=1 or the file ends too early.
pub fn read_points(path: impl AsRef<Path>) -> Result<Vec<MapPoint>> {
    let path = path.as_ref();
    let bytes = fremen::file::read(path, MAX_BYTES)?;
    let is_ply = path
        .extension()
        .is_some_and(|it| it.eq_ignore_ascii_case("ply"));
    let points = if is_ply {
        parse_ply(&bytes)
    } else {
        parse_csv(&bytes)
    };
    points.map_err(|error| error.with_path(path))
}

/// The map of points on the raster of `resolution_m` at zero, as large as they need. The largest
/// probability in a voxel counts; what has no point is unknown.
///
/// # Errors
/// [`ErrorKind::Config`] where there is no point, or they are too far apart for one grid.
pub fn map_of_points(points: &[MapPoint], resolution_m: f64) -> Result<OccupancyMap> {
    if points.is_empty() {
        return Err(Error::new(ErrorKind::Config, "a list of no points"));
    }
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for point in points {
        for axis in 0..3 {
            let cell = (point.at_m[axis] / resolution_m).floor();
            low[axis] = low[axis].min(cell);
            high[axis] = high[axis].max(cell);
        }
    }
    let dims = std::array::from_fn(|axis| (high[axis] - low[axis] + 1.0).min(4e9) as u32);
    let spec = GridSpec::new_3d(low.map(|it| it * resolution_m), resolution_m, dims)?;
    let mut map = OccupancyMap::new_unknown(spec);
    for point in points {
        // By whole cells, as the corners were found: no rounding of the origin puts a point outside.
        let cell = std::array::from_fn(|axis| {
            ((point.at_m[axis] / resolution_m).floor() - low[axis]) as u32
        });
        let index = spec.index(cell);
        let p = map.get(index).map_or(point.p, |p| p.max(point.p));
        map.set(index, Some(p));
    }
    Ok(map)
}

/// Writes the centres of all voxels of at least probability `least` as PLY (ASCII) or, by any other
/// name than `*.ply`, as CSV, each with its probability; in place of an earlier list
/// that is none of `inputs`.
///
/// # Errors
/// As [`OutputFile::replace`].
pub fn write_points(
    map: &OccupancyMap,
    least: f32,
    path: impl AsRef<Path>,
    inputs: &[&Path],
) -> Result<()> {
    let path = path.as_ref();
    let spec = map.spec();
    let mut rows = String::new();
    let is_ply = path
        .extension()
        .is_some_and(|it| it.eq_ignore_ascii_case("ply"));
    let separator = if is_ply { ' ' } else { ',' };
    let mut num = 0_usize;
    for (index, &p) in map.probabilities().iter().enumerate() {
        // NaN is not at least anything.
        if p >= least {
            let [x, y, z] = spec.center(spec.cell(index));
            let s = separator;
            let _ = writeln!(rows, "{x:.6}{s}{y:.6}{s}{z:.6}{s}{p}");
            num += 1;
        }
    }
    let (kind, head) = if is_ply {
        let properties = ["double x", "double y", "double z", "float p"];
        let properties = properties.map(|it| format!("property {it}\n")).concat();
        let head = format!("ply\nformat ascii 1.0\nelement vertex {num}\n{properties}end_header\n");
        (PLY, head)
    } else {
        (CSV, format!("{CSV_HEADER}\n"))
    };
    let mut file = OutputFile::replace(path, kind, inputs)?;
    for part in [head, rows] {
        file.write_all(part.as_bytes())
            .map_err(|cause| Error::io(path, cause))?;
    }
    file.finish()
}

fn format(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, message.into())
}

/// A point of these values, all of which must be what they should be.
fn point(at_m: [f64; 3], p: Option<f64>) -> Result<MapPoint> {
    let p = p.unwrap_or(1.0);
    if !at_m.iter().all(|it| it.is_finite()) {
        return Err(format(format!("{at_m:?} is no place")));
    }
    if !(0.0..=1.0).contains(&p) {
        return Err(format(format!("{p} is no probability")));
    }
    Ok(MapPoint { at_m, p: p as f32 })
}

fn parse_csv(bytes: &[u8]) -> Result<Vec<MapPoint>> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(bytes);
    let broken = |cause: csv::Error| format(cause.to_string());
    let headers = reader.headers().map_err(broken)?.clone();
    let column = |name: &str| headers.iter().position(|it| it.eq_ignore_ascii_case(name));
    let required = |name: &str| {
        column(name).ok_or_else(|| {
            format(format!("there is no column {name}"))
                .with_help("a list of points begins with the line x,y,z or x,y,z,p")
        })
    };
    let at = [required("x")?, required("y")?, required("z")?];
    let p = column("p");
    let mut points = Vec::new();
    for record in reader.records() {
        let record = record.map_err(broken)?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |at: usize| -> Result<f64> {
            let text = record.get(at).unwrap_or_default();
            let shown = || format(format!("`{}` is no number", fremen::error::printable(text)));
            text.parse().map_err(|_| shown())
        };
        let read = || {
            point(
                [number(at[0])?, number(at[1])?, number(at[2])?],
                p.map(number).transpose()?,
            )
        };
        points.push(read().map_err(|error| error.with_place(format!("line {line}")))?);
    }
    Ok(points)
}

/// How a property of a vertex is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scalar {
    Int(usize, bool),
    F32,
    F64,
}

impl Scalar {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Int(1, true),
            "uchar" | "uint8" => Self::Int(1, false),
            "short" | "int16" => Self::Int(2, true),
            "ushort" | "uint16" => Self::Int(2, false),
            "int" | "int32" => Self::Int(4, true),
            "uint" | "uint32" => Self::Int(4, false),
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    const fn num_bytes(self) -> usize {
        match self {
            Self::Int(num, _) => num,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in these bytes, least significant first.
    fn number(self, bytes: &[u8]) -> f64 {
        let mut eight = [0; 8];
        eight[..bytes.len()].copy_from_slice(bytes);
        let bits = u64::from_le_bytes(eight);
        match self {
            Self::F32 => f32::from_bits(bits as u32).into(),
            Self::F64 => f64::from_bits(bits),
            Self::Int(_, false) => bits as f64,
            Self::Int(num, true) => {
                let shift = 64 - 8 * num;
                ((bits << shift) as i64 >> shift) as f64
            }
        }
    }
}

/// What the header of a PLY file says of its vertices.
struct Ply {
    is_binary: bool,
    num: usize,
    properties: Vec<(String, Scalar)>,
    /// Where the data begin, and in which line.
    start: usize,
    line: usize,
}

fn ply_header(bytes: &[u8]) -> Result<Ply> {
    let mut ply = Ply {
        is_binary: false,
        num: 0,
        properties: Vec::new(),
        start: 0,
        line: 0,
    };
    let mut element: Option<bool> = None;
    loop {
        let rest = &bytes[ply.start..];
        let end = rest.iter().position(|byte| *byte == b'\n');
        // Headers have short lines; a file without one is none.
        let Some(end) = end.filter(|end| *end < 1_000 && ply.line < 1_000) else {
            return Err(format("the header has no line `end_header`"));
        };
        let line = String::from_utf8_lossy(&rest[..end]).into_owned();
        ply.start += end + 1;
        ply.line += 1;
        let place = |error: Error| error.with_place(format!("line {}", ply.line));
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] if ply.line == 1 => {}
            _ if ply.line == 1 => return Err(place(format("this is no PLY file"))),
            ["end_header"] => return Ok(ply),
            ["format", "ascii", _] => ply.is_binary = false,
            ["format", "binary_little_endian", _] => ply.is_binary = true,
            ["format", ..] => {
                let error = format("this format of PLY is not read")
                    .with_help("write it as ascii or binary_little_endian");
                return Err(place(error));
            }
            ["element", name, num] => {
                let is_vertex = name == "vertex";
                if !is_vertex && element.is_none() {
                    let error = format("the first element is not `vertex`");
                    return Err(place(error.with_help("write the vertices first")));
                }
                // What follows the vertices is not read.
                element = Some(is_vertex);
                if is_vertex {
                    let num = num
                        .parse()
                        .map_err(|_| place(format("no number of vertices")))?;
                    ply.num = num;
                }
            }
            ["property", scalar, name] if element == Some(true) => {
                let error = || place(format(format!("properties of type {scalar} are not read")));
                let scalar = Scalar::of(scalar).ok_or_else(error)?;
                ply.properties.push((name.to_owned(), scalar));
            }
            ["property", "list", ..] if element == Some(true) => {
                return Err(place(format("lists of a vertex are not read")));
            }
            _ => {}
        }
    }
}

fn parse_ply(bytes: &[u8]) -> Result<Vec<MapPoint>> {
    let ply = ply_header(bytes)?;
    let column = |name: &str| ply.properties.iter().position(|(it, _)| it == name);
    let required = |name: &str| {
        column(name).ok_or_else(|| format(format!("vertices have no property {name}")))
    };
    let at = [required("x")?, required("y")?, required("z")?];
    let p = column("p");
    let data = &bytes[ply.start..];
    let mut points = Vec::new();
    let of_row = |row: &[f64]| point(at.map(|column| row[column]), p.map(|column| row[column]));
    if ply.is_binary {
        let size: usize = ply.properties.iter().map(|(_, it)| it.num_bytes()).sum();
        let rows = data.chunks_exact(size).take(ply.num);
        for (number, bytes) in rows.enumerate() {
            let mut rest = bytes;
            let row: Vec<f64> = (ply.properties.iter())
                .map(|(_, scalar)| {
                    let (first, after) = rest.split_at(scalar.num_bytes());
                    rest = after;
                    scalar.number(first)
                })
                .collect();
            let place = |error: Error| error.with_place(format!("point {}", number + 1));
            points.push(of_row(&row).map_err(place)?);
        }
    } else {
        let text = String::from_utf8_lossy(data);
        for (number, line) in text.lines().take(ply.num).enumerate() {
            let place = |error: Error| error.with_place(format!("line {}", ply.line + number + 1));
            let row: Vec<f64> = (line.split_ascii_whitespace())
                .map_while(|word| word.parse().ok())
                .collect();
            if row.len() < ply.properties.len() {
                let message = format!("{} numbers are expected", ply.properties.len());
                return Err(place(format(message)));
            }
            points.push(of_row(&row).map_err(place)?);
        }
    }
    if points.len() < ply.num {
        let message = format!("{} of {} points are there", points.len(), ply.num);
        return Err(format(message).with_help("the file is cut: write it again"));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_come_from_both_formats_and_mean_the_same() -> Result<()> {
        let expected = [
            MapPoint {
                at_m: [0.5, -1.25, 2.0],
                p: 0.75,
            },
            MapPoint {
                at_m: [1.0, 2.0, 3.0],
                p: 1.0,
            },
        ];
        assert_eq!(
            parse_csv(b"p,z,y,x\n0.75,2,-1.25,0.5\n1,3,2,1\n")?,
            expected
        );
        let head = |kind: &str, more: &str| {
            format!(
                "ply\nformat {kind} 1.0\ncomment hi\nelement vertex 2\nproperty float x\nproperty double \
                 y\nproperty short z\n{more}property float p\nelement face 0\nproperty list uchar int \
                 vertex_indices\nend_header\n"
            )
        };
        let text = head("ascii", "") + "0.5 -1.25 2 0.75\n1 2 3 1\n";
        assert_eq!(parse_ply(text.as_bytes())?, expected);
        let mut bytes = head("binary_little_endian", "property uchar red\n").into_bytes();
        for it in &expected {
            bytes.extend((it.at_m[0] as f32).to_le_bytes());
            bytes.extend(it.at_m[1].to_le_bytes());
            bytes.extend((it.at_m[2] as i16).to_le_bytes());
            bytes.push(7);
            bytes.extend(it.p.to_le_bytes());
        }
        assert_eq!(parse_ply(&bytes)?, expected);
        bytes.pop();
        assert!(parse_ply(&bytes).is_err());
        Ok(())
    }

    #[test]
    fn faults_are_named_by_their_place() {
        for (text, place) in [
            ("x,y,z\n1,2,nan\n", Some("line 2")),
            ("x,y,z\n1,2,3\n1,b,3\n", Some("line 3")),
            ("x,y,z,p\n1,2,3,1.5\n", Some("line 2")),
            ("x,y\n1,2\n", None),
        ] {
            let error = parse_csv(text.as_bytes()).expect_err(text);
            assert_eq!(error.place(), place, "{text}");
        }
        let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty \
                    float z\nend_header\n";
        for (text, place) in [
            (format!("{head}1 2 3\n4 5\n"), Some("line 9")),
            (format!("{head}1 2 3\n4 5 inf\n"), Some("line 9")),
            (format!("{head}1 2 3\n"), None),
            (head.replace("ascii", "binary_big_endian"), Some("line 2")),
            (head.replace("property float z\n", ""), None),
            ("ply\nformat ascii 1.0\n".to_owned(), None),
            ("plx\n".to_owned(), Some("line 1")),
        ] {
            let error = parse_ply(text.as_bytes()).expect_err(&text);
            assert_eq!(error.place(), place, "{text}");
        }
    }

    #[test]
    fn maps_are_written_as_points_and_come_back() -> Result<()> {
        let dir = tempfile::tempdir().expect("a folder");
        let spec = GridSpec::new_3d([-0.4, 1.0, 0.2], 0.2, [3, 4, 5])?;
        let mut map = OccupancyMap::new_unknown(spec);
        for index in (0..spec.num_cells()).step_by(3) {
            map.set(index, Some(if index % 2 == 0 { 0.875 } else { 0.25 }));
        }
        for name in ["map.ply", "map.csv"] {
            let path = dir.path().join(name);
            // In place of itself, too.
            write_points(&map, 0.0, &path, &[])?;
            write_points(&map, 0.0, &path, &[])?;
            let back = map_of_points(&read_points(&path)?, 0.2)?;
            for index in 0..spec.num_cells() {
                let center = spec.center(spec.cell(index));
                let found = back.spec().cell_at(center).map(|it| back.spec().index(it));
                assert_eq!(found.and_then(|it| back.get(it)), map.get(index), "{name}");
            }
            write_points(&map, 0.5, &path, &[])?;
            assert!(read_points(&path)?.iter().all(|it| it.p == 0.875));
        }
        assert!(map_of_points(&[], 0.2).is_err());
        assert!(
            map_of_points(
                &[MapPoint {
                    at_m: [1e12, 0.0, 0.0],
                    p: 1.0
                }],
                1e-9
            )
            .is_err()
        );
        Ok(())
    }
}

//! What does a map of the authors' benchmark say?
//!
//! The reference benchmark keeps each place in a YAML file of OpenCV's `FileStorage` with the
//! matrices
//!
//! | matrix | shape | type | |
//! |---|---|---|---|
//! | `Keypoints` | features x 7 | `f` | x, y, size, angle, response, octave, class |
//! | `Descriptors` | features x 32 | `u` | BRIEF |
//! | `Visibility` | features x visits | `c` or `u` | 1: was seen |
//! | `Times` | 1 x visits | `i` | seconds |
//! | `Fremen` | | | fitted models: left out, they are fitted again from the log |
//!
//! Only what such files need is read of YAML. O(bytes). Format: OpenCV's documentation of
//! `cv::FileStorage`; layout: the sources of that benchmark.

use std::path::Path;

use crate::feature::{Descriptor, Features, Keypoint};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::BitRow;

use crate::map::limits::MAX_FEATURES;

/// Bytes of a file, at most.
const MAX_BYTES: u64 = 1 << 28;
/// Numbers of one matrix, at most.
const MAX_CELLS: usize = 1 << 28;
const KEYPOINT_COLUMNS: usize = 7;
const DESCRIPTOR_COLUMNS: usize = 32;

/// One place of the reference benchmark.
#[derive(Clone, Debug, PartialEq)]
pub struct FileStorageMap {
    /// All features of the place.
    pub features: Features,
    /// The time of each visit: the file's seconds, since 1970.
    pub times: Vec<Time>,
    /// One row a visit, one bit a feature: it was seen.
    pub seen: Vec<BitRow>,
}

/// Reads one place of the reference benchmark; errors name the line.
pub fn read_file_storage(path: impl AsRef<Path>) -> Result<FileStorageMap> {
    let path = path.as_ref();
    let text = fremen::file::read(path, MAX_BYTES)?;
    decode_file_storage(&text).map_err(|error| error.with_path(path))
}

/// [`read_file_storage`] of the bytes of a file.
pub fn decode_file_storage(bytes: &[u8]) -> Result<FileStorageMap> {
    parse(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes))
}

/// [`read_file_storage`] of what is in memory.
pub(super) fn parse(text: &[u8]) -> Result<FileStorageMap> {
    let text = std::str::from_utf8(text).map_err(|error| {
        let before = text[..error.valid_up_to()].split(|&byte| byte == b'\n');
        format_error("this is no UTF-8", before.count())
    })?;
    if !text.starts_with("%YAML") {
        return Err(format_error("`%YAML` is expected", 1)
            .with_help("give a map that OpenCV's FileStorage has written as YAML"));
    }
    let mut lines = Lines::new(text);
    let (mut keypoints, mut descriptors, mut visibility, mut times) = (None, None, None, None);
    while let Some((line, text)) = lines.next() {
        let Some((name, rest)) = text.split_once(':') else {
            continue;
        };
        if text.starts_with(char::is_whitespace) || rest.trim() != "!!opencv-matrix" {
            continue;
        }
        let wanted = match name {
            "Keypoints" => &mut keypoints,
            "Descriptors" => &mut descriptors,
            "Visibility" => &mut visibility,
            "Times" => &mut times,
            _ => continue,
        };
        if wanted.replace(Matrix::read(&mut lines, line)?).is_some() {
            return Err(format_error(
                &format!("there are two matrices `{name}`"),
                line,
            ));
        }
    }
    let end = lines.number;
    let need = |matrix: Option<Matrix>, name: &str| {
        matrix.ok_or_else(|| format_error(&format!("the matrix `{name}` is missing"), end))
    };
    let keypoints = need(keypoints, "Keypoints")?;
    let descriptors = need(descriptors, "Descriptors")?;
    let visibility = need(visibility, "Visibility")?;
    let times = need(times, "Times")?;
    let num_features = keypoints.rows;
    keypoints.must_be(num_features, KEYPOINT_COLUMNS)?;
    descriptors.must_be(num_features, DESCRIPTOR_COLUMNS)?;
    visibility.must_be(num_features, times.columns)?;
    times.must_be(1, times.columns)?;
    if num_features > MAX_FEATURES {
        let message =
            format!("{num_features} features, where a place holds at most {MAX_FEATURES}");
        return Err(format_error(&message, keypoints.line));
    }
    let mut seen = vec![BitRow::zeros(num_features); times.columns];
    for (at, cell) in visibility.cells.iter().enumerate() {
        match cell.number {
            0.0 => {}
            1.0 => seen[at % times.columns].set(at / times.columns),
            _ => return Err(format_error("a visibility is 0 or 1", cell.line)),
        }
    }
    Ok(FileStorageMap {
        features: features(&keypoints, &descriptors)?,
        times: (times.cells.iter())
            .map(|cell| Ok(Time::from_s(cell.whole(0, i64::from(u32::MAX))?)))
            .collect::<Result<_>>()?,
        seen,
    })
}

fn features(keypoints: &Matrix, descriptors: &Matrix) -> Result<Features> {
    let mut features = Features::new();
    let rows = (keypoints.cells.chunks_exact(KEYPOINT_COLUMNS))
        .zip(descriptors.cells.chunks_exact(DESCRIPTOR_COLUMNS));
    for (point, bytes) in rows {
        let number = |at: usize| {
            let number = point[at].number as f32;
            if number.is_finite() {
                Ok(number)
            } else {
                Err(format_error(
                    "a keypoint's number is not finite",
                    point[at].line,
                ))
            }
        };
        let keypoint = Keypoint {
            x: number(0)?,
            y: number(1)?,
            size: number(2)?,
            response: number(4)?,
        };
        let mut descriptor = [0; DESCRIPTOR_COLUMNS];
        for (byte, cell) in descriptor.iter_mut().zip(bytes) {
            *byte = cell.whole(0, 255)? as u8;
        }
        features.push(keypoint, Descriptor::from_bytes(descriptor));
    }
    Ok(features)
}

fn format_error(message: &str, line: usize) -> Error {
    Error::new(ErrorKind::Format, message).with_place(format!("line {line}"))
}

/// Lines with their numbers, from 1.
struct Lines<'a> {
    lines: std::str::Lines<'a>,
    number: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Self {
        Self {
            lines: text.lines(),
            number: 0,
        }
    }

    fn next(&mut self) -> Option<(usize, &'a str)> {
        let line = self.lines.next()?;
        self.number += 1;
        Some((self.number, line))
    }
}

/// A number and where it stands.
#[derive(Clone, Copy, Debug)]
struct Cell {
    number: f64,
    line: usize,
}

impl Cell {
    /// The number, if it is a whole one in this range.
    fn whole(self, from: i64, to: i64) -> Result<i64> {
        let range = from as f64..=to as f64;
        if range.contains(&self.number) && self.number.fract() == 0.0 {
            Ok(self.number as i64)
        } else {
            let message = format!("a whole number from {from} to {to} is expected");
            Err(format_error(&message, self.line))
        }
    }
}

/// A matrix, row by row.
struct Matrix {
    line: usize,
    rows: usize,
    columns: usize,
    cells: Vec<Cell>,
}

impl Matrix {
    /// Reads what follows the name in line `line`.
    fn read(lines: &mut Lines<'_>, line: usize) -> Result<Self> {
        let mut value = |key: &str| {
            let (line, text) = (lines.next())
                .ok_or_else(|| format_error(&format!("`{key}` is missing"), line + 1))?;
            let value = (text.trim_start().strip_prefix(key))
                .and_then(|rest| rest.trim_start().strip_prefix(':'));
            match value {
                Some(value) => Ok((line, value.trim())),
                None => Err(format_error(&format!("`{key}:` is expected"), line)),
            }
        };
        let count = |(line, text): (usize, &str)| {
            (text.parse::<usize>()).map_err(|_| format_error("a count is expected", line))
        };
        let rows = count(value("rows")?)?;
        let columns = count(value("cols")?)?;
        let (type_line, name) = value("dt")?;
        if !matches!(
            name.trim_matches('"'),
            "u" | "c" | "w" | "s" | "i" | "f" | "d"
        ) {
            let message = format!("numbers of type `{}` are not known", name.escape_debug());
            return Err(format_error(&message, type_line));
        }
        let (data_line, data) = value("data")?;
        let num_cells = (rows.checked_mul(columns))
            .filter(|&cells| cells <= MAX_CELLS)
            .ok_or_else(|| {
                let message = format!("a matrix has at most {MAX_CELLS} numbers");
                format_error(&message, line)
            })?;
        let mut cells = Vec::new();
        let Some(first) = data.strip_prefix('[') else {
            return Err(format_error("`[` is expected", data_line));
        };
        let (mut line, mut text) = (data_line, first);
        loop {
            let (numbers, is_last) = match text.split_once(']') {
                Some((numbers, _)) => (numbers, true),
                None => (text, false),
            };
            for word in numbers
                .split(',')
                .map(str::trim)
                .filter(|it| !it.is_empty())
            {
                if cells.len() == num_cells {
                    let message = format!("more than {rows} x {columns} numbers");
                    return Err(format_error(&message, line));
                }
                let number = number_of(word).ok_or_else(|| {
                    let word: String = word.chars().take(40).collect();
                    format_error(&format!("`{}` is no number", word.escape_debug()), line)
                })?;
                cells.push(Cell { number, line });
            }
            if is_last {
                break;
            }
            (line, text) =
                (lines.next()).ok_or_else(|| format_error("`]` is missing", line + 1))?;
        }
        if cells.len() < num_cells {
            let message = format!(
                "{} numbers, where {rows} x {columns} are expected",
                cells.len()
            );
            return Err(format_error(&message, line));
        }
        Ok(Self {
            line,
            rows,
            columns,
            cells,
        })
    }

    fn must_be(&self, rows: usize, columns: usize) -> Result<()> {
        if (self.rows, self.columns) == (rows, columns) {
            return Ok(());
        }
        let message = format!(
            "a matrix of {rows} x {columns} is expected here, not {} x {}",
            self.rows, self.columns
        );
        Err(format_error(&message, self.line))
    }
}

/// OpenCV writes `1.`, `-1.5e+00`, `.Inf`, `-.Inf` and `.Nan`.
fn number_of(word: &str) -> Option<f64> {
    match word {
        ".Inf" | ".inf" => Some(f64::INFINITY),
        "-.Inf" | "-.inf" => Some(f64::NEG_INFINITY),
        ".Nan" | ".nan" => Some(f64::NAN),
        _ if word.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) => {
            word.parse().ok()
        }
        _ => None,
    }
}

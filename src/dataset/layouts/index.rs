//! Which images does the `index.csv` of this folder list?

use std::collections::BTreeMap;
use std::path::Path;

use super::collector::{Collector, outside_message};
use crate::dataset::table::{MAX_TABLE_BYTES, Row, Table, header_of, read_text};
use crate::feature::Rect;
use crate::map::{Edge, PlaceKey};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Time, TimeUnit, Zone};

const CROP: [&str; 4] = ["crop_x", "crop_y", "crop_w", "crop_h"];
/// Columns of times, one of which an index has: RFC 3339, or numbers since 1970.
const TIMES: [(&str, Option<TimeUnit>); 5] = [
    ("time", None),
    ("time_s", Some(TimeUnit::Seconds)),
    ("time_ms", Some(TimeUnit::Milliseconds)),
    ("time_us", Some(TimeUnit::Microseconds)),
    ("time_ns", Some(TimeUnit::Nanoseconds)),
];
/// Columns that mean nothing here.
const FOR_PEOPLE: [&str; 2] = ["condition", "note"];
const POSE: [&str; 3] = ["x", "y", "z"];

/// Reads the index.
pub(super) fn read(collector: &mut Collector<'_>, file: &str, ignore: &[String]) -> Result<()> {
    let path = collector.root.join(file);
    let text = read_text(&path, MAX_TABLE_BYTES)?;
    let header = header_of(&text);
    let has = |name: &str| {
        header
            .split([',', ';', '\t'])
            .any(|cell| cell.trim().trim_matches('"') == name)
    };
    let times = TIMES.map(|(column, _)| column);
    let time = times
        .into_iter()
        .find(|name| has(name))
        .unwrap_or(TIMES[0].0);
    let optional: Vec<_> = (CROP.into_iter())
        .chain(["scale"])
        .chain(POSE)
        .chain(times.into_iter().filter(|name| *name != time))
        .chain(FOR_PEOPLE)
        .chain(ignore.iter().map(String::as_str))
        .collect();
    let only = collector.options.only.as_deref();
    let is_wanted = |path: &str| {
        let name = path.rsplit('/').next().unwrap_or(path);
        only.is_none_or(|only| only.contains(name) || only.contains(name.trim()))
    };
    let required = ["place", time, "path"];
    let table = Table::read_where(&path, &required, &optional, "path", &is_wanted)?;
    let times = Times::of(&table, collector.options.zone.as_ref())?;
    if let Some((unit, column)) = times.other_unit(&table) {
        let message = format!(
            "its times are read as {}, and look like {} (help: call the column {column}, if they are)",
            times.unit.map_or("", TimeUnit::words),
            unit.words()
        );
        collector.problem(file, message);
    }
    if table.rows.is_empty() {
        return Err(Error::new(ErrorKind::Format, "the index lists no image")
            .with_path(table.path())
            .with_help("write one row for each image below the header"));
    }
    let has_poses = if table.has("z") {
        has_all_or_none(&table, &POSE)?
    } else {
        has_all_or_none(&table, &POSE[..2])?
    };
    has_all_or_none(&table, &CROP)?;
    // Sum of positions and how many, for places whose pose is given with every image.
    let mut sums: BTreeMap<PlaceKey, ([f64; 3], f64)> = BTreeMap::new();
    for row in &table.rows {
        let place = place(&table, row, "place")?;
        let time = times.read(&table, row)?;
        let path = path_of(collector.root, &table, row)?;
        let scale = match table.finite(row, "scale")? {
            Some(scale) if scale <= 0.0 => {
                return Err(table
                    .error(row, "scale", format!("the scale {scale} is not positive"))
                    .with_help(
                        "write the factor by which to resize, or leave the cell empty for 1",
                    ));
            }
            scale => scale.unwrap_or(1.0),
        };
        let crop = crop(&table, row)?;
        if has_poses && let Some(pose) = pose(&table, row)? {
            let (sum, count) = sums.entry(place.clone()).or_default();
            for (sum, value) in sum.iter_mut().zip(pose) {
                *sum += value;
            }
            *count += 1.0;
        }
        let subject = format!("{file} line {}", row.line);
        match crop {
            Crop::Outside(written) => {
                collector.image_problem(subject, outside_message(&written, path, None), path);
            }
            Crop::None => collector.add(&subject, &place, time, path, |image| {
                image.with_scale(scale)
            }),
            Crop::Cut(rect) => collector.add(&subject, &place, time, path, |image| {
                image.with_crop(Some(rect)).with_scale(scale)
            }),
        }
    }
    collector.poses = sums
        .into_iter()
        .map(|(place, (sum, count))| (place, sum.map(|value| value / count)))
        .collect();
    Ok(())
}

/// The one column of times, and what stands in it.
struct Times<'a> {
    column: &'static str,
    unit: Option<TimeUnit>,
    zone: Option<&'a Zone>,
}

impl<'a> Times<'a> {
    fn of(table: &Table, zone: Option<&'a Zone>) -> Result<Self> {
        let mut there = TIMES.into_iter().filter(|(column, _)| table.has(column));
        let (column, unit) = there.next().unwrap_or(TIMES[0]);
        match there.next() {
            None => Ok(Self { column, unit, zone }),
            Some((second, _)) => Err(header_error(
                table.path(),
                format!("there are two columns of times, `{column}` and `{second}`"),
                "remove one of them".into(),
            )),
        }
    }

    /// The unit that every number of the column looks like, if it is another one than the column's;
    /// and the column for it.
    ///
    /// A clock that begins with the robot may show the same numbers, so they are learnt all the same.
    fn other_unit(&self, table: &Table) -> Option<(TimeUnit, &'static str)> {
        let of = |row: &Row| TimeUnit::guess(table.get(row, self.column)?.parse().ok()?);
        let guess = of(table.rows.first()?).filter(|_| self.unit.is_some())?;
        let is_other =
            Some(guess) != self.unit && table.rows.iter().all(|row| of(row) == Some(guess));
        let (column, _) = TIMES.into_iter().find(|(_, unit)| *unit == Some(guess))?;
        is_other.then_some((guess, column))
    }

    fn read(&self, table: &Table, row: &Row) -> Result<Time> {
        let cell = table.text(row, self.column)?;
        match self.unit {
            Some(unit) => unit.time(cell),
            None => Time::parse_in(cell, self.zone),
        }
        .map_err(|error| table.locate(error, row, self.column))
    }
}

/// Reads poses.csv in the dataset's folder, where it exists.
pub(super) fn read_poses(collector: &mut Collector<'_>) -> Result<()> {
    let path = collector.root.join("poses.csv");
    if !path.exists() {
        return Ok(());
    }
    if !collector.poses.is_empty() {
        return Err(Error::new(
            ErrorKind::Format,
            "poses are given twice: here and in the index or manifest",
        )
        .with_path(&path)
        .with_help("remove this file, or the columns x, y and z there"));
    }
    let table = Table::read(&path, &["place", "x", "y"], &["z"])?;
    for row in &table.rows {
        let place = place(&table, row, "place")?;
        let Some(pose) = pose(&table, row)? else {
            return Err(table
                .error(row, "x", "the cells x and y are empty")
                .with_help("write the position in metres or remove the row"));
        };
        if collector.poses.insert(place.clone(), pose).is_some() {
            return Err(table
                .error(row, "place", format!("a second pose of `{place}`"))
                .with_help("remove one of them"));
        }
    }
    Ok(())
}

/// Reads edges.csv in the dataset's folder, where it exists.
pub(super) fn read_edges(collector: &mut Collector<'_>) -> Result<()> {
    let path = collector.root.join("edges.csv");
    if !path.exists() {
        return Ok(());
    }
    let table = Table::read(&path, &["from", "to"], &["name"])?;
    for row in &table.rows {
        let edge = Edge {
            from: place(&table, row, "from")?,
            to: place(&table, row, "to")?,
            name: table.get(row, "name").unwrap_or_default().to_owned(),
        };
        if collector.edges.contains(&edge) {
            return Err(table
                .error(
                    row,
                    "from",
                    format!("the edge {} -> {} is listed twice", edge.from, edge.to),
                )
                .with_help("remove one of them or give them different names"));
        }
        collector.edges.push(edge);
    }
    Ok(())
}

/// The image's path. Blanks around it are the table's, unless they belong to the name of a file.
fn path_of<'a>(root: &Path, table: &Table, row: &'a Row) -> Result<&'a str> {
    let path = table.text(row, "path")?;
    let written = table.written(row, "path").unwrap_or(path);
    let is_name = written != path && root.join(written).symlink_metadata().is_ok();
    Ok(if is_name { written } else { path })
}

fn place(table: &Table, row: &Row, column: &str) -> Result<PlaceKey> {
    PlaceKey::written(table.text(row, column)?).map_err(|error| table.locate(error, row, column))
}

enum Crop {
    None,
    Cut(Rect),
    /// As written: part of it is at negative pixels.
    Outside(String),
}

fn crop(table: &Table, row: &Row) -> Result<Crop> {
    let mut values = [None; 4];
    for (value, column) in values.iter_mut().zip(CROP) {
        *value = table.number::<i64>(row, column, "a whole number of pixels")?;
    }
    let [Some(x), Some(y), Some(width), Some(height)] = values else {
        return match CROP.iter().zip(values).find(|(_, value)| value.is_none()) {
            Some((column, _)) if values.iter().any(Option::is_some) => Err(table
                .error(row, column, "the crop is incomplete")
                .with_help("write crop_x, crop_y, crop_w and crop_h, or none of them")),
            _ => Ok(Crop::None),
        };
    };
    let px = |value: i64| u32::try_from(value).ok();
    Ok(match (px(x), px(y), px(width), px(height)) {
        (Some(x), Some(y), Some(width), Some(height)) => Crop::Cut(Rect {
            x,
            y,
            width,
            height,
        }),
        _ => Crop::Outside(format!("{x},{y},{width},{height}")),
    })
}

/// The position in the columns x, y and z (0 if not given).
fn pose(table: &Table, row: &Row) -> Result<Option<[f64; 3]>> {
    match (table.finite(row, "x")?, table.finite(row, "y")?) {
        (Some(x), Some(y)) => Ok(Some([x, y, table.finite(row, "z")?.unwrap_or(0.0)])),
        (None, None) => Ok(None),
        (x, _) => {
            let column = if x.is_none() { "x" } else { "y" };
            Err(table
                .error(row, column, "the pose is incomplete")
                .with_help("write both x and y, or none of them"))
        }
    }
}

fn has_all_or_none(table: &Table, columns: &[&str]) -> Result<bool> {
    let present = columns.iter().filter(|column| table.has(column)).count();
    if present == 0 || present == columns.len() {
        return Ok(present > 0);
    }
    let missing: Vec<_> = columns
        .iter()
        .filter(|column| !table.has(column))
        .copied()
        .collect();
    Err(header_error(
        table.path(),
        format!("the column `{}` is missing", missing.join("`, `")),
        format!("write all of {}, or none of them", columns.join(", ")),
    ))
}

fn header_error(path: &Path, message: String, help: String) -> Error {
    Error::new(ErrorKind::Format, message)
        .with_path(path)
        .with_place("line 1")
        .with_help(help)
}

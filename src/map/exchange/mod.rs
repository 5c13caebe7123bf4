//! How does a map become a folder of plain files, and back?
//!
//! Tables as CSV and arrays as NPY, so that a table program or numpy opens them; `maps/README.md`
//! describes each. The way back gives the same map, bit for bit ([`Snapshot::digest`]); what does not
//! fit is an error that names the file and the line or row.

mod file_storage;
mod npy;

pub use file_storage::{FileStorageMap, read_file_storage};

use std::fs;
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;

use crate::feature::{Features, Rect};
use crate::map::codec;
use crate::map::limits::{DESCRIPTOR_BYTES, KEYPOINT_BYTES, MAX_ATTACHMENT_BYTES, MAX_FEATURES};
use crate::map::node::Node;
use crate::map::snapshot::Snapshot;
use crate::map::types::{AppearanceUse, Edge, MapMeta, PlaceKey, SessionId, Visit, VisitId};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::{BitRow, Observation};

/// The layout of the folder that this code writes and reads.
const LAYOUT: &str = "1";
const META_COLUMNS: [&str; 2] = ["key", "value"];
const PLACE_COLUMNS: [&str; 6] = ["place", "num_visits", "num_features", "x", "y", "z"];
const EDGE_COLUMNS: [&str; 3] = ["from", "to", "name"];
const VISIT_COLUMNS: [&str; 10] = [
    "place",
    "visit",
    "session",
    "time_us",
    "source",
    "appearance_use",
    "num_features",
    "has_hidden",
    "num_experiences",
    "num_appearance",
];

impl Snapshot {
    /// Writes the map into `folder`, which must not exist yet or be empty.
    pub fn export(&self, folder: impl AsRef<Path>) -> Result<()> {
        let folder = folder.as_ref();
        prepare(folder)?;
        let table = |name: &str, columns: &[&str], rows: &[Vec<String>]| {
            write_table(&folder.join(name), columns, rows)
        };
        table("map.csv", &META_COLUMNS, &meta_rows(&self.meta))?;
        table("edges.csv", &EDGE_COLUMNS, &edge_rows(&self.edges))?;
        let mut places = Vec::new();
        let mut visits = Vec::new();
        let mut features = Arrays::default();
        let mut appearances = Arrays::default();
        let (mut seen, mut located_by) = (Vec::new(), Vec::new());
        for node in &self.nodes {
            places.push(place_row(node));
            features.push(&node.features);
            for (at, visit) in node.visits.iter().enumerate() {
                visits.push(visit_row(node, at));
                let len = node.log.seen_row(at).len();
                seen.extend((0..len).map(|i| match node.log.observation(at, i) {
                    Some(Observation::Seen) => 1,
                    Some(Observation::NotSeen) => 0,
                    Some(Observation::NotObservable) | None => u8::MAX,
                }));
                let row = node.experience_log.seen_row(at);
                located_by.extend((0..row.len()).map(|i| u8::from(row.get(i))));
                if let Some(appearance) = &visit.appearance {
                    appearances.push(appearance);
                }
            }
        }
        table("places.csv", &PLACE_COLUMNS, &places)?;
        table("visits.csv", &VISIT_COLUMNS, &visits)?;
        features.write(folder, "")?;
        appearances.write(folder, "appearance_")?;
        npy::write(&folder.join("seen.npy"), npy::I8, 0, &seen)?;
        npy::write(&folder.join("located_by.npy"), npy::U8, 0, &located_by)?;
        self.export_attachments(&folder.join("attachments"))
    }

    fn export_attachments(&self, folder: &Path) -> Result<()> {
        if self.attachments.is_empty() {
            return Ok(());
        }
        fs::create_dir(folder).map_err(|cause| Error::io(folder, &cause))?;
        for (name, value) in &self.attachments {
            let path = folder.join(format!("{name}.bin"));
            fs::write(&path, value).map_err(|cause| Error::io(&path, &cause))?;
        }
        Ok(())
    }

    /// Reads a folder that [`export`](Self::export) has written; a snapshot of generation 0.
    pub fn import(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref();
        let mut snapshot = Self::empty(read_meta(&folder.join("map.csv"))?);
        let mut features = Arrays::read(folder, "")?;
        let mut appearances = Arrays::read(folder, "appearance_")?;
        let seen_path = folder.join("seen.npy");
        let seen = npy::read(&seen_path, npy::I8, 0)?;
        let located_path = folder.join("located_by.npy");
        let located_by = npy::read(&located_path, npy::U8, 0)?;
        let mut seen = Cells::new(&seen_path, &seen, &[0, 1, u8::MAX], "1, 0 or -1");
        let mut located_by = Cells::new(&located_path, &located_by, &[0, 1], "1 or 0");
        let places = Table::read(&folder.join("places.csv"), &PLACE_COLUMNS)?;
        let visits = Table::read(&folder.join("visits.csv"), &VISIT_COLUMNS)?;
        let mut rows = visits.rows.iter();
        for place in &places.rows {
            let key: PlaceKey = places.key(place, 0)?;
            let num_features: usize = places.number(place, 2)?;
            let mut left = features.take(num_features)?;
            let mut node = Node::new(key);
            node.pose = places.pose(place)?;
            for _ in 0..places.number::<usize>(place, 1)? {
                let row = rows
                    .next()
                    .ok_or_else(|| visits.error(None, "the visits of a place are missing"))?;
                if visits.key(row, 0)? != node.key {
                    let message = format!("a visit of place `{}` is expected here", node.key);
                    return Err(visits.error(Some(row), message));
                }
                let visit = visits.visit(row, &mut appearances)?;
                let len: usize = visits.number(row, 6)?;
                let born = (len.checked_sub(node.features.len()))
                    .and_then(|num_born| left.split(num_born))
                    .ok_or_else(|| {
                        visits.error(Some(row), format!("the place has not {len} features here"))
                    })?;
                let (bits, hidden) = seen.take(len)?;
                let hidden = visits.flag(row, 7)?.then_some(hidden);
                let (located, _) = located_by.take(visits.number(row, 8)?)?;
                node.push_visit(visit, &born, bits, hidden, located)
                    .map_err(|error| visits.error(Some(row), error.to_string()))?;
            }
            if !left.keypoints.is_empty() {
                let message = format!("{num_features} features, which its visits do not reach");
                return Err(places.error(Some(place), message));
            }
            snapshot
                .push_node(node)
                .map_err(|error| places.error(Some(place), error.to_string()))?;
        }
        if let Some(row) = rows.next() {
            return Err(visits.error(Some(row), "this visit belongs to no place of places.csv"));
        }
        for rest in [&features, &appearances] {
            rest.must_be_empty()?;
        }
        seen.must_be_empty()?;
        located_by.must_be_empty()?;
        snapshot.edges = read_edges(&folder.join("edges.csv"))?;
        snapshot.import_attachments(&folder.join("attachments"))?;
        snapshot.check().map_err(|error| error.with_path(folder))?;
        Ok(snapshot)
    }

    fn import_attachments(&mut self, folder: &Path) -> Result<()> {
        if !folder.exists() {
            return Ok(());
        }
        let io = |cause: std::io::Error| Error::io(folder, &cause);
        for entry in fs::read_dir(folder).map_err(io)? {
            let path = entry.map_err(io)?.path();
            let io = |cause: std::io::Error| Error::io(&path, &cause);
            let name = path.file_stem().and_then(|name| name.to_str());
            let is_bin = path.extension().is_some_and(|extension| extension == "bin");
            let Some(name) = name.filter(|_| is_bin) else {
                return Err(format_error("this is no attachment `NAME.bin`").with_path(&path));
            };
            if fs::metadata(&path).map_err(io)?.len() > MAX_ATTACHMENT_BYTES as u64 {
                let message = format!("more than {MAX_ATTACHMENT_BYTES} bytes");
                return Err(format_error(message).with_path(&path));
            }
            let value = fs::read(&path).map_err(io)?;
            self.attachments.insert(name.into(), value.into());
        }
        Ok(())
    }
}

/// Makes the folder, or accepts an empty one.
fn prepare(folder: &Path) -> Result<()> {
    let io = |cause: std::io::Error| Error::io(folder, &cause);
    if folder.exists() {
        if fs::read_dir(folder).map_err(io)?.next().is_some() {
            return Err(Error::new(ErrorKind::Io, "this folder is not empty")
                .with_path(folder)
                .with_help("a folder is never overwritten: choose another name"));
        }
        Ok(())
    } else {
        fs::create_dir(folder).map_err(io)
    }
}

fn meta_rows(meta: &MapMeta) -> Vec<Vec<String>> {
    let crop = meta.crop;
    let size = meta.image_size;
    let number = |number: Option<u32>| number.map(|number| number.to_string());
    [
        ("layout", Some(LAYOUT.to_owned())),
        ("uuid", Some(format!("{:032x}", meta.uuid))),
        ("extractor", Some(meta.extractor.clone())),
        ("image_width", number(size.map(|size| size.0))),
        ("image_height", number(size.map(|size| size.1))),
        ("crop_x", number(crop.map(|crop| crop.x))),
        ("crop_y", number(crop.map(|crop| crop.y))),
        ("crop_width", number(crop.map(|crop| crop.width))),
        ("crop_height", number(crop.map(|crop| crop.height))),
        ("preset", Some(meta.preset.clone())),
        ("zone", meta.zone.clone()),
    ]
    .into_iter()
    .filter_map(|(key, value)| Some(vec![key.to_owned(), value?]))
    .collect()
}

fn edge_rows(edges: &[Edge]) -> Vec<Vec<String>> {
    let row = |edge: &Edge| {
        vec![
            edge.from.to_string(),
            edge.to.to_string(),
            edge.name.clone(),
        ]
    };
    edges.iter().map(row).collect()
}

fn place_row(node: &Node) -> Vec<String> {
    let mut row = vec![
        node.key.to_string(),
        node.visits.len().to_string(),
        node.features.len().to_string(),
    ];
    row.extend(match node.pose {
        // The shortest digits that read back as the same number.
        Some(pose) => pose.map(|x| x.to_string()),
        None => [const { String::new() }; 3],
    });
    row
}

fn visit_row(node: &Node, at: usize) -> Vec<String> {
    let visit = &node.visits[at];
    let num_appearance = (visit.appearance.as_ref()).map(|features| features.len().to_string());
    vec![
        node.key.to_string(),
        visit.id.to_string(),
        visit.session.to_string(),
        visit.time.as_us().to_string(),
        visit.source.clone(),
        visit.appearance_use.name().to_owned(),
        node.log.seen_row(at).len().to_string(),
        node.log.hidden_row(at).is_some().to_string(),
        node.experience_log.seen_row(at).len().to_string(),
        num_appearance.unwrap_or_default(),
    ]
}

fn write_table(path: &Path, columns: &[&str], rows: &[Vec<String>]) -> Result<()> {
    let error = |cause: csv::Error| csv_error(path, &cause);
    let file = fs::File::create_new(path).map_err(|cause| Error::io(path, &cause))?;
    let mut writer = csv::Writer::from_writer(file);
    writer.write_record(columns).map_err(error)?;
    for row in rows {
        writer.write_record(row).map_err(error)?;
    }
    writer.flush().map_err(|cause| Error::io(path, &cause))
}

fn csv_error(path: &Path, cause: &csv::Error) -> Error {
    let line = cause.position().map_or(0, csv::Position::line);
    format_error(cause.to_string())
        .with_place(format!("line {line}"))
        .with_path(path)
}

fn format_error(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, message)
}

/// Keypoints and descriptors as two arrays.
#[derive(Default)]
struct Arrays {
    keypoints: Vec<u8>,
    descriptors: Vec<u8>,
    /// The file of the keypoints, for messages.
    path: std::path::PathBuf,
    num_taken: usize,
}

impl Arrays {
    fn push(&mut self, features: &Features) {
        (self.keypoints).extend(codec::encode_keypoints(features.keypoints()));
        (self.descriptors).extend(codec::encode_descriptors(features.descriptors()));
    }

    fn write(&self, folder: &Path, prefix: &str) -> Result<()> {
        let path = |name: &str| folder.join(format!("{prefix}{name}.npy"));
        npy::write(&path("keypoints"), npy::F32, 4, &self.keypoints)?;
        npy::write(
            &path("descriptors"),
            npy::U8,
            DESCRIPTOR_BYTES,
            &self.descriptors,
        )
    }

    fn read(folder: &Path, prefix: &str) -> Result<Self> {
        let path = |name: &str| folder.join(format!("{prefix}{name}.npy"));
        let keypoints = npy::read(&path("keypoints"), npy::F32, 4)?;
        let descriptors = npy::read(&path("descriptors"), npy::U8, DESCRIPTOR_BYTES)?;
        let (points, rows) = (
            keypoints.len() / KEYPOINT_BYTES,
            descriptors.len() / DESCRIPTOR_BYTES,
        );
        if points == rows {
            Ok(Self {
                keypoints,
                descriptors,
                path: path("keypoints"),
                num_taken: 0,
            })
        } else {
            Err(format_error(format!(
                "{rows} descriptors do not pair with {points} keypoints"
            ))
            .with_path(path("descriptors")))
        }
    }

    /// The next `len` features, still as bytes.
    fn take(&mut self, len: usize) -> Result<Pending<'_>> {
        let start = self.num_taken;
        let end = start.checked_add(len).filter(|_| len <= MAX_FEATURES);
        let keypoints = end.and_then(|end| {
            (self.keypoints).get(start * KEYPOINT_BYTES..end.checked_mul(KEYPOINT_BYTES)?)
        });
        let (Some(keypoints), Some(end)) = (keypoints, end) else {
            let message = format!("{len} more rows are expected than there are");
            return Err(format_error(message)
                .with_place(format!("row {start}"))
                .with_path(&self.path));
        };
        self.num_taken = end;
        Ok(Pending {
            keypoints,
            descriptors: &self.descriptors[start * DESCRIPTOR_BYTES..end * DESCRIPTOR_BYTES],
            path: &self.path,
            row: start,
        })
    }

    fn must_be_empty(&self) -> Result<()> {
        let rows = self.keypoints.len() / KEYPOINT_BYTES;
        if self.num_taken == rows {
            return Ok(());
        }
        let message = format!("{} rows belong to nothing", rows - self.num_taken);
        Err(format_error(message)
            .with_place(format!("row {}", self.num_taken))
            .with_path(&self.path))
    }
}

/// Features that are not decoded yet.
struct Pending<'a> {
    keypoints: &'a [u8],
    descriptors: &'a [u8],
    path: &'a Path,
    row: usize,
}

impl Pending<'_> {
    /// The first `len`, if there are so many and their numbers are finite.
    fn split(&mut self, len: usize) -> Option<Features> {
        let (keypoints, left) =
            (self.keypoints).split_at_checked(len.checked_mul(KEYPOINT_BYTES)?)?;
        let (descriptors, others) = self.descriptors.split_at_checked(len * DESCRIPTOR_BYTES)?;
        (self.keypoints, self.descriptors) = (left, others);
        let keypoints = codec::decode_keypoints(keypoints).ok()?;
        codec::pair(keypoints, codec::decode_descriptors(descriptors).ok()?).ok()
    }

    fn all(mut self) -> Result<Features> {
        let len = self.keypoints.len() / KEYPOINT_BYTES;
        let (path, row) = (self.path, self.row);
        self.split(len).ok_or_else(|| {
            format_error(format!(
                "a number of the {len} keypoints from here is not finite"
            ))
            .with_place(format!("row {row}"))
            .with_path(path)
        })
    }
}

/// A one-dimensional array that is read from its start.
struct Cells<'a> {
    path: &'a Path,
    numbers: &'a [u8],
    valid: &'static [u8],
    wanted: &'static str,
    num_taken: usize,
}

impl<'a> Cells<'a> {
    fn new(path: &'a Path, numbers: &'a [u8], valid: &'static [u8], wanted: &'static str) -> Self {
        Self {
            path,
            numbers,
            valid,
            wanted,
            num_taken: 0,
        }
    }

    fn error(&self, row: usize, message: impl Into<String>) -> Error {
        format_error(message)
            .with_place(format!("row {row}"))
            .with_path(self.path)
    }

    /// The next `len` cells: which are 1, and which are -1.
    fn take(&mut self, len: usize) -> Result<(BitRow, BitRow)> {
        let start = self.num_taken;
        let cells = self.numbers[start..].get(..len);
        let Some(cells) = cells.filter(|_| len <= MAX_FEATURES) else {
            let message = format!("{len} more rows are expected than there are");
            return Err(self.error(start, message));
        };
        if let Some(at) = cells.iter().position(|cell| !self.valid.contains(cell)) {
            return Err(self.error(start + at, format!("{} is expected", self.wanted)));
        }
        self.num_taken += len;
        let row = |wanted: u8| {
            let mut row = BitRow::zeros(len);
            let ones = cells
                .iter()
                .enumerate()
                .filter(|&(_, &cell)| cell == wanted);
            ones.for_each(|(i, _)| row.set(i));
            row
        };
        Ok((row(1), row(u8::MAX)))
    }

    fn must_be_empty(&self) -> Result<()> {
        match self.numbers.len() - self.num_taken {
            0 => Ok(()),
            rest => Err(self.error(self.num_taken, format!("{rest} rows belong to nothing"))),
        }
    }
}

/// A CSV file with known columns.
struct Table {
    path: std::path::PathBuf,
    columns: &'static [&'static str],
    rows: Vec<csv::StringRecord>,
}

impl Table {
    fn read(path: &Path, columns: &'static [&'static str]) -> Result<Self> {
        let file = fs::File::open(path).map_err(|cause| Error::io(path, &cause))?;
        let mut reader = csv::ReaderBuilder::new()
            .buffer_capacity(1 << 16)
            .from_reader(file);
        let error = |cause: csv::Error| csv_error(path, &cause);
        if reader.headers().map_err(error)? != columns {
            return Err(
                format_error(format!("the columns {} are expected", columns.join(",")))
                    .with_place("line 1")
                    .with_path(path),
            );
        }
        let rows: csv::Result<_> = reader.records().collect();
        Ok(Self {
            path: path.to_owned(),
            columns,
            rows: rows.map_err(error)?,
        })
    }

    fn error(&self, row: Option<&csv::StringRecord>, message: impl Into<String>) -> Error {
        let line = row
            .and_then(csv::StringRecord::position)
            .map(csv::Position::line);
        let error = format_error(message).with_path(&self.path);
        match line {
            Some(line) => error.with_place(format!("line {line}")),
            None => error.with_place("end of the file"),
        }
    }

    fn cell_error(&self, row: &csv::StringRecord, column: usize, message: &str) -> Error {
        let place = row.position().map_or(0, csv::Position::line);
        format_error(message)
            .with_place(format!("line {place}, column {}", self.columns[column]))
            .with_path(&self.path)
    }

    fn number<T: FromStr>(&self, row: &csv::StringRecord, column: usize) -> Result<T> {
        (row[column].parse()).map_err(|_| {
            let message = format!("`{}` is no such number", row[column].escape_debug());
            self.cell_error(row, column, &message)
        })
    }

    fn bits_128(&self, row: &csv::StringRecord, column: usize) -> Result<u128> {
        u128::from_str_radix(&row[column], 16)
            .map_err(|_| self.cell_error(row, column, "32 hexadecimal digits are expected"))
    }

    fn flag(&self, row: &csv::StringRecord, column: usize) -> Result<bool> {
        (row[column].parse())
            .map_err(|_| self.cell_error(row, column, "`true` or `false` is expected"))
    }

    fn key(&self, row: &csv::StringRecord, column: usize) -> Result<PlaceKey> {
        PlaceKey::new(&row[column])
            .map_err(|error| self.cell_error(row, column, &error.to_string()))
    }

    fn pose(&self, row: &csv::StringRecord) -> Result<Option<[f64; 3]>> {
        if (3..6).all(|column| row[column].is_empty()) {
            return Ok(None);
        }
        Ok(Some([
            self.number(row, 3)?,
            self.number(row, 4)?,
            self.number(row, 5)?,
        ]))
    }

    fn visit(&self, row: &csv::StringRecord, appearances: &mut Arrays) -> Result<Visit> {
        let appearance = if row[9].is_empty() {
            None
        } else {
            let appearance = appearances.take(self.number(row, 9)?)?.all()?;
            Some(Arc::new(appearance))
        };
        Ok(Visit {
            id: VisitId(self.bits_128(row, 1)?),
            session: SessionId(self.bits_128(row, 2)?),
            time: Time::from_us(self.number(row, 3)?),
            source: row[4].to_owned(),
            appearance,
            appearance_use: AppearanceUse::named(&row[5]).ok_or_else(|| {
                self.cell_error(row, 5, "`experience` or `recognised` is expected")
            })?,
        })
    }
}

fn read_meta(path: &Path) -> Result<MapMeta> {
    let table = Table::read(path, &META_COLUMNS)?;
    let find = |key: &str| table.rows.iter().find(|row| &row[0] == key);
    let need = |key: &str| {
        find(key).ok_or_else(|| table.error(None, format!("a row with the key `{key}` is missing")))
    };
    let number = |key: &str| match find(key) {
        Some(row) => table.number(row, 1).map(Some),
        None => Ok(None),
    };
    let layout = need("layout")?;
    if &layout[1] != LAYOUT {
        return Err(table
            .cell_error(layout, 1, "this layout of folders is not known")
            .with_help("use a newer chronotope"));
    }
    let image_size = number("image_width")?.zip(number("image_height")?);
    let crop = match (
        number("crop_x")?,
        number("crop_y")?,
        number("crop_width")?,
        number("crop_height")?,
    ) {
        (Some(x), Some(y), Some(width), Some(height)) => Some(Rect {
            x,
            y,
            width,
            height,
        }),
        _ => None,
    };
    Ok(MapMeta {
        uuid: table.bits_128(need("uuid")?, 1)?,
        extractor: need("extractor")?[1].to_owned(),
        image_size,
        crop,
        preset: need("preset")?[1].to_owned(),
        zone: find("zone").map(|row| row[1].to_owned()),
    })
}

fn read_edges(path: &Path) -> Result<Vec<Edge>> {
    let table = Table::read(path, &EDGE_COLUMNS)?;
    let edge = |row: &csv::StringRecord| {
        Ok(Edge {
            from: table.key(row, 0)?,
            to: table.key(row, 1)?,
            name: row[2].to_owned(),
        })
    };
    table.rows.iter().map(edge).collect()
}

//! How does a folder of plain files become a map?

use std::path::Path;
use std::sync::Arc;

use super::arrays::{Arrays, Cells};
use super::folder::Folder;
use super::layout::{
    EDGE_COLUMNS, LAYOUT, LAYOUT_1, MANIFEST, META_COLUMNS, PLACE_COLUMNS, VISIT_COLUMNS,
    format_error,
};
use super::npy;
use super::table::Table;
use crate::feature::Rect;
use crate::map::limits::MAX_ATTACHMENT_BYTES;
use crate::map::node::Node;
use crate::map::snapshot::Snapshot;
use crate::map::types::{AppearanceUse, Edge, MapMeta, PlaceKey, SessionId, Visit, VisitId};
use fremen::error::Result;
use fremen::time::Time;

/// The folder of attachments in the folder.
const ATTACHMENTS: &str = "attachments";

impl Snapshot {
    /// Reads a folder that [`export`](Self::export) has written; a snapshot of generation 0.
    pub fn import(folder: impl AsRef<Path>) -> Result<Self> {
        let path = folder.as_ref();
        let folder = &Folder::open(path)?;
        let table =
            |name: &str, columns| Table::parse(&folder.path_of(name), &folder.read(name)?, columns);
        let meta = read_meta(&table("map.csv", &META_COLUMNS)?, folder.has_manifest())?;
        let mut snapshot = Self::empty(meta);
        let mut features = Arrays::read(folder, "")?;
        let mut appearances = Arrays::read(folder, "appearance_")?;
        let seen_path = folder.path_of("seen.npy");
        let seen = npy::decode(&seen_path, folder.read("seen.npy")?, npy::I8, 0)?;
        let located_path = folder.path_of("located_by.npy");
        let located_by = npy::decode(&located_path, folder.read("located_by.npy")?, npy::U8, 0)?;
        let mut seen = Cells::new(&seen_path, &seen, &[0, 1, u8::MAX], "1, 0 or -1");
        let mut located_by = Cells::new(&located_path, &located_by, &[0, 1], "1 or 0");
        let places = table("places.csv", &PLACE_COLUMNS)?;
        let visits = table("visits.csv", &VISIT_COLUMNS)?;
        let mut rows = visits.rows.iter();
        for place in &places.rows {
            let key: PlaceKey = places.key(place, 0)?;
            let num_features: usize = places.number(place, 2)?;
            let mut left = features.take(num_features)?;
            let mut node = Node::new(key);
            (node.set_pose(places.pose(place)?))
                .map_err(|error| places.error(Some(place), error.to_string()))?;
            for _ in 0..places.number::<usize>(place, 1)? {
                let row = rows
                    .next()
                    .ok_or_else(|| visits.error(None, "the visits of a place are missing"))?;
                if visits.key(row, 0)? != *node.key() {
                    let message = format!("a visit of place `{}` is expected here", node.key());
                    return Err(visits.error(Some(row), message));
                }
                let visit = read_visit(&visits, row, &mut appearances)?;
                let len: usize = visits.number(row, 6)?;
                let born = (len.checked_sub(node.features().len()))
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
        snapshot.edges = read_edges(&table("edges.csv", &EDGE_COLUMNS)?)?;
        snapshot.import_attachments(folder)?;
        snapshot.check().map_err(|error| error.with_path(path))?;
        Ok(snapshot)
    }

    fn import_attachments(&mut self, folder: &Folder) -> Result<()> {
        for file in folder.names_in(ATTACHMENTS)? {
            let path = folder.path_of(&file);
            let name = (file.strip_prefix(ATTACHMENTS))
                .and_then(|name| name.strip_prefix('/')?.strip_suffix(".bin"));
            let Some(name) = name.filter(|name| !name.contains('/')) else {
                return Err(format_error("this is no attachment `NAME.bin`").with_path(&path));
            };
            let value = folder.read(&file)?;
            if value.len() > MAX_ATTACHMENT_BYTES {
                let message = format!("more than {MAX_ATTACHMENT_BYTES} bytes");
                return Err(format_error(message).with_path(&path));
            }
            self.attachments.insert(name.into(), value.into());
        }
        Ok(())
    }
}

fn read_meta(table: &Table, has_manifest: bool) -> Result<MapMeta> {
    let find = |key: &str| table.rows.iter().find(|row| &row[0] == key);
    let need = |key: &str| {
        find(key).ok_or_else(|| table.error(None, format!("a row with the key `{key}` is missing")))
    };
    let number = |key: &str| match find(key) {
        Some(row) => table.number(row, 1).map(Some),
        None => Ok(None),
    };
    let layout = need("layout")?;
    if &layout[1] == LAYOUT && !has_manifest {
        return Err(table
            .error(
                None,
                format!("the folder has no {MANIFEST}, so files may be missing"),
            )
            .with_help("export the map again"));
    }
    if ![LAYOUT, LAYOUT_1].contains(&&layout[1]) {
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

fn read_visit(table: &Table, row: &csv::StringRecord, appearances: &mut Arrays) -> Result<Visit> {
    let appearance = if row[9].is_empty() {
        None
    } else {
        let appearance = appearances.take(table.number(row, 9)?)?.all()?;
        Some(Arc::new(appearance))
    };
    Ok(Visit {
        id: VisitId(table.bits_128(row, 1)?),
        session: SessionId(table.bits_128(row, 2)?),
        time: Time::from_us(table.number(row, 3)?),
        source: row[4].to_owned(),
        appearance,
        appearance_use: AppearanceUse::named(&row[5])
            .ok_or_else(|| table.cell_error(row, 5, "`experience` or `recognised` is expected"))?,
    })
}

fn read_edges(table: &Table) -> Result<Vec<Edge>> {
    let edge = |row: &csv::StringRecord| {
        Ok(Edge {
            from: table.key(row, 0)?,
            to: table.key(row, 1)?,
            name: row[2].to_owned(),
        })
    };
    table.rows.iter().map(edge).collect()
}

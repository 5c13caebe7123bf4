//! Which tables has each format?
//!
//! `maps/README.md` states the same for people, down to the byte. Not for reading or writing rows:
//! that is `load` and `change`.

use chronotope_store::{Holds, Kind, Table};

use crate::map::limits::{
    DESCRIPTOR_BYTES, KEYPOINT_BYTES, MAX_ATTACHMENT_BYTES, MAX_ATTACHMENT_NAME_BYTES,
    MAX_FEATURES, MAX_TEXT_BYTES,
};

const MAX_KEYPOINTS_BYTES: usize = MAX_FEATURES * KEYPOINT_BYTES;
const MAX_DESCRIPTORS_BYTES: usize = MAX_FEATURES * DESCRIPTOR_BYTES;
const MAX_BITS_BYTES: usize = MAX_FEATURES / 8;

/// What a map file is to the store.
pub(super) static MAP: Kind = Kind {
    noun: "map",
    // `Chro` in ASCII, big-endian as SQLite stores it.
    application_id: 0x4368_726f,
    version: 3,
    tables: tables_of,
    references: &["meta", "edges"],
    program: "chronotope",
    tool: "chronotope map",
    maker: "chronotope map build",
    help_for_folder: "to learn a map from a folder of images use `chronotope map build`",
};

pub(super) const GENERATION: Table = Table {
    name: "generation",
    create: "CREATE TABLE generation (number INTEGER PRIMARY KEY, parent INTEGER, \
             prunes INTEGER NOT NULL, time_us INTEGER NOT NULL, meta INTEGER NOT NULL, \
             edges INTEGER NOT NULL, num_places INTEGER NOT NULL, num_visits INTEGER NOT NULL, \
             num_features INTEGER NOT NULL, digest BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &GENERATION_COLUMNS,
    limits: &[("digest", 32)],
    holds: Holds::All,
};

const GENERATION_COLUMNS: [&str; 10] = [
    "number",
    "parent",
    "prunes",
    "time_us",
    "meta",
    "edges",
    "num_places",
    "num_visits",
    "num_features",
    "digest",
];

/// The same table in format 1, where a generation's parent is the one before it.
pub(super) const GENERATION_1: Table = Table {
    name: "generation",
    create: "CREATE TABLE generation (number INTEGER PRIMARY KEY, time_us INTEGER NOT NULL, \
             meta INTEGER NOT NULL, edges INTEGER NOT NULL, num_places INTEGER NOT NULL, \
             num_visits INTEGER NOT NULL, num_features INTEGER NOT NULL, digest BLOB NOT NULL, \
             crc INTEGER NOT NULL) STRICT",
    columns: &{
        let [number, _parent, _prunes, a, b, c, d, e, f, g] = GENERATION_COLUMNS;
        [number, a, b, c, d, e, f, g]
    },
    limits: &[("digest", 32)],
    holds: Holds::All,
};

pub(super) const META: Table = Table {
    name: "meta",
    create: "CREATE TABLE meta (generation INTEGER PRIMARY KEY, uuid BLOB NOT NULL, \
             extractor TEXT NOT NULL, image_width INTEGER, image_height INTEGER, crop_x INTEGER, \
             crop_y INTEGER, crop_width INTEGER, crop_height INTEGER, preset TEXT NOT NULL, \
             zone TEXT, crc INTEGER NOT NULL) STRICT",
    columns: &[
        "generation",
        "uuid",
        "extractor",
        "image_width",
        "image_height",
        "crop_x",
        "crop_y",
        "crop_width",
        "crop_height",
        "preset",
        "zone",
    ],
    limits: &[
        ("uuid", 16),
        ("extractor", MAX_TEXT_BYTES),
        ("preset", MAX_TEXT_BYTES),
        ("zone", MAX_TEXT_BYTES),
    ],
    holds: Holds::Newest,
};

pub(super) const EDGE: Table = Table {
    name: "edge",
    create: "CREATE TABLE edge (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             origin TEXT NOT NULL, destination TEXT NOT NULL, name TEXT NOT NULL, \
             crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "origin", "destination", "name"],
    limits: &[
        ("origin", MAX_TEXT_BYTES),
        ("destination", MAX_TEXT_BYTES),
        ("name", MAX_TEXT_BYTES),
    ],
    holds: Holds::Listed("edges"),
};

pub(super) const PLACE: Table = Table {
    name: "place",
    create: "CREATE TABLE place (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             key TEXT NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "key"],
    limits: &[("key", MAX_TEXT_BYTES)],
    holds: Holds::All,
};

pub(super) const POSE: Table = Table {
    name: "pose",
    create: "CREATE TABLE pose (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             place INTEGER NOT NULL, x REAL, y REAL, z REAL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "place", "x", "y", "z"],
    limits: &[],
    holds: Holds::NewestOf("place"),
};

pub(super) const VISIT: Table = Table {
    name: "visit",
    create: "CREATE TABLE visit (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             place INTEGER NOT NULL, number INTEGER NOT NULL, visit BLOB NOT NULL, \
             session BLOB NOT NULL, time_us INTEGER NOT NULL, source TEXT NOT NULL, \
             appearance_use TEXT NOT NULL, num_features INTEGER NOT NULL, seen BLOB NOT NULL, \
             hidden BLOB, located_by BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &[
        "id",
        "generation",
        "place",
        "number",
        "visit",
        "session",
        "time_us",
        "source",
        "appearance_use",
        "num_features",
        "seen",
        "hidden",
        "located_by",
    ],
    limits: &[
        ("visit", 16),
        ("session", 16),
        ("source", MAX_TEXT_BYTES),
        ("appearance_use", MAX_TEXT_BYTES),
        ("seen", MAX_BITS_BYTES),
        ("hidden", MAX_BITS_BYTES),
        ("located_by", MAX_BITS_BYTES),
    ],
    holds: Holds::Since(&RENEWAL, "place"),
};

/// A table of features by the visit that they belong to.
macro_rules! features_of_visits {
    ($name:literal) => {
        Table {
            name: $name,
            create: concat!(
                "CREATE TABLE ",
                $name,
                " (visit INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
                 keypoints BLOB NOT NULL, descriptors BLOB NOT NULL, crc INTEGER NOT NULL) STRICT"
            ),
            columns: &["visit", "generation", "keypoints", "descriptors"],
            limits: &[
                ("keypoints", MAX_KEYPOINTS_BYTES),
                ("descriptors", MAX_DESCRIPTORS_BYTES),
            ],
            holds: Holds::With(&VISIT),
        }
    };
}

pub(super) const FEATURE: Table = features_of_visits!("feature");
pub(super) const APPEARANCE: Table = features_of_visits!("appearance");

pub(super) const ATTACHMENT: Table = Table {
    name: "attachment",
    create: "CREATE TABLE attachment (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             name TEXT NOT NULL, value BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "name", "value"],
    limits: &[
        ("name", MAX_ATTACHMENT_NAME_BYTES),
        ("value", MAX_ATTACHMENT_BYTES),
    ],
    holds: Holds::NewestOf("name"),
};

/// Places that are written anew: of a place in this table only visits of the same generation and
/// later ones hold.
pub(super) const RENEWAL: Table = Table {
    name: "renewal",
    create: "CREATE TABLE renewal (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             place INTEGER NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "place"],
    limits: &[],
    holds: Holds::NewestOf("place"),
};

/// Every table of today's format, in order of creation.
static TABLES: [&Table; 10] = [
    &GENERATION,
    &META,
    &EDGE,
    &PLACE,
    &POSE,
    &VISIT,
    &FEATURE,
    &APPEARANCE,
    &ATTACHMENT,
    &RENEWAL,
];

/// Every table of format 1.
static TABLES_1: [&Table; 8] = {
    let [_, meta, edge, place, pose, visit, feature, appearance, ..] = TABLES;
    [
        &GENERATION_1,
        meta,
        edge,
        place,
        pose,
        visit,
        feature,
        appearance,
    ]
};

/// Every table of a format that this code reads.
fn tables_of(version: u32) -> &'static [&'static Table] {
    match version {
        1 => &TABLES_1,
        // Without `renewal`.
        2 => &TABLES[..TABLES.len() - 1],
        _ => &TABLES,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_names_its_columns_and_limits_in_order() {
        for &table in TABLES_1.iter().chain(&TABLES) {
            let mut rest = table.create;
            for column in table.columns.iter().chain(&["crc"]) {
                let at = rest.find(&format!("{column} ")).expect("in order");
                rest = &rest[at + column.len()..];
            }
            for (column, _) in table.limits {
                assert!(table.columns.contains(column), "{}.{column}", table.name);
            }
        }
    }
}

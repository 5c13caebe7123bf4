//! Which tables has a file of a grid?

use chronotope_store::{Holds, Kind, Table};

/// What a grid file is to the store.
pub(super) static GRID: Kind = Kind {
    noun: "grid",
    // `ChGr` in ASCII.
    application_id: 0x4368_4772,
    version: 2,
    tables: |version| match version {
        1 => &[&GENERATION, &SPEC, &BATCH, &TILE, &RESET],
        _ => &[&GENERATION, &SPEC, &BATCH, &TILE, &RESET, &ATTACHMENT],
    },
    references: &[],
    program: "chronotope",
    tool: "chronotope grid",
    maker: "chronotope grid build",
    help_for_folder: "to learn a grid from a folder of maps use `chronotope grid build`",
};

const GENERATION: Table = Table {
    name: "generation",
    create: "CREATE TABLE generation (number INTEGER PRIMARY KEY, parent INTEGER, \
             prunes INTEGER NOT NULL, time_us INTEGER NOT NULL, num_observations INTEGER NOT NULL, \
             num_tiles INTEGER NOT NULL, digest BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &[
        "number",
        "parent",
        "prunes",
        "time_us",
        "num_observations",
        "num_tiles",
        "digest",
    ],
    limits: &[("digest", 32)],
    holds: Holds::All,
};

/// Where the cells are; one row.
pub(super) const SPEC: Table = Table {
    name: "spec",
    create: "CREATE TABLE spec (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             is_2d INTEGER NOT NULL, origin_x_m REAL NOT NULL, origin_y_m REAL NOT NULL, \
             origin_z_m REAL NOT NULL, resolution_m REAL NOT NULL, width INTEGER NOT NULL, \
             height INTEGER NOT NULL, depth INTEGER NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &[
        "id",
        "generation",
        "is_2d",
        "origin_x_m",
        "origin_y_m",
        "origin_z_m",
        "resolution_m",
        "width",
        "height",
        "depth",
    ],
    limits: &[],
    holds: Holds::Newest,
};

/// Observations that were committed together: their times and observers.
pub(super) const BATCH: Table = Table {
    name: "batch",
    create: "CREATE TABLE batch (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             line INTEGER NOT NULL, observations BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "line", "observations"],
    limits: &[("observations", 1 << 28)],
    holds: Holds::Since(&RESET, "line"),
};

/// What the observations of a batch saw of a tile.
pub(super) const TILE: Table = Table {
    name: "tile",
    create: "CREATE TABLE tile (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             line INTEGER NOT NULL, batch INTEGER NOT NULL, tile INTEGER NOT NULL, \
             changes BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "line", "batch", "tile", "changes"],
    limits: &[("changes", 1 << 30)],
    holds: Holds::Since(&RESET, "line"),
};

/// Where everything before is replaced: what was forgotten is not read any more.
pub(super) const RESET: Table = Table {
    name: "reset",
    create: "CREATE TABLE reset (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             line INTEGER NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "line"],
    limits: &[],
    holds: Holds::NewestOf("line"),
};

/// What is kept beside the observations, by name; an empty value takes it away.
pub(super) const ATTACHMENT: Table = Table {
    name: "attachment",
    create: "CREATE TABLE attachment (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             name TEXT NOT NULL, value BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "name", "value"],
    limits: &[("name", 256), ("value", 1 << 28)],
    holds: Holds::NewestOf("name"),
};

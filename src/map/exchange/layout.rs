//! Which files and columns has an exported folder?

use std::path::Path;

use fremen::error::{Error, ErrorKind};

/// The layout of the folder that this code writes.
pub(super) const LAYOUT: &str = "2";
/// The layout without a manifest, which is read, too.
pub(super) const LAYOUT_1: &str = "1";
/// The file that lists all others.
pub(super) const MANIFEST: &str = "manifest.csv";
pub(super) const MANIFEST_COLUMNS: [&str; 3] = ["file", "num_bytes", "sha256"];
pub(super) const META_COLUMNS: [&str; 2] = ["key", "value"];
pub(super) const PLACE_COLUMNS: [&str; 6] = ["place", "num_visits", "num_features", "x", "y", "z"];
pub(super) const EDGE_COLUMNS: [&str; 3] = ["from", "to", "name"];
pub(super) const VISIT_COLUMNS: [&str; 10] = [
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

pub(super) fn csv_error(path: &Path, cause: &csv::Error) -> Error {
    let line = cause.position().map_or(0, csv::Position::line);
    format_error(cause.to_string())
        .with_place(format!("line {line}"))
        .with_path(path)
}

pub(super) fn format_error(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, message)
}

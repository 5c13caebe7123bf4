//! How does a map become a folder of plain files, and back?
//!
//! Tables as CSV and arrays as NPY, so that a table program or numpy opens them; `maps/README.md`
//! describes each, and one table lists them all with their SHA-256. The way back gives the same
//! map, bit for bit ([`Snapshot::digest`](super::Snapshot::digest)); what does not fit is an error
//! that names the file and the line or row.

mod arrays;
mod export;
mod file_storage;
mod folder;
mod import;
mod layout;
mod npy;
mod table;

pub use file_storage::{FileStorageMap, decode_file_storage, read_file_storage};

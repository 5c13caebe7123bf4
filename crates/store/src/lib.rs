//! How is something kept in one file of generations that survives what happens to files?
//!
//! A [`Store`] is one `SQLite` file. A commit appends rows and makes one [`Generation`]; an earlier
//! one can be returned to, and those that nobody will return to can be pruned. Every row has a
//! checksum, every generation the digest of its content, so that damage is found and named.
//!
//! This crate knows nothing of what a row means. Its user describes the [`Kind`] of file and its
//! [`Table`]s, says what a generation's content is, and reads and writes rows through [`Reader`]
//! and [`Writer`]. (`chronotope` keeps its maps so; `tests/it` keeps cells with counts.)

mod connection;
mod fault;
mod generation;
mod header;
mod heal;
mod journal;
mod kind;
mod mapped;
mod prune;
mod row;
mod store;
mod table;
mod transaction;
mod value;

pub use connection::Access;
pub use fault::{Fault, Faults};
pub use generation::{Generation, Lineage, Tip, ends};
pub use kind::Kind;
pub use mapped::MappedFile;
pub use row::Row;
pub use rusqlite::types::ValueRef;
pub use store::Store;
pub use table::{Holds, Table, row_crc};
pub use transaction::{Check, Reader, Writer};
pub use value::{Sink, put_value};

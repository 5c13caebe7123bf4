//! How is a grid kept in a file, whatever happens to the machine?
//!
//! A [`GridFile`] is a file of generations (`chronotope_store`): each commit appends the new
//! observations, an earlier generation can be returned to, every row has a checksum and every
//! generation a digest of the whole content. A process that is killed while it writes leaves the
//! old generation or the new one.

mod codec;
mod grid_file;
mod tables;

pub use chronotope_store::{Access, Fault, Generation};
pub(crate) use codec::{decode_observations, decode_tile, encode_observations, encode_tile};
pub use grid_file::{Attachments, GridFile, UNDIGESTED, Verified};

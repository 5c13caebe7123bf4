//! How is a map kept in one file that survives what happens to files?

mod change;
#[cfg(test)]
mod damage;
pub(super) mod digest;
pub(super) mod format;
mod load;
mod mapped;
mod prune;
mod stamp;
mod store;
mod verify;

pub use digest::ContentDigest;
pub(crate) use format::MAX_TEXT_BYTES;
pub use load::{Fault, Generation};
pub(crate) use mapped::MappedFile;
pub use stamp::Stamp;
pub use store::{Map, Pruned};
pub use verify::VerifyReport;

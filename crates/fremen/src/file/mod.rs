//! How is a file opened that may be hostile, and one written so that nothing is lost?
//!
//! [`input`] opens every file that comes from outside, [`output`] writes every file that the
//! project writes, and [`OutputFolder`] every folder that is whole or not there; only the store
//! writes otherwise, by `SQLite`, and its writers take [`Turn`]s. A test of the architecture holds
//! all other code to these.

mod folder;
pub mod input;
pub mod output;
mod turn;

pub use folder::OutputFolder;
pub use input::{number_at, open, open_beside, read, read_text};
pub use output::{OutputFile, OutputKind, Unfinished, rename_new, sync_folder_of};
pub use turn::Turn;

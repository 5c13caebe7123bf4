//! Where do images, times, places, edges and truth come from?
//!
//! A [`Dataset`] is a sorted list of [`Entry`]s: one image of one place at one time. It comes from
//! a folder with an `index.csv`, from one of the published layouts (GRIEF, FreLoc / Witham Wharf,
//! NCLT), read as a [`Manifest`] says, or from the synthetic world.
//!
//! What cannot be trusted as a whole is an error: no index, a bad header, a bad number, a time that
//! is none. What concerns one image is left out, counted and listed in [`Dataset::problems`]: a
//! missing or empty file, a crop that is not inside its image, a second row for the same place and
//! time, a place that the manifest does not list. Nothing is left out in silence, and nothing is
//! ever written.

mod adjusted;
mod capture;
mod check;
mod doubt;
mod file_image;
mod file_name;
mod folder;
mod layouts;
mod lookup;
mod make_index;
mod manifest;
mod masked;
mod paths;
mod pictures;
mod table;
mod types;

pub mod synthetic;

pub use adjusted::scale_between;
pub use capture::exif_time;
pub use check::{CheckOptions, CheckReport, PlaceSummary, SizeCount};
pub(crate) use doubt::needs_room;
pub use doubt::{blind_doubt, blindness};
pub use file_image::FileImage;
pub use lookup::{FileIdentity, Lookup};
pub use make_index::{IndexOptions, IndexSource, MadeIndex};
pub use manifest::{Checksums, Layout, Manifest, Mask, NcltPlace, Quantum, Side, Split, TimeRule};
pub use pictures::{FoundPicture, PictureFinder, PictureTime, TimeSource};
pub use types::{Clock, Dataset, Entry, ImageSource, Problem, ReadOptions};

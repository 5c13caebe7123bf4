//! How are maps read that others wrote, and written so that others read them?
//!
//! [`MapServerMap`] is what ROS's `map_server` (`nav2_map_server`) loads and saves: a picture and
//! a YAML file that says what its shades mean. [`read_index`] reads a list of such maps with their
//! times.

mod index;
mod map_server;
mod mode;
mod picture;
mod place;
mod yaml;

pub use index::{IndexEntry, read_index};
pub use map_server::{MapServerMap, UNKNOWN};
pub use mode::MapMode;
pub use place::{common_spec, patch_of};

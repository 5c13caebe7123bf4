//! How are maps read that others wrote, and written so that others read them?
//!
//! [`MapServerMap`] is what ROS's `map_server` (`nav2_map_server`) loads and saves: a picture and
//! a YAML file that says what its shades mean. [`read_index`] reads a list of such maps with their
//! times. 3-D maps come and go as `OctoMap` trees ([`read_octomap`]) and as lists of points in PLY or
//! CSV ([`read_points`]). [`read_map`] and [`write_map`] tell them by their names.

mod any;
mod index;
mod map_server;
mod mode;
mod octomap;
mod picture;
mod place;
mod points;
mod yaml;

pub use any::{read_map, write_map};
pub use index::{IndexEntry, read_index};
pub use map_server::{MapServerMap, UNKNOWN};
pub use mode::MapMode;
pub use octomap::{read_octomap, write_octomap};
pub use place::{common_spec, patch_of, patch_of_occupancy};
pub use points::{MapPoint, map_of_points, read_points, write_points};

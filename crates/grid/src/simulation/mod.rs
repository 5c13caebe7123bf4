//! What would a robot have seen in a world whose truth is known at every moment?
//!
//! Worlds for experiments: an [`Office`] after the paper on lifelong maps (IROS 2016) and the
//! thesis' world of [`Boxes`]. Both are functions of a seed and a time: nothing is stored, any moment
//! can be asked for again, and every run gives the same.

mod boxes;
mod drive;
mod habit;
mod laser;
mod office;
mod office_3d;
mod people;
mod scene;

pub use boxes::{BoxPeriods, Boxes};
pub use drive::{Drive, DriveConfig, drive_along, resample};
pub use habit::{Habit, MONDAY, day_of, hour_of, is_weekend};
pub use laser::Laser;
pub use office::{Layout, Office};
pub use office_3d::{Frames, Office3d};
pub use scene::Scene;

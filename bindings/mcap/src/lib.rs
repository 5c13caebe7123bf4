//! Which maps are in a robot's bags, and which answers go into them?
//!
//! A bag (MCAP, or `.db3` with its `metadata.yaml`) is a [`Dataset`](chronotope::dataset::Dataset)
//! here: [`Recording::read`] gives its images with places and times, and
//! [`Training`](chronotope::training::Training) makes of it the map that the same images in a folder
//! would give. [`AnswerFile`] is the other way: what a [`Robot`](chronotope::robot::Robot) says of a
//! bag's images, as channels that Foxglove shows beside them.
//!
//! ```no_run
//! use std::sync::Arc;
//!
//! use chronotope::training::{Training, TrainingConfig};
//! use chronotope_bags::{Bag, BagOptions, Places, Recording};
//!
//! # fn main() -> chronotope::Result<()> {
//! let bag = Arc::new(Bag::open("monday.mcap")?);
//! let options = BagOptions::new(Places::Poses(None));
//! let recording = Recording::read(&bag, &options, None)?;
//! let out = "monday.map".as_ref();
//! let mut training = Training::to_build_from(recording.dataset, out, &TrainingConfig::default())?;
//! training.learn(&|| false, &mut |_| {})?;
//! training.finish()?;
//! # Ok(())
//! # }
//! ```
//!
//! Not for live robots: a node subscribes, a bag is read from its beginning.

mod answers;
mod bag;
mod cdr;
mod dataset;
mod message;
mod picture;
mod places;
mod table;
mod track;

pub use answers::{Answer, AnswerFile, State, foxglove_layout};
pub use bag::{Bag, Contents, Topic, TopicSummary};
pub use dataset::{BagOptions, Origin, Places, Recording, StampSource};
pub use message::{CameraInfo, EncodedImage, MessageType, RawImage};
pub use places::Vicinity;

//! How do many robots learn what one machine would have learnt of all their logs?
//!
//! By sums of whole numbers. What FreMEn needs of a history is a few sums
//! ([`SpectralSums`](fremen::spectrum::SpectralSums)), which are exact: the sums of parts of the history,
//! made anywhere and merged in any order, are bit for bit those of the whole. So any engine that can map
//! and merge distributes the work, and one machine without any engine gives the same bytes.
//!
//! What must not happen is that an observation counts twice. A [`FleetLog`] holds statements by the
//! identity of their visit, each once, at two bits a feature; sums are made of it last.
//!
//! ```no_run
//! use std::path::PathBuf;
//!
//! use chronotope_fleet::table::{ModelWriter, files_of, read_observations};
//! use chronotope_fleet::{FleetConfig, learn};
//!
//! # fn main() -> fremen::Result<()> {
//! // What two robots have uploaded. A folder would have to hold observations only, and `_SUCCESS`.
//! let uploads = ["robot-17/observations.parquet", "robot-18/observations.parquet"];
//! let files = files_of(&uploads.map(PathBuf::from))?;
//! let (log, report) = read_observations(&files, &Default::default())?;
//! let models = learn(&log, &FleetConfig::default())?;
//! let mut table = ModelWriter::begin("models.parquet")?;
//! table.write(&models)?;
//! table.finish()
//! # }
//! ```
//!
//! # Rooms
//!
//! | room | the question it answers |
//! |---|---|
//! | `states` | at which features did one visit look, and which did it see? |
//! | `log` | which visits are known, from whomever and however often they came? |
//! | `sums` | what are the sums of every feature of a place? |
//! | `model` | what does a fleet know of one feature? |
//! | [`table`] | how are these kept as Parquet? (feature `parquet`) |

mod log;
mod model;
mod states;
mod sums;
#[cfg(feature = "parquet")]
pub mod table;

pub use log::{Contradiction, FleetLog, PlaceLog, Visit};
pub use model::{FeatureModel, FleetConfig, learn, model_of};
pub use states::States;
pub use sums::FeatureSums;

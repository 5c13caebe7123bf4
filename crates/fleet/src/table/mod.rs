//! How are observations, features and models kept as Parquet, so that a robot writes what a cluster reads?
//!
//! Three tables, described in `docs/fleet.md`, of version 1. Text, identities and times repeat, so they are
//! dictionaries; row groups end where a place ends, so that what is asked of one place or day is found by
//! the statistics of the row groups alone. Whatever does not fit is an error that names file, row group and
//! column. Files are whole or not there, and a folder of them is finished once `_SUCCESS` is in it.

mod columns;
mod features;
mod folder;
mod models;
mod observations;
mod reader;
mod writer;

pub use features::{FeatureRow, FeatureWriter, read_extractor, read_features};
pub use folder::{SUCCESS, TableFolder, files_of};
pub use models::{ModelWriter, read_models};
pub use observations::{ObservationWriter, ReadConfig, ReadReport, read_observations, read_series};

//! Where does a run read, and where does it write?

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use chronotope::feature::{Extractor, ExtractorConfig, Models};

use crate::data::extractor;
use crate::suite::Suite;

/// Where a run reads and writes.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// The folder that holds the dataset, or the folders of several.
    pub data: Option<PathBuf>,
    /// Where results go; created if missing.
    pub out: PathBuf,
    /// Where extracted features are kept from run to run.
    pub cache: PathBuf,
    /// Of a series' suite: the share of samples that thinning keeps, in place of the suite's.
    pub share: Option<f64>,
    /// Of a synthetic suite: the number of worlds, in place of the suite's.
    pub worlds: Option<u64>,
    /// What finds the features of suites of images, if not the shipped recipe.
    pub extractor: Option<ExtractorConfig>,
    /// Where its network is, if it has one.
    pub models: Models,
    /// The command line, for the report.
    pub command: String,
}

impl RunOptions {
    /// What finds the features of suites of images.
    pub fn extractor(&self) -> Result<Box<dyn Extractor>> {
        let config = self.extractor.clone().unwrap_or_else(extractor);
        Ok(config.build_with(&self.models)?)
    }

    /// The folder of a suite that reads series.
    pub fn folder_of_series(&self, suite: &Suite) -> Result<&Path> {
        self.data.as_deref().with_context(|| {
            format!(
                "suite `{}` needs its series: name their folder with --data DIR or the variable \
                 CHRONOTOPE_DATA",
                suite.name
            )
        })
    }
}

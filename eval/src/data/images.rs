//! Where do the images of a suite, their features and its folds come from?

use std::path::Path;

use anyhow::Result;
use chronotope::dataset::Dataset;
use chronotope::feature::Extractor;

use super::features::ExtractedDataset;
use super::folds::{Fold, folds};
use super::opened::open;
use crate::progress::Progress;
use crate::suite::Suite;

/// The images of a suite.
pub(crate) struct Images {
    pub(crate) data: ExtractedDataset,
    pub(crate) folds: Vec<Fold>,
    /// What is learnt and queried, in words.
    pub(crate) split: String,
}

/// The images of a suite that has no folds, with their features.
pub(crate) fn extracted(
    suite: &Suite,
    data: Option<&Path>,
    cache: &Path,
    extractor: &dyn Extractor,
) -> Result<ExtractedDataset> {
    features(open(suite, data)?.0, cache, extractor)
}

fn features(dataset: Dataset, cache: &Path, extractor: &dyn Extractor) -> Result<ExtractedDataset> {
    let bar = Progress::new(dataset.entries.len(), "features");
    Ok(ExtractedDataset::new(
        dataset,
        extractor,
        Some(cache),
        &|| bar.inc(),
    )?)
}

/// The images of a suite with their features, and its folds.
pub(crate) fn images(
    suite: &Suite,
    data: Option<&Path>,
    cache: &Path,
    extractor: &dyn Extractor,
) -> Result<Images> {
    let (dataset, split) = open(suite, data)?;
    // A split that leaves nothing fails before the long part.
    folds(suite, &dataset, split.as_ref())?;
    let data = features(dataset, cache, extractor)?;
    let (folds, split) = folds(suite, &data.dataset, split.as_ref())?;
    Ok(Images { data, folds, split })
}

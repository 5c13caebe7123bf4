//! Where do the images of a suite, their features and its folds come from?

use std::path::Path;

use anyhow::{Context, Result};
use chronotope::dataset::{Dataset, Manifest};

use super::features::{ExtractedDataset, extractor};
use super::folds::{Fold, folds};
use crate::progress::Progress;
use crate::suite::Suite;

/// The images of a suite with their features, and its folds.
pub(crate) fn images(
    suite: &Suite,
    data: Option<&Path>,
    cache: &Path,
) -> Result<(ExtractedDataset, Vec<Fold>)> {
    let manifest = Manifest::find_builtin(&suite.dataset)?;
    let data = data.with_context(|| {
        format!(
            "suite `{}` needs images: name the folder of `{}` with --data DIR or the variable \
             CHRONOTOPE_DATA",
            suite.name, suite.dataset
        )
    })?;
    let dataset = Dataset::open_with(&manifest, data)?;
    let bar = Progress::new(dataset.entries.len(), "features");
    let extracted = ExtractedDataset::new(dataset, &extractor()?, Some(cache), &|| bar.inc())?;
    drop(bar);
    let folds = folds(&suite.protocol, &extracted.dataset, Some(&manifest))?;
    Ok((extracted, folds))
}

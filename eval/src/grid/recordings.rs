//! Which files of recorded data does a suite have?

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::run::RunOptions;
use crate::suite::Suite;

/// The folder of recorded data: the dataset's in the one that is named, or that one itself.
pub(super) fn files(suite: &Suite, options: &RunOptions) -> Result<PathBuf> {
    let data = options.data.as_deref().with_context(|| {
        format!(
            "suite `{}` needs recorded data: name their folder with --data DIR or the variable \
             CHRONOTOPE_DATA",
            suite.name
        )
    })?;
    let inner = data.join(&suite.dataset);
    Ok(if inner.is_dir() {
        inner
    } else {
        data.to_owned()
    })
}

/// The names of recordings in a folder, in order: files with this ending, or that and `.gz`.
pub(super) fn recordings(folder: &Path, ending: &str) -> Result<Vec<String>> {
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("cannot read the folder {}", folder.display()))?;
    let mut names = Vec::new();
    for entry in entries {
        let name = entry?.file_name().to_string_lossy().into_owned();
        let plain = name.strip_suffix(".gz").unwrap_or(&name);
        if plain
            .strip_suffix(ending)
            .is_some_and(|stem| stem.ends_with('.'))
        {
            names.push(name);
        }
    }
    names.sort();
    ensure!(
        !names.is_empty(),
        "{}: no recordings *.{ending} or *.{ending}.gz",
        folder.display()
    );
    Ok(names)
}

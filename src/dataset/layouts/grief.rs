//! Which images are in a folder of the GRIEF layout, `MMLL.{ppm,png,webp,jpg}`?

use std::path::{Path, PathBuf};

use super::collector::{Collector, no_time};
use crate::dataset::paths::{digits, image_rank, list, relative, stem_of};
use crate::map::PlaceKey;
use fremen::error::Result;

pub(super) fn read(collector: &mut Collector<'_>, place_prefix: &str) -> Result<()> {
    let Some(folder) = find_folder(collector.root) else {
        return Ok(());
    };
    for path in list(&folder)? {
        let subject = relative(collector.root, &path);
        if path.is_dir() || image_rank(&path).is_none() {
            continue;
        }
        let stem = stem_of(&path);
        let Some((visit, place)) = numbers(&stem) else {
            collector.problem(
                &subject,
                "the name is not MMLL, visit and place with two digits each (help: rename or move it)",
            );
            continue;
        };
        let place = PlaceKey::new(&format!("{place_prefix}{place}"))?;
        let Some(time) = collector.manifest.time.of_visit(visit) else {
            return Err(no_time(&path, visit));
        };
        collector.add(&subject, &place, time, &subject, |image| image);
    }
    Ok(())
}

/// The folder with `MMLL` images: `dir/images` or `dir`.
pub(super) fn find_folder(dir: &Path) -> Option<PathBuf> {
    [dir.join("images"), dir.to_owned()]
        .into_iter()
        .find(|folder| {
            list(folder).is_ok_and(|paths| {
                paths
                    .iter()
                    .any(|path| image_rank(path).is_some() && numbers(&stem_of(path)).is_some())
            })
        })
}

/// Visit and place of `MMLL`.
fn numbers(stem: &str) -> Option<(i64, i64)> {
    let number = (stem.len() == 4).then(|| digits(stem)).flatten()?;
    Some((number / 100, number % 100))
}

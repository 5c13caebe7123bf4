//! Which images are in a folder of the FreLoc (and Witham Wharf) layout,
//! `training|testing/place_N/%05d.bmp`?

use std::collections::BTreeMap;
use std::path::Path;

use super::collector::{Collector, no_time};
use crate::dataset::paths::{digits, image_rank, list, name_of, relative, stem_of};
use crate::map::PlaceKey;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// The folders of a FreLoc dataset.
const FOLDERS: [&str; 2] = ["training", "testing"];

/// Whether a folder has this layout.
pub(super) fn is_in(dir: &Path) -> bool {
    FOLDERS.iter().any(|folder| {
        list(&dir.join(folder)).is_ok_and(|paths| {
            paths
                .iter()
                .any(|path| path.is_dir() && place_number(&name_of(path)).is_some())
        })
    })
}

pub(super) fn read(
    collector: &mut Collector<'_>,
    origins: &BTreeMap<String, Time>,
    key: impl Fn(i64) -> Result<PlaceKey>,
) -> Result<()> {
    for folder in FOLDERS {
        let top = collector.root.join(folder);
        if !top.is_dir() {
            continue;
        }
        let time_rule = &collector.manifest.time;
        let origin = origins
            .get(folder)
            .copied()
            .or(time_rule.origin)
            .ok_or_else(|| {
                Error::new(ErrorKind::Config, "no time is given for image 0")
                    .with_path(&top)
                    .with_help("write origin under [time] of the manifest")
            })?;
        for place_dir in list(&top)? {
            if !place_dir.is_dir() {
                continue;
            }
            let Some(number) = place_number(&name_of(&place_dir)) else {
                let subject = relative(collector.root, &place_dir);
                collector.problem(
                    subject,
                    "the folder is not called place_N (help: rename or move it)",
                );
                continue;
            };
            let place = key(number)?;
            for path in list(&place_dir)? {
                if path.is_dir() || image_rank(&path).is_none() {
                    continue;
                }
                let subject = relative(collector.root, &path);
                let stem = stem_of(&path);
                let number: Option<i64> = (stem.len() >= 5).then(|| digits(&stem)).flatten();
                let Some(number) = number else {
                    collector.problem(
                        &subject,
                        "the name is not the number of the image with five digits, as in 00042.bmp (help: rename or move it)",
                    );
                    continue;
                };
                let time_rule = &collector.manifest.time;
                let Some(time) = time_rule.of_number(origin, number) else {
                    return Err(no_time(&path, number));
                };
                collector.add(&subject, &place, time, &subject, |image| image);
            }
        }
    }
    Ok(())
}

fn place_number(name: &str) -> Option<i64> {
    digits(name.strip_prefix("place_")?)
}

//! Which images does a suite speak of?
//!
//! Those of a supported dataset, of a folder or manifest anywhere, or of two folders, of which one
//! is learnt and the other queried.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use chronotope::dataset::{Clock, Dataset, Manifest, Problem, Split};

use crate::suite::{Home, Protocol, Suite};

/// What precedes the ids of images that are learnt and of those that are queried, where they come
/// from two folders.
const SIDES: [&str; 2] = ["learn", "query"];

/// The images of a suite, and the split between them where its manifest has one.
pub(super) fn open(suite: &Suite, data: Option<&Path>) -> Result<(Dataset, Option<Split>)> {
    let (manifest, dir) = locate(suite, data)?;
    let dataset = Dataset::open_with(&manifest, &dir)?;
    let Protocol::OtherFolder { query } = &suite.protocol else {
        return Ok((dataset, manifest.split));
    };
    let queried = Dataset::open(&suite.resolve(query))?;
    let mut split = Split::default();
    split.learn_folder = Some(SIDES[0].into());
    split.query_folder = Some(SIDES[1].into());
    Ok((both(dataset, queried), Some(split)))
}

/// The manifest of a suite's dataset, and the folder of its images or one that holds it.
fn locate(suite: &Suite, data: Option<&Path>) -> Result<(Manifest, PathBuf)> {
    let missing = || {
        format!(
            "suite `{}` needs images: name the folder of `{}` with --data DIR or the variable \
             CHRONOTOPE_DATA",
            suite.name, suite.dataset
        )
    };
    if suite.home == Home::Own {
        let data = data.with_context(missing)?;
        return Ok(Manifest::locate(data)?);
    }
    if let Ok(manifest) = Manifest::find_builtin(&suite.dataset) {
        return Ok((manifest, data.with_context(missing)?.to_owned()));
    }
    let mut tried = Vec::new();
    if matches!(suite.home, Home::SuiteFile(_)) {
        tried.push(suite.resolve(Path::new(&suite.dataset)));
    }
    if let Some(data) = data {
        tried.push(data.join(&suite.dataset));
        if data.file_stem().is_some_and(|name| *name == *suite.dataset) {
            tried.push(data.to_owned());
        }
    }
    let found = tried.iter().find(|path| path.exists());
    let found = found.with_context(|| {
        let tried: Vec<_> = tried
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        format!(
            "suite `{}`: there is no dataset `{}`; looked for {} (help: name the folder that \
             holds it with --data DIR, or write its path from the suite's file)",
            suite.name,
            suite.dataset,
            tried.join(" and ")
        )
    })?;
    Ok(Manifest::locate(found)?)
}

/// One dataset of two, whose ids say which side an image is for.
fn both(learnt: Dataset, queried: Dataset) -> Dataset {
    let mut all = Dataset {
        name: learnt.name.clone(),
        clock: match (learnt.clock, queried.clock) {
            (Clock::Real, Clock::Real) => Clock::Real,
            _ => Clock::None,
        },
        zone: learnt.zone.clone(),
        entries: Vec::new(),
        edges: learnt.edges.clone(),
        poses: queried.poses.clone(),
        problems: Vec::new(),
        image_size: learnt.image_size,
    };
    // Where both say where a place is, the map's word counts.
    all.poses.extend(learnt.poses.clone());
    for edge in queried.edges.iter().cloned() {
        if !all.edges.contains(&edge) {
            all.edges.push(edge);
        }
    }
    for (side, dataset) in SIDES.into_iter().zip([learnt, queried]) {
        for mut entry in dataset.entries {
            entry.id = format!("{side}/{}", entry.id);
            all.entries.push(entry);
        }
        all.problems
            .extend(dataset.problems.into_iter().map(|it| Problem {
                subject: format!("{side}/{}", it.subject),
                ..it
            }));
    }
    all.entries
        .sort_by(|a, b| (a.time, &a.place, &a.id).cmp(&(b.time, &b.place, &b.id)));
    all
}

/// Which side of a listed split each entry is on: `Some(true)` is learnt, `Some(false)` queried.
pub(super) fn sides_of_file(path: &Path, dataset: &Dataset) -> Result<Vec<Option<bool>>> {
    let read = || format!("cannot read {}", path.display());
    let text = std::fs::read_to_string(path).with_context(read)?;
    let mut listed = std::collections::BTreeMap::new();
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || (index == 0 && line.replace(' ', "") == "path,side") {
            continue;
        }
        let cells = line.rsplit_once(',');
        let (image, side) = cells.map_or((line, ""), |(image, side)| (image.trim(), side.trim()));
        let image = image
            .strip_prefix('"')
            .map_or(image, |quoted| quoted.strip_suffix('"').unwrap_or(image));
        let is_learnt = match side {
            "learn" => true,
            "query" => false,
            _ => anyhow::bail!(
                "{}: line {}: `{side}` is no side (help: rows are path,side, and a side is learn \
                 or query)",
                path.display(),
                index + 1
            ),
        };
        if listed
            .insert(image.to_owned(), (is_learnt, index + 1))
            .is_some()
        {
            anyhow::bail!(
                "{}: line {}: `{image}` is there twice (help: remove one of the rows)",
                path.display(),
                index + 1
            );
        }
    }
    let mut unknown: std::collections::BTreeSet<&str> = listed.keys().map(String::as_str).collect();
    let sides = (dataset.entries.iter())
        .map(|entry| {
            // Cut-outs of one picture are `PATH@...`.
            let id = entry.id.as_str();
            let picture = id.rsplit_once('@').map_or(id, |(picture, _)| picture);
            let name = [id, picture]
                .into_iter()
                .find(|it| listed.contains_key(*it))?;
            unknown.remove(name);
            Some(listed[name].0)
        })
        .collect();
    if let Some(first) = unknown.first() {
        let line = listed[*first].1;
        ensure!(
            dataset
                .problems
                .iter()
                .any(|it| it.subject.contains(*first)),
            "{}: line {line}: `{}` has no image `{first}` (help: write paths as in its index.csv)",
            path.display(),
            dataset.name
        );
    }
    Ok(sides)
}

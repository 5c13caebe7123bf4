//! What is there to explore, and what is known of it?

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Result;
use fremen::online::OnlineConfig;
use fremen::series::Columns;
use fremen::time::{TimeUnit, Zone};
use fremen::{Error, ErrorKind, Series, Time};
use fremen_explore::{Beliefs, Fitted, InZone, Recording};

use super::unpacked::unpacked;
use chronotope::map::{Map, Snapshot};

/// Some places, learnt from what was seen before a moment.
pub(super) struct Known {
    pub(super) places: InZone,
    /// Looks that were left out because they are not before that moment.
    pub(super) num_later: usize,
    /// The times and places of those since a moment that the caller asked for.
    pub(super) lately: Vec<(Time, usize)>,
}

/// How series are read and learnt.
pub(super) struct Reading<'a> {
    pub(super) unit: Option<TimeUnit>,
    pub(super) zone: Option<&'a Zone>,
    pub(super) model: &'a OnlineConfig,
}

/// A map, or series of which each is a place, as they were known before `before`; with the looks from
/// `since` on, which is `before` where nobody wants to know.
pub(super) fn known(
    files: &[PathBuf],
    reading: &Reading<'_>,
    since: Time,
    before: Time,
) -> Result<Known> {
    if let [file] = files
        && is_map(file)?
    {
        let map = Map::open_read_only(file)?;
        return of_map(&map.snapshot(), since, before)
            .map_err(|error| error.with_path(file).into());
    }
    let series = read_series(files, reading)?;
    let mut looks: Vec<(Time, usize, bool)> = Vec::new();
    let (mut num_later, mut lately) = (0, Vec::new());
    for (place, (_, series)) in series.iter().enumerate() {
        for &(time, state) in series.states() {
            if (since..before).contains(&time) {
                lately.push((time, place));
            }
            if time < before {
                looks.push((reading.wall(time), place, state));
            } else {
                num_later += 1;
            }
        }
    }
    let names = series.iter().map(|(name, _)| name.as_str());
    let beliefs = Beliefs::of_looks(names, reading.model, looks)?;
    Ok(Known {
        places: InZone::new(beliefs, reading.zone.cloned()),
        num_later,
        lately,
    })
}

impl Reading<'_> {
    fn wall(&self, time: Time) -> Time {
        self.zone.map_or(time, |zone| zone.wall(time))
    }
}

/// Whether a file begins as maps do; what maps are is checked when it is opened as one.
fn is_map(path: &Path) -> fremen::Result<bool> {
    if path == Path::new("-") {
        return Ok(false);
    }
    let mut begin = Vec::new();
    (fremen::file::open(path)?.take(16).read_to_end(&mut begin))
        .map_err(|cause| Error::io(path, cause))?;
    Ok(begin.starts_with(b"SQLite format 3\0"))
}

/// The features of each place of a map, by their natural rhythms and the clocks of the map's zone.
fn of_map(snapshot: &Snapshot, since: Time, before: Time) -> fremen::Result<Known> {
    let zone = snapshot.meta().civil_zone()?;
    let mut fitted = Fitted::new();
    let (mut num_later, mut lately) = (0, Vec::new());
    for (place, node) in snapshot.nodes().iter().enumerate() {
        let times = node.log().times().iter().copied();
        lately.extend(times.filter_map(|time| {
            let is_meant = (since..before).contains(&time);
            is_meant.then_some((time, place))
        }));
        num_later += fitted.push_log(node.key().as_str(), node.log(), before, zone.as_ref())?;
    }
    Ok(Known {
        places: InZone::new(fitted, zone),
        num_later,
        lately,
    })
}

/// Series of CSV files; a place is named as its file.
fn read_series(files: &[PathBuf], reading: &Reading<'_>) -> Result<Vec<(String, Series)>> {
    let columns = Columns {
        unit: reading.unit,
        zone: reading.zone,
        ..Columns::default()
    };
    let mut all: Vec<(String, Series)> = Vec::with_capacity(files.len());
    for file in files {
        let name = file
            .file_name()
            .unwrap_or(file.as_os_str())
            .to_string_lossy();
        let name = name
            .split('.')
            .find(|part| !part.is_empty())
            .unwrap_or(&name)
            .to_owned();
        if all.iter().any(|(other, _)| *other == name) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("two files are the place `{name}`"),
            )
            .with_path(file)
            .with_help("a place is named as its file, up to the first dot; rename one")
            .into());
        }
        let series =
            Series::parse_csv(&unpacked(file)?, columns).map_err(|error| error.with_path(file))?;
        all.push((name, series));
    }
    Ok(all)
}

/// The moments at which the states of all series are known; how many of others there are.
pub(super) fn recording(files: &[PathBuf], reading: &Reading<'_>) -> Result<(Recording, usize)> {
    let series = read_series(files, reading)?;
    // The last of equal times.
    let maps: Vec<BTreeMap<Time, bool>> = (series.iter())
        .map(|(_, series)| {
            let states = series.states().iter();
            states
                .map(|&(time, state)| (reading.wall(time), state))
                .collect()
        })
        .collect();
    let (Some(first), longest) = (maps.first(), maps.iter().map(BTreeMap::len).max()) else {
        return Err(Error::new(ErrorKind::Shape, "there is no place to explore").into());
    };
    let is_common = |time: &&Time| maps.iter().all(|map| map.contains_key(time));
    let times: Vec<Time> = first.keys().filter(is_common).copied().collect();
    if times.is_empty() {
        return Err(Error::new(
            ErrorKind::Shape,
            "there is no time at which the states of all series are known",
        )
        .with_help("a simulation needs series of the same times, such as one row a minute")
        .into());
    }
    let num_others = longest.unwrap_or_default() - times.len();
    let mut recording = Recording::new(times.clone())?;
    for ((name, _), map) in series.iter().zip(&maps) {
        let states = times.iter().map(|time| map[time]).collect();
        recording.push(name.as_str(), 1, states)?;
    }
    Ok((recording, num_others))
}

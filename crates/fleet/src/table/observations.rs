//! How do observations become a log, fast, and a log observations?
//!
//! One row for each feature of each visit: place, visit, time, feature, state. Written visit by visit, the
//! rows of a visit lie together, and reading costs a few nanoseconds a row; in any other order it costs
//! more, and gives the same log.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use arrow_array::types::TimestampMicrosecondType;
use arrow_array::{
    Array, BinaryArray, BooleanArray, Int32Array, StringArray, TimestampMicrosecondArray,
};
use fremen::{Error, ErrorKind, Result, Series, Time};
use rayon::prelude::*;

use super::columns::OBSERVATIONS;
use super::reader::{Batch, TableFile};
use super::writer::{TableWriter, column};
use crate::log::{Contradiction, FleetLog};
use crate::states::States;

const ALL: [&str; 5] = ["place", "visit", "time", "feature", "state"];

/// Rows that are written at once.
const BATCH: usize = 1 << 16;

/// How observations are read.
#[derive(Clone, Debug)]
pub struct ReadConfig {
    num_threads: usize,
    max_bytes: usize,
}

impl Default for ReadConfig {
    /// All processors; 8 GiB.
    fn default() -> Self {
        Self {
            num_threads: 0,
            max_bytes: 1 << 33,
        }
    }
}

impl ReadConfig {
    /// Threads to read with; 0 for one on each processor.
    #[must_use]
    pub fn with_num_threads(mut self, num_threads: usize) -> Self {
        self.num_threads = num_threads;
        self
    }

    /// Memory that the visits may take, about.
    #[must_use]
    pub fn with_max_bytes(mut self, max_bytes: usize) -> Self {
        self.max_bytes = max_bytes;
        self
    }
}

/// What was read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadReport {
    /// Files.
    pub num_files: usize,
    /// Rows of all files.
    pub num_rows: u64,
    /// Rows that said what another had said.
    pub num_duplicates: u64,
}

/// Reads the observations of files ([`files_of`](super::files_of)), each statement once.
///
/// Fails with [`ErrorKind::Format`], naming file, row group and column, for whatever is no table of
/// observations or contradicts another row, and with [`ErrorKind::Shape`] if the visits do not fit into the
/// memory that is allowed.
pub fn read_observations(files: &[PathBuf], cfg: &ReadConfig) -> Result<(FleetLog, ReadReport)> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(cfg.num_threads)
        .build();
    let pool = pool.map_err(|cause| Error::new(ErrorKind::Io, cause.to_string()))?;
    // All footers first: a file that is none of these is found before anything is worked out.
    let tables: Result<Vec<TableFile>> = (files.iter())
        .map(|path| TableFile::open(path, &OBSERVATIONS, &ALL))
        .collect();
    let tables = tables?;
    let groups: Vec<(usize, usize)> = (tables.iter().enumerate())
        .flat_map(|(at, table)| (0..table.num_row_groups()).map(move |group| (at, group)))
        .collect();
    // Of neighbours, so that visits that two row groups share are few.
    let share = groups.len().div_ceil(pool.current_num_threads()).max(1);
    let (num_rows, num_bytes) = (AtomicU64::new(0), AtomicU64::new(0));
    let read = |groups: &[(usize, usize)]| {
        let mut log = FleetLog::new();
        for &(table, group) in groups {
            let before = log.num_bytes();
            let rows = read_group(&tables[table], group, &mut log)?;
            num_rows.fetch_add(rows, Ordering::Relaxed);
            let more = (log.num_bytes() - before) as u64;
            let so_far = num_bytes.fetch_add(more, Ordering::Relaxed) + more;
            if so_far > cfg.max_bytes as u64 {
                return Err(too_large(cfg.max_bytes)
                    .with_path(tables[table].path())
                    .into());
            }
        }
        Ok(log)
    };
    let log = pool.install(|| {
        let logs = groups.par_chunks(share).map(read);
        logs.try_reduce(FleetLog::new, |log, other| Ok(log.merge(other)?))
    });
    let log = log.map_err(|refused| match refused {
        Refused::Error(error) => error,
        Refused::Contradiction(it) => located(&tables, it),
    })?;
    // As read, whatever the footers say.
    let num_rows = num_rows.into_inner();
    let report = ReadReport {
        num_files: files.len(),
        num_rows,
        num_duplicates: num_rows - log.num_observations(),
    };
    Ok((log, report))
}

fn too_large(max_bytes: usize) -> Error {
    let message = format!(
        "the visits need more than the {:.1} GB of memory that are allowed",
        max_bytes as f64 / 1e9
    );
    Error::new(ErrorKind::Shape, message)
        .with_help("learn fewer places at once, allow more, or learn on a cluster")
}

/// Why a file is not read on.
enum Refused {
    Error(Error),
    Contradiction(Contradiction),
}

impl From<Error> for Refused {
    fn from(error: Error) -> Self {
        Self::Error(error)
    }
}

impl From<Contradiction> for Refused {
    fn from(it: Contradiction) -> Self {
        Self::Contradiction(it)
    }
}

/// The columns of some rows.
struct Columns<'a> {
    places: (&'a [i32], &'a StringArray),
    visits: (Vec<i32>, Vec<u128>),
    times: &'a [i64],
    features: &'a [i32],
    states: Vec<bool>,
}

impl<'a> Columns<'a> {
    fn of(batch: &'a Batch<'_>) -> Result<Self> {
        Ok(Self {
            places: batch.texts(0)?,
            visits: batch.identities(1)?,
            times: batch.numbers::<TimestampMicrosecondType>(2),
            features: batch.naturals(3)?,
            states: batch.flags(4),
        })
    }

    /// Where the rows from `start` on end that are of one visit.
    fn end_of_run(&self, start: usize) -> usize {
        let (places, visits, times) = (self.places.0, &self.visits.0, self.times);
        let (place, visit, time) = (places[start], visits[start], times[start]);
        let is_same =
            |&row: &usize| places[row] == place && visits[row] == visit && times[row] == time;
        let next = start + 1;
        next + (next..times.len()).take_while(is_same).count()
    }
}

/// Adds what a row group says, and gives the number of its rows.
fn read_group(table: &TableFile, group: usize, log: &mut FleetLog) -> Result<u64, Refused> {
    let mut num_rows = 0;
    let mut rows = table.rows(group)?;
    while let Some(batch) = rows.next()? {
        let columns = Columns::of(&batch)?;
        let (place_keys, places) = columns.places;
        let (visit_keys, visits) = &columns.visits;
        let mut place_at = vec![None; places.len()];
        // For each visit: the place that it was last found at, and its number there.
        let mut visit_at = vec![None; visits.len()];
        let mut start = 0;
        while start < batch.num_rows() {
            let end = columns.end_of_run(start);
            let (place, visit) = (place_keys[start] as usize, visit_keys[start] as usize);
            let at = *place_at[place].get_or_insert_with(|| log.place(places.value(place)));
            let known = log.place_mut(at);
            let time = Time::from_us(columns.times[start]);
            let visit = match visit_at[visit] {
                Some((of, number, when)) if of == at && when == time => number,
                _ => {
                    let number = known.visit(visits[visit], time)?;
                    visit_at[visit] = Some((at, number, time));
                    number
                }
            };
            known.add_run(
                visit,
                &columns.features[start..end],
                &columns.states[start..end],
            )?;
            start = end;
        }
        num_rows += batch.num_rows() as u64;
    }
    Ok(num_rows)
}

/// The error for a contradiction, with both places where it is said.
fn located(tables: &[TableFile], it: Contradiction) -> Error {
    let mut first: Option<(String, i64, bool)> = None;
    for table in tables {
        for group in 0..table.num_row_groups() {
            let found = statements(table, group, &it);
            for (time, state) in found.unwrap_or_default() {
                let Some((place, first_time, first_state)) = &first else {
                    let place = format!("{}, row group {group}", table.path().display());
                    first = Some((place, time, state));
                    continue;
                };
                let column = match it.feature {
                    None if *first_time != time => "time",
                    Some(_) if *first_state != state => "state",
                    _ => continue,
                };
                let first = format!("first said in {place}");
                let error = Error::from(it);
                let message = format!("{}; {first}", error.message());
                return Error::new(error.kind(), message)
                    .with_path(table.path())
                    .with_place(format!("row group {group}, column `{column}`"))
                    .with_help(error.help().unwrap_or_default());
            }
        }
    }
    it.into()
}

/// What a row group says of a visit, and of the feature if one is named.
fn statements(table: &TableFile, group: usize, it: &Contradiction) -> Result<Vec<(i64, bool)>> {
    let mut found = Vec::new();
    let mut rows = table.rows(group)?;
    while let Some(batch) = rows.next()? {
        let columns = Columns::of(&batch)?;
        for row in 0..batch.num_rows() {
            let place = columns.places.1.value(columns.places.0[row] as usize);
            let visit = columns.visits.1[columns.visits.0[row] as usize];
            let feature = columns.features[row].cast_unsigned();
            let is_meant = it.feature.is_none_or(|it| it == feature);
            if place == it.place && visit == it.visit && is_meant {
                found.push((columns.times[row], columns.states[row]));
            }
        }
    }
    Ok(found)
}

/// The history of one feature of one place, for `chronotope spectrum`; each visit once. Without a place or a
/// feature the file must hold one only.
pub fn read_series(files: &[PathBuf], place: Option<&str>, feature: Option<u32>) -> Result<Series> {
    let (log, _) = read_observations(files, &ReadConfig::default())?;
    let places = log.places();
    let first = || files.first().map_or(Path::new(""), PathBuf::as_path);
    let refused = |kind, message: String, help: String| {
        Error::new(kind, message).with_path(first()).with_help(help)
    };
    let names = |help: &str| {
        if places.is_empty() {
            return "no row is in these files".to_owned();
        }
        let some: Vec<&str> = places.iter().take(5).map(|it| it.key()).collect();
        let dots = if places.len() > 5 { ", ..." } else { "" };
        format!("{help}{}{dots}", some.join(", "))
    };
    let found = match place {
        Some(key) => places.iter().find(|it| it.key() == key).ok_or_else(|| {
            let message = format!("there is no place `{key}`");
            refused(ErrorKind::NotFound, message, names("there are "))
        })?,
        None => match &places[..] {
            [one] => one,
            [] => return Ok(Series::new()),
            many => {
                let message = format!("these are observations of {} places", many.len());
                return Err(refused(
                    ErrorKind::Config,
                    message,
                    names("name one with --place: "),
                ));
            }
        },
    };
    let mut features: Vec<u32> = (found.visits().iter())
        .flat_map(|visit| visit.states.iter().map(|(feature, _)| feature))
        .collect();
    features.sort_unstable();
    features.dedup();
    let feature = match (feature, &features[..]) {
        (Some(feature), known) if known.contains(&feature) => feature,
        (None, [one]) => *one,
        (Some(feature), _) => {
            let message = format!("place `{}` has no feature {feature}", found.key());
            let help = format!("it has {} features", features.len());
            return Err(refused(ErrorKind::NotFound, message, help));
        }
        (None, _) => {
            let message = format!("place `{}` has {} features", found.key(), features.len());
            return Err(refused(
                ErrorKind::Config,
                message,
                "name one with --feature".into(),
            ));
        }
    };
    let states = found.visits().iter().filter_map(|visit| {
        let state = visit.states.iter().find(|(it, _)| *it == feature)?.1;
        Some((visit.time, visit.id, state))
    });
    // Of equal times in order of identity, so that the order of arrival means nothing.
    let mut states: Vec<_> = states.collect();
    states.sort_unstable();
    Ok(states
        .into_iter()
        .map(|(time, _, state)| (time, state))
        .collect())
}

/// A table of observations that is being written; dropped before it is finished, it leaves nothing behind.
///
/// Visit by visit and place by place is the order that is read fastest.
pub struct ObservationWriter {
    writer: TableWriter,
    place: String,
    rows: Vec<(u128, Time, u32, bool)>,
}

impl ObservationWriter {
    /// Begins a file at a path where nothing is yet.
    pub fn begin(path: impl AsRef<Path>) -> Result<Self> {
        Ok(Self {
            writer: TableWriter::begin(path.as_ref(), &OBSERVATIONS)?,
            place: String::new(),
            rows: Vec::with_capacity(BATCH),
        })
    }

    /// Writes what was observed at one visit of a place.
    pub fn visit(&mut self, place: &str, id: u128, time: Time, states: &States) -> Result<()> {
        if place != self.place {
            self.write(true)?;
            place.clone_into(&mut self.place);
        }
        for (feature, state) in states.iter() {
            self.rows.push((id, time, feature, state));
            if self.rows.len() == BATCH {
                self.write(false)?;
            }
        }
        Ok(())
    }

    fn write(&mut self, ends_place: bool) -> Result<()> {
        if self.rows.is_empty() && !ends_place {
            return Ok(());
        }
        let rows = &self.rows;
        let times = rows.iter().map(|row| row.1.as_us());
        let columns = vec![
            column(
                rows.iter()
                    .map(|_| Some(&self.place))
                    .collect::<StringArray>(),
            ),
            column(
                rows.iter()
                    .map(|row| Some(row.0.to_be_bytes()))
                    .collect::<BinaryArray>(),
            ),
            column(TimestampMicrosecondArray::from_iter_values(times).with_timezone("UTC")),
            column(Int32Array::from_iter_values(
                rows.iter().map(|row| row.2.cast_signed()),
            )),
            column(rows.iter().map(|row| Some(row.3)).collect::<BooleanArray>()),
        ];
        self.writer.write(columns, ends_place)?;
        self.rows.clear();
        Ok(())
    }

    /// Everything is on the disk and has its name once this returns.
    pub fn finish(mut self) -> Result<()> {
        self.write(false)?;
        self.writer.finish()
    }
}

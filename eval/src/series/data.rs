//! Where do the series come from, and what of them is unseen?

use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use chronotope::{Period, Time};
use sha2::{Digest, Sha256};

use crate::provenance::hex;
use crate::suite::Form;

/// When, and whether the state was 1.
pub type State = (Time, bool);

/// A stretch of time that no model has seen.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its name.
    pub name: String,
    /// Ascending in time.
    pub states: Vec<State>,
}

/// One state with its past and its future.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// What may be learnt, ascending in time.
    pub learn: Vec<State>,
    /// What is queried.
    pub parts: Vec<Part>,
}

/// The series of a suite with their digest and what should be known of them.
#[derive(Clone, Debug)]
pub struct SeriesDataset {
    /// The series, each with what is learnt and what is queried.
    pub series: Vec<Series>,
    /// Of the bytes of all files.
    pub sha256: String,
    /// In words: what is learnt, what is queried.
    pub split: String,
    /// What was left out and what was assumed.
    pub notes: Vec<String>,
}

/// Monday 5 January 1970, where a series counts its days from a Monday of no date.
const A_MONDAY: Time = Time::from_s(4 * 86_400);

/// Traversals that an edge must have.
const MIN_TRAVERSALS: usize = 50;

/// The share of an edge's traversals that is learnt.
const LEARNT_SHARE: f64 = 0.7;

/// Reads the series of `form` in `data`, which is their folder or one that holds it (also as
/// `series/`).
pub fn read(form: Form, data: &Path) -> Result<SeriesDataset> {
    let mut files = Files {
        folder: folder(form, data)?,
        digest: Sha256::new(),
    };
    let mut dataset = match form {
        Form::Door => door(&mut files)?,
        Form::Door2016 => door2016(&mut files)?,
        Form::Aruba => aruba(&mut files)?,
        Form::Edges => edges(&mut files)?,
    };
    dataset.sha256 = hex(&files.digest.finalize());
    Ok(dataset)
}

/// The first of the possible folders that exists.
fn folder(form: Form, data: &Path) -> Result<PathBuf> {
    let name = form.name();
    let mut tried = vec![data.join("series").join(name), data.join(name)];
    if data.file_name().is_some_and(|last| last == name) {
        tried.insert(0, data.to_path_buf());
    }
    (tried.into_iter().find(|path| path.is_dir())).with_context(|| {
        format!(
            "{} has no folder `{name}` or `series/{name}`",
            data.display()
        )
    })
}

/// Files of one folder, digested as they are read.
struct Files {
    folder: PathBuf,
    digest: Sha256,
}

impl Files {
    fn text(&mut self, name: &str) -> Result<String> {
        let path = self.folder.join(name);
        let unreadable = || format!("cannot read {}", path.display());
        let bytes = std::fs::read(&path).with_context(unreadable)?;
        self.digest.update(&bytes);
        let mut text = String::new();
        if path.extension().is_some_and(|extension| extension == "gz") {
            let mut decoder = flate2::read::GzDecoder::new(&bytes[..]);
            decoder.read_to_string(&mut text).with_context(unreadable)?;
        } else {
            text = String::from_utf8(bytes).with_context(unreadable)?;
        }
        Ok(text)
    }

    /// Rows of seconds and state, after a header, in order of time; times count from `epoch`.
    fn table(&mut self, name: &str, epoch: Time) -> Result<Vec<State>> {
        let text = self.text(name)?;
        let rows = text.lines().enumerate().skip(1);
        let mut states = rows
            .map(|(number, line)| {
                let row = line.split_once(',').and_then(|(time_s, state)| {
                    let state = match state.trim() {
                        "0" => false,
                        "1" => true,
                        _ => return None,
                    };
                    let us = time_s.trim().parse::<i64>().ok()?.checked_mul(1_000_000)?;
                    Some((epoch.plus_us(us), state))
                });
                row.with_context(|| {
                    let path = self.folder.join(name);
                    format!("{}: line {}: no `seconds,0|1`", path.display(), number + 1)
                })
            })
            .collect::<Result<Vec<_>>>()?;
        ensure!(!states.is_empty(), "{name} has no rows");
        states.sort_by_key(|state| state.0);
        Ok(states)
    }
}

fn door(files: &mut Files) -> Result<SeriesDataset> {
    let learn = files.table("week.csv.gz", A_MONDAY)?;
    let parts = ["day7", "day8"].map(|name| -> Result<Part> {
        Ok(Part {
            name: name.into(),
            states: files.table(&format!("{name}.csv.gz"), A_MONDAY)?,
        })
    });
    Ok(SeriesDataset {
        series: vec![Series {
            name: "door".into(),
            learn,
            parts: parts.into_iter().collect::<Result<_>>()?,
        }],
        sha256: String::new(),
        split: "one week, a sample a second, learnt; the two days after it queried".into(),
        notes: vec!["Times count from a Monday of no date.".into()],
    })
}

fn door2016(files: &mut Files) -> Result<SeriesDataset> {
    let learn = files.table("learn_10_weeks.csv.gz", Time::from_s(0))?;
    let states = files.table("test_week_1.csv.gz", Time::from_s(0))?;
    Ok(SeriesDataset {
        series: vec![Series {
            name: "door2016".into(),
            learn,
            parts: vec![Part {
                name: "week".into(),
                states,
            }],
        }],
        sha256: String::new(),
        split: "ten weeks, a sample a minute, learnt; a later week queried".into(),
        notes: Vec::new(),
    })
}

fn aruba(files: &mut Files) -> Result<SeriesDataset> {
    const LEARNT_MINUTES: usize = 12 * 7 * 24 * 60;
    let names = files.text("location.names")?;
    let text = files.text("location.min")?;
    let rooms: Vec<usize> = (text.lines().enumerate())
        .map(|(number, line)| {
            let room = line.trim().parse();
            room.with_context(|| format!("location.min: line {}: no number", number + 1))
        })
        .collect::<Result<_>>()?;
    if rooms.len() <= LEARNT_MINUTES {
        bail!("location.min has {} minutes, not 16 weeks", rooms.len());
    }
    let state = |minute: usize, room| {
        let time = A_MONDAY.plus_us(minute as i64 * Period::HOUR.fraction(60).as_us());
        (time, rooms[minute] == room)
    };
    let series = names.lines().enumerate().map(|(room, name)| Series {
        name: name.trim().into(),
        learn: (0..LEARNT_MINUTES).map(|i| state(i, room)).collect(),
        parts: vec![Part {
            name: "weeks 13-16".into(),
            states: (LEARNT_MINUTES..rooms.len())
                .map(|i| state(i, room))
                .collect(),
        }],
    });
    Ok(SeriesDataset {
        series: series.collect(),
        sha256: String::new(),
        split: "presence in each room, a sample a minute: weeks 1 to 12 learnt, 13 to 16 queried"
            .into(),
        notes: vec![
            "The days have no dates: the first is taken as a Monday, which makes office hours a \
             pattern of sampling and no claim about the person."
                .into(),
            "A number is a place in the list of names, counted from 0; 0 never occurs. Names are doubtful \
             (nights are spent in Master_Bathroom, or in Master_Bedroom if counted from 1, which leaves \
             Outside never visited); no number below depends on them."
                .into(),
        ],
    })
}

fn edges(files: &mut Files) -> Result<SeriesDataset> {
    let mut names: Vec<String> = (std::fs::read_dir(&files.folder)?)
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| {
            Path::new(name)
                .extension()
                .is_some_and(|extension| extension == "data")
        })
        .collect();
    names.sort();
    let mut series = Vec::new();
    let mut few = Vec::new();
    for file in &names {
        let name = file.trim_end_matches(".data").to_owned();
        let text = files.text(file)?;
        let mut states: Vec<State> = (text.lines().enumerate())
            .map(|(number, line)| {
                let mut fields = line.split_whitespace();
                let row = (fields.next(), fields.nth(1));
                let (Some(time_s), Some(success @ ("0" | "1"))) = row else {
                    bail!("{file}: line {}: no `time duration 0|1`", number + 1);
                };
                Ok((Time::from_s(time_s.parse()?), success == "1"))
            })
            .collect::<Result<_>>()?;
        states.sort_by_key(|state| state.0);
        if states.len() < MIN_TRAVERSALS {
            few.push(name);
            continue;
        }
        let queried = states.split_off((states.len() as f64 * LEARNT_SHARE) as usize);
        series.push(Series {
            name,
            learn: states,
            parts: vec![Part {
                name: "last 30 %".into(),
                states: queried,
            }],
        });
    }
    ensure!(
        !series.is_empty(),
        "{} has no edges",
        files.folder.display()
    );
    Ok(SeriesDataset {
        split: format!(
            "success of traversals of {} edges: the first 70 % of each learnt, the rest queried",
            series.len()
        ),
        series,
        sha256: String::new(),
        notes: vec![format!(
            "Left out, with fewer than {MIN_TRAVERSALS} traversals: {}",
            few.join(", ")
        )],
    })
}

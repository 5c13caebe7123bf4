//! Where will people be tomorrow, by where they were today?

use std::io::{BufRead, BufReader};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use fremen::{CandidatePeriods, Error, ErrorKind, Period, Result, Time};

use crate::cells::{CellState, GridSpec, OccupancyMap, Patch};
use crate::experiment::gallery::Gallery;
use crate::model::{CellModel, GridConfig};
use crate::picture::{occupancy_png, rhythms_png};
use crate::temporal::TemporalGrid;

/// Where people were seen, second by second, in an area that was watched all the time.
#[derive(Clone, Debug, PartialEq)]
pub struct Detections {
    /// From when to when the area was watched.
    pub watched: [Time; 2],
    /// Lower left and upper right corner of the area.
    pub area_m: [[f64; 2]; 2],
    /// When and where somebody was.
    pub rows: Vec<(Time, [f64; 2])>,
}

/// The most bytes of one file, once unpacked.
const MAX_BYTES: u64 = 1 << 28;

impl Detections {
    /// Reads a file of detections, which may be packed by gzip: a line with the first and the last
    /// second, one with the limits of x, one with those of y, then lines `SECONDS X Y`. A row at
    /// (0, 0) is a mark and left out.
    ///
    /// # Errors
    /// [`ErrorKind::Format`] with the file and the line where something is no number, is missing or
    /// is not finite.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut file = BufReader::new(fremen::file::open(path)?);
        let begin = file.fill_buf().map_err(|cause| Error::io(path, cause))?;
        let read = if begin.starts_with(&[0x1f, 0x8b]) {
            Self::parse(BufReader::new(MultiGzDecoder::new(file)))
        } else {
            Self::parse(file)
        };
        read.map_err(|error| error.with_path(path))
    }

    /// Reads the text of such a file.
    ///
    /// # Errors
    /// As [`read`](Self::read), without the file's name.
    pub fn parse(reader: impl BufRead) -> Result<Self> {
        let mut header: Vec<[f64; 2]> = Vec::new();
        let mut rows = Vec::new();
        for (number, line) in reader.take(MAX_BYTES).lines().enumerate() {
            let at = |error: Error| error.with_place(format!("line {}", number + 1));
            let line = line.map_err(|cause| {
                at(Error::new(
                    ErrorKind::Format,
                    format!("this cannot be read: {cause}"),
                ))
            })?;
            let numbers = numbers(&line).map_err(at)?;
            match (number, numbers.as_slice()) {
                (0..3, [low, high]) if low < high => header.push([*low, *high]),
                (3.., [seconds, x, y]) => {
                    if [*x, *y] != [0.0, 0.0] {
                        rows.push((time(*seconds).map_err(at)?, [*x, *y]));
                    }
                }
                _ => {
                    let expected = if number < 3 {
                        "two limits"
                    } else {
                        "a time, x and y"
                    };
                    let message = format!("{expected} expected, not {} numbers", numbers.len());
                    return Err(at(Error::new(ErrorKind::Format, message)
                        .with_help("was the file cut, or are limits swapped?")));
                }
            }
        }
        let [watched, x, y] = header[..] else {
            let message = "the file ends before the limits of time, x and y";
            return Err(Error::new(ErrorKind::Format, message));
        };
        Ok(Self {
            watched: [time(watched[0])?, time(watched[1])?],
            area_m: [[x[0], y[0]], [x[1], y[1]]],
            rows,
        })
    }

    /// The part of it from one time to another.
    #[must_use]
    pub fn between(&self, from: Time, to: Time) -> Self {
        let inside = |time: &Time| *time >= from && *time < to;
        Self {
            watched: [self.watched[0].max(from), self.watched[1].min(to)],
            area_m: self.area_m,
            rows: self
                .rows
                .iter()
                .filter(|(time, _)| inside(time))
                .copied()
                .collect(),
        }
    }

    /// For each slot of the time the cells in which somebody was.
    fn slots(&self, spec: &GridSpec, slot_s: f64) -> Vec<(Time, Patch)> {
        let slot_us = (slot_s * 1e6) as i64;
        let begin = self.watched[0].as_us();
        let count = (self.watched[1].as_us() - begin) / slot_us.max(1);
        let mut slots: Vec<(Time, Patch)> = (0..count)
            .map(|slot| {
                let mut patch = Patch::new_whole(spec);
                for index in 0..spec.num_cells() {
                    patch.set(spec.cell(index), CellState::Free);
                }
                (Time::from_us(begin + slot * slot_us), patch)
            })
            .collect();
        for (time, [x, y]) in &self.rows {
            let slot = (time.as_us() - begin).div_euclid(slot_us.max(1));
            let place = usize::try_from(slot)
                .ok()
                .and_then(|slot| slots.get_mut(slot));
            if let (Some((_, patch)), Some(cell)) = (place, spec.cell_at([*x, *y, 0.0])) {
                patch.set(cell, CellState::Occupied);
            }
        }
        slots
    }
}

fn numbers(line: &str) -> Result<Vec<f64>> {
    (line.split_ascii_whitespace().take(4))
        .map(|word| {
            let number: Option<f64> = word.parse().ok();
            number.filter(|number| number.is_finite()).ok_or_else(|| {
                let shown: String = word.chars().take(40).collect();
                Error::new(ErrorKind::Format, format!("`{shown}` is no finite number"))
            })
        })
        .collect()
}

fn time(seconds: f64) -> Result<Time> {
    let us = (seconds * 1e6).round();
    // `i64::MAX as f64` rounds up, so `<` keeps the cast exact.
    if us.abs() < i64::MAX as f64 {
        return Ok(Time::from_us(us as i64));
    }
    Err(Error::new(
        ErrorKind::Time,
        format!("{seconds} s is no time"),
    ))
}

/// How presence is learnt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PresenceConfig {
    /// Side of a cell.
    pub cell_m: f64,
    /// A cell is occupied in a slot of time if anybody was in it.
    pub slot_s: f64,
}

impl Default for PresenceConfig {
    fn default() -> Self {
        Self {
            cell_m: 1.0,
            slot_s: 60.0,
        }
    }
}

/// How well one model foresees.
#[derive(Clone, Debug, PartialEq)]
pub struct PresenceResult {
    /// The model.
    pub name: &'static str,
    /// Mean squared difference of probability and state, over all cells and slots.
    pub brier: f64,
    /// For each hour of the predicted time: cells that were expected to be occupied in a slot, and
    /// the Brier score.
    pub by_hour: Vec<[f64; 2]>,
    /// The same cells as they were seen.
    pub seen_by_hour: Vec<f64>,
}

/// Sums of one hour.
#[derive(Clone, Copy, Debug, Default)]
struct Hour {
    num_slots: f64,
    expected: f64,
    seen: f64,
    squares: f64,
}

/// Pictures of how often cells are expected to be occupied at four hours, and of how often they were
/// in the hour from then on; black is as often as the most visited cell of the picture, and at least
/// one slot of ten.
///
/// # Errors
/// As the grid.
pub fn presence_gallery(
    learnt: &Detections,
    foreseen: &Detections,
    config: &PresenceConfig,
) -> Result<Gallery> {
    let spec = spec_of(learnt, config)?;
    let day = CandidatePeriods::harmonic(Period::DAY, 24)?;
    let model = GridConfig::fremen(day, 2)?
        .with_guards(false)
        .with_persistence(false);
    let mut grid = TemporalGrid::new(spec, model);
    for (time, patch) in learnt.slots(&spec, config.slot_s) {
        grid.observe(&patch, time)?;
    }
    let test = foreseen.slots(&spec, config.slot_s);
    let begin = foreseen.watched[0];
    let fitted = grid.fitted();
    let mut map = OccupancyMap::new_unknown(spec);
    let mut hours = Vec::new();
    for hour in [9_i64, 12, 16, 20] {
        let from = begin.plus_us(hour * 3_600_000_000);
        fitted.predict_into(from.plus_us(1_800_000_000), &mut map)?;
        let mut seen = vec![0.0_f32; spec.num_cells()];
        let to = from.plus_us(3_600_000_000);
        let slots = test.iter().filter(|(time, _)| (from..to).contains(time));
        let mut num = 0.0_f32;
        for (_, patch) in slots {
            num += 1.0;
            for (seen, state) in seen.iter_mut().zip(patch.states()) {
                *seen += f32::from(u8::from(*state == CellState::Occupied));
            }
        }
        let expected = shares_png(spec, map.probabilities())?;
        let seen: Vec<f32> = seen.iter().map(|it| it / num.max(1.0)).collect();
        let offset = format!("hour {hour} of the day");
        hours.push([
            (format!("{offset}, predicted"), expected),
            (format!("{offset}, seen"), shares_png(spec, &seen)?),
        ]);
    }
    let rhythms = rhythms_png(&fitted, &spec, begin)?;
    Ok(Gallery {
        hours,
        rhythms: ("strongest rhythm of each cell".to_owned(), rhythms),
    })
}

fn shares_png(spec: GridSpec, shares: &[f32]) -> Result<Vec<u8>> {
    let most = shares.iter().copied().fold(0.1, f32::max);
    let mut map = OccupancyMap::new_unknown(spec);
    for (p, share) in map.probabilities_mut().iter_mut().zip(shares) {
        *p = share / most;
    }
    occupancy_png(&map)
}

fn spec_of(learnt: &Detections, config: &PresenceConfig) -> Result<GridSpec> {
    let [low, high] = learnt.area_m;
    let size = [0, 1].map(|axis| ((high[axis] - low[axis]) / config.cell_m).ceil() as u32);
    GridSpec::new_2d(low, config.cell_m, size)
}

/// Learns one time and predicts another with several models, the mean first.
///
/// # Errors
/// As the grid.
pub fn presence(
    learnt: &Detections,
    foreseen: &Detections,
    config: &PresenceConfig,
) -> Result<Vec<PresenceResult>> {
    let spec = spec_of(learnt, config)?;
    let day = CandidatePeriods::harmonic(Period::DAY, 24)?;
    let histogram = |num_bins| {
        GridConfig::new(CellModel::Histogram {
            period: Period::DAY,
            num_bins,
        })
    };
    let models: [(&'static str, GridConfig); 6] = [
        ("mean", GridConfig::new(CellModel::Mean)?),
        ("histogram, 24 h", histogram(24)?),
        ("histogram, 8 x 3 h", histogram(8)?),
        ("FreMEn, order 1", GridConfig::fremen(day.clone(), 1)?),
        ("FreMEn, order 2", GridConfig::fremen(day.clone(), 2)?),
        ("FreMEn, order 4", GridConfig::fremen(day, 4)?),
    ];
    let mut grid = TemporalGrid::new(spec, models[0].1.clone());
    for (time, patch) in learnt.slots(&spec, config.slot_s) {
        grid.observe(&patch, time)?;
    }
    let test = foreseen.slots(&spec, config.slot_s);
    let mut map = OccupancyMap::new_unknown(spec);
    let mut results = Vec::new();
    for (name, model) in models {
        // One day cannot show that it repeats, and the last minute says nothing of another day.
        grid.set_config(model.with_guards(false).with_persistence(false));
        let (mut sum, mut count) = (0.0, 0_u64);
        let mut hours: Vec<Hour> = Vec::new();
        for (time, patch) in &test {
            grid.predict_into(*time, &mut map)?;
            let at = (time.since_s(test[0].0) / 3_600.0) as usize;
            hours.resize(hours.len().max(at + 1), Hour::default());
            let hour = &mut hours[at];
            hour.num_slots += 1.0;
            for (p, state) in map.probabilities().iter().zip(patch.states()) {
                let truth = f64::from(u8::from(*state == CellState::Occupied));
                let p = if p.is_nan() { 0.5 } else { f64::from(*p) };
                sum += (p - truth).powi(2);
                count += 1;
                hour.expected += p;
                hour.seen += truth;
                hour.squares += (p - truth).powi(2);
            }
        }
        results.push(PresenceResult {
            name,
            brier: sum / count.max(1) as f64,
            by_hour: (hours.iter())
                .map(|it| {
                    let slots: f64 = it.num_slots;
                    let cells = slots * spec.num_cells() as f64;
                    [it.expected / slots.max(1.0), it.squares / cells.max(1.0)]
                })
                .collect(),
            seen_by_hour: (hours.iter())
                .map(|it| it.seen / it.num_slots.max(1.0))
                .collect(),
        });
    }
    Ok(results)
}

/// The table: scores, and by how much each is better than the mean.
pub fn presence_table(results: &[PresenceResult]) -> String {
    use std::fmt::Write as _;
    let mut text = String::from("model              |    Brier | better than the mean by %\n");
    let mean = results.first().map_or(f64::NAN, |first| first.brier);
    for result in results {
        let gain = 100.0 * (1.0 - result.brier / mean);
        let _ = writeln!(
            text,
            "{:18} | {:.6} | {gain:+.1}",
            result.name, result.brier
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn parse(text: &str) -> Result<Detections> {
        Detections::parse(Cursor::new(text.as_bytes()))
    }

    #[test]
    fn detections_are_read_and_faults_are_named_by_their_line() -> Result<()> {
        let read = parse("0 100\n-1 1\n0 2\n0 0 0\n5 0.5 1.5\n")?;
        assert_eq!(read.rows, [(Time::from_s(5), [0.5, 1.5])]);
        assert_eq!(read.area_m, [[-1.0, 0.0], [1.0, 2.0]]);
        for (text, line) in [
            ("0 100\n-1 1\n0 2\n5 0.5\n", "line 4"),
            ("0 100\n-1 1\n0 2\n5 x 1\n", "line 4"),
            ("0 100\n1 -1\n0 2\n", "line 2"),
            ("0 100\n-1 1\n0 2\n5 1 nan\n", "line 4"),
            ("100 0\n", "line 1"),
        ] {
            assert_eq!(parse(text).expect_err(text).place(), Some(line), "{text}");
        }
        assert!(parse("0 100\n-1 1\n").is_err());
        Ok(())
    }

    #[test]
    fn who_comes_every_morning_is_foreseen_by_hours_and_not_by_the_mean() -> Result<()> {
        let hours = |from: i64, to: i64, day: i64| {
            (from * 60..to * 60)
                .map(move |minute| (Time::from_s(day * 86_400 + minute * 60 + 7), [0.5, 0.5]))
        };
        let of_day = |day: i64| Detections {
            watched: [Time::from_s(day * 86_400), Time::from_s((day + 1) * 86_400)],
            area_m: [[0.0, 0.0], [2.0, 2.0]],
            rows: hours(8, 12, day).collect(),
        };
        let results = presence(&of_day(3), &of_day(9), &PresenceConfig::default())?;
        let brier = |name: &str| {
            let found = results.iter().find(|result| result.name == name);
            found.expect("a model of that name").brier
        };
        // One of four cells, one sixth of the day.
        assert!((brier("mean") - 0.25 * (1.0 / 6.0) * (5.0 / 6.0)).abs() < 1e-6);
        assert!(brier("histogram, 24 h") < 1e-9);
        assert!(brier("FreMEn, order 2") < 0.6 * brier("mean"));
        assert!(presence_table(&results).lines().count() == 7);
        Ok(())
    }
}

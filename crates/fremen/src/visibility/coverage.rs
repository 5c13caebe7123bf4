//! Which hours, weekdays and seasons were ever sampled?
//!
//! For each cycle (day, week, year) the visits are marked on its circle: a part of the circle counts
//! once for each turn in which it was visited, however often. The marks are smoothed (51 minutes, 8
//! hours, 30 days; more where there are few) and compared with what is usual where there are marks.
//! A quarter of that is as good as all; below it, support falls to 0 in proportion. So an hour is
//! supported if it was visited on a fair share of the days that others were.
//!
//! The week counts only once a week has passed: before, no weekday can have been left out.

use crate::error::Result;
use crate::spectrum::{Reader, Writer};
use crate::time::{Period, Time};

/// A cycle: its length, the parts that its circle is divided into, and the width of smoothing.
struct Cycle {
    period: Period,
    parts: usize,
    width_s: f64,
}

const CYCLES: [Cycle; 3] = [
    Cycle {
        period: Period::DAY,
        parts: 96,
        width_s: 3_060.0,
    },
    Cycle {
        period: Period::WEEK,
        parts: 168,
        width_s: 28_800.0,
    },
    Cycle {
        period: Period::YEAR,
        parts: 73,
        width_s: 2_592_000.0,
    },
];

/// A part with this share of the usual number of visits is fully supported.
const ENOUGH: f64 = 0.25;

/// Weekdays are judged where visits span at least a week; an hour less is a week of samples.
const MIN_WEEK_S: f64 = 601_200.0;

/// Full support, as it is kept.
const FULL: f64 = 65_535.0;

/// How well the times of day, week and year were sampled, each 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Coverage {
    /// Circles begin at the first visit, so that shifted times shift the support.
    origin: Time,
    /// For each cycle, for each part; empty where nothing speaks against any time.
    support: [Vec<u16>; 3],
}

/// The support of a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Support {
    /// Hour and weekday.
    pub(super) habit: f64,
    /// Season.
    pub(super) season: f64,
}

impl Coverage {
    /// Of visits in any order.
    pub(super) fn new(times: impl Iterator<Item = Time>) -> Self {
        let mut times: Vec<Time> = times.collect();
        times.sort_unstable();
        let origin = times.first().copied().unwrap_or_default();
        let span_s = times.last().map_or(0.0, |last| last.since_s(origin));
        let support = [0, 1, 2].map(|i| {
            if i == 1 && span_s < MIN_WEEK_S {
                return Vec::new();
            }
            CYCLES[i].support(&times, origin)
        });
        Self { origin, support }
    }

    /// How well moments like this were sampled.
    pub(super) fn at(&self, time: Time) -> Support {
        let [day, week, year] = [0, 1, 2].map(|i| self.of_cycle(i, time));
        Support {
            habit: day * week,
            season: year,
        }
    }

    fn of_cycle(&self, cycle: usize, time: Time) -> f64 {
        let parts = &self.support[cycle];
        if parts.is_empty() {
            return 1.0;
        }
        // From the middle of one part to that of the next.
        let count = parts.len();
        let at = turn(time, self.origin, CYCLES[cycle].period).1 * count as f64 - 0.5;
        let (low, share) = (at.floor(), at - at.floor());
        let low = (low as i64).rem_euclid(count as i64) as usize;
        let (a, b) = (f64::from(parts[low]), f64::from(parts[(low + 1) % count]));
        (a + (b - a) * share) / FULL
    }

    pub(super) fn write(&self, writer: &mut Writer) {
        writer.signed(self.origin.as_us());
        for parts in &self.support {
            writer.varint(parts.len() as u64);
            for &part in parts {
                writer.u16(part);
            }
        }
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let origin = Time::from_us(reader.signed()?);
        let mut support = [Vec::new(), Vec::new(), Vec::new()];
        for (parts, cycle) in support.iter_mut().zip(&CYCLES) {
            let count = reader.count(2)?;
            if count != 0 && count != cycle.parts {
                return Err(reader.impossible("a cycle has another number of parts"));
            }
            *parts = reader.u16s(count)?;
        }
        Ok(Self { origin, support })
    }
}

/// Which turn of the cycle a moment is in, and how far through it.
fn turn(time: Time, origin: Time, period: Period) -> (i128, f64) {
    let since_us = i128::from(time.as_us()) - i128::from(origin.as_us());
    let period_us = i128::from(period.as_us());
    let within = since_us.rem_euclid(period_us) as f64 / period_us as f64;
    (since_us.div_euclid(period_us), within)
}

impl Cycle {
    /// The support of each part; `times` are sorted.
    fn support(&self, times: &[Time], origin: Time) -> Vec<u16> {
        let mut marks = vec![0.0_f64; self.parts];
        let mut last_turn = vec![None; self.parts];
        for &time in times {
            let (turn, within) = turn(time, origin, self.period);
            let part = ((within * self.parts as f64) as usize).min(self.parts - 1);
            if last_turn[part] != Some(turn) {
                last_turn[part] = Some(turn);
                marks[part] += 1.0;
            }
        }
        let total: f64 = marks.iter().sum();
        // So few visits are spread over the circle before an hour can be called left out.
        let width = (self.width_s / self.period.as_s()).max(0.5 / total.max(1.0));
        let sharpness = (std::f64::consts::TAU * width).powi(-2);
        let weight = |apart: usize| {
            let angle = std::f64::consts::TAU * apart as f64 / self.parts as f64;
            (sharpness * (angle.cos() - 1.0)).exp()
        };
        let weights: Vec<f64> = (0..self.parts).map(weight).collect();
        let smoothed: Vec<f64> = (0..self.parts)
            .map(|part| {
                let others = marks.iter().enumerate();
                others
                    .map(|(other, mark)| mark * weights[part.abs_diff(other)])
                    .sum()
            })
            .collect();
        let usual = usual(&smoothed, &marks);
        if usual <= 0.0 {
            return vec![0; self.parts];
        }
        (smoothed.iter())
            .map(|value| ((value / (ENOUGH * usual)).min(1.0) * FULL).round() as u16)
            .collect()
    }
}

/// The median of `values` over the marks.
fn usual(values: &[f64], marks: &[f64]) -> f64 {
    let mut marked: Vec<(f64, f64)> = values.iter().copied().zip(marks.iter().copied()).collect();
    marked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = marks.iter().sum::<f64>() / 2.0;
    let mut passed = 0.0;
    for (value, mark) in marked {
        passed += mark;
        if mark > 0.0 && passed >= half {
            return value;
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hours since a Monday at midnight.
    fn at(hour: i64) -> Time {
        Time::from_s(3_600 * hour)
    }

    #[test]
    fn office_hours_support_neither_nights_nor_weekends_nor_other_seasons() {
        let weekdays = (0..60).filter(|day| day % 7 < 5);
        let hours = weekdays.flat_map(|day| (8..18).map(move |hour| at(24 * day + hour)));
        let coverage = Coverage::new(hours);
        let habit = |hour: i64| coverage.at(at(hour)).habit;
        for hour in 8..18 {
            assert!(
                habit(24 * 70 + hour) > 0.9,
                "{hour}: {}",
                habit(24 * 70 + hour)
            );
        }
        for hour in [0, 3, 5, 21, 23] {
            assert!(
                habit(24 * 70 + hour) < 0.05,
                "{hour}: {}",
                habit(24 * 70 + hour)
            );
        }
        assert!(
            habit(24 * 75 + 12) < 0.3,
            "Saturday: {}",
            habit(24 * 75 + 12)
        );
        let season = |day: i64| coverage.at(at(24 * day)).season;
        assert!(season(30) == 1.0 && season(70) > 0.9 && season(240) < 0.05);
    }

    #[test]
    fn regular_visits_and_single_ones_leave_no_hour_out() {
        let hourly = Coverage::new((0..24 * 30).map(at));
        let one = Coverage::new(std::iter::once(at(7)));
        for hour in 0..24 * 7 {
            assert_eq!(hourly.at(at(1_000 + hour)).habit, 1.0);
            assert!(
                one.at(at(hour)).habit > 0.4,
                "{hour}: {:?}",
                one.at(at(hour))
            );
        }
        let none = Coverage::new(std::iter::empty());
        assert_eq!(none.at(at(5)).habit, 0.0);
    }
}

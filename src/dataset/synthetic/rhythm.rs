//! How likely is it that an element shows at this time?
//!
//! A [`Rhythm`] is the true p(t) of one element of the world: a product of smooth windows on the
//! cycles of the year, the week and the day, stretched to `low..=high`:
//!
//! ```text
//! p(t) = low + (high - low) * a(t)   or, for its counterpart,   low + (high - low) * (1 - a(t))
//! a(t) = year(t) * week(t) * day(t),  each in [0, 1]
//! ```
//!
//! Times are UTC; a day starts at 00:00, a year's phase 0 is where it was at the Unix epoch (the
//! first of January, give or take the calendar's leap days). No function of the platform's
//! mathematical library is called, so p(t) is the same number everywhere.

use fremen::time::{Period, Time};

/// A smooth window on a cycle of length 1: up around `start`, down around `end`.
///
/// Two windows that share a border and the ramp sum to 1 there. Needs
/// `ramp <= length <= 1 - ramp`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    start: f64,
    length: f64,
    ramp: f64,
}

/// `x` less its whole part, in `[0, 1)`.
fn wrap(x: f64) -> f64 {
    let fraction = x - x.floor();
    if fraction < 1.0 { fraction } else { 0.0 }
}

/// 0 below 0, 1 above 1, `3 x^2 - 2 x^3` between.
pub(super) fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// A wave with the period 1 that is 1 at 0, -1 at 1/2 and close to a cosine between.
pub(super) fn wave(phase: f64) -> f64 {
    1.0 - 2.0 * smoothstep(2.0 * (wrap(phase + 0.5) - 0.5).abs())
}

impl Window {
    /// The window of this length around `centre`.
    pub(super) fn around(centre: f64, length: f64, ramp: f64) -> Self {
        Self {
            start: wrap(centre - length / 2.0),
            length,
            ramp,
        }
    }

    fn at(self, phase: f64) -> f64 {
        let q = wrap(phase - self.start + self.ramp / 2.0);
        if q < self.ramp {
            smoothstep(q / self.ramp)
        } else if q < self.length {
            1.0
        } else {
            1.0 - smoothstep((q - self.length) / self.ramp)
        }
    }
}

/// When something is active: inside all of the windows that are given.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Activity {
    /// On the year.
    pub(super) year: Option<Window>,
    /// Bit `k` is the `k`-th day of the week, Monday first.
    pub(super) weekdays: Option<u8>,
    /// On the day.
    pub(super) day: Option<Window>,
}

/// 1970-01-01 was a Thursday: the week's phase counted from the epoch starts there.
const EPOCH_WEEKDAY: i64 = 3;

impl Activity {
    fn at(self, time: Time) -> f64 {
        let mut activity = 1.0;
        if let Some(window) = self.year {
            activity *= window.at(time.phase(Period::YEAR));
        }
        if let Some(weekdays) = self.weekdays {
            let day = time.as_us().div_euclid(Period::DAY.as_us()) + EPOCH_WEEKDAY;
            activity *= f64::from((weekdays >> day.rem_euclid(7)) & 1);
        }
        if let Some(window) = self.day {
            activity *= window.at(time.phase(Period::DAY));
        }
        activity
    }
}

/// The probability of being drawn, as a function of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rhythm {
    activity: Activity,
    /// Active when the activity is not.
    counterpart: bool,
    low: f64,
    high: f64,
}

impl Rhythm {
    /// The same at all times.
    pub(super) fn constant(probability: f64) -> Self {
        Self {
            activity: Activity::default(),
            counterpart: false,
            low: probability,
            high: probability,
        }
    }

    /// `high` while active, `low` while not.
    pub(super) fn with(activity: Activity, low: f64, high: f64) -> Self {
        Self {
            activity,
            counterpart: false,
            low,
            high,
        }
    }

    /// `low` while active, `high` while not.
    pub(super) fn without(activity: Activity, low: f64, high: f64) -> Self {
        Self {
            counterpart: true,
            ..Self::with(activity, low, high)
        }
    }

    /// p(t), in `[0, 1]`.
    pub(super) fn at(&self, time: Time) -> f64 {
        let activity = self.activity.at(time);
        let activity = if self.counterpart {
            1.0 - activity
        } else {
            activity
        };
        (self.low + (self.high - self.low) * activity).clamp(0.0, 1.0)
    }

    /// The mean of p(t) over many years, from a sample whose steps share no rhythm with the cycles.
    pub(super) fn mean(&self) -> f64 {
        // Steps of 5.618034 days run through all phases of day, week and year alike.
        const STEPS: i64 = 1461;
        const STEP_US: i64 = 485_398_137_600;
        let sum: f64 = (0..STEPS)
            .map(|step| self.at(Time::from_us(step * STEP_US)))
            .sum();
        sum / STEPS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summer() -> Activity {
        Activity {
            year: Some(Window::around(0.54, 0.5, 0.1)),
            ..Activity::default()
        }
    }

    #[test]
    fn summer_is_in_july_and_its_counterpart_in_january() {
        let july = Time::parse("2023-07-15T12:00:00Z").expect("valid");
        let january = Time::parse("2023-01-15T12:00:00Z").expect("valid");
        let leaves = Rhythm::with(summer(), 0.02, 0.96);
        let snow = Rhythm::without(summer(), 0.02, 0.96);
        assert_eq!(leaves.at(july), 0.96);
        assert_eq!(leaves.at(january), 0.02);
        assert_eq!(snow.at(july), 0.02);
        assert_eq!(snow.at(january), 0.96);
        assert!((leaves.mean() - 0.49).abs() < 0.01, "{}", leaves.mean());
    }

    #[test]
    fn weekdays_start_on_monday() {
        let monday = Activity {
            weekdays: Some(1),
            ..Activity::default()
        };
        let at = |text: &str| monday.at(Time::parse(text).expect("valid"));
        assert_eq!(at("2024-01-01T00:00:00Z"), 1.0);
        assert_eq!(at("2024-01-01T23:59:59Z"), 1.0);
        assert_eq!(at("2024-01-02T00:00:00Z"), 0.0);
        assert_eq!(at("1969-12-29T12:00:00Z"), 1.0);
    }

    #[test]
    fn windows_that_share_a_border_sum_to_one() {
        let first = Window::around(0.25, 0.5, 0.1);
        let second = Window::around(0.75, 0.5, 0.1);
        for k in 0..1000 {
            let phase = f64::from(k) / 1000.0;
            let sum = first.at(phase) + second.at(phase);
            assert!((sum - 1.0).abs() < 1e-12, "{phase}: {sum}");
        }
    }

    #[test]
    fn the_mean_step_meets_all_phases() {
        for (activity, expected) in [
            (summer(), 0.5),
            (
                Activity {
                    weekdays: Some(0b1_1111),
                    ..Activity::default()
                },
                5.0 / 7.0,
            ),
            (
                Activity {
                    day: Some(Window::around(0.5, 0.4, 0.05)),
                    weekdays: Some(0b1_1111),
                    ..Activity::default()
                },
                0.4 * 5.0 / 7.0,
            ),
        ] {
            let mean = Rhythm::with(activity, 0.0, 1.0).mean();
            assert!((mean - expected).abs() < 0.02, "{mean} is not {expected}");
        }
    }
}

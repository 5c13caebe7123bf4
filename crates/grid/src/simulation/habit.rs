//! When is something done in an office?

use fremen::Time;

use crate::random::Random;

/// The first day of the simulated calendar: 1970-01-05, a Monday.
pub const MONDAY: Time = Time::from_s(4 * 86_400);

/// Whole days since [`MONDAY`].
pub fn day_of(time: Time) -> i64 {
    time.since_s(MONDAY).div_euclid(86_400.0) as i64
}

/// Hours since midnight.
pub fn hour_of(time: Time) -> f64 {
    time.since_s(MONDAY).rem_euclid(86_400.0) / 3_600.0
}

/// Whether a day is a Saturday or a Sunday.
pub const fn is_weekend(day: i64) -> bool {
    day.rem_euclid(7) >= 5
}

/// Something that is on once a day for some hours: a cupboard that is open, a door, a trolley.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Habit {
    /// Hour at which it begins on average.
    pub begin_h: f64,
    /// Hour at which it ends on average.
    pub end_h: f64,
    /// Standard deviation of both.
    pub jitter_h: f64,
    /// How likely it happens on a weekday.
    pub on_weekdays: f64,
    /// How likely it happens on a day of the weekend.
    pub on_weekends: f64,
}

impl Habit {
    /// Whether it is on at `time`, for the thing with number `id` in the world of `seed`.
    pub fn is_on(&self, seed: u64, id: u64, time: Time) -> bool {
        let day = day_of(time);
        let mut random = Random::stream(seed, &[id, day as u64]);
        let p = if is_weekend(day) {
            self.on_weekends
        } else {
            self.on_weekdays
        };
        let happens = random.chance(p);
        let begin = self.begin_h + random.normal(self.jitter_h);
        let end = self.end_h + random.normal(self.jitter_h);
        happens && (begin..end).contains(&hour_of(time))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_and_hours_are_those_of_the_calendar() {
        let time = MONDAY.plus_us(((5 * 24 + 7) * 3_600 + 1_800) * 1_000_000);
        assert_eq!(day_of(time), 5);
        assert!((hour_of(time) - 7.5).abs() < 1e-9);
        assert!(is_weekend(5) && is_weekend(6) && !is_weekend(7) && !is_weekend(4));
        assert_eq!(day_of(MONDAY.plus_us(-1)), -1);
    }

    #[test]
    fn a_habit_is_kept_about_as_often_as_it_says() {
        let habit = Habit {
            begin_h: 8.0,
            end_h: 17.0,
            jitter_h: 0.5,
            on_weekdays: 0.8,
            on_weekends: 0.0,
        };
        let at = |day: i64, hour: i64| MONDAY.plus_us((day * 24 + hour) * 3_600_000_000);
        let on = |hour| {
            (0..700)
                .filter(|&day| habit.is_on(3, 1, at(day, hour)))
                .count()
        };
        // Of 500 weekdays.
        assert!(on(12).abs_diff(400) < 30, "{}", on(12));
        assert_eq!(on(3), 0);
        assert!(on(8).abs_diff(200) < 40, "{}", on(8));
    }
}

//! Which moments and lengths of time are there?
//!
//! A [`Time`] is a whole number of microseconds since 1970-01-01T00:00:00Z, a [`Period`] a positive
//! whole number of microseconds. Both are integers, because `f32` epoch seconds step by 128 s and
//! even `f64` phases of short periods lose digits at large epoch times: a phase is taken from
//! `t mod T` in integers ([`Time::phase`]) and only then becomes a fraction.

use std::fmt;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use crate::error::{Error, ErrorKind, Result};

const US_PER_S: i64 = 1_000_000;

/// A moment in UTC, in microseconds since the Unix epoch.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Time(i64);

impl Time {
    /// The moment `us` microseconds after the Unix epoch.
    pub const fn from_us(us: i64) -> Self {
        Self(us)
    }

    /// The moment `s` whole seconds after the Unix epoch.
    pub const fn from_s(s: i64) -> Self {
        Self(s.saturating_mul(US_PER_S))
    }

    /// What the system's clock says.
    ///
    /// A clock that is off by more than 290,000 years gives the nearest end of time.
    pub fn now() -> Self {
        let now = SystemTime::now();
        Self::try_from(now).unwrap_or(if now < SystemTime::UNIX_EPOCH {
            Self(i64::MIN)
        } else {
            Self(i64::MAX)
        })
    }

    /// Microseconds since the Unix epoch.
    pub const fn as_us(self) -> i64 {
        self.0
    }

    /// Seconds since the Unix epoch (exact to a microsecond for the next 140 years).
    pub fn as_s(self) -> f64 {
        self.0 as f64 / US_PER_S as f64
    }

    /// The moment `us` microseconds later (earlier if negative), saturating at the ends of time.
    #[must_use]
    pub const fn plus_us(self, us: i64) -> Self {
        Self(self.0.saturating_add(us))
    }

    /// `self - earlier` in seconds.
    pub fn since_s(self, earlier: Self) -> f64 {
        (i128::from(self.0) - i128::from(earlier.0)) as f64 / US_PER_S as f64
    }

    /// The fraction of `period` that has passed at this moment since the epoch, in `[0, 1)`.
    pub fn phase(self, period: Period) -> f64 {
        self.0.rem_euclid(period.0) as f64 / period.0 as f64
    }
}

impl fmt::Display for Time {
    /// RFC 3339 in UTC, or `epoch+N us` beyond the calendar's range.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match jiff::Timestamp::from_microsecond(self.0) {
            Ok(timestamp) => write!(f, "{timestamp}"),
            Err(_) => write!(f, "epoch{:+} us", self.0),
        }
    }
}

impl From<jiff::Timestamp> for Time {
    /// Cut to whole microseconds, towards the epoch.
    fn from(timestamp: jiff::Timestamp) -> Self {
        Self(timestamp.as_microsecond())
    }
}

impl TryFrom<Time> for jiff::Timestamp {
    type Error = Error;

    /// Fails beyond the years -9999 and 9999.
    fn try_from(time: Time) -> Result<Self> {
        Self::from_microsecond(time.0).map_err(|cause| {
            Error::new(
                ErrorKind::Time,
                format!("{time} is outside of the calendar"),
            )
            .with_source(cause)
        })
    }
}

impl TryFrom<SystemTime> for Time {
    type Error = Error;

    /// Cut to whole microseconds, towards the past.
    fn try_from(time: SystemTime) -> Result<Self> {
        let us = match time.duration_since(SystemTime::UNIX_EPOCH) {
            Ok(since) => i64::try_from(since.as_micros()).ok(),
            Err(before) => {
                let us = before.duration().as_nanos().div_ceil(1_000);
                i64::try_from(us).ok().map(|us| -us)
            }
        };
        us.map(Self).ok_or_else(|| {
            Error::new(
                ErrorKind::Time,
                "the system's time does not fit into 64 bits of microseconds",
            )
        })
    }
}

impl TryFrom<Time> for SystemTime {
    type Error = Error;

    /// Fails where the system cannot represent the time.
    fn try_from(time: Time) -> Result<Self> {
        let distance = Duration::from_micros(time.0.unsigned_abs());
        let moved = if time.0 < 0 {
            Self::UNIX_EPOCH.checked_sub(distance)
        } else {
            Self::UNIX_EPOCH.checked_add(distance)
        };
        moved
            .ok_or_else(|| Error::new(ErrorKind::Time, format!("{time} is no time of this system")))
    }
}

/// The length of one cycle: a positive number of microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "i64", into = "i64")]
pub struct Period(i64);

impl Period {
    /// One hour.
    pub const HOUR: Self = Self(3_600 * US_PER_S);
    /// One day of 24 hours.
    pub const DAY: Self = Self(86_400 * US_PER_S);
    /// Seven days.
    pub const WEEK: Self = Self(7 * 86_400 * US_PER_S);
    /// The mean Gregorian year of 365.2425 days.
    pub const YEAR: Self = Self(31_556_952 * US_PER_S);

    /// A period of `us` microseconds, which must be positive.
    pub fn from_us(us: i64) -> Result<Self> {
        if us > 0 {
            Ok(Self(us))
        } else {
            Err(Error::new(
                ErrorKind::Config,
                format!("a period must be positive, not {us} us"),
            ))
        }
    }

    /// A period of `s` seconds, rounded to the microsecond; must be finite and positive.
    pub fn from_s(s: f64) -> Result<Self> {
        let us = (s * US_PER_S as f64).round();
        // `i64::MAX as f64` rounds up, so `<` keeps the cast below exact.
        if us.is_finite() && us >= 1.0 && us < i64::MAX as f64 {
            Ok(Self(us as i64))
        } else {
            Err(Error::new(
                ErrorKind::Config,
                format!("a period must be a positive number of seconds, not {s}"),
            ))
        }
    }

    /// The `parts`-th part of this period, cut to whole microseconds; at least one.
    #[must_use]
    pub const fn fraction(self, parts: u32) -> Self {
        let parts = if parts == 0 { 1 } else { parts as i64 };
        let us = self.0 / parts;
        Self(if us == 0 { 1 } else { us })
    }

    /// Microseconds.
    pub const fn as_us(self) -> i64 {
        self.0
    }

    /// Seconds.
    pub fn as_s(self) -> f64 {
        self.0 as f64 / US_PER_S as f64
    }
}

impl TryFrom<i64> for Period {
    type Error = Error;

    fn try_from(us: i64) -> Result<Self> {
        Self::from_us(us)
    }
}

impl From<Period> for i64 {
    fn from(period: Period) -> Self {
        period.0
    }
}

impl fmt::Display for Period {
    /// In the largest of years, weeks, days, hours, minutes, seconds that is not above the period.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (unit, name) = [
            (Self::YEAR.0, "y"),
            (Self::WEEK.0, "w"),
            (Self::DAY.0, "d"),
            (Self::HOUR.0, "h"),
            (60 * US_PER_S, "min"),
        ]
        .into_iter()
        .find(|&(unit, _)| self.0 >= unit)
        .unwrap_or((US_PER_S, "s"));
        let value = self.0 as f64 / unit as f64;
        let rounded = (value * 1000.0).round() / 1000.0;
        write!(f, "{rounded} {name}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_and_shows_rfc_3339() {
        let time = Time::parse("2009-10-15T12:00:00Z").expect("valid");
        assert_eq!(time.to_string(), "2009-10-15T12:00:00Z");
        assert_eq!(
            Time::parse("2009-10-15T14:00:00+02:00").expect("valid"),
            time
        );
    }

    #[test]
    fn a_time_without_offset_is_an_error_that_helps() {
        let error = Time::parse("2009-10-15 12:00").expect_err("no offset");
        assert_eq!(error.kind(), ErrorKind::Time);
        assert!(error.to_string().contains("RFC 3339"), "{error}");
    }

    #[test]
    fn phase_is_exact_far_from_the_epoch_and_before_it() {
        let day = Period::DAY;
        assert_eq!(Time::from_s(4 * 86_400 * 40_000 + 21_600).phase(day), 0.25);
        assert_eq!(Time::from_s(-21_600).phase(day), 0.75);
    }

    #[test]
    fn times_of_the_system_and_of_the_calendar_come_back() {
        for us in [0, 1, -1, -1_500_000, 1_255_608_123_456_789] {
            let time = Time::from_us(us);
            let of_system = SystemTime::try_from(time).expect("representable");
            assert_eq!(Time::try_from(of_system).expect("in range"), time, "{us}");
            let of_calendar = jiff::Timestamp::try_from(time).expect("in the calendar");
            assert_eq!(Time::from(of_calendar), time, "{us}");
        }
        let error = jiff::Timestamp::try_from(Time::from_us(i64::MAX)).expect_err("no such year");
        assert_eq!(error.kind(), ErrorKind::Time);
        // This was written in 2026.
        assert!(Time::now() > Time::parse("2026-01-01T00:00:00Z").expect("valid"));
    }

    #[test]
    fn periods_refuse_what_is_no_length() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
            assert!(Period::from_s(bad).is_err(), "{bad}");
        }
        assert_eq!(Period::YEAR.to_string(), "1 y");
        assert_eq!(
            Period::from_s(5400.0).expect("positive").to_string(),
            "1.5 h"
        );
    }
}

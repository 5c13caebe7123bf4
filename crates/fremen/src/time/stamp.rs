//! Which moment does this text mean?
//!
//! RFC 3339 with an offset; a number with its unit (`1714640400s`, `1714640400000ms`); or, where a
//! zone is given, a date without an offset. A bare number is refused with the unit that it looks
//! like ([`TimeUnit::guess`]), a bare date with the way to give a zone: both would be guesses.
//!
//! Numbers are read as decimals, not as floats, so that nanoseconds since 1970 lose no digit.

use std::fmt;
use std::str::FromStr;

use super::moment::Time;
use super::zone::Zone;
use crate::error::{Error, ErrorKind, Result};

/// Microseconds of a day.
const DAY_US: i128 = 86_400_000_000;
/// Moments of recorded data, from 1990 to 2060, in seconds since 1970. No number is one of these in
/// two units.
const RECORDED_S: std::ops::Range<f64> = 631_152_000.0..2_840_140_800.0;

/// What a number that stands for a moment counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum TimeUnit {
    /// Nanoseconds since 1970.
    Nanoseconds,
    /// Microseconds since 1970.
    Microseconds,
    /// Milliseconds since 1970.
    Milliseconds,
    /// Seconds since 1970.
    Seconds,
    /// Minutes since 1970.
    Minutes,
    /// Hours since 1970.
    Hours,
    /// Days since 1970.
    Days,
    /// Days since 1899-12-30, as spreadsheets count them.
    ExcelDays,
    /// Days since noon of 4713-01-01 before Christ, as astronomers count them.
    JulianDays,
}

impl TimeUnit {
    /// Every unit.
    pub const ALL: [Self; 9] = [
        Self::Nanoseconds,
        Self::Microseconds,
        Self::Milliseconds,
        Self::Seconds,
        Self::Minutes,
        Self::Hours,
        Self::Days,
        Self::ExcelDays,
        Self::JulianDays,
    ];

    /// Its short name; the first four also follow a number as its unit.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nanoseconds => "ns",
            Self::Microseconds => "us",
            Self::Milliseconds => "ms",
            Self::Seconds => "s",
            Self::Minutes => "min",
            Self::Hours => "h",
            Self::Days => "d",
            Self::ExcelDays => "excel",
            Self::JulianDays => "julian",
        }
    }

    /// What it is, for people.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Nanoseconds => "nanoseconds since 1970",
            Self::Microseconds => "microseconds since 1970",
            Self::Milliseconds => "milliseconds since 1970",
            Self::Seconds => "seconds since 1970",
            Self::Minutes => "minutes since 1970",
            Self::Hours => "hours since 1970",
            Self::Days => "days since 1970",
            Self::ExcelDays => "days of a spreadsheet",
            Self::JulianDays => "Julian days",
        }
    }

    /// One unit, as a fraction of microseconds; and the moment of the number 0, in microseconds
    /// since 1970.
    const fn scale(self) -> (i128, i128, i128) {
        match self {
            Self::Nanoseconds => (1, 1_000, 0),
            Self::Microseconds => (1, 1, 0),
            Self::Milliseconds => (1_000, 1, 0),
            Self::Seconds => (1_000_000, 1, 0),
            Self::Minutes => (60_000_000, 1, 0),
            Self::Hours => (3_600_000_000, 1, 0),
            Self::Days => (DAY_US, 1, 0),
            Self::ExcelDays => (DAY_US, 1, -25_569 * DAY_US),
            // 2,440,587.5 days before 1970.
            Self::JulianDays => (DAY_US, 1, -4_881_175 * (DAY_US / 2)),
        }
    }

    /// The moment that a decimal number means.
    ///
    /// Fails with [`ErrorKind::Time`] if it is no number or lies outside of the calendar.
    pub fn time(self, number: &str) -> Result<Time> {
        let (above, below, zero_us) = self.scale();
        let us = decimal(number).and_then(|(digits, decimals)| {
            let below = below.checked_mul(10_i128.checked_pow(decimals)?)?;
            let us = rounded(digits.checked_mul(above)?, below);
            // Days have too few digits for microseconds.
            let step = if zero_us == 0 { 1 } else { 1_000 };
            i64::try_from(rounded(us, step) * step + zero_us).ok()
        });
        us.map(Time::from_us)
            .filter(|&time| jiff::Timestamp::try_from(time).is_ok())
            .ok_or_else(|| {
                Error::new(
                    ErrorKind::Time,
                    format!(
                        "`{number}` is no time: these are no {} of the calendar",
                        self.words()
                    ),
                )
                .with_help("write RFC 3339 with an offset, or seconds since 1970")
            })
    }

    /// The one unit in which this number is a moment from 1990 to 2060, if there is one. It may
    /// still be small seconds of a clock that began at 0.
    #[must_use]
    pub fn guess(number: f64) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| {
            let (above, below, zero_us) = unit.scale();
            let s = (number * above as f64 / below as f64 + zero_us as f64) / 1e6;
            RECORDED_S.contains(&s)
        })
    }
}

impl fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for TimeUnit {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        (Self::ALL.into_iter())
            .find(|unit| unit.name() == name)
            .ok_or_else(|| {
                Error::new(ErrorKind::Config, format!("`{name}` is no unit of times")).with_help(
                    format!("the units are {}", Self::ALL.map(Self::name).join(", ")),
                )
            })
    }
}

impl Time {
    /// Reads an RFC 3339 time with an offset (`2009-10-15T12:00:00Z`), or a number since 1970 with
    /// its unit: `s`, `ms`, `us` or `ns` (`1255608000s`).
    ///
    /// A time without offset or unit is refused: it would be a guess by hours, or by millennia.
    pub fn parse(text: &str) -> Result<Self> {
        let text = text.trim();
        if let Some((number, unit)) = split_unit(text) {
            return unit.time(number);
        }
        text.parse::<jiff::Timestamp>()
            .map(Self::from)
            .map_err(|cause| no_moment(text, cause))
    }

    /// [`parse`](Self::parse) where a date without an offset is meant in `zone`, if there is one.
    pub fn parse_in(text: &str, zone: Option<&Zone>) -> Result<Self> {
        let read = Self::parse(text);
        match (zone, text.trim().parse::<jiff::civil::DateTime>()) {
            (Some(zone), Ok(civil)) if read.is_err() => zone.moment(civil),
            _ => read,
        }
    }
}

impl FromStr for Time {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Self::parse(text)
    }
}

/// A number and the unit written behind it.
fn split_unit(text: &str) -> Option<(&str, TimeUnit)> {
    let end = text.find(|c: char| c.is_alphabetic())?;
    let (number, unit) = text.split_at(end);
    let unit = match unit {
        "µs" | "μs" => TimeUnit::Microseconds,
        name => TimeUnit::ALL[..4]
            .iter()
            .copied()
            .find(|unit| unit.name() == name)?,
    };
    let number = number.trim_end();
    decimal(number).map(|_| (number, unit))
}

/// Why this text is no moment.
fn no_moment(text: &str, cause: jiff::Error) -> Error {
    let reason = cause.to_string();
    let number = decimal(text).and_then(|_| text.parse::<f64>().ok());
    let error = |message: String, help: String| {
        Error::new(ErrorKind::Time, message)
            .with_help(help)
            .with_source(cause)
    };
    let guess = number.and_then(TimeUnit::guess);
    if let Some(unit) = guess.filter(|unit| TimeUnit::ALL[..4].contains(unit)) {
        return error(
            format!(
                "bad time `{text}`: it has no unit, and looks like {}",
                unit.words()
            ),
            format!("write {text}{unit}, or RFC 3339 with an offset"),
        );
    }
    if let Some(unit) = guess {
        return error(
            format!("bad time `{text}`: it looks like {}", unit.words()),
            "write RFC 3339 with an offset, such as 2009-10-15T12:00:00Z".into(),
        );
    }
    if text.parse::<jiff::civil::DateTime>().is_ok() {
        return error(
            format!("bad time `{text}`: it has no offset from UTC"),
            "write RFC 3339 with an offset, such as 2009-10-15T12:00:00Z, or name its zone where \
             there is an option --zone"
                .into(),
        );
    }
    error(
        format!("bad time `{text}`: {reason}"),
        "write RFC 3339 with an offset, such as 2009-10-15T12:00:00Z".into(),
    )
}

/// All digits of a decimal number as an integer, and how many of them are behind the point.
fn decimal(text: &str) -> Option<(i128, u32)> {
    /// A number of so many digits and their product with any unit fits into 128 bits.
    const MAX_DIGITS: usize = 25;
    let unsigned = text.strip_prefix(['-', '+']).unwrap_or(text);
    let (mut whole, mut fraction) = unsigned.split_once('.').unwrap_or((unsigned, ""));
    let is_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if !is_digits(whole) || !is_digits(fraction) || whole.is_empty() && fraction.is_empty() {
        // As other programs write large numbers: 1.7145216e9.
        let value = text
            .parse::<f64>()
            .ok()
            .filter(|value| value.abs() < 1e20)?;
        return text
            .contains(['e', 'E'])
            .then(|| ((value * 1e3).round() as i128, 3));
    }
    whole = whole.trim_start_matches('0');
    fraction = fraction.trim_end_matches('0');
    if whole.len() > MAX_DIGITS {
        return None;
    }
    fraction = &fraction[..fraction.len().min(MAX_DIGITS - whole.len())];
    let digits = format!("{whole}{fraction}");
    let digits: i128 = if digits.is_empty() {
        0
    } else {
        digits.parse().ok()?
    };
    let sign = if text.starts_with('-') { -1 } else { 1 };
    Some((sign * digits, fraction.len() as u32))
}

/// The integer nearest to a fraction.
fn rounded(above: i128, below: i128) -> i128 {
    (2 * above + below).div_euclid(2 * below)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_with_their_unit_are_moments_to_the_last_digit() {
        let expected = Time::from_us(1_714_640_400_123_457);
        for text in [
            "2024-05-02T09:00:00.123457Z",
            "2024-05-02T11:00:00.123457+02:00",
            "1714640400.123457s",
            "1714640400123.457ms",
            "1714640400123457us",
            "1714640400123457 µs",
            "1714640400123456999ns",
        ] {
            assert_eq!(Time::parse(text).expect(text), expected, "{text}");
        }
        assert_eq!(
            Time::parse("-1.5s").expect("valid"),
            Time::from_us(-1_500_000)
        );
    }

    #[test]
    fn every_unit_is_recognised_and_reads_the_same_moment() {
        let expected = Time::parse("2024-05-02T09:00:00Z").expect("valid");
        for (number, unit) in [
            ("1714640400000000000", TimeUnit::Nanoseconds),
            ("1714640400000000", TimeUnit::Microseconds),
            ("1714640400000", TimeUnit::Milliseconds),
            ("1.7146404e9", TimeUnit::Seconds),
            ("28577340", TimeUnit::Minutes),
            ("476289", TimeUnit::Hours),
            ("19845.375", TimeUnit::Days),
            ("45414.375", TimeUnit::ExcelDays),
            ("2460432.875", TimeUnit::JulianDays),
        ] {
            assert_eq!(unit.time(number).expect(number), expected, "{number}");
            let value = number.parse().expect("a number");
            assert_eq!(TimeUnit::guess(value), Some(unit), "{number}");
            assert_eq!(unit.name().parse::<TimeUnit>().expect("a name"), unit);
        }
        // A fraction of a day that a spreadsheet has rounded.
        let minute = TimeUnit::ExcelDays.time("45414.0069444444").expect("valid");
        assert_eq!(minute.to_string(), "2024-05-02T00:10:00Z");
    }

    #[test]
    fn what_has_no_unit_or_offset_is_refused_and_named() {
        for (text, words) in [
            ("1714640400", "write 1714640400s"),
            ("1714640400000", "milliseconds since 1970"),
            ("1714640400000000000", "write 1714640400000000000ns"),
            ("45414.375", "days of a spreadsheet"),
            ("2024-05-02 09:00:00", "--zone"),
            ("2024-05-02T09:00:00", "no offset"),
            ("1e300s", "bad time"),
            ("99999999999999s", "calendar"),
            ("yesterday", "RFC 3339"),
            ("", "RFC 3339"),
        ] {
            let error = Time::parse(text).expect_err(text);
            assert_eq!(error.kind(), ErrorKind::Time, "{text}");
            assert!(error.to_string().contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn a_zone_is_for_dates_without_an_offset() {
        let prague = Zone::new("Europe/Prague").expect("known");
        let read = |text: &str| Time::parse_in(text, Some(&prague)).expect(text).to_string();
        assert_eq!(read("2024-05-02T11:00:00"), "2024-05-02T09:00:00Z");
        assert_eq!(read("2024-12-02 11:00:00"), "2024-12-02T10:00:00Z");
        assert_eq!(read("2024-05-02T11:00:00Z"), "2024-05-02T11:00:00Z");
        assert!(Time::parse_in("2024-05-02T11:00:00", None).is_err());
        assert!(Time::parse_in("1714640400", Some(&prague)).is_err());
    }
}

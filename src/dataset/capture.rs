//! When was the picture in this file taken, by its EXIF data?
//!
//! Of the dates in the file the first that exists in the calendar counts: that of taking, of
//! digitising, of the last change. Its offset from UTC is the one written with it, else the one
//! that the satellites' time in the same file shows, else that of the zone that the caller names.
//! Without any of these a date would be a guess by hours, and is none. The satellites' time alone
//! counts where no date does.

use std::path::Path;

use jiff::civil::DateTime;

use crate::feature::{ExifStamp, exif_stamps};
use fremen::error::Result;
use fremen::time::{Time, Zone};

/// Offsets from UTC are multiples of this, s.
const OFFSET_STEP_S: f64 = 900.0;
/// And at most this, s.
const MAX_OFFSET_S: i64 = 14 * 3_600;
/// A camera's clock and the satellites' time of its position differ by less than this, s.
const MAX_GPS_AGE_S: f64 = 300.0;

/// When the picture was taken, if its file says so; `zone` is that of dates without an offset.
///
/// Fails only where the file cannot be read: dates that are none are passed over.
pub fn exif_time(path: &Path, zone: Option<&Zone>) -> Result<Option<Time>> {
    let found = exif_stamps(path)?;
    let gps = (found.gps.as_deref())
        .and_then(Civil::read)
        .and_then(|civil| civil.at_offset(0));
    let dates = found.stamps.iter().filter_map(Civil::of_stamp);
    let first = dates.clone().next();
    // A date of digitising is that of taking for a camera; a date of change may be years later.
    let mut with_offset =
        dates.take_while(|civil| Some(civil.day()) == first.as_ref().map(Civil::day));
    Ok(with_offset
        .find_map(|civil| civil.at_offset(civil.offset_s?))
        .or_else(|| first?.by(gps, zone))
        .or(gps))
}

/// A date of the calendar.
#[derive(Clone, Copy)]
struct Civil {
    date: DateTime,
    offset_s: Option<i64>,
}

impl Civil {
    fn of_stamp(stamp: &ExifStamp) -> Option<Self> {
        let mut civil = Self::read(&stamp.civil)?;
        let written = stamp.offset.as_deref().and_then(offset_s);
        civil.offset_s = written.or(civil.offset_s);
        if civil.date.subsec_nanosecond() == 0
            && let Some(nanoseconds) = nanoseconds(&stamp.fraction)
        {
            civil.date = civil
                .date
                .with()
                .subsec_nanosecond(nanoseconds)
                .build()
                .ok()?;
        }
        Some(civil)
    }

    /// A date with any signs between its numbers, perhaps with a fraction and an offset behind it.
    fn read(text: &str) -> Option<Self> {
        let mut rest = text.trim();
        let mut numbers = [0_i16; 6];
        for (position, number) in numbers.iter_mut().enumerate() {
            if position > 0 {
                let digits = rest.trim_start_matches([':', '-', '/', '.', ' ', 'T', 't']);
                if digits.is_empty() && position == 5 {
                    break;
                }
                rest = digits;
            }
            let len = rest.bytes().take_while(u8::is_ascii_digit).count();
            if len == 0 || len > 4 {
                return None;
            }
            *number = rest[..len].parse().ok()?;
            rest = &rest[len..];
        }
        let [year, month, day, hour, minute, second] = numbers;
        let small = |number: i16| i8::try_from(number).ok();
        let mut fraction = None;
        if let Some(behind) = rest.strip_prefix(['.', ',']) {
            let len = behind.bytes().take_while(u8::is_ascii_digit).count();
            fraction = nanoseconds(&behind[..len]);
            rest = &behind[len..];
        }
        // Some write hours of twelve.
        let of_twelve = rest.trim_start().get(..2).map(str::to_ascii_uppercase);
        let hour = match (of_twelve.as_deref(), hour) {
            (Some("AM"), 12) => 0,
            (Some("PM"), 1..=11) => hour + 12,
            _ => hour,
        };
        if matches!(of_twelve.as_deref(), Some("AM" | "PM")) {
            rest = &rest.trim_start()[2..];
        }
        let date = DateTime::new(
            year,
            small(month)?,
            small(day)?,
            small(hour)?,
            small(minute)?,
            small(second)?,
            fraction.unwrap_or_default(),
        );
        // A clock that was never set writes zeros, or blanks.
        date.ok().filter(|_| year > 0).map(|date| Self {
            date,
            offset_s: offset_s(rest),
        })
    }

    fn day(&self) -> jiff::civil::Date {
        self.date.date()
    }

    /// The moment, so many seconds east of UTC; `None` beyond the calendar.
    fn at_offset(&self, offset_s: i64) -> Option<Time> {
        let as_utc = jiff::tz::TimeZone::UTC.to_timestamp(self.date).ok()?;
        let time = Time::from(as_utc).plus_us(-offset_s * 1_000_000);
        jiff::Timestamp::try_from(time).is_ok().then_some(time)
    }

    /// The moment, by the satellites' time or by the zone.
    fn by(&self, gps: Option<Time>, zone: Option<&Zone>) -> Option<Time> {
        if let (Some(gps), Some(as_utc)) = (gps, self.at_offset(0)) {
            let ahead_s = as_utc.since_s(gps);
            let offset_s = (ahead_s / OFFSET_STEP_S).round() * OFFSET_STEP_S;
            let is_offset = offset_s.abs() <= MAX_OFFSET_S as f64;
            return if is_offset && (ahead_s - offset_s).abs() <= MAX_GPS_AGE_S {
                self.at_offset(offset_s as i64)
            } else {
                Some(gps)
            };
        }
        zone?.moment(self.date).ok()
    }
}

/// Seconds east of UTC: `+02:00`, `-0930`, `+2`, `Z`.
fn offset_s(text: &str) -> Option<i64> {
    let text = text.trim();
    if matches!(text, "Z" | "z" | "UTC") {
        return Some(0);
    }
    let sign = match text.chars().next()? {
        '+' => 1,
        '-' => -1,
        _ => return None,
    };
    let digits = text[1..].trim();
    let (hours, minutes) = match digits.split_once(':') {
        Some(parts) => parts,
        None if digits.len() == 4 => digits.split_at_checked(2)?,
        None => (digits, "0"),
    };
    let (hours, minutes): (u8, u8) = (hours.parse().ok()?, minutes.parse().ok()?);
    let offset_s = i64::from(hours) * 3_600 + i64::from(minutes) * 60;
    (minutes < 60 && offset_s <= MAX_OFFSET_S).then_some(sign * offset_s)
}

/// Digits of a fraction of a second as nanoseconds; `None` if there are none.
fn nanoseconds(digits: &str) -> Option<i32> {
    let digits = digits.trim();
    if digits.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    format!("{digits:0<9}")[..9].parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str, zone: Option<&Zone>, gps: Option<&str>) -> Option<String> {
        let civil = Civil::read(text)?;
        let gps = gps.and_then(|text| Time::parse(text).ok());
        let time = civil
            .offset_s
            .and_then(|offset_s| civil.at_offset(offset_s))
            .or_else(|| civil.by(gps, zone));
        time.map(|time| time.to_string())
    }

    #[test]
    fn dates_are_read_as_writers_write_them() {
        let expected = Some("2024-05-02T09:00:00.25Z".to_owned());
        for text in [
            "2024:05:02 11:00:00.25+02:00",
            "2024-05-02T11:00:00.250+0200",
            "2024/05/02 09:00:00.25Z",
            " 2024:05:02 11:00:00.25 +2 ",
            "2024:05:02 09:00:00.25 AM Z",
        ] {
            assert_eq!(at(text, None, None), expected, "{text}");
        }
    }

    #[test]
    fn dates_that_are_none_are_none() {
        for text in [
            "0000:00:00 00:00:00Z",
            "    :  :     :  :  ",
            "2024:02:30 10:00:00Z",
            "2024:05:02 24:24:27Z",
            "9999:12:31 23:59:59-12:00",
            "2024:05:02 11:00:00+26:00",
            "",
        ] {
            assert_eq!(at(text, None, None), None, "{text}");
        }
    }

    #[test]
    fn an_offset_that_is_not_written_is_that_of_the_satellites_or_of_the_zone() {
        let prague = Zone::new("Europe/Prague").expect("known");
        let date = "2024:05:02 11:00:00";
        assert_eq!(at(date, None, None), None);
        let nine = Some("2024-05-02T09:00:00Z".to_owned());
        assert_eq!(at(date, Some(&prague), None), nine);
        // The position is 40 s old.
        assert_eq!(at(date, None, Some("2024-05-02T08:59:20Z")), nine);
        // The camera's clock is off by minutes: the satellites are right.
        let other = Some("2024-05-02T09:06:00Z".to_owned());
        assert_eq!(at(date, None, Some("2024-05-02T09:06:00Z")), other);
    }
}

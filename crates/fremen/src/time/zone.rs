//! Which time do clocks on walls show there?
//!
//! People live by civil time: an office that opens at eight opens at 6:00 UTC in summer and at
//! 7:00 UTC in winter. A [`Zone`] turns moments into what the clocks there show ([`Zone::wall`]),
//! and what a clock there showed into the moment ([`Zone::moment`]).

use std::fmt;
use std::str::FromStr;

use jiff::civil::DateTime;
use jiff::tz::TimeZone;

use super::moment::Time;
use crate::error::{Error, ErrorKind, Result};

/// The civil time of a region, with its daylight saving.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Zone {
    name: String,
    rules: TimeZone,
}

impl Zone {
    /// The zone that the IANA database calls `name`, such as `Europe/Prague`.
    pub fn new(name: &str) -> Result<Self> {
        TimeZone::get(name)
            .map(|rules| Self {
                name: name.to_owned(),
                rules,
            })
            .map_err(|cause| {
                Error::new(ErrorKind::Config, format!("`{name}` is no time zone"))
                    .with_help("use an IANA name such as Europe/Prague")
                    .with_source(cause)
            })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What clocks there show at a moment, as if they showed UTC.
    ///
    /// Differences of such times are those of clocks: the day that summer time begins has 23 hours
    /// that are shown. Beyond the calendar it is the moment itself.
    #[must_use]
    pub fn wall(&self, time: Time) -> Time {
        match jiff::Timestamp::try_from(time) {
            Ok(moment) => {
                let offset_s = self.rules.to_offset(moment).seconds();
                time.plus_us(i64::from(offset_s) * 1_000_000)
            }
            Err(_) => time,
        }
    }

    /// When clocks there show what they show at `wall`: the inverse of [`wall`](Self::wall).
    #[must_use]
    pub fn moment_shown(&self, wall: Time) -> Time {
        let civil = jiff::Timestamp::try_from(wall)
            .map(|shown| jiff::tz::Offset::UTC.to_datetime(shown))
            .and_then(|civil| self.moment(civil));
        civil.unwrap_or(wall)
    }

    /// When clocks there show this.
    ///
    /// Of an hour that comes twice the first is meant; one that is left out counts on as if it were
    /// not. Fails with [`ErrorKind::Time`] beyond the calendar.
    pub fn moment(&self, civil: DateTime) -> Result<Time> {
        self.rules
            .to_timestamp(civil)
            .map(Time::from)
            .map_err(|cause| {
                Error::new(
                    ErrorKind::Time,
                    format!("{civil} is outside of the calendar"),
                )
                .with_source(cause)
            })
    }
}

impl fmt::Display for Zone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl FromStr for Zone {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::new(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn time(text: &str) -> Time {
        Time::parse(text).expect("valid")
    }

    #[test]
    fn clocks_on_walls_change_twice_a_year() {
        let prague = Zone::new("Europe/Prague").expect("known");
        for (moment, wall) in [
            ("2024-03-31T00:59:59Z", "2024-03-31T01:59:59Z"),
            ("2024-03-31T01:00:00Z", "2024-03-31T03:00:00Z"),
            ("2024-10-27T00:59:59Z", "2024-10-27T02:59:59Z"),
            ("2024-10-27T01:00:00Z", "2024-10-27T02:00:00Z"),
        ] {
            assert_eq!(prague.wall(time(moment)), time(wall), "{moment}");
            let back = prague.moment_shown(time(wall));
            // What clocks show twice is taken for the first time.
            assert!(
                back == time(moment) || wall == "2024-10-27T02:00:00Z",
                "{back}"
            );
        }
        for (civil, moment) in [
            ("2024-03-31T03:00:00", "2024-03-31T01:00:00Z"),
            // The first of the two.
            ("2024-10-27T02:30:00", "2024-10-27T00:30:00Z"),
            ("2024-10-27T03:00:00", "2024-10-27T02:00:00Z"),
        ] {
            let civil = civil.parse().expect("civil");
            assert_eq!(prague.moment(civil).expect("in range"), time(moment));
        }
        let end = Time::from_us(i64::MAX);
        assert_eq!(prague.wall(end), end);
    }

    #[test]
    fn a_zone_that_is_none_is_an_error_that_helps() {
        let error = Zone::new("Europe/Atlantis").expect_err("sunk");
        assert!(error.to_string().contains("Europe/Prague"), "{error}");
    }
}

//! When was an image with this file name taken?
//!
//! A [`NamePattern`] is text with fields in braces, matched with a file's name without folders and
//! extension: `{year:4}-{month:2}-{day:2}T{hour:2}_{minute:2}_{second:2}`. A field is a run of
//! decimal digits: exactly as many as the number after the colon, or else as many as there are. `*`
//! stands for any text. Fields: `year`, `month`, `day`, `hour`, `minute`, `second` (of a moment in
//! UTC), `unix_s`, `unix_ms`, `unix_us` and `unix_ns` (since 1970; seconds may have a fraction),
//! `visit` (a number that the time rule turns into a time) and `place` (any text, unless the number
//! of its digits is given; ignored here).

use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Time, TimeUnit, Zone};

const FIELDS: [&str; 12] = [
    "year", "month", "day", "hour", "minute", "second", "unix_s", "unix_ms", "unix_us", "unix_ns",
    "visit", "place",
];
/// Those that are moments by themselves.
const MOMENTS: [(&str, TimeUnit); 4] = [
    ("unix_ns", TimeUnit::Nanoseconds),
    ("unix_us", TimeUnit::Microseconds),
    ("unix_ms", TimeUnit::Milliseconds),
    ("unix_s", TimeUnit::Seconds),
];

/// What a name has for each of them.
type Values<'t> = [Option<&'t str>; FIELDS.len()];

#[derive(Clone, Debug, PartialEq, Eq)]
enum Part {
    Literal(String),
    /// Index into [`FIELDS`] and number of digits.
    Field(usize, Option<usize>),
    Anything,
}

/// A pattern of file names that contain a time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct NamePattern(Vec<Part>);

/// What a file name says about its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Moment {
    At(Time),
    Visit(i64),
}

impl NamePattern {
    pub(super) fn parse(pattern: &str) -> Result<Self> {
        let bad = |message: String| {
            Error::new(
                ErrorKind::Config,
                format!("the file name pattern `{pattern}` {message}"),
            )
            .with_help("an example: {year:4}{month:2}{day:2}_{hour:2}{minute:2}{second:2}")
        };
        let mut parts = Vec::new();
        let mut rest = pattern;
        while let Some(start) = rest.find(['{', '*']) {
            if start > 0 {
                parts.push(Part::Literal(rest[..start].into()));
            }
            if rest[start..].starts_with('*') {
                parts.push(Part::Anything);
                rest = &rest[start + 1..];
                continue;
            }
            let end = rest[start..]
                .find('}')
                .ok_or_else(|| bad("opens a brace and does not close it".into()))?
                + start;
            let (name, digits) = match rest[start + 1..end].split_once(':') {
                Some((name, digits)) => {
                    let digits = digits
                        .parse()
                        .ok()
                        .filter(|&digits| (1..=18).contains(&digits))
                        .ok_or_else(|| bad(format!("names `{digits}` digits, not 1 to 18")))?;
                    (name, Some(digits))
                }
                None => (&rest[start + 1..end], None),
            };
            let field = FIELDS
                .iter()
                .position(|&known| known == name)
                .ok_or_else(|| {
                    bad(format!(
                        "has the unknown field `{name}`; the fields are {}",
                        FIELDS.join(", ")
                    ))
                })?;
            parts.push(Part::Field(field, digits));
            rest = &rest[end + 1..];
        }
        if !rest.is_empty() {
            parts.push(Part::Literal(rest.into()));
        }
        let pattern = Self(parts);
        let says_when = (pattern.has("year") && pattern.has("month") && pattern.has("day"))
            || MOMENTS.iter().any(|(field, _)| pattern.has(field))
            || pattern.has("visit");
        if says_when {
            Ok(pattern)
        } else {
            Err(bad(
                "has no time: it needs year, month and day, or unix_s, unix_ms, unix_us, unix_ns or \
                 visit"
                    .into(),
            ))
        }
    }

    pub(super) fn has(&self, field: &str) -> bool {
        self.0
            .iter()
            .any(|part| matches!(part, Part::Field(id, _) if FIELDS[*id] == field))
    }

    /// The moment in `stem`, a file name without folders and extension; its date is one of `zone`,
    /// or of UTC.
    pub(super) fn read(&self, stem: &str, zone: Option<&Zone>) -> Option<Moment> {
        self.read_with_place(stem, zone).map(|(moment, _)| moment)
    }

    /// [`read`](Self::read), with the place as it is written, if the pattern has one.
    pub(super) fn read_with_place(
        &self,
        stem: &str,
        zone: Option<&Zone>,
    ) -> Option<(Moment, Option<String>)> {
        let mut values = [None; FIELDS.len()];
        if !read_parts(&self.0, stem, &mut values) {
            return None;
        }
        let place = values[FIELDS.len() - 1].map(str::to_owned);
        moment(&values, zone).map(|moment| (moment, place))
    }
}

/// The moment that the fields of a name say.
fn moment(values: &Values<'_>, zone: Option<&Zone>) -> Option<Moment> {
    let get = |name: &str| values[FIELDS.iter().position(|&known| known == name)?];
    if let Some((number, unit)) =
        (MOMENTS.iter()).find_map(|(field, unit)| Some((get(field)?, unit)))
    {
        return unit.time(number).ok().map(Moment::At);
    }
    if let (Some(year), Some(month), Some(day)) = (get("year"), get("month"), get("day")) {
        let small = |digits: &str| digits.parse::<i8>().ok();
        let civil = jiff::civil::DateTime::new(
            year.parse().ok()?,
            small(month)?,
            small(day)?,
            small(get("hour").unwrap_or("0"))?,
            small(get("minute").unwrap_or("0"))?,
            small(get("second").unwrap_or("0"))?,
            0,
        )
        .ok()?;
        if let Some(zone) = zone {
            return zone.moment(civil).ok().map(Moment::At);
        }
        let utc = jiff::tz::TimeZone::UTC.to_timestamp(civil).ok()?;
        return Some(Moment::At(Time::from(utc)));
    }
    get("visit")?.parse().ok().map(Moment::Visit)
}

fn read_parts<'t>(parts: &[Part], text: &'t str, values: &mut Values<'t>) -> bool {
    let Some((first, later)) = parts.split_first() else {
        return text.is_empty();
    };
    let ends = || {
        text.char_indices()
            .map(|(start, _)| start)
            .chain([text.len()])
    };
    match first {
        Part::Literal(literal) => text
            .strip_prefix(literal.as_str())
            .is_some_and(|rest| read_parts(later, rest, values)),
        Part::Field(field, digits) => {
            let run = text.bytes().take_while(u8::is_ascii_digit).count();
            let mut take = |end: usize| {
                values[*field] = Some(&text[..end]);
                read_parts(later, &text[end..], values)
            };
            match (FIELDS[*field], digits) {
                ("place", None) => ends().skip(1).any(take),
                (_, Some(digits)) => run >= *digits && take(*digits),
                // Of 1714640400.25 all of it, unless the pattern goes on with the point.
                ("unix_s", None) if run > 0 => {
                    let behind = text[run..].strip_prefix('.').unwrap_or_default();
                    let fraction = behind.bytes().take_while(u8::is_ascii_digit).count();
                    (fraction > 0 && take(run + 1 + fraction)) || take(run)
                }
                _ => run > 0 && take(run),
            }
        }
        Part::Anything => ends().any(|start| read_parts(later, &text[start..], values)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> Moment {
        Moment::At(Time::parse(text).unwrap())
    }

    #[test]
    fn reads_calendar_fields_epoch_counts_and_visits() {
        let pattern =
            NamePattern::parse("{year:4}-{month:2}-{day:2}T{hour:2}_{minute:2}_{second:2}")
                .unwrap();
        assert_eq!(
            pattern.read("2023-06-13T03_11_46", None),
            Some(at("2023-06-13T03:11:46Z"))
        );
        assert_eq!(pattern.read("2023-06-13T03_11_46x", None), None);
        assert_eq!(
            pattern.read("2023-13-13T03_11_46", None),
            None,
            "there is no month 13"
        );
        assert_eq!(
            NamePattern::parse("{unix_us}")
                .unwrap()
                .read("1326030975726043", None),
            Some(at("2012-01-08T13:56:15.726043Z"))
        );
        assert_eq!(
            NamePattern::parse("cam*_{unix_s}")
                .unwrap()
                .read("cam_front_86400", None),
            Some(at("1970-01-02T00:00:00Z"))
        );
        for (pattern, name) in [
            ("{unix_ms}", "1326030975726"),
            ("cam_{unix_s}", "cam_1326030975.726000"),
            ("{unix_s}.*", "1326030975.726"),
            ("{unix_ns}_{place}", "1326030975726000000_hall"),
        ] {
            let read = NamePattern::parse(pattern).unwrap().read(name, None);
            let is_cut = pattern == "{unix_s}.*";
            let expected = if is_cut {
                "2012-01-08T13:56:15Z"
            } else {
                "2012-01-08T13:56:15.726Z"
            };
            assert_eq!(read, Some(at(expected)), "{pattern}");
        }
        assert_eq!(
            NamePattern::parse("{visit:2}{place:2}")
                .unwrap()
                .read("1205", None),
            Some(Moment::Visit(12))
        );
    }

    #[test]
    fn refuses_patterns_that_say_no_time() {
        for (pattern, message) in [
            ("{year:4}", "has no time"),
            ("{yaer:4}", "unknown field `yaer`"),
            ("{visit", "does not close"),
            ("{visit:0}", "`0` digits"),
        ] {
            let error = NamePattern::parse(pattern).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}

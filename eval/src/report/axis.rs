//! Where do the marks of an axis stand: times, frequencies and probabilities?

use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use jiff::{Span, Timestamp};

use super::content::TimeAxis;
use super::html::put;

/// At most six positions with texts between two times.
pub(super) fn time_ticks(axis: TimeAxis, first: f64, last: f64) -> Vec<(f64, String)> {
    match axis {
        TimeAxis::VisitIndex => {
            let step = ((last - first) / 5.0).ceil().max(1.0);
            let num = ((last - first) / step).floor() as u32;
            (0..=num)
                .map(|i| first.ceil() + f64::from(i) * step)
                .filter(|index| *index <= last)
                .map(|index| (index, format!("visit {index:.0}")))
                .collect()
        }
        TimeAxis::UnixSeconds => calendar_ticks(first, last).unwrap_or_default(),
    }
}

/// Whole hours, days, months or years; `None` outside the calendar.
fn calendar_ticks(first: f64, last: f64) -> Option<Vec<(f64, String)>> {
    const HOUR: f64 = 3_600.0;
    const DAY: f64 = 24.0 * HOUR;
    const MONTH: f64 = 30.5 * DAY;
    let candidates = [
        (HOUR, Span::new().hours(1), "%H:%M"),
        (3.0 * HOUR, Span::new().hours(3), "%H:%M"),
        (6.0 * HOUR, Span::new().hours(6), "%d %b %H:%M"),
        (DAY, Span::new().days(1), "%d %b"),
        (2.0 * DAY, Span::new().days(2), "%d %b"),
        (7.0 * DAY, Span::new().days(7), "%d %b"),
        (14.0 * DAY, Span::new().days(14), "%d %b"),
        (MONTH, Span::new().months(1), "%b %y"),
        (3.0 * MONTH, Span::new().months(3), "%b %y"),
        (6.0 * MONTH, Span::new().months(6), "%b %y"),
        (12.0 * MONTH, Span::new().years(1), "%Y"),
        (60.0 * MONTH, Span::new().years(5), "%Y"),
        (240.0 * MONTH, Span::new().years(20), "%Y"),
    ];
    let (seconds, span, format) = candidates
        .into_iter()
        .find(|(seconds, ..)| (last - first) / seconds <= 5.5)?;
    let start = civil(first)?;
    let mut tick = if seconds < MONTH {
        start.date().at(0, 0, 0, 0)
    } else if seconds < 12.0 * MONTH {
        start.date().first_of_month().at(0, 0, 0, 0)
    } else {
        start.date().first_of_year().at(0, 0, 0, 0)
    };
    let mut ticks = Vec::new();
    while let Some(time) = unix(tick).filter(|time| *time <= last) {
        if time >= first {
            ticks.push((time, tick.strftime(format).to_string()));
        }
        tick = tick.checked_add(span).ok()?;
    }
    Some(ticks)
}

fn civil(time: f64) -> Option<DateTime> {
    let time = Timestamp::from_second(time as i64).ok()?;
    Some(time.to_zoned(TimeZone::UTC).datetime())
}

fn unix(time: DateTime) -> Option<f64> {
    let zoned = time.to_zoned(TimeZone::UTC).ok()?;
    Some(zoned.timestamp().as_second() as f64)
}

/// At most seven round frequencies between two.
pub(super) fn frequency_ticks(first: f64, last: f64) -> Vec<(f64, String)> {
    const STEPS: [f64; 3] = [1.0, 2.0, 5.0];
    let span = last - first;
    if !span.is_finite() || span <= 0.0 {
        return vec![(first, format!("{first:.1}"))];
    }
    let decade = span.log10().floor() as i32 - 1;
    let steps = (decade..=decade + 1).flat_map(|power| STEPS.map(|step| (step, power)));
    let (step, power) = (steps.into_iter())
        .find(|&(step, power)| span / (step * 10_f64.powi(power)) <= 6.0)
        .unwrap_or((1.0, decade + 2));
    let step = step * 10_f64.powi(power);
    let decimals = (-power).max(0) as usize;
    ((first / step).ceil() as i64..=(last / step).floor() as i64)
        .map(|i| (i as f64 * step, format!("{:.decimals$}", i as f64 * step)))
        .collect()
}

/// Lines across a picture from `left` to `right` at p = 0, 1/2 and 1, each with its number `gap` to
/// the left.
pub(super) fn probability_lines(
    html: &mut String,
    (left, right): (f64, f64),
    gap: f64,
    y: impl Fn(f64) -> f64,
) {
    for (p, text) in [(0.0, "0"), (0.5, "0.5"), (1.0, "1")] {
        put!(
            html,
            "<path class=\"axis\" d=\"M{left} {y:.1}H{right}\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{text}</text>",
            left - gap,
            y(p) + 4.5,
            y = y(p)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calendar_ticks_are_few_and_inside() {
        let start = 1_300_000_000.0;
        for span in [2_000.0, 9e3, 6e4, 3e5, 2e6, 3e7, 4e8, 3e9] {
            let ticks = calendar_ticks(start, start + span).unwrap();
            assert!(ticks.len() <= 7, "{span}: {ticks:?}");
            assert!(
                ticks
                    .iter()
                    .all(|(t, _)| (start..=start + span).contains(t))
            );
        }
        let year = calendar_ticks(1_293_840_000.0, 1_325_300_000.0).unwrap();
        assert_eq!(year[0].1, "Jan 11");
        assert!(calendar_ticks(f64::MAX / 2.0, f64::MAX).is_none());
    }

    #[test]
    fn frequencies_are_marked_at_round_numbers() {
        let texts = |first, last| -> Vec<String> {
            let ticks = frequency_ticks(first, last);
            assert!((2..=7).contains(&ticks.len()), "{ticks:?}");
            assert!(ticks.iter().all(|(f, _)| (first..=last).contains(f)));
            ticks.into_iter().map(|(_, text)| text).collect()
        };
        assert_eq!(texts(0.13, 2.6), ["0.5", "1.0", "1.5", "2.0", "2.5"]);
        assert_eq!(texts(1.0, 12.0), ["2", "4", "6", "8", "10", "12"]);
        for last in [0.01, 0.7, 3.3, 24.0, 99.0, 4_321.0] {
            texts(last / 40.0, last);
        }
        assert_eq!(frequency_ticks(1.0, 1.0).len(), 1);
    }
}

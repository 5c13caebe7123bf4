//! Where does a time stand on the axis of a history?
//!
//! The viewer's plots have the timeline as their axis. A history of years must be seen at any
//! moment of any timeline, while queries come in seconds: it is drawn as lines and points of a
//! plane instead (x to the right, y down, in units of the canvas).
//!
//! The axis spans the history and has room beyond both of its ends, for queries of other times. It
//! goes on to a query that is near; before one that is further away it is broken, and the query
//! stands behind the break.

use chronotope::Time;

/// Width and height of the canvas: about the shape of its panel.
pub(crate) const CANVAS: (f32, f32) = (1000.0, 290.0);
/// Left and right end of the history.
const HISTORY_X: (f32, f32) = (112.0, 850.0);
/// Left and right end of the axis with what lies beyond the history.
const AXIS_X: (f32, f32) = (66.0, 930.0);
/// p = 1 and p = 0.
const P_Y: (f32, f32) = (62.0, 232.0);
/// The probabilities that have a line.
const LEVELS: [(f64, &str); 3] = [(0.0, "0"), (0.5, "0.5"), (1.0, "1")];
/// Steps between dates.
const NUM_DATES: i64 = 4;
/// Texts hang below their points: those beside a line have points above it by half a text.
const TEXT_RISE: f32 = 13.0;
/// Half the width of a break, and how far its strokes lean and reach up and down.
const BREAK: f32 = 5.0;
const STROKE: (f32, f32) = (4.0, 9.0);
/// Notes stay this far from the edges of the canvas: half their width.
const NOTE_MARGIN: f32 = 125.0;

/// A line from one point of the canvas to another.
pub(crate) type Line = [(f32, f32); 2];

/// The axis of one history.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TimeAxis {
    first_us: i64,
    last_us: i64,
}

/// Where a query's time stands.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mark {
    pub(crate) x: f32,
    /// What carries the axis on to it; nothing within the history.
    pub(crate) extension: Vec<Line>,
    /// Strokes across the axis where its scale ends; none if it holds up to the mark.
    pub(crate) breaks: Vec<Line>,
}

impl TimeAxis {
    /// From the first to the last of `times_us`; `None` if there are none.
    pub(crate) fn around(times_us: impl Iterator<Item = i64> + Clone) -> Option<Self> {
        Some(Self {
            first_us: times_us.clone().min()?,
            last_us: times_us.max()?,
        })
    }

    /// Where a time of the history lies; what is outside is drawn at the nearer end.
    pub(crate) fn x(&self, time_us: i64) -> f32 {
        let (left, right) = HISTORY_X;
        self.scaled(time_us)
            .clamp(f64::from(left), f64::from(right)) as f32
    }

    /// Where a probability lies; no number counts as 0.
    #[expect(clippy::manual_clamp, reason = "clamp keeps what is not a number")]
    pub(crate) fn y(p: f64) -> f32 {
        let (top, bottom) = P_Y;
        bottom - p.max(0.0).min(1.0) as f32 * (bottom - top)
    }

    /// Lines of 0, one half and 1, and one up from each date.
    pub(crate) fn lines(&self) -> Vec<Line> {
        let (left, right) = HISTORY_X;
        let levels = LEVELS.map(|(p, _)| [(left, Self::y(p)), (right, Self::y(p))]);
        let dates = (self.dates().into_iter()).map(|(us, _)| upright(self.x(us)));
        levels.into_iter().chain(dates).collect()
    }

    /// Texts at the axes, and the points that they hang from.
    pub(crate) fn texts(&self) -> Vec<((f32, f32), String)> {
        let left = AXIS_X.0 - 32.0;
        let levels = LEVELS.map(|(p, text)| ((left, Self::y(p) - TEXT_RISE), text.to_owned()));
        let dates =
            (self.dates().into_iter()).map(|(us, text)| ((self.x(us), Self::y(0.0) + 6.0), text));
        levels.into_iter().chain(dates).collect()
    }

    /// Where the name of the feature hangs from.
    pub(crate) fn title_at() -> (f32, f32) {
        (HISTORY_X.0.midpoint(HISTORY_X.1), 0.0)
    }

    /// Where a query's time stands, and what of the axis is drawn for it alone.
    pub(crate) fn mark(&self, time_us: i64) -> Mark {
        let scaled = self.scaled(time_us);
        let x = scaled.clamp(f64::from(AXIS_X.0), f64::from(AXIS_X.1)) as f32;
        let mut mark = Mark {
            x,
            extension: Vec::new(),
            breaks: Vec::new(),
        };
        let end = if time_us < self.first_us {
            HISTORY_X.0
        } else if time_us > self.last_us {
            HISTORY_X.1
        } else {
            return mark;
        };
        let is_near = (f64::from(AXIS_X.0)..=f64::from(AXIS_X.1)).contains(&scaled);
        let middle = end.midpoint(x);
        let toward = (x - end).signum();
        for y in LEVELS.map(|(p, _)| Self::y(p)) {
            if is_near {
                mark.extension.push([(end, y), (x, y)]);
                continue;
            }
            let (before, after) = (middle - toward * BREAK, middle + toward * BREAK);
            mark.extension.push([(end, y), (before, y)]);
            mark.extension.push([(after, y), (x, y)]);
            let (lean, reach) = STROKE;
            mark.breaks
                .extend([before, after].map(|at| [(at - lean, y + reach), (at + lean, y - reach)]));
        }
        mark
    }

    /// The text of a query's time and of p then, and the point above the mark that it hangs from.
    pub(crate) fn note(&self, time_us: i64, p: f64) -> ((f32, f32), String) {
        let x = (self.mark(time_us).x).clamp(NOTE_MARGIN, CANVAS.0 - NOTE_MARGIN);
        let text = format!("now ({}): p = {p:.2}", minute(time_us));
        ((x, P_Y.0 - 34.0), text)
    }

    /// Where a time would lie if the scale of the history went on for ever.
    fn scaled(&self, time_us: i64) -> f64 {
        let (left, right) = (f64::from(HISTORY_X.0), f64::from(HISTORY_X.1));
        let span = (i128::from(self.last_us) - i128::from(self.first_us)) as f64;
        let since = (i128::from(time_us) - i128::from(self.first_us)) as f64;
        if span > 0.0 {
            left + since / span * (right - left)
        } else if since == 0.0 {
            left.midpoint(right)
        } else {
            // A history of one moment has no scale.
            since.signum() * f64::INFINITY
        }
    }

    /// Times at equal steps with texts as exact as the span needs.
    fn dates(&self) -> Vec<(i64, String)> {
        const DAY_US: i128 = 86_400_000_000;
        let span = i128::from(self.last_us) - i128::from(self.first_us);
        if span == 0 {
            return vec![(self.first_us, minute(self.first_us))];
        }
        (0..=NUM_DATES)
            .map(|i| {
                let us = i128::from(self.first_us) + span * i128::from(i) / i128::from(NUM_DATES);
                let us = us as i64;
                let text = minute(us);
                let text = match span / DAY_US {
                    0..=9 => text,
                    10..=2_000 => text.chars().take(10).collect(),
                    _ => text.chars().take(7).collect(),
                };
                (us, text)
            })
            .collect()
    }
}

/// From p = 0 to p = 1.
pub(crate) fn upright(x: f32) -> Line {
    [(x, TimeAxis::y(1.0)), (x, TimeAxis::y(0.0))]
}

/// `2026-03-01 14:05`, UTC.
fn minute(us: i64) -> String {
    (Time::from_us(us).to_string().chars().take(16))
        .map(|c| if c == 'T' { ' ' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: i64 = 86_400_000_000;

    fn axis(first_us: i64, last_us: i64) -> TimeAxis {
        TimeAxis::around([first_us, last_us].into_iter()).expect("times")
    }

    #[test]
    fn a_history_fills_its_frame() {
        let axis = TimeAxis::around([5 * DAY, 0, 10 * DAY].into_iter()).expect("times");
        assert_eq!(axis.x(0), HISTORY_X.0);
        assert_eq!(axis.x(10 * DAY), HISTORY_X.1);
        assert_eq!(axis.x(-3 * DAY), HISTORY_X.0);
        assert_eq!(axis.x(i64::MAX), HISTORY_X.1);
        assert!(TimeAxis::y(1.0) < TimeAxis::y(0.0), "y points down");
        assert_eq!(TimeAxis::y(f64::NAN), TimeAxis::y(0.0));
        assert!(TimeAxis::around(std::iter::empty()).is_none());
    }

    #[test]
    fn a_query_within_the_history_stands_on_the_axis() {
        let axis = axis(0, 100 * DAY);
        for day in [0, 50, 100] {
            let mark = axis.mark(day * DAY);
            assert_eq!(mark.x, axis.x(day * DAY));
            assert!(mark.extension.is_empty() && mark.breaks.is_empty());
        }
        let (at, text) = axis.note(50 * DAY, 0.934);
        assert_eq!(at.0, axis.x(50 * DAY));
        assert_eq!(text, "now (1970-02-20 00:00): p = 0.93");
    }

    #[test]
    fn the_axis_goes_on_to_a_query_shortly_after_or_before() {
        let axis = axis(0, 100 * DAY);
        let day = (HISTORY_X.1 - HISTORY_X.0) / 100.0;
        for (days_outside, time_us, end, toward) in [
            (2, 102 * DAY, HISTORY_X.1, 1.0),
            (10, 110 * DAY, HISTORY_X.1, 1.0),
            (3, -3 * DAY, HISTORY_X.0, -1.0),
        ] {
            let mark = axis.mark(time_us);
            let expected = end + toward * day * days_outside as f32;
            assert!((mark.x - expected).abs() < 0.01, "{mark:?}");
            assert!(mark.breaks.is_empty(), "{mark:?}");
            assert_eq!(mark.extension.len(), LEVELS.len());
            for line in &mark.extension {
                assert_eq!((line[0].0, line[1].0), (end, mark.x));
            }
        }
        assert_eq!(
            axis.note(102 * DAY, 1.0).1,
            "now (1970-04-13 00:00): p = 1.00"
        );
    }

    #[test]
    fn the_axis_is_broken_before_a_query_long_after_or_before() {
        let axis = axis(0, 100 * DAY);
        for (time_us, end, outer) in [
            (444 * DAY, HISTORY_X.1, AXIS_X.1),
            (112 * DAY, HISTORY_X.1, AXIS_X.1),
            (i64::MAX, HISTORY_X.1, AXIS_X.1),
            (-400 * DAY, HISTORY_X.0, AXIS_X.0),
            (i64::MIN, HISTORY_X.0, AXIS_X.0),
        ] {
            let mark = axis.mark(time_us);
            assert_eq!(mark.x, outer);
            assert_eq!(mark.breaks.len(), 2 * LEVELS.len());
            assert_eq!(mark.extension.len(), 2 * LEVELS.len());
            let between = end.min(outer)..=end.max(outer);
            for line in mark.extension.iter().chain(&mark.breaks) {
                assert!(
                    line.iter().all(|point| between.contains(&point.0)),
                    "{mark:?}"
                );
            }
            // Nothing lies between the two strokes.
            for pieces in mark.extension.chunks(2) {
                assert_eq!((pieces[0][0].0, pieces[1][1].0), (end, outer));
                assert_eq!((pieces[0][1].0 - pieces[1][0].0).abs(), 2.0 * BREAK);
            }
        }
        let (at, text) = axis.note(444 * DAY, 0.5);
        assert_eq!(text, "now (1971-03-21 00:00): p = 0.50");
        assert!(at.0 + NOTE_MARGIN <= CANVAS.0, "{at:?}");
        assert!(axis.note(-400 * DAY, 0.5).0.0 >= NOTE_MARGIN);
    }

    #[test]
    fn a_history_of_one_moment_has_no_scale() {
        let axis = axis(DAY, DAY);
        assert_eq!(axis.mark(DAY).x, axis.x(DAY));
        assert!(axis.mark(DAY).breaks.is_empty());
        assert_eq!(axis.mark(DAY + 1).x, AXIS_X.1);
        assert_eq!(axis.mark(DAY - 1).x, AXIS_X.0);
        assert!(!axis.mark(DAY + 1).breaks.is_empty());
    }

    #[test]
    fn dates_are_as_exact_as_the_span_needs() {
        let texts = |span: i64| -> Vec<String> {
            let dates = axis(0, span).dates();
            dates.into_iter().map(|(_, text)| text).collect()
        };
        assert_eq!(texts(0), ["1970-01-01 00:00"]);
        assert_eq!(texts(2 * DAY)[1], "1970-01-01 12:00");
        assert_eq!(texts(40 * DAY)[4], "1970-02-10");
        assert_eq!(texts(4_000 * DAY)[4], "1980-12");
        assert_eq!(axis(i64::MIN, i64::MAX).dates().len(), 5);
    }
}

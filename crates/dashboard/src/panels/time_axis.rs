//! Where does a time stand on the axis of a history?
//!
//! The viewer's plots have the timeline as their axis. A history of years must be seen at any moment
//! of any timeline, while queries come in seconds: it is drawn as lines and points of a plane
//! instead (x to the right, y down, in units of the canvas).

use chronotope::Time;

/// Width and height of the canvas: about the shape of its panel.
pub(crate) const CANVAS: (f32, f32) = (1000.0, 290.0);
/// Texts hang below their points: those beside a line have points above it by half a text.
const TEXT_RISE: f32 = 13.0;

/// Left and right end of a history.
const HISTORY_X: (f32, f32) = (70.0, 935.0);
/// p = 1 and p = 0.
const P_Y: (f32, f32) = (62.0, 232.0);
const NUM_DATES: i64 = 4;

/// The axis of one history.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TimeAxis {
    first_us: i64,
    last_us: i64,
}

impl TimeAxis {
    /// From the first to the last of `times_us`; `None` if there are none.
    pub(crate) fn around(times_us: impl Iterator<Item = i64> + Clone) -> Option<Self> {
        Some(Self {
            first_us: times_us.clone().min()?,
            last_us: times_us.max()?,
        })
    }

    /// Where a time lies; what is outside is drawn at the nearer end.
    pub(crate) fn x(&self, time_us: i64) -> f32 {
        let span = (i128::from(self.last_us) - i128::from(self.first_us)) as f64;
        let since = (i128::from(time_us) - i128::from(self.first_us)) as f64;
        let share = if span > 0.0 { since / span } else { 0.5 };
        let (left, right) = HISTORY_X;
        left + share.clamp(0.0, 1.0) as f32 * (right - left)
    }

    /// Where a probability lies; no number counts as 0.
    #[expect(clippy::manual_clamp, reason = "clamp keeps what is not a number")]
    pub(crate) fn y(p: f64) -> f32 {
        let (top, bottom) = P_Y;
        bottom - p.max(0.0).min(1.0) as f32 * (bottom - top)
    }

    /// Lines of 0, one half and 1, and one up from each date.
    pub(crate) fn lines(&self) -> Vec<[(f32, f32); 2]> {
        let (left, right) = HISTORY_X;
        let levels = [0.0, 0.5, 1.0].map(|p| [(left, Self::y(p)), (right, Self::y(p))]);
        let dates = (self.dates().into_iter()).map(|(us, _)| {
            let x = self.x(us);
            [(x, Self::y(0.0)), (x, Self::y(1.0))]
        });
        levels.into_iter().chain(dates).collect()
    }

    /// Texts at the axes, and the points that they hang from.
    pub(crate) fn texts(&self) -> Vec<((f32, f32), String)> {
        let levels = [(0.0, "0"), (0.5, "0.5"), (1.0, "1")];
        let levels = levels.map(|(p, text)| {
            (
                (HISTORY_X.0 - 36.0, Self::y(p) - TEXT_RISE),
                text.to_owned(),
            )
        });
        let dates =
            (self.dates().into_iter()).map(|(us, text)| ((self.x(us), Self::y(0.0) + 6.0), text));
        levels.into_iter().chain(dates).collect()
    }

    /// Where the name of the feature hangs from.
    pub(crate) fn title_at() -> (f32, f32) {
        (HISTORY_X.0.midpoint(HISTORY_X.1), 0.0)
    }

    /// Where the text of a time hangs from, above its line.
    pub(crate) fn note_at(&self, time_us: i64) -> (f32, f32) {
        (self.x(time_us), P_Y.0 - 34.0)
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
    fn dates_are_as_exact_as_the_span_needs() {
        let texts = |span: i64| -> Vec<String> {
            let axis = TimeAxis::around([0, span].into_iter()).expect("times");
            axis.dates().into_iter().map(|(_, text)| text).collect()
        };
        assert_eq!(texts(0), ["1970-01-01 00:00"]);
        assert_eq!(texts(2 * DAY)[1], "1970-01-01 12:00");
        assert_eq!(texts(40 * DAY)[4], "1970-02-10");
        assert_eq!(texts(4_000 * DAY)[4], "1980-12");
        let widest = TimeAxis::around([i64::MIN, i64::MAX].into_iter()).expect("times");
        assert_eq!(widest.dates().len(), 5);
    }
}

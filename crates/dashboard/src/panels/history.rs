//! When was a feature seen, and when is it probably visible?
//!
//! The history of a feature over its own years, its p(t), and where the query stands in it.

use anyhow::Result;
use chronotope::Time;
use chronotope::trace::{CurveSummary, Trace};
use rerun::{LineStrips2D, Points2D, Radius, RecordingStream};

use super::lookup::place;
use super::texts;
use super::time_axis::{Line, Mark, TimeAxis, upright};
use crate::{colours, entities};

/// What is drawn once for a map: axes, history and p(t).
pub(crate) fn log(
    stream: &RecordingStream,
    index: usize,
    curve: &CurveSummary,
    trace: &Trace<'_>,
) -> Result<()> {
    let Some(axis) = axis(curve) else {
        return Ok(());
    };
    stream.log(
        entities::curve_axes(index),
        &LineStrips2D::new(axis.lines())
            .with_colors([colours::rgb(colours::FAINT)])
            .with_radii([Radius::new_ui_points(0.5)]),
    )?;
    let title = format!(
        "feature {} of {}, {}",
        curve.feature,
        place(trace, curve.node.0 as usize),
        (curve.period_s).map_or_else(|| "no rhythm".into(), rhythm)
    );
    let written = (axis.texts().into_iter()).chain([(TimeAxis::title_at(), title)]);
    texts::log(stream, &entities::curve_texts(index), written)?;
    let line = (curve.times_us.iter().zip(&curve.p)).map(|(&us, &p)| (axis.x(us), TimeAxis::y(p)));
    stream.log(
        entities::curve_p(index),
        &LineStrips2D::new([line.collect::<Vec<_>>()])
            .with_colors([colours::series(index)])
            .with_radii([Radius::new_ui_points(1.5)]),
    )?;
    stream.log(entities::curve_seen(index), &visits(&axis, curve))?;
    Ok(())
}

/// When the query was taken, and p then, in each history.
pub(crate) fn log_now(
    stream: &RecordingStream,
    curves: &[CurveSummary],
    trace: &Trace<'_>,
    time: Option<Time>,
) -> Result<()> {
    let Some(time_us) = time.map(Time::as_us) else {
        return Ok(());
    };
    let known = curves.iter().zip(&trace.curve_probabilities);
    for (index, (curve, &p)) in known.enumerate() {
        let Some(axis) = axis(curve) else {
            continue;
        };
        let mark = axis.mark(time_us);
        stream.log(entities::curve_now(index), &lines(&mark))?;
        // The text hangs above, where it hides neither the curve nor a date.
        let (above, note) = axis.note(time_us, p);
        stream.log(
            entities::curve_p_now(index),
            &Points2D::new([above, (mark.x, TimeAxis::y(p))])
                .with_colors([colours::rgb(colours::TEXT)])
                .with_radii([0.0, 5.0].map(Radius::new_ui_points))
                .with_labels([note, String::new()])
                .with_show_labels(true),
        )?;
    }
    Ok(())
}

/// The axis of the history of a feature and its p(t).
fn axis(curve: &CurveSummary) -> Option<TimeAxis> {
    TimeAxis::around(curve.times_us.iter().chain(&curve.visit_times_us).copied())
}

/// The line of the query, and what of the axis leads to it.
fn lines(mark: &Mark) -> LineStrips2D {
    let extension = mark.extension.iter();
    let breaks = mark.breaks.iter();
    let drawn: Vec<(Line, [u8; 3], f32)> = std::iter::once((upright(mark.x), colours::TEXT, 1.0))
        .chain(extension.map(|&line| (line, colours::FAINT, 0.5)))
        .chain(breaks.map(|&line| (line, colours::TEXT, 1.0)))
        .collect();
    LineStrips2D::new(drawn.iter().map(|it| it.0))
        .with_colors(drawn.iter().map(|it| colours::rgb(it.1)))
        .with_radii(drawn.iter().map(|it| Radius::new_ui_points(it.2)))
}

/// A dot for each visit at which the feature could be observed: at 1 if it was seen, else at 0.
fn visits(axis: &TimeAxis, curve: &CurveSummary) -> Points2D {
    let observed: Vec<(i64, bool)> = (curve.visit_times_us.iter().zip(&curve.seen))
        .filter_map(|(&us, &seen)| Some((us, seen?)))
        .collect();
    let at =
        (observed.iter()).map(|&(us, seen)| (axis.x(us), TimeAxis::y(f64::from(u8::from(seen)))));
    let colour = |seen| {
        if seen {
            colours::MATCHED
        } else {
            colours::MISSING
        }
    };
    Points2D::new(at)
        .with_colors(observed.iter().map(|&(_, seen)| colours::rgb(colour(seen))))
        .with_radii([Radius::new_ui_points(4.0)])
        .with_labels(observed.iter().map(|&(us, seen)| {
            let seen = if seen { "seen" } else { "not seen" };
            format!("{seen} {}", Time::from_us(us))
        }))
        .with_show_labels(false)
}

/// A rhythm's period for people.
fn rhythm(period_s: f64) -> String {
    let units = [(31_556_952.0, "year"), (86_400.0, "day"), (3_600.0, "hour")];
    let (unit_s, name) = (units.into_iter())
        .find(|(unit_s, _)| period_s >= 0.99 * unit_s)
        .unwrap_or((60.0, "minute"));
    match format!("{:.2}", period_s / unit_s).as_str() {
        "1.00" => format!("rhythm of a {name}").replace("a hour", "an hour"),
        count => {
            let count = count.trim_end_matches('0').trim_end_matches('.');
            format!("rhythm of {count} {name}s")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_are_said_in_the_largest_unit_that_they_fill() {
        assert_eq!(rhythm(86_400.0), "rhythm of a day");
        assert_eq!(rhythm(3_600.0), "rhythm of an hour");
        assert_eq!(rhythm(43_200.0), "rhythm of 12 hours");
        assert_eq!(rhythm(1.5 * 31_556_952.0), "rhythm of 1.5 years");
        assert_eq!(rhythm(90.0), "rhythm of 1.5 minutes");
    }
}

//! Which places are probable now?
//!
//! Bars with the names of places, drawn as lines of a plane: the viewer's own bars have numbers
//! only. Those show all places beside them.

use anyhow::Result;
use chronotope::trace::Trace;
use rerun::{BarChart, Color, LineStrips2D, Radius, RecordingStream};

use super::lookup::{OFF_MAP, place};
use super::over_time::MAX_FOLLOWED;
use super::texts;
use crate::{colours, entities};

/// Width and height of the canvas.
pub(crate) const CANVAS: (f32, f32) = (1000.0, 380.0);
/// Left and right end of bars: 0 and 100 percent.
const BARS_X: (f32, f32) = (350.0, 960.0);
/// Texts hang below their points: those beside a bar have points above it by half a text.
const TEXT_RISE: f32 = 24.0;
/// Smaller shares have no bar.
const MIN_SHOWN: f64 = 0.005;
/// Bars with names, beside that of being off the map.
const NUM_BARS: usize = MAX_FOLLOWED;

/// The posterior: with names of the best places, by number of all.
pub(crate) fn log(stream: &RecordingStream, trace: &Trace<'_>, posterior: &[f64]) -> Result<()> {
    let off_map = trace.localization.off_map;
    let percent: Vec<f64> = (posterior.iter().chain([&off_map]))
        .map(|share| 100.0 * share)
        .collect();
    stream.log(
        entities::POSTERIOR,
        &BarChart::new(percent).with_color(colours::series(0)),
    )?;
    let rows = rows(trace, posterior);
    let shares: Vec<f64> = rows.iter().map(|row| row.1).collect();
    let drawn = bars(&shares);
    stream.log(
        entities::BARS,
        &LineStrips2D::new(drawn.iter().map(|bar| bar.line))
            .with_colors(rows.iter().map(|row| row.2))
            .with_radii(drawn.iter().map(|bar| Radius::new_scene_units(bar.radius))),
    )?;
    let names = (drawn.iter().zip(&rows)).flat_map(|(bar, (name, share, _))| {
        [
            (bar.name_at, shortened(name)),
            (bar.value_at, format!("{:.1} %", 100.0 * share)),
        ]
    });
    texts::log(stream, entities::BAR_NAMES, names)
}

/// Name, share and colour of each bar.
fn rows<'t>(trace: &'t Trace<'_>, posterior: &[f64]) -> Vec<(&'t str, f64, Color)> {
    // A small map keeps its order, so that a bar stays where it was.
    let is_small = posterior.len() <= MAX_FOLLOWED;
    let mut shown: Vec<usize> = (0..posterior.len()).collect();
    if !is_small {
        shown.sort_by(|&a, &b| posterior[b].total_cmp(&posterior[a]).then(a.cmp(&b)));
        shown.truncate(NUM_BARS);
    }
    let colour = |node: usize| {
        if is_small {
            colours::series(node)
        } else {
            colours::probability(posterior[node])
        }
    };
    let off_map = (
        OFF_MAP,
        trace.localization.off_map,
        colours::series(if is_small { posterior.len() } else { 1 }),
    );
    (shown.into_iter())
        .map(|node| (place(trace, node), posterior[node], colour(node)))
        .chain([off_map])
        .collect()
}

/// The end of a name that would not fit beside a bar: names of places differ in their ends.
fn shortened(name: &str) -> String {
    const MAX: usize = 14;
    let num = name.chars().count();
    if num <= MAX {
        return name.to_owned();
    }
    std::iter::once('\u{2026}')
        .chain(name.chars().skip(num + 1 - MAX))
        .collect()
}

/// One bar with its name.
#[derive(Clone, Debug, PartialEq)]
struct Bar {
    /// From 0 percent to its end.
    line: [(f32, f32); 2],
    /// Half its thickness.
    radius: f32,
    /// The point that its name hangs from.
    name_at: (f32, f32),
    /// The point that its value hangs from.
    value_at: (f32, f32),
}

/// One bar for each share, from the top; shares are cut to [0, 1].
fn bars(shares: &[f64]) -> Vec<Bar> {
    let pitch = (CANVAS.1 / shares.len().max(1) as f32).min(80.0);
    let (left, right) = BARS_X;
    (shares.iter().enumerate())
        .map(|(row, share)| {
            let y = (row as f32 + 0.5) * pitch;
            // The ends of a bar are round: what is next to nothing would be drawn as a dot. A line
            // without length is not drawn.
            let shown = if *share >= MIN_SHOWN {
                share.min(1.0)
            } else {
                0.0
            };
            let end = left + shown as f32 * (right - left);
            Bar {
                line: [(left, y), (end, y)],
                radius: 0.3 * pitch,
                name_at: (120.0, y - TEXT_RISE),
                value_at: (270.0, y - TEXT_RISE),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_stay_on_the_canvas_and_apart() {
        let bars = bars(&[0.001, 0.5, 1.0, 7.0, f64::NAN]);
        let length = |bar: &Bar| bar.line[1].0 - bar.line[0].0;
        assert_eq!(length(&bars[0]), 0.0);
        assert_eq!(length(&bars[4]), 0.0);
        assert_eq!(length(&bars[2]), length(&bars[3]));
        for pair in bars.windows(2) {
            assert!(pair[0].line[0].1 + pair[0].radius < pair[1].line[0].1 - pair[1].radius);
        }
        assert!(
            bars.iter()
                .all(|bar| bar.line[1].0 <= CANVAS.0 && bar.line[1].1 <= CANVAS.1)
        );
    }

    #[test]
    fn long_names_keep_their_ends() {
        assert_eq!(shortened(OFF_MAP), OFF_MAP);
        assert_eq!(shortened("street-of-lamps-07"), "\u{2026}t-of-lamps-07");
    }
}

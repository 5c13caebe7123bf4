//! How does the time of an answer grow with the map?
//!
//! A plain SVG with its own colours for light and dark, both axes logarithmic, one line a stage.

use std::fmt::Write as _;

use super::SpeedReport;
use super::end_to_end::SECTION;

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 130.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 50.0;
const COLOURS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a6d00"];

/// The stages over the number of places.
pub(super) fn growth(report: &SpeedReport) -> String {
    let lines = lines_of(report);
    let points = || lines.iter().flat_map(|(_, points)| points.iter().copied());
    let range = |of: fn((f64, f64)) -> f64| {
        let (low, high) = points()
            .map(of)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            });
        if low.is_finite() {
            (
                low.log10().floor(),
                high.log10().ceil().max(low.log10().floor() + 1.0),
            )
        } else {
            (0.0, 1.0)
        }
    };
    let ((x0, x1), (y0, y1)) = (range(|point| point.0), range(|point| point.1));
    let px = |x: f64| LEFT + (x.log10() - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT);
    let py = |y: f64| HEIGHT - BOTTOM - (y.log10() - y0) / (y1 - y0) * (HEIGHT - TOP - BOTTOM);

    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         aria-label=\"Time of an answer in ms over the number of places, by stage\">\n<style>\
         text{{font:13px sans-serif;fill:#222}}.grid{{stroke:#ccc}}path{{fill:none;stroke-width:2}}\
         .bg{{fill:#fff}}@media(prefers-color-scheme:dark){{text{{fill:#ddd}}.grid{{stroke:#444}}\
         .bg{{fill:#111}}}}</style>\n<rect class=\"bg\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>\n"
    );
    // Writing to a string cannot fail.
    for decade in y0 as i32..=y1 as i32 {
        let value = 10_f64.powi(decade);
        let y = py(value);
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{}\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{value} ms</text>",
            WIDTH - RIGHT,
            LEFT - 8.0,
            y + 4.0
        );
    }
    for decade in x0 as i32..=x1 as i32 {
        let value = 10_f64.powi(decade);
        let x = px(value);
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{x:.1} {TOP}V{}\"/><text x=\"{x:.1}\" y=\"{}\" \
             text-anchor=\"middle\">{value}</text>",
            HEIGHT - BOTTOM,
            HEIGHT - BOTTOM + 20.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">places</text>",
        f64::midpoint(LEFT, WIDTH - RIGHT),
        HEIGHT - 8.0
    );
    for (index, (name, points)) in lines.iter().enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        let mut path = String::new();
        for (i, &(x, y)) in points.iter().enumerate() {
            let step = if i == 0 { 'M' } else { 'L' };
            let _ = write!(path, "{step}{:.1} {:.1}", px(x), py(y));
            let _ = write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{colour}\"><title>{name}, {x} places: \
                 {y:.3} ms</title></circle>",
                px(x),
                py(y)
            );
        }
        let (x, y) = points.last().map_or((LEFT, TOP), |&(x, y)| (px(x), py(y)));
        let _ = writeln!(
            svg,
            "<path stroke=\"{colour}\" d=\"{path}\"/><text x=\"{:.1}\" y=\"{:.1}\">{name}</text>",
            x + 10.0,
            y + 4.0
        );
    }
    svg.push_str("</svg>\n");
    svg
}

/// A name and its points: places, ms.
type Line<'a> = (&'a str, Vec<(f64, f64)>);

/// One line for each stage, in the order of the table.
fn lines_of(report: &SpeedReport) -> Vec<Line<'_>> {
    let mut lines: Vec<Line<'_>> = Vec::new();
    for row in report
        .measurements
        .iter()
        .filter(|row| row.section == SECTION)
    {
        let Some(places) = row
            .case
            .split(' ')
            .next()
            .and_then(|word| word.parse().ok())
        else {
            continue;
        };
        if row.ms_p50 <= 0.0 {
            continue;
        }
        match lines.iter_mut().find(|(name, _)| *name == row.subject) {
            Some((_, points)) => points.push((places, row.ms_p50)),
            None => lines.push((&row.subject, vec![(places, row.ms_p50)])),
        }
    }
    lines
}

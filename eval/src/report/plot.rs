//! How do numbers become lines that a phone, a dark screen and a colour-blind reader can show?
//!
//! SVG is written by hand and not by a plotting crate because colours have to be classes of the
//! page's style sheet: the same picture then follows light and dark mode, and a script can bring
//! one line out. A line differs from its neighbours by colour, dashes *and* marker.

use super::html::{Esc, put};

/// Size of a plot's coordinate system; small, so that its text stays readable on a phone.
const WIDTH: f64 = 480.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 50.0;

/// One measured point with its interval.
pub(super) struct Point {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) low: f64,
    pub(super) high: f64,
    /// Shown on pointing at it.
    pub(super) label: String,
}

/// One line of a plot.
pub(super) struct Series {
    pub(super) name: String,
    /// Index into the colours of the style sheet.
    pub(super) colour: usize,
    /// Which of its method's lines this is: chooses dashes and marker.
    pub(super) style: usize,
    /// Drawn thick: the line the page is about.
    pub(super) is_main: bool,
    /// Shown behind the name in the key.
    pub(super) value: String,
    pub(super) points: Vec<Point>,
}

/// How a horizontal axis is divided.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    Linear,
    Logarithmic,
}

/// A plot of values from 0, most often shares in %.
pub(super) struct SharePlot<'a> {
    pub(super) title: &'a str,
    /// What a reader who cannot see it should know.
    pub(super) description: String,
    pub(super) x_label: &'a str,
    pub(super) x_scale: Scale,
    /// Stands behind the numbers of the vertical axis, such as ` %`.
    pub(super) y_unit: &'a str,
    /// A line to compare the others with.
    pub(super) guide: Option<[(f64, f64); 2]>,
    /// Positions and texts below the axis, ascending; an empty text is a bare tick.
    pub(super) x_ticks: Vec<(f64, String)>,
    pub(super) series: &'a [Series],
    /// Drawn large with its key beside it.
    pub(super) is_lead: bool,
    /// What the values in the key are.
    pub(super) key_title: String,
    /// Makes ids unique on the page.
    pub(super) id: String,
}

/// The largest value of an axis and its step, such that at most six steps reach `max`.
pub(super) fn nice_axis(max: f64) -> (f64, f64) {
    let max = if max > 0.0 { max } else { 1.0 };
    let steps = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];
    for step in steps {
        let count = (max / step).ceil();
        if count <= 6.0 {
            return (count * step, step);
        }
    }
    (max, max / 5.0)
}

/// An SVG marker of shape `style` around a point, as an element of class `class`.
pub(super) fn marker(html: &mut String, style: usize, class: &str, x: f64, y: f64, title: &str) {
    let r = 4.0;
    let title = if title.is_empty() {
        String::new()
    } else {
        format!("<title>{}</title>", Esc(title))
    };
    let polygon = |points: &[(f64, f64)]| {
        let points: Vec<String> = points
            .iter()
            .map(|(dx, dy)| format!("{:.1},{:.1}", x + dx * r, y + dy * r))
            .collect();
        format!(
            "<polygon class=\"{class}\" points=\"{}\">{title}</polygon>",
            points.join(" ")
        )
    };
    let shape = match style % 5 {
        0 => format!(
            "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\">{title}</circle>"
        ),
        1 => polygon(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)]),
        2 => polygon(&[(0.0, -1.2), (1.15, 0.9), (-1.15, 0.9)]),
        3 => polygon(&[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)]),
        _ => polygon(&[(0.0, 1.2), (1.15, -0.9), (-1.15, -0.9)]),
    };
    html.push_str(&shape);
}

impl SharePlot<'_> {
    /// The plot as a `figure` with its key; empty without points.
    pub(super) fn render(&self) -> String {
        let mut html = String::new();
        let points = || self.series.iter().flat_map(|series| &series.points);
        if points().next().is_none() {
            return html;
        }
        let lead = if self.is_lead { " lead" } else { "" };
        put!(
            html,
            "<figure class=\"plot{lead}\"><h3>{}</h3><div>",
            Esc(self.title)
        );
        self.drawing(&mut html);
        put!(
            html,
            "</div><ul class=\"keys\"><li class=\"at\">{}</li>",
            Esc(&self.key_title)
        );
        for (index, series) in self.series.iter().enumerate() {
            key(&mut html, index, series);
        }
        html.push_str("</ul></figure>\n");
        html
    }

    fn drawing(&self, html: &mut String) {
        let height = if self.is_lead { 360.0 } else { 300.0 };
        let bottom = height - BOTTOM;
        let points = || self.series.iter().flat_map(|series| &series.points);
        let scaled = |x: f64| match self.x_scale {
            Scale::Linear => x,
            Scale::Logarithmic => log10(x),
        };
        let all_x = || {
            let ticks = self.x_ticks.iter().map(|(x, _)| *x);
            points().map(|point| point.x).chain(ticks).map(scaled)
        };
        let first = all_x().fold(f64::INFINITY, f64::min);
        let last = all_x().fold(f64::NEG_INFINITY, f64::max);
        let span = if last > first { last - first } else { 1.0 };
        // A little air on both sides, so that markers are not cut.
        let px = |x: f64| LEFT + 8.0 + (scaled(x) - first) / span * (WIDTH - LEFT - RIGHT - 16.0);
        let (top_value, step) = nice_axis(points().map(|point| point.y).fold(0.0, f64::max));
        let py = |y: f64| bottom - y / top_value * (bottom - TOP);

        put!(
            html,
            "<svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{}\">\
             <clipPath id=\"{}\"><rect x=\"{LEFT}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath>",
            Esc(&self.description),
            self.id,
            TOP - 6.0,
            WIDTH - LEFT - RIGHT,
            bottom - TOP + 12.0
        );
        let num_steps = (top_value / step).round() as u32;
        for i in 0..=num_steps {
            let value = f64::from(i) * step;
            let y = py(value);
            put!(
                html,
                "<path class=\"axis\" d=\"M{LEFT} {y:.1}H{}\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{value}{unit}</text>",
                WIDTH - RIGHT,
                LEFT - 7.0,
                y + 4.5,
                unit = self.y_unit
            );
        }
        for (x, text) in &self.x_ticks {
            let x = px(*x);
            put!(
                html,
                "<path class=\"tick\" d=\"M{x:.1} {bottom}v5\"/>\
                 <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                bottom + 20.0,
                Esc(text)
            );
        }
        put!(
            html,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text><g clip-path=\"url(#{})\">",
            f64::midpoint(LEFT, WIDTH - RIGHT),
            height - 8.0,
            Esc(self.x_label),
            self.id
        );
        if let Some(guide) = self.guide {
            let line = guide.into_iter().map(|(x, y)| (px(x), py(y)));
            put!(html, "<path class=\"guide\" d=\"{}\"/>", path(line));
        }
        let (main, others): (Vec<_>, Vec<_>) =
            self.series.iter().enumerate().partition(|(_, s)| s.is_main);
        for (index, series) in others.into_iter().chain(main) {
            let class = if series.is_main { " main" } else { "" };
            put!(
                html,
                "<g class=\"series c{}{class}\" data-series=\"{index}\">",
                series.colour
            );
            let upper = series.points.iter().map(|p| (px(p.x), py(p.high)));
            let lower = series.points.iter().rev().map(|p| (px(p.x), py(p.low)));
            put!(
                html,
                "<path class=\"band\" d=\"{}Z\"/>",
                path(upper.chain(lower))
            );
            let line = series.points.iter().map(|p| (px(p.x), py(p.y)));
            put!(
                html,
                "<path class=\"curve d{}\" d=\"{}\"/>",
                series.style % 4,
                path(line)
            );
            for point in &series.points {
                let title = format!("{}, {}", series.name, point.label);
                marker(html, series.style, "dot", px(point.x), py(point.y), &title);
            }
            html.push_str("</g>");
        }
        html.push_str("</g></svg>");
    }
}

/// A button with a sample of the line, its name and value.
fn key(html: &mut String, index: usize, series: &Series) {
    let class = if series.is_main { " main-key" } else { "" };
    put!(
        html,
        "<li><button type=\"button\" class=\"key c{}{class}\" data-series=\"{index}\" \
             aria-pressed=\"true\"><svg viewBox=\"0 0 40 16\" aria-hidden=\"true\"{}>\
             <path class=\"curve d{}\" d=\"M1 8H39\"/>",
        series.colour,
        if series.is_main {
            " class=\"main\""
        } else {
            ""
        },
        series.style % 4,
    );
    marker(html, series.style, "dot", 20.0, 8.0, "");
    put!(
        html,
        "</svg><span>{}</span><span class=\"value\">{}</span></button></li>",
        Esc(&series.name),
        Esc(&series.value)
    );
}

fn log10(x: f64) -> f64 {
    x.max(f64::MIN_POSITIVE).log10()
}

/// The `d` of a polyline.
pub(super) fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    let mut d = String::new();
    for (i, (x, y)) in points.enumerate() {
        put!(d, "{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' });
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_end_on_a_step_and_have_at_most_six() {
        for max in [0.0, 0.3, 1.7, 3.0, 24.0, 47.5, 61.0, 100.0, 216.2, 2_900.0] {
            let (top, step) = nice_axis(max);
            assert!(
                top >= max && top / step <= 6.0 && (top / step).fract() == 0.0,
                "{max}"
            );
        }
        assert_eq!(nice_axis(47.5), (50.0, 10.0));
        assert_eq!(nice_axis(100.0), (100.0, 20.0));
        assert_eq!(nice_axis(216.2), (250.0, 50.0));
    }

    #[test]
    fn paths_move_and_then_draw() {
        assert_eq!(
            path([(1.0, 2.0), (3.5, 4.0)].into_iter()),
            "M1.0 2.0L3.5 4.0"
        );
    }
}

//! When is a feature visible, as p(t) over its observations?

use super::axis::{probability_lines, time_ticks};
use super::content::{ProbabilityCurve, TimeAxis};
use super::html::{Esc, put};
use super::plot::path;
use super::spectrum::spectrum;

/// Above this many visits, observations are ticks and not dots.
const MAX_DOTS: usize = 80;

const WIDTH: f64 = 480.0;

const HEIGHT: f64 = 190.0;

const LEFT: f64 = 46.0;

const RIGHT: f64 = 14.0;

const TOP: f64 = 26.0;

const BOTTOM: f64 = 150.0;

/// p(t) of a few features over their observations.
pub(super) fn curves(curves: &[ProbabilityCurve]) -> String {
    let mut html = String::new();
    if curves.is_empty() {
        return html;
    }
    html.push_str(
        "<h2>When is a feature visible?</h2><p class=\"hint\">Marks are visits of the place: filled at \
         the top where the feature was seen, hollow at the bottom where it was not, grey in the \
         middle where it could not be observed. The line is the learnt probability p(t), the dashed \
         line the time of a query. Below are the rhythms of these marks; where the grey is high, visits came \
         in step with that rhythm and cannot be distinguished from none.</p><div class=\"grid\">",
    );
    for curve in curves {
        one_curve(&mut html, curve);
    }
    html.push_str("</div>\n");
    html
}

/// Where times and probabilities lie in a curve's picture.
struct Frame {
    first: f64,
    last: f64,
}

impl Frame {
    /// Around everything that the curve shows; `None` where that is nothing.
    fn of(curve: &ProbabilityCurve) -> Option<Self> {
        let times = || {
            let observed = curve
                .observations
                .iter()
                .map(|observation| observation.time);
            let drawn = curve.curve.iter().map(|(time, _)| *time);
            observed.chain(drawn).chain(curve.query_time)
        };
        let first = times().fold(f64::INFINITY, f64::min);
        let last = times().fold(f64::NEG_INFINITY, f64::max);
        (first.is_finite() && last.is_finite()).then_some(Self { first, last })
    }

    fn x(&self, time: f64) -> f64 {
        let span = (self.last - self.first).max(f64::MIN_POSITIVE);
        LEFT + 8.0 + (time - self.first) / span * (WIDTH - LEFT - RIGHT - 16.0)
    }

    fn y(p: f64) -> f64 {
        BOTTOM - p.clamp(0.0, 1.0) * (BOTTOM - TOP)
    }

    fn axes(&self, html: &mut String, axis: TimeAxis) {
        probability_lines(html, (LEFT, WIDTH - RIGHT), 7.0, Self::y);
        for (time, text) in time_ticks(axis, self.first, self.last) {
            put!(
                html,
                "<path class=\"tick\" d=\"M{x:.1} {BOTTOM}v5\"/><text x=\"{x:.1}\" y=\"{}\" \
                 text-anchor=\"middle\">{}</text>",
                BOTTOM + 23.0,
                Esc(text),
                x = self.x(time)
            );
        }
    }

    fn query(&self, html: &mut String, curve: &ProbabilityCurve, time: f64) {
        let x = self.x(time);
        put!(
            html,
            "<path class=\"now\" d=\"M{x:.1} {}V{BOTTOM}\"/>",
            TOP - 8.0
        );
        let Some(p) = at(&curve.curve, time) else {
            return;
        };
        let (anchor, dx) = if x > WIDTH / 2.0 {
            ("end", -9.0)
        } else {
            ("start", 9.0)
        };
        put!(
            html,
            "<circle class=\"nowdot\" cx=\"{x:.1}\" cy=\"{:.1}\" r=\"4.5\"/>\
             <text class=\"strong\" x=\"{:.1}\" y=\"{}\" text-anchor=\"{anchor}\">\
             query: p = {p:.2}</text>",
            Self::y(p),
            x + dx,
            TOP - 10.0
        );
    }
}

fn one_curve(html: &mut String, curve: &ProbabilityCurve) {
    let Some(frame) = Frame::of(curve) else {
        return;
    };
    let count = |seen| {
        let seen = curve.observations.iter().filter(|o| o.seen == Some(seen));
        seen.count()
    };
    let (num_seen, num_observed) = (count(true), count(true) + count(false));
    put!(
        html,
        "<figure><h3>{0}</h3><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}: \
         seen in {num_seen} of {num_observed} visits\">",
        Esc(&curve.title)
    );
    frame.axes(html, curve.axis);
    let line = curve
        .curve
        .iter()
        .map(|&(time, p)| (frame.x(time), Frame::y(p)));
    put!(html, "<path class=\"pt\" d=\"{}\"/>", path(line));
    let many = curve.observations.len() > MAX_DOTS;
    for observation in &curve.observations {
        let x = frame.x(observation.time);
        let (class, y) = match observation.seen {
            Some(true) => ("obs", Frame::y(1.0)),
            Some(false) => ("obs no", Frame::y(0.0)),
            None => ("obs hidden", Frame::y(0.5)),
        };
        if many {
            put!(
                html,
                "<path class=\"{class}\" d=\"M{x:.1} {:.1}v8\"/>",
                y - 4.0
            );
        } else {
            put!(
                html,
                "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/>"
            );
        }
    }
    if let Some(time) = curve.query_time {
        frame.query(html, curve, time);
    }
    let zone = match curve.axis {
        TimeAxis::UnixSeconds => "; times in UTC",
        TimeAxis::VisitIndex => "",
    };
    put!(
        html,
        "</svg><figcaption>Seen in {num_seen} of {num_observed} visits{zone}.</figcaption>"
    );
    spectrum(html, &curve.title, &curve.spectrum);
    html.push_str("</figure>\n");
}

/// The value of a curve at a time, linear between its points; `None` outside.
fn at(curve: &[(f64, f64)], time: f64) -> Option<f64> {
    let above = curve.iter().position(|(t, _)| *t >= time)?;
    let (t1, p1) = curve[above];
    if t1 == time {
        return Some(p1);
    }
    let (t0, p0) = *curve.get(above.checked_sub(1)?)?;
    Some(p0 + (p1 - p0) * (time - t0) / (t1 - t0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_linear_between_its_points() {
        let curve = [(0.0, 0.0), (2.0, 1.0)];
        assert_eq!(at(&curve, 0.0), Some(0.0));
        assert_eq!(at(&curve, 1.0), Some(0.5));
        assert_eq!(at(&curve, -1.0), None);
        assert_eq!(at(&curve, 3.0), None);
    }
}

//! How are images, predictions and mistakes shown?

use chronotope::Result;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use jiff::{Span, Timestamp};

use super::content::{
    FeatureClass, FeaturePicture, GalleryImage, Mistake, ProbabilityCurve, TimeAxis,
};
use super::html::{Esc, Words, data_uri, put};
use super::plot::path;
use super::raster::spectrum;

/// Widest live image that is embedded.
const LIVE_WIDTH: u32 = 1_024;

/// Widest image of the mistakes' gallery.
const GALLERY_WIDTH: u32 = 360;

/// Above this many visits, observations are ticks and not dots.
const MAX_DOTS: usize = 80;

impl FeatureClass {
    const ALL: [Self; 3] = [Self::Matched, Self::Missing, Self::Unexpected];

    fn class(self) -> &'static str {
        match self {
            Self::Matched => "matched",
            Self::Missing => "missing",
            Self::Unexpected => "unexpected",
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Matched => "predicted and found",
            Self::Missing => "predicted, not found",
            Self::Unexpected => "seen, not predicted",
        }
    }
}

/// The outline of a class: ring, cross or small triangle.
fn outline(class: FeatureClass, x: f64, y: f64, r: f64) -> String {
    match class {
        FeatureClass::Matched => format!(
            "M{:.1} {y:.1}a{r:.1} {r:.1} 0 1 0 {d:.1} 0a{r:.1} {r:.1} 0 1 0 -{d:.1} 0",
            x - r,
            d = 2.0 * r
        ),
        FeatureClass::Missing => {
            let r = 0.8 * r;
            let d = 2.0 * r;
            format!(
                "M{:.1} {:.1}l{d:.1} {d:.1}M{:.1} {:.1}l-{d:.1} {d:.1}",
                x - r,
                y - r,
                x + r,
                y - r
            )
        }
        FeatureClass::Unexpected => {
            let r = 0.55 * r;
            format!(
                "M{x:.1} {:.1}l{:.1} {:.1}h-{:.1}z",
                y - r,
                0.95 * r,
                1.7 * r,
                1.9 * r
            )
        }
    }
}

/// Live images with their predicted features.
pub(super) fn features(pictures: &[FeaturePicture]) -> Result<String> {
    let mut html = String::new();
    if pictures.is_empty() {
        return Ok(html);
    }
    html.push_str(
        "<h2>What did it expect to see?</h2><p class=\"hint\">The live image with the features that \
         the map predicted for this place at this time. Point at a mark to see how probable it was; \
         press a name below to hide its marks.</p>",
    );
    for picture in pictures {
        let (width, height) = (picture.image.width(), picture.image.height());
        let count = |class| picture.features.iter().filter(|f| f.class == class).count();
        let counts: Vec<String> = FeatureClass::ALL
            .iter()
            .map(|&class| format!("{} {}", count(class), class.words()))
            .collect();
        let note = match picture.note.as_str() {
            "" => String::new(),
            note => format!("<p class=\"hint\">{}</p>", Esc(note)),
        };
        put!(
            html,
            "<figure class=\"picture\"><h3>{}</h3>{note}<svg class=\"scene\" viewBox=\"0 0 {width} {height}\" \
             role=\"img\" aria-label=\"{}: {}\"><image width=\"{width}\" height=\"{height}\" \
             href=\"{}\"/>",
            Esc(&picture.title),
            Esc(&picture.title),
            counts.join(", "),
            data_uri(&picture.image, LIVE_WIDTH)?
        );
        // Marks grow with the image, so that they look alike in every report.
        let unit = width as f64 / 100.0;
        // What was predicted lies on top.
        for class in FeatureClass::ALL.into_iter().rev() {
            put!(html, "<g class=\"k-{}\">", class.class());
            for feature in picture.features.iter().filter(|f| f.class == class) {
                // The centre of the upper-left pixel is (0, 0), in SVG it is (0.5, 0.5).
                let (x, y) = (f64::from(feature.x) + 0.5, f64::from(feature.y) + 0.5);
                let r = match class {
                    // There are many of them, and they are not the point.
                    FeatureClass::Unexpected => unit,
                    _ => (f64::from(feature.size) / 2.0).clamp(1.1 * unit, 1.9 * unit),
                };
                let d = outline(class, x, y, r);
                let title = match class {
                    FeatureClass::Unexpected => class.words().to_owned(),
                    _ => format!("{}, p = {:.2}", class.words(), feature.probability),
                };
                put!(
                    html,
                    "<g><title>{title}</title><path class=\"f halo\" d=\"{d}\"/>\
                     <path class=\"f f-{}\" d=\"{d}\"/></g>",
                    class.class()
                );
            }
            html.push_str("</g>");
        }
        html.push_str("</svg><ul class=\"keys\">");
        for class in FeatureClass::ALL {
            let d = outline(class, 20.0, 8.0, 6.0);
            put!(
                html,
                "<li><button type=\"button\" class=\"key\" data-hides=\"{0}\" aria-pressed=\"true\">\
                 <svg viewBox=\"0 0 40 16\" aria-hidden=\"true\"><path class=\"f halo\" d=\"{d}\"/>\
                 <path class=\"f f-{0}\" d=\"{d}\"/></svg><span>{1}</span>\
                 <span class=\"value\">{2}</span></button></li>",
                class.class(),
                class.words(),
                count(class)
            );
        }
        html.push_str("</ul></figure>\n");
    }
    Ok(html)
}

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
         in step with that rhythm and cannot tell it from none.</p><div class=\"grid\">",
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
        for (p, text) in [(0.0, "0"), (0.5, "0.5"), (1.0, "1")] {
            put!(
                html,
                "<path class=\"axis\" d=\"M{LEFT} {y:.1}H{}\"/><text x=\"{}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{text}</text>",
                WIDTH - RIGHT,
                LEFT - 7.0,
                Self::y(p) + 4.5,
                y = Self::y(p)
            );
        }
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

/// Wrong answers next to the right ones.
pub(super) fn mistakes(mistakes: &[Mistake]) -> Result<String> {
    let mut html = String::new();
    if mistakes.is_empty() {
        return Ok(html);
    }
    html.push_str(
        "<h2>Where does it fail?</h2><p class=\"hint\">The worst mistakes: the image that was asked, \
         an image of the true place and one of the place that was answered.</p>",
    );
    for mistake in mistakes {
        put!(
            html,
            "<article class=\"mistake\"><h3>{}</h3><div class=\"trio\">",
            Esc(&mistake.title)
        );
        gallery(&mut html, "Asked", "", &mistake.query)?;
        gallery(&mut html, "\u{2713} True place", "ok", &mistake.truth)?;
        gallery(&mut html, "\u{2717} Answered", "no", &mistake.answered)?;
        html.push_str("</div></article>\n");
    }
    Ok(html)
}

fn gallery(html: &mut String, role: &str, class: &str, image: &GalleryImage) -> Result<()> {
    put!(html, "<figure><span class=\"role {class}\">{role}</span>");
    match &image.image {
        Some(pixels) => put!(
            html,
            "<img alt=\"{role}: {}\" loading=\"lazy\" width=\"{}\" height=\"{}\" src=\"{}\">",
            Esc(&image.caption),
            pixels.width(),
            pixels.height(),
            data_uri(pixels, GALLERY_WIDTH)?
        ),
        None => html.push_str("<div class=\"none\">no image to show</div>"),
    }
    put!(
        html,
        "<figcaption>{}</figcaption></figure>",
        Words(&image.caption)
    );
    Ok(())
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
    fn a_curve_is_linear_between_its_points() {
        let curve = [(0.0, 0.0), (2.0, 1.0)];
        assert_eq!(at(&curve, 0.0), Some(0.0));
        assert_eq!(at(&curve, 1.0), Some(0.5));
        assert_eq!(at(&curve, -1.0), None);
        assert_eq!(at(&curve, 3.0), None);
    }
}

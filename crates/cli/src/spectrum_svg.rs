//! What does a series look like, with what was learnt of it?
//!
//! One SVG of two pictures: p(t) over the latest two weeks of data, and the spectrum of the state
//! with that of its sampling below, upside down. Where the sampling has a strong line of its own,
//! the state's lines borrow from each other.

use std::fmt::Write as _;

use fremen::file::OutputKind;
use fremen::spectrum::Periodogram;
use fremen::visibility::Estimate;
use fremen::{Period, Time};

const WIDTH: f64 = 960.0;
const LEFT: f64 = 48.0;
const RIGHT: f64 = 944.0;
/// Points of a curve: one in 25 minutes of two weeks.
const NUM_POINTS: i64 = 800;
/// What a picture can show.
const MAX_WEEKS: i64 = 2;

/// A file with such a picture.
pub(super) const SVG: OutputKind = OutputKind {
    noun: "a picture that this command has drawn",
    begins: b"<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 960 560\" \
              font-family=\"sans-serif\" font-size=\"13\" role=\"img\">\n<title>",
};

/// What is drawn.
pub(super) struct Picture<'a> {
    pub(super) title: String,
    /// Ascending in time.
    pub(super) states: &'a [(Time, bool)],
    /// As [`times`] gives them.
    pub(super) times: &'a [Time],
    /// Names of models with p and its interval at these times.
    pub(super) curves: Vec<(&'static str, &'a [Estimate])>,
    pub(super) periodogram: &'a Periodogram,
}

/// The times at which curves are drawn, from the first to the last one; none without states.
pub(super) fn times(states: &[(Time, bool)]) -> Vec<Time> {
    let (Some(first), Some(last)) = (states.first(), states.last()) else {
        return Vec::new();
    };
    let (first, last) = (first.0.as_us(), last.0.as_us());
    let from = first.max(last.saturating_sub(MAX_WEEKS * Period::WEEK.as_us()));
    let span = i128::from(last) - i128::from(from);
    (0..=NUM_POINTS)
        .map(|i| Time::from_us(from + (span * i128::from(i) / i128::from(NUM_POINTS)) as i64))
        .collect()
}

impl Picture<'_> {
    /// The whole file.
    pub(super) fn svg(&self) -> String {
        let mut svg = String::new();
        // Writing to a string cannot fail.
        let _ = write!(
            svg,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} 560\" \
             font-family=\"sans-serif\" font-size=\"13\" role=\"img\">\n<title>{0}</title>\n\
             <rect width=\"{WIDTH}\" height=\"560\" fill=\"#fff\"/>\n\
             <text x=\"{LEFT}\" y=\"24\" font-size=\"16\" font-weight=\"bold\">{0}</text>\n",
            escaped(&self.title)
        );
        self.draw_curves(&mut svg);
        self.draw_spectrum(&mut svg);
        svg.push_str("</svg>\n");
        svg
    }

    fn draw_curves(&self, svg: &mut String) {
        const TOP: f64 = 60.0;
        const BOTTOM: f64 = 240.0;
        let (Some(&first), Some(&last)) = (self.times.first(), self.times.last()) else {
            return;
        };
        let span_s = last.since_s(first).max(1e-6);
        let px = |time: Time| LEFT + time.since_s(first) / span_s * (RIGHT - LEFT);
        let py = |p: f64| BOTTOM - p * (BOTTOM - TOP);
        let shown = &self.states[self.states.partition_point(|state| state.0 < first)..];
        let mut d = String::new();
        for pair in shown.windows(2).filter(|pair| pair[0].1) {
            let (from, to) = (px(pair[0].0), px(pair[1].0));
            let _ = write!(d, "M{from:.1} {TOP}H{to:.1}V{BOTTOM}H{from:.1}Z");
        }
        let _ = writeln!(
            svg,
            "<path class=\"state\" fill=\"#d8d8d8\" stroke=\"#d8d8d8\" stroke-width=\".3\" d=\"{d}\"/>"
        );
        for (p, text) in [(0.0, "0"), (0.5, "0.5"), (1.0, "1")] {
            axis(svg, py(p), text);
        }
        for (time, anchor) in [(first, "start"), (last, "end")] {
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"{anchor}\">{time}</text>",
                px(time),
                BOTTOM + 20.0
            );
        }
        let mut x = LEFT;
        for (i, (name, values)) in self.curves.iter().enumerate() {
            let (colour, dashes) = [("#0072b2", "none"), ("#d55e00", "6 3")][i % 2];
            let line = |of: fn(&Estimate) -> f64| -> Vec<String> {
                let at = self.times.iter().zip(*values);
                at.map(|(&time, it)| format!("{:.1},{:.1}", px(time), py(of(it))))
                    .collect()
            };
            let points = line(|it| it.p);
            // The interval of the first model, the one to use.
            if i == 0 {
                let mut band = line(|it| it.high);
                band.extend(line(|it| it.low).into_iter().rev());
                let _ = writeln!(
                    svg,
                    "<polygon class=\"interval\" fill=\"{colour}\" fill-opacity=\".15\" \
                     points=\"{}\"/>",
                    band.join(" ")
                );
            }
            let _ = writeln!(
                svg,
                "<polyline class=\"p\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\" \
                 stroke-dasharray=\"{dashes}\" points=\"{}\"/>\n\
                 <text x=\"{x}\" y=\"50\" fill=\"{colour}\">{name}</text>",
                points.join(" ")
            );
            x += 90.0;
        }
        let _ = writeln!(
            svg,
            "<text x=\"{x}\" y=\"50\" fill=\"#555\">p(t), learnt from all samples; shaded: its 95 % interval; grey: the state was 1</text>"
        );
    }

    fn draw_spectrum(&self, svg: &mut String) {
        const MIDDLE: f64 = 440.0;
        const HEIGHT: f64 = 120.0;
        const DEPTH: f64 = 70.0;
        let lines = self.periodogram.lines();
        let highest = self
            .periodogram
            .strongest()
            .map_or(0.0, |line| line.amplitude);
        let periods: Vec<f64> = lines.iter().map(|line| line.period_s.ln()).collect();
        let longest = periods.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shortest = periods.iter().copied().fold(f64::INFINITY, f64::min);
        let width = (longest - shortest).max(1e-9);
        let px =
            |log_period: f64| LEFT + 6.0 + (longest - log_period) / width * (RIGHT - LEFT - 12.0);
        axis(svg, MIDDLE - HEIGHT, &format!("{highest:.2}"));
        axis(svg, MIDDLE, "0");
        axis(svg, MIDDLE + DEPTH, "1");
        let (mut up, mut down) = (String::new(), String::new());
        for (line, &period) in lines.iter().zip(&periods) {
            let x = px(period);
            let _ = write!(
                up,
                "M{x:.1} {MIDDLE}v-{:.1}",
                line.amplitude / highest.max(1e-12) * HEIGHT
            );
            let _ = write!(down, "M{x:.1} {MIDDLE}v{:.1}", line.window * DEPTH);
        }
        for (class, colour, d) in [("amplitude", "#0072b2", up), ("window", "#d55e00", down)] {
            let _ = writeln!(
                svg,
                "<path class=\"{class}\" stroke=\"{colour}\" stroke-width=\"2\" d=\"{d}\"/>"
            );
        }
        for (log_period, anchor) in [(longest, "start"), (shortest, "end")] {
            let period = Period::from_s(log_period.exp());
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"{anchor}\">{}</text>",
                px(log_period),
                MIDDLE + DEPTH + 20.0,
                period.map_or_else(|_| String::new(), |period| period.to_string())
            );
        }
        let _ = writeln!(
            svg,
            "<text x=\"{LEFT}\" y=\"{}\" fill=\"#0072b2\">amplitude of the state, over the period</text>\n\
             <text x=\"{RIGHT}\" y=\"{}\" text-anchor=\"end\" fill=\"#d55e00\">the sampling\u{2019}s own: 0 where \
             samples are spread over the cycle</text>",
            MIDDLE - HEIGHT - 10.0,
            MIDDLE + DEPTH - 8.0
        );
    }
}

fn axis(svg: &mut String, y: f64, text: &str) {
    let _ = writeln!(
        svg,
        "<path stroke=\"#bbb\" stroke-width=\".7\" d=\"M{LEFT} {y:.1}H{RIGHT}\"/>\
         <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>",
        LEFT - 6.0,
        y + 4.5
    );
}

/// Text between tags.
fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;");
    text.replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use fremen::CandidatePeriods;

    #[test]
    fn times_and_titles_far_out_are_drawn_without_nonsense() {
        let candidates = CandidatePeriods::harmonic(Period::DAY, 1).expect("valid");
        let ends = [
            (Time::from_us(i64::MIN), true),
            (Time::from_us(i64::MAX), false),
        ];
        for states in [&ends[..], &ends[..1], &[]] {
            let times = times(states);
            let periodogram = Periodogram::new(states, &candidates).expect("few");
            let at = Estimate {
                p: 0.5,
                low: 0.25,
                high: 0.75,
            };
            let p = vec![at; times.len()];
            let picture = Picture {
                title: "<a> & b".into(),
                states,
                times: &times,
                curves: vec![("natural", &p)],
                periodogram: &periodogram,
            };
            let svg = picture.svg();
            assert!(
                svg.contains("&lt;a&gt; &amp; b") && svg.ends_with("</svg>\n"),
                "{svg}"
            );
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}

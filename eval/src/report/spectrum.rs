//! Which rhythms does a feature have, next to those of its visits?

use chronotope::trace::SpectrumSummary;

use super::axis::frequency_ticks;
use super::html::{Esc, put};
use super::plot::path;

const WIDTH: f64 = 480.0;

const LEFT: f64 = 46.0;

const RIGHT: f64 = 14.0;

const TOP: f64 = 14.0;

const BOTTOM: f64 = 92.0;

/// The amplitudes of a feature's rhythms over the sampling window.
pub(super) fn spectrum(html: &mut String, title: &str, sheet: &SpectrumSummary) {
    let (Some(&first), Some(&last)) = (sheet.frequencies.first(), sheet.frequencies.last()) else {
        return;
    };
    let width = WIDTH - LEFT - RIGHT;
    let x = |f: f64| LEFT + 6.0 + (f - first) / (last - first).max(1e-12) * (width - 12.0);
    let y = |share: f64| BOTTOM - share.clamp(0.0, 1.0) * (BOTTOM - TOP);
    let strongest = (sheet.frequencies.iter().zip(&sheet.amplitudes))
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map_or((0.0, 0.0), |(frequency, amplitude)| {
            (*frequency, *amplitude)
        });
    put!(
        html,
        "<svg viewBox=\"0 0 {WIDTH} 130\" role=\"img\" aria-label=\"Spectrum of {}: strongest at \
         {:.2} cycles per {}, amplitude {:.2}\">",
        Esc(title),
        strongest.0,
        Esc(&sheet.per),
        strongest.1
    );
    for (share, text) in [(0.0, "0"), (1.0, "1")] {
        put!(
            html,
            "<path class=\"axis\" d=\"M{LEFT} {at:.1}H{:.1}\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{text}</text>",
            WIDTH - RIGHT,
            LEFT - 7.0,
            y(share) + 4.5,
            at = y(share)
        );
    }
    let window = (sheet.frequencies.iter().zip(&sheet.window)).map(|(&f, &w)| (x(f), y(w)));
    put!(
        html,
        "<path class=\"window\" d=\"{}L{:.1} {b:.1}L{:.1} {b:.1}Z\"/>",
        path(window),
        x(last),
        x(first),
        b = y(0.0)
    );
    html.push_str("<path class=\"stems\" d=\"");
    for (&f, &amplitude) in sheet.frequencies.iter().zip(&sheet.amplitudes) {
        put!(html, "M{:.1} {:.1}V{:.1}", x(f), y(0.0), y(amplitude));
    }
    html.push_str("\"/>");
    for (f, text) in frequency_ticks(first, last) {
        put!(
            html,
            "<path class=\"tick\" d=\"M{x:.1} {BOTTOM}v5\"/><text x=\"{x:.1}\" y=\"{:.1}\" \
             text-anchor=\"middle\">{text}</text>",
            BOTTOM + 18.0,
            x = x(f)
        );
    }
    put!(
        html,
        "<text x=\"{:.1}\" y=\"126\" text-anchor=\"middle\">cycles per {}; grey: when visits came</text></svg>",
        LEFT + width / 2.0,
        Esc(&sheet.per)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spectrum_names_its_strongest_rhythm() {
        let sheet = SpectrumSummary {
            per: "day".into(),
            frequencies: vec![0.5, 1.0, 1.5],
            amplitudes: vec![0.1, 0.6, 0.2],
            window: vec![0.0, 0.3, 1.0],
        };
        let mut html = String::new();
        spectrum(&mut html, "feature", &sheet);
        assert!(html.contains("strongest at 1.00 cycles per day, amplitude 0.60"));
        let mut none = String::new();
        spectrum(&mut none, "feature", &SpectrumSummary::default());
        assert!(none.is_empty());
    }
}

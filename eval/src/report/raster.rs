//! How do a place's features and the rhythms of one of them look as a whole?

use super::content::Raster;
use super::html::{Esc, put};
use super::pictures::time_ticks;
use super::plot::path;
use chronotope::localize::trace::SpectrumSheet;

const WIDTH: f64 = 960.0;
const LEFT: f64 = 16.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 6.0;
/// Height of a row.
const ROW: f64 = 9.0;
/// Steps of shade.
const NUM_SHADES: usize = 8;

/// Features x visits: shade is p(t), a dot is "seen".
pub(super) fn section(raster: Option<&Raster>) -> String {
    let mut html = String::new();
    let Some(raster) = raster.filter(|raster| !raster.rows.is_empty()) else {
        return html;
    };
    let num_visits = raster.times.len();
    let step = (WIDTH - LEFT - RIGHT) / num_visits.max(1) as f64;
    let bottom = TOP + ROW * raster.rows.len() as f64;
    put!(
        html,
        "<h3 style=\"margin-top:26px\">{} of {} features of {}, visit by visit</h3><p class=\"hint\">One row \
         per feature, one column per visit. The darker, the more probable p(t) is; a dot: it was seen \
         there. Shade without dots and dots without shade are what the model got wrong; nothing is drawn \
         before a feature was born.</p><div class=\"scroll raster\" tabindex=\"0\" role=\"region\" \
         aria-label=\"Features and visits\"><svg viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" \
         aria-label=\"{} features of {} over {num_visits} visits: {}\">",
        raster.rows.len(),
        raster.num_features,
        Esc(&raster.place),
        bottom + 30.0,
        raster.rows.len(),
        Esc(&raster.place),
        agreement(raster)
    );
    let mut shades = vec![String::new(); NUM_SHADES];
    let mut dots = String::new();
    for (at, row) in raster.rows.iter().enumerate() {
        let y = TOP + (at as f64 + 0.5) * ROW;
        let shade = |visit: usize| {
            row.seen[visit]?;
            Some(((row.p[visit].clamp(0.0, 1.0) * NUM_SHADES as f64) as usize).min(NUM_SHADES - 1))
        };
        let mut visit = 0;
        while visit < num_visits {
            let from = visit;
            let level = shade(from);
            while visit < num_visits && shade(visit) == level {
                visit += 1;
            }
            if let Some(level) = level {
                let (x, width) = (LEFT + from as f64 * step, (visit - from) as f64 * step);
                put!(shades[level], "M{x:.1} {y:.1}h{width:.1}");
            }
        }
        for (visit, _) in (row.seen.iter().enumerate()).filter(|(_, seen)| **seen == Some(true)) {
            put!(dots, "M{:.1} {y:.1}h0", LEFT + (visit as f64 + 0.5) * step);
        }
    }
    for (level, d) in shades.iter().enumerate().filter(|(_, d)| !d.is_empty()) {
        let opacity = (level as f64 + 0.5) / NUM_SHADES as f64;
        put!(
            html,
            "<path class=\"shade\" stroke-opacity=\"{opacity:.2}\" d=\"{d}\"/>"
        );
    }
    put!(html, "<path class=\"seen\" d=\"{dots}\"/>");
    columns(&mut html, raster, step, bottom);
    html.push_str("</svg></div>\n");
    html
}

/// Dates below the columns of the visits that are nearest to them.
fn columns(html: &mut String, raster: &Raster, step: f64, bottom: f64) {
    let (Some(&first), Some(&last)) = (raster.times.first(), raster.times.last()) else {
        return;
    };
    let mut free_from = f64::NEG_INFINITY;
    for (time, text) in time_ticks(raster.axis, first, last) {
        let visit = raster.times.partition_point(|&visit| visit < time);
        let x = LEFT + (visit as f64 + 0.5) * step;
        // Visits are columns of one width, so that dates may fall close together.
        if visit < raster.times.len() && x >= free_from && x + 30.0 < WIDTH {
            put!(
                html,
                "<path class=\"tick\" d=\"M{x:.1} {bottom:.1}v5\"/><text x=\"{x:.1}\" y=\"{:.1}\" \
                 text-anchor=\"middle\">{}</text>",
                bottom + 20.0,
                Esc(text)
            );
            free_from = x + 90.0;
        }
    }
}

/// How often p >= 0.5 was right, in words.
fn agreement(raster: &Raster) -> String {
    let cells = (raster.rows.iter())
        .flat_map(|row| row.seen.iter().zip(&row.p))
        .filter_map(|(seen, &p)| Some(((*seen)?, p >= 0.5)));
    let (num, agree) = cells.fold((0_usize, 0_usize), |(num, agree), (seen, likely)| {
        (num + 1, agree + usize::from(seen == likely))
    });
    format!("p of at least one half agrees with what was seen in {agree} of {num} cells")
}

const SPECTRUM_WIDTH: f64 = 480.0;
const SPECTRUM_LEFT: f64 = 46.0;
const SPECTRUM_RIGHT: f64 = 14.0;
const SPECTRUM_TOP: f64 = 14.0;
const SPECTRUM_BOTTOM: f64 = 92.0;

/// The amplitudes of a feature's rhythms over the sampling window.
pub(super) fn spectrum(html: &mut String, title: &str, sheet: &SpectrumSheet) {
    let (Some(&first), Some(&last)) = (sheet.frequencies.first(), sheet.frequencies.last()) else {
        return;
    };
    let width = SPECTRUM_WIDTH - SPECTRUM_LEFT - SPECTRUM_RIGHT;
    let x = |f: f64| SPECTRUM_LEFT + 6.0 + (f - first) / (last - first).max(1e-12) * (width - 12.0);
    let y = |share: f64| SPECTRUM_BOTTOM - share.clamp(0.0, 1.0) * (SPECTRUM_BOTTOM - SPECTRUM_TOP);
    let strongest = (sheet.frequencies.iter().zip(&sheet.amplitudes))
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map_or((0.0, 0.0), |(frequency, amplitude)| {
            (*frequency, *amplitude)
        });
    put!(
        html,
        "<svg viewBox=\"0 0 {SPECTRUM_WIDTH} 130\" role=\"img\" aria-label=\"Spectrum of {}: strongest at \
         {:.2} cycles per {}, amplitude {:.2}\">",
        Esc(title),
        strongest.0,
        Esc(&sheet.per),
        strongest.1
    );
    for (share, text) in [(0.0, "0"), (1.0, "1")] {
        put!(
            html,
            "<path class=\"axis\" d=\"M{SPECTRUM_LEFT} {at:.1}H{:.1}\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{text}</text>",
            SPECTRUM_WIDTH - SPECTRUM_RIGHT,
            SPECTRUM_LEFT - 7.0,
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
            "<path class=\"tick\" d=\"M{x:.1} {SPECTRUM_BOTTOM}v5\"/><text x=\"{x:.1}\" y=\"{:.1}\" \
             text-anchor=\"middle\">{text}</text>",
            SPECTRUM_BOTTOM + 18.0,
            x = x(f)
        );
    }
    put!(
        html,
        "<text x=\"{:.1}\" y=\"126\" text-anchor=\"middle\">cycles per {}; grey: when visits came</text></svg>",
        SPECTRUM_LEFT + width / 2.0,
        Esc(&sheet.per)
    );
}

/// At most seven round frequencies between two.
fn frequency_ticks(first: f64, last: f64) -> Vec<(f64, String)> {
    const STEPS: [f64; 3] = [1.0, 2.0, 5.0];
    let span = last - first;
    if !span.is_finite() || span <= 0.0 {
        return vec![(first, format!("{first:.1}"))];
    }
    let decade = span.log10().floor() as i32 - 1;
    let steps = (decade..=decade + 1).flat_map(|power| STEPS.map(|step| (step, power)));
    let (step, power) = (steps.into_iter())
        .find(|&(step, power)| span / (step * 10_f64.powi(power)) <= 6.0)
        .unwrap_or((1.0, decade + 2));
    let step = step * 10_f64.powi(power);
    let decimals = (-power).max(0) as usize;
    ((first / step).ceil() as i64..=(last / step).floor() as i64)
        .map(|i| (i as f64 * step, format!("{:.decimals$}", i as f64 * step)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::content::{RasterRow, TimeAxis};

    fn sample() -> Raster {
        Raster {
            place: "a<b".into(),
            num_features: 7,
            axis: TimeAxis::VisitIndex,
            times: vec![0.0, 1.0, 2.0, 3.0],
            rows: vec![RasterRow {
                feature: 3,
                seen: vec![None, Some(true), Some(false), Some(true)],
                p: vec![0.9, 0.9, 0.9, 0.1],
            }],
        }
    }

    #[test]
    fn shades_run_together_and_only_what_was_seen_has_a_dot() {
        let html = section(Some(&sample()));
        assert_eq!(html.matches("class=\"shade\"").count(), 2, "{html}");
        let dots = html.split("class=\"seen\" d=\"").nth(1).unwrap();
        assert_eq!(dots.split('"').next().unwrap().matches('M').count(), 2);
        assert!(html.contains("in 1 of 3 cells") && html.contains("a&lt;b"));
        assert!(section(None).is_empty());
    }

    #[test]
    fn frequencies_are_marked_at_round_numbers() {
        let texts = |first, last| -> Vec<String> {
            let ticks = frequency_ticks(first, last);
            assert!((2..=7).contains(&ticks.len()), "{ticks:?}");
            assert!(ticks.iter().all(|(f, _)| (first..=last).contains(f)));
            ticks.into_iter().map(|(_, text)| text).collect()
        };
        assert_eq!(texts(0.13, 2.6), ["0.5", "1.0", "1.5", "2.0", "2.5"]);
        assert_eq!(texts(1.0, 12.0), ["2", "4", "6", "8", "10", "12"]);
        for last in [0.01, 0.7, 3.3, 24.0, 99.0, 4_321.0] {
            texts(last / 40.0, last);
        }
        assert_eq!(frequency_ticks(1.0, 1.0).len(), 1);
    }

    #[test]
    fn a_spectrum_names_its_strongest_rhythm() {
        let sheet = SpectrumSheet {
            per: "day".into(),
            frequencies: vec![0.5, 1.0, 1.5],
            amplitudes: vec![0.1, 0.6, 0.2],
            window: vec![0.0, 0.3, 1.0],
        };
        let mut html = String::new();
        spectrum(&mut html, "feature", &sheet);
        assert!(html.contains("strongest at 1.00 cycles per day, amplitude 0.60"));
        let mut none = String::new();
        spectrum(&mut none, "feature", &SpectrumSheet::default());
        assert!(none.is_empty());
    }
}

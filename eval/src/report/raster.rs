//! How do the features of a place look as a whole, visit by visit?

use super::axis::time_ticks;
use super::content::Raster;
use super::html::{Esc, put};

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
}

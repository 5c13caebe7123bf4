//! How often is the answer wrong, over n and over the work done?

use std::collections::BTreeMap;

use super::glossary::words;
use super::names::{colour, interval_text, label};
use crate::report::facts::short_count;
use crate::report::headline::Headline;
use crate::report::plot::{Point, Scale, Series, SharePlot};
use crate::results::{SuiteResults, Variant};

/// Names of n that are written below an axis; the others get a bare tick.
const LABELLED_N: [u32; 8] = [5, 10, 20, 30, 50, 100, 200, 300];

/// What a plot draws along its horizontal axis.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Along {
    N,
    Pairs,
}

/// Error over n, the group of the headline first and large.
pub(in crate::report) fn error_over_n(
    results: &SuiteResults,
    headline: Option<&Headline>,
) -> String {
    let plots = error_plots(results, headline, Along::N);
    if plots.is_empty() {
        return plots;
    }
    format!(
        "<h2>How often is the answer wrong?</h2>\
         <p class=\"hint\">Lower is better. Each line is one way to predict what a place looks like; \
         n is how many features per place it may use (per experience for the experience methods). \
         Shades are 95 % intervals over the images. Point at a name to bring its line out, press it \
         to hide the line.</p>{}{plots}",
        words(results)
    )
}

pub(super) fn error_plots(
    results: &SuiteResults,
    headline: Option<&Headline>,
    along: Along,
) -> String {
    let mut html = String::new();
    let Some(Headline {
        variant: headline,
        n,
        ..
    }) = headline
    else {
        return html;
    };
    let n = *n;
    let mut groups = results.grouped();
    // A stable sort: the headline's group moves to the front.
    groups.sort_by_key(|(preset, score, _)| *preset != headline.preset || *score != headline.score);
    for (index, (preset, score, variants)) in groups.iter().enumerate() {
        let mut series = Vec::new();
        let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
        for variant in variants {
            let style = seen.entry(&variant.method).or_insert(0);
            series.push(one_series(
                results,
                variant,
                *style,
                variant == headline,
                n,
                along,
            ));
            *style += 1;
        }
        // The key reads from top to bottom like the lines at their left ends.
        series.sort_by(|a, b| first_y(b).total_cmp(&first_y(a)));
        let is_lead = along == Along::N && index == 0;
        let title = format!("Preset {preset}, score {score}");
        let best = series
            .iter()
            .map(|series| format!("{}: {}", series.name, series.value))
            .collect::<Vec<_>>()
            .join("; ");
        let plot = SharePlot {
            title: &title,
            description: format!(
                "Wrong answers in per cent over {}; {title}. At n = {n}: {best}.",
                match along {
                    Along::N => "the number of features per place",
                    Along::Pairs => "the number of descriptor pairs compared",
                }
            ),
            x_label: match along {
                Along::N => "n, features per place",
                Along::Pairs => "descriptor pairs compared per image",
            },
            x_scale: Scale::Logarithmic,
            y_unit: " %",
            guide: None,
            x_ticks: ticks(results, &series, along),
            series: &series,
            is_lead,
            key_title: format!("wrong at n = {n}"),
            id: format!(
                "clip-{}-{index}",
                if along == Along::N { "n" } else { "pairs" }
            ),
        };
        html.push_str(&plot.render());
        if is_lead && groups.len() > 1 {
            html.push_str("<div class=\"grid\">");
        }
    }
    match along {
        Along::N if groups.len() > 1 => html.push_str("</div>"),
        Along::Pairs if !html.is_empty() => html = format!("<div class=\"grid\">{html}</div>"),
        _ => {}
    }
    html
}

fn first_y(series: &Series) -> f64 {
    series.points.first().map_or(0.0, |point| point.y)
}

fn one_series(
    results: &SuiteResults,
    variant: &Variant,
    style: usize,
    is_main: bool,
    n: u32,
    along: Along,
) -> Series {
    let mut points: Vec<Point> = results
        .rows
        .iter()
        .filter(|row| row.variant == *variant)
        .filter(|row| along == Along::N || row.pairs_compared > 0.0)
        .map(|row| Point {
            x: match along {
                Along::N => f64::from(row.n),
                Along::Pairs => row.pairs_compared,
            },
            y: row.wrong_percent(),
            low: row.ci_low,
            high: row.ci_high,
            label: format!(
                "n = {}: {:.1} % wrong (95 % interval {}), {} pairs",
                row.n,
                row.wrong_percent(),
                interval_text(row),
                short_count(row.pairs_compared)
            ),
        })
        .collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    Series {
        name: label(variant),
        colour: colour(&variant.method),
        style,
        is_main,
        value: results
            .row(&variant.at(n))
            .map_or_else(String::new, |row| format!("{:.1} %", row.wrong_percent())),
        points,
    }
}

fn ticks(results: &SuiteResults, series: &[Series], along: Along) -> Vec<(f64, String)> {
    match along {
        Along::N => {
            let all = results.all_n();
            let text = |n: u32| {
                if all.len() <= LABELLED_N.len() || LABELLED_N.contains(&n) {
                    n.to_string()
                } else {
                    String::new()
                }
            };
            all.iter().map(|&n| (f64::from(n), text(n))).collect()
        }
        Along::Pairs => {
            let all = || series.iter().flat_map(|s| &s.points).map(|point| point.x);
            let low = all().fold(f64::INFINITY, f64::min).max(1.0).log10().floor() as i32;
            let high = all().fold(1.0, f64::max).log10().ceil() as i32;
            (low..=high.max(low))
                .map(|power| 10_f64.powi(power))
                .map(|count| (count, short_power(count)))
                .collect()
        }
    }
}

fn short_power(count: f64) -> String {
    match count {
        c if c < 1e3 => format!("{c:.0}"),
        c if c < 1e6 => format!("{:.0}k", c / 1e3),
        c if c < 1e9 => format!("{:.0}M", c / 1e6),
        c => format!("{:.0}G", c / 1e9),
    }
}

//! What does a run over grids show, so that a stranger sees it in ten seconds?
//!
//! What was wanted and what came, maps as pictures, lines over time and range, and all numbers.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::html::{Esc, put};
use super::page::{document, run_again};
use super::plot::path;
use crate::grid::{GridResults, GridTable, Plot, facts, show};

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 240.0;
const LEFT: f64 = 46.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 196.0;
/// Points of a curve that are fewer than this are marked by dots.
const FEW: usize = 16;

/// The report as one HTML document.
pub fn render_grid(results: &GridResults) -> String {
    let sections = [
        ("maps", "Maps", pictures(results)),
        ("plots", "Curves", plots(&results.plots)),
        ("summary", "All numbers", tables(&results.tables)),
    ];
    document(
        &format!("{}: what will the map be?", results.suite),
        &head(results),
        &sections,
        "<p>Intervals: 95 %; shares of independent cases by Wilson, all others by drawing whole worlds \
         again (cluster bootstrap). Baselines: the static map of a night, the averaged map, the last \
         observation; the oracle knows the truth.</p>",
    )
}

fn head(results: &GridResults) -> String {
    let mut html = String::new();
    put!(
        html,
        "<h1>What will the map be? Suite {}</h1><p class=\"sub\">{}</p>",
        Esc(&results.suite),
        Esc(&results.title)
    );
    let num_met = results
        .targets
        .iter()
        .filter(|target| target.is_met)
        .count();
    if !results.targets.is_empty() {
        put!(
            html,
            "<p class=\"verdict\">{num_met} of {} aims are met.</p><div class=\"scroll\" tabindex=\"0\" \
             role=\"region\" aria-label=\"Aims\"><table><thead><tr><th>aim</th><th>measured</th>\
             <th>verdict</th></tr></thead><tbody>",
            results.targets.len()
        );
        for target in &results.targets {
            let (class, word) = if target.is_met {
                ("better", "met")
            } else {
                ("worse", "missed")
            };
            put!(
                html,
                "<tr><td>{}</td><td>{}</td><td class=\"{class}\">{word}</td></tr>",
                Esc(&target.wanted),
                Esc(&target.measured)
            );
        }
        html.push_str("</tbody></table></div>");
    }
    run_again(&mut html, &results.command);
    html.push_str("<details><summary>How this was measured</summary><dl class=\"facts\">");
    for (name, value) in facts(results) {
        put!(html, "<dt>{name}</dt><dd>{}</dd>", Esc(value));
    }
    html.push_str("</dl></details>");
    html
}

fn pictures(results: &GridResults) -> String {
    let mut html = String::new();
    for (title, hint, pictures) in &results.pictures {
        put!(
            html,
            "<h2>{}</h2><p class=\"hint\">{}</p><div class=\"grid\">",
            Esc(title),
            Esc(hint)
        );
        for picture in pictures {
            put!(
                html,
                "<figure><img style=\"width:100%;image-rendering:pixelated\" alt=\"{0}\" \
                 src=\"data:image/png;base64,{1}\"><figcaption>{0}</figcaption></figure>",
                Esc(&picture.title),
                STANDARD.encode(&picture.png)
            );
        }
        html.push_str("</div>");
    }
    html
}

fn plots(plots: &[Plot]) -> String {
    let mut html = String::new();
    if plots.is_empty() {
        return html;
    }
    html.push_str("<h2>Curves</h2><div class=\"grid level\">");
    for (number, plot) in plots.iter().enumerate() {
        draw(&mut html, plot, number);
    }
    html.push_str("</div>");
    html
}

/// A step of 1, 2 or 5 times a power of ten, such that at most six reach `max`.
fn step(max: f64) -> f64 {
    let mut step = 10_f64.powf((max / 6.0).log10().floor());
    for factor in [2.0, 2.5, 2.0] {
        if max / step <= 6.0 {
            break;
        }
        step *= factor;
    }
    step
}

fn draw(html: &mut String, plot: &Plot, number: usize) {
    let points = || plot.curves.iter().flat_map(|curve| &curve.points);
    let largest = |of: fn(&(f64, f64)) -> f64| {
        let max = points()
            .map(of)
            .filter(|it| it.is_finite())
            .fold(0.0, f64::max);
        if max > 0.0 { max } else { 1.0 }
    };
    let [x_max, y_max] = [largest(|it| it.0), largest(|it| it.1)];
    let px = |x: f64| LEFT + x / x_max * (WIDTH - LEFT - RIGHT);
    let py = |y: f64| BOTTOM - y / y_max * (BOTTOM - TOP);
    put!(
        html,
        "<figure class=\"plot\"><h3>{0}</h3><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         aria-label=\"{0}\">",
        Esc(&plot.title)
    );
    let y_step = step(y_max);
    for at in 0..=(y_max / y_step).floor() as usize {
        let y = at as f64 * y_step;
        put!(
            html,
            "<path class=\"axis\" d=\"M{LEFT} {0:.1}H{1}\"/><text x=\"{2}\" y=\"{3:.1}\" \
             text-anchor=\"end\">{4}</text>",
            py(y),
            WIDTH - RIGHT,
            LEFT - 6.0,
            py(y) + 4.0,
            label(y, y_step)
        );
    }
    let x_step = step(x_max);
    for at in 0..=(x_max / x_step).floor() as usize {
        let x = at as f64 * x_step;
        put!(
            html,
            "<path class=\"tick\" d=\"M{0:.1} {BOTTOM}v5\"/><text x=\"{0:.1}\" y=\"{1}\" \
             text-anchor=\"middle\">{2}</text>",
            px(x),
            BOTTOM + 19.0,
            label(x, x_step)
        );
    }
    put!(
        html,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text><text x=\"{LEFT}\" y=\"{}\">{}</text>",
        f64::midpoint(LEFT, WIDTH - RIGHT),
        HEIGHT - 6.0,
        Esc(&plot.axes[0]),
        TOP - 1.0,
        Esc(&plot.axes[1])
    );
    for (index, curve) in plot.curves.iter().enumerate() {
        put!(
            html,
            "<g class=\"series c{}\" data-series=\"{index}\">",
            index % 8
        );
        let is_apart = curve.name.ends_with("maps");
        if !is_apart {
            let line = curve.points.iter().filter(|(_, y)| y.is_finite());
            put!(
                html,
                "<path class=\"curve d{}\" d=\"{}\"/>",
                index % 4,
                path(line.map(|&(x, y)| (px(x), py(y))))
            );
        }
        if is_apart || curve.points.len() < FEW {
            for &(x, y) in &curve.points {
                put!(
                    html,
                    "<circle class=\"dot\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\"/>",
                    px(x),
                    py(y)
                );
            }
        }
        html.push_str("</g>");
    }
    html.push_str("</svg><ul class=\"keys\">");
    keys(html, plot, number);
    html.push_str("</ul></figure>\n");
}

/// The names of the curves, which can be pressed.
fn keys(html: &mut String, plot: &Plot, number: usize) {
    for (index, curve) in plot.curves.iter().enumerate() {
        put!(
            html,
            "<li><button type=\"button\" class=\"key c{}\" data-series=\"{index}\" id=\"plot{number}-{index}\" \
             aria-pressed=\"true\"><svg viewBox=\"0 0 40 16\" aria-hidden=\"true\"><path class=\"curve d{}\" \
             d=\"M1 8H39\"/></svg><span>{}</span></button></li>",
            index % 8,
            index % 4,
            Esc(&curve.name)
        );
    }
}

/// As many digits as a step needs.
fn label(value: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

fn tables(tables: &[GridTable]) -> String {
    let mut html = String::from(
        "<h2>All numbers</h2><p class=\"hint\">With 95 % intervals where there are any. Press a heading to \
         sort.</p>",
    );
    for table in tables {
        put!(
            html,
            "<h3 class=\"above\" id=\"{}\">{}</h3><div class=\"scroll\" tabindex=\"0\" role=\"region\" \
             aria-label=\"{1}\"><table class=\"sortable\"><thead><tr>",
            Esc(&table.id),
            Esc(&table.title)
        );
        put!(
            html,
            "<th><button type=\"button\">{}</button></th>",
            Esc(&table.of)
        );
        for column in &table.columns {
            put!(
                html,
                "<th><button type=\"button\">{}</button></th>",
                Esc(&column.heading)
            );
        }
        html.push_str("</tr></thead><tbody>");
        for row in &table.rows {
            let class = if row.is_default {
                " class=\"default\""
            } else {
                ""
            };
            put!(html, "<tr{class}><td>{}</td>", Esc(&row.name));
            for column in &table.columns {
                match row.values.get(&column.key) {
                    Some(cell) => put!(
                        html,
                        "<td data-v=\"{}\">{}</td>",
                        cell.value,
                        show(*cell, column.decimals)
                    ),
                    None => html.push_str("<td>\u{2013}</td>"),
                }
            }
            html.push_str("</tr>");
        }
        html.push_str("</tbody></table></div>");
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_a_few_round_steps() {
        for (max, expected) in [
            (1.0, 0.2),
            (7.0, 2.0),
            (26.0, 5.0),
            (60.0, 10.0),
            (0.05, 0.01),
        ] {
            assert!((step(max) - expected).abs() < 1e-9, "{max}: {}", step(max));
            assert!((2.0..=6.0).contains(&(max / step(max))), "{max}");
        }
        assert_eq!([label(0.2, 0.1), label(40.0, 20.0)], ["0.2", "40"]);
    }
}

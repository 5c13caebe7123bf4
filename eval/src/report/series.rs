//! What does a run over series show, so that a stranger sees it in ten seconds?
//!
//! The same frame as the report of images: what was found in one sentence, p(t) over the data,
//! error over order, the spectrum over that of the sampling, and all numbers.

use std::collections::BTreeMap;

use super::axis::probability_lines;
use super::html::{Esc, put};
use super::page::{document, run_again};
use super::plot::{Point, Scale, Series, SharePlot, path};
use crate::results::RowOrder;
use crate::series::sampling::Sampling;
use crate::series::{Drawing, Measured, Row, SeriesResults, Spectrum, facts, is_in_table};
use chronotope::spectrum::PeriodogramLine;

const WIDTH: f64 = 480.0;
const LEFT: f64 = 40.0;
const RIGHT: f64 = 10.0;

/// The report as one HTML document.
pub fn render_series(results: &SeriesResults) -> String {
    let sections = [
        ("curves", "Over time", curves(&results.drawings)),
        ("order", "Error over order", over_order(results)),
        ("spectrum", "Spectrum", spectra(&results.spectra)),
        ("summary", "All numbers", summary(results)),
    ];
    document(
        &format!("{}: is the state predicted?", results.suite),
        &head(results),
        &sections,
        "<p>Wrong: p(t) on the wrong side of 1/2. Brier score: mean squared difference of p and state, log \
         loss: mean of \u{2212}ln p of what came, p no closer to 0 or 1 than 0.001. Intervals: percentile \
         bootstrap over blocks of time; against the mean: the difference block by block, same draws. Orders \
         of FreMEn are shown in full, none is chosen by the queries.</p>",
    )
}

fn sampling_words(sampling: Sampling) -> &'static str {
    match sampling {
        Sampling::All => "all samples",
        Sampling::Random => "random samples",
        Sampling::OfficeHours => "office hours alone",
    }
}

fn head(results: &SeriesResults) -> String {
    let mut html = String::new();
    put!(
        html,
        "<h1>Is the state predicted? Suite {}</h1><p class=\"sub\">{}</p>",
        Esc(&results.suite),
        Esc(&results.title)
    );
    let hardest = Sampling::OfficeHours;
    if let (Some(ours), Some(literal)) = (results.default_row(hardest), results.literal(hardest)) {
        let better = 100.0 * (1.0 - ours.brier.value / literal.brier.value);
        let (class, words) = if better >= 0.0 {
            ("better", format!("{better:.0} % lower"))
        } else {
            ("worse", format!("{:.0} % higher", -better))
        };
        put!(
            html,
            "<p class=\"verdict\">Learnt from office hours alone (Monday to Friday, 8 to 18 h), model \
             <em>{}</em> predicts every hour with a Brier score of <strong>{:.3}</strong>, <strong \
             class=\"{class}\">{words}</strong> than FreMEn as printed in the papers <span class=\"word\">({},</span> order chosen on \
             held-out samples: {:.3}).</p>",
            Esc(&ours.model),
            ours.brier.value,
            Esc(&literal.model),
            literal.brier.value
        );
    }
    html.push_str("<div class=\"tiles\">");
    for sampling in Sampling::ALL {
        let Some(row) = results.default_row(sampling) else {
            continue;
        };
        let against = row.brier_against_mean;
        put!(
            html,
            "<div class=\"tile\"><b>{:.1} %</b><span>of states wrong, learnt from {}; Brier score {:.3}, \
             against the mean {} ({} to {})</span></div>",
            100.0 * row.state_error.value,
            sampling_words(sampling),
            row.brier.value,
            signed(against.value),
            signed(against.low),
            signed(against.high)
        );
    }
    html.push_str("</div>");
    run_again(&mut html, &results.command);
    html.push_str("<details><summary>How this was measured</summary><dl class=\"facts\">");
    for (name, value) in facts(results) {
        put!(html, "<dt>{name}</dt><dd>{}</dd>", Esc(value));
    }
    html.push_str("</dl></details>");
    html
}

/// Three decimals, a sign, a real minus.
fn signed(value: f64) -> String {
    match format!("{value:+.3}").as_str() {
        "+0.000" | "-0.000" => "0.000".to_owned(),
        text => text.replace('-', "\u{2212}"),
    }
}

/// Colour and dashes of a model, the same in all plots.
fn look(model: &str) -> (usize, usize) {
    match model {
        "mean" => (0, 0),
        "natural" => (1, 0),
        "fft" => (2, 1),
        "fremen" => (4, 0),
        "fremen-alpha-only" => (3, 2),
        "fremen-running-mean" => (3, 1),
        _ => (5, 3),
    }
}

fn curves(drawings: &[Drawing]) -> String {
    let mut html = String::new();
    if drawings.is_empty() {
        return html;
    }
    html.push_str(
        "<h2>What was predicted, what came?</h2><p class=\"hint\">Grey: the state was 1 (until the next sample), in time that no model \
         had seen. Lines: p(t) of each model; what it was learnt from stands in the title.</p>\
         <div class=\"grid level\">",
    );
    for drawing in drawings {
        curve(&mut html, drawing);
    }
    html.push_str("</div>\n");
    html
}

fn curve(html: &mut String, drawing: &Drawing) {
    const TOP: f64 = 10.0;
    const BOTTOM: f64 = 150.0;
    let (Some(&first), Some(&last)) = (drawing.times_s.first(), drawing.times_s.last()) else {
        return;
    };
    let px = |time: f64| LEFT + (time - first) / (last - first).max(1.0) * (WIDTH - LEFT - RIGHT);
    let py = |p: f64| BOTTOM - p * (BOTTOM - TOP);
    let share: f64 = drawing.is_one.iter().map(|(from, to)| to - from).sum();
    put!(
        html,
        "<figure class=\"plot\"><h3>{0}</h3><svg viewBox=\"0 0 {WIDTH} 186\" role=\"img\" aria-label=\"{0}: p(t) \
         of {1} over the state, which was 1 for {2:.0} % of the time\">",
        Esc(&drawing.title),
        Esc(names(drawing)),
        100.0 * share / (last - first).max(1.0)
    );
    let mut d = String::new();
    for (from, to) in &drawing.is_one {
        let (x, width) = (px(*from), (px(*to) - px(*from)).max(0.3));
        put!(d, "M{x:.1} {TOP}h{width:.1}V{BOTTOM}h-{width:.1}Z");
    }
    put!(html, "<path class=\"truth\" d=\"{d}\"/>");
    probability_lines(html, (LEFT, WIDTH - RIGHT), 6.0, py);
    for (time, text) in day_ticks(first, last) {
        put!(
            html,
            "<path class=\"tick\" d=\"M{x:.1} {BOTTOM}v5\"/><text x=\"{x:.1}\" y=\"{}\" \
             text-anchor=\"{}\">{text}</text>",
            BOTTOM + 20.0,
            // The last name would be cut at the edge.
            if px(time) > WIDTH - 2.0 * RIGHT {
                "end"
            } else {
                "middle"
            },
            x = px(time)
        );
    }
    for (index, (name, values)) in drawing.curves.iter().enumerate() {
        let (colour, style) = look(name.split(',').next().unwrap_or_default());
        let main = if name == "natural" { " main" } else { "" };
        let line = drawing.times_s.iter().zip(values);
        put!(
            html,
            "<g class=\"series c{colour}{main}\" data-series=\"{index}\"><path class=\"curve d{style}\" \
             d=\"{}\"/></g>",
            path(line.map(|(&time, &p)| (px(time), py(p))))
        );
    }
    html.push_str("</svg><ul class=\"keys\">");
    for (index, (name, _)) in drawing.curves.iter().enumerate() {
        let (colour, style) = look(name.split(',').next().unwrap_or_default());
        let (main, thick) = if name == "natural" {
            (" main-key", " class=\"main\"")
        } else {
            ("", "")
        };
        put!(
            html,
            "<li><button type=\"button\" class=\"key c{colour}{main}\" data-series=\"{index}\" \
             aria-pressed=\"true\"><svg viewBox=\"0 0 40 16\" aria-hidden=\"true\"{thick}><path class=\"curve d{style}\" \
             d=\"M1 8H39\"/></svg><span>{}</span></button></li>",
            Esc(name)
        );
    }
    html.push_str("</ul></figure>\n");
}

fn names(drawing: &Drawing) -> String {
    let names: Vec<&str> = drawing
        .curves
        .iter()
        .map(|(name, _)| name.as_str())
        .collect();
    names.join(", ")
}

/// Midnights with the day of the week, or every six hours of a short stretch.
fn day_ticks(first: f64, last: f64) -> Vec<(f64, String)> {
    const DAY: f64 = 86_400.0;
    // The epoch was a Thursday.
    const NAMES: [&str; 7] = ["Thu", "Fri", "Sat", "Sun", "Mon", "Tue", "Wed"];
    let step = if last - first > 2.5 * DAY {
        DAY
    } else {
        DAY / 4.0
    };
    let mut ticks = Vec::new();
    let mut time = (first / step).ceil() * step;
    while time <= last {
        let hour = time.rem_euclid(DAY) / 3_600.0;
        ticks.push((
            time,
            if hour == 0.0 {
                NAMES[((time / DAY) as i64).rem_euclid(7) as usize].to_owned()
            } else {
                format!("{hour:.0} h")
            },
        ));
        time += step;
    }
    ticks
}

/// State error and Brier score over order (T-RO, Fig. 3 to 5), a plot for each sampling.
fn over_order(results: &SeriesResults) -> String {
    let mut html = String::new();
    let plots = [
        (
            "Wrong states",
            (|row| row.state_error) as fn(&Row) -> Measured,
        ),
        ("Brier score in %", |row| row.brier),
    ];
    // A sampling's plots side by side.
    for sampling in Sampling::ALL {
        for (metric, (name, value)) in plots.into_iter().enumerate() {
            let title = format!("{name}, learnt from {}", sampling_words(sampling));
            order_plot(&mut html, results, sampling, &title, value, metric);
        }
    }
    if html.is_empty() {
        return html;
    }
    format!(
        "<h2>How many rhythms?</h2><p class=\"hint\">Error on unseen time over the order of the papers\u{2019} \
         models; the mean and models that choose for themselves are level lines. The shade is \
         the 95 % interval of the recommended model; the table has all.</p><div class=\"grid\">{html}</div>"
    )
}

fn order_plot(
    html: &mut String,
    results: &SeriesResults,
    sampling: Sampling,
    title: &str,
    value: fn(&Row) -> Measured,
    metric: usize,
) {
    let rows = || results.rows.iter().filter(|row| row.sampling == sampling);
    let mut by_model: BTreeMap<&str, Vec<(u32, &Row)>> = BTreeMap::new();
    let mut last = 0;
    for row in rows() {
        if let RowOrder::Fixed(order) = row.order
            && row.model != "mean"
        {
            by_model.entry(&row.model).or_default().push((order, row));
            last = last.max(order);
        }
    }
    for row in rows().filter(|row| row.model == "mean" || row.is_default) {
        by_model.insert(&row.model, vec![(0, row), (last, row)]);
    }
    let point = |(order, row): &(u32, &Row)| {
        let measured = value(row);
        Point {
            // The axis is logarithmic: powers of ten are evenly spaced.
            x: 10_f64.powi(*order as i32),
            y: 100.0 * measured.value,
            // One shade is enough: many would hide each other. The table has all intervals.
            low: 100.0
                * if row.is_default {
                    measured.low
                } else {
                    measured.value
                },
            high: 100.0
                * if row.is_default {
                    measured.high
                } else {
                    measured.value
                },
            label: format!("order {}: {:.1} %", row.order, 100.0 * measured.value),
        }
    };
    let mut series: Vec<Series> = (by_model.iter())
        .map(|(model, rows)| {
            let (colour, style) = look(model);
            let points: Vec<Point> = rows.iter().map(point).collect();
            let best = points.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
            Series {
                name: (*model).to_owned(),
                colour,
                style,
                is_main: rows.iter().any(|(_, row)| row.is_default),
                value: format!("{best:.1} %"),
                points,
            }
        })
        .collect();
    let at_the_end = |series: &Series| series.points.last().map_or(0.0, |point| point.y);
    series.sort_by(|a, b| at_the_end(b).total_cmp(&at_the_end(a)));
    let plot = SharePlot {
        x_scale: Scale::Logarithmic,
        y_unit: " %",
        guide: None,
        title,
        description: format!("{title}, over the order of the model"),
        x_label: "order: rhythms that the model has",
        x_ticks: (0..=last)
            .map(|order| (10_f64.powi(order as i32), order.to_string()))
            .collect(),
        series: &series,
        is_lead: false,
        key_title: "lowest".into(),
        id: format!("order{metric}{}", sampling.name()),
    };
    html.push_str(&plot.render());
}

fn spectra(spectra: &[Spectrum]) -> String {
    let mut html = String::new();
    if spectra.is_empty() {
        return html;
    }
    html.push_str(
        "<h2>Which rhythms, and which are the sampling\u{2019}s own?</h2><p class=\"hint\">Above: amplitudes \
         2|g| of the learnt state. Below, upside down: the transform |W|/m of the sampling itself, 0 where \
         samples are spread evenly over a cycle. Rhythms above a strong window line cannot be distinguished from the \
         mean or from each other: that is why all are solved for together.</p><div class=\"grid\">",
    );
    for spectrum in spectra {
        one_spectrum(&mut html, spectrum);
    }
    html.push_str("</div>\n");
    html
}

fn one_spectrum(html: &mut String, spectrum: &Spectrum) {
    const TOP: f64 = 12.0;
    const MIDDLE: f64 = 130.0;
    const BOTTOM: f64 = 210.0;
    const HOUR: f64 = 3_600.0;
    /// A window below this is no taller than its line is thick.
    const EVEN: f64 = 0.02;
    let (Some(first), Some(last)) = (spectrum.lines.first(), spectrum.lines.last()) else {
        return;
    };
    let (longest, shortest) = (first.period_s.ln(), last.period_s.ln());
    let px = |period_s: f64| {
        LEFT + 8.0
            + (longest - period_s.ln()) / (longest - shortest).max(1e-9)
                * (WIDTH - LEFT - RIGHT - 16.0)
    };
    let highest = spectrum
        .lines
        .iter()
        .map(|line| line.amplitude)
        .fold(0.05, f64::max);
    let strongest = (spectrum.lines.iter())
        .max_by(|a, b| a.amplitude.total_cmp(&b.amplitude))
        .map_or(0.0, |line| line.period_s / HOUR);
    put!(
        html,
        "<figure><h3>{0}</h3><svg viewBox=\"0 0 {WIDTH} 258\" role=\"img\" aria-label=\"{0}: amplitudes over \
         periods from a week to an hour above the sampling window; the strongest has {strongest:.0} h\">",
        Esc(&spectrum.title)
    );
    for (y, text) in [
        (TOP, format!("{highest:.2}")),
        (MIDDLE, "0".to_owned()),
        (BOTTOM, "1".to_owned()),
    ] {
        put!(
            html,
            "<path class=\"axis\" d=\"M{LEFT} {y}H{}\"/><text x=\"{}\" y=\"{}\" \
             text-anchor=\"end\">{text}</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            y + 4.5
        );
    }
    let window = (spectrum.lines.iter())
        .map(|line| line.window)
        .fold(0.0, f64::max);
    let sampling = if window < EVEN {
        "sampling: even, no rhythm of its own"
    } else {
        "sampling"
    };
    let stems = |height: &dyn Fn(&PeriodogramLine) -> f64| {
        let mut d = String::new();
        for line in &spectrum.lines {
            put!(d, "M{:.1} {MIDDLE}V{:.1}", px(line.period_s), height(line));
        }
        d
    };
    put!(
        html,
        "<g class=\"c1\"><path class=\"curve\" d=\"{}\"/></g><g class=\"c3\"><path class=\"curve\" d=\"{}\"/></g>",
        stems(&|line| MIDDLE - line.amplitude / highest * (MIDDLE - TOP)),
        stems(&|line| MIDDLE + line.window * (BOTTOM - MIDDLE))
    );
    for (period_s, text) in [
        (168.0 * HOUR, "week"),
        (24.0 * HOUR, "day"),
        (12.0 * HOUR, "12 h"),
        (6.0 * HOUR, "6 h"),
        (3.0 * HOUR, "3 h"),
        (HOUR, "1 h"),
    ] {
        put!(
            html,
            "<path class=\"tick\" d=\"M{x:.1} {BOTTOM}v5\"/><text x=\"{x:.1}\" y=\"{}\" \
             text-anchor=\"middle\">{text}</text>",
            BOTTOM + 20.0,
            x = px(period_s)
        );
    }
    put!(
        html,
        "<text class=\"strong\" x=\"{x}\" y=\"{}\" text-anchor=\"end\">state</text><text class=\"strong\" \
         x=\"{x}\" y=\"{}\" text-anchor=\"end\">{sampling}</text><text x=\"{}\" y=\"{}\" \
         text-anchor=\"middle\">period</text></svg></figure>\n",
        TOP + 14.0,
        BOTTOM - 8.0,
        f64::midpoint(LEFT, WIDTH - RIGHT),
        BOTTOM + 40.0,
        x = WIDTH - RIGHT - 4.0
    );
}

fn summary(results: &SeriesResults) -> String {
    let mut html = String::from(
        "<h2>All numbers</h2><p class=\"hint\">On unseen time, with 95 % intervals. Press a heading to \
         sort. The file has all orders.</p>",
    );
    for sampling in Sampling::ALL {
        let rows: Vec<&Row> = (results.rows.iter())
            .filter(|row| row.sampling == sampling && is_in_table(row))
            .collect();
        let Some(first) = rows.first() else { continue };
        put!(
            html,
            "<h3 class=\"above\">Learnt from {} ({:.0} samples)</h3><div class=\"scroll\" tabindex=\"0\" \
             role=\"region\" aria-label=\"All numbers, learnt from {0}\"><table class=\"sortable\"><thead><tr>",
            sampling_words(sampling),
            first.num_learnt
        );
        for head in [
            "model",
            "order",
            "wrong, learnt %",
            "wrong, unseen %",
            "interval",
            "Brier",
            "interval",
            "against mean",
            "interval",
            "log loss",
        ] {
            put!(html, "<th><button type=\"button\">{head}</button></th>");
        }
        html.push_str("</tr></thead><tbody>");
        for row in rows {
            summary_row(&mut html, row);
        }
        html.push_str("</tbody></table></div>");
    }
    html
}

fn summary_row(html: &mut String, row: &Row) {
    let class = if row.is_default {
        " class=\"default\""
    } else {
        ""
    };
    let against = row.brier_against_mean;
    // What is printed as nothing is no difference.
    let is_nothing = signed(against.value) == "0.000";
    let judged = if is_nothing {
        "same"
    } else if row.is_worse_than_mean() {
        "worse"
    } else if against.high < 0.0 {
        "better"
    } else {
        "same"
    };
    let percent = |value: f64| format!("{:.1}", 100.0 * value);
    put!(
        html,
        "<tr{class}><td><span class=\"swatch c{}\"></span>{}</td><td data-v=\"{}\">{}</td><td>{}</td><td>{}</td>\
         <td>{} to {}</td><td>{:.3}</td><td>{:.3} to {:.3}</td><td class=\"{judged}\" data-v=\"{}\">{}</td>\
         <td>{} to {}</td><td>{:.3}</td></tr>",
        look(&row.model).0,
        Esc(&row.model),
        match row.order {
            RowOrder::Fixed(order) => order.to_string(),
            RowOrder::Auto => "-1".to_owned(),
        },
        row.order,
        percent(row.estimation_error),
        percent(row.state_error.value),
        percent(row.state_error.low),
        percent(row.state_error.high),
        row.brier.value,
        row.brier.low,
        row.brier.high,
        against.value,
        signed(against.value),
        signed(against.low),
        signed(against.high),
        row.log_loss.value
    );
}

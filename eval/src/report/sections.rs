//! Which parts of a report come from the numbers alone?

use std::collections::BTreeMap;

use super::html::{Esc, Words, put, signed};
use super::plot::{Point, Scale, Series, SharePlot};
use crate::judge::rates::{Confusion, PairedDifference};
use crate::results::{Order, Row, SuiteResults, Variant};
use crate::table::{header_lines, short_count, short_ms};

/// More places than this make a matrix that nobody reads: the most frequent confusions are listed.
const MAX_MATRIX_PLACES: usize = 24;

/// How many confusions are listed then.
const NUM_LISTED_CONFUSIONS: usize = 20;

/// The baseline that every method is compared with.
const BASELINE: &str = "static";

/// Names of n that are written below an axis; the others get a bare tick.
const LABELLED_N: [u32; 8] = [5, 10, 20, 30, 50, 100, 200, 300];

/// Index into the colours of the style sheet, the same for a method in all plots.
fn colour(method: &str) -> usize {
    const KNOWN: [&str; 6] = [
        BASELINE,
        "fremen",
        "experience",
        "experience-all",
        "freex",
        "fused",
    ];
    KNOWN
        .iter()
        .position(|known| *known == method)
        .unwrap_or_else(|| {
            let sum: usize = method.bytes().map(usize::from).sum();
            KNOWN.len() + sum % 2
        })
}

/// Method with model and order, for people: parts that say nothing are left out.
pub(super) fn label(variant: &Variant) -> String {
    let mut text = variant.method.clone();
    if !matches!(variant.model.as_str(), "mean" | "none" | "-" | "") {
        put!(text, " {}", variant.model);
    }
    match variant.order {
        Order::Fixed(0) => {}
        Order::Fixed(order) => put!(text, ", order {order}"),
        Order::Auto => text.push_str(", order auto"),
    }
    text
}

/// The variant that the headline is about: the shipped default, else the first FreMEn, else the
/// first of all. Never the best one: choosing it by the queries would flatter it.
pub(super) fn headline(results: &SuiteResults) -> Option<Variant> {
    let variants = results.variants();
    results
        .default_variant()
        .or_else(|| variants.iter().find(|v| v.method == "fremen").cloned())
        .or_else(|| variants.first().cloned())
}

/// The baseline of the same preset and score, where the run has one other than `variant`.
fn baseline(results: &SuiteResults, variant: &Variant) -> Option<Variant> {
    results.variants().into_iter().find(|other| {
        other.method == BASELINE
            && other.preset == variant.preset
            && other.score == variant.score
            && other != variant
    })
}

fn interval_text(row: &Row) -> String {
    format!("{:.1} to {:.1}", row.ci_low, row.ci_high)
}

/// Title, verdict, tiles and where the numbers come from.
pub(super) fn head(results: &SuiteResults) -> String {
    let mut html = String::new();
    put!(
        html,
        "<h1>Which place is this? Suite {}</h1><p class=\"sub\">{}: {} queries{}</p>",
        Esc(&results.suite),
        Esc(&results.dataset),
        results.queries.len(),
        results
            .num_places
            .map_or_else(String::new, |num| format!(", {num} places"))
    );
    let headline = headline(results).zip(results.detail_n());
    if let Some((variant, n)) = &headline
        && let Some(row) = results.row(&variant.at(*n))
    {
        verdict(&mut html, results, row, variant);
    }
    if !results.command.is_empty() {
        put!(
            html,
            "<p class=\"again\">Run it again: <code>{}</code></p>",
            Words(&results.command)
        );
    }
    html.push_str("<details><summary>How this was measured</summary><dl class=\"facts\">");
    for (name, value) in header_lines(results) {
        if name == "Command" {
            let value = Words(&value);
            put!(html, "<dt>{name}</dt><dd><code>{value}</code></dd>");
        } else {
            put!(html, "<dt>{name}</dt><dd>{}</dd>", Esc(value));
        }
    }
    for note in &results.notes {
        put!(html, "<dt>Note</dt><dd>{}</dd>", Esc(note));
    }
    html.push_str("</dl></details>");
    html
}

fn verdict(html: &mut String, results: &SuiteResults, row: &Row, variant: &Variant) {
    let who = if row.is_default {
        "the default configuration"
    } else {
        "the configuration"
    };
    put!(
        html,
        "<p class=\"verdict\">With {} predicted features per place, {who} ({}, score {}) names the \
         right place for <strong>{} of {}</strong> images",
        row.n,
        Esc(label(variant)),
        Esc(&row.variant.score),
        trimmed(row.correct),
        row.queries
    );
    let pair = baseline(results, variant).and_then(|other| {
        PairedDifference::between(&results.queries, &other.at(row.n), &variant.at(row.n))
    });
    match &pair {
        Some(pair) if pair.points.excludes_zero() && pair.points.mean < 0.0 => put!(
            html,
            ", <strong class=\"better\">{:.1} points fewer mistakes</strong> than the static map",
            -pair.points.mean
        ),
        Some(pair) if pair.points.excludes_zero() => put!(
            html,
            ", <strong class=\"worse\">{:.1} points more mistakes</strong> than the static map",
            pair.points.mean
        ),
        Some(_) => html.push_str(
            ". On this many images that is <strong>not clearly different</strong> from the static map",
        ),
        None => {}
    }
    html.push_str(".</p><div class=\"tiles\">");
    let mut tile = |value: String, what: String| {
        put!(
            html,
            "<div class=\"tile\"><b>{}</b><span>{}</span></div>",
            Esc(value),
            Esc(what)
        );
    };
    tile(
        format!("{:.1} %", row.wrong_percent()),
        format!("wrong (95 % interval {})", interval_text(row)),
    );
    if let Some(pair) = &pair {
        let interval = pair.points.interval;
        tile(
            format!("{} points", signed(pair.points.mean)),
            format!(
                "against static on the same images ({} to {})",
                signed(interval.low),
                signed(interval.high)
            ),
        );
    }
    if let Some(percent) = row.reobserved {
        let of_static = baseline(results, variant)
            .and_then(|other| results.row(&other.at(row.n))?.reobserved)
            .map_or_else(String::new, |percent| format!(" (static: {percent:.0} %)"));
        tile(
            format!("{percent:.0} %"),
            format!("of the predicted features are seen again{of_static}"),
        );
    }
    // A run that timed nothing says nothing about time.
    if row.ms_p50 > 0.0 {
        tile(
            format!("{} ms", short_ms(row.ms_p50)),
            format!(
                "to locate one image, median; 99 of 100 within {} ms",
                short_ms(row.ms_p99)
            ),
        );
    }
    html.push_str("</div>");
}

/// A number of queries, with its split ties where there are some.
fn trimmed(count: f64) -> String {
    let text = format!("{count:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}

/// What a plot draws along its horizontal axis.
#[derive(Clone, Copy, PartialEq)]
enum Along {
    N,
    Pairs,
}

/// Error over n, the group of the headline first and large.
pub(super) fn error_over_n(results: &SuiteResults) -> String {
    let plots = error_plots(results, Along::N);
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

/// The meaning of the presets, methods and scores that the run has.
fn words(results: &SuiteResults) -> String {
    const MEANINGS: [(&str, &str); 11] = [
        ("lttl", "preset: the recipe of the published benchmark"),
        ("default", "preset: what this project ships"),
        (
            "static",
            "method: the features seen most often, whatever the time",
        ),
        (
            "fremen",
            "method: the features most likely at the time of the image",
        ),
        (
            "experience",
            "method: an appearance is added to a place when the ones so far fail",
        ),
        (
            "experience-all",
            "method: every visit is kept as an appearance",
        ),
        (
            "freex",
            "method: the appearances that are likely at the time of the image",
        ),
        (
            "fused",
            "method: likely features and likely appearances under one budget",
        ),
        ("count", "score: how many predicted features are matched"),
        (
            "inliers",
            "score: how many matches agree on one displacement",
        ),
        (
            "likelihood",
            "score: how probable matches and misses are at this place",
        ),
    ];
    const OF_MODELS: [(&str, &str); 8] = [
        (
            "likeliest",
            "the likeliest features, whether or not they cover the place\u{2019}s appearances",
        ),
        (
            "covering",
            "features that cover the place\u{2019}s appearances, for a score that goes with the likeliest",
        ),
        (
            "without appearances",
            "it is not used that features seen together are expected together",
        ),
        (
            "without distances",
            "it is not used how near the descriptors of a match are",
        ),
        (
            "without displacement",
            "it is not used how far the camera seems displaced",
        ),
        (
            "without false-rates",
            "it is not used which features are found at other places too",
        ),
        (
            "without repeatability",
            "it is not used at which places features are found again more often",
        ),
        (
            "without strays",
            "it is not used how many matches there are that do not agree with the others",
        ),
    ];
    let variants = results.variants();
    let is_used = |word: &str| {
        let names = |v: &Variant| [v.preset.clone(), v.method.clone(), v.score.clone()];
        variants
            .iter()
            .any(|variant| names(variant).iter().any(|name| name == word))
    };
    let of_models = (OF_MODELS.iter())
        .filter(|(word, _)| variants.iter().any(|variant| variant.model.ends_with(word)));
    let mut html =
        String::from("<details><summary>What the names mean</summary><dl class=\"facts\">");
    for (word, meaning) in (MEANINGS.iter().filter(|(word, _)| is_used(word))).chain(of_models) {
        put!(html, "<dt>{word}</dt><dd>{meaning}</dd>");
    }
    html.push_str("</dl></details>");
    html
}

fn error_plots(results: &SuiteResults, along: Along) -> String {
    let mut html = String::new();
    let Some((headline, n)) = headline(results).zip(results.detail_n()) else {
        return html;
    };
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
                *variant == headline,
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

/// Every row, one n at a time, with intervals and the paired difference to the baseline.
pub(super) fn summary(results: &SuiteResults) -> String {
    let mut html = String::new();
    let Some(shown) = results.detail_n() else {
        return html;
    };
    put!(
        html,
        "<h2>All numbers</h2><p class=\"hint\">Press a heading to sort. Bold is the shipped default configuration. A tie for the first rank \
         counts in parts. \u{201c}Against static\u{201d} pairs each method with the static map of its \
         preset and score, image by image: \u{25bc} fewer mistakes, \u{25b2} more, \u{2248} not \
         clearly different at 95 %.</p>\
         <div class=\"controls\"><label>Features per place, n = \
         <select data-filters=\"rows\"><option value=\"\">all</option>"
    );
    for n in results.all_n() {
        let selected = if n == shown { " selected" } else { "" };
        put!(html, "<option{selected}>{n}</option>");
    }
    // Intervals are drawn to the scale of the rows shown; without the script, of all rows.
    let highs = results.rows.iter().map(|row| row.ci_high);
    put!(
        html,
        "</select></label></div><div class=\"scroll\" tabindex=\"0\" role=\"region\" \
         aria-label=\"All numbers\"><table class=\"sortable\" id=\"rows\" \
         style=\"--scale:{:.1}\"><thead><tr>",
        highs.fold(1.0, f64::max)
    );
    let may_be_unknown = results.rows.iter().any(|row| row.unknown > 0);
    let any_tied = results.rows.iter().any(|row| row.tied > 0);
    let heads = [
        ("Method", "t", true),
        ("n", "n", true),
        ("Wrong %", "", true),
        ("95 % interval", "t", true),
        ("Against static", "t", true),
        ("Tied", "", any_tied),
        ("Unknown", "", may_be_unknown),
        ("Seen again %", "", true),
        ("Pairs", "", true),
        ("ms, p50 (p99)", "", true),
    ];
    for (name, class, _) in heads.iter().filter(|(.., shown)| *shown) {
        put!(
            html,
            "<th scope=\"col\" class=\"{class}\"><button type=\"button\">{name}</button></th>"
        );
    }
    html.push_str("</tr></thead><tbody>");
    for row in &results.rows {
        summary_row(&mut html, results, row, (any_tied, may_be_unknown));
    }
    html.push_str("</tbody></table></div>\n");
    html
}

fn summary_row(
    html: &mut String,
    results: &SuiteResults,
    row: &Row,
    (any_tied, may_be_unknown): (bool, bool),
) {
    let variant = &row.variant;
    let class = if row.is_default {
        " class=\"default\""
    } else {
        ""
    };
    put!(
        html,
        "<tr data-n=\"{}\" data-high=\"{:.1}\"{class}><td><span class=\"swatch c{}\"></span>{}\
         <span class=\"sub\">{}, {}</span></td><td class=\"n\" data-v=\"{}\">{}</td>\
         <td data-v=\"{}\">{:.1}</td>",
        row.n,
        row.ci_high,
        colour(&row.variant.method),
        Esc(label(variant)),
        Esc(&row.variant.preset),
        Esc(&row.variant.score),
        row.n,
        row.n,
        row.wrong_percent(),
        row.wrong_percent()
    );
    put!(
        html,
        "<td class=\"t\" data-v=\"{}\"><span class=\"forest c{}\" \
         style=\"--lo:{:.1};--v:{:.1};--hi:{:.1}\" role=\"img\" aria-label=\"{}\">\
         <i class=\"w\"></i><i class=\"m\"></i></span>{}</td>",
        row.ci_high,
        colour(&row.variant.method),
        row.ci_low,
        row.wrong_percent(),
        row.ci_high,
        interval_text(row),
        interval_text(row)
    );
    let pair = baseline(results, &variant).and_then(|other| {
        PairedDifference::between(&results.queries, &other.at(row.n), &variant.at(row.n))
    });
    match pair {
        None => html.push_str("<td class=\"t\"></td>"),
        Some(pair) => {
            let (class, arrow, words) = match pair.points {
                p if !p.excludes_zero() => ("same", "\u{2248}", "not clearly different"),
                p if p.mean < 0.0 => ("better", "\u{25bc}", "fewer mistakes"),
                _ => ("worse", "\u{25b2}", "more mistakes"),
            };
            put!(
                html,
                "<td class=\"t {class}\" data-v=\"{}\"><span aria-hidden=\"true\">{arrow}</span>\
                 <span class=\"sr\">{words}</span> {} <small>({} to {})</small></td>",
                pair.points.mean,
                signed(pair.points.mean),
                signed(pair.points.interval.low),
                signed(pair.points.interval.high)
            );
        }
    }
    if any_tied {
        put!(html, "<td data-v=\"{0}\">{0}</td>", row.tied);
    }
    if may_be_unknown {
        put!(html, "<td data-v=\"{0}\">{0}</td>", row.unknown);
    }
    match row.reobserved {
        Some(percent) => put!(html, "<td data-v=\"{percent}\">{percent:.1}</td>"),
        None => html.push_str("<td>\u{2013}</td>"),
    }
    put!(
        html,
        "<td data-v=\"{}\">{}</td>",
        row.pairs_compared,
        short_count(row.pairs_compared)
    );
    if row.ms_p50 > 0.0 {
        put!(
            html,
            "<td data-v=\"{}\">{} <small>({})</small></td></tr>\n",
            row.ms_p50,
            short_ms(row.ms_p50),
            short_ms(row.ms_p99)
        );
    } else {
        html.push_str("<td>\u{2013}</td></tr>\n");
    }
}

/// Bars of re-observation with whiskers (T-RO, Table I).
pub(super) fn reobservation(results: &SuiteResults) -> String {
    let mut html = String::new();
    if results.reobservation.is_empty() {
        return html;
    }
    html.push_str(
        "<h2>Are the predicted features really there?</h2><p class=\"hint\">Higher is better. Share \
         of each method\u{2019}s most trusted features of the true place that the image shows again; \
         whiskers are 95 % intervals.</p>",
    );
    let mut presets: Vec<(&str, u32)> = Vec::new();
    for entry in &results.reobservation {
        if !presets.contains(&(entry.variant.preset.as_str(), entry.top)) {
            presets.push((&entry.variant.preset, entry.top));
        }
    }
    html.push_str("<div class=\"grid\">");
    for (preset, top) in presets {
        put!(
            html,
            "<div class=\"bars\"><h3>Preset {}, top {top} features</h3>",
            Esc(preset)
        );
        let entries = results
            .reobservation
            .iter()
            .filter(|entry| entry.variant.preset == preset && entry.top == top);
        for entry in entries {
            put!(
                html,
                "<div class=\"bar\"><span class=\"name\">{}</span><span class=\"track c{}\" \
                 style=\"--v:{:.1};--lo:{:.1};--hi:{:.1}\" role=\"img\" \
                 aria-label=\"{:.1} per cent, 95 % interval {:.1} to {:.1}\">\
                 <span class=\"fill\"></span><span class=\"whisker\"></span></span>\
                 <span class=\"num\">{:.1} %</span></div>",
                Esc(label(&entry.variant)),
                colour(&entry.variant.method),
                entry.percent,
                entry.ci_low,
                entry.ci_high,
                entry.percent,
                entry.ci_low,
                entry.ci_high,
                entry.percent
            );
        }
        html.push_str("</div>");
    }
    html.push_str("</div>\n");
    html
}

/// Predicted visibility against the truth.
pub(super) fn visibility_errors(results: &SuiteResults) -> String {
    let mut html = String::new();
    let errors = &results.visibility_errors;
    if errors.is_empty() {
        return html;
    }
    html.push_str(
        "<h2>How far is predicted visibility from the truth?</h2><p class=\"hint\">Lower is better. \
         Here the true probability of everything that is drawn is known: the mean distance of each \
         model\u{2019}s p(t) from it, at rounds that were not learnt; the default model has a star.</p>\
         <div class=\"scroll\"><table><thead><tr><th>Model</th><th class=\"num\">mean |p \u{2212} truth|</th>\
         <th class=\"num\">95 % interval</th></tr></thead><tbody>",
    );
    for error in errors {
        put!(
            html,
            "<tr><td>{}{}</td><td class=\"num\">{:.3}</td><td class=\"num\">{:.3} to {:.3}</td></tr>",
            Esc(&error.model),
            if error.is_default { " *" } else { "" },
            error.mean,
            error.ci_low,
            error.ci_high
        );
    }
    html.push_str("</tbody></table></div>\n");
    html
}

/// Error over pairs compared, and time by stage.
pub(super) fn cost(results: &SuiteResults) -> String {
    let plots = error_plots(results, Along::Pairs);
    let mut html = String::new();
    if plots.is_empty() && results.latency.is_empty() {
        return html;
    }
    html.push_str("<h2>What does it cost?</h2>");
    if !plots.is_empty() {
        put!(
            html,
            "<p class=\"hint\">The same errors over the work done: how many pairs of descriptors are \
             compared to locate one image. A method that keeps every visit as an experience compares \
             many times more. Lower and further left is better.</p>{plots}"
        );
    }
    if !results.latency.is_empty() {
        latency(&mut html, results);
    }
    html
}

fn latency(html: &mut String, results: &SuiteResults) {
    let mut stages: Vec<&str> = Vec::new();
    let mut owners: Vec<&str> = Vec::new();
    for entry in &results.latency {
        if !stages.contains(&entry.stage.as_str()) {
            stages.push(&entry.stage);
        }
        if !owners.contains(&entry.of.as_str()) {
            owners.push(&entry.of);
        }
    }
    let sum = |owner: &str| -> f64 {
        let own = results.latency.iter().filter(|entry| entry.of == owner);
        own.map(|entry| entry.ms_p50).sum()
    };
    let largest = owners
        .iter()
        .map(|owner| sum(owner))
        .fold(0.0, f64::max)
        .max(1e-9);
    html.push_str(
        "<h3 style=\"margin-top:26px\">Time of one image by stage</h3><p class=\"hint\">Medians, with \
         the 99th percentile in brackets, in ms.</p><div class=\"scroll\" tabindex=\"0\" \
         role=\"region\" aria-label=\"Time by stage\"><table><thead><tr><th scope=\"col\">Run</th>\
         <th scope=\"col\" class=\"t\">Together</th>",
    );
    for (index, stage) in stages.iter().enumerate() {
        put!(
            html,
            "<th scope=\"col\"><span class=\"swatch c{}\"></span>{}</th>",
            index % 8,
            Esc(stage)
        );
    }
    html.push_str("</tr></thead><tbody>");
    for owner in owners {
        put!(
            html,
            "<tr><td>{}</td><td class=\"t wide\"><div class=\"stack\" role=\"img\" \
             aria-label=\"{} ms in all\" style=\"width:{:.1}%\">",
            Esc(owner),
            short_ms(sum(owner)),
            100.0 * sum(owner) / largest
        );
        let of = |stage: &str| {
            results
                .latency
                .iter()
                .find(|entry| entry.of == owner && entry.stage == stage)
        };
        for (index, stage) in stages.iter().enumerate() {
            if let Some(entry) = of(stage) {
                put!(
                    html,
                    "<span class=\"c{}\" style=\"flex:{:.4}\" title=\"{}: {} ms\"></span>",
                    index % 8,
                    entry.ms_p50,
                    Esc(stage),
                    short_ms(entry.ms_p50)
                );
            }
        }
        html.push_str("</div></td>");
        for stage in &stages {
            match of(stage) {
                Some(entry) => put!(
                    html,
                    "<td>{} <small>({})</small></td>",
                    short_ms(entry.ms_p50),
                    short_ms(entry.ms_p99)
                ),
                None => html.push_str("<td>\u{2013}</td>"),
            }
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table></div>\n");
}

/// Who is mistaken for whom, of the headline's row.
pub(super) fn confusion(results: &SuiteResults) -> String {
    let mut html = String::new();
    let Some((variant, n)) = headline(results).zip(results.detail_n()) else {
        return html;
    };
    let confusion = Confusion::of(&results.queries, &variant.at(n));
    if confusion.places.is_empty() {
        return html;
    }
    put!(
        html,
        "<h2>Which places are mistaken for which?</h2><p class=\"hint\">{}, preset {}, score {}, n = \
         {n}: one row per true place, one column per answer, in images (ties in parts).</p>",
        Esc(label(&variant)),
        Esc(&variant.preset),
        Esc(&variant.score)
    );
    if confusion.places.len() > MAX_MATRIX_PLACES {
        confusion_list(&mut html, &confusion);
    } else {
        confusion_matrix(&mut html, &confusion);
    }
    html
}

fn confusion_matrix(html: &mut String, confusion: &Confusion) {
    let any_silent = confusion.no_answer.iter().any(|&count| count > 0.0);
    html.push_str(
        "<div class=\"scroll\" style=\"display:inline-block;max-width:100%\" tabindex=\"0\" \
         role=\"region\" aria-label=\"Confusion matrix\"><table class=\"confusion\"><thead><tr>\
         <th scope=\"col\">true \\ answer</th>",
    );
    for place in &confusion.places {
        put!(html, "<th scope=\"col\">{}</th>", Esc(place));
    }
    if any_silent {
        html.push_str("<th scope=\"col\">none</th>");
    }
    html.push_str("</tr></thead><tbody>");
    for (truth, counts) in confusion.counts.iter().enumerate() {
        let all = counts.iter().sum::<f64>() + confusion.no_answer[truth];
        put!(
            html,
            "<tr><th scope=\"row\">{}</th>",
            Esc(&confusion.places[truth])
        );
        let mut cell = |count: f64, class: &str| {
            if count > 0.0 {
                let share = 100.0 * count / all;
                put!(
                    html,
                    "<td class=\"{class}\" style=\"--p:{share:.0}\">{}</td>",
                    trimmed(count)
                );
            } else {
                html.push_str("<td></td>");
            }
        };
        for (answer, &count) in counts.iter().enumerate() {
            cell(count, if answer == truth { "hit" } else { "miss" });
        }
        if any_silent {
            cell(confusion.no_answer[truth], "miss");
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table></div>\n");
}

fn confusion_list(html: &mut String, confusion: &Confusion) {
    let mut pairs: Vec<(f64, &str, &str)> = Vec::new();
    for (truth, counts) in confusion.counts.iter().enumerate() {
        for (answer, &count) in counts.iter().enumerate() {
            if count > 0.0 && answer != truth {
                pairs.push((count, &confusion.places[truth], &confusion.places[answer]));
            }
        }
    }
    if pairs.is_empty() {
        html.push_str("<p>No place was mistaken for another.</p>");
        return;
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    html.push_str(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Confusions\"><table>\
         <thead><tr><th scope=\"col\">True place</th><th scope=\"col\" class=\"t\">Answer</th>\
         <th scope=\"col\">Images</th></tr></thead><tbody>",
    );
    for (count, truth, answer) in pairs.iter().take(NUM_LISTED_CONFUSIONS) {
        put!(
            html,
            "<tr><td>{}</td><td class=\"t\">{}</td><td>{}</td></tr>",
            Esc(truth),
            Esc(answer),
            trimmed(*count)
        );
    }
    html.push_str("</tbody></table></div>\n");
}

/// What the words mean.
pub(super) fn foot() -> &'static str {
    "<p>Wrong: the forced first choice is not the true place; k places that share the first rank count \
     1/k right if the true one is among them. Intervals: percentile bootstrap over the images (whole \
     groups of like images where the suite names groups); where all images agree, Wilson\u{2019}s, with \
     an intraclass correlation of 0.2 within groups. \
     Against static: the mean of differences image by image, same draws. Pairs: descriptor comparisons \
     per image. Times exclude decoding and extraction unless a stage says so; compare them only within \
     one machine.</p>"
}

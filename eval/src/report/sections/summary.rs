//! What are all numbers, one n at a time?

use super::names::{colour, interval_text, label};
use crate::judge::rates::PairedDifference;
use crate::report::facts::{short_count, short_ms};
use crate::report::headline::{Headline, baseline};
use crate::report::html::{Esc, put, signed};
use crate::results::{Row, SuiteResults};

/// Every row, one n at a time, with intervals and the paired difference to the baseline.
pub(in crate::report) fn summary(results: &SuiteResults, headline: Option<&Headline>) -> String {
    let mut html = String::new();
    let Some(Headline { n: shown, .. }) = headline else {
        return html;
    };
    put!(
        html,
        "<h2>All numbers</h2><p class=\"hint\">Press a heading to sort. Bold is the shipped default configuration. A tie for the first rank \
         counts in parts. \u{201c}Against static\u{201d} pairs each method with the static map of its \
         preset and score, image by image: \u{25bc} fewer mistakes, \u{25b2} more, \u{2248} not \
         clearly different at 95 %.{}</p>\
         <div class=\"controls\"><label>Features per place, n = \
         <select data-filters=\"rows\"><option value=\"\">all</option>",
        results.tolerance.map_or_else(String::new, |tolerance| {
            let tolerance = tolerance.in_words();
            format!(
                " \u{201c}Within\u{201d} is within {tolerance} of the true place; \u{201c}of it \
                 beyond\u{201d} is how much of what was located is further off."
            )
        })
    );
    for n in results.all_n() {
        let selected = if n == *shown { " selected" } else { "" };
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
    let has_tolerance = results.tolerance.is_some();
    let heads = [
        ("Method", "t", true),
        ("n", "n", true),
        ("Wrong %", "", true),
        ("95 % interval", "t", true),
        ("Right within %", "", has_tolerance),
        ("Located %", "", has_tolerance),
        ("of it beyond %", "", has_tolerance),
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
    if let Some(within) = &row.within {
        let percent = |count: f64, of: u32| 100.0 * count / f64::from(of.max(1));
        for value in [
            percent(within.correct, row.queries),
            percent(f64::from(within.located), row.queries),
            percent(f64::from(within.located_wrong), within.located),
        ] {
            put!(html, "<td data-v=\"{value}\">{value:.1}</td>");
        }
    } else if results.tolerance.is_some() {
        html.push_str("<td></td><td></td><td></td>");
    }
    let pair = baseline(results, variant).and_then(|other| {
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

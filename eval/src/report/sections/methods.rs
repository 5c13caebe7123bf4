//! How do the methods compare, at one n and at a glance?

use super::names::{colour, label};
use crate::judge::decides;
use crate::judge::rates::within;
use crate::report::headline::Headline;
use crate::report::html::{Esc, put};
use crate::results::{Row, SuiteResults, Tolerance, Variant, Within};

/// One line a method of the headline's preset, with the scores side by side; nothing where there is
/// nothing to compare.
pub(super) fn methods(html: &mut String, results: &SuiteResults, headline: &Headline) {
    let of_preset = |variant: &Variant| variant.preset == headline.variant.preset;
    let variants: Vec<Variant> = results.variants().into_iter().filter(of_preset).collect();
    let mut methods: Vec<(&Variant, Vec<&Variant>)> = Vec::new();
    for variant in &variants {
        let same = |known: &Variant| {
            (&known.method, &known.model, known.order)
                == (&variant.method, &variant.model, variant.order)
        };
        match methods.iter_mut().find(|(known, _)| same(known)) {
            Some((_, scores)) => scores.push(variant),
            None => methods.push((variant, vec![variant])),
        }
    }
    let mut scores: Vec<&str> = Vec::new();
    for variant in &variants {
        if !scores.contains(&variant.score.as_str()) {
            scores.push(&variant.score);
        }
    }
    if methods.len() < 2 {
        return;
    }
    head(html, results, headline.n, &scores);
    for (first, of_scores) in &methods {
        put!(
            html,
            "<tr><th scope=\"row\" class=\"t\"><span class=\"swatch c{}\"></span>{}</th>",
            colour(&first.method),
            Esc(label(first))
        );
        for score in &scores {
            let variant = of_scores.iter().find(|variant| variant.score == *score);
            let row = variant.and_then(|variant| results.row(&variant.at(headline.n)));
            cells(html, results, score, row);
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table></div>\n");
}

fn head(html: &mut String, results: &SuiteResults, n: u32, scores: &[&str]) {
    let near = results.tolerance.map(Tolerance::in_words);
    put!(
        html,
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"The methods\">\
         <table class=\"methods\"><thead><tr><th scope=\"col\" class=\"t\" rowspan=\"2\">\
         Method, n = {n}</th>"
    );
    for score in scores {
        let width = 1 + usize::from(near.is_some()) + 2 * usize::from(decides(score));
        put!(
            html,
            "<th scope=\"colgroup\" colspan=\"{width}\">by {}</th>",
            Esc(score)
        );
    }
    html.push_str("</tr><tr>");
    for score in scores {
        html.push_str("<th scope=\"col\">right %</th>");
        if let Some(near) = &near {
            put!(html, "<th scope=\"col\">within {near} %</th>");
        }
        if decides(score) {
            html.push_str("<th scope=\"col\">located %</th><th scope=\"col\">of it wrong %</th>");
        }
    }
    html.push_str("</tr></thead><tbody>");
}

fn cells(html: &mut String, results: &SuiteResults, score: &str, row: Option<&Row>) {
    let mut cell = |value: Option<f64>| match value {
        Some(value) => {
            let is_default = row.is_some_and(|row| row.is_default);
            let class = if is_default { " class=\"best\"" } else { "" };
            put!(html, "<td{class}>{value:.1}</td>");
        }
        None => html.push_str("<td>\u{2013}</td>"),
    };
    cell(row.map(|row| 100.0 - row.wrong_percent()));
    if results.tolerance.is_some() {
        cell(row.and_then(Row::within_percent));
    }
    if decides(score) {
        let of = row.map(|row| of_row(results, row));
        let num = row.map_or(0, |row| row.queries);
        cell(of.map(|of| share(of.located, num)));
        // What is beyond the tolerance, where there is one.
        cell(
            of.filter(|of| of.located > 0)
                .map(|of| match results.tolerance {
                    Some(_) => share(of.located_wrong, of.located),
                    None => share(of.located_wrong_exact, of.located),
                }),
        );
    }
}

/// What the decisions of a row are worth, whether or not the run has a tolerance.
pub(super) fn of_row(results: &SuiteResults, row: &Row) -> Within {
    (row.within).unwrap_or_else(|| within(&results.queries, &row.key()))
}

pub(super) fn share(count: u32, of: u32) -> f64 {
    100.0 * f64::from(count) / f64::from(of.max(1))
}

//! What does an answer cost?

use super::error::{Along, error_plots};
use crate::report::facts::short_ms;
use crate::report::headline::Headline;
use crate::report::html::{Esc, put};
use crate::results::SuiteResults;

/// Error over pairs compared, and time by stage.
pub(in crate::report) fn cost(results: &SuiteResults, headline: Option<&Headline>) -> String {
    let plots = error_plots(results, headline, Along::Pairs);
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

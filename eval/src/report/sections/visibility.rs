//! Are the predicted features there, and how far is p(t) from the truth?

use super::names::{colour, label};
use crate::report::html::{Esc, put};
use crate::results::SuiteResults;

/// Bars of re-observation with whiskers (T-RO, Table I).
pub(in crate::report) fn reobservation(results: &SuiteResults) -> String {
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
pub(in crate::report) fn visibility_errors(results: &SuiteResults) -> String {
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

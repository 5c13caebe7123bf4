//! Which places are mistaken for which?

use super::names::{label, trimmed};
use crate::judge::rates::Confusion;
use crate::report::headline::Headline;
use crate::report::html::{Esc, put};
use crate::results::SuiteResults;

/// More places than this make a matrix that nobody reads: the most frequent confusions are listed.
const MAX_MATRIX_PLACES: usize = 24;

/// How many confusions are listed then.
const NUM_LISTED_CONFUSIONS: usize = 20;

/// Who is mistaken for whom, of the headline's row.
pub(in crate::report) fn confusion(results: &SuiteResults, headline: Option<&Headline>) -> String {
    let mut html = String::new();
    let Some(Headline { variant, n, .. }) = headline else {
        return html;
    };
    let confusion = Confusion::of(&results.queries, &variant.at(*n));
    if confusion.places.is_empty() {
        return html;
    }
    put!(
        html,
        "<h2>Which places are mistaken for which?</h2><p class=\"hint\">{}, preset {}, score {}, n = \
         {n}: one row per true place, one column per answer, in images (ties in parts).</p>",
        Esc(label(variant)),
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

//! Which part of a report shows whether posteriors and decisions can be trusted?

use super::headline::Headline;
use super::html::{Esc, put};
use super::plot::{Point, Scale, Series, SharePlot, nice_axis};
use super::sections::label;
use crate::results::Judgement;
use crate::results::SuiteResults;

/// Colours of the style sheet, one for each score.
const COLOURS: [(&str, usize); 3] = [("likelihood", 1), ("inliers", 3), ("count", 4)];

/// Ends of a line on which confidence is what it says.
const DIAGONAL: [(f64, f64); 2] = [(0.0, 0.0), (100.0, 100.0)];

/// Reliability, precision-recall, decisions; empty where nothing was judged.
pub(super) fn section(results: &SuiteResults, headline: Option<&Headline>) -> String {
    let mut html = String::new();
    let Some((headline, usual_n)) = headline.zip(results.detail_n()) else {
        return html;
    };
    let main = &headline.variant;
    // Not every n is judged.
    let is_judged = results.judgement.iter().any(|it| it.n == headline.n);
    let n = if is_judged { headline.n } else { usual_n };
    // One line per score of the configuration that the report is about.
    let shown: Vec<&Judgement> = (results.judgement.iter())
        .filter(|it| it.n == n && it.part.is_none())
        .filter(|it| it.variant.method == main.method && it.variant.model == main.model)
        .filter(|it| it.variant.preset == main.preset && it.variant.order == main.order)
        .collect();
    if shown.is_empty() {
        return html;
    }
    let has_out_of_map = shown.iter().any(|it| it.out_of_map.is_some());
    put!(
        html,
        "<h2>Can its certainty be trusted?</h2><p class=\"hint\">{} at n = {n}. The posterior is the \
         probability of each place and of being off the map; counts and inliers are calibrated into one as \
         well, so that the scores can be compared. {}</p>",
        Esc(label(main)),
        if has_out_of_map {
            "Foreign queries are images of places that the map lacks; they are mixed in as often as the \
             off-map prior says."
        } else {
            "Every query is of a place in the map."
        }
    );
    numbers(&mut html, &shown);
    html.push_str("<div class=\"grid\">");
    for plot in [reliability, precision_recall, risks] {
        html.push_str(&plot(&shown, &main.score));
    }
    html.push_str("</div>");
    html
}

fn numbers(html: &mut String, shown: &[&Judgement]) {
    html.push_str(
        "<div class=\"scroll\"><table><thead><tr><th>score</th><th>calibration error</th>\
         <th>interval</th><th>Brier</th><th>log loss</th><th>recall@1</th><th>recall@5</th>\
         <th>R@100P</th><th>located %</th><th>of it wrong</th><th>ambiguous %</th><th>unknown %</th>\
         <th>out-of-map accepted %</th></tr></thead><tbody>",
    );
    for it in shown {
        let calibration = it.calibration();
        let error = calibration.expected_error;
        let decisions = &it.in_map.decisions;
        put!(
            html,
            "<tr><td>{}</td><td>{:.3}</td><td>{:.3} to {:.3}</td><td>{:.3}</td><td>{:.3}</td>\
             <td>{:.3}</td><td>{:.3}</td><td>{:.3}</td><td>{:.1}</td><td>{:.1}</td><td>{:.1}</td>\
             <td>{:.1}</td><td>{}</td></tr>",
            Esc(&it.variant.score),
            error.value,
            error.ci_low,
            error.ci_high,
            calibration.brier.value,
            calibration.log_loss.value,
            it.in_map.recall_at_1.value,
            it.in_map.recall_at_5.value,
            it.retrieval().recall_at_full_precision,
            100.0 * decisions.located.share.value,
            100.0 * decisions.located.wrong,
            100.0 * decisions.ambiguous.share.value,
            100.0 * decisions.unknown.share.value,
            it.out_of_map.as_ref().map_or_else(
                || "-".to_owned(),
                |out_of_map| format!("{:.1}", 100.0 * out_of_map.decisions.located.share.value)
            )
        );
    }
    html.push_str("</tbody></table></div>");
}

/// A point in %, without an interval.
fn point(x: f64, y: f64, label: String) -> Point {
    let (x, y) = (100.0 * x, 100.0 * y);
    Point {
        x,
        y,
        low: y,
        high: y,
        label,
    }
}

fn series(
    shown: &[&Judgement],
    main: &str,
    value: impl Fn(&Judgement) -> String,
    points: impl Fn(&Judgement) -> Vec<Point>,
) -> Vec<Series> {
    (shown.iter().enumerate())
        .map(|(style, it)| Series {
            name: it.variant.score.clone(),
            colour: (COLOURS.iter())
                .find(|(score, _)| *score == it.variant.score)
                .map_or(0, |(_, colour)| *colour),
            style,
            is_main: it.variant.score == main,
            value: value(it),
            points: points(it),
        })
        .collect()
}

/// Ticks of a linear axis in %, up to `max`.
fn percent_ticks(max: f64) -> Vec<(f64, String)> {
    let (top, step) = nice_axis(max);
    let count = (top / step).round() as u32;
    (0..=count)
        .map(|i| f64::from(i) * step)
        .map(|value| (value, format!("{value} %")))
        .collect()
}

/// What a reader who sees no picture reads about each line.
fn in_words(series: &[Series]) -> String {
    let in_words: Vec<_> = (series.iter())
        .map(|series| format!("{}: {}", series.name, series.value))
        .collect();
    in_words.join("; ")
}

fn reliability(shown: &[&Judgement], main: &str) -> String {
    let series = series(
        shown,
        main,
        |it| format!("{:.3}", it.calibration().expected_error.value),
        |it| {
            let bins = it.calibration().bins.iter();
            bins.map(|bin| {
                let label = format!(
                    "{:.1} % of the queries are {:.1} % sure and {:.1} % right",
                    100.0 * bin.mass,
                    100.0 * bin.confidence,
                    100.0 * bin.right
                );
                point(bin.confidence, bin.right, label)
            })
            .collect()
        },
    );
    SharePlot {
        title: "How often is the first choice right, as sure as it is?",
        description: format!(
            "Reliability diagram: share of right first choices over their mean posterior, in bins of \
             equal mass; the diagonal is perfect. Expected calibration error: {}.",
            in_words(&series)
        ),
        x_label: "posterior of the first choice",
        x_scale: Scale::Linear,
        y_unit: " %",
        guide: Some(DIAGONAL),
        x_ticks: percent_ticks(100.0),
        series: &series,
        is_lead: false,
        key_title: "calibration error".into(),
        id: "clip-reliability".into(),
    }
    .render()
}

fn precision_recall(shown: &[&Judgement], main: &str) -> String {
    let series = series(
        shown,
        main,
        |it| format!("{:.3}", it.retrieval().average_precision),
        |it| {
            let curve = it.retrieval().curve.iter();
            curve
                .map(|at| {
                    let label = format!(
                        "posterior of {:.3} and more: {:.1} % found, {:.1} % of it right",
                        at.least_confidence,
                        100.0 * at.recall,
                        100.0 * at.precision
                    );
                    point(at.recall, at.precision, label)
                })
                .collect()
        },
    );
    SharePlot {
        title: "How much is found without mistakes?",
        description: format!(
            "Precision in per cent over recall, for falling least posterior. Average precision: {}.",
            in_words(&series)
        ),
        x_label: "recall: accepted and right, of those in the map",
        x_scale: Scale::Linear,
        y_unit: " %",
        guide: None,
        x_ticks: percent_ticks(100.0),
        series: &series,
        is_lead: false,
        key_title: "average precision".into(),
        id: "clip-precision".into(),
    }
    .render()
}

/// Located in-map queries over accepted out-of-map queries, or over wrongly located in-map queries
/// where nobody is out-of-map.
fn risks(shown: &[&Judgement], main: &str) -> String {
    let has_out_of_map = shown.iter().any(|it| it.out_of_map.is_some());
    let bad = |at: &crate::results::AtRisk| at.accepted.unwrap_or(at.located_wrong);
    let what = if has_out_of_map {
        "out-of-map queries accepted"
    } else {
        "located at the wrong place"
    };
    let series = series(
        shown,
        main,
        |it| format!("{:.1} %", 100.0 * it.in_map.decisions.located.share.value),
        |it| {
            (it.risks.iter())
                .map(|at| {
                    let label = format!(
                        "risk {}: {:.1} % located, {:.1} % {what}",
                        at.risk,
                        100.0 * at.located,
                        100.0 * bad(at)
                    );
                    point(bad(at), at.located, label)
                })
                .collect()
        },
    );
    let max =
        (series.iter().flat_map(|series| &series.points)).fold(0.0, |max: f64, p| max.max(p.x));
    let risk = shown.first().map_or(0.0, |it| it.in_map.decisions.risk);
    SharePlot {
        title: "How many are located, at what price?",
        description: format!(
            "Located queries in per cent over {what}, for risks of 0.001 to 0.5. Located at the \
             default risk of {risk}: {}.",
            in_words(&series)
        ),
        x_label: what,
        x_scale: Scale::Linear,
        y_unit: " %",
        guide: None,
        x_ticks: percent_ticks(max),
        series: &series,
        is_lead: false,
        key_title: format!("located at risk {risk}"),
        id: "clip-risks".into(),
    }
    .render()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::judge_all;
    use crate::sample::sample_results;

    fn section_of(results: &SuiteResults) -> String {
        section(results, Headline::of(results).as_ref())
    }

    #[test]
    fn a_judged_run_has_three_plots_with_words_and_another_has_none() {
        let mut results = sample_results();
        results.judgement.clear();
        assert_eq!(section_of(&results), "");
        results.judgement = judge_all(&results, &[]);
        let html = section_of(&results);
        assert_eq!(html.matches("<figure").count(), 3, "{html}");
        assert_eq!(html.matches("role=\"img\" aria-label=\"").count(), 3);
        assert!(html.contains("calibration error") && html.contains("located at the wrong place"));
        for number in html.split(['"', ' ', ',']) {
            assert!(!["NaN", "inf"].contains(&number), "{html}");
        }
    }

    #[test]
    fn out_of_map_queries_change_what_the_price_is() {
        let mut results = sample_results();
        for query in results.queries.iter_mut().step_by(3) {
            query.truth = None;
        }
        results.judgement = judge_all(&results, &[]);
        let html = section_of(&results);
        assert!(html.contains("out-of-map queries accepted"), "{html}");
    }
}

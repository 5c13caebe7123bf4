//! What does a report say first?

use super::methods::{methods, of_row, share};
use super::names::{interval_text, label, trimmed};
use crate::judge::decides;
use crate::report::facts::{header_lines, short_ms};
use crate::report::headline::{Headline, baseline};
use crate::report::html::{Esc, Words, put, signed};
use crate::report::page::run_again;
use crate::results::{Row, SuiteResults};

/// Title, verdict, tiles and where the numbers come from.
pub(in crate::report) fn head(results: &SuiteResults, headline: Option<&Headline>) -> String {
    let mut html = String::new();
    put!(
        html,
        "<h1>Which place is this? Suite {}</h1><p class=\"sub\">{}: {} queries{}{}</p>",
        Esc(&results.suite),
        Esc(&results.dataset),
        results.queries.len(),
        results
            .num_places
            .map_or_else(String::new, |num| format!(", {num} places")),
        match results.split.as_str() {
            "" => String::new(),
            split => format!("; {}", Esc(split)),
        }
    );
    if let Some(headline) = headline
        && let Some(row) = results.row(&headline.variant.at(headline.n))
    {
        verdict(&mut html, results, row, headline);
    }
    run_again(&mut html, &results.command);
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

fn verdict(html: &mut String, results: &SuiteResults, row: &Row, headline: &Headline) {
    let variant = &headline.variant;
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
    if let (Some(tolerance), Some(within)) = (results.tolerance, &row.within) {
        put!(
            html,
            " (within {}: <strong>{} of {}</strong>)",
            tolerance.in_words(),
            trimmed(within.correct),
            row.queries
        );
    }
    let pair = headline.against_static;
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
    if let Some(needs) = headline.static_needs {
        put!(
            html,
            ". To be wrong as seldom, the static map needs <strong>{needs} features</strong> per place"
        );
    }
    html.push_str(".</p>");
    if pair.is_some_and(|pair| pair.points.excludes_zero()) {
        put!(
            html,
            "<p class=\"hint\">n = {} is where the two differ most on these images; every n is below.</p>",
            row.n
        );
    }
    tiles(html, results, row, headline);
}

/// The numbers of the headline, one a tile.
fn tiles(html: &mut String, results: &SuiteResults, row: &Row, headline: &Headline) {
    html.push_str("<div class=\"tiles\">");
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
    if let (Some(tolerance), Some(within), Some(percent)) =
        (results.tolerance, &row.within, row.within_percent())
    {
        tile(
            format!("{percent:.1} %"),
            format!(
                "right within {} ({:.1} to {:.1})",
                tolerance.in_words(),
                within.ci_low,
                within.ci_high
            ),
        );
    }
    located_tile(results, row, &mut tile);
    if let Some(pair) = &headline.against_static {
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
        let of_static = baseline(results, &headline.variant)
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
    methods(html, results, headline);
}

/// How many images a robot would act on, and how often that is wrong; nothing for rows that decide
/// nothing.
fn located_tile(results: &SuiteResults, row: &Row, tile: &mut impl FnMut(String, String)) {
    if !decides(&row.variant.score) || row.queries == 0 {
        return;
    }
    let of = of_row(results, row);
    let what = if of.located == 0 {
        "located: no answer was sure enough to act on".to_owned()
    } else {
        let exact = share(of.located_wrong_exact, of.located);
        // Within a tolerance, what lies beyond it is the mistake; a neighbour is none.
        let wrong = results.tolerance.map_or_else(
            || format!("{exact:.1} % of these are wrong"),
            |tolerance| {
                let far = share(of.located_wrong, of.located);
                let words = tolerance.in_words();
                format!(
                    "{far:.1} % of these are wrong by more than {words}; \
                     {exact:.1} % do not name the very place first"
                )
            },
        );
        format!("located: sure enough to act on; {wrong}")
    };
    tile(format!("{:.1} %", share(of.located, row.queries)), what);
}

/// What the words mean.
pub(in crate::report) fn foot() -> &'static str {
    "<p>Wrong: the forced first choice is not the true place; k places that share the first rank count \
     1/k right if the true one is among them. Intervals: percentile bootstrap over the images (whole \
     groups of like images where the suite names groups); where all images agree, Wilson\u{2019}s, with \
     an intraclass correlation of 0.2 within groups. \
     Located: the answer is given because the probability of being wrong is at most the risk that is \
     allowed, one in twenty unless a suite says otherwise; ambiguous and unknown answers are not. \
     Within a tolerance: a place that is near enough to the true one counts as right too. \
     Against static: the mean of differences image by image, same draws. Pairs: descriptor comparisons \
     per image. Times exclude decoding and extraction unless a stage says so; compare them only within \
     one machine.</p>"
}

//! What does a run of exploration show, so that a stranger sees it in ten seconds?
//!
//! Error over weeks, over the share of time, what the next look is worth, a day of the default (states,
//! p(t), entropy and visits one under the other, as Fig. 4 to 6 of RAS 2016), and all numbers.

use super::html::{Esc, put};
use super::page::{document, run_again};
use super::plot::{Point, Scale, Series, SharePlot, path};
use crate::explore::{Curve, Day, DayPlace, ExploreResults};

const WIDTH: f64 = 480.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 10.0;

/// The report as one HTML document.
pub fn render_explore(results: &ExploreResults) -> String {
    let sections = [
        ("curves", "Over time", curves(results)),
        (
            "day",
            "A day",
            results.day.as_ref().map(day).unwrap_or_default(),
        ),
        ("summary", "All numbers", summary(results)),
    ];
    document(
        &format!("{}: where to look next?", results.suite),
        &head(results),
        &sections,
        "<p>Wrong: states of all places and moments for which p is on the wrong side of 1/2; what the robot is \
         looking at it knows. Intervals: 95 % of the mean over seeds (normal).</p>",
    )
}

fn head(results: &ExploreResults) -> String {
    let mut html = String::new();
    put!(
        html,
        "<h1>Where to look next? Suite {}</h1><p class=\"sub\">{}</p>",
        Esc(&results.suite),
        Esc(&results.title)
    );
    if let Some(row) = results.default_row() {
        match row.bits_an_hour {
            None => put!(
                html,
                "<p class=\"verdict\">By default (<em>{}</em> with <em>{}</em>) <strong>{:.2} %</strong> of all \
                 states are wrong ({:.2} to {:.2}; worst seed {:.2}); knowing the majority of each state from \
                 the start {:.2} %, an oracle that goes where the model is wrong {:.2} %.</p>",
                Esc(&row.strategy),
                Esc(&row.model),
                100.0 * row.error.value,
                100.0 * row.error.low,
                100.0 * row.error.high,
                100.0 * row.worst,
                100.0 * results.majority,
                100.0 * results.oracle
            ),
            Some(bits) => put!(
                html,
                "<p class=\"verdict\">Tours bring <strong>{:.1} bits</strong> an hour ({:.1} to {:.1}), and {} \
                 visits were late{}.</p>",
                bits.value,
                bits.low,
                bits.high,
                row.num_late,
                others(results)
            ),
        }
    }
    run_again(&mut html, &results.command);
    html.push_str("<details><summary>How this was measured</summary><dl class=\"facts\">");
    let mut facts = vec![
        ("Protocol", &results.protocol),
        ("Digest", &results.dataset_sha256),
        ("Commit", &results.commit),
        ("Machine", &results.machine),
        ("Command", &results.command),
    ];
    facts.extend(results.notes.iter().map(|note| ("Note", note)));
    for (name, value) in facts {
        put!(html, "<dt>{name}</dt><dd>{}</dd>", Esc(value));
    }
    html.push_str("</dl></details>");
    html
}

/// What the rows beside the default bring an hour.
fn others(results: &ExploreResults) -> String {
    let others = results.rows.iter().filter(|row| !row.is_default);
    let texts = others.filter_map(|row| {
        let bits = row.bits_an_hour?;
        Some(format!(
            "; {} brings {:.1} ({:.1} to {:.1}), {} late",
            Esc(&row.strategy),
            bits.value,
            bits.low,
            bits.high,
            row.num_late
        ))
    });
    texts.collect()
}

fn curves(results: &ExploreResults) -> String {
    let mut html = String::new();
    let has_errors = results.majority > 0.0;
    html.push_str("<h2>What is wrong, and what is a look worth?</h2><div class=\"grid\">");
    let (title, unit) = match results.days_a_point {
        1 => ("Wrong states over days", "day"),
        _ => ("Wrong states over weeks", "week"),
    };
    let weeks = (results.over_weeks.first()).map_or(0, |curve| curve.points.len());
    let every = weeks.div_ceil(8).max(1);
    let ticks = (1..=weeks).filter(|week| week % every == 0);
    let ticks = ticks.map(|week| (week as f64, week.to_string())).collect();
    plot(&mut html, title, unit, ticks, &results.over_weeks, 100.0);
    let title = if has_errors {
        "Wrong states over the share of time for visits"
    } else {
        "Bits an hour over the share of time"
    };
    let scale = if has_errors { 100.0 } else { 1.0 };
    let ticks = [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| (share, format!("{share}")));
    plot(
        &mut html,
        title,
        "share of time",
        ticks.to_vec(),
        &results.over_share,
        scale,
    );
    if !results.next_look_bits.is_empty() {
        let looks = results.next_look_bits.iter().enumerate();
        let points = looks.step_by(6).map(|(look, &bits)| Point {
            x: look as f64 + 1.0,
            y: bits,
            low: bits,
            high: bits,
            label: format!("look {}: {bits:.2} bits", look + 1),
        });
        let series = [Series {
            name: "default".into(),
            colour: 1,
            style: 0,
            is_main: true,
            value: format!("{:.1} bits", results.next_look_bits[0]),
            points: points.collect(),
        }];
        let last = results.next_look_bits.len();
        let ticks = [1, last / 4, last / 2, last * 3 / 4, last].map(|x| (x as f64, x.to_string()));
        html.push_str(
            &SharePlot {
                title: "What the next look of a day adds, in bits",
                description: "bits of the next look over the number of looks of a day".into(),
                x_label: "looks in a day, a slot each; stop where other work is worth more",
                x_scale: Scale::Linear,
                y_unit: "",
                guide: None,
                x_ticks: ticks.to_vec(),
                series: &series,
                is_lead: false,
                key_title: "first look".into(),
                id: "next".into(),
            }
            .render(),
        );
    }
    html.push_str("</div>\n");
    html
}

fn plot(
    html: &mut String,
    title: &str,
    x_label: &str,
    x_ticks: Vec<(f64, String)>,
    curves: &[Curve],
    scale: f64,
) {
    let unit = if scale > 1.0 { " %" } else { "" };
    let mut series: Vec<Series> = (curves.iter().enumerate())
        .map(|(index, curve)| Series {
            name: curve.name.clone(),
            colour: [1, 2, 4, 0][index % 4],
            style: index,
            is_main: curve.is_default,
            value: (curve.points.last()).map_or(String::new(), |(_, last)| {
                format!("{:.1}{unit}", scale * last.value)
            }),
            points: (curve.points.iter())
                .map(|&(x, measured)| Point {
                    x,
                    y: scale * measured.value,
                    low: scale * measured.low,
                    high: scale * measured.high,
                    label: format!("{x}: {:.2}{unit}", scale * measured.value),
                })
                .collect(),
        })
        .collect();
    let at_the_end = |series: &Series| series.points.last().map_or(0.0, |point| point.y);
    series.sort_by(|a, b| at_the_end(b).total_cmp(&at_the_end(a)));
    html.push_str(
        &SharePlot {
            title,
            description: format!("{title}, strategies and models"),
            x_label,
            x_scale: Scale::Linear,
            y_unit: unit,
            guide: None,
            x_ticks,
            series: &series,
            is_lead: false,
            key_title: "last".into(),
            id: x_label.replace(' ', "-"),
        }
        .render(),
    );
}

fn day(day: &Day) -> String {
    let mut html = String::new();
    put!(
        html,
        "<h2>What did the default believe, and where did it go?</h2><p class=\"hint\">Day {} at the four places \
         that it visited most. Grey: the (first) state was 1. Thick line: p(t) as it was believed at that moment, with \
         all looks until then. Dashed line: its entropy in bits. Bars below: visits.</p><div class=\"grid level\">",
        day.day + 1
    );
    for place in &day.places {
        day_place(&mut html, place);
    }
    html.push_str("</div>\n");
    html
}

fn day_place(html: &mut String, place: &DayPlace) {
    const TOP: f64 = 10.0;
    const BOTTOM: f64 = 120.0;
    const VISITS: f64 = 136.0;
    let px = |hour: f64| LEFT + hour / 24.0 * (WIDTH - LEFT - RIGHT);
    let py = |p: f64| BOTTOM - p * (BOTTOM - TOP);
    put!(
        html,
        "<figure class=\"plot\"><h3>{0}</h3><svg viewBox=\"0 0 {WIDTH} 176\" role=\"img\" aria-label=\"{0}: state, \
         p, entropy and {1} visits of a day\">",
        Esc(&place.name),
        place.visits.len()
    );
    let mut truth = String::new();
    let mut since = None;
    for (&hour, &state) in place.hours.iter().zip(&place.states) {
        match (state, since) {
            (true, None) => since = Some(hour),
            (false, Some(from)) => {
                put!(
                    truth,
                    "M{:.1} {TOP}H{:.1}V{BOTTOM}H{:.1}Z",
                    px(from),
                    px(hour),
                    px(from)
                );
                since = None;
            }
            _ => {}
        }
    }
    if let Some(from) = since {
        put!(
            truth,
            "M{:.1} {TOP}H{:.1}V{BOTTOM}H{:.1}Z",
            px(from),
            px(24.0),
            px(from)
        );
    }
    put!(html, "<path class=\"truth\" d=\"{truth}\"/>");
    for p in [0.0, 0.5, 1.0] {
        put!(
            html,
            "<path class=\"axis\" d=\"M{LEFT} {y:.1}H{}\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{p}</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            py(p) + 4.5,
            y = py(p)
        );
    }
    // 480 points are as many as can be seen.
    let step = (place.hours.len() / 480).max(1);
    let at = |values: &[f64]| -> String {
        let points = place.hours.iter().zip(values).step_by(step);
        path(points.map(|(&hour, &value)| (px(hour), py(value))))
    };
    put!(
        html,
        "<g class=\"series c4\"><path class=\"curve d1\" d=\"{}\"/></g>\
         <g class=\"series c1 main\"><path class=\"curve d0\" d=\"{}\"/></g>",
        at(&place.bits),
        at(&place.p)
    );
    put!(
        html,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">visits</text>",
        LEFT - 6.0,
        VISITS + 4.0
    );
    for &(from, to) in &place.visits {
        put!(
            html,
            "<path class=\"visit\" d=\"M{:.1} {VISITS}H{:.1}\"/>",
            px(from),
            px(to)
        );
    }
    for hour in [0.0, 6.0, 12.0, 18.0, 24.0] {
        put!(
            html,
            "<text x=\"{:.1}\" y=\"166\" text-anchor=\"{}\">{hour} h</text>",
            px(hour),
            if hour > 23.0 { "end" } else { "middle" }
        );
    }
    html.push_str("</svg></figure>\n");
}

fn summary(results: &ExploreResults) -> String {
    let mut html = String::from(
        "<h2>All numbers</h2><div class=\"scroll\" tabindex=\"0\" role=\"region\" \
         aria-label=\"All numbers\"><table class=\"sortable\"><thead><tr><th>strategy</th><th>model</th>\
         <th>wrong, %</th><th>95 %</th><th>worst seed</th><th>published</th><th>bits a visit</th>\
         <th>bits an hour</th><th>driving, s a day</th><th>late</th></tr></thead><tbody>",
    );
    for row in &results.rows {
        put!(
            html,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}{:.2}{}</td><td>{:.2} to {:.2}</td><td>{:.2}</td>\
             <td>{}</td><td>{:.2}</td><td>{}</td><td>{:.0}</td><td>{}</td></tr>",
            Esc(&row.strategy),
            Esc(&row.model),
            if row.is_default { "<strong>" } else { "" },
            100.0 * row.error.value,
            if row.is_default { "</strong>" } else { "" },
            100.0 * row.error.low,
            100.0 * row.error.high,
            100.0 * row.worst,
            (row.published).map_or(String::new(), |it| format!("{:.1}", 100.0 * it)),
            row.bits_a_visit,
            (row.bits_an_hour).map_or(String::new(), |it| format!(
                "{:.1} ({:.1} to {:.1})",
                it.value, it.low, it.high
            )),
            row.travel_s_a_day,
            row.num_late
        );
    }
    html.push_str("</tbody></table></div>\n");
    html
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explore::Row;
    use crate::series::Measured;

    fn sure(value: f64) -> Measured {
        Measured {
            value,
            low: value,
            high: value,
        }
    }

    fn results() -> ExploreResults {
        let row = |strategy: &str, is_default| Row {
            strategy: strategy.into(),
            model: "histogram <persistent>".into(),
            is_default,
            error: sure(0.0408),
            worst: 0.0425,
            published: Some(0.057),
            bits_a_visit: 1.5,
            bits_an_hour: None,
            travel_s_a_day: 0.0,
            num_late: 0,
            num_seeds: 20,
        };
        let curve = Curve {
            name: "information".into(),
            is_default: true,
            points: vec![(1.0, sure(0.06)), (2.0, sure(0.04))],
        };
        ExploreResults {
            schema_version: 1,
            suite: "explore-aruba".into(),
            title: "<b>where?</b>".into(),
            dataset_sha256: "00".into(),
            commit: "none".into(),
            machine: "none".into(),
            command: "chronotope-eval run explore-aruba".into(),
            protocol: "two weeks".into(),
            notes: Vec::new(),
            majority: 0.1,
            oracle: 0.02,
            rows: vec![row("information", true), row("random", false)],
            over_weeks: vec![curve.clone()],
            days_a_point: 7,
            over_share: vec![curve],
            next_look_bits: vec![3.0; 144],
            day: Some(Day {
                day: 6,
                places: vec![DayPlace {
                    name: "kitchen & hall".into(),
                    hours: (0..1_440).map(|minute| f64::from(minute) / 60.0).collect(),
                    states: (0..1_440).map(|minute| minute > 1_000).collect(),
                    p: vec![0.25; 1_440],
                    bits: vec![0.81; 1_440],
                    visits: vec![(3.0, 3.17), (8.0, 8.17)],
                }],
            }),
        }
    }

    #[test]
    fn the_page_shows_the_default_the_day_and_all_rows_and_no_markup_of_the_input() {
        let html = render_explore(&results());
        assert!(html.contains("4.08 %"));
        assert!(html.contains("kitchen &amp; hall"));
        assert!(html.contains("histogram &lt;persistent&gt;") && !html.contains("<b>where"));
        assert_eq!(html.matches("<tr><th scope=\"row\">").count(), 2);
        // Three plots and one day; the state is 1 until the end of the day.
        assert_eq!(html.matches("role=\"img\"").count(), 4);
        assert!(html.contains("H470.0V120H"));
        assert_eq!(html, render_explore(&results()));
    }

    #[test]
    fn without_errors_bits_an_hour_are_shown() {
        let mut results = results();
        results.majority = 0.0;
        results.day = None;
        results.next_look_bits.clear();
        results.rows[0].bits_an_hour = Some(sure(12.5));
        results.rows[1].bits_an_hour = Some(sure(144.5));
        let html = render_explore(&results);
        assert!(html.contains("Bits an hour over the share of time"));
        assert!(html.contains("<strong>12.5 bits</strong>"));
        assert!(html.contains("; random brings 144.5 (144.5 to 144.5), 0 late.</p>"));
    }
}

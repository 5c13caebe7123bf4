//! How does the time of an answer grow with the map?
//!
//! A plain SVG with its own colours for light and dark: two panels over the same places, the stages
//! of one answer above, whole answers below; all axes logarithmic, one line a row of the table.
//! Names stand at the ends of their lines, moved apart where lines end together.

use std::fmt::Write as _;

use super::end_to_end::SECTION;
use super::measurement::SpeedReport;

const WIDTH: f64 = 760.0;
const LEFT: f64 = 76.0;
const TOP: f64 = 12.0;
/// Of a panel: its title, the drawing, the air below it.
const TITLE: f64 = 30.0;
const PANEL: f64 = 250.0;
const BELOW: f64 = 40.0;
const BOTTOM: f64 = 22.0;
/// Between the last point of a line and its name.
const LEADER: f64 = 34.0;
/// The smallest distance of two names, and the widest that a letter is on average, at 13 px.
const LINE: f64 = 17.0;
const LETTER: f64 = 7.0;
/// Approximate searches that find fewer first places say so beside their name.
const GOOD_RECALL: f64 = 0.99;
/// Of a colour-blind safe palette; no panel has more lines than it has colours and markers
/// together.
const COLOURS: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#b0578d", "#8a6d00", "#4da3d8",
];

/// A name and its points: places, ms.
struct Line {
    name: String,
    points: Vec<(f64, f64)>,
}

/// Both panels of the plot.
pub(super) fn growth(report: &SpeedReport) -> String {
    let (whole, stages): (Vec<_>, Vec<_>) = lines_of(report).into_iter().partition(is_whole);
    let panels = [
        ("Stages of one answer, and what is done less often", stages),
        ("Whole answers, features given", whole),
    ];
    let lines = || panels.iter().flat_map(|(_, lines)| lines);
    let places = decades(lines().flat_map(|line| &line.points).map(|point| point.0));
    let right = LEADER + LETTER * lines().map(|line| line.name.len()).max().unwrap_or(0) as f64;
    let num_panels = panels.iter().filter(|(_, lines)| !lines.is_empty()).count();
    let height = TOP + num_panels as f64 * (TITLE + PANEL + BELOW) + BOTTOM;

    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
         aria-label=\"Time of an answer in ms over the number of places, by stage and whole\">\n<style>\
         text{{font:13px sans-serif;fill:#222}}.title{{font-weight:bold}}path{{fill:none;stroke-width:2}}\
         .grid{{stroke:#ddd;stroke-width:1}}.leader{{stroke-width:1;stroke-opacity:.7}}\
         .bg{{fill:#fff}}@media(prefers-color-scheme:dark){{text{{fill:#ddd}}.grid{{stroke:#333}}\
         .bg{{fill:#111}}}}</style>\n<rect class=\"bg\" width=\"{WIDTH}\" height=\"{height}\"/>\n"
    );
    let mut top = TOP;
    for (title, lines) in panels.iter().filter(|(_, lines)| !lines.is_empty()) {
        // Writing to a string cannot fail.
        let _ = writeln!(
            svg,
            "<text class=\"title\" x=\"{LEFT}\" y=\"{:.1}\">{title}</text>",
            top + 15.0
        );
        panel(&mut svg, lines, places, top + TITLE, WIDTH - right);
        top += TITLE + PANEL + BELOW;
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">places</text>\n</svg>",
        f64::midpoint(LEFT, WIDTH - right),
        height - 10.0
    );
    svg
}

/// Grid, lines and names, between `top` and `right`.
fn panel(svg: &mut String, lines: &[Line], places: (f64, f64), top: f64, right: f64) {
    let times = decades(lines.iter().flat_map(|l| &l.points).map(|point| point.1));
    let bottom = top + PANEL;
    let px = |x: f64| LEFT + (x.log10() - places.0) / (places.1 - places.0) * (right - LEFT);
    let py = |y: f64| bottom - (y.log10() - times.0) / (times.1 - times.0) * PANEL;
    for decade in times.0 as i32..=times.1 as i32 {
        let value = 10_f64.powi(decade);
        let y = py(value);
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{right:.1}\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{}</text>",
            LEFT - 8.0,
            y + 4.0,
            duration(value)
        );
    }
    for decade in places.0 as i32..=places.1 as i32 {
        let value = 10_f64.powi(decade);
        let x = px(value);
        let _ = writeln!(
            svg,
            "<path class=\"grid\" d=\"M{x:.1} {top}V{bottom}\"/><text x=\"{x:.1}\" y=\"{}\" \
             text-anchor=\"middle\">{value}</text>",
            bottom + 18.0
        );
    }
    let ends: Vec<f64> = (lines.iter())
        .map(|line| line.points.last().map_or(top, |point| py(point.1)))
        .collect();
    let names = spread(&ends, LINE, (top, bottom));
    for (index, (line, (end, name))) in lines.iter().zip(ends.iter().zip(names)).enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        let mut path = String::new();
        for (i, &(x, y)) in line.points.iter().enumerate() {
            let step = if i == 0 { 'M' } else { 'L' };
            let _ = write!(path, "{step}{:.1} {:.1}", px(x), py(y));
            marker(svg, index, colour, (px(x), py(y)));
            let _ = write!(
                svg,
                "<title>{}, {x} places: {y:.3} ms</title></path>",
                line.name
            );
        }
        let x = line.points.last().map_or(LEFT, |point| px(point.0));
        let _ = writeln!(
            svg,
            "<path stroke=\"{colour}\" d=\"{path}\"/><path class=\"leader\" stroke=\"{colour}\" d=\"M{:.1} {end:.1}\
             L{:.1} {name:.1}H{:.1}\"/><text class=\"name\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            x + 7.0,
            right + LEADER - 12.0,
            right + LEADER - 7.0,
            right + LEADER - 4.0,
            name + 4.0,
            line.name
        );
    }
}

/// The opening tag of a marker at a point; neighbours differ in shape as well.
fn marker(svg: &mut String, index: usize, colour: &str, (x, y): (f64, f64)) {
    let shape = match index % 3 {
        0 => "m-4 0a4 4 0 1 0 8 0a4 4 0 1 0 -8 0z",
        1 => "m-3.5 -3.5h7v7h-7z",
        _ => "m0 -5l5 8.5h-10z",
    };
    let _ = write!(
        svg,
        "<path style=\"fill:{colour}\" d=\"M{x:.1} {y:.1}{shape}\">"
    );
}

/// Where names stand: as near to `wanted` as they can in the same order, at least `distance` apart
/// and within `range` as long as there is room.
fn spread(wanted: &[f64], distance: f64, range: (f64, f64)) -> Vec<f64> {
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|&a, &b| wanted[a].total_cmp(&wanted[b]).then(a.cmp(&b)));
    // Groups that touch: their names, and the mean of where their first one would like to be.
    let mut groups: Vec<(Vec<usize>, f64)> = Vec::new();
    for index in order {
        let mut group = (vec![index], wanted[index]);
        while let Some((above, first)) = groups.pop() {
            let size = above.len() as f64;
            if first + size * distance <= group.1 {
                groups.push((above, first));
                break;
            }
            let num = group.0.len() as f64;
            let mean = (first * size + (group.1 - size * distance) * num) / (size + num);
            let room = range.1 - distance * (size + num - 1.0);
            group = ([above, group.0].concat(), mean.min(room).max(range.0));
        }
        groups.push(group);
    }
    let mut placed = vec![0.0; wanted.len()];
    for (group, first) in groups {
        for (step, index) in group.into_iter().enumerate() {
            placed[index] = first + step as f64 * distance;
        }
    }
    placed
}

/// The powers of ten around all values; of none, one decade.
fn decades(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(x), high.max(x))
    });
    if !low.is_finite() {
        return (0.0, 1.0);
    }
    let low = low.log10().floor();
    (low, high.log10().ceil().max(low + 1.0))
}

/// `10 µs`, `1 ms`, `10 s`.
fn duration(ms: f64) -> String {
    if ms < 0.5 {
        format!("{} µs", (ms * 1e3).round())
    } else if ms < 500.0 {
        format!("{} ms", ms.round())
    } else {
        format!("{} s", (ms / 1e3).round())
    }
}

fn is_whole(line: &Line) -> bool {
    line.name.starts_with("whole") || line.name.contains("batch")
}

/// One line for each stage, in the order of the table. A stage that is a difference of two times
/// and came out as nothing has no place on a logarithmic axis.
fn lines_of(report: &SpeedReport) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    let mut recalls: Vec<Option<f64>> = Vec::new();
    for row in (report.measurements.iter()).filter(|row| row.section == SECTION) {
        let num_places = (row.case.split(' ').next()).and_then(|word| word.parse().ok());
        let Some(places) = num_places.filter(|_| row.ms_p50 > 0.0) else {
            continue;
        };
        let known = lines.iter().position(|line| line.name == row.subject);
        let index = known.unwrap_or_else(|| {
            lines.push(Line {
                name: row.subject.clone(),
                points: Vec::new(),
            });
            recalls.push(None);
            lines.len() - 1
        });
        lines[index].points.push((places, row.ms_p50));
        recalls[index] = row.recall;
    }
    for (line, recall) in lines.iter_mut().zip(recalls) {
        if let Some(recall) = recall.filter(|&recall| recall < GOOD_RECALL) {
            let _ = write!(line.name, " ({:.0} % found)", recall * 100.0);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use proptest::prelude::*;

    use super::*;

    /// The run that is kept with the sources; `CHRONOTOPE_WRITE_GROWTH=1` draws its picture again.
    #[test]
    fn names_of_the_kept_run_are_apart_and_inside() {
        let record = Path::new(env!("CARGO_MANIFEST_DIR")).join("record");
        let report = super::super::read(&record.join("speed.json")).unwrap();
        let svg = growth(&report);
        let number = |text: &str, key: &str| -> f64 {
            let at = text.split(&format!(" {key}=\"")).nth(1).unwrap();
            at.split('"').next().unwrap().parse().unwrap()
        };
        let height = number(svg.split("<rect").nth(1).unwrap(), "height");
        let mut names: Vec<(f64, &str)> = Vec::new();
        for text in svg.split("<text class=\"name\"").skip(1) {
            let name = text.split(['>', '<']).nth(1).unwrap();
            let (x, y) = (number(text, "x"), number(text, "y"));
            assert!(x + LETTER * name.len() as f64 <= WIDTH + 0.1, "{name}");
            assert!(y > 0.0 && y < height, "{name}");
            names.push((y, name));
        }
        assert!(names.len() > 8, "{names:?}");
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        for pair in names.windows(2) {
            assert!(pair[1].0 - pair[0].0 >= LINE - 0.11, "{pair:?}");
        }
        if std::env::var_os("CHRONOTOPE_WRITE_GROWTH").is_some() {
            std::fs::write(record.join("growth.svg"), svg).unwrap();
        }
    }

    proptest! {
        #[test]
        fn spread_names_keep_their_order_their_distance_and_the_panel(
            wanted in proptest::collection::vec(100.0..350.0, 1..12)
        ) {
            let placed = spread(&wanted, 17.0, (100.0, 350.0));
            for (i, a) in placed.iter().enumerate() {
                prop_assert!((100.0..=350.0 + 1e-9).contains(a));
                for (j, b) in placed.iter().enumerate().skip(i + 1) {
                    prop_assert!((a - b).abs() >= 17.0 - 1e-9);
                    prop_assert!(wanted[i] == wanted[j] || (wanted[i] < wanted[j]) == (a < b));
                }
            }
        }

        #[test]
        fn names_that_are_apart_stay_where_their_lines_end(first in 100.0..120.0) {
            let wanted = [first + 60.0, first, first + 17.5];
            prop_assert_eq!(spread(&wanted, 17.0, (100.0, 350.0)), wanted);
        }
    }
}

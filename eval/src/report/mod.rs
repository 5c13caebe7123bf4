//! What did a run find, so that a stranger sees it in ten seconds?
//!
//! [`render`] makes one HTML file of a run: what was found in one sentence, error over n, the summary
//! with intervals, what the methods saw, their mistakes and their cost. The file needs no network
//! (its content policy forbids it), follows the reader's light or dark mode, fits a phone, and tells
//! things apart by shape as well as by colour (palette of Okabe and Ito 2008, darkened or lightened
//! where the contrast needs it). Every number comes from [`SuiteResults`]; every picture is given by
//! the caller. Text of the input is escaped everywhere.

mod html;
mod judgement;
mod pictures;
mod plot;
mod raster;
mod sections;
mod series;

use std::path::Path;

use chronotope::Result;
use chronotope::feature::GrayImage;
use chronotope::trace::SpectrumSummary;

use crate::results::{SuiteResults, write_atomically};
use html::{Esc, put};
pub use series::{render_series, write_series};

/// What became of a feature in a live image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FeatureClass {
    /// Predicted and found.
    Matched,
    /// Predicted, but not found.
    Missing,
    /// Seen, but not predicted.
    Unexpected,
}

/// A feature to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PicturedFeature {
    /// Column of the centre, px.
    pub x: f32,
    /// Row of the centre, px.
    pub y: f32,
    /// Diameter, px.
    pub size: f32,
    /// What became of it.
    pub class: FeatureClass,
    /// Predicted visibility, 0 to 1; not used for unexpected features.
    pub probability: f32,
}

/// A live image with what was predicted for it.
#[derive(Clone, Debug)]
pub struct FeaturePicture {
    /// The live image.
    pub image: GrayImage,
    /// Place and time, and how much of the prediction came true.
    pub title: String,
    /// What was decided, and why; nothing where it is empty.
    pub note: String,
    /// Its features, and the predicted ones that it lacks.
    pub features: Vec<PicturedFeature>,
}

/// What the horizontal axis of a [`ProbabilityCurve`] counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeAxis {
    /// Seconds since 1970-01-01T00:00:00Z.
    UnixSeconds,
    /// The number of the visit: the dataset has no clock.
    VisitIndex,
}

/// One visit of a feature's place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// In the unit of the curve's axis.
    pub time: f64,
    /// Whether the feature was seen; `None` where it could not be observed.
    pub seen: Option<bool>,
}

/// Predicted visibility of one feature over its observations (T-RO, Fig. 1).
#[derive(Clone, Debug)]
pub struct ProbabilityCurve {
    /// Which feature of which place.
    pub title: String,
    /// Unit of all times here.
    pub axis: TimeAxis,
    /// What was observed, in any order.
    pub observations: Vec<Observation>,
    /// Time and p(t), ascending in time.
    pub curve: Vec<(f64, f64)>,
    /// When the query was taken.
    pub query_time: Option<f64>,
    /// The rhythms of the observations; without frequencies it is not drawn.
    pub spectrum: SpectrumSummary,
}

/// What was seen of one place, feature by feature and visit by visit, over what is predicted.
#[derive(Clone, Debug)]
pub struct Raster {
    /// The place.
    pub place: String,
    /// How many features it has; the rows are some of them.
    pub num_features: usize,
    /// Unit of the visits' times.
    pub axis: TimeAxis,
    /// The visits, ascending.
    pub times: Vec<f64>,
    /// From top to bottom.
    pub rows: Vec<RasterRow>,
}

/// One feature of a [`Raster`], with as many entries as there are visits.
#[derive(Clone, Debug)]
pub struct RasterRow {
    /// Its number.
    pub feature: usize,
    /// Whether it was seen; `None` where it could not be observed.
    pub seen: Vec<Option<bool>>,
    /// p(t).
    pub p: Vec<f64>,
}

/// An image of the mistakes' gallery.
#[derive(Clone, Debug)]
pub struct GalleryImage {
    /// The picture; none where the place has no image to show.
    pub image: Option<GrayImage>,
    /// Place and time.
    pub caption: String,
}

/// A wrong answer next to the right one.
#[derive(Clone, Debug)]
pub struct Mistake {
    /// Query and why it is listed, such as how sure the wrong answer was.
    pub title: String,
    /// The image that was asked.
    pub query: GalleryImage,
    /// An image of the true place.
    pub truth: GalleryImage,
    /// An image of the place that was answered.
    pub answered: GalleryImage,
}

/// The pictures of a report; what is empty is left out of it.
#[derive(Clone, Debug, Default)]
pub struct Pictures {
    /// Predicted features in live images.
    pub features: Vec<FeaturePicture>,
    /// p(t) of a few features.
    pub curves: Vec<ProbabilityCurve>,
    /// Features and visits of one place.
    pub raster: Option<Raster>,
    /// Worst first.
    pub mistakes: Vec<Mistake>,
}

/// All that a report shows.
#[derive(Clone, Copy, Debug)]
pub struct ReportInput<'a> {
    /// The run.
    pub results: &'a SuiteResults,
    /// Its pictures.
    pub pictures: &'a Pictures,
}

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// Nothing may be loaded: what the file needs, it holds.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// The report as one HTML document. Fails on pictures that are no images.
pub fn render(input: &ReportInput<'_>) -> Result<String> {
    let results = input.results;
    let sections = [
        ("error", "Error", sections::error_over_n(results)),
        ("summary", "All numbers", sections::summary(results)),
        (
            "features",
            "Prediction",
            pictures::features(&input.pictures.features)?,
        ),
        (
            "visibility",
            "Visibility",
            pictures::curves(&input.pictures.curves)
                + &raster::section(input.pictures.raster.as_ref()),
        ),
        (
            "reobservation",
            "Re-observation",
            sections::reobservation(results),
        ),
        ("judgement", "Trust", judgement::section(results)),
        ("truth", "Truth", sections::visibility_errors(results)),
        ("cost", "Cost", sections::cost(results)),
        ("confusion", "Confusion", sections::confusion(results)),
        (
            "mistakes",
            "Mistakes",
            pictures::mistakes(&input.pictures.mistakes)?,
        ),
    ];
    let title = format!("{}: which place is this?", results.suite);
    Ok(document(
        &title,
        &sections::head(results),
        &sections,
        sections::foot(),
    ))
}

/// A page of sections (id, name, body), of which the empty ones are left out.
fn document(title: &str, head: &str, sections: &[(&str, &str, String)], foot: &str) -> String {
    let shown = || sections.iter().filter(|(_, _, body)| !body.is_empty());
    let mut html = String::new();
    put!(
        html,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>Chronotope, suite {}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n",
        Esc(title)
    );
    put!(html, "<header>{head}<nav aria-label=\"Sections\">");
    for (id, name, _) in shown() {
        put!(html, "<a href=\"#{id}\">{name}</a>");
    }
    html.push_str("</nav></header>\n<main>\n");
    for (id, _, body) in shown() {
        put!(html, "<section id=\"{id}\">\n{body}</section>\n");
    }
    put!(
        html,
        "</main>\n<footer>{foot}</footer>\n<script>{SCRIPT}</script>\n</body>\n</html>\n"
    );
    html
}

/// Renders the report into `path`; a reader finds the old file or the new one, never a part.
pub fn write(input: &ReportInput<'_>, path: &Path) -> Result<()> {
    let html = render(input).map_err(|error| error.with_path(path))?;
    write_atomically(path, html.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// `--name:#hex` of a rule of the style sheet.
    fn variables(rule: &str) -> BTreeMap<&str, &str> {
        rule.split(['{', ';', '}'])
            .filter_map(|part| part.trim().strip_prefix("--")?.split_once(":#"))
            .collect()
    }

    /// Relative luminance (WCAG 2).
    fn luminance(hex: &str) -> f64 {
        let hex = if hex.len() == 3 {
            hex.chars().flat_map(|c| [c, c]).collect()
        } else {
            hex.to_owned()
        };
        let channel = |at: usize| {
            let value = f64::from(u8::from_str_radix(&hex[at..at + 2], 16).unwrap()) / 255.0;
            if value <= 0.040_45 {
                value / 12.92
            } else {
                ((value + 0.055) / 1.055).powf(2.4)
            }
        };
        0.2126 * channel(0) + 0.7152 * channel(2) + 0.0722 * channel(4)
    }

    fn contrast(a: &str, b: &str) -> f64 {
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn text_and_lines_stand_out_in_light_and_dark() {
        let mut rules = STYLE.split(":root").skip(1);
        let light = variables(rules.next().unwrap().split_once('}').unwrap().0);
        let dark = variables(rules.next().unwrap().split_once('}').unwrap().0);
        for (mode, colours) in [("light", light), ("dark", dark)] {
            for background in ["bg", "card"] {
                for text in ["ink", "muted", "accent", "good", "bad"] {
                    let ratio = contrast(colours[text], colours[background]);
                    assert!(ratio >= 4.5, "{mode}: {text} on {background}: {ratio:.2}");
                }
                for line in 0..8 {
                    let ratio = contrast(colours[format!("c{line}").as_str()], colours[background]);
                    assert!(ratio >= 3.0, "{mode}: c{line} on {background}: {ratio:.2}");
                }
            }
        }
    }
}

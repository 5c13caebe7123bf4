//! What did a run find, so that a stranger sees it in ten seconds?
//!
//! [`render`] makes one HTML file of a run: what was found in one sentence, error over n, the
//! summary with intervals, what the methods saw, their mistakes and their cost. The file needs no
//! network (its content policy forbids it), follows the reader's light or dark mode, fits a phone,
//! and distinguishes things by shape as well as by colour (palette of Okabe and Ito 2008, darkened
//! or lightened where the contrast needs it). Every number comes from [`SuiteResults`]; every
//! picture is given by the caller. Text of the input is escaped everywhere.

mod axis;
mod content;
mod curves;
mod explore;
mod facts;
mod grid;
mod headline;
mod html;
mod judgement;
mod page;
mod pictures;
mod plot;
mod raster;
mod sections;
mod series;
mod showcase;
mod spectrum;
pub mod terminal;

use std::path::Path;

use chronotope::Result;

use crate::results::{SuiteResults, write_atomically};
pub use content::{
    FeatureClass, FeaturePicture, GalleryImage, Mistake, ObservedState, PicturedFeature, Pictures,
    ProbabilityCurve, Raster, RasterRow, TimeAxis,
};
pub use explore::render_explore;
pub use grid::render_grid;
use headline::Headline;
use page::document;
pub use series::render_series;
pub use showcase::pictures;

/// All that a report shows.
#[derive(Clone, Copy, Debug)]
pub struct ReportInput<'a> {
    /// The numbers of the run.
    pub results: &'a SuiteResults,
    /// The pictures that are drawn of it.
    pub pictures: &'a Pictures,
}

/// The report as one HTML document. Fails on pictures that are no images.
pub fn render(input: &ReportInput<'_>) -> Result<String> {
    let results = input.results;
    let headline = Headline::of(results);
    let headline = headline.as_ref();
    let sections = [
        ("error", "Error", sections::error_over_n(results, headline)),
        (
            "summary",
            "All numbers",
            sections::summary(results, headline),
        ),
        (
            "features",
            "Prediction",
            self::pictures::features(&input.pictures.features)?,
        ),
        (
            "visibility",
            "Visibility",
            curves::curves(&input.pictures.curves)
                + &raster::section(input.pictures.raster.as_ref()),
        ),
        (
            "reobservation",
            "Re-observation",
            sections::reobservation(results),
        ),
        ("judgement", "Trust", judgement::section(results, headline)),
        ("truth", "Truth", sections::visibility_errors(results)),
        ("cost", "Cost", sections::cost(results, headline)),
        (
            "confusion",
            "Confusion",
            sections::confusion(results, headline),
        ),
        (
            "mistakes",
            "Mistakes",
            self::pictures::mistakes(&input.pictures.mistakes)?,
        ),
    ];
    let title = format!("{}: which place is this?", results.suite);
    Ok(document(
        &title,
        &sections::head(results, headline),
        &sections,
        sections::foot(),
    ))
}

/// Renders the report into `path`; a reader finds the old file or the new one, never a part.
pub fn write(input: &ReportInput<'_>, path: &Path) -> Result<()> {
    let html = render(input).map_err(|error| error.with_path(path))?;
    write_atomically(path, html.as_bytes())
}

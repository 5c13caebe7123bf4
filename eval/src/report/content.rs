//! What can the pictures of a report show?

use chronotope::feature::GrayImage;
use chronotope::trace::SpectrumSummary;

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
pub struct ObservedState {
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
    pub observations: Vec<ObservedState>,
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
    /// The place whose features are shown.
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
    /// The number of the feature at its place.
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
    /// The image that was queried.
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
    /// Wrong answers, the worst one first.
    pub mistakes: Vec<Mistake>,
}

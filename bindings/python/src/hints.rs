//! What does a type checker read where Rust takes or gives any object?
//!
//! Each type here is a Python object with a name in `chronotope._types`, which the generated stub
//! shows.

use pyo3::inspect::PyStaticExpr;
use pyo3::prelude::*;
use pyo3::type_hint_identifier;
use std::convert::Infallible;

macro_rules! arguments {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {$(
        $(#[$doc])*
        pub(crate) struct $name<'py>(pub(crate) Bound<'py, PyAny>);

        impl<'py> FromPyObject<'_, 'py> for $name<'py> {
            type Error = PyErr;
            const INPUT_TYPE: PyStaticExpr =
                type_hint_identifier!("chronotope._types", stringify!($name));

            fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
                Ok(Self(object.to_owned()))
            }
        }
    )*};
}

macro_rules! answers {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {$(
        $(#[$doc])*
        pub(crate) struct $name<'py>(pub(crate) Bound<'py, PyAny>);

        impl<'py> IntoPyObject<'py> for $name<'py> {
            type Target = PyAny;
            type Output = Bound<'py, PyAny>;
            type Error = Infallible;
            const OUTPUT_TYPE: PyStaticExpr =
                type_hint_identifier!("chronotope._types", stringify!($name));

            fn into_pyobject(self, _py: Python<'py>) -> Result<Self::Output, Self::Error> {
                Ok(self.0)
            }
        }
    )*};
}

arguments! {
    /// An image: array, PIL image, path, or features.
    ImageLike,
    /// An image of pixels.
    PixelsLike,
    /// Several of them.
    ImagesLike,
    /// Pixels that may be used.
    MaskLike,
    /// A moment.
    TimeLike,
    /// Several of them.
    TimesLike,
    /// A dictionary as JSON has it.
    ConfigLike,
    /// A path of the file system.
    PathLike,
    /// A map, or the path of one.
    MapLike,
    /// Whether and how progress is shown.
    ProgressLike,
    /// Points, one a row.
    PointsLike,
    /// Descriptors, one a row.
    DescriptorsLike,
    /// A map of cells: an array, or the path of one.
    CellsLike,
    /// A grid, or the path of one.
    GridLike,
    /// Numbers.
    FloatsLike,
    /// Names of places, perhaps with numbers of states.
    PlacesLike,
    /// What is explored: series, a map, or the path of one.
    ExploredLike,
    /// 0/1 states of one place.
    LookLike,
    /// Microseconds.
    Microseconds,
    /// 0, 1 or -1.
    States,
    /// int32.
    Codes,
}

answers! {
    /// float32, (n, 2).
    Points,
    /// float32, (n,).
    Strengths,
    /// uint8, (n, 32).
    Descriptors,
    /// float64, (n,).
    Numbers,
    /// float64, (n, 3).
    Triples,
    /// float32 of a grid's shape.
    Probabilities,
    /// int8 of a grid's shape.
    Occupancy,
    /// Of a cell: its index in an array.
    Index,
    /// Metres.
    Point,
    /// uint32, (n,).
    Ids,
    /// int64, (n,).
    Stamps,
    /// int8, (n,).
    Ternary,
    /// uint8, (height, width).
    Picture,
    /// A list of bytes.
    ByteStrings,
    /// The matches of an answer, structured.
    Matches,
    /// What json.loads gives.
    Json,
    /// A moment in UTC.
    Moment,
    /// A moment in UTC, where known.
    MaybeMoment,
    /// Results, and exceptions where they were asked for.
    Answers,
}

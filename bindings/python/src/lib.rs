//! How is the engine used from Python?
//!
//! The private module `chronotope._chronotope`: classes over the rooms of the engine and nothing that
//! computes by itself. What is written in Python stands beside it in `python/chronotope`: exceptions,
//! times, pictures in notebooks, and the estimators of `chronotope.series`.
//!
//! Everything that takes longer than a millisecond lets go of the interpreter's lock; what takes long
//! hears Ctrl-C.

mod answer;
mod explore;
mod explorer;
mod failure;
mod features;
mod fleet;
mod grid;
mod grid_answer;
mod grid_cells;
mod grid_changes;
mod grid_json;
mod grid_office;
mod grid_robot;
mod grid_state;
mod hints;
mod image;
mod learn_folder;
mod learner;
mod localizer;
mod log;
mod map;
mod map_changes;
mod map_json;
mod progress;
mod python;
mod robot;
mod series;
mod settings;
mod street;

/// The engine of `chronotope`; use that package.
#[pyo3::pymodule]
mod _chronotope {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::answer::{PyCandidate, PyLocalization};
    #[pymodule_export]
    use crate::explore::{
        PySimulation, PyTour, explore_next, explore_plan, explore_prospects, explore_simulate,
        explore_tour,
    };
    #[pymodule_export]
    use crate::explorer::{PyExplorer, PyProspect, PyVisit};
    #[pymodule_export]
    use crate::features::{PyFeatures, address_of, extract};
    #[pymodule_export]
    use crate::fleet::{
        compact, evaluate_visits, join_maps, merge_sums, predict_models, sum_visits,
    };
    #[pymodule_export]
    use crate::grid::PyGrid;
    #[pymodule_export]
    use crate::grid_answer::{PyCellExplanation, PyObserved, PyVerdict};
    #[pymodule_export]
    use crate::grid_office::PyOffice;
    #[pymodule_export]
    use crate::grid_robot::{PyGridLocalizer, PyGridPath, PyPoseEstimate};
    #[pymodule_export]
    use crate::learner::PyLearner;
    #[pymodule_export]
    use crate::localizer::PyLocalizer;
    #[pymodule_export]
    use crate::map::{PyMap, PyPlace, PyPredictedMap, PyReport, exif_time};
    #[pymodule_export]
    use crate::robot::{PyRobot, PyTracker};
    #[pymodule_export]
    use crate::series::{PySeriesModel, calendar, parse_time, parse_times, periodogram, read_csv};
    #[pymodule_export]
    use crate::street::PyStreet;

    #[pymodule_init]
    fn init(_py: Python<'_>) -> PyResult<()> {
        crate::log::listen();
        // What an unknown kernel is called is said once, at once.
        let kernel = chronotope::simd::Kernel::from_env().map_err(crate::failure::Failure::from)?;
        tracing::debug!(kernel = kernel.name(), "matching");
        Ok(())
    }
}

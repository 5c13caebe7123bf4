//! How much of a map contradicts a prediction?

use crate::cells::{CellState, OccupancyMap, Thresholds};
use crate::localize::DistanceField;

/// What two maps of the same cells say about each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The share of cells that were predicted wrongly, each weighed by how sure the prediction was. A
    /// surface that lies one cell beside the predicted one is no contradiction: that is the laser's
    /// noise.
    pub disagreement: f64,
    /// The disagreement to be expected if the prediction's probabilities are right.
    pub expected: f64,
    /// Cells that were compared: known to both, and near a surface of either. (In the middle of
    /// free space everything agrees, which would hide failures.)
    pub num_compared: usize,
    /// New surfaces: occupied although predicted free, and not beside a predicted surface.
    pub appeared: Vec<usize>,
    /// Lost surfaces: free although predicted occupied, and no surface beside it.
    pub vanished: Vec<usize>,
}

/// Cells up to so many cells away from a surface are near it.
const REACH_CELLS: f64 = 2.5;
/// A surface in the next cell, straight or diagonal, is the same surface.
const SAME_CELLS: f64 = 1.5;

/// Compares an observed map with the predicted one. Both have the same cells; otherwise nothing is
/// compared.
pub fn compare(
    predicted: &OccupancyMap,
    observed: &OccupancyMap,
    thresholds: Thresholds,
) -> Comparison {
    let mut comparison = Comparison {
        disagreement: 0.0,
        expected: 0.0,
        num_compared: 0,
        appeared: Vec::new(),
        vanished: Vec::new(),
    };
    let spec = predicted.spec();
    if spec != observed.spec() {
        return comparison;
    }
    let reach_m = REACH_CELLS * spec.resolution_m();
    let same_m = SAME_CELLS * spec.resolution_m();
    let expected = DistanceField::new(predicted, thresholds, 2.0 * reach_m);
    let found = DistanceField::new(observed, thresholds, 2.0 * reach_m);
    let (mut wrong, mut doubtful, mut all) = (0.0, 0.0, 0.0);
    for index in 0..spec.num_cells() {
        if expected.of_cell(index) > reach_m && found.of_cell(index) > reach_m {
            continue;
        }
        let (Some(p), Some(_)) = (predicted.get(index), observed.get(index)) else {
            continue;
        };
        let states = [predicted, observed].map(|map| map.state(index, thresholds));
        if !(states[0].is_known() && states[1].is_known()) {
            continue;
        }
        let sureness = f64::from((2.0 * p - 1.0).abs());
        all += sureness;
        // What is beside a predicted surface is excused, whether it is one or not.
        if states[0] == CellState::Occupied || expected.of_cell(index) > same_m {
            doubtful += sureness * f64::from(p.min(1.0 - p));
        }
        comparison.num_compared += 1;
        if states[0] == states[1] {
            continue;
        }
        if states[1] == CellState::Free {
            if found.of_cell(index) > same_m {
                wrong += sureness;
                comparison.vanished.push(index);
            }
        } else if expected.of_cell(index) > same_m {
            wrong += sureness;
            comparison.appeared.push(index);
        }
    }
    if all > 0.0 {
        comparison.disagreement = wrong / all;
        comparison.expected = doubtful / all;
    }
    comparison
}

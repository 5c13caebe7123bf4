//! How has a map to be moved to lie on another?

use fremen::{Error, ErrorKind, Result};
use rayon::prelude::*;

use crate::cells::{CellState, OccupancyMap, Thresholds};
use crate::localize::DistanceField;
use crate::pose::{Pose2, wrap};

/// Which motions are tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Shifts along x and y, at most.
    pub max_shift_m: f64,
    /// Turns, at most.
    pub max_turn_rad: f64,
    /// Surfaces of the new map that are compared, at most.
    pub num_points: usize,
    /// What counts as a surface.
    pub thresholds: Thresholds,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            max_shift_m: 0.6,
            max_turn_rad: 0.09,
            num_points: 1_000,
            thresholds: Thresholds::default(),
        }
    }
}

/// How a map lies on another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// How the new map is moved: a turn about zero, then a shift.
    pub motion: Pose2,
    /// How far its surfaces move by that on average.
    pub shift_m: f64,
    /// How well its surfaces lie on those of the other map after that, from 0 to 1.
    pub score: f64,
    /// How well they do without it.
    pub score_before: f64,
}

/// Steps of the first search: as large as the kernel of its score is wide.
const COARSE_CELLS: f64 = 2.0;
/// Width of the last kernel.
const FINE_CELLS: f64 = 1.0;
/// How often the steps of the last search are halved: to a sixteenth of a cell.
const NUM_HALVINGS: i32 = 5;

/// The small motion that lays the surfaces of `new` onto those of `base`.
///
/// A grid of shifts and turns is searched by the mean of a narrow kernel of the distances, so that
/// what has changed does not pull; the best is refined by steps that become smaller. Both maps are
/// in the same frame; their cells may differ.
///
/// # Errors
/// [`ErrorKind::NotFound`] where one of them has no surface.
pub fn register(base: &OccupancyMap, new: &OccupancyMap, search: &Search) -> Result<Registration> {
    let points = surface_points(new, search)?;
    let cell_m = base.spec().resolution_m();
    let coarse_m = COARSE_CELLS * cell_m;
    let field = DistanceField::new(base, search.thresholds, 4.0 * coarse_m);
    if (0..base.spec().num_cells()).all(|index| field.of_cell(index) > 0.0) {
        return Err(no_surface("the map to lie on"));
    }
    let center = center_of(&points);
    // The turn that moves the outermost points by one step.
    let reach = (points.iter())
        .map(|p| (p[0] - center[0]).hypot(p[1] - center[1]))
        .fold(cell_m, f64::max);
    let turn_step = coarse_m / reach;
    let shifts = (search.max_shift_m / coarse_m).ceil() as i64;
    let turns = (search.max_turn_rad / turn_step).ceil() as i64;
    let side = 2 * shifts + 1;
    let tried: Vec<([f64; 3], f64)> = (0..side * side * (2 * turns + 1))
        .into_par_iter()
        .map(|number| {
            let at = [
                (number % side - shifts) as f64 * coarse_m,
                (number / side % side - shifts) as f64 * coarse_m,
                (number / side / side - turns) as f64 * turn_step,
            ];
            (at, score(&field, &points, center, at, coarse_m))
        })
        .collect();
    let still = [0.0; 3];
    let mut best = (still, score(&field, &points, center, still, coarse_m));
    for (at, value) in tried {
        if value > best.1 {
            best = (at, value);
        }
    }
    let fine_m = FINE_CELLS * cell_m;
    let at = refine(
        &field,
        &points,
        center,
        best.0,
        [coarse_m, turn_step, fine_m],
    );
    let motion = about(center, at);
    let shift_m = (points.iter())
        .map(|point| {
            let [x, y] = motion.place(*point);
            (x - point[0]).hypot(y - point[1])
        })
        .sum::<f64>()
        / points.len() as f64;
    Ok(Registration {
        motion,
        shift_m,
        score: score(&field, &points, center, at, fine_m),
        score_before: score(&field, &points, center, still, fine_m),
    })
}

fn no_surface(what: &str) -> Error {
    Error::new(ErrorKind::NotFound, format!("{what} has no surface"))
        .with_help("a map needs occupied cells to be laid on another")
}

/// Evenly over all surfaces.
fn surface_points(map: &OccupancyMap, search: &Search) -> Result<Vec<[f64; 2]>> {
    let spec = map.spec();
    let occupied: Vec<usize> = (0..spec.num_cells())
        .filter(|&index| map.state(index, search.thresholds) == CellState::Occupied)
        .collect();
    let count = occupied.len().min(search.num_points);
    if count == 0 {
        return Err(no_surface("the new map"));
    }
    let points = (0..count).map(|number| {
        let [x, y, _] = spec.center(spec.cell(occupied[number * occupied.len() / count]));
        [x, y]
    });
    Ok(points.collect())
}

fn center_of(points: &[[f64; 2]]) -> [f64; 2] {
    let sum = points
        .iter()
        .fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
    sum.map(|sum| sum / points.len() as f64)
}

/// The motion that turns about `center` and then shifts.
fn about(center: [f64; 2], [dx, dy, turn]: [f64; 3]) -> Pose2 {
    let [x, y] = Pose2::new(0.0, 0.0, turn).place(center);
    Pose2::new(center[0] + dx - x, center[1] + dy - y, wrap(turn))
}

/// How well points lie on surfaces: the mean of a kernel of this width.
fn score(
    field: &DistanceField,
    points: &[[f64; 2]],
    center: [f64; 2],
    at: [f64; 3],
    width_m: f64,
) -> f64 {
    let (sin, cos) = at[2].sin_cos();
    let scale = -0.5 / (width_m * width_m);
    let sum: f64 = (points.iter())
        .map(|point| {
            let (x, y) = (point[0] - center[0], point[1] - center[1]);
            let moved = [
                center[0] + at[0] + cos * x - sin * y,
                center[1] + at[1] + sin * x + cos * y,
            ];
            (scale * field.at(moved).powi(2)).exp()
        })
        .sum();
    sum / points.len() as f64
}

/// Climbs by steps that become smaller, with a kernel that becomes narrower.
fn refine(
    field: &DistanceField,
    points: &[[f64; 2]],
    center: [f64; 2],
    from: [f64; 3],
    [step_m, step_rad, fine_m]: [f64; 3],
) -> [f64; 3] {
    let mut at = from;
    for halving in 0..NUM_HALVINGS {
        let scale = 0.5_f64.powi(halving);
        let width = fine_m.max(step_m * scale);
        let mut value = score(field, points, center, at, width);
        loop {
            let before = value;
            for axis in 0..3 {
                let step = if axis == 2 { step_rad } else { step_m } * scale;
                for sign in [-1.0, 1.0] {
                    let mut next = at;
                    next[axis] += sign * step;
                    let found = score(field, points, center, next, width);
                    if found > value {
                        (at, value) = (next, found);
                    }
                }
            }
            if value <= before + 1e-9 {
                break;
            }
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registration::resample::resampled;
    use crate::simulation::{Layout, MONDAY, Office};

    #[test]
    fn a_moved_map_is_laid_back_within_a_quarter_of_a_cell() -> Result<()> {
        let office = Office::new(6, Layout::Development);
        let spec = office.spec(0.05)?;
        let night = office.true_map(MONDAY.plus_us(3 * 3_600_000_000), spec);
        // By day other cupboards are open and chairs stand elsewhere.
        let day = office.true_map(MONDAY.plus_us(14 * 3_600_000_000), spec);
        for (x, y, turn) in [
            (0.0, 0.0, 0.0),
            (0.3, -0.2, 0.0),
            (-0.05, 0.1, 0.03),
            (0.2, 0.2, -0.06),
        ] {
            let center = [9.0, 4.0];
            let motion = about(center, [x, y, turn]);
            let moved = resampled(&day, &motion, spec);
            let found = register(&night, &moved, &Search::default())?;
            let back = motion.then(&Pose2::default());
            for corner in [[1.0, 1.0], [17.0, 1.0], [9.0, 8.0]] {
                let [u, v] = found.motion.place(back.place(corner));
                let off = (u - corner[0]).hypot(v - corner[1]);
                assert!(off < 0.025, "{x} {y} {turn}: {off}");
            }
            assert!(found.score >= found.score_before);
        }
        let nothing = OccupancyMap::new_unknown(spec);
        assert!(register(&night, &nothing, &Search::default()).is_err());
        assert!(register(&nothing, &night, &Search::default()).is_err());
        Ok(())
    }
}

//! Through which cells does a ray pass?

use std::ops::ControlFlow;

use crate::cells::GridSpec;

/// A cell on a ray, and where the ray enters and leaves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Index of the cell in its grid.
    pub index: usize,
    /// Distance from the ray's begin.
    pub enter_m: f64,
    /// Distance from the ray's begin; that of the ray's end in its last cell.
    pub leave_m: f64,
}

/// Calls `visit` for every cell of a 2-D grid that the line from `from_m` to `to_m` passes, in
/// order, until it breaks (J. Amanatides, A. Woo: A fast voxel traversal algorithm for ray tracing,
/// Eurographics 1987).
///
/// Where the line begins or ends outside of the grid, the cells inside are visited. A line with a
/// number that is not finite passes none.
pub fn walk(
    spec: &GridSpec,
    from_m: [f64; 2],
    to_m: [f64; 2],
    mut visit: impl FnMut(Crossing) -> ControlFlow<()>,
) {
    let length_m = (to_m[0] - from_m[0]).hypot(to_m[1] - from_m[1]);
    if !length_m.is_finite() {
        return;
    }
    let Some(mut steps) = Steps::begin(spec, from_m, to_m) else {
        return;
    };
    let width = spec.dims()[0] as usize;
    loop {
        let next = steps.next[0].min(steps.next[1]).min(steps.last);
        let crossing = Crossing {
            index: steps.cell[0] as usize + width * steps.cell[1] as usize,
            enter_m: steps.at * length_m,
            leave_m: next * length_m,
        };
        if visit(crossing).is_break() || !steps.advance(next) {
            return;
        }
    }
}

/// Where a walk is. Positions along the line are fractions of its length.
struct Steps {
    cell: [i64; 2],
    size: [i64; 2],
    /// By how much the cell changes along each axis: -1 or 1.
    sign: [i64; 2],
    /// Where the line meets the next border along each axis, and the steps from border to border.
    next: [f64; 2],
    step: [f64; 2],
    at: f64,
    last: f64,
}

impl Steps {
    /// The first cell inside of the grid, if the line meets it.
    fn begin(spec: &GridSpec, from_m: [f64; 2], to_m: [f64; 2]) -> Option<Self> {
        // In units of cells, from the grid's corner on.
        let origin = spec.origin_m();
        let scale =
            |point: [f64; 2]| [0, 1].map(|axis| (point[axis] - origin[axis]) / spec.resolution_m());
        let (from, to) = (scale(from_m), scale(to_m));
        let size = [0, 1].map(|axis| i64::from(spec.dims()[axis]));
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let along = to[axis] - from[axis];
            let end = size[axis] as f64;
            if along == 0.0 {
                if !(from[axis] >= 0.0 && from[axis] < end) {
                    return None;
                }
                continue;
            }
            let (a, b) = (-from[axis] / along, (end - from[axis]) / along);
            first = first.max(a.min(b));
            last = last.min(a.max(b));
        }
        if first > last {
            return None;
        }
        let mut steps = Self {
            cell: [0; 2],
            size,
            sign: [1; 2],
            next: [f64::INFINITY; 2],
            step: [f64::INFINITY; 2],
            at: first,
            last,
        };
        for axis in 0..2 {
            let along = to[axis] - from[axis];
            let here = from[axis] + along * first;
            // A line that begins on the upper border runs downwards into the last cell.
            steps.cell[axis] = (here.floor() as i64).clamp(0, size[axis] - 1);
            if along != 0.0 {
                let is_up = along > 0.0;
                steps.sign[axis] = if is_up { 1 } else { -1 };
                let border = steps.cell[axis] + i64::from(is_up);
                steps.next[axis] = (border as f64 - from[axis]) / along;
                steps.step[axis] = 1.0 / along.abs();
            }
        }
        Some(steps)
    }

    /// Goes on to the cell behind the border at `next`; false at the end of the line or grid.
    fn advance(&mut self, next: f64) -> bool {
        if next >= self.last {
            return false;
        }
        let axis = usize::from(self.next[1] < self.next[0]);
        self.cell[axis] += self.sign[axis];
        self.next[axis] += self.step[axis];
        self.at = next;
        self.cell[axis] >= 0 && self.cell[axis] < self.size[axis]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use fremen::Result;

    fn cells(spec: &GridSpec, from: [f64; 2], to: [f64; 2]) -> Vec<Crossing> {
        let mut found = Vec::new();
        walk(spec, from, to, |crossing| {
            found.push(crossing);
            ControlFlow::Continue(())
        });
        found
    }

    #[test]
    fn every_cell_with_a_point_of_the_line_is_visited_once_and_in_order() -> Result<()> {
        let spec = GridSpec::new_2d([-2.0, 1.0], 0.25, [40, 30])?;
        let mut random = Random::new(11);
        for _ in 0..500 {
            let mut point = || [random.between(-6.0, 12.0), random.between(-4.0, 12.0)];
            let (from, to) = (point(), point());
            let found = cells(&spec, from, to);
            let length = (to[0] - from[0]).hypot(to[1] - from[1]);
            for pair in found.windows(2) {
                assert!((pair[0].leave_m - pair[1].enter_m).abs() < 1e-9);
                let (a, b) = (spec.cell(pair[0].index), spec.cell(pair[1].index));
                assert_eq!(a[0].abs_diff(b[0]) + a[1].abs_diff(b[1]), 1);
            }
            // The oracle: points at small steps.
            for i in 0..2_000 {
                let s = f64::from(i) / 2_000.0;
                let at = [0, 1].map(|axis| from[axis] + s * (to[axis] - from[axis]));
                let Some(cell) = spec.cell_at([at[0], at[1], 0.0]) else {
                    continue;
                };
                let crossing = found.iter().find(|c| c.index == spec.index(cell));
                let crossing = crossing.expect("a cell on the line is visited");
                let is_between =
                    s * length > crossing.enter_m - 1e-6 && s * length < crossing.leave_m + 1e-6;
                assert!(is_between);
            }
        }
        Ok(())
    }

    #[test]
    fn lines_along_borders_and_outside_end() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 1.0, [4, 3])?;
        assert_eq!(cells(&spec, [0.5, 1.5], [3.5, 1.5]).len(), 4);
        assert_eq!(cells(&spec, [1.0, -5.0], [1.0, 9.0]).len(), 3);
        assert_eq!(cells(&spec, [9.0, 1.0], [-9.0, 1.0]).len(), 4);
        assert_eq!(cells(&spec, [-3.0, -1.0], [9.0, -1.0]).len(), 0);
        assert_eq!(cells(&spec, [2.5, 2.5], [2.5, 2.5]).len(), 1);
        assert_eq!(cells(&spec, [f64::NAN, 0.0], [1.0, 1.0]).len(), 0);
        assert_eq!(cells(&spec, [0.5, 0.5], [f64::INFINITY, 0.5]).len(), 0);
        Ok(())
    }
}

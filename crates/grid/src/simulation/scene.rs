//! What is where at one moment?

use std::ops::ControlFlow;

use crate::cells::{GridSpec, OccupancyMap};
use crate::scan::ray::walk;

/// Surfaces at the height of the laser, at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// From `[x, y]` to `[x, y]`.
    segments: Vec<[[f64; 2]; 2]>,
    /// Centre and radius.
    discs: Vec<([f64; 2], f64)>,
}

impl Scene {
    /// Adds a straight surface.
    pub fn add_segment(&mut self, from_m: [f64; 2], to_m: [f64; 2]) {
        self.segments.push([from_m, to_m]);
    }

    /// Adds the four sides of a box between two corners.
    pub fn add_box(&mut self, low_m: [f64; 2], high_m: [f64; 2]) {
        let corners = [low_m, [high_m[0], low_m[1]], high_m, [low_m[0], high_m[1]]];
        for index in 0..4 {
            self.add_segment(corners[index], corners[(index + 1) % 4]);
        }
    }

    /// Adds something round: a person, a chair, a leg of a table.
    pub fn add_disc(&mut self, center_m: [f64; 2], radius_m: f64) {
        self.discs.push((center_m, radius_m));
    }

    /// Adds all of another scene.
    pub fn extend(&mut self, other: &Self) {
        self.segments.extend_from_slice(&other.segments);
        self.discs.extend_from_slice(&other.discs);
    }

    /// How far a ray in a direction of length 1 goes; none where nothing is within `max_range_m`.
    pub fn cast(&self, from_m: [f64; 2], direction: [f64; 2], max_range_m: f64) -> Option<f64> {
        let [dx, dy] = direction;
        let mut nearest = max_range_m;
        let mut found = false;
        for [a, b] in &self.segments {
            let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
            let (fx, fy) = (a[0] - from_m[0], a[1] - from_m[1]);
            let determinant = dx * ey - dy * ex;
            if determinant.abs() < 1e-12 {
                continue;
            }
            let along = (fx * ey - fy * ex) / determinant;
            let on = (fx * dy - fy * dx) / determinant;
            if along > 0.0 && along < nearest && (0.0..=1.0).contains(&on) {
                nearest = along;
                found = true;
            }
        }
        for (center, radius) in &self.discs {
            let (fx, fy) = (center[0] - from_m[0], center[1] - from_m[1]);
            let middle = fx * dx + fy * dy;
            let off = fx * fx + fy * fy - middle * middle;
            let half = radius * radius - off;
            if half <= 0.0 {
                continue;
            }
            let along = middle - half.sqrt();
            if along > 0.0 && along < nearest {
                nearest = along;
                found = true;
            }
        }
        found.then_some(nearest)
    }

    /// Whether a disc around a point meets a surface or lies in something round.
    pub fn is_blocked(&self, at_m: [f64; 2], radius_m: f64) -> bool {
        let near = |a: [f64; 2], b: [f64; 2]| {
            let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
            let length = ex * ex + ey * ey;
            let along = if length > 0.0 {
                (((at_m[0] - a[0]) * ex + (at_m[1] - a[1]) * ey) / length).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let (x, y) = (a[0] + along * ex - at_m[0], a[1] + along * ey - at_m[1]);
            x.hypot(y) < radius_m
        };
        self.segments.iter().any(|[a, b]| near(*a, *b))
            || (self.discs.iter()).any(|(center, radius)| {
                (center[0] - at_m[0]).hypot(center[1] - at_m[1]) < radius + radius_m
            })
    }

    /// The true map: surfaces are occupied, what can be reached from `inside_m` without crossing
    /// one is free, and all else is hidden, hence unknown.
    pub fn rasterize(&self, spec: GridSpec, inside_m: [f64; 2]) -> OccupancyMap {
        let mut map = OccupancyMap::new_unknown(spec);
        for [a, b] in &self.segments {
            walk(&spec, *a, *b, |crossing| {
                map.set(crossing.index, Some(1.0));
                ControlFlow::Continue(())
            });
        }
        for (center, radius) in &self.discs {
            let reach = (radius / spec.resolution_m()).ceil() as i64;
            for step_y in -reach..=reach {
                for step_x in -reach..=reach {
                    let offset = [step_x, step_y].map(|step| step as f64 * spec.resolution_m());
                    let point = [center[0] + offset[0], center[1] + offset[1], 0.0];
                    if offset[0].hypot(offset[1]) <= *radius
                        && let Some(cell) = spec.cell_at(point)
                    {
                        map.set(spec.index(cell), Some(1.0));
                    }
                }
            }
        }
        flood(&mut map, inside_m);
        map
    }
}

/// Makes free what is reached from `inside_m` by steps to the four neighbours.
fn flood(map: &mut OccupancyMap, inside_m: [f64; 2]) {
    let spec = *map.spec();
    let [width, height, _] = spec.dims();
    let mut open: Vec<[u32; 3]> = Vec::new();
    open.extend(spec.cell_at([inside_m[0], inside_m[1], 0.0]));
    while let Some(cell) = open.pop() {
        let index = spec.index(cell);
        if map.get(index).is_some() {
            continue;
        }
        map.set(index, Some(0.0));
        let [x, y, _] = cell;
        if x > 0 {
            open.push([x - 1, y, 0]);
        }
        if y > 0 {
            open.push([x, y - 1, 0]);
        }
        if x + 1 < width {
            open.push([x + 1, y, 0]);
        }
        if y + 1 < height {
            open.push([x, y + 1, 0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells::{CellState, Thresholds};
    use fremen::Result;

    #[test]
    fn rays_end_at_the_nearest_surface() {
        let mut scene = Scene::default();
        scene.add_segment([2.0, -1.0], [2.0, 1.0]);
        scene.add_disc([4.0, 3.0], 0.5);
        assert_eq!(scene.cast([0.0, 0.0], [1.0, 0.0], 9.0), Some(2.0));
        assert_eq!(scene.cast([0.0, 0.0], [1.0, 0.0], 1.9), None);
        assert_eq!(scene.cast([0.0, 0.0], [-1.0, 0.0], 9.0), None);
        assert_eq!(scene.cast([4.0, 0.0], [0.0, 1.0], 9.0), Some(2.5));
        assert!(scene.is_blocked([1.8, 0.5], 0.3) && !scene.is_blocked([1.6, 0.5], 0.3));
        assert!(scene.is_blocked([4.0, 2.3], 0.3));
    }

    #[test]
    fn what_is_hidden_is_unknown() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 0.1, [40, 40])?;
        let mut scene = Scene::default();
        scene.add_box([0.05, 0.05], [3.95, 3.95]);
        scene.add_box([1.05, 1.05], [2.05, 2.05]);
        let map = scene.rasterize(spec, [3.0, 3.0]);
        let state = |x: f64, y: f64| {
            let cell = spec.cell_at([x, y, 0.0]).expect("inside");
            map.state(spec.index(cell), Thresholds::default())
        };
        assert_eq!(state(1.5, 1.5), CellState::Unknown);
        assert_eq!(state(1.05, 1.5), CellState::Occupied);
        assert_eq!(state(0.5, 0.5), CellState::Free);
        Ok(())
    }
}

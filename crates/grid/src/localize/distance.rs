//! How far is it from each cell to the nearest surface?

use crate::cells::{CellState, GridSpec, OccupancyMap, Thresholds};

/// Distances from cells of a 2-D grid to the centre of the nearest occupied cell.
#[derive(Clone, Debug)]
pub struct DistanceField {
    spec: GridSpec,
    distances_m: Vec<f32>,
    limit_m: f32,
}

impl DistanceField {
    /// The distances to the occupied cells of `map`, exact up to `limit_m` and `limit_m` beyond
    /// (P. Felzenszwalb, D. Huttenlocher: Distance transforms of sampled functions, 2012; time is
    /// linear in the number of cells).
    pub fn new(map: &OccupancyMap, thresholds: Thresholds, limit_m: f64) -> Self {
        let is_occupied = |index| map.state(index, thresholds) == CellState::Occupied;
        Self::to_cells(*map.spec(), limit_m, is_occupied)
    }

    /// The distances to the cells of `spec` for which `is_target`.
    pub fn to_cells(spec: GridSpec, limit_m: f64, is_target: impl Fn(usize) -> bool) -> Self {
        let [width, height, _] = spec.dims().map(|n| n as usize);
        // Squared distances in cells. Far enough, but small enough to add without loss.
        let far = (width * width + height * height) as f64;
        let mut squares: Vec<f64> = (0..spec.num_cells())
            .map(|index| if is_target(index) { 0.0 } else { far })
            .collect();
        let mut scratch = Scratch::default();
        for row in squares.chunks_exact_mut(width) {
            scratch.lower_envelope(row);
        }
        let mut column = vec![0.0; height];
        for x in 0..width {
            for (y, square) in column.iter_mut().enumerate() {
                *square = squares[x + width * y];
            }
            scratch.lower_envelope(&mut column);
            for (y, square) in column.iter().enumerate() {
                squares[x + width * y] = *square;
            }
        }
        let distances = squares.iter().map(|square| {
            let distance_m = square.sqrt() * spec.resolution_m();
            // `far` stands for "nowhere".
            if *square >= far {
                limit_m
            } else {
                distance_m.min(limit_m)
            }
        });
        Self {
            spec,
            distances_m: distances.map(|distance| distance as f32).collect(),
            limit_m: limit_m as f32,
        }
    }

    /// The cells.
    pub const fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// Where distances end.
    pub const fn limit_m(&self) -> f64 {
        self.limit_m as f64
    }

    /// The distance of a cell; the limit outside of the grid.
    pub fn of_cell(&self, index: usize) -> f64 {
        f64::from(self.distances_m.get(index).copied().unwrap_or(self.limit_m))
    }

    /// The distance of a point, interpolated between the centres of the four cells around it; the
    /// limit outside of the grid.
    pub fn at(&self, point_m: [f64; 2]) -> f64 {
        let [width, height, _] = self.spec.dims().map(|n| n as usize);
        let origin = self.spec.origin_m();
        let scale = 1.0 / self.spec.resolution_m();
        let u = (point_m[0] - origin[0]) * scale - 0.5;
        let v = (point_m[1] - origin[1]) * scale - 0.5;
        let (x, y) = (u.floor(), v.floor());
        // NaN fails, too.
        let is_inside = x >= 0.0 && y >= 0.0 && x < width as f64 - 1.0 && y < height as f64 - 1.0;
        if !is_inside {
            let cell = self.spec.cell_at([point_m[0], point_m[1], 0.0]);
            return cell.map_or(self.limit_m(), |cell| self.of_cell(self.spec.index(cell)));
        }
        let (fx, fy) = ((u - x) as f32, (v - y) as f32);
        let first = x as usize + width * y as usize;
        let (a, b) = (self.distances_m[first], self.distances_m[first + 1]);
        let (c, d) = (
            self.distances_m[first + width],
            self.distances_m[first + width + 1],
        );
        let (low, high) = (a + (b - a) * fx, c + (d - c) * fx);
        f64::from(low + (high - low) * fy)
    }
}

/// The parabolas whose lower envelope is the distance along one row.
#[derive(Default)]
struct Scratch {
    /// Where each parabola stands, and from where on it is the lowest.
    apex: Vec<usize>,
    from: Vec<f64>,
    before: Vec<f64>,
}

impl Scratch {
    /// Replaces each f(q) by the smallest (q - p)^2 + f(p).
    fn lower_envelope(&mut self, row: &mut [f64]) {
        self.apex.clear();
        self.from.clear();
        self.before.clear();
        self.before.extend_from_slice(row);
        for (q, &height) in row.iter().enumerate() {
            let mut from = f64::NEG_INFINITY;
            while let Some(&p) = self.apex.last() {
                let (x, z) = (q as f64, p as f64);
                let meet = ((height + x * x) - (row[p] + z * z)) / (2.0 * (x - z));
                if meet > self.from[self.from.len() - 1] {
                    from = meet;
                    break;
                }
                self.apex.pop();
                self.from.pop();
            }
            self.apex.push(q);
            self.from.push(from);
        }
        let mut at = 0;
        for (q, square) in row.iter_mut().enumerate() {
            while at + 1 < self.from.len() && self.from[at + 1] < q as f64 {
                at += 1;
            }
            let p = self.apex[at];
            let step = q.abs_diff(p) as f64;
            *square = step * step + self.before[p];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use fremen::Result;

    #[test]
    fn distances_are_those_of_the_nearest_occupied_cell() -> Result<()> {
        let spec = GridSpec::new_2d([-1.0, 3.0], 0.5, [31, 22])?;
        let mut random = Random::new(5);
        for num_occupied in [0, 1, 7, 40] {
            let mut occupied: Vec<usize> = Vec::new();
            for _ in 0..num_occupied {
                occupied.push(random.below(spec.num_cells()));
            }
            let field = DistanceField::to_cells(spec, 6.0, |index| occupied.contains(&index));
            for index in 0..spec.num_cells() {
                let here = spec.center(spec.cell(index));
                let nearest = (occupied.iter())
                    .map(|&other| {
                        let there = spec.center(spec.cell(other));
                        (here[0] - there[0]).hypot(here[1] - there[1])
                    })
                    .fold(6.0, f64::min);
                assert!((field.of_cell(index) - nearest).abs() < 1e-6);
                assert!((field.at([here[0], here[1]]) - nearest).abs() < 1e-6);
            }
            assert_eq!(field.at([-1.1, 3.2]), 6.0);
            assert_eq!(field.at([f64::NAN, 3.2]), 6.0);
        }
        Ok(())
    }
}

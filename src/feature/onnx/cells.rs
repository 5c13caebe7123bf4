//! Which cells of a feature map stand out?
//!
//! With `v_c` the value of channel `c` at a cell, after the mean over the window around it, and `m_c`
//! and `s_c` its mean and standard deviation over the cells of this image:
//!
//! ```text
//! z_c = (v_c - m_c) / s_c          (0 where the channel says the same everywhere)
//! strength = sqrt(mean over c of z_c^2)
//! ```
//!
//! So a cell is strong where it is unlike the rest of its own image. Nothing is learnt from other
//! images: what a channel says of all of this one (it is dark, it is snow) is taken out, and the
//! same image always gives the same features. Moments are sums in `f64` in the order of cells.

use std::cmp::Reverse;

/// The values of a layer: for each channel a plane of `rows` x `columns` cells.
pub(super) struct Cells {
    columns: usize,
    rows: usize,
    values: Vec<f32>,
}

impl Cells {
    /// `values` are planes of `rows` x `columns`, at least one.
    pub(super) fn new(columns: usize, rows: usize, values: Vec<f32>) -> Self {
        debug_assert!(!values.is_empty() && values.len().is_multiple_of(columns * rows));
        Self {
            columns,
            rows,
            values,
        }
    }

    /// How many cells there are.
    fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// The channels of a cell; cells are numbered row by row.
    pub(super) fn channels(&self, cell: usize) -> impl Iterator<Item = f32> {
        self.values.iter().copied().skip(cell).step_by(self.len())
    }

    /// Replaces every value by the mean over the window of `side` x `side` cells around it, as far
    /// as it lies in the grid.
    pub(super) fn smooth(&mut self, side: usize) {
        let reach = side / 2;
        if reach == 0 {
            return;
        }
        let (columns, rows) = (self.columns, self.rows);
        let mut across = vec![0.0; columns * rows];
        for plane in self.values.chunks_exact_mut(columns * rows) {
            for (row, out) in plane
                .chunks_exact(columns)
                .zip(across.chunks_exact_mut(columns))
            {
                for (x, out) in out.iter_mut().enumerate() {
                    let around = &row[x.saturating_sub(reach)..(x + reach + 1).min(columns)];
                    *out = around.iter().sum::<f32>() / around.len() as f32;
                }
            }
            for (y, out) in plane.chunks_exact_mut(columns).enumerate() {
                let around = y.saturating_sub(reach)..(y + reach + 1).min(rows);
                for (x, out) in out.iter_mut().enumerate() {
                    let sum: f32 = around.clone().map(|y| across[y * columns + x]).sum();
                    *out = sum / around.len() as f32;
                }
            }
        }
    }

    /// Gives every channel the mean 0 and the variance 1 over the cells that are shown.
    pub(super) fn standardize(&mut self, is_shown: &[bool]) {
        let num_shown = is_shown.iter().filter(|shown| **shown).count().max(1) as f64;
        let num_cells = self.len();
        for plane in self.values.chunks_exact_mut(num_cells) {
            let shown = || {
                let cells = plane.iter().zip(is_shown).filter(|(_, shown)| **shown);
                cells.map(|(&value, _)| f64::from(value))
            };
            let mean = shown().sum::<f64>() / num_shown;
            let variance = shown().map(|value| (value - mean).powi(2)).sum::<f64>() / num_shown;
            let deviation = variance.sqrt();
            // What is left of rounding where all values are the same.
            let is_constant = deviation <= 1e-6 * mean.abs() || deviation < f64::MIN_POSITIVE;
            let factor = if is_constant { 0.0 } else { 1.0 / deviation };
            for value in plane {
                *value = ((f64::from(*value) - mean) * factor) as f32;
            }
        }
    }

    /// How strong each cell is.
    pub(super) fn strengths(&self) -> Vec<f32> {
        let num_cells = self.len();
        let mut strengths = vec![0.0; num_cells];
        for plane in self.values.chunks_exact(num_cells) {
            for (sum, value) in strengths.iter_mut().zip(plane) {
                *sum += value * value;
            }
        }
        let num_channels = (self.values.len() / num_cells) as f32;
        for strength in &mut strengths {
            *strength = (*strength / num_channels).sqrt();
        }
        strengths
    }

    /// The cells that are shown and the strongest of their window of `side` x `side` cells, by
    /// strength (descending), then row, then column. Of equal cells in one window the first counts;
    /// a cell of strength 0 does not stand out.
    pub(super) fn strongest(
        &self,
        strengths: &[f32],
        is_shown: &[bool],
        side: usize,
    ) -> Vec<usize> {
        let rank = |cell: usize| (Ordered(strengths[cell]), Reverse(cell));
        let reach = side / 2;
        let stands_out = |&cell: &usize| {
            let (x, y) = (cell % self.columns, cell / self.columns);
            let across = x.saturating_sub(reach)..(x + reach + 1).min(self.columns);
            let mut down = y.saturating_sub(reach)..(y + reach + 1).min(self.rows);
            down.all(|y| {
                let mut around = across.clone().map(|x| y * self.columns + x);
                around.all(|other| !is_shown[other] || rank(other) <= rank(cell))
            })
        };
        let mut strongest: Vec<usize> = (0..self.len())
            .filter(|&cell| is_shown[cell] && strengths[cell] > 0.0)
            .filter(stands_out)
            .collect();
        strongest.sort_unstable_by_key(|&cell| Reverse(rank(cell)));
        strongest
    }
}

/// A number with a place in every order.
#[derive(Clone, Copy)]
struct Ordered(f32);

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Ordered {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Ordered {}

#[cfg(test)]
mod tests {
    use super::*;

    const SHOWN: [bool; 12] = [true; 12];

    /// Two channels of 4 x 3 cells.
    fn cells() -> Cells {
        let first = [0.0, 0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0];
        Cells::new(4, 3, first.into_iter().chain([7.0; 12]).collect())
    }

    #[test]
    fn a_window_is_a_mean_of_what_lies_in_the_grid() {
        let mut cells = cells();
        cells.smooth(3);
        let near = |cell: usize, expected: f32| {
            let found = cells.channels(cell).next().expect("a channel");
            assert!((found - expected).abs() < 1e-5, "{cell}: {found}");
        };
        near(0, 9.0 / 4.0);
        near(1, 9.0 / 6.0);
        near(5, 1.0);
        near(6, 12.0 / 9.0);
        near(11, 3.0 / 4.0);
        assert!((0..12).all(|cell| cells.channels(cell).nth(1) == Some(7.0)));
        let mut same = self::cells();
        same.smooth(1);
        assert_eq!(same.values, self::cells().values);
    }

    #[test]
    fn standardised_channels_have_no_mean_and_one_variance_where_they_are_shown() {
        let mut cells = cells();
        cells.standardize(&SHOWN);
        let plane = |channel: usize| &cells.values[channel * 12..][..12];
        let sum: f32 = plane(0).iter().sum();
        let squares: f32 = plane(0).iter().map(|value| value * value).sum();
        assert!(
            sum.abs() < 1e-5 && (squares - 12.0).abs() < 1e-4,
            "{sum} {squares}"
        );
        // One that says the same everywhere says nothing.
        assert!(plane(1).iter().all(|value| *value == 0.0));

        // What is hidden does not change what is shown.
        let mut is_shown = SHOWN;
        is_shown[5] = false;
        let (mut one, mut other) = (self::cells(), self::cells());
        other.values[5] = -100.0;
        one.standardize(&is_shown);
        other.standardize(&is_shown);
        assert_eq!(one.values[7], other.values[7]);
    }

    #[test]
    fn the_strongest_of_each_window_come_first() {
        let cells = cells();
        let strengths = [1.0, 1.0, 0.0, 2.0, 1.0, 9.0, 2.0, 3.0, 0.5, 0.5, 0.5, 3.0];
        let all = cells.strongest(&strengths, &SHOWN, 1);
        assert_eq!(all, [5, 7, 11, 3, 6, 0, 1, 4, 8, 9, 10]);
        // Equal neighbours: the first.
        assert_eq!(cells.strongest(&strengths, &SHOWN, 3), [5, 7]);
        let mut is_shown = SHOWN;
        is_shown[5] = false;
        assert_eq!(cells.strongest(&strengths, &is_shown, 3), [7, 0]);
    }
}

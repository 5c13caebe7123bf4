//! Which mean and rhythms explain a history best, all at once?
//!
//! Harmonic least squares with a floating mean and ridge: the coefficients b of
//! `x(t) = (1, cos w_a t, sin w_a t, cos w_b t, ...)` that minimise
//! `sum_i (s_i - b x(t_i))^2 + ridge (b_1^2 + b_2^2 + ...)`; the mean is not penalised. Where
//! sampling is uneven, FreMEn's `g_k` is disturbed by the mean and by the other rhythms through the
//! sampling's own spectrum; solving for all of them together is not.
//!
//! With harmonic candidates everything follows from sums: products of cosines are cosines of the
//! sum and the difference of their harmonics, so `W_m` for m = 0 ... 2 K gives every entry of the
//! normal equations and `S_k` their right-hand side. (Mergeable; no observation is needed again.)
//!
//! O(n^3) to prepare n = 1 + 2 l coefficients once for all features that share observation times,
//! O(n^2) a feature. Not for hundreds of rhythms at once: that is a periodogram's job.

/// The normal equations of some harmonics, solved for any number of features that share their
/// times.
#[derive(Clone, Debug)]
pub struct HarmonicRegression {
    harmonics: Vec<u16>,
    factor: Cholesky,
}

impl HarmonicRegression {
    /// For the given `harmonics` (from 1) of the base period.
    ///
    /// `num_observed` is the number of observations and `observed` their `W_m`: cosine sums of the
    /// harmonics 1 ... M, then sine sums (of `sin w t`, not `-sin`), with M at least twice the
    /// highest harmonic given. `ridge` is in observations and positive. `None` without
    /// observations.
    ///
    /// # Panics
    /// If `observed` does not reach far enough.
    pub fn new(
        num_observed: usize,
        observed: &[f64],
        harmonics: &[u16],
        ridge: f64,
    ) -> Option<Self> {
        if num_observed == 0 {
            return None;
        }
        let (cos_sums, sin_sums) = observed.split_at(observed.len() / 2);
        let cos = |n: i32| match n {
            0 => num_observed as f64,
            n => cos_sums[n.unsigned_abs() as usize - 1],
        };
        let sin = |n: i32| match n {
            0 => 0.0,
            n => f64::from(n.signum()) * sin_sums[n.unsigned_abs() as usize - 1],
        };
        let size = 1 + 2 * harmonics.len();
        let mut gram = vec![0.0; size * size];
        // The mean is the harmonic 0, whose sine does not exist.
        let columns: Vec<(i32, bool)> = std::iter::once((0, false))
            .chain(
                harmonics
                    .iter()
                    .flat_map(|&h| [(i32::from(h), false), (i32::from(h), true)]),
            )
            .collect();
        for (i, &(a, a_is_sin)) in columns.iter().enumerate() {
            for (j, &(b, b_is_sin)) in columns.iter().enumerate() {
                gram[i * size + j] = 0.5
                    * match (a_is_sin, b_is_sin) {
                        (false, false) => cos(a - b) + cos(a + b),
                        (true, true) => cos(a - b) - cos(a + b),
                        (true, false) => sin(a + b) + sin(a - b),
                        (false, true) => sin(a + b) - sin(a - b),
                    };
            }
            gram[i * size + i] += if i == 0 { 0.0 } else { ridge };
        }
        Some(Self {
            harmonics: harmonics.to_vec(),
            factor: Cholesky::new(gram, size)?,
        })
    }

    /// Mean, then the factors of cosine and sine of every harmonic; from the number of observations
    /// at which the state was 1 and their sums `S_k`, laid out as for [`new`](Self::new) (any M
    /// that reaches the harmonics). The second value is the explained sum of squares, a constant
    /// apart.
    pub fn solve(&self, num_seen: usize, seen: &[f64]) -> (Vec<f64>, f64) {
        let (cos, sin) = seen.split_at(seen.len() / 2);
        let mut right: Vec<f64> = Vec::with_capacity(1 + 2 * self.harmonics.len());
        right.push(num_seen as f64);
        for &harmonic in &self.harmonics {
            let at = usize::from(harmonic) - 1;
            right.extend([cos[at], sin[at]]);
        }
        let mut solution = right.clone();
        self.factor.solve(&mut solution);
        let explained = right.iter().zip(&solution).map(|(r, b)| r * b).sum();
        (solution, explained)
    }
}

/// A symmetric positive matrix as the product of a triangular one with itself.
#[derive(Clone, Debug)]
pub(crate) struct Cholesky {
    lower: Vec<f64>,
    size: usize,
}

impl Cholesky {
    /// `None` if the matrix (row by row) is not positive definite.
    pub(crate) fn new(mut matrix: Vec<f64>, size: usize) -> Option<Self> {
        for i in 0..size {
            for j in 0..=i {
                let mut sum = matrix[i * size + j];
                for k in 0..j {
                    sum -= matrix[i * size + k] * matrix[j * size + k];
                }
                matrix[i * size + j] = if i > j {
                    sum / matrix[j * size + j]
                } else if sum > 0.0 {
                    sum.sqrt()
                } else {
                    return None;
                };
            }
        }
        Some(Self {
            lower: matrix,
            size,
        })
    }

    /// Replaces the right-hand side by the solution.
    pub(crate) fn solve(&self, right: &mut [f64]) {
        let at = |i: usize, j: usize| self.lower[i * self.size + j];
        for i in 0..self.size {
            let known: f64 = (0..i).map(|j| at(i, j) * right[j]).sum();
            right[i] = (right[i] - known) / at(i, i);
        }
        for i in (0..self.size).rev() {
            let known: f64 = (i + 1..self.size).map(|j| at(j, i) * right[j]).sum();
            right[i] = (right[i] - known) / at(i, i);
        }
    }

    /// The diagonal of the inverse.
    pub(crate) fn inverse_diagonal(&self) -> Vec<f64> {
        (0..self.size)
            .map(|i| {
                let mut unit = vec![0.0; self.size];
                unit[i] = 1.0;
                self.solve(&mut unit);
                unit[i]
            })
            .collect()
    }
}

//! How strong is each rhythm in the data, and in the sampling alone?
//!
//! With observations at `t_i`, 1 <= i <= m, and states `s_i` in {0, 1} of mean mu, a period T has
//! the amplitude `2 / m * abs(sum_i (s_i - mu) e^(-j 2 pi t_i / T))`, which is `2 abs(g_k)` (T-RO
//! 2017 eq. 10 with the factor 2), and the window `1 / m * abs(sum_i e^(-j 2 pi t_i / T))`. Where
//! the window is near 1, observations came in step with T, and nothing can distinguish that rhythm
//! from none; where two periods both have a high window, each borrows from the other.

use super::candidates::CandidatePeriods;
use super::sums::SpectralSums;
use crate::error::Result;
use crate::time::Time;

/// One period of a [`Periodogram`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PeriodogramLine {
    /// The length of a cycle, in seconds.
    pub period_s: f64,
    /// How far p(t) swings to either side, in [0, 1] but for rounding.
    pub amplitude: f64,
    /// The window of the sampling, in [0, 1] but for rounding: 0 where observations are spread over
    /// all phases, 1 where all have one phase.
    pub window: f64,
}

/// The strength of every candidate period, in the order of the candidates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Periodogram {
    lines: Vec<PeriodogramLine>,
}

impl Periodogram {
    /// Of one state at its observation times, in any order; O(m K). No observations give amplitudes
    /// of 0.
    ///
    /// Fails beyond [`MAX_OBSERVATIONS`](super::MAX_OBSERVATIONS).
    pub fn new(states: &[(Time, bool)], candidates: &CandidatePeriods) -> Result<Self> {
        let mut sums = SpectralSums::new(candidates.clone());
        for &(time, state) in states {
            sums.add(time, state)?;
        }
        Ok(sums.periodogram())
    }

    /// One line a candidate, in the order of the candidates.
    pub fn lines(&self) -> &[PeriodogramLine] {
        &self.lines
    }

    /// The line with the highest amplitude, the earlier one of equals; `None` if every amplitude is
    /// 0.
    pub fn strongest(&self) -> Option<PeriodogramLine> {
        let mut strongest: Option<PeriodogramLine> = None;
        for line in self.lines.iter().filter(|line| line.amplitude > 0.0) {
            if strongest.is_none_or(|it| line.amplitude > it.amplitude) {
                strongest = Some(*line);
            }
        }
        strongest
    }
}

impl SpectralSums {
    /// How far the state swings with each candidate period, and how far its sampling does; O(K).
    pub fn periodogram(&self) -> Periodogram {
        let candidates = self.candidates();
        let coefficients = self.coefficients();
        let lines = (0..candidates.len()).map(|k| PeriodogramLine {
            period_s: candidates.period_s(k),
            amplitude: 2.0 * coefficients[k].hypot(coefficients[candidates.len() + k]),
            window: self.window(k),
        });
        Periodogram {
            lines: lines.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Period;

    #[test]
    fn a_regular_sampling_has_no_line_of_its_own_and_office_hours_have() {
        let day_k = 6;
        let candidates = CandidatePeriods::harmonic(Period::WEEK, 14).expect("valid");
        let of_hours = |keep: fn(i64) -> bool| {
            let states: Vec<(Time, bool)> = (0..28 * 24)
                .filter(|hour| keep(hour % 24))
                .map(|hour| (Time::from_s(hour * 3_600), hour % 24 < 12))
                .collect();
            Periodogram::new(&states, &candidates).expect("few")
        };
        let all = of_hours(|_| true);
        assert!(all.lines()[day_k].amplitude > 0.6, "{all:?}");
        assert!(all.lines().iter().all(|line| line.window < 1e-9), "{all:?}");
        assert_eq!(all.strongest(), Some(all.lines()[day_k]));
        let office = of_hours(|hour| (8..18).contains(&hour));
        assert!(office.lines()[day_k].window > 0.6, "{office:?}");
    }

    #[test]
    fn nothing_and_a_constant_have_no_strongest_line() {
        let candidates = CandidatePeriods::harmonic(Period::DAY, 3).expect("valid");
        let constant: Vec<_> = (0..50).map(|i| (Time::from_s(i * 977), true)).collect();
        for states in [&[][..], &constant] {
            let periodogram = Periodogram::new(states, &candidates).expect("few");
            assert_eq!(periodogram.lines().len(), 3);
            assert_eq!(periodogram.strongest(), None);
        }
    }
}

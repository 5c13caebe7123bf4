//! Which rhythms does a history have, as bars of a chart?

use serde::{Deserialize, Serialize};

use fremen::spectrum::{CandidatePeriods, Periodogram};
use fremen::time::{Period, Time};

/// Frequencies of a spectrum.
pub const SPECTRUM_BARS: usize = 240;

/// The amplitudes of a history's rhythms.
///
/// With visits at `t_i`, 1 <= i <= m, and states `s_i` in {0, 1} of mean mu, frequency f has the
/// amplitude `2 / m * abs(sum_i (s_i - mu) e^(-j 2 pi f t_i))` and the sampling window `1 / m *
/// abs(sum_i e^(-j 2 pi f t_i))`: where the window is near 1, visits came in step with f, and no
/// history can tell that rhythm from none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpectrumSummary {
    /// What frequencies are counted per, `day` or `year`.
    pub per: String,
    /// Frequencies, ascending from one cycle in the history's span.
    pub frequencies: Vec<f64>,
    /// Their amplitudes, 0 to 1.
    pub amplitudes: Vec<f64>,
    /// The sampling window, 0 to 1.
    pub window: Vec<f64>,
}

impl SpectrumSummary {
    /// The amplitudes of the rhythms of a history: when it was looked for, and whether it was seen.
    ///
    /// Frequencies are multiples of one cycle in the span, up to 2.5 a day (twelve a year, where
    /// visits are more than a day apart). If that is more than [`SPECTRUM_BARS`], each bar shows
    /// the highest of its part.
    pub fn of(times: &[Time], seen: &[Option<bool>]) -> Self {
        let observed: Vec<(Time, bool)> = (times.iter().zip(seen))
            .filter_map(|(&time, &seen)| Some((time, seen?)))
            .collect();
        let mut ascending: Vec<Time> = observed.iter().map(|state| state.0).collect();
        ascending.sort_unstable();
        let (Some(&first), Some(&last)) = (ascending.first(), ascending.last()) else {
            return Self::default();
        };
        let span_s = last.since_s(first);
        let mut gaps_s: Vec<f64> = (ascending.windows(2))
            .map(|pair| pair[1].since_s(pair[0]))
            .collect();
        gaps_s.sort_unstable_by(f64::total_cmp);
        let is_daily = (gaps_s.get(gaps_s.len() / 2)).is_none_or(|&gap| gap <= Period::DAY.as_s());
        let (per, unit_s, highest) = if is_daily {
            ("day", Period::DAY.as_s(), 2.5)
        } else {
            ("year", Period::YEAR.as_s(), 12.0)
        };
        let num = ((highest / unit_s * span_s).ceil() as usize).max(2);
        // Years of daily visits have thousands of lines; a part of them shows how high they are.
        let num = num.min(64 * SPECTRUM_BARS);
        let per_bar = num.div_ceil(SPECTRUM_BARS);
        // A history of one moment, or of more visits than can be summed, has no spectrum.
        let periodogram = Period::from_s(span_s)
            .and_then(|span| CandidatePeriods::harmonic(span, num))
            .and_then(|candidates| Periodogram::new(&observed, &candidates));
        let Ok(periodogram) = periodogram else {
            return Self::default();
        };
        let mut summary = Self {
            per: per.into(),
            ..Self::default()
        };
        for first in (1..=num).step_by(per_bar) {
            let part = first..(first + per_bar).min(num + 1);
            let middle = (part.start + part.end - 1) as f64 / 2.0;
            summary.frequencies.push(middle / span_s * unit_s);
            let (amplitude, window) = (periodogram.lines()[part.start - 1..part.end - 1].iter())
                .fold((0.0_f64, 0.0_f64), |(amplitude, window), line| {
                    (amplitude.max(line.amplitude), window.max(line.window))
                });
            summary.amplitudes.push(amplitude.min(1.0));
            summary.window.push(window.min(1.0));
        }
        summary
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A feature that is seen by day only, looked at every five hours and a bit for 100 days.
    fn by_day() -> (Vec<Time>, Vec<Option<bool>>) {
        let times: Vec<Time> = (0..480).map(|i| Time::from_s(i * 18_011)).collect();
        let seen = (times.iter())
            .map(|time| Some(time.phase(Period::DAY) < 0.5))
            .collect();
        (times, seen)
    }

    fn highest(values: &[f64]) -> usize {
        (0..values.len())
            .max_by(|&a, &b| values[a].total_cmp(&values[b]))
            .expect("bars")
    }

    #[test]
    fn a_daily_rhythm_is_the_highest_bar() {
        let (times, seen) = by_day();
        let summary = SpectrumSummary::of(&times, &seen);
        assert_eq!(summary.per, "day");
        assert!(summary.frequencies.len() <= SPECTRUM_BARS);
        let best = highest(&summary.amplitudes);
        assert!(
            (summary.frequencies[best] - 1.0).abs() < 0.02,
            "{summary:?}"
        );
        // A square wave's first harmonic is 2 / pi.
        assert!((summary.amplitudes[best] - 2.0 / std::f64::consts::PI).abs() < 0.05);
        // Five hours and eleven seconds step past every rhythm up to twice a day.
        let window = (summary.frequencies.iter().zip(&summary.window))
            .filter(|(frequency, _)| **frequency < 2.0)
            .map(|(_, window)| *window)
            .fold(0.0, f64::max);
        assert!(window < 0.3, "{window}");
    }

    #[test]
    fn visits_once_a_day_show_in_the_sampling_window() {
        let times: Vec<Time> = (0..100).map(|day| Time::from_s(day * 86_400)).collect();
        let seen = vec![Some(true); times.len()];
        let summary = SpectrumSummary::of(&times, &seen);
        for per_day in [1.0, 2.0] {
            let bar = (summary.frequencies.iter()).position(|f| (f - per_day).abs() < 0.006);
            assert!(summary.window[bar.expect("a bar")] > 0.99, "{summary:?}");
        }
        assert!(summary.amplitudes.iter().all(|&amplitude| amplitude < 1e-9));
    }

    #[test]
    fn what_could_not_be_observed_has_no_weight() {
        let (mut times, mut seen) = by_day();
        let without = SpectrumSummary::of(&times, &seen);
        times.insert(7, times[7].plus_us(1));
        seen.insert(7, None);
        let with = SpectrumSummary::of(&times, &seen);
        for (a, b) in without.amplitudes.iter().zip(&with.amplitudes) {
            assert!((a - b).abs() < 1e-9);
        }
    }

    #[test]
    fn a_history_of_one_moment_has_no_spectrum() {
        let empty = SpectrumSummary::default();
        assert_eq!(SpectrumSummary::of(&[], &[]), empty);
        assert_eq!(
            SpectrumSummary::of(&[Time::from_s(1)], &[Some(true)]),
            empty
        );
        assert_eq!(
            SpectrumSummary::of(&[Time::from_s(1); 3], &[Some(true); 3]),
            empty
        );
    }
}

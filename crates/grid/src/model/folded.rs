//! What is the occupancy of a cell in each part of its strongest period?
//!
//! A few cosines round off the edges of what comes and goes at once: a box, a door, a parked car.
//! Folded over its period, a cell is a histogram over the phase, which may have any shape (*epoch
//! folding*). Into how many parts a period is divided follows from the observations: P. Gregory and
//! T. Loredo (A new method for the detection of a periodic signal of unknown shape and period,
//! Astrophysical Journal 398, 1992) compare histograms by their evidence, the probability of the data
//! with the heights of the parts integrated out, which needs no punishment of many parts.
//!
//! Deviation: they add up all periods and numbers of parts, weighed by their evidence; here the period
//! is the strongest of FreMEn's, and the number of parts is the most likely one.

use std::f64::consts::TAU;

/// No period is divided into fewer parts, but for one that has no rhythm at all.
const LEAST_BINS: usize = 6;

/// The mean of each part of a period, by how often the cell was seen and was occupied in each of the
/// finest parts; `mean` is that of all observations.
///
/// The finest parts are put together in pairs as long as that is more likely; a part of which little
/// is known leans on its nearest neighbours that were seen.
pub(super) fn means(occupied: &[i64], known: &[i64], mean: f64) -> Vec<f32> {
    let finest = known.len();
    let mut best = evidence(occupied, known, finest);
    let mut width = finest;
    let mut num = LEAST_BINS.min(finest);
    for candidate in 0.. {
        // From few parts to many, so that of equally likely ones the fewest are taken.
        num = if candidate == 0 { num } else { num * 2 };
        if num > finest {
            break;
        }
        if finest.is_multiple_of(num) {
            let found = evidence(occupied, known, finest / num);
            // Rounding is no reason for more parts.
            if found > best + 1e-9 {
                (best, width) = (found, finest / num);
            }
        }
    }
    let sums: Vec<[f64; 2]> = (occupied.chunks(width).zip(known.chunks(width)))
        .map(|(occupied, known)| [occupied, known].map(|it| it.iter().sum::<i64>() as f64))
        .collect();
    let means: Vec<f32> = (0..sums.len())
        .map(|part| smoothed(&sums, part, mean) as f32)
        .collect();
    (0..finest).map(|bin| means[bin / width]).collect()
}

/// The mean of a part, in which its surroundings count as one observation.
fn smoothed(sums: &[[f64; 2]], part: usize, mean: f64) -> f64 {
    let num = sums.len();
    let around = (1..=num / 2).find_map(|distance| {
        let [a, b] = [
            sums[(part + distance) % num],
            sums[(part + num - distance) % num],
        ];
        let known = a[1] + b[1];
        (known > 0.0).then(|| (a[0] + b[0] + mean) / (known + 1.0))
    });
    let [occupied, known] = sums[part];
    (occupied + around.unwrap_or(mean)) / (known + 1.0)
}

/// The logarithm of the evidence of a histogram whose parts are `width` of the finest ones: each part
/// has a probability of its own, all of which are equally likely beforehand.
fn evidence(occupied: &[i64], known: &[i64], width: usize) -> f64 {
    let parts = occupied.chunks(width).zip(known.chunks(width));
    let logs = parts.map(|(occupied, known)| {
        let (occupied, known): (i64, i64) = (occupied.iter().sum(), known.iter().sum());
        let free = known - occupied;
        ln_factorial(occupied) + ln_factorial(free) - ln_factorial(known + 1)
    });
    logs.sum()
}

/// ln(n!), from 16 on by Stirling's series, within 1e-9.
fn ln_factorial(n: i64) -> f64 {
    const EXACT: i64 = 16;
    if n < EXACT {
        return (2..=n).map(|it| it as f64).product::<f64>().ln();
    }
    let x = n as f64 + 1.0;
    (x - 0.5) * x.ln() - x + 0.5 * TAU.ln() + 1.0 / (12.0 * x) - 1.0 / (360.0 * x.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factorials_are_products() {
        let mut sum = 0.0;
        for n in 1..200 {
            sum += (n as f64).ln();
            assert!((ln_factorial(n) - sum).abs() < 1e-8, "{n}");
        }
        assert_eq!(ln_factorial(0), 0.0);
    }

    #[test]
    fn a_square_wave_keeps_its_edges_and_noise_has_none() {
        // Occupied in 13 of 48 parts: an edge that only the finest ones have.
        for (num, is_fine) in [(400, true), (40, false)] {
            let occupied: Vec<i64> = (0..48).map(|bin| if bin < 13 { num } else { 0 }).collect();
            let found = means(&occupied, &[num; 48], 13.0 / 48.0);
            let wrong = found
                .iter()
                .enumerate()
                .filter(|(bin, p)| (**p > 0.5) != (*bin < 13));
            // Of few observations larger parts are more likely.
            assert_eq!(wrong.count() == 0, is_fine, "{num}: {found:?}");
        }
        let known = [4; 48];
        // One observation of two, whatever the phase.
        let noise: Vec<i64> = (0..48)
            .map(|bin| 2 + i64::from(bin % 2 == 0) - i64::from(bin % 2))
            .collect();
        let found = means(&noise, &known, 0.5);
        assert!(found.iter().all(|p| (p - 0.5).abs() < 0.01), "{found:?}");
    }

    #[test]
    fn a_part_that_was_never_seen_is_as_its_neighbours() {
        let mut known = [6; 12];
        let mut occupied: [i64; 12] = std::array::from_fn(|bin| if bin < 6 { 6 } else { 0 });
        (known[3], occupied[3]) = (0, 0);
        (known[9], occupied[9]) = (0, 0);
        let found = means(&occupied, &known, 0.5);
        assert!(found[3] > 0.9 && found[9] < 0.1, "{found:?}");
        assert!(
            means(&[0], &[0], 0.25)
                .iter()
                .all(|p| (p - 0.25).abs() < 1e-6)
        );
    }
}

//! Where can the robot's centre be, when it is not a point?

use crate::cells::{GridSpec, OccupancyMap};

/// For each cell the highest probability within `radius_m`: that something is in the way of a robot
/// whose centre is there. NaN where a cell within that is unknown, unless `unknown` gives it a
/// probability.
pub(super) fn inflated(map: &OccupancyMap, radius_m: f64, unknown: Option<f32>) -> Vec<f32> {
    let spec = *map.spec();
    let [width, height, _] = spec.dims().map(|n| n as usize);
    let disc = half_widths(&spec, radius_m);
    let reach = disc.len() / 2;
    // Unknown is above all probabilities, so that one maximum does for both.
    let source: Vec<f32> = (0..spec.num_cells())
        .map(|index| map.get(index).or(unknown).unwrap_or(UNKNOWN))
        .collect();
    let mut highest = vec![0.0_f32; spec.num_cells()];
    let mut row_max = vec![0.0_f32; width];
    for (offset, &half) in disc.iter().enumerate() {
        for y in 0..height {
            let Some(from) = (y + offset)
                .checked_sub(reach)
                .filter(|from| *from < height)
            else {
                continue;
            };
            sliding_maximum(
                &source[from * width..(from + 1) * width],
                half,
                &mut row_max,
            );
            for (cell, found) in highest[y * width..(y + 1) * width].iter_mut().zip(&row_max) {
                *cell = cell.max(*found);
            }
        }
    }
    for p in &mut highest {
        if *p >= UNKNOWN {
            *p = f32::NAN;
        }
    }
    highest
}

/// Stands for "unknown" among probabilities.
const UNKNOWN: f32 = 2.0;

/// For each row of a disc, from its lowest to its highest, half of its width in cells.
fn half_widths(spec: &GridSpec, radius_m: f64) -> Vec<usize> {
    let radius = (radius_m / spec.resolution_m()).max(0.0);
    let reach = radius.floor() as i64;
    (-reach..=reach)
        .map(|y| (radius * radius - (y * y) as f64).max(0.0).sqrt().floor() as usize)
        .collect()
}

/// The highest of the values up to `half` to the left and right of each.
fn sliding_maximum(row: &[f32], half: usize, out: &mut [f32]) {
    for (x, found) in out.iter_mut().enumerate() {
        let end = (x + half + 1).min(row.len());
        *found = row[x.saturating_sub(half)..end]
            .iter()
            .fold(0.0, |a, b| a.max(*b));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use fremen::Result;

    #[test]
    fn a_disc_takes_the_highest_of_all_cells_whose_centres_it_covers() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 0.1, [23, 17])?;
        let mut random = Random::new(4);
        let mut map = OccupancyMap::new_unknown(spec);
        for index in 0..spec.num_cells() {
            let is_known = random.chance(0.97);
            map.set(index, is_known.then(|| random.uniform() as f32));
        }
        let found = inflated(&map, 0.25, None);
        for (index, &found) in found.iter().enumerate() {
            let here = spec.center(spec.cell(index));
            let near = (0..spec.num_cells()).filter(|&other| {
                let there = spec.center(spec.cell(other));
                (here[0] - there[0]).hypot(here[1] - there[1]) < 0.25 + 1e-9
            });
            let all: Vec<Option<f32>> = near.map(|other| map.get(other)).collect();
            if all.iter().any(Option::is_none) {
                assert!(found.is_nan());
            } else {
                let highest = all.iter().flatten().fold(0.0_f32, |a, b| a.max(*b));
                assert_eq!(found, highest);
            }
        }
        assert!(inflated(&map, 0.25, Some(0.3)).iter().all(|p| !p.is_nan()));
        Ok(())
    }
}

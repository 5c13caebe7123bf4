//! What does a map say in the cells of another grid?

use crate::cells::{GridSpec, OccupancyMap};
use crate::pose::Pose2;

/// A 2-D map in the cells of `spec`, after it was moved by `motion` (given in the map's frame: first
/// a turn about its zero, then a shift).
///
/// The rule: a cell takes the highest probability of the known cells whose centres come to lie in
/// it, so that a thin wall has no holes; where there is none, that of the cell which its own centre
/// comes from. With equal cells and no motion the map stays the same. Cells that nothing comes to
/// are unknown.
pub fn resampled(map: &OccupancyMap, motion: &Pose2, spec: GridSpec) -> OccupancyMap {
    let from = *map.spec();
    let mut moved = OccupancyMap::new_unknown(spec);
    for index in 0..from.num_cells() {
        let Some(p) = map.get(index) else { continue };
        let [x, y, _] = from.center(from.cell(index));
        let [x, y] = motion.place([x, y]);
        if let Some(cell) = spec.cell_at([x, y, 0.0]) {
            let cell = spec.index(cell);
            let highest = moved.get(cell).map_or(p, |other| other.max(p));
            moved.set(cell, Some(highest));
        }
    }
    let back = motion.to(&Pose2::default());
    for index in 0..spec.num_cells() {
        if moved.get(index).is_none() {
            let [x, y, _] = spec.center(spec.cell(index));
            let [x, y] = back.place([x, y]);
            let source = from.cell_at([x, y, 0.0]);
            moved.set(index, source.and_then(|cell| map.get(from.index(cell))));
        }
    }
    moved
}

#[cfg(test)]
mod tests {
    use super::*;
    use fremen::Result;

    #[test]
    fn a_map_stays_the_same_without_motion_and_comes_back_after_a_shift() -> Result<()> {
        let spec = GridSpec::new_2d([-1.0, 2.0], 0.1, [30, 20])?;
        let mut map = OccupancyMap::new_unknown(spec);
        for index in (0..spec.num_cells()).step_by(3) {
            map.set(index, Some(index as f32 / spec.num_cells() as f32));
        }
        assert_eq!(resampled(&map, &Pose2::default(), spec), map);
        let there = resampled(&map, &Pose2::new(0.5, -0.3, 0.0), spec);
        assert_eq!(there.get(5), map.get(3 * 30));
        let back = resampled(&there, &Pose2::new(-0.5, 0.3, 0.0), spec);
        for index in 0..spec.num_cells() {
            let [x, y, _] = spec.cell(index);
            if x < 25 && y >= 3 {
                assert_eq!(back.get(index), map.get(index));
            }
        }
        Ok(())
    }

    #[test]
    fn a_thin_wall_keeps_together_in_coarser_and_in_turned_cells() -> Result<()> {
        let spec = GridSpec::new_2d([0.0, 0.0], 0.05, [100, 100])?;
        let mut map = OccupancyMap::new_unknown(spec);
        for index in 0..spec.num_cells() {
            let is_wall = spec.cell(index)[1] == 50;
            map.set(index, Some(if is_wall { 1.0 } else { 0.0 }));
        }
        let coarse = resampled(
            &map,
            &Pose2::default(),
            GridSpec::new_2d([0.0, 0.0], 0.2, [25, 25])?,
        );
        assert!((0..25).all(|x| coarse.get(x + 25 * 12) == Some(1.0)));
        let turned = resampled(&map, &Pose2::new(0.0, 0.0, 0.1), spec);
        // Every column that the wall crosses has a part of it.
        for x in 5..90 {
            assert!(
                (0..100).any(|y| turned.get(x + 100 * y) == Some(1.0)),
                "{x}"
            );
        }
        Ok(())
    }
}

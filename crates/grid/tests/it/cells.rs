//! Cells, indices and points agree for any grid.

use fremen_grid::GridSpec;
use proptest::prelude::*;

proptest! {
    #[test]
    fn a_point_lies_in_the_cell_that_it_is_in(
        origin in -1e3..1e3_f64,
        resolution in 0.01..2.0_f64,
        dims in prop::array::uniform3(1_u32..40),
        point in prop::array::uniform3(-1.1e3..1.1e3_f64),
    ) {
        let spec = GridSpec::new_3d([origin; 3], resolution, dims).unwrap();
        if let Some(cell) = spec.cell_at(point) {
            let center = spec.center(cell);
            prop_assert!(spec.contains(cell));
            for axis in 0..3 {
                prop_assert!((center[axis] - point[axis]).abs() <= resolution * 0.5 + 1e-9);
            }
        } else {
            let inside = |axis: usize| {
                let step = (point[axis] - origin) / resolution;
                step >= 0.0 && step < f64::from(dims[axis])
            };
            prop_assert!(!(0..3).all(inside));
        }
    }
}

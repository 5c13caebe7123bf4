//! Where is each place drawn?
//!
//! By its pose, seen from above (x to the right, y up), scaled so that the map fits; the places of a map
//! without poses stand on a circle in order of their creation, and those without pose in a map with some
//! stand in a row below it.

use std::f64::consts::TAU;

use chronotope::localize::trace::MapSheet;

/// Width of the drawing.
const SIZE: f64 = 400.0;

/// One position for each place of the map.
pub(crate) fn positions(map: &MapSheet) -> Vec<[f32; 2]> {
    let poses: Vec<[f64; 2]> = (map.places.iter())
        .filter_map(|place| place.pose)
        .map(|pose| [pose[0], -pose[1]])
        .filter(|pose| pose.iter().all(|value| value.is_finite()))
        .collect();
    let bounds = |axis: usize| {
        let values = || poses.iter().map(move |pose| pose[axis]);
        let low = values().fold(f64::INFINITY, f64::min);
        (low, values().fold(f64::NEG_INFINITY, f64::max) - low)
    };
    if poses.is_empty() {
        return on_a_circle(map.places.len());
    }
    let [(left, width), (top, height)] = [bounds(0), bounds(1)];
    // Places that all stand on one spot keep their size.
    let span = width.max(height);
    let scale = if span > 0.0 { SIZE / span } else { 1.0 };
    let mut num_without = 0;
    (map.places.iter())
        .map(|place| match place.pose {
            Some([x, y, _]) if x.is_finite() && y.is_finite() => {
                [((x - left) * scale) as f32, ((-y - top) * scale) as f32]
            }
            _ => {
                num_without += 1;
                let below = height * scale + 60.0;
                [(f64::from(num_without - 1) * 60.0) as f32, below as f32]
            }
        })
        .collect()
}

fn on_a_circle(num: usize) -> Vec<[f32; 2]> {
    // Labels need about 60 along the circle.
    let radius = (60.0 * num as f64 / TAU).max(SIZE / 3.0);
    (0..num)
        .map(|i| {
            let (sin, cos) = (TAU * i as f64 / num as f64).sin_cos();
            [(radius * sin) as f32, (-radius * cos) as f32]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use chronotope::localize::trace::PlaceSheet;

    use super::*;

    fn map(poses: &[Option<[f64; 3]>]) -> MapSheet {
        MapSheet {
            places: (poses.iter())
                .map(|&pose| PlaceSheet {
                    pose,
                    ..PlaceSheet::default()
                })
                .collect(),
            ..MapSheet::default()
        }
    }

    #[test]
    fn north_is_up_and_the_map_fits() {
        let drawn = positions(&map(&[
            Some([1000.0, 50.0, 3.0]),
            Some([1010.0, 50.0, 0.0]),
            Some([1010.0, 55.0, 0.0]),
        ]));
        assert_eq!(drawn, [[0.0, 200.0], [400.0, 200.0], [400.0, 0.0]]);
    }

    #[test]
    fn every_place_has_a_position_of_its_own() {
        for poses in [
            vec![None; 7],
            vec![Some([5.0; 3]), None, None],
            vec![
                Some([f64::NAN; 3]),
                Some([1.0; 3]),
                Some([f64::INFINITY, 0.0, 0.0]),
            ],
        ] {
            let drawn = positions(&map(&poses));
            assert_eq!(drawn.len(), poses.len());
            for (i, a) in drawn.iter().enumerate() {
                assert!(a.iter().all(|value| value.is_finite()));
                assert!(drawn[..i].iter().all(|b| a != b), "{drawn:?}");
            }
        }
        assert!(positions(&map(&[])).is_empty());
    }
}

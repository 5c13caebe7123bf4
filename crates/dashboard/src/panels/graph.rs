//! Which places are there, how are they joined, and how probable is each?
//!
//! A place is drawn at its pose, seen from above (x to the right, y up), scaled so that the map
//! fits; the places of a map without poses stand on a circle in order of their creation, and those
//! without pose in a map with some stand in a row below it. Where names would lie over each other,
//! places stand a little above or below their poses.

use std::f64::consts::TAU;

use anyhow::Result;
use chronotope::trace::{MapSummary, Trace};
use rerun::external::re_sdk_types::datatypes::Range2D;
use rerun::{GraphEdges, GraphNodes, RecordingStream};

use super::lookup::names;
use crate::{colours, entities};

/// Width of the drawing.
const SIZE: f64 = 400.0;

/// About the width of a letter of a name, and the frame around it, as the viewer draws them.
const LETTER: f32 = 6.8;
const FRAME: f32 = 14.0;
/// From one row of names to the next.
const ROW: f32 = 36.0;
/// Steps above and below a pose that are tried.
const MAX_ROWS: i16 = 4;
/// Of more places nobody reads names.
const MAX_NAMED: usize = 100;

/// The ways between places.
pub(crate) fn log_ways(stream: &RecordingStream, map: &MapSummary) -> Result<()> {
    let edges = (map.edges.iter()).map(|edge| (edge.from.as_str(), edge.to.as_str()));
    let edges = GraphEdges::new(edges.collect::<Vec<_>>()).with_directed_edges();
    Ok(stream.log(entities::GRAPH, &edges)?)
}

/// The places, at `positions` if there is one for each, coloured by their posterior.
pub(crate) fn log_places(
    stream: &RecordingStream,
    trace: &Trace<'_>,
    posterior: &[f64],
    positions: &[[f32; 2]],
) -> Result<()> {
    let here = trace
        .localization
        .decision
        .place()
        .map(|node| node.0 as usize);
    let labels = (trace.places.iter().zip(posterior).enumerate()).map(|(node, (key, share))| {
        let marks = if here == Some(node) { "HERE: " } else { "" };
        format!("{marks}{key} {:.0} %", 100.0 * share)
    });
    let radii = (0..trace.places.len()).map(|node| if here == Some(node) { 14.0 } else { 7.0 });
    let mut nodes = GraphNodes::new(names(trace))
        .with_labels(labels)
        .with_colors(posterior.iter().map(|&share| colours::probability(share)))
        .with_radii(radii);
    if positions.len() == trace.places.len() {
        nodes = nodes.with_positions(positions.iter().copied());
    }
    Ok(stream.log(entities::GRAPH, &nodes)?)
}

/// The part of the plane that holds all positions, with a margin for their names.
pub(crate) fn extent(positions: &[[f32; 2]], names: &[&str]) -> Range2D {
    let widths = names.iter().map(|name| name_width(name));
    let half = 0.5 * f64::from(widths.fold(100.0, f32::max));
    let range = |axis: usize, margin: f64| {
        let values = || {
            positions
                .iter()
                .map(move |position| f64::from(position[axis]))
        };
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        if low > high {
            [-100.0, 100.0]
        } else {
            [low - margin, high + margin]
        }
    };
    Range2D {
        x_range: range(0, half).into(),
        y_range: range(1, 60.0).into(),
    }
}

/// One position for each place of the map; `names` are those of the places, in order.
pub(crate) fn positions(map: &MapSummary, names: &[&str]) -> Vec<[f32; 2]> {
    let at = by_pose(map);
    if at.len() > MAX_NAMED {
        return at;
    }
    let widths: Vec<f32> = (0..at.len())
        .map(|node| name_width(names.get(node).copied().unwrap_or_default()))
        .collect();
    apart(&at, &widths)
}

/// The width of a place's name with all that may stand beside it.
fn name_width(name: &str) -> f32 {
    LETTER * (name.chars().count() + "HERE:  100 %".len()) as f32 + FRAME
}

/// Moves what would lie over an earlier one by rows, the nearest free row first; what has none
/// stays.
fn apart(at: &[[f32; 2]], widths: &[f32]) -> Vec<[f32; 2]> {
    let mut placed: Vec<[f32; 2]> = Vec::new();
    for (&[x, y], &width) in at.iter().zip(widths) {
        let is_free = |candidate: f32| {
            (placed.iter().zip(widths)).all(|(&[x2, y2], width2)| {
                (x - x2).abs() >= 0.5 * (width + width2) || (candidate - y2).abs() >= 0.9 * ROW
            })
        };
        let steps = (1..=MAX_ROWS).flat_map(|step| [step, -step]);
        let rows = std::iter::once(0)
            .chain(steps)
            .map(|step| y + f32::from(step) * ROW);
        placed.push([x, rows.into_iter().find(|&row| is_free(row)).unwrap_or(y)]);
    }
    placed
}

fn by_pose(map: &MapSummary) -> Vec<[f32; 2]> {
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
    use chronotope::trace::PlaceSummary;

    use super::*;

    fn map(poses: &[Option<[f64; 3]>]) -> MapSummary {
        MapSummary {
            places: (poses.iter())
                .map(|&pose| PlaceSummary {
                    pose,
                    ..PlaceSummary::default()
                })
                .collect(),
            ..MapSummary::default()
        }
    }

    #[test]
    fn north_is_up_and_the_map_fits() {
        let drawn = positions(
            &map(&[
                Some([1000.0, 50.0, 3.0]),
                Some([1010.0, 50.0, 0.0]),
                Some([1010.0, 55.0, 0.0]),
            ]),
            &[],
        );
        assert_eq!(drawn, [[0.0, 200.0], [400.0, 200.0], [400.0, 0.0]]);
    }

    #[test]
    fn names_of_a_straight_street_lie_apart() {
        let mut street = map(&[None; 8]);
        for (index, place) in street.places.iter_mut().enumerate() {
            place.pose = Some([12.0 * index as f64, 3.0, 0.0]);
        }
        let drawn = positions(&street, &["place-00"; 8]);
        let width = name_width("place-00");
        for (i, a) in drawn.iter().enumerate() {
            for b in &drawn[..i] {
                let is_apart = (a[0] - b[0]).abs() >= width || (a[1] - b[1]).abs() >= 30.0;
                assert!(is_apart, "{drawn:?}");
            }
        }
        assert!(drawn.windows(2).all(|pair| pair[0][0] < pair[1][0]));
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
            let drawn = positions(&map(&poses), &[]);
            assert_eq!(drawn.len(), poses.len());
            for (i, a) in drawn.iter().enumerate() {
                assert!(a.iter().all(|value| value.is_finite()));
                assert!(drawn[..i].iter().all(|b| a != b), "{drawn:?}");
            }
        }
        assert!(positions(&map(&[]), &[]).is_empty());
    }
}

//! What does a grid look like?
//!
//! Pictures for people, as PNG: the highest y is on top; of a 3-D grid each column of voxels is one
//! pixel.

use fremen::{Error, ErrorKind, Result, Time};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::cells::{GridSpec, OccupancyMap};
use crate::temporal::FittedGrid;

/// Of a cell that was never seen.
const UNKNOWN: [u8; 3] = [150, 170, 190];

/// The occupancy of a map: white is free, black occupied, blue-grey unknown. Of a column of voxels
/// the most occupied one.
///
/// # Errors
/// What the encoder says.
pub fn occupancy_png(map: &OccupancyMap) -> Result<Vec<u8>> {
    let spec = map.spec();
    png(spec, |x, y| {
        let column = (0..spec.dims()[2]).filter_map(|z| map.get(spec.index([x, y, z])));
        column.reduce(f32::max).map_or(UNKNOWN, |p| {
            let shade = (255.0 * (1.0 - p)).round() as u8;
            [shade; 3]
        })
    })
}

/// A map as [`occupancy_png`] draws it, paler, with cells that have appeared in red and cells that have
/// vanished in blue.
///
/// # Errors
/// What the encoder says.
pub fn contradictions_png(
    map: &OccupancyMap,
    appeared: &[usize],
    vanished: &[usize],
) -> Result<Vec<u8>> {
    let spec = map.spec();
    let mut marks = vec![0_u8; spec.num_cells()];
    for (cells, mark) in [(appeared, 1), (vanished, 2)] {
        for &cell in cells {
            if let Some(it) = marks.get_mut(cell) {
                *it = mark;
            }
        }
    }
    png(spec, |x, y| {
        let index = spec.index([x, y, 0]);
        match (marks[index], map.get(index)) {
            (1, _) => [214, 39, 40],
            (2, _) => [31, 119, 180],
            (_, None) => UNKNOWN,
            (_, Some(p)) => [255 - (p * 160.0) as u8; 3],
        }
    })
}

/// The strongest rhythm of each cell: its period as a hue (a week red, a day green, an hour blue
/// and beyond), its amplitude as the depth of the colour; on top of what is mostly occupied in dark
/// grey.
///
/// # Errors
/// What the encoder says.
pub fn rhythms_png(fitted: &FittedGrid<'_>, spec: &GridSpec, time: Time) -> Result<Vec<u8>> {
    rhythms_png_between(fitted, spec, time, [1_800.0, 604_800.0])
}

/// As [`rhythms_png`], with hues from violet for periods of `ends_s[0]` seconds and less to red for
/// those of `ends_s[1]` and more.
///
/// # Errors
/// What the encoder says.
pub fn rhythms_png_between(
    fitted: &FittedGrid<'_>,
    spec: &GridSpec,
    time: Time,
    ends_s: [f64; 2],
) -> Result<Vec<u8>> {
    let mut map = OccupancyMap::new_unknown(*spec);
    fitted.predict_into(time, &mut map)?;
    png(spec, |x, y| {
        let mut strongest = (0.0, 0.0);
        let mut most: Option<f32> = None;
        for z in 0..spec.dims()[2] {
            let p = map.get(spec.index([x, y, z]));
            most = most.into_iter().chain(p).reduce(f32::max);
            if let Some((period_s, amplitude)) = fitted.strongest_rhythm([x, y, z])
                && amplitude > strongest.1
            {
                strongest = (period_s, amplitude);
            }
        }
        match (most, strongest) {
            (None, _) => UNKNOWN,
            (Some(p), (_, 0.0)) => [255 - (p * 200.0) as u8; 3],
            (_, (period_s, amplitude)) => colour_of(period_s, amplitude, ends_s),
        }
    })
}

/// A hue by the logarithm of the period, from red (the longest) to violet (the shortest).
fn colour_of(period_s: f64, amplitude: f64, [shortest_s, longest_s]: [f64; 2]) -> [u8; 3] {
    let position = (longest_s / period_s).ln() / (longest_s / shortest_s).ln();
    let hue = 6.0 * 0.8 * position.clamp(0.0, 1.0);
    let depth = (0.25 + 1.5 * amplitude).min(1.0);
    let channel = |shift: f64| {
        // The usual way round the colour wheel, in six parts.
        let k = (shift + hue).rem_euclid(6.0);
        let fall = k.min(4.0 - k).clamp(0.0, 1.0);
        (255.0 * (1.0 - depth * fall)).round() as u8
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

fn png(spec: &GridSpec, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Result<Vec<u8>> {
    let [w, h, _] = spec.dims();
    let mut pixels = Vec::with_capacity(3 * w as usize * h as usize);
    for y in (0..h).rev() {
        for x in 0..w {
            pixels.extend(pixel(x, y));
        }
    }
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(&pixels, w, h, ExtendedColorType::Rgb8)
        .map_err(|cause| Error::new(ErrorKind::Format, cause.to_string()))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_have_colours_from_red_to_violet() {
        let ends_s = [1_800.0, 604_800.0];
        let colour_of = |period_s, amplitude| colour_of(period_s, amplitude, ends_s);
        assert_eq!(colour_of(604_800.0, 1.0), [255, 0, 0]);
        let [red, green, _] = colour_of(86_400.0, 1.0);
        assert!(green == 255 && red > 0, "a day is yellow-green");
        let [_, _, blue] = colour_of(3_600.0, 1.0);
        assert_eq!(blue, 255);
    }
}

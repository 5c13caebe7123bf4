//! How does an image become the input of a network?
//!
//! Each side is scaled on its own to the size of the input: a triangle as wide as the step between
//! output pixels (at least one pixel of the image) weighs the pixels around, so that shrinking
//! blurs and does not skip. Then each channel is `(grey / 255 - mean) / std`. Sums are taken in a
//! fixed order.

use crate::feature::GrayView;

/// The planes of the channels, one after the other, each `size` (width, height) large.
pub(super) fn planes(
    image: GrayView<'_>,
    size: (usize, usize),
    normalization: impl ExactSizeIterator<Item = (f64, f64)>,
) -> Vec<f32> {
    let gray = scaled(image, size);
    let mut planes = Vec::with_capacity(gray.len() * normalization.len());
    for (mean, std) in normalization {
        let (factor, offset) = ((1.0 / (255.0 * std)) as f32, (mean / std) as f32);
        planes.extend(gray.iter().map(|level| level * factor - offset));
    }
    planes
}

/// The image at another size; it has pixels.
fn scaled(image: GrayView<'_>, (width, height): (usize, usize)) -> Vec<f32> {
    let (columns, rows) = (taps(image.width(), width), taps(image.height(), height));
    let mut across = Vec::with_capacity(width * image.height());
    for y in 0..image.height() {
        let row = image.row(y);
        across.extend(columns.iter().map(|tap| {
            let pixels = row[tap.first..].iter().zip(&tap.weights);
            pixels
                .map(|(&level, weight)| f32::from(level) * weight)
                .sum::<f32>()
        }));
    }
    let mut out = vec![0.0; width * height];
    for (tap, out) in rows.iter().zip(out.chunks_exact_mut(width)) {
        let rows = across[tap.first * width..].chunks_exact(width);
        for (row, weight) in rows.zip(&tap.weights) {
            for (out, level) in out.iter_mut().zip(row) {
                *out += level * weight;
            }
        }
    }
    out
}

/// What an output pixel is made of: pixels from `first` on, whose weights add up to 1.
struct Tap {
    first: usize,
    weights: Vec<f32>,
}

/// For every output pixel of an axis of `len` pixels that becomes `scaled_len` long.
fn taps(len: usize, scaled_len: usize) -> Vec<Tap> {
    let step = len as f64 / scaled_len as f64;
    let reach = step.max(1.0);
    (0..scaled_len)
        .map(|i| {
            let centre = (i as f64 + 0.5) * step - 0.5;
            // Centres lie up to half a pixel outside, where the nearest pixel counts.
            let centre = centre.clamp(0.0, (len - 1) as f64);
            let first = (centre - reach).floor().max(0.0) as usize;
            let last = ((centre + reach).ceil() as usize).min(len - 1);
            let weight = |j: usize| (1.0 - (j as f64 - centre).abs() / reach).max(0.0);
            let total: f64 = (first..=last).map(weight).sum();
            let weights = (first..=last).map(|j| (weight(j) / total) as f32);
            Tap {
                first,
                weights: weights.collect(),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::GrayImage;

    fn image(width: usize, height: usize, level: impl Fn(usize, usize) -> u8) -> GrayImage {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let data = pixels.map(|(x, y)| level(x, y)).collect();
        GrayImage::new(width, height, data).expect("fits")
    }

    #[test]
    fn one_size_is_the_same_and_grey_stays_grey() {
        let noise = image(7, 5, |x, y| (x * 37 + y * 91) as u8);
        let same = scaled(noise.view(), (7, 5));
        assert!(
            same.iter()
                .zip(noise.data())
                .all(|(a, &b)| *a == f32::from(b))
        );
        for size in [(3, 2), (20, 11), (7, 40)] {
            let flat = scaled(image(7, 5, |_, _| 90).view(), size);
            assert_eq!(flat.len(), size.0 * size.1);
            assert!(flat.iter().all(|level| (level - 90.0).abs() < 1e-3));
        }
    }

    #[test]
    fn shrinking_is_a_mean_of_all_pixels_and_a_ramp_stays_one() {
        // Single pixels that plain sampling would skip or keep whole.
        let stripes = scaled(
            image(64, 64, |x, _| 255 * u8::from(x % 4 == 0)).view(),
            (8, 8),
        );
        assert!(
            stripes[9..15]
                .iter()
                .all(|level| (level - 63.75).abs() < 1.0),
            "{stripes:?}"
        );
        let ramp = scaled(image(64, 4, |x, _| 2 * x as u8).view(), (16, 4));
        for (i, level) in ramp.iter().enumerate().take(15).skip(1) {
            // Pixel i of 16 has its centre at 4 i + 1.5 of 64.
            let expected = 2.0 * (4.0 * i as f32 + 1.5);
            assert!((level - expected).abs() < 0.01, "{i}: {level}");
        }
    }

    #[test]
    fn channels_are_normalised_one_by_one() {
        let white = image(4, 4, |_, _| 255);
        let norms = [(0.5, 0.25), (1.0, 2.0)];
        let found = planes(white.view(), (2, 2), norms.into_iter());
        let expected = [2.0, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0];
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-5),
            "{found:?}"
        );
    }
}

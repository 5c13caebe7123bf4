//! Which colour means what?
//!
//! The three classes of features are colours of Okabe and Ito that colour-blind people can tell
//! apart too; probabilities run from a greyish blue that is still legible on black to yellow, so that
//! brighter means more probable without any colour at all.

use rerun::Color;

/// A feature found where it was predicted.
pub(crate) const MATCHED: [u8; 3] = [0, 200, 140];
/// A predicted feature that was not found.
pub(crate) const MISSING: [u8; 3] = [240, 160, 0];
/// A live feature that nothing predicted.
pub(crate) const UNEXPECTED: [u8; 3] = [86, 180, 233];
/// Ways, frames, windows.
pub(crate) const QUIET: [u8; 3] = [130, 130, 140];

/// Lines of a plot's frame.
pub(crate) const FAINT: [u8; 3] = [60, 60, 68];
/// Texts of our own plots.
pub(crate) const TEXT: [u8; 3] = [225, 225, 230];

/// Lines of up to nine series, then again.
const SERIES: [[u8; 3]; 9] = [
    [86, 180, 233],
    [240, 160, 0],
    [0, 200, 140],
    [240, 228, 66],
    [204, 121, 167],
    [213, 94, 0],
    [150, 150, 255],
    [200, 200, 200],
    [165, 120, 85],
];

/// What people call the first of [`series`]; `None` where names would no longer tell them apart.
pub(crate) fn series_name(index: usize) -> Option<&'static str> {
    const NAMES: [&str; 7] = ["blue", "orange", "green", "yellow", "pink", "red", "violet"];
    NAMES.get(index).copied()
}

const PROBABILITY: [[f32; 3]; 5] = [
    [110.0, 115.0, 160.0],
    [85.0, 140.0, 175.0],
    [55.0, 175.0, 160.0],
    [120.0, 210.0, 100.0],
    [253.0, 231.0, 37.0],
];

pub(crate) fn rgb([r, g, b]: [u8; 3]) -> Color {
    Color::from_rgb(r, g, b)
}

pub(crate) fn series(index: usize) -> Color {
    rgb(SERIES[index % SERIES.len()])
}

/// The colour of a probability; what lies outside [0, 1] is taken to its end.
#[expect(clippy::manual_clamp, reason = "clamp keeps what is not a number")]
pub(crate) fn probability(p: f64) -> Color {
    // `max` also takes "not a number" to 0.
    let at = p.max(0.0).min(1.0) as f32 * (PROBABILITY.len() - 1) as f32;
    let stop = (at as usize).min(PROBABILITY.len() - 2);
    let share = at - stop as f32;
    let [r, g, b] = std::array::from_fn(|channel| {
        let [low, high] = [PROBABILITY[stop][channel], PROBABILITY[stop + 1][channel]];
        (low + share * (high - low)) as u8
    });
    Color::from_rgb(r, g, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brighter_means_more_probable() {
        let brightness = |p: f64| {
            let [r, g, b, _] = probability(p).to_array();
            0.3 * f64::from(r) + 0.6 * f64::from(g) + 0.1 * f64::from(b)
        };
        let steps: Vec<f64> = (0..=20).map(|i| brightness(f64::from(i) / 20.0)).collect();
        assert!(steps.windows(2).all(|pair| pair[0] < pair[1]), "{steps:?}");
        assert_eq!(probability(-1.0), probability(0.0));
        assert_eq!(probability(7.0), probability(1.0));
        assert_eq!(probability(f64::NAN), probability(0.0));
    }
}

//! Where on the unit circle is a phase?

use std::f64::consts::TAU;

/// `(cos, sin)` of `2 pi phase` for a phase in `[0, 1]`.
///
/// By Taylor polynomials on an eighth of the circle, exact to 2^-52: only additions and products,
/// so that every platform gets the same bits (the standard library's sine is the system's own).
/// What is stored relative to a prediction can therefore be read anywhere.
#[inline]
pub(crate) fn unit(phase: f64) -> (f64, f64) {
    // The nearest quarter turn; what is left is exact and at most an eighth of a turn.
    let quarter = (phase * 4.0 + 0.5).floor();
    let angle = (phase - quarter * 0.25) * TAU;
    let x = angle * angle;
    let sin = angle
        * (1.0
            + x * (-1.0 / 6.0
                + x * (1.0 / 120.0
                    + x * (-1.0 / 5_040.0
                        + x * (1.0 / 362_880.0
                            + x * (-1.0 / 39_916_800.0
                                + x * (1.0 / 6_227_020_800.0
                                    + x * (-1.0 / 1_307_674_368_000.0))))))));
    let cos = 1.0
        + x * (-0.5
            + x * (1.0 / 24.0
                + x * (-1.0 / 720.0
                    + x * (1.0 / 40_320.0
                        + x * (-1.0 / 3_628_800.0
                            + x * (1.0 / 479_001_600.0
                                + x * (-1.0 / 87_178_291_200.0
                                    + x * (1.0 / 20_922_789_888_000.0))))))));
    match quarter as i64 & 3 {
        0 => (cos, sin),
        1 => (-sin, cos),
        2 => (-cos, -sin),
        _ => (sin, -cos),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_standard_library() {
        for i in 0..=80_000 {
            let phase = f64::from(i) / 80_000.0;
            let (cos, sin) = unit(phase);
            let expected = (TAU * phase).sin_cos();
            // The oracle's own argument is rounded to 2^-51.
            assert!((sin - expected.0).abs() < 1e-15, "sin of {phase}");
            assert!((cos - expected.1).abs() < 1e-15, "cos of {phase}");
        }
        assert_eq!(unit(0.25), (-0.0, 1.0));
    }
}

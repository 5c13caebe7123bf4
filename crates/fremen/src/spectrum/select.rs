//! Which few rhythms does a model of order l keep?

/// A coefficient of at most this amplitude is rounding noise and never selected.
pub const NEGLIGIBLE_AMPLITUDE: f64 = 1e-11;

/// A later candidate must be stronger by this factor in power to go before an earlier one.
const CLEARLY_STRONGER: f64 = 1.0 + 1e-8;

/// Writes the indices of the strongest coefficients, strongest first, and returns how many there
/// are.
///
/// `powers` are the squared amplitudes `abs(g_k)^2` and are set to zero where selected. At most
/// `out.len()` are selected, and none of an amplitude below [`NEGLIGIBLE_AMPLITUDE`].
///
/// Powers that differ by less than one part in 10^8 count as equal and the earlier candidate wins:
/// with uniform sampling a frequency and its alias have equal power in exact arithmetic, and the
/// last bit of a sum must not choose between them. O(K l).
pub fn strongest(powers: &mut [f64], out: &mut [u16]) -> usize {
    for (selected, slot) in out.iter_mut().enumerate() {
        let mut best = None;
        let mut to_beat = NEGLIGIBLE_AMPLITUDE * NEGLIGIBLE_AMPLITUDE;
        for (k, &power) in powers.iter().enumerate() {
            if power > to_beat {
                best = Some(k);
                to_beat = power * CLEARLY_STRONGER;
            }
        }
        let Some(k) = best else { return selected };
        *slot = k as u16;
        powers[k] = 0.0;
    }
    out.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strongest_first_and_the_earlier_of_equals() {
        let mut out = [0; 4];
        let mut powers = [0.2, 0.5, 0.5 * (1.0 + 1e-12), 1e-30, f64::NAN];
        assert_eq!(strongest(&mut powers, &mut out), 3);
        assert_eq!(out[..3], [1, 2, 0]);
    }
}

//! How do the channels of a cell become bits?
//!
//! Bit `b` of a descriptor says on which side of a plane through the origin the cell's vector of
//! channels lies:
//!
//! ```text
//! bit_b = sum_c sign(b, c) z_c > 0        sign(b, c) in {-1, +1}
//! ```
//!
//! The planes are the same in every program: the signs of channel `c` are the bits of the draws `4
//! c` to `4 c + 3` of `SplitMix64` from the seed 0, least significant bit first, for any number of
//! channels or bits. Two vectors at an angle of `a` differ in a share of `a / pi` of the bits, so
//! the Hamming distance is an estimate of their cosine (Charikar, STOC 2002; signs for Gaussian
//! coordinates: Achlioptas, *Database-friendly random projections*, 2003).
//!
//! Complexity: channels x bits additions a cell, in the order of channels.

use crate::feature::Descriptor;

/// The planes for a number of channels.
pub(super) struct Projection {
    num_bits: usize,
    /// Of each channel, the sign in every bit.
    signs: Vec<f32>,
}

impl Projection {
    /// `num_bits` planes, at most 256.
    pub(super) fn new(num_channels: usize, num_bits: usize) -> Self {
        let mut state = 0;
        let mut signs = Vec::with_capacity(num_channels * num_bits);
        for _ in 0..num_channels {
            let words: [u64; 4] = std::array::from_fn(|_| split_mix(&mut state));
            signs.extend(
                (0..num_bits).map(|bit| match words[bit / 64] >> (bit % 64) & 1 {
                    0 => -1.0,
                    _ => 1.0,
                }),
            );
        }
        Self { num_bits, signs }
    }

    /// The bits of one vector; its bit `b` is bit `b % 64` of word `b / 64`. `sums` is memory to
    /// work in.
    pub(super) fn describe(
        &self,
        channels: impl Iterator<Item = f32>,
        sums: &mut Vec<f32>,
    ) -> Descriptor {
        sums.clear();
        sums.resize(self.num_bits, 0.0);
        for (value, signs) in channels.zip(self.signs.chunks_exact(self.num_bits)) {
            for (sum, sign) in sums.iter_mut().zip(signs) {
                *sum += value * sign;
            }
        }
        let mut words = [0; 4];
        for (bit, &sum) in sums.iter().enumerate() {
            words[bit / 64] |= u64::from(sum > 0.0) << (bit % 64);
        }
        Descriptor(words)
    }
}

/// The next draw of `SplitMix64` (Steele, Lea, Flood: *Fast splittable pseudorandom number
/// generators*, OOPSLA 2014).
fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut draw = *state;
    draw = (draw ^ draw >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    draw = (draw ^ draw >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    draw ^ draw >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vector(seed: u64, len: usize) -> Vec<f32> {
        let mut state = seed;
        let mut draw = || (split_mix(&mut state) >> 40) as f32 / (1 << 23) as f32 - 1.0;
        (0..len).map(|_| draw()).collect()
    }

    #[test]
    fn planes_are_the_same_in_every_program() {
        // The first draws of SplitMix64 from 0, as its reference implementation prints them.
        let mut state = 0;
        assert_eq!(split_mix(&mut state), 0xE220_A839_7B1D_CDAF);
        assert_eq!(split_mix(&mut state), 0x6E78_9E6A_A1B9_65F4);
        // One channel: the bits are its signs.
        let bits = Projection::new(1, 256).describe([1.0].into_iter(), &mut Vec::new());
        assert_eq!(bits.0[..2], [0xE220_A839_7B1D_CDAF, 0x6E78_9E6A_A1B9_65F4]);
        let fewer = Projection::new(1, 70).describe([1.0].into_iter(), &mut Vec::new());
        assert_eq!(fewer.0, [bits.0[0], bits.0[1] & 0x3F, 0, 0]);
    }

    #[test]
    fn the_distance_of_bits_is_the_angle_of_vectors() {
        let projection = Projection::new(300, 256);
        let bits = |vector: &[f32]| projection.describe(vector.iter().copied(), &mut Vec::new());
        let (a, b) = (vector(1, 300), vector(2, 300));
        for share in [0.0_f32, 0.3, 0.7, 1.0] {
            let mixed: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a + share * (b - a)).collect();
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            let cosine = dot(&a, &mixed) / (dot(&a, &a) * dot(&mixed, &mixed)).sqrt();
            let expected = cosine.clamp(-1.0, 1.0).acos() / std::f32::consts::PI * 256.0;
            let found = bits(&a).distance_bits(&bits(&mixed)) as f32;
            assert!((found - expected).abs() < 30.0, "{found} for {expected}");
        }
        let scaled: Vec<f32> = a.iter().map(|value| value * 4.0).collect();
        assert_eq!(bits(&a), bits(&scaled));
    }
}

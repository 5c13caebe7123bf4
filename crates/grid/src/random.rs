//! Which number comes next, the same on every run and in every thread?
//!
//! Simulations and particle filters need many independent streams of random numbers that depend on
//! nothing but a seed and on what they are for. [`Random::stream`] makes one from a seed and a list
//! of numbers (a step, a particle), so that work may be split over threads in any way.

/// A stream of pseudo-random numbers (`SplitMix64`: G. Steele, D. Lea, C. Flood: Fast splittable
/// pseudorandom number generators, OOPSLA 2014). Not for secrets.
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

/// The odd constant by which the state advances.
const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

impl Random {
    /// The stream of a seed.
    pub const fn new(seed: u64) -> Self {
        Self { state: mix(seed) }
    }

    /// The stream of a seed and of what it is for; streams of different `keys` are independent.
    pub fn stream(seed: u64, keys: &[u64]) -> Self {
        let mut state = mix(seed);
        for &key in keys {
            state = mix(state.wrapping_add(STEP) ^ mix(key.wrapping_add(STEP)));
        }
        Self { state }
    }

    /// The next 64 bits.
    pub const fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(STEP);
        mix(self.state)
    }

    /// A number in `[0, 1)`.
    pub const fn uniform(&mut self) -> f64 {
        // The upper 53 bits fill the mantissa.
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number in `[low, high)`.
    pub const fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// A whole number below `count`; 0 where `count` is 0.
    pub const fn below(&mut self, count: usize) -> usize {
        // 128 bits keep the bias below 2^-64 x count.
        ((self.bits() as u128 * count as u128) >> 64) as usize
    }

    /// True with probability `p`.
    pub const fn chance(&mut self, p: f64) -> bool {
        self.uniform() < p
    }

    /// A normally distributed number of mean 0 and the given standard deviation (Box-Muller).
    pub fn normal(&mut self, deviation: f64) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        deviation * radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// `SplitMix64`'s finaliser: every bit of the result depends on every bit of the input.
const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ() {
        let bits = |keys: &[u64]| Random::stream(7, keys).bits();
        assert_eq!(bits(&[1, 2]), bits(&[1, 2]));
        assert_ne!(bits(&[1, 2]), bits(&[2, 1]));
        assert_ne!(bits(&[1]), bits(&[1, 0]));
        assert_ne!(Random::new(1).bits(), Random::new(2).bits());
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        let mut random = Random::new(3);
        let n = 100_000;
        let mean = |f: &mut dyn FnMut() -> f64| (0..n).map(|_| f()).sum::<f64>() / f64::from(n);
        assert!((mean(&mut || random.uniform()) - 0.5).abs() < 0.005);
        assert!(mean(&mut || random.normal(2.0)).abs() < 0.03);
        assert!((mean(&mut || random.normal(2.0).powi(2)) - 4.0).abs() < 0.1);
        assert!((mean(&mut || random.below(10) as f64) - 4.5).abs() < 0.05);
        assert_eq!(random.below(0), 0);
    }
}

//! Which number comes next, the same on every machine?
//!
//! [`hash`] names a number by what it is for (seed, place, element, visit), so that no draw depends
//! on the order of other draws; [`Rng`] is the splitmix64 sequence of Steele, Lea and Flood (2014),
//! *Fast splittable pseudorandom number generators*, for the many draws inside one thing.
//! Only integer arithmetic and exactly rounded `f64` operations are used. Not for cryptography.

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

const fn mix(z: u64) -> u64 {
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A well-mixed number for this list of numbers; order and length matter.
pub(super) fn hash(parts: &[u64]) -> u64 {
    parts
        .iter()
        .fold(mix(parts.len() as u64 ^ GOLDEN), |state, &part| {
            mix(state.wrapping_add(GOLDEN) ^ mix(part.wrapping_add(GOLDEN)))
        })
}

/// The number as a fraction in `[0, 1)`, from its upper 53 bits.
pub(super) fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}

/// A splitmix64 sequence.
#[derive(Clone, Debug)]
pub(super) struct Rng(u64);

impl Rng {
    /// The sequence named by this list of numbers.
    pub(super) fn new(parts: &[u64]) -> Self {
        Self(hash(parts))
    }

    /// 64 bits.
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        mix(self.0)
    }

    /// A fraction in `[0, 1)`.
    pub(super) fn unit(&mut self) -> f64 {
        unit(self.bits())
    }

    /// A number in `[low, high)`.
    pub(super) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A whole number in `low..=high`.
    pub(super) fn int(&mut self, low: i32, high: i32) -> i32 {
        let span = (i64::from(high) - i64::from(low) + 1).max(1) as u64;
        (i64::from(low) + ((u128::from(self.bits()) * u128::from(span)) >> 64) as i64) as i32
    }

    /// True with this probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Brings the items into random order.
    pub(super) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            let other = self.int(0, last as i32) as usize;
            items.swap(last, other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequence_is_splitmix64() {
        // First outputs for seed 1234567, as published with the algorithm.
        let mut rng = Rng(1_234_567);
        assert_eq!(rng.bits(), 6_457_827_717_110_365_317);
        assert_eq!(rng.bits(), 3_203_168_211_198_807_973);
    }

    #[test]
    fn draws_stay_in_their_range_and_fill_it() {
        let mut rng = Rng::new(&[1]);
        let mut seen = [0; 4];
        for _ in 0..1000 {
            seen[(rng.int(-1, 2) + 1) as usize] += 1;
            let x = rng.range(2.0, 3.0);
            assert!((2.0..3.0).contains(&x));
        }
        assert!(seen.iter().all(|&count| count > 180), "{seen:?}");
    }

    #[test]
    fn order_and_length_name_other_numbers() {
        assert_ne!(hash(&[1, 2]), hash(&[2, 1]));
        assert_ne!(hash(&[0]), hash(&[0, 0]));
    }
}

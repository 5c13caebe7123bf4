//! How is a bit written in few bits, if its probability is known?
//!
//! A binary arithmetic coder with adaptive probabilities, in whole numbers only: every machine
//! writes the same bytes.

/// The probability of a 1, learnt from the bits so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bit {
    /// In units of 2^-16.
    p: u16,
    /// Bits so far, up to the limit at which old ones are forgotten.
    num: u8,
}

/// From here on the newest bit has a weight of 1 / 128.
const LIMIT: u8 = 126;

impl Bit {
    pub(super) const EVEN: Self = Self { p: 1 << 15, num: 0 };

    fn learn(&mut self, bit: bool) {
        let target = if bit { i32::from(u16::MAX) } else { 0 };
        let p = i32::from(self.p);
        let step = (target - p) * 2 / (2 * i32::from(self.num) + 3);
        // Never quite certain, so that what is unlikely can be written.
        self.p = (p + step).clamp(24, 65_511) as u16;
        self.num = (self.num + 1).min(LIMIT);
    }
}

/// What bits are written to, or read from: one description of a format serves both.
pub(super) trait Coder {
    /// Writes `bit` and gives it back, or reads a bit, whose probability is not known otherwise.
    fn code(&mut self, bit: bool, model: &mut Bit) -> bool;

    /// Whether more was read than there is: the bytes were not written by an [`Encoder`].
    fn is_spent(&self) -> bool {
        false
    }

    /// A whole number below 2^`len`, highest bit first, with a model for each prefix.
    fn number(&mut self, value: u32, len: u32, models: &mut [Bit]) -> u32 {
        let mut prefix = 1;
        for shift in (0..len).rev() {
            let bit = self.code(value >> shift & 1 == 1, &mut models[prefix]);
            prefix = prefix << 1 | usize::from(bit);
        }
        prefix as u32 - (1 << len)
    }

    /// A whole number of up to 32 bits: its length, then its bits, of which the first three after
    /// the leading one have models.
    fn length(&mut self, value: u32, models: &mut Lengths) -> u32 {
        let len = 32 - value.leading_zeros();
        let len = self.number(len, 6, &mut models.len).min(32);
        if len < 2 {
            return len;
        }
        let mut found = 1_u32;
        for at in 1..len {
            let bit = value >> (len - 1 - at) & 1 == 1;
            let mut even = Bit::EVEN;
            let model = if at < 4 {
                &mut models.first[len as usize * 8 + (found as usize & 7)]
            } else {
                &mut even
            };
            found = found << 1 | u32::from(self.code(bit, model));
        }
        found
    }
}

/// The models of whole numbers.
#[derive(Clone, Debug)]
pub(super) struct Lengths {
    len: [Bit; 64],
    first: [Bit; 33 * 8],
}

impl Lengths {
    pub(super) const fn new() -> Self {
        Self {
            len: [Bit::EVEN; 64],
            first: [Bit::EVEN; 33 * 8],
        }
    }
}

/// Writes bits.
#[derive(Debug)]
pub(super) struct Encoder {
    low: u32,
    high: u32,
    bytes: Vec<u8>,
}

impl Encoder {
    pub(super) const fn new() -> Self {
        Self {
            low: 0,
            high: u32::MAX,
            bytes: Vec::new(),
        }
    }

    pub(super) fn finish(mut self) -> Vec<u8> {
        // One number between the two ends says all; what follows may be anything.
        self.bytes.extend_from_slice(&self.high.to_be_bytes());
        self.bytes
    }
}

/// Where between two ends a bit of this probability parts them.
fn middle(low: u32, high: u32, model: Bit) -> u32 {
    low + ((u64::from(high - low) * u64::from(model.p)) >> 16) as u32
}

impl Coder for Encoder {
    #[inline]
    fn code(&mut self, bit: bool, model: &mut Bit) -> bool {
        let middle = middle(self.low, self.high, *model);
        if bit {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        model.learn(bit);
        while (self.low ^ self.high) >> 24 == 0 {
            self.bytes.push((self.high >> 24) as u8);
            self.low <<= 8;
            self.high = self.high << 8 | 255;
        }
        bit
    }
}

/// Reads bits.
#[derive(Debug)]
pub(super) struct Decoder<'a> {
    low: u32,
    high: u32,
    value: u32,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self {
            low: 0,
            high: u32::MAX,
            value: 0,
            bytes,
            at: 0,
        };
        for _ in 0..4 {
            decoder.next_byte();
        }
        decoder
    }

    fn next_byte(&mut self) {
        let byte = self.bytes.get(self.at).copied().unwrap_or(0);
        self.value = self.value << 8 | u32::from(byte);
        self.at += 1;
    }
}

impl Coder for Decoder<'_> {
    fn is_spent(&self) -> bool {
        self.at > self.bytes.len() + 4
    }

    #[inline]
    fn code(&mut self, _: bool, model: &mut Bit) -> bool {
        let middle = middle(self.low, self.high, *model);
        let bit = self.value <= middle;
        if bit {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        model.learn(bit);
        while (self.low ^ self.high) >> 24 == 0 {
            self.low <<= 8;
            self.high = self.high << 8 | 255;
            self.next_byte();
        }
        bit
    }
}

/// Bytes whose probabilities follow from the byte before: for headers and times.
pub(super) fn code_bytes(coder: &mut impl Coder, bytes: &[u8]) -> Vec<u8> {
    let mut models = vec![Bit::EVEN; 256 * 256];
    let mut lengths = Lengths::new();
    let num = coder.length(bytes.len() as u32, &mut lengths);
    let mut before = 0_usize;
    let mut found = Vec::new();
    for at in 0..num as usize {
        if coder.is_spent() {
            break;
        }
        let byte = bytes.get(at).copied().unwrap_or(0);
        let models = &mut models[before * 256..(before + 1) * 256];
        before = coder.number(byte.into(), 8, models) as usize;
        found.push(before as u8);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read(
            values in prop::collection::vec((any::<u32>(), 0_u32..32), 0..300),
            bytes in prop::collection::vec(any::<u8>(), 0..300),
        ) {
            fn all(coder: &mut impl Coder, values: &[u32]) -> Vec<u32> {
                let mut lengths = Lengths::new();
                values.iter().map(|&value| coder.length(value, &mut lengths)).collect()
            }
            let values: Vec<u32> = values.into_iter().map(|(value, by)| value >> by).collect();
            let mut encoder = Encoder::new();
            all(&mut encoder, &values);
            code_bytes(&mut encoder, &bytes);
            let written = encoder.finish();
            let mut decoder = Decoder::new(&written);
            let nothing = vec![0; values.len()];
            prop_assert_eq!(all(&mut decoder, &nothing), values);
            prop_assert_eq!(code_bytes(&mut decoder, &[]), bytes);
            prop_assert!(!decoder.is_spent());
        }
    }

    #[test]
    fn what_is_likely_takes_few_bits() {
        let mut encoder = Encoder::new();
        let mut model = Bit::EVEN;
        for i in 0..80_000 {
            encoder.code(i % 100 == 0, &mut model);
        }
        // The entropy of 1 in 100 is 0.081 bits.
        let num_bytes = encoder.finish().len();
        assert!(num_bytes < 1_000, "{num_bytes}");
    }
}

//! Which symbols and bits follow in the coded data of a JPEG?
//!
//! Codes of up to 16 bits, the canonical ones of ITU-T T.81 annex C. In the data, a byte 0xFF is
//! followed by 0x00; any other byte there makes it a marker, at which the data ends.

/// Codes of so many bits are looked up in one step.
const FAST_BITS: u32 = 9;

/// The codes of one table.
#[derive(Clone)]
pub(super) struct Huffman {
    /// (bits of the code, symbol) by the next [`FAST_BITS`] bits; no bits: the code is longer.
    fast: Vec<(u8, u8)>,
    /// By bits of the code less one: one more than the last code of that length, in 16 bits; and
    /// what a code of that length is less than the place of its symbol.
    longer: [(u32, i32); 16],
    symbols: Vec<u8>,
}

impl Huffman {
    /// `counts[n]` codes have n + 1 bits; `None` if there are not as many symbols, or more codes
    /// than fit.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let total: usize = counts.iter().map(|&count| usize::from(count)).sum();
        if total != symbols.len() || total > 256 {
            return None;
        }
        let mut fast = vec![(0, 0); 1 << FAST_BITS];
        let mut longer = [(0, 0); 16];
        let (mut code, mut place) = (0_u32, 0_usize);
        for (bits, &count) in (1..=16_u32).zip(counts) {
            let first = code;
            for &symbol in &symbols[place..place + usize::from(count)] {
                if code >= 1 << bits {
                    return None;
                }
                if bits <= FAST_BITS {
                    let free = FAST_BITS - bits;
                    let from = (code << free) as usize;
                    fast[from..from + (1 << free)].fill((bits as u8, symbol));
                }
                code += 1;
            }
            let end = if count == 0 { 0 } else { code << (16 - bits) };
            longer[bits as usize - 1] = (end, first as i32 - place as i32);
            place += usize::from(count);
            code <<= 1;
        }
        Some(Self {
            fast,
            longer,
            symbols: symbols.to_vec(),
        })
    }

    /// (bits of the code, symbol) that these 16 bits begin with.
    fn find(&self, next_16: u32) -> Option<(u32, u8)> {
        let (bits, symbol) = self.fast[(next_16 >> (16 - FAST_BITS)) as usize];
        if bits > 0 {
            return Some((u32::from(bits), symbol));
        }
        (FAST_BITS + 1..=16).find_map(|bits| {
            let (end, shift) = self.longer[bits as usize - 1];
            let place = (next_16 >> (16 - bits)) as i32 - shift;
            let symbol = self.symbols.get(usize::try_from(place).ok()?)?;
            (next_16 < end).then_some((bits, *symbol))
        })
    }
}

/// Why coded data cannot be read on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// It ends.
    Short,
    /// No symbol has this code, or the symbol cannot stand here.
    Code,
    /// The table of its codes was never given.
    NoTable,
}

/// Reads coded data bit by bit.
pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    ahead: u64,
    num_ahead: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self {
            bytes,
            at,
            ahead: 0,
            num_ahead: 0,
        }
    }

    fn fill(&mut self) {
        while self.num_ahead <= 48 {
            let Some(&byte) = self.bytes.get(self.at) else {
                return;
            };
            if byte == 0xFF {
                if self.bytes.get(self.at + 1) != Some(&0) {
                    return;
                }
                self.at += 1;
            }
            self.at += 1;
            self.ahead = self.ahead << 8 | u64::from(byte);
            self.num_ahead += 8;
        }
    }

    /// The next 16 bits, with zeros behind the last one.
    fn peek_16(&self) -> u32 {
        let bits = if self.num_ahead >= 16 {
            self.ahead >> (self.num_ahead - 16)
        } else {
            self.ahead << (16 - self.num_ahead)
        };
        (bits & 0xFFFF) as u32
    }

    /// At most 16 bits as a number.
    pub(super) fn take(&mut self, count: u32) -> Result<u32, Fault> {
        if self.num_ahead < count {
            self.fill();
        }
        if self.num_ahead < count {
            return Err(Fault::Short);
        }
        self.num_ahead -= count;
        Ok((self.ahead >> self.num_ahead) as u32 & ((1 << count) - 1))
    }

    pub(super) fn symbol(&mut self, table: &Huffman) -> Result<u8, Fault> {
        if self.num_ahead < 16 {
            self.fill();
        }
        let found = table.find(self.peek_16());
        match found {
            Some((bits, symbol)) if bits <= self.num_ahead => {
                self.num_ahead -= bits;
                Ok(symbol)
            }
            _ if self.num_ahead < 16 => Err(Fault::Short),
            _ => Err(Fault::Code),
        }
    }

    /// Ends the data: where the next marker is (or the file ends), how many whole bytes of data are
    /// left over before it, and whether these, and the bits before them, are all zeros or all ones.
    pub(super) fn finish(&self) -> (usize, usize, bool) {
        let mut at = self.at;
        let mut left = (self.num_ahead / 8) as usize;
        // The rest of a byte that was begun; then whole bytes, of those ahead and behind them.
        let num_rest = self.num_ahead % 8;
        let num_whole = self.num_ahead - num_rest;
        let rest = (self.ahead >> num_whole) & ((1 << num_rest) - 1);
        let is_rest_padding = rest == 0 || rest == (1 << num_rest) - 1;
        let whole = self.ahead & ((1 << num_whole) - 1);
        let (mut any_zero, mut any_one) = (whole.count_ones() < num_whole, whole != 0);
        while at < self.bytes.len() && !is_marker(self.bytes, at) {
            // The zero behind a byte of ones is none of the data.
            let is_stuffing = at > 0 && self.bytes[at - 1] == 0xFF && self.bytes[at] == 0;
            if !is_stuffing {
                any_zero |= self.bytes[at] != 0xFF;
                any_one |= self.bytes[at] != 0;
                left += 1;
            }
            at += 1;
        }
        (at, left, is_rest_padding && !(any_zero && any_one))
    }
}

/// Whether a marker begins here.
pub(super) fn is_marker(bytes: &[u8], at: usize) -> bool {
    bytes.get(at) == Some(&0xFF) && bytes.get(at + 1).is_some_and(|&next| next != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten codes: 0, 10, and eight of 11 bits that begin with 11000000.
    fn table() -> Huffman {
        let mut counts = [0; 16];
        (counts[0], counts[1], counts[10]) = (1, 1, 8);
        Huffman::new(&counts, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]).expect("fits")
    }

    #[test]
    fn short_and_long_codes_are_read_until_the_marker() {
        // 0, 10, 11000000000, 11000000110, then ones.
        let bytes = [
            0b0101_1000,
            0b0000_0011,
            0b0000_0011,
            0b0111_1111,
            0xFF,
            0xD9,
        ];
        let mut bits = Bits::new(&bytes, 0);
        let read: Vec<_> = (0..4).map(|_| bits.symbol(&table())).collect();
        assert_eq!(read, [Ok(1), Ok(2), Ok(3), Ok(9)]);
        assert_eq!(bits.symbol(&table()), Err(Fault::Short));
        assert_eq!(bits.finish(), (4, 0, true));
    }

    #[test]
    fn stuffed_bytes_count_once_and_codes_that_are_none_are_named() {
        let bytes = [0xFF, 0, 0xFF, 0, 0x12, 0xFF, 0xD0];
        let mut bits = Bits::new(&bytes, 0);
        assert_eq!(bits.symbol(&table()), Err(Fault::Code));
        assert_eq!(bits.take(12), Ok(0xFFF));
        assert_eq!(bits.take(12), Ok(0xF12));
        assert_eq!(bits.finish(), (5, 0, true));
    }

    #[test]
    fn more_codes_than_fit_are_no_table() {
        let mut counts = [0; 16];
        counts[0] = 3;
        assert!(Huffman::new(&counts, &[1, 2, 3]).is_none());
        assert!(Huffman::new(&counts, &[1]).is_none());
    }
}

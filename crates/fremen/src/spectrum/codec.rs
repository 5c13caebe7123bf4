//! How are models written as few bytes?
//!
//! Little-endian, LEB128 variable-length integers (7 bits a byte, low bits first; signed ones by
//! zigzag), and a CRC-32 of everything before it at the end.

use crate::error::{Error, ErrorKind, Result};

/// Bytes under way; starts with a tag of four bytes that names format and version.
pub(crate) struct Writer(Vec<u8>);

impl Writer {
    pub(crate) fn new(tag: [u8; 4]) -> Self {
        Self(tag.to_vec())
    }

    pub(crate) fn byte(&mut self, value: u8) {
        self.0.push(value);
    }

    pub(crate) fn u16(&mut self, value: u16) {
        self.0.extend(value.to_le_bytes());
    }

    pub(crate) fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    pub(crate) fn signed(&mut self, value: i64) {
        self.varint(((value << 1) ^ (value >> 63)) as u64);
    }

    pub(crate) fn float(&mut self, value: f64) {
        self.0.extend(value.to_le_bytes());
    }

    pub(crate) fn floats(&mut self, values: impl IntoIterator<Item = f64>) {
        for value in values {
            self.float(value);
        }
    }

    /// Bytes that carry their own tag and checksum, behind their length.
    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.varint(bytes.len() as u64);
        self.0.extend(bytes);
    }

    pub(crate) fn finish(mut self) -> Vec<u8> {
        let crc = crc32fast::hash(&self.0);
        self.0.extend(crc.to_le_bytes());
        self.0
    }
}

/// The rest of some bytes whose tag and checksum have been found right.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    what: &'static str,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8], tag: [u8; 4], what: &'static str) -> Result<Self> {
        let Some((body, crc)) = bytes.split_last_chunk::<4>() else {
            return Err(Error::new(
                ErrorKind::Format,
                format!("{} bytes are too few for {what}", bytes.len()),
            ));
        };
        if !body.starts_with(&tag) {
            return Err(Error::new(
                ErrorKind::Format,
                format!("these bytes are not {what} of a known version"),
            ));
        }
        // A fuzzer, which cannot guess a checksum, gets behind it.
        if crc32fast::hash(body) != u32::from_le_bytes(*crc) && !cfg!(fuzzing) {
            return Err(Error::new(
                ErrorKind::Checksum,
                format!("{what} is damaged: its checksum does not match"),
            ));
        }
        Ok(Self {
            bytes: body,
            at: tag.len(),
            what,
        })
    }

    /// The error for a value that no writer makes.
    pub(crate) fn impossible(&self, message: &str) -> Error {
        Error::new(ErrorKind::Format, format!("{}: {message}", self.what))
            .with_place(format!("byte {}", self.at))
    }

    pub(crate) fn byte(&mut self) -> Result<u8> {
        let byte = self.bytes.get(self.at).copied();
        let byte = byte.ok_or_else(|| self.impossible("ends too early"))?;
        self.at += 1;
        Ok(byte)
    }

    pub(crate) fn u16(&mut self) -> Result<u16> {
        Ok(u16::from_le_bytes([self.byte()?, self.byte()?]))
    }

    pub(crate) fn varint(&mut self) -> Result<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            let bits = u64::from(byte & 0x7F);
            if shift == 63 && bits > 1 {
                break;
            }
            value |= bits << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(self.impossible("a number has more than 64 bits"))
    }

    pub(crate) fn signed(&mut self) -> Result<i64> {
        let value = self.varint()?;
        Ok((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// As many numbers, none of which is infinite or NaN.
    pub(crate) fn floats(&mut self, count: usize) -> Result<Vec<f64>> {
        let bytes = self.take(count, 8)?;
        let (chunks, _) = bytes.as_chunks::<8>();
        let values: Vec<f64> = chunks.iter().map(|it| f64::from_le_bytes(*it)).collect();
        if values.iter().all(|value| value.is_finite()) {
            Ok(values)
        } else {
            Err(self.impossible("a number is not finite"))
        }
    }

    pub(crate) fn u16s(&mut self, count: usize) -> Result<Vec<u16>> {
        let (chunks, _) = self.take(count, 2)?.as_chunks::<2>();
        Ok(chunks.iter().map(|it| u16::from_le_bytes(*it)).collect())
    }

    /// What [`Writer::bytes`] wrote.
    pub(crate) fn bytes(&mut self) -> Result<&'a [u8]> {
        let len = self.count(1)?;
        self.take(len, 1)
    }

    /// A number of things that take at least `least` bytes each, so that no file can claim more
    /// memory than it is long.
    pub(crate) fn count(&mut self, least: usize) -> Result<usize> {
        let count = usize::try_from(self.varint()?).ok();
        let fits = |count: &usize| {
            count
                .checked_mul(least)
                .is_some_and(|it| it <= self.rest().len())
        };
        count
            .filter(fits)
            .ok_or_else(|| self.impossible("more items than bytes"))
    }

    fn take(&mut self, count: usize, size: usize) -> Result<&'a [u8]> {
        let len = count.checked_mul(size);
        let taken = len.and_then(|len| self.rest().get(..len));
        let taken = taken.ok_or_else(|| self.impossible("ends too early"))?;
        self.at += taken.len();
        Ok(taken)
    }

    /// Bytes not read yet.
    pub(crate) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// Fails unless everything has been read.
    pub(crate) fn finish(self) -> Result<()> {
        if self.at == self.bytes.len() {
            Ok(())
        } else {
            Err(self.impossible("bytes are left over"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TAG: [u8; 4] = *b"test";

    #[test]
    fn numbers_come_back() {
        let signed = [0, -1, 1, i64::MIN, i64::MAX, 63, 64, -64, -65];
        let mut writer = Writer::new(TAG);
        for value in signed {
            writer.signed(value);
            writer.varint(value as u64);
        }
        let bytes = writer.finish();
        let mut reader = Reader::new(&bytes, TAG, "a test").expect("own bytes");
        for value in signed {
            assert_eq!(reader.signed().expect("written"), value);
            assert_eq!(reader.varint().expect("written"), value as u64);
        }
        reader.finish().expect("nothing left");
    }

    #[test]
    fn every_flipped_bit_and_every_cut_is_found() {
        let mut writer = Writer::new(TAG);
        writer.varint(12_345);
        let bytes = writer.finish();
        for bit in 0..bytes.len() * 8 {
            let mut bytes = bytes.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(Reader::new(&bytes, TAG, "a test").is_err(), "bit {bit}");
        }
        for len in 0..bytes.len() {
            assert!(Reader::new(&bytes[..len], TAG, "a test").is_err(), "{len}");
        }
    }
}
